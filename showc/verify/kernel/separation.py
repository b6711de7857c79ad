"""Separation of every pair of drones at every instant of the show.

**Theorem.** In the separation's own measure no two drones of the logged polynomials
come nearer to each other at any instant than :attr:`Encounter.lower`, whether they fly,
hover, wait on their pads or have landed. What is flown comes no nearer than that, less
both tubes' radii (:mod:`showc.verify.kernel.dynamics`).

Proof. Time is cut into slices. Pairs that are further apart throughout a slice than the
closest encounter known so far are settled by :mod:`showc.verify.kernel.slices`. For the
others the difference of positions is a polynomial on each common mesh interval. Its
component along any unit vector bounds its length from below, and so do the Bernstein
coefficients of the sum of its squares (for the forms per axis, of each component);
values at interval ends are reached (Farouki 2012, The Bernstein polynomial basis: a
centennial retrospective, section 4). Intervals that could hold a nearer encounter than
the nearest end so far are halved, until both are :data:`RESOLUTION` apart. No sampling
decides anything.

*Rounding.* Fewer than 1000 steps lie between logged coefficients and what is compared:
:data:`GAMMA` of the greatest coordinate for lengths, of the greatest coefficient for
squares (Higham 2002, section 3.1). Times that differ by less than ``MOMENT`` count as
one; what is flown in it comes off the bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from showc.verify.kernel.bernstein import MOST, halves, square_sum
from showc.verify.kernel.dynamics import GAMMA, POSITION
from showc.verify.kernel.slices import Measure, edges, measures, near_pairs, take
from showc.verify.kernel.statement import Statement
from showc.verify.kernel.tracks import MOMENT, Stretch, Tracks, cut

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log.showc_pb2 import Separation
    from showc.verify.kernel.dynamics import Tube
    from showc.verify.kernel.show import LoggedShow


RESOLUTION = 5e-7
"""Width of the enclosure of the closest encounter [m]."""

TOLERANCE = 1e-6
"""How far the separation may be missed by the polynomials: what a solver calls equal
[m]. What is flown may miss it by the tolerances of two positions besides."""

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
    error: float = 0.0
    """Rounding, of numbers and of times, that ``lower`` allows for [m]."""


def closest_encounter(show: LoggedShow) -> Encounter | None:
    """Enclose the closest encounter of the whole show.

    Returns
    -------
    Encounter or None
        ``upper - lower`` is ``RESOLUTION`` and the error; None if there are fewer than
        two drones.
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
        closest,
        lower=min(encounter.lower for encounter in found),
        error=max(encounter.error for encounter in found),
    )


def separated(
    show: LoggedShow, tubes: Sequence[Tube], encounter: Encounter | None
) -> Statement:
    """State whether the separation is kept, and by how much.

    Parameters
    ----------
    tubes
        One for each segment of the show.
    encounter
        The closest one of the whole show.
    """
    title = "separation of every pair at every instant"
    if encounter is None:
        return Statement("VRF321", title, None, notes=("there is only one drone",))
    separation = show.rules.separation
    scale = max(measure.scale[-1] for measure in measures(separation))
    radius = max(
        float(np.sqrt(np.sum(tube.radius[:, :3] ** 2, axis=1)).max()) for tube in tubes
    )
    # Where positions are not proved, VRF301 says so; what would be flown is unknown.
    away = min(radius, POSITION) * max(scale, 1.0)
    flown = max(encounter.lower - 2.0 * away, 0.0)
    note = (
        f"{show.drones * (show.drones - 1) // 2:,} pairs; the closest encounter of the "
        f"polynomials lies in [{encounter.lower:.7f}, {encounter.upper:.7f}] m "
        f"(resolution {RESOLUTION:.0e} m, rounding {encounter.error:.0e} m, tolerance "
        f"{TOLERANCE:.0e} m); each drone flies within {radius:.1e} m of them"
    )
    least = separation.distance - TOLERANCE
    return Statement(
        "VRF321",
        title,
        encounter.lower >= least and radius <= POSITION,
        flown,
        separation.distance,
        "m",
        encounter.pair,
        ", ".join(encounter.segments),
        encounter.time,
        (note,),
    )


def _searched(stretch: Stretch, measure: Measure, wanted: float) -> Encounter:
    search = _Search(measure, wanted)
    search.stretch(stretch.tracks())
    names = tuple(segment.message.name for segment in stretch.segments)
    return search.result(names)


class _Pairs(NamedTuple):
    """Pairs of drones over intervals of time, each array of shape (n,)."""

    first: IntArray
    second: IntArray
    low: FloatArray
    """Show time [s]."""
    high: FloatArray
    """Show time [s]."""

    def some(self, chosen: BoolArray) -> _Pairs:
        """Return those that are chosen."""
        first, second, low, high = self
        return _Pairs(first[chosen], second[chosen], low[chosen], high[chosen])

    def halved(self) -> _Pairs:
        """Return the first halves of all intervals, then the second ones."""
        middle = 0.5 * (self.low + self.high)
        low = np.concatenate([self.low, middle])
        high = np.concatenate([middle, self.high])
        return _Pairs(np.tile(self.first, 2), np.tile(self.second, 2), low, high)


