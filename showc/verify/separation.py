"""Separation of every pair of drones at every instant of the show.

Time is cut into slices. In a slice every drone stays near the chord of its flight;
pairs whose chords are further apart than the closest encounter known so far are settled
by that (:mod:`showc.verify.slices`). For the rest, the distance is a polynomial in
time on each common mesh interval: the Bernstein coefficients of the squared distance
(of each axis, for the forms per axis) bound it from below, values at interval ends from
above, and intervals are halved until both agree. So the closest encounter of the whole
show is enclosed, and no pair comes nearer at any instant, sampled or not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from showc.verify.kernel.bernstein import halves, square_sum
from showc.verify.measure import Measure, measures
from showc.verify.slices import Slice, edges, take
from showc.verify.tracks import Stretch, Tracks, cut

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from showc.log.showc_pb2 import Separation
    from showc.verify.kernel.show import LoggedShow

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

RESOLUTION = 5e-7
"""Width of the enclosure of the closest encounter [m]."""

_BATCH = 60_000
"""Pairs looked at together; bounds the memory."""

_FURTHEST = 2.0
"""How far drones fly in a slice, in separations: more slices take longer to cut, fewer
leave more pairs to their polynomials."""

_ROUNDS = 80


@dataclass(frozen=True, slots=True)
class Encounter:
    """The closest two drones come, in the separation's own measure."""

    lower: float
    """No pair comes nearer at any instant [m]."""
    upper: float
    """Distance that is reached [m]."""
    pair: tuple[int, int]
    """The pair that reaches it, counting from 0."""
    time: float
    """Show time at which it does [s]."""
    segments: tuple[str, ...]
    """Names of what is under way then."""
    pairs_halved: int
    """Pairs on slices that needed their polynomials, for the record."""


def closest_encounter(show: LoggedShow) -> Encounter | None:
    """Enclose the closest encounter of the whole show.

    Returns
    -------
    Encounter or None
        ``upper - lower`` is at most 1 um; None if there are fewer than two drones.
    """
    return closest_of([part() for part in encounter_parts(show)])


def encounter_parts(show: LoggedShow) -> list[Callable[[], Encounter]]:
    """Return searches for the closest encounter, each over a part of the show."""
    if show.drones < 2:
        return []
    wanted = show.rules.separation
    return [
        partial(_searched, stretch, measure, wanted.distance)
        for measure in measures(wanted)
        for stretch in cut(show)
    ]


def closest_in(
    tracks: Tracks, wanted: Separation, during: str = ""
) -> Encounter | None:
    """Enclose the closest encounter of a fleet whose tracks are known.

    Parameters
    ----------
    tracks
        Where all drones are.
    wanted
        How distances are measured, and which is asked for.
    during
        Name of what is under way, for the record.
    """
    if tracks.drones < 2:
        return None
    found = []
    for measure in measures(wanted):
        search = _Search(measure, wanted.distance)
        search.stretch(tracks)
        found.append(search.result((during,) if during else ()))
    return closest_of(found)


def closest_of(found: Sequence[Encounter]) -> Encounter | None:
    """Return the closest of what the parts found, the first among equals."""
    if not found:
        return None
    closest = min(found, key=lambda encounter: encounter.upper)
    return replace(
        closest, pairs_halved=sum(encounter.pairs_halved for encounter in found)
    )


def _searched(stretch: Stretch, measure: Measure, wanted: float) -> Encounter:
    search = _Search(measure, wanted)
    search.stretch(stretch.tracks())
    names = tuple(segment.message.name for segment in stretch.segments)
    return search.result(names)


