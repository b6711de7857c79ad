"""Slices of time in which drones fly almost straight, and which could meet in them.

**Lemma.** A pair that :meth:`Slice.near` leaves out comes no nearer in the slice than
the distance it was asked for.

Proof. In a slice a drone's position differs from the chord of its flight, the straight
and even motion from where the slice finds it to where it leaves it, by no more than the
greatest difference of their Bernstein coefficients. So two drones come no nearer than
their chords do, less the two differences; and no nearer than the middles of their
chords, less the radii of the balls around them that hold all coefficients. Two points
nearer than the edge of a lattice's cells lie in one cell or in neighbouring ones.

*Rounding.* Everything is worked out in fewer than 1000 steps: the caller takes
gamma_1000 (Higham 2002, section 3.1) of the greatest coordinate off what it concludes.
Coefficients enclose values by Farouki 2012, section 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.verify.kernel.tracks import Tracks


@dataclass(frozen=True, slots=True)
class Measure:
    """How a difference of positions becomes a distance."""

    axes: tuple[int, ...]
    """Axes that count."""
    scale: tuple[float, ...]
    """Factor on each of them."""
    largest: bool
    """Whether the distance is the largest component (else the Euclidean length)."""

    def __call__(self, difference: FloatArray, axis: int = -1) -> FloatArray:
        """Distances of differences, scaled already, that lie along one ``axis``."""
        if self.largest:
            return np.asarray(np.abs(difference).max(axis=axis))
        return np.asarray(np.sqrt(np.sum(difference**2, axis=axis)))

    def of_chords(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Lower bounds (n,) of the distances on the way from ``begin`` to ``end``.

        Both have the shape (n, axes). Of the Euclidean length it is the least itself.
        """
        if self.largest:
            # The greatest of the components' least values.
            least = np.minimum(np.abs(begin), np.abs(end))
            return np.asarray(np.where(begin * end < 0.0, 0.0, least).max(axis=-1))
        way = end - begin
        square = np.einsum("nk,nk->n", way, way)
        along = -np.einsum("nk,nk->n", begin, way)
        share = np.clip(along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        return self(begin + share[:, None] * way)


def measures(separation: pb.Separation) -> tuple[Measure, ...]:
    """Return the distances of which each must be at least the separation's.

    ``all-axes`` asks for three of them, the other forms for one.
    """
    shape = separation.shape
    if shape == pb.Separation.ALL_AXES:
        return tuple(Measure((axis,), (1.0,), largest=True) for axis in range(3))
    if shape == pb.Separation.ANY_AXIS:
        return (Measure((0, 1, 2), (1.0, 1.0, 1.0), largest=True),)
    stretch = separation.vertical_stretch if shape == pb.Separation.ELLIPSOID else 1.0
    return (Measure((0, 1, 2), (1.0, 1.0, 1.0 / stretch), largest=False),)


def near_pairs(points: FloatArray, reach: float) -> IntArray:
    """Pairs (n, 2) of points (m, axes), the first less, that may be within ``reach``.

    All pairs in one cell of a lattice with edges of ``reach``, or in cells that touch;
    no pair within ``reach`` is missing.
    """
    count = points.shape[0]
    if count < 2:
        return np.empty((0, 2), dtype=np.int64)
    extent = float(np.ptp(points, axis=0).max())
    # A lattice finer than a millionth of its extent would only cost memory.
    edge = max(reach * (1.0 + 1e-9), 1e-6 * extent, 1e-9)
    cell = np.zeros((count, 3), dtype=np.int64)
    cell[:, : points.shape[1]] = np.floor((points - points.min(axis=0)) / edge) + 1
    size = int(cell.max()) + 2
    key = (cell[:, 0] * size + cell[:, 1]) * size + cell[:, 2]
    order = np.argsort(key, kind="stable")
    ranked = key[order]
    found = []
    # Of neighbouring cells those with greater keys; three in a row have keys in a row.
    for across, along in ((0, 0), (0, 1), (1, -1), (1, 0), (1, 1)):
        middle = ranked + (across * size + along) * size
        first = np.searchsorted(ranked, middle - 1, side="left")
        # Each pair once: only points that come later in the order.
        first = np.maximum(first, np.arange(1, count + 1))
        many = np.maximum(np.searchsorted(ranked, middle + 1, side="right") - first, 0)
        one = np.repeat(np.arange(count), many)
        begin = np.cumsum(many) - many
        other = np.arange(one.size) + np.repeat(first - begin, many)
        found.append(np.column_stack([order[one], order[other]]))
    return np.sort(np.concatenate(found), axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """Where every drone is in a slice of time."""

    begin: FloatArray
    """Where each is at its start, shape (drones, axes)."""
    end: FloatArray
    """Where it is at its end, shape (drones, axes)."""
    radius: FloatArray
    """Of the ball around the middle of the chord that holds the flight, (drones,)."""
    away: FloatArray
    """How far the flight leaves the chord at most, shape (drones,)."""

    def near(self, measure: Measure, distance: float) -> IntArray:
        """Pairs (n, 2), the first less, that could come nearer than ``distance``."""
        middle = 0.5 * (self.begin + self.end)
        reach = distance + 2.0 * float(self.radius.max())
        pairs = near_pairs(middle, reach)
        first, second = pairs[:, 0], pairs[:, 1]
        gap = measure(middle[first] - middle[second])
        gap -= self.radius[first] + self.radius[second]
        pairs = pairs[gap < distance]
        first, second = pairs[:, 0], pairs[:, 1]
        gap = measure.of_chords(
            self.begin[first] - self.begin[second], self.end[first] - self.end[second]
        )
        gap -= self.away[first] + self.away[second]
        return np.asarray(pairs[gap < distance], dtype=np.int64)


def take(positions: Tracks, low: float, high: float, measure: Measure) -> Slice:
    """Restrict what all drones fly to a slice."""
    count = positions.drones
    row = positions.at(np.arange(count), np.full(count, low))
    last = positions.first[1:] - 1
    lows, highs = np.full(count, low), np.full(count, high)
    hull = positions.between(row, lows, highs)
    parts = [(np.arange(count), hull, row.copy())]
    more = np.flatnonzero((positions.ends[row] < high) & (row < last))
    while more.size:
        row[more] += 1
        part = positions.between(row[more], lows[more], highs[more])
        parts.append((more, part, row[more]))
        more = more[(positions.ends[row[more]] < high) & (row[more] < last[more])]
    begin, end = hull[:, 0], hull[:, -1].copy()
    for drones, part, _ in parts[1:]:
        end[drones] = part[:, -1]
    away = np.zeros(count)
    # Component by component and coefficient by coefficient, drones lie side by side.
    steps = np.linspace(0.0, 1.0, hull.shape[1])[:, None, None]
    for drones, part, rows in parts:
        since = np.clip((positions.starts[rows] - low) / (high - low), 0.0, 1.0)
        until = np.clip((positions.ends[rows] - low) / (high - low), 0.0, 1.0)
        until[rows == last[drones]] = 1.0
        chord = (end - begin)[drones].T
        off = part.transpose(1, 2, 0) - (begin[drones].T + since * chord)
        off -= steps * ((until - since) * chord)
        off = measure(off, axis=-2).max(axis=0)
        away[drones] = np.maximum(away[drones], off)
    radius = 0.5 * measure(end - begin) + away
    return Slice(begin, end, radius, away)


def edges(positions: Tracks, distance: float) -> Iterator[tuple[float, float]]:
    """Cut a stretch at common mesh points, and in between where drones fly far.

    Parameters
    ----------
    positions
        What flies.
    distance
        No drone flies further in a slice [m].

    Yields
    ------
    float, float
        Show times between which a slice lies [s]; none if nothing moves.
    """
    ends = np.array([positions.begin, positions.end])
    speed = positions.speed
    if speed == 0.0:
        return
    times, counts = np.unique(np.round(positions.starts, 9), return_counts=True)
    inside = (times > positions.begin) & (times < positions.end)
    common = inside & (counts >= 0.25 * counts[inside].max(initial=1))
    cuts = np.union1d(ends, times[common])
    longest = distance / speed
    for low, high in pairwise(cuts.tolist()):
        parts = max(1, int(np.ceil((high - low) / longest)))
        inner = np.linspace(low, high, parts + 1)
        yield from pairwise(inner.tolist())
