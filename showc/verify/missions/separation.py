"""Separation of the flights that the autopilots will make, from the missions' bytes.

Every drone is late by the delay of its leg, give or take 0.2 s, so at time t it is on
the part of its line between its nominal places with the greatest and the least delay;
the latter goes on beyond the end of the leg by the overshoot, until the drone has
settled. The distance of two such parts is the least that any two delays give, and it
changes no faster than the drones' greatest relative speed: pieces of time are halved
until none can hold anything nearer than what was found, by more than the resolution.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.missions.distances import (
    metric_scale,
    near_pairs,
    nearest_places,
    part_distance,
)
from showc.verify.missions.law import SETTLING
from showc.verify.missions.legs import joined

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log import showc_pb2 as pb
    from showc.verify.missions.law import Profiles
    from showc.verify.missions.legs import MissionLegs


RESOLUTION = 2e-3
"""How far the proved distance may lie below the true one [m]."""

COARSE, PIECES = 4, 16
"""Pieces of a stretch of time at first, and of those that are looked into."""

TOGETHER = 0.5
"""Legs that begin within this time of each other are looked at together [s]."""


class OverlappingLegsError(Exception):
    """A drone may still fly one leg when the next one is released."""

    def __init__(self, drone: int, time: float) -> None:
        super().__init__(f"drone {drone + 1} at {time:.2f} s")
        self.drone = drone
        self.time = time


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """One leg of every drone, or rest, during a stretch of time."""

    begin: FloatArray
    """Where each drone's leg begins, shape (drones, 3), show frame [m]."""
    along: FloatArray
    """From there to its end, zero for a drone at rest, shape (drones, 3) [m]."""
    leg: IntArray
    """Row of each one's leg in the table of all legs, shape (drones,)."""
    release: FloatArray
    """When it is released, shape (drones,) [s]."""
    first: float
    """First instant [s]."""
    last: float
    """Last instant [s]."""
    flights: Profiles
    """The table of all legs."""

    def places(
        self, drone: IntArray, part: FloatArray, width: float, length: float
    ) -> tuple[FloatArray, FloatArray]:
        """Rearmost and foremost places, each (3, m) [m].

        Of drones ``drone`` (m,) during ``length`` [s] from ``part`` (m,) times
        ``width`` [s] after the stretch's begin.
        """
        leg = self.leg[drone]
        late, early = self._law_times(drone, part * width, length)
        rear, _ = self.flights.fraction(leg, late)
        front, _ = self.flights.fraction(leg, early)
        moving = late < self.flights.duration[leg] + SETTLING
        front *= np.where(moving, self.flights.excess[leg], 1.0)
        begin, along = self.begin.T[:, drone], self.along.T[:, drone]
        return begin + rear * along, begin + front * along

    def rates(
        self, drone: IntArray, part: FloatArray, width: float
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Least and greatest rates (m,) [1/s] at which they cover their legs.

        Of drones ``drone`` (m,) during ``width`` [s] from ``part`` (m,) times that
        after the stretch's begin; and whether each settles before the middle.
        """
        leg = self.leg[drone]
        late, early = self._law_times(drone, part * width, width)
        middle, _ = self._law_times(drone, (part + 0.5) * width, 0.0)
        _, slow_rear = self.flights.fraction(leg, late)
        _, slow_front = self.flights.fraction(leg, early)
        # The speed rises, stays and falls: it is greatest nearest to the leg's middle.
        duration = self.flights.duration[leg]
        _, fast = self.flights.fraction(leg, np.clip(0.5 * duration, late, early))
        moving = late < duration + SETTLING
        fast *= np.where(moving, self.flights.excess[leg], 1.0)
        # The law's time runs slower than the clock at first, by up to 35 %.
        slow = 0.65 * np.minimum(slow_rear, slow_front)
        return slow, fast, moving & ~(middle < duration + SETTLING)

    def _law_times(
        self, drone: IntArray, after: FloatArray, length: float
    ) -> tuple[FloatArray, FloatArray]:
        """Law's times (m,) [s] of the latest at the start, the earliest at the end."""
        leg = self.leg[drone]
        since = self.first + after - self.release[drone]
        spread = self.flights.spread[leg]
        late = self.flights.law_time(leg, since) - spread
        return late, self.flights.law_time(leg, since + length) + spread


@dataclass(frozen=True, slots=True, eq=False)
class _Timed:
    """The timed legs of all drones, one after the other.

    Drones with fewer legs than others, or none, are filled up with legs that begin
    never and lead nowhere.
    """

    legs: IntArray
    """Rows in the table of all legs, shape (drones, most)."""
    release: FloatArray
    """When each is released, shape (drones, most) [s]."""
    first: FloatArray
    """When each can begin at the earliest, shape (drones, most) [s]."""
    last: FloatArray
    """When each has ended at the latest, shape (drones, most) [s]."""
    begin: FloatArray
    """Where each begins, shape (drones, most, 3), show frame [m]."""
    along: FloatArray
    """From there to its end, shape (drones, most, 3) [m]."""

    flights: Profiles
    """The table of all legs."""

    def stretch(self, first: float, following: float) -> Stretch | None:
        """Return what is flown from ``first`` up to ``following`` [s], if anything."""
        begun = np.count_nonzero(self.first < following - 1e-9, axis=1)
        flies = begun > 0
        # A drone not yet off rests where its first timed leg begins.
        chosen = np.arange(begun.size), np.maximum(begun - 1, 0)
        last = min(following, float(self.last[chosen][flies].max(initial=-np.inf)))
        if last <= first:
            return None
        return Stretch(
            self.begin[chosen],
            self.along[chosen] * flies[:, None],
            self.legs[chosen],
            self.release[chosen],
            first,
            last,
            self.flights,
        )


def stretches(
    missions: Sequence[MissionLegs], flights: Profiles, first_leg: IntArray
) -> Iterator[Stretch]:
    """Cut time so that a drone flies at most one timed leg in a stretch.

    ``flights`` is the table of all legs, ``first_leg`` (drones,) the row of each one's
    first leg in it.

    Raises
    ------
    OverlappingLegsError
        If a drone's legs are not surely apart in time.
    """
    fleet = _timed_legs(missions, flights, first_leg)
    late = np.argwhere(fleet.last[:, :-1] > fleet.first[:, 1:])
    if late.size:
        drone, leg = late[0].tolist()
        raise OverlappingLegsError(drone, float(fleet.release[drone, leg + 1]))
    cuts = _cuts(fleet)
    for first, following in pairwise([*cuts.tolist(), np.inf]):
        stretch = fleet.stretch(first, following)
        if stretch is not None:
            yield stretch


def _timed_legs(
    missions: Sequence[MissionLegs], flights: Profiles, first_leg: IntArray
) -> _Timed:
    """Return the legs of all drones, those that are timed."""
    followed = flights.followed(flights.spread)
    timed = [np.flatnonzero(np.isfinite(one.release)) for one in missions]
    shape = len(missions), max((rows.size for rows in timed), default=0) or 1
    legs = np.zeros(shape, dtype=np.int64)
    release, begin, along = (
        np.zeros(shape),
        np.zeros((*shape, 3)),
        np.zeros((*shape, 3)),
    )
    first, last = np.full(shape, np.inf), np.full(shape, -np.inf)
    for drone, (one, rows) in enumerate(zip(missions, timed, strict=True)):
        # A drone without timed legs waits where its last leg begins.
        some = rows if rows.size else np.array([one.release.size - 1])
        part = slice(some.size)
        legs[drone, part] = first_leg[drone] + some
        begin[drone, part] = one.places[some]
        along[drone, part] = one.places[some + 1] - one.places[some]
        if rows.size:
            release[drone, part] = one.release[rows]
            own = legs[drone, part]
            first[drone, part] = release[drone, part] - flights.spread[own]
            last[drone, part] = release[drone, part] + followed[own]
    return _Timed(legs, release, first, last, begin, along, flights)


def _cuts(fleet: _Timed) -> FloatArray:
    """Return times [s] between which no drone can fly more than one leg.

    Legs that begin close together share a cut, unless a drone's own leg before it still
    runs then.
    """
    moments = np.unique(fleet.first[np.isfinite(fleet.first)])
    cuts: list[float] = []
    for moment in moments.tolist():
        if not cuts or moment - cuts[-1] > TOGETHER:
            cuts.append(moment)
    known = np.isfinite(fleet.first[:, 1:])
    begins, before = fleet.first[:, 1:][known], fleet.last[:, :-1][known]
    while True:
        edges = np.array(cuts)
        shared = edges[np.searchsorted(edges, begins + 1e-9) - 1]
        missing = set(begins[before > shared + 1e-9].tolist()) - set(cuts)
        if not missing:
            return edges
        cuts = sorted([*cuts, *missing])


@dataclass(frozen=True, slots=True)
class Nearest:
    """The pair that can come nearest."""

    pair: tuple[int, int]
    """Drones, counting from 0."""
    time: float
    """On the missions' clock [s]."""
    distance: float
    """In the separation's metric, at most the resolution above the least [m]."""


def nearest_timed(
    missions: Sequence[MissionLegs], rules: pb.Separation
) -> Nearest | None:
    """Return the nearest encounter of all timed legs; None if there is none.

    Raises
    ------
    OverlappingLegsError
        If a drone's legs are not surely apart in time.
    """
    flights, first_leg = joined(missions)
    best: Nearest | None = None
    for stretch in stretches(missions, flights, first_leg):
        best = _refined(stretch, rules, best)
    return best


def nearest_untimed(
    missions: Sequence[MissionLegs], rules: pb.Separation, *, landing: bool
) -> Nearest | None:
    """Return the least distance of the drones' whole lines up, or down.

    Take-off and landing are not timed: any two places on two lines may be taken at
    once.
    """
    begin, along = [], []
    for mission in missions:
        timed = np.flatnonzero(np.isfinite(mission.release))
        count = mission.release.size
        if landing:
            high, low = mission.places[count - 1], mission.places[count]
        else:
            climbed = int(timed[0]) if timed.size else max(count - 1, 0)
            high, low = mission.places[climbed], mission.places[0]
        begin.append(low)
        along.append(high - low)
    p, u = np.array(begin), np.array(along)
    everyone = np.ones(len(p), dtype=np.bool_)
    found = nearest_places(p, rules, everyone)
    if found is None:
        return None
    a, b, distance = found
    bottom, top = p.T.copy(), (p + u).T.copy()
    for one, other in near_pairs(p, p + u, rules, distance, everyone):
        value = part_distance(
            (bottom[:, one], top[:, one]), (bottom[:, other], top[:, other]), rules
        )
        if value.size and value.min() < distance:
            row = int(value.argmin())
            a, b, distance = int(one[row]), int(other[row]), float(value[row])
    return Nearest((a, b), 0.0, distance)


def _refined(
    stretch: Stretch, rules: pb.Separation, best: Nearest | None
) -> Nearest | None:
    """Return the nearest of ``best`` and what happens in ``stretch``."""
    everyone, begin = np.arange(stretch.leg.size), np.zeros(stretch.leg.size)
    span = stretch.last - stretch.first
    rear, front = stretch.places(everyone, begin, span, span)
    moving = np.any(rear != front, axis=0)
    _, stop = stretch.places(everyone, begin + 1.0, span, 0.0)
    # The least distance at the end bounds what is worth looking at.
    limit = np.inf if best is None else best.distance
    found = nearest_places(stop.T, rules, moving, limit)
    if found is not None:
        best = Nearest(found[:2], stretch.last, found[2])
    if best is None:
        return None
    for pairs in near_pairs(rear.T, front.T, rules, best.distance, moving):
        best = _halved(stretch, rules, pairs, best)
    return best


def _halved(
    stretch: Stretch,
    rules: pb.Separation,
    pairs: tuple[IntArray, IntArray],
    best: Nearest,
) -> Nearest:
    """Return the nearest of ``best`` and what ``pairs`` do in that stretch."""
    count, (a, b), piece = 1, pairs, np.zeros(pairs[0].size)
    while a.size:
        width = (stretch.last - stretch.first) / count
        parts = [stretch.places(one, piece, width, width) for one in (a, b)]
        whole = part_distance(parts[0], parts[1], rules)
        # What is further apart throughout can be nearer at no instant.
        near = np.flatnonzero(whole < best.distance)
        a, b, piece, whole = a[near], b[near], piece[near], whole[near]
        if count >= PIECES and a.size:
            bound, value = _examined(stretch, rules, (a, b, piece), whole, width)
            row = int(value.argmin())
            if value[row] < best.distance:
                time = stretch.first + (int(piece[row]) + 0.5) * width
                pair = int(a[row]), int(b[row])
                best = Nearest(pair, float(time), float(value[row]))
            left = bound < best.distance - RESOLUTION
            a, b, piece = a[left], b[left], piece[left]
        finer = COARSE if count == 1 else 2
        a, b, piece = np.repeat(a, finer), np.repeat(b, finer), np.repeat(piece, finer)
        piece = finer * piece + np.arange(piece.size) % finer
        count *= finer
    return best


def _examined(
    stretch: Stretch,
    rules: pb.Separation,
    rows: tuple[IntArray, IntArray, FloatArray],
    whole: FloatArray,
    width: float,
) -> tuple[FloatArray, FloatArray]:
    """Lower bounds over pieces of time, and least distances in their middles.

    ``rows`` are pairs and their pieces, each (n,); ``whole`` (n,) lower bounds already.
    """
    (a, b, piece), half = rows, np.asarray(rows[2] + 0.5)
    pair = a, b
    middle = [stretch.places(one, half, width, 0.0) for one in pair]
    value = part_distance(middle[0], middle[1], rules)
    one, other = (stretch.rates(some, piece, width) for some in pair)
    u, v = (stretch.along[some].T * metric_scale(rules)[:, None] for some in pair)
    relative = np.zeros(piece.size)
    for speed_a in one[:2]:
        for speed_b in other[:2]:
            gap = speed_a * u - speed_b * v
            np.maximum(relative, np.einsum("kn,kn->n", gap, gap), out=relative)
    sharp = np.maximum(whole, value - 0.5 * width * np.sqrt(relative))
    return np.where(one[2] | other[2], whole, sharp), value
