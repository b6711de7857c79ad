"""Where all drones are over a stretch of time: their position polynomials, aligned."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.bernstein import elevate, part

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.verify.kernel.show import LoggedShow, Segment


MOMENT = 1e-8
"""Times nearer to each other than this are one [s]: rounding of times of day-long
shows. What a drone flies in it is part of every error bound that uses tracks."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Positions of the whole fleet from ``begin`` to ``end``.

    Row k is a polynomial of one drone; rows of a drone follow each other in time and
    together cover the stretch.
    """

    begin: float
    """Show time [s]."""
    end: float
    """Show time [s]."""
    first: IntArray
    """First row of each drone, and the number of rows, shape (drones + 1,)."""
    starts: FloatArray
    """Show time at which each row starts, shape (rows,) [s]."""
    ends: FloatArray
    """Show time at which each row ends, shape (rows,) [s]."""
    position: FloatArray
    """Bernstein coefficients, shape (rows, degree + 1, 3) [m]."""

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return int(self.first.size) - 1

    @property
    def speed(self) -> float:
        """No drone flies faster [m/s]: hulls of coefficients over times."""
        degree = self.position.shape[1] - 1
        if degree == 0:
            return 0.0
        # Coefficient by coefficient, all rows of one lie side by side.
        hull = np.ascontiguousarray(self.position.transpose(1, 2, 0))
        step = np.sqrt(np.sum(np.diff(hull, axis=0) ** 2, axis=1)).max(axis=0)
        width = self.ends - self.starts
        return float(degree * np.max(step / np.where(width > 0.0, width, np.inf)))

    def at(self, drone: IntArray, time: FloatArray) -> IntArray:
        """Row of each ``drone`` that covers each ``time``, shape (n,)."""
        # Times rise along a drone's rows; an offset for each drone makes them rise
        # over all rows, so that one search serves all.
        offset = 2.0 * (self.end - self.begin + 1.0)
        owner = np.repeat(np.arange(self.drones), np.diff(self.first))
        keys = self.starts - self.begin + owner * offset
        found = np.searchsorted(keys, time - self.begin + drone * offset, side="right")
        return np.clip(found - 1, self.first[drone], self.first[drone + 1] - 1)

    def between(self, row: IntArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Coefficients of rows (n,) restricted to show times ``low`` to ``high``."""
        start = self.starts[row]
        width = self.ends[row] - start
        width = np.where(width > 0.0, width, 1.0)
        lower = np.clip((low - start) / width, 0.0, 1.0)
        upper = np.clip((high - start) / width, 0.0, 1.0)
        result = self.position[row]
        inner = np.flatnonzero((lower > 0.0) | (upper < 1.0))
        if inner.size == row.size:
            return part(result, lower, upper)
        result[inner] = part(result[inner], lower[inner], upper[inner])
        return result


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A stretch of the show, and where drones wait that do not fly in it."""

    begin: float
    """Show time [s]."""
    end: float
    """Show time [s]."""
    segments: tuple[Segment, ...]
    """What is under way: all of them from its begin to its end."""
    places: FloatArray
    """Of those that fly in none of the segments, shape (drones, 3) [m]."""

    def tracks(self) -> Tracks:
        """Positions of all drones."""
        owners, starts, ends, positions = [], [], [], []
        waiting = np.ones(self.places.shape[0], dtype=bool)
        for segment in self.segments:
            waiting[segment.drones] = False
            for table in segment.tables:
                begin, end = table.start + segment.start, table.end + segment.start
                # Ends of a segment may miss the stretch's edge by rounding alone.
                keep = (end > self.begin + MOMENT) & (begin < self.end - MOMENT)
                owners.append(table.owner[keep])
                starts.append(begin[keep])
                ends.append(end[keep])
                positions.append(table.state[keep][:, :, :3])
        still = np.flatnonzero(waiting)
        owners.append(still)
        starts.append(np.full(still.size, self.begin))
        ends.append(np.full(still.size, self.end))
        positions.append(self.places[still][:, None, :])
        some = [array for array in positions if array.size]
        degree = max(array.shape[1] for array in some) - 1
        position = np.concatenate([elevate(array, degree) for array in some])
        owner, start = np.concatenate(owners), np.concatenate(starts)
        order = np.lexsort((start, owner))
        counts = np.bincount(owner, minlength=waiting.size)
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        end = np.concatenate(ends)
        return Tracks(
            self.begin, self.end, first, start[order], end[order], position[order]
        )


def cut(show: LoggedShow) -> list[Stretch]:
    """Cut the show where a segment starts or ends, in the order of time.

    A drone that takes part in no segment of a stretch stands where its last segment
    ended, or, before its first, where that will start: on its pad.
    """
    place = np.zeros((show.drones, 3))
    for segment in sorted(show.segments, key=lambda one: one.start, reverse=True):
        place[segment.drones] = segment.ends()[0][:, :3]
    times = [0.0, show.duration]
    times += [time for one in show.segments for time in (one.start, one.end)]
    found = []
    for low, high in pairwise(np.unique(np.round(times, 9)).tolist()):
        flying = tuple(
            one
            for one in show.segments
            if one.start < high - MOMENT and one.end > low + MOMENT
        )
        found.append(Stretch(low, high, flying, place))
        place = place.copy()
        for segment in flying:
            if segment.end <= high + MOMENT:
                place[segment.drones] = segment.ends()[1][:, :3]
    return found
