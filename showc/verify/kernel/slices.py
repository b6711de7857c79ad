"""Where drones are: tracks, and slices of time in which they fly almost straight.

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
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.verify.kernel.bernstein import part

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.verify.kernel.show import Segment

MOMENT = 1e-8
"""Times nearer to each other than this are one [s]: rounding of times of day-long
shows. What a drone flies in it is part of every error bound that uses tracks."""
_SLICES = 1_000  # of a stretch at most: no speed that a log claims takes hours


@dataclass(frozen=True, eq=False)
class Tracks:
    """Positions of the whole fleet from ``begin`` to ``end``.

    Row k is a polynomial of one drone; rows of a drone follow each other in time and
    together cover the stretch.
    """

    begin: float  # show time [s]
    end: float  # show time [s]
    first: IntArray  # first row of each drone, and the number of rows, (drones + 1,)
    starts: FloatArray  # show time at which each row starts, shape (rows,) [s]
    ends: FloatArray  # show time at which each row ends, shape (rows,) [s]
    position: FloatArray  # Bernstein coefficients, shape (rows, degree + 1, 3) [m]

    @classmethod
    def of(cls, segment: Segment) -> Tracks:
        """Return the positions of all drones over a segment."""
        table, begin = segment.table, segment.start
        starts, ends = begin + table.start, begin + table.end
        places = table.state[:, :, :3]
        return cls(begin, segment.end, table.first, starts, ends, places)

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return int(self.first.size) - 1

    @cached_property
    def speed(self) -> float:
        """No drone flies faster [m/s]: hulls of coefficients over times."""
        steps = self.position[:, 1:] - self.position[:, :-1]
        width = np.where(self.ends > self.starts, self.ends - self.starts, np.inf)
        squares = np.einsum("njk,njk->nj", steps, steps).max(axis=1, initial=0.0)
        return float(np.max(np.sqrt(squares) / width) * steps.shape[1])

    @cached_property
    def _keys(self) -> FloatArray:
        """Starts with an offset for each drone: they rise over all rows, (rows,)."""
        owner = np.arange(self.drones).repeat(np.diff(self.first))
        return self._key(owner, self.starts)

    def _key(self, drone: IntArray, time: FloatArray) -> FloatArray:
        return time - self.begin + drone * 2.0 * (self.end - self.begin + 1.0)

    def at(self, drone: IntArray, time: FloatArray) -> IntArray:
        """Row of each ``drone`` that covers each ``time``, shape (..., n)."""
        found = np.searchsorted(self._keys, self._key(drone, time), side="right")
        return np.clip(found - 1, self.first[drone], self.first[drone + 1] - 1)

    def between(self, row: IntArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Coefficients of rows (n,) restricted to show times ``low`` to ``high``."""
        start = self.starts[row]
        width = self.ends[row] - start
        width = np.where(width > 0.0, width, 1.0)
        lower = np.clip((low - start) / width, 0.0, 1.0)
        upper = np.clip((high - start) / width, 0.0, 1.0)
        return part(self.position[row], lower, upper)