class _Search:
    """Branch and bound over one stretch with one measure."""

    def __init__(self, measure: Measure, wanted: float) -> None:
        self.measure = measure
        self.wanted = wanted
        self.best = np.inf
        self.pair = (0, 1)
        self.time = 0.0
        self.error = 0.0

    def result(self, segments: tuple[str, ...]) -> Encounter:
        """Say what was found, while ``segments`` are under way."""
        lower = max(self.best - RESOLUTION - self.error, 0.0)
        return Encounter(lower, self.best, self.pair, self.time, segments, self.error)

    def stretch(self, tracks: Tracks) -> None:
        """Search the stretch."""
        axes = list(self.measure.axes)
        scaled = tracks.position[:, :, axes] * np.array(self.measure.scale)
        positions = replace(tracks, position=np.ascontiguousarray(scaled))
        # Each drone of a pair, by rounding and by what it flies in a moment.
        rounding = GAMMA * float(np.abs(scaled).max(initial=0.0))
        self.error = 2.0 * (rounding + MOMENT * positions.speed)
        self._instant(positions)
        batch: list[_Pairs] = []
        for low, high in edges(positions, _FURTHEST * max(self.best, self.wanted)):
            piece = take(positions, low, high, self.measure)
            first, second = piece.near(self.measure, self.best - RESOLUTION / 2).T
            times = np.full(first.size, low), np.full(first.size, high)
            batch.append(_Pairs(first, second, *times))
            if sum(part.first.size for part in batch) >= _BATCH:
                self._decide(positions, batch)
                batch = []
        if batch:
            self._decide(positions, batch)

    def _take(self, distance: FloatArray, pairs: _Pairs, time: FloatArray) -> None:
        """Remember the nearest of some distances that are reached."""
        index = int(np.argmin(distance)) if distance.size else 0
        if distance.size and distance[index] < self.best:
            self.best = float(distance[index])
            self.pair = int(pairs.first[index]), int(pairs.second[index])
            self.time = float(time[index])

    def _instant(self, positions: Tracks) -> None:
        """Closest pair at the first instant: a start that makes pruning work."""
        place = positions.position[positions.first[:-1], 0]
        reach = max(self.wanted, RESOLUTION)
        extent = float(np.ptp(place, axis=0).max())
        pairs = near_pairs(place, reach)
        while not pairs.size:
            reach = 2.0 * reach if reach < extent else np.inf
            pairs = near_pairs(place, min(reach, 2.0 * extent + 1.0))
        first, second = pairs.T
        time = np.full(first.size, positions.begin)
        distance = self.measure(place[first] - place[second])
        self._take(distance, _Pairs(first, second, time, time), time)

    def _decide(self, positions: Tracks, batch: list[_Pairs]) -> None:
        """Enclose the distances of candidate pairs over their slices."""
        pairs = _Pairs._make(map(np.concatenate, zip(*batch, strict=True)))
        rows = [positions.at(drone, pairs.low) for drone in pairs[:2]]
        while pairs.first.size:
            last = [positions.first[drone + 1] - 1 for drone in pairs[:2]]
            ends = [
                np.where(row < end, positions.ends[row], np.inf)
                for row, end in zip(rows, last, strict=True)
            ]
            # Up to where the first of the two polynomials ends.
            stop = np.minimum(pairs.high, np.minimum(*ends))
            difference = positions.between(rows[0], pairs.low, stop)
            difference -= positions.between(rows[1], pairs.low, stop)
            self._enclose(difference, pairs._replace(high=stop))
            more = stop < pairs.high
            rows = [
                (row + (end <= stop))[more] for row, end in zip(rows, ends, strict=True)
            ]
            pairs = pairs._replace(low=stop).some(more)

    def _enclose(self, work: FloatArray, pairs: _Pairs) -> None:
        """Enclose distances from coefficients of differences, (n, degree + 1, axes)."""
        self._take(self.measure(work[:, 0]), pairs, pairs.low)
        self._take(self.measure(work[:, -1]), pairs, pairs.high)
        keep = self._could_be_nearer(work)
        work, pairs = work[keep], pairs.some(keep)
        if not self.measure.largest:
            work = square_sum(work)[:, :, None]
        for _ in range(_ROUNDS):
            keep = self._lower(work) < self.best - RESOLUTION / 2
            if not keep.any():
                return
            if np.count_nonzero(keep) > MOST:
                break
            work, pairs = np.concatenate(halves(work[keep])), pairs.some(keep).halved()
            self._take(self._value(work[:, 0]), pairs, pairs.low)
            self._take(self._value(work[:, -1]), pairs, pairs.high)
        # Rounding is coarser than what is wanted: nothing is proved.
        self.error = np.inf

    def _could_be_nearer(self, difference: FloatArray) -> BoolArray:
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
            squares = work[:, :, 0]
            least = squares.min(axis=1) - GAMMA * squares.max(axis=1)
            return np.asarray(np.sqrt(np.maximum(least, 0.0)))
        away = np.maximum(work.min(axis=1), -work.max(axis=1))
        return np.asarray(np.maximum(away.max(axis=1), 0.0))

    def _value(self, work: FloatArray) -> FloatArray:
        """Distances from one column of ``work`` (n, components)."""
        if not self.measure.largest:
            return np.asarray(np.sqrt(np.maximum(work[:, 0], 0.0)))
        return np.asarray(np.abs(work).max(axis=1))