class _Search:
    """Branch and bound over one stretch with one measure."""

    def __init__(self, measure: Measure, wanted: float) -> None:
        self.measure = measure
        self.wanted = wanted
        self.best = np.inf
        self.pair = (0, 1)
        self.time = 0.0
        self.halved = 0

    def result(self, segments: tuple[str, ...]) -> Encounter:
        """Say what was found, while ``segments`` are under way."""
        return Encounter(
            max(self.best - RESOLUTION, 0.0),
            self.best,
            self.pair,
            self.time,
            segments,
            self.halved,
        )

    def stretch(self, all_axes: Tracks) -> None:
        """Search the stretch."""
        axes = list(self.measure.axes)
        scaled = all_axes.position[:, :, axes] * np.array(self.measure.scale)
        positions = Tracks(
            all_axes.begin,
            all_axes.end,
            all_axes.first,
            all_axes.starts,
            all_axes.ends,
            np.ascontiguousarray(scaled),
        )
        self._instant(positions)
        batch: list[tuple[IntArray, IntArray, FloatArray, FloatArray]] = []
        size = 0
        for low, high in edges(positions, _FURTHEST * max(self.best, self.wanted)):
            piece = take(positions, low, high, self.measure)
            pairs = piece.near(self.measure, self.best - RESOLUTION / 2)
            one = piece.whole[pairs].all(axis=1)
            self._one_polynomial(piece, pairs[one])
            pairs = pairs[~one]
            if pairs.size == 0:
                continue
            times = np.full(pairs.shape[0], low), np.full(pairs.shape[0], high)
            batch.append((pairs[:, 0], pairs[:, 1], *times))
            size += pairs.shape[0]
            if size >= _BATCH:
                self._decide(positions, batch)
                batch, size = [], 0
        if batch:
            self._decide(positions, batch)

    def _one_polynomial(self, piece: Slice, pairs: IntArray) -> None:
        """Enclose the distances of pairs of which each flies one polynomial."""
        for begin in range(0, pairs.shape[0], _BATCH):
            first, second = pairs[begin : begin + _BATCH].T
            self._enclose(
                piece.hull[first] - piece.hull[second],
                first,
                second,
                np.full(first.size, piece.low),
                np.full(first.size, piece.high),
            )

    def _take(
        self, distance: FloatArray, first: IntArray, second: IntArray, time: FloatArray
    ) -> None:
        """Remember the nearest of some distances that are reached."""
        index = int(np.argmin(distance))
        if distance[index] < self.best:
            self.best = float(distance[index])
            self.pair = int(first[index]), int(second[index])
            self.time = float(time[index])

    def _instant(self, positions: Tracks) -> None:
        """Closest pair at the first instant: a start that makes pruning work."""
        place = positions.position[positions.first[:-1], 0]
        distance, neighbour = cKDTree(place).query(place, k=2, p=self.measure.order)
        drone = np.arange(positions.drones)
        # Of drones in one place, the nearest neighbour may be listed first.
        other = np.where(neighbour[:, 1] == drone, neighbour[:, 0], neighbour[:, 1])
        self._take(
            distance[:, 1],
            np.minimum(drone, other),
            np.maximum(drone, other),
            np.full(drone.size, positions.begin),
        )

    def _decide(
        self,
        positions: Tracks,
        batch: list[tuple[IntArray, IntArray, FloatArray, FloatArray]],
    ) -> None:
        """Enclose the distances of candidate pairs over their slices."""
        first = np.concatenate([part[0] for part in batch])
        second = np.concatenate([part[1] for part in batch])
        low = np.concatenate([part[2] for part in batch])
        high = np.concatenate([part[3] for part in batch])
        row_a, row_b = positions.at(first, low), positions.at(second, low)
        last_a, last_b = positions.first[first + 1] - 1, positions.first[second + 1] - 1
        while first.size:
            # Up to where the first of the two polynomials ends.
            stop = np.minimum(
                high,
                np.minimum(
                    np.where(row_a < last_a, positions.ends[row_a], np.inf),
                    np.where(row_b < last_b, positions.ends[row_b], np.inf),
                ),
            )
            difference = positions.between(row_a, low, stop)
            difference -= positions.between(row_b, low, stop)
            self._enclose(difference, first, second, low, stop)
            row_a = row_a + ((positions.ends[row_a] <= stop) & (row_a < last_a))
            row_b = row_b + ((positions.ends[row_b] <= stop) & (row_b < last_b))
            more = stop < high
            low = stop[more]
            first, second, high = first[more], second[more], high[more]
            row_a, row_b = row_a[more], row_b[more]
            last_a, last_b = last_a[more], last_b[more]

    def _enclose(
        self,
        difference: FloatArray,
        first: IntArray,
        second: IntArray,
        low: FloatArray,
        high: FloatArray,
    ) -> None:
        self._take(self.measure(difference[:, 0]), first, second, low)
        self._take(self.measure(difference[:, -1]), first, second, high)
        open_ = self._could_be_nearer(difference)
        if not open_.any():
            return
        self.halved += int(open_.sum())
        work = difference[open_]
        if not self.measure.largest:
            work = square_sum(work)[:, :, None]
        first, second, low, high = first[open_], second[open_], low[open_], high[open_]
        for _ in range(_ROUNDS):
            keep = self._lower(work) < self.best - RESOLUTION / 2
            if not keep.any():
                return
            left, right = halves(work[keep])
            first, second = np.tile(first[keep], 2), np.tile(second[keep], 2)
            middle = 0.5 * (low[keep] + high[keep])
            low = np.concatenate([low[keep], middle])
            high = np.concatenate([middle, high[keep]])
            work = np.concatenate([left, right])
            self._take(self._value(work[:, 0]), first, second, low)
            self._take(self._value(work[:, -1]), first, second, high)
        raise ArithmeticError("separation: the enclosure does not close")

    def _could_be_nearer(self, difference: FloatArray) -> NDArray[np.bool_]:
        """Whether a plane between the pair fails to settle it; (n,)."""
        limit = self.best - RESOLUTION / 2
        if self.measure.largest:
            return np.asarray(self._lower(difference) < limit)
        middle = difference[:, 0] + difference[:, -1]
        length = np.sqrt(np.sum(middle**2, axis=1))
        normal = middle / np.where(length > 0.0, length, 1.0)[:, None]
        along = np.matmul(difference, normal[:, :, None])[:, :, 0]
        return np.asarray(along.min(axis=1) < limit)

    def _lower(self, work: FloatArray) -> FloatArray:
        """Lower bounds of the distances on the intervals, shape (n,)."""
        if not self.measure.largest:
            return np.asarray(np.sqrt(np.maximum(work[:, :, 0].min(axis=1), 0.0)))
        away = np.maximum(work.min(axis=1), -work.max(axis=1))
        return np.asarray(np.maximum(away.max(axis=1), 0.0))

    def _value(self, work: FloatArray) -> FloatArray:
        """Distances from one column of ``work`` (n, components)."""
        if not self.measure.largest:
            return np.asarray(np.sqrt(np.maximum(work[:, 0], 0.0)))
        return np.asarray(np.abs(work).max(axis=1))
