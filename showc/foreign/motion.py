"""Algebra on the tracks of a fleet: parts, derivatives, greatest values, differences.

All bounds are enclosures by Bernstein coefficients (Farouki 2012, The Bernstein
polynomial basis: a centennial retrospective, section 4): they hold at every instant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.bernstein import basis, elevate, halves
from showc.verify.kernel.slices import Tracks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from showc.arrays import FloatArray, IntArray


ROWS_AT_ONCE = 5_000
"""Polynomials that are looked at together: what they take stays near the processor."""

SHORTEST = 1e-9
"""Pieces shorter than this are rounding of the same instant [s]."""

_ROUNDS = 60
"""Halvings of a piece after which its ends are neighbouring numbers of float64."""


@dataclass(frozen=True, slots=True)
class Greatest:
    """The greatest value of something over a fleet and its whole time."""

    upper: float
    """It is not exceeded at any instant."""
    lower: float
    """It is reached."""
    drone: int
    """Where it is reached, counting from 0."""
    time: float
    """When [s]."""


def values(coefficients: FloatArray, fraction: FloatArray) -> FloatArray:
    """Values at one ``fraction`` (..., n) each; shape (..., n, components)."""
    weights = basis(coefficients.shape[-2] - 1, fraction)
    return np.asarray(np.matmul(weights[..., None, :], coefficients)[..., 0, :])


def owners(tracks: Tracks) -> IntArray:
    """Drone of each row."""
    return np.repeat(np.arange(tracks.drones), np.diff(tracks.first))


def chosen(tracks: Tracks, drones: slice) -> Tracks:
    """Return the tracks of some neighbouring drones."""
    low, high, _ = drones.indices(tracks.drones)
    part = slice(int(tracks.first[low]), int(tracks.first[high]))
    return replace(
        tracks,
        first=tracks.first[low : high + 1] - tracks.first[low],
        starts=tracks.starts[part],
        ends=tracks.ends[part],
        position=tracks.position[part],
    )


def portions(tracks: Tracks, rows: int = ROWS_AT_ONCE) -> Iterator[tuple[int, Tracks]]:
    """Cut a fleet into some drones at a time: number of the first, and their tracks."""
    low = 0
    while low < tracks.drones:
        high = int(
            np.searchsorted(tracks.first, tracks.first[low] + rows, side="right")
        )
        high = min(max(high - 1, low + 1), tracks.drones)
        yield low, chosen(tracks, slice(low, high))
        low = high


def derivative(tracks: Tracks) -> Tracks:
    """Return the derivative with respect to time, one degree lower."""
    degree = tracks.position.shape[1] - 1
    if degree == 0:
        return replace(tracks, position=np.zeros_like(tracks.position))
    width = (tracks.ends - tracks.starts)[:, None, None]
    return replace(tracks, position=degree * np.diff(tracks.position, axis=1) / width)


def jumps(tracks: Tracks) -> tuple[IntArray, FloatArray]:
    """Rows that do not begin where the one before ends, and by how much they miss.

    Returns
    -------
    rows
        Numbers of the rows that follow another of the same drone, shape (n,).
    ndarray
        Difference of the values at the joint, shape (n, components).
    """
    owner = owners(tracks)
    rows = np.flatnonzero(owner[1:] == owner[:-1]) + 1
    return rows, tracks.position[rows, 0] - tracks.position[rows - 1, -1]


def common(
    first: Tracks, second: Tracks, begin: float, end: float
) -> tuple[Tracks, Tracks]:
    """Write two fleets on the same pieces, those of both, from ``begin`` to ``end``.

    Both must cover that time.
    """
    count = first.drones
    owner = np.concatenate([owners(first), owners(second)])
    low = np.clip(np.concatenate([first.starts, second.starts]), begin, end)
    order = np.lexsort((low, owner))
    owner, low = owner[order], low[order]
    same = np.append(owner[1:] == owner[:-1], False)
    high = np.where(same, np.append(low[1:], end), end)
    keep = high - low > SHORTEST
    owner, low, high = owner[keep], low[keep], high[keep]
    starts = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=count))])
    middle = 0.5 * (low + high)
    return tuple(  # type: ignore[return-value]
        Tracks(
            begin,
            end,
            starts.astype(np.int64),
            low,
            high,
            tracks.between(tracks.at(owner, middle), low, high),
        )
        for tracks in (first, second)
    )


def during(tracks: Tracks, begin: float, end: float) -> Tracks:
    """Return what a fleet flies from ``begin`` to ``end``, which it must cover."""
    low, high = np.maximum(tracks.starts, begin), np.minimum(tracks.ends, end)
    keep = np.flatnonzero(high - low > SHORTEST)
    low, high = low[keep], high[keep]
    position = tracks.position[keep]
    cut = np.flatnonzero((low > tracks.starts[keep]) | (high < tracks.ends[keep]))
    position[cut] = tracks.between(keep[cut], low[cut], high[cut])
    counts = np.bincount(owners(tracks)[keep], minlength=tracks.drones)
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Tracks(begin, end, first, low, high, position)


def difference(first: Tracks, second: Tracks) -> Tracks:
    """Return the difference of two fleets, over the time that both cover."""
    one, other = common(
        first, second, max(first.begin, second.begin), min(first.end, second.end)
    )
    degree = max(one.position.shape[1], other.position.shape[1]) - 1
    return replace(
        one, position=elevate(one.position, degree) - elevate(other.position, degree)
    )


def greatest(
    tracks: Tracks, measured: Callable[[FloatArray], FloatArray], resolution: float
) -> Greatest:
    """Enclose the greatest value of a quasi-convex function of the components.

    Such a function is nowhere in a hull greater than at its corners: the control points
    of a piece bound it from above, its values at the ends from below, and pieces that
    could hold more than is known are halved.

    Parameters
    ----------
    tracks
        What moves: positions, velocities, differences.
    measured
        From components (..., k) to values (...); quasi-convex.
    resolution
        Width of the enclosure, in the unit of the values.
    """
    value = measured(tracks.position)
    ends = np.maximum(value[:, 0], value[:, -1])
    row = int(np.argmax(ends))
    lower = float(ends[row])
    at_end = value[row, -1] > value[row, 0]
    time = float((tracks.ends if at_end else tracks.starts)[row])
    rows = np.flatnonzero(value.max(axis=1) > lower + resolution)
    work, low, high = tracks.position[rows], tracks.starts[rows], tracks.ends[rows]
    upper = lower + resolution
    for _ in range(_ROUNDS):
        keep = measured(work).max(axis=1) > lower + resolution
        if not keep.any():
            return Greatest(lower + resolution, lower, _owner(tracks, row), time)
        left, right = halves(work[keep])
        rows, low, high = rows[keep], low[keep], high[keep]
        middle = 0.5 * (low + high)
        reached = measured(right[:, 0])
        index = int(np.argmax(reached))
        if reached[index] > lower:
            lower, row = float(reached[index]), int(rows[index])
            time = float(middle[index])
        rows = np.tile(rows, 2)
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        work = np.concatenate([left, right])
        upper = float(measured(work).max())
    return Greatest(max(upper, lower), lower, _owner(tracks, row), float(time))


def _owner(tracks: Tracks, row: int) -> int:
    return int(np.searchsorted(tracks.first, row, side="right")) - 1


def length(axes: tuple[int, ...]) -> Callable[[FloatArray], FloatArray]:
    """Return the function that measures the length of some components."""

    def measured(components: FloatArray) -> FloatArray:
        part = components[..., list(axes)]
        return np.asarray(np.sqrt(np.einsum("...k,...k->...", part, part)))

    return measured


def component(axis: int, sign: float = 1.0) -> Callable[[FloatArray], FloatArray]:
    """Return the function that takes ``sign`` times one component."""
    return lambda components: np.asarray(sign * components[..., axis])


def over_fleet(tracks: Tracks, search: Callable[[Tracks], Greatest]) -> Greatest:
    """Run a search over a fleet, some drones at a time."""
    found: Greatest | None = None
    for first, part in portions(tracks):
        one = search(part)
        one = replace(one, drone=one.drone + first)
        if found is None:
            found = one
        else:
            inner = one if one.lower > found.lower else found
            found = replace(inner, upper=max(one.upper, found.upper))
    if found is None:
        raise ValueError("a fleet without drones")
    return found


def standing(tracks: Tracks, begin: float, end: float) -> Tracks:
    """Fill up the time before each first piece and after each last: the drone stands.

    The result covers the time from ``begin`` to ``end``, which must not be shorter than
    that of any drone.
    """
    count, points = tracks.drones, tracks.position.shape[1]
    head, tail = tracks.first[:-1], tracks.first[1:] - 1
    drones = np.arange(count)
    owner = np.concatenate([drones, owners(tracks), drones])
    low = np.concatenate([np.full(count, begin), tracks.starts, tracks.ends[tail]])
    high = np.concatenate([tracks.starts[head], tracks.ends, np.full(count, end)])
    body = np.concatenate(
        [
            np.repeat(tracks.position[head, :1], points, axis=1),
            tracks.position,
            np.repeat(tracks.position[tail, -1:], points, axis=1),
        ]
    )
    keep = np.flatnonzero(high - low > SHORTEST)
    order = keep[np.lexsort((low[keep], owner[keep]))]
    counts = np.bincount(owner[keep], minlength=count)
    return Tracks(
        begin,
        end,
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        low[order],
        high[order],
        body[order],
    )


def place_at(tracks: Tracks, time: float) -> FloatArray:
    """Where all drones are at ``time`` [s], shape (drones, components)."""
    drones = np.arange(tracks.drones)
    row = tracks.at(drones, np.full(tracks.drones, time))
    width = tracks.ends[row] - tracks.starts[row]
    share = np.clip((time - tracks.starts[row]) / width, 0.0, 1.0)
    return values(tracks.position[row], share)
