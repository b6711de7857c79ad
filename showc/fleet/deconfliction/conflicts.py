"""Where two drones come too near: detection in continuous time, on the polynomials.

Time is cut into slots; in each slot every drone sweeps a box (the hull of its
Bernstein coefficients), and a k-d tree over the boxes names the few pairs that can
meet. For those the relative motion is bounded from below by its Bernstein coefficients
along a separating direction, and halved until the bound decides (branch and bound; the
coefficients enclose the polynomial, so nothing is missed between samples).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.neighbours import all_pairs, least_distance, near_pairs
from showc.fleet.deconfliction.tracks import Pieces, Tracks, cut
from showc.trajectory import bernstein_basis, restrict
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.vehicle import Separation


RESOLUTION = 1e-6
"""To what the least distance of a pair is found [m]."""
_BLOCK = 100_000
"""Pairs that are looked at together: bounds the memory."""
_HALVINGS = 40
"""Halvings of a second that leave less than a picosecond: the end of any search."""


@dataclass(frozen=True, slots=True, eq=False)
class Encounters:
    """Pairs and their nearest approach, each array of shape (m,)."""

    first: IntArray
    """Lower index of the pair."""
    second: IntArray
    """Higher index; those from ``Tracks.moving`` on stand still."""
    time: FloatArray
    """When they are nearest [s]."""
    distance: FloatArray
    """How near, in the separation's metric [m], to ``RESOLUTION`` from above."""

    def __len__(self) -> int:
        return int(self.first.size)


def conflicts(tracks: Tracks, separation: Separation, radius: float) -> Encounters:
    """Find all pairs that come nearer than ``radius``, sorted by their indices.

    A pair that stays ``radius`` apart is never named; one that comes nearer than
    ``radius`` always is.
    """
    found = _search(tracks, separation, radius, only_closest=False)
    keep = found.distance < radius
    return Encounters(
        found.first[keep], found.second[keep], found.time[keep], found.distance[keep]
    )


def closest(tracks: Tracks, separation: Separation) -> Encounters:
    """Find the nearest approach of all pairs: one encounter, or none if alone."""
    if tracks.moving == 0 or tracks.count < 2:
        none = np.zeros(0, dtype=np.int64)
        return Encounters(none, none, np.zeros(0), np.zeros(0))
    radius = _sampled_distance(tracks, separation)
    found = _search(tracks, separation, radius + RESOLUTION, only_closest=True)
    best = np.lexsort((found.second, found.first, found.distance))[:1]
    return Encounters(
        found.first[best], found.second[best], found.time[best], found.distance[best]
    )


def standing(
    points: FloatArray, moving: int, separation: Separation, radius: float
) -> Encounters:
    """Find the pairs of drones that stand nearer than ``radius``, the nearest first.

    Parameters
    ----------
    points
        Where drones stand, shape (n, 3) [m].
    moving
        How many of these, the first ones, count among themselves and with the others.
    """
    scaled = points * np.asarray(separation.metric_scale)
    if separation.shape == "all-axes":
        first, second = all_pairs(points.shape[0])
    else:
        first, second = near_pairs(scaled, radius, _norm(separation))
    first, second = first[first < moving], second[first < moving]
    distance = _measure(scaled[first] - scaled[second], separation)
    order = np.lexsort((second, first, distance))
    order = order[distance[order] < radius]
    time = np.zeros(order.size)
    return Encounters(first[order], second[order], time, distance[order])


def _sampled_distance(tracks: Tracks, separation: Separation) -> float:
    """Least distance over all pairs at a few instants: above the true least."""
    scale = np.asarray(separation.metric_scale)
    least = np.inf
    for time in np.linspace(0.0, tracks.duration, 9):
        points = tracks.at(float(time)) * scale
        if separation.shape == "all-axes" or tracks.moving < tracks.count:
            for index in range(tracks.moving):
                gap = points[index + 1 :] - points[index]
                if gap.size:
                    least = min(least, float(_measure(gap, separation).min()))
            continue
        least = min(least, least_distance(points, _norm(separation)))
    return least