def innermost(begin: FloatArray, end: FloatArray) -> FloatArray:
    """Points (..., axes) nearest to the origin on ways from ``begin`` to ``end``."""
    way = end - begin
    square = np.einsum("...k,...k->...", way, way)
    along = -np.einsum("...k,...k->...", begin, way)
    share = np.clip(along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return np.asarray(begin + share[..., None] * way)


@dataclass(frozen=True, slots=True)
class Measure:
    """How a difference of positions becomes a distance."""

    axes: tuple[int, ...]  # axes that count, one after the other
    scale: tuple[float, ...]  # factor on each of them
    largest: bool  # whether it is the largest component (else the Euclidean length)

    def space(self, points: FloatArray) -> FloatArray:
        """Places (..., 3) in the space whose distances count, (..., axes)."""
        axes = slice(self.axes[0], self.axes[-1] + 1)
        return np.asarray(points[..., axes] * np.array(self.scale))

    def __call__(self, difference: FloatArray) -> FloatArray:
        """Distances (...) of differences (..., axes), scaled already."""
        if self.largest:
            return np.asarray(np.abs(difference).max(axis=-1))
        square = np.einsum("...k,...k->...", difference, difference)
        return np.asarray(np.sqrt(square))

    def of_chords(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Lower bounds (n,) of the distances on the way from ``begin`` to ``end``.

        Both have the shape (n, axes). Of the Euclidean length it is the least itself.
        """
        if self.largest:
            # The greatest of the components' least values.
            least = np.minimum(np.abs(begin), np.abs(end))
            return np.asarray(np.where(begin * end < 0.0, 0.0, least).max(axis=-1))
        return self(innermost(begin, end))


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


def neighbours(points: FloatArray) -> IntArray:
    """Pairs (m - 1, 2) of points (m, axes) in some sort: a start for a search."""
    order = np.lexsort(points.T)
    return np.asarray(np.column_stack([order[:-1], order[1:]]))


def near_pairs(
    points: FloatArray, reach: float, most: float = np.inf
) -> IntArray | None:
    """Pairs (n, 2) of points (m, axes), the first less, that may be within ``reach``.

    All pairs in one cell of a lattice with edges of ``reach``, or in cells that touch;
    no pair within ``reach`` is missing. None: there are more than ``most``.
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
        most -= many.sum()
        if most < 0:
            return None
        one = np.repeat(np.arange(count), many)
        begin = np.cumsum(many) - many
        other = np.arange(one.size) + np.repeat(first - begin, many)
        found.append([order[one], order[other]])
    pairs = np.concatenate(found, axis=1)
    return np.column_stack([pairs.min(axis=0), pairs.max(axis=0)])


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """Where every drone is in a slice of time."""

    begin: FloatArray  # where each is at its start, shape (drones, axes)
    end: FloatArray  # where it is at its end, shape (drones, axes)
    radius: FloatArray  # of the ball around the chord's middle that holds it, (drones,)
    away: FloatArray  # how far the flight leaves the chord at most, shape (drones,)

    def near(
        self, measure: Measure, distance: float, most: float = np.inf
    ) -> IntArray | None:
        """Pairs (n, 2), the first less, that could come nearer than ``distance``.

        None: there are more than ``most`` to look at.
        """
        middle = 0.5 * (self.begin + self.end)
        reach = distance + 2.0 * float(self.radius.max())
        pairs = near_pairs(middle, reach, most)
        if pairs is None:
            return None
        first, second = pairs.T
        gap = measure(middle.take(first, axis=0) - middle.take(second, axis=0))
        gap -= self.radius[first] + self.radius[second]
        first, second = (pairs := pairs[gap < distance]).T
        begin, end = (some[first] - some[second] for some in (self.begin, self.end))
        gap = measure.of_chords(begin, end) - self.away[first] - self.away[second]
        return np.asarray(pairs[gap < distance], dtype=np.int64)


def take(positions: Tracks, low: float, high: float, measure: Measure) -> Slice:
    """Restrict what all drones fly to a slice."""
    drones = np.arange(positions.drones)
    rows = [positions.at(drones, np.full(drones.size, time)) for time in (low, high)]
    count = rows[1] - rows[0] + 1
    first, last = np.cumsum(count) - count, np.cumsum(count) - 1
    row = np.arange(last[-1] + 1) + np.repeat(rows[0] - first, count)
    hull = positions.between(row, np.full(row.size, low), np.full(row.size, high))
    begin, end = hull[first, 0], hull[last, -1]
    spans = positions.starts[row], positions.ends[row]
    since, until = (np.clip((at - low) / (high - low), 0.0, 1.0) for at in spans)
    since[first], until[last] = 0.0, 1.0
    # The chord has coefficients at even steps of each row's own time.
    share = np.linspace(since, until, hull.shape[1], axis=1)[:, :, None]
    owner = np.repeat(drones, count)
    off = hull - begin[owner, None] - share * (end - begin)[owner, None]
    away = np.maximum.reduceat(measure(off).max(axis=1), first)
    return Slice(begin, end, 0.5 * measure(end - begin) + away, away)


def edges(
    begin: float, end: float, speed: float, furthest: float, most: int = _SLICES
) -> Iterator[tuple[float, float]]:
    """Cut a stretch of time [s] into slices, ``most`` of them at most.

    Else what flies with ``speed`` [m/s] flies no further than ``furthest`` [m] in one.
    """
    parts = int(np.clip(np.ceil((end - begin) * speed / furthest), 1, most))
    yield from pairwise(np.linspace(begin, end, parts + 1).tolist())
