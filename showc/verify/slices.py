"""Slices of time in which drones fly almost straight, and who could meet in them.

In a slice a drone's position differs from the chord of its flight, the straight and
even motion from where the slice finds it to where it leaves it, by no more than the
greatest difference of their Bernstein coefficients. So two drones come no nearer than
their chords do, less the two differences; and no nearer than the middles of their
chords, less the radii of the balls around them that hold all coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.verify.measure import Measure
    from showc.verify.tracks import Tracks

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """What every drone flies from ``low`` to ``high``."""

    low: float
    """Show time [s]."""
    high: float
    """Show time [s]."""
    hull: FloatArray
    """Coefficients of the first polynomial of each drone in the slice, restricted to
    it, shape (drones, degree + 1, axes)."""
    whole: NDArray[np.bool_]
    """Whether that one covers the slice, shape (drones,)."""
    begin: FloatArray
    """Where each drone is at ``low``, shape (drones, axes)."""
    end: FloatArray
    """Where it is at ``high``, shape (drones, axes)."""
    radius: FloatArray
    """Of the ball around the middle of the chord that holds the flight, (drones,)."""
    away: FloatArray
    """How far the flight leaves the chord at most, shape (drones,)."""

    def near(self, measure: Measure, distance: float) -> IntArray:
        """Pairs (n, 2), the first less, that could come nearer than ``distance``."""
        middle = 0.5 * (self.begin + self.end)
        reach = distance + 2.0 * float(self.radius.max())
        pairs = cKDTree(middle).query_pairs(
            reach, p=measure.order, output_type="ndarray"
        )
        if pairs.size == 0:
            return np.empty((0, 2), dtype=np.int64)
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
    whole = (positions.ends[row] >= high) | (row == last)
    parts = [(np.arange(count), hull, row.copy())]
    more = np.flatnonzero(~whole)
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
        off = measure.lengths(off).max(axis=0)
        away[drones] = np.maximum(away[drones], off)
    radius = 0.5 * measure(end - begin) + away
    return Slice(low, high, hull, whole, begin, end, radius, away)


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
    # Coefficient by coefficient, all rows of one lie side by side.
    hull = np.ascontiguousarray(positions.position.transpose(1, 2, 0))
    moving = hull.max(axis=0) - hull.min(axis=0)
    travel = np.sqrt(np.sum(moving**2, axis=0))
    if not np.any(travel > 0.0):
        return
    times, counts = np.unique(np.round(positions.starts, 9), return_counts=True)
    inside = (times > positions.begin) & (times < positions.end)
    common = inside & (counts >= 0.25 * counts[inside].max(initial=1))
    cuts = np.union1d(ends, times[common])
    width = positions.ends - positions.starts
    speed = float(np.max(travel / np.where(width > 0.0, width, np.inf)))
    longest = distance / speed if speed > 0.0 else np.inf
    for low, high in pairwise(cuts.tolist()):
        parts = max(1, int(np.ceil((high - low) / longest)))
        inner = np.linspace(low, high, parts + 1)
        yield from pairwise(inner.tolist())