def _search(
    tracks: Tracks, separation: Separation, radius: float, *, only_closest: bool
) -> Encounters:
    count = tracks.count
    pieces = cut(tracks, np.asarray(separation.metric_scale), radius)
    best: dict[int, tuple[float, float]] = {}
    limit = radius
    for keys, first, second in _candidates(pieces, tracks.moving, separation, radius):
        for top in range(0, first.size, _BLOCK):
            block = slice(top, top + _BLOCK)
            relative = pieces.relative(keys[block], first[block], second[block])
            pair, time, distance = _least(
                relative[0] * count + relative[1],
                *relative[2:],
                separation,
                limit,
                only_closest=only_closest,
            )
            for key, when, value in zip(
                pair.tolist(), time.tolist(), distance.tolist(), strict=True
            ):
                if key not in best or value < best[key][1]:
                    best[key] = (when, value)
            if only_closest and distance.size:
                limit = min(limit, float(distance.min()))
    keys = np.array(sorted(best), dtype=np.int64)
    values = np.array([best[int(key)] for key in keys]).reshape(-1, 2)
    return Encounters(keys // count, keys % count, values[:, 0], values[:, 1])


def _candidates(
    pieces: Pieces, moving: int, separation: Separation, radius: float
) -> Iterator[tuple[IntArray, IntArray, IntArray]]:
    """Yield slots and pairs whose boxes come nearer than ``radius``."""
    slots, first, second = [], [], []
    waiting = 0
    for slot, (lower, upper) in enumerate(zip(*pieces.boxes(), strict=True)):
        centre, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        if separation.shape == "all-axes":
            a, b = all_pairs(lower.shape[0])
        else:
            reach = 2.0 * float(np.linalg.norm(half, axis=1).max())
            a, b = near_pairs(centre, radius + reach, _norm(separation))
        near = a < moving
        a, b = a[near], b[near]
        gap = np.maximum(np.abs(centre[a] - centre[b]) - half[a] - half[b], 0.0)
        near = _measure(gap, separation) < radius
        slots.append(np.full(int(near.sum()), slot))
        first.append(a[near])
        second.append(b[near])
        waiting += int(near.sum())
        if waiting >= _BLOCK or slot == pieces.slots - 1:
            yield np.concatenate(slots), np.concatenate(first), np.concatenate(second)
            slots, first, second, waiting = [], [], [], 0


def _norm(separation: Separation) -> float:
    """Order of the norm that the separation is measured in, all axes at once."""
    return np.inf if separation.shape == "any-axis" else 2.0


def _measure(difference: FloatArray, separation: Separation) -> FloatArray:
    """Distance of a difference that is already in metric coordinates."""
    if separation.shape in ("any-axis", "all-axes"):
        return measure(difference, separation)
    return np.asarray(np.sqrt(np.einsum("...c,...c->...", difference, difference)))


def _least(  # noqa: PLR0917 - arrays of one loop
    pair: IntArray,
    begin: FloatArray,
    end: FloatArray,
    coefficients: FloatArray,
    separation: Separation,
    radius: float,
    *,
    only_closest: bool,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Least distance of each pair below ``radius``: pairs, times, distances."""
    pairs, index = np.unique(pair, return_inverse=True)
    least = np.full(pairs.size, np.inf)
    when = np.zeros(pairs.size)
    degree = coefficients.shape[1] - 1
    for _ in range(_HALVINGS):
        lower, fraction = _bound(coefficients, separation)
        limit = (
            min(radius, float(least.min(initial=np.inf))) if only_closest else radius
        )
        keep = lower < limit
        if not keep.any():
            break
        index, begin, end = index[keep], begin[keep], end[keep]
        coefficients, lower, fraction = (
            coefficients[keep],
            lower[keep],
            fraction[keep],
        )
        basis = bernstein_basis(degree, fraction)
        for part, value in (
            (fraction, np.einsum("nk,nkc->nc", basis, coefficients)),
            (np.zeros_like(fraction), coefficients[:, 0]),
            (np.ones_like(fraction), coefficients[:, -1]),
        ):
            distance = _measure(value, separation)
            order = np.lexsort((distance, index))
            head = np.concatenate([[True], np.diff(index[order]) > 0])
            chosen = order[head]
            better = chosen[distance[chosen] < least[index[chosen]]]
            least[index[better]] = distance[better]
            when[index[better]] = begin[better] + part[better] * (
                end[better] - begin[better]
            )
        best = float(least.min()) if only_closest else least[index]
        keep = lower < np.minimum(best, radius) - RESOLUTION
        if not keep.any():
            break
        index, begin, end = index[keep], begin[keep], end[keep]
        coefficients = coefficients[keep]
        half = np.full((index.size, 1, 1), 0.5)
        middle = 0.5 * (begin + end)
        coefficients = np.concatenate(
            [
                restrict(coefficients, 0.0 * half, half),
                restrict(coefficients, half, 2.0 * half),
            ]
        )
        index = np.concatenate([index, index])
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
    found = np.isfinite(least)
    return pairs[found], when[found], least[found]


def _bound(
    coefficients: FloatArray, separation: Separation
) -> tuple[FloatArray, FloatArray]:
    """Lower bound of the distance on each interval, and where to look for the least.

    The direction is that of the nearest point of the chord, which makes the bound
    exact for relative motion along a straight line.
    """
    start = coefficients[:, 0]
    chord = coefficients[:, -1] - start
    square = np.einsum("nc,nc->n", chord, chord)
    along = -np.einsum("nc,nc->n", start, chord)
    fraction = np.clip(along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    if separation.shape in ("any-axis", "all-axes"):
        low, high = coefficients.min(axis=1), coefficients.max(axis=1)
        per_axis = np.maximum(np.maximum(low, -high), 0.0)
        return measure(per_axis, separation), fraction
    nearest = start + fraction[:, None] * chord
    size = np.sqrt(np.einsum("nc,nc->n", nearest, nearest))
    normal = nearest / np.where(size > 0.0, size, 1.0)[:, None]
    lower = np.einsum("nkc,nc->nk", coefficients, normal).min(axis=1)
    return np.maximum(lower, 0.0), fraction
