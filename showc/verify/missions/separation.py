"""Separation of the flights that the autopilots will make, from the missions' bytes.

Every drone is late by the delay of its leg, give or take its spread. So at time t it is
on the part of its line between its places with the greatest and the least delay; the
latter goes on beyond the end of the leg by the overshoot, until the drone has settled.
The distance of two such parts is the least that any two delays give.

Over a piece of time, the distance is at least that of the parts covered in it. It is
also at least the distance at the middle, less half the piece times the greatest speed
at which the ends of the parts approach each other. A pair and a time are polynomials of
degrees 0 and 1, so :func:`showc.verify.kernel.bernstein.least` halves pieces of time
until none can hold anything nearer than what was found, by more than the resolution.
Before that, slices of time in which drones fly a few metres leave few pairs to halve:
:class:`showc.verify.kernel.slices.Slice` finds those whose parts are near.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.verify.kernel.bernstein import least
from showc.verify.kernel.separation import Encounter
from showc.verify.kernel.slices import Measure, edges, measures, near_pairs, neighbours
from showc.verify.missions.law import CONSTANTS, KNOWN, Covered
from showc.verify.missions.legs import UNTIMED, FleetLegs

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log.showc_pb2 import Separation

RESOLUTION = 2e-3  # how far the proved distance may lie below the true one [m]

_TOGETHER = 20_000  # pairs that are looked at together: few enough for the memory
_FURTHEST = 4.0
"""How far drones fly in a slice, in separations: more slices take longer to cut, fewer
leave more pairs to be halved."""
_SLICES = 100
"""Slices of a stretch at most: a leg to the other end of the world ends this, too."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """One leg of every drone, or rest, during a stretch of time, in one measure."""

    fleet: FleetLegs
    measure: Measure
    leg: IntArray
    """Row of each drone's leg in the table of all legs, shape (drones,)."""
    release: FloatArray
    """When it is released, shape (drones,) [s]."""
    begin: FloatArray
    """Where it begins, in the measure's space, shape (drones, axes)."""
    along: FloatArray
    """From there to its end, zero for a drone at rest, shape (drones, axes)."""
    first: float
    """First instant [s]."""
    last: float
    """Last instant [s]."""

    def parts(self, drone: IntArray, low: FloatArray, high: FloatArray) -> Covered:
        """Places and velocities (m, axes) of drones (m,) from low to high (m,) [s]."""
        leg, release = self.leg[drone], self.release[drone]
        flights = self.fleet.profiles
        excess = np.where(self._moving(drone, low), flights.excess[leg], 1.0)
        begin, along = (some.take(drone, axis=0) for some in (self.begin, self.along))
        covered = flights.between(leg, low - release, high - release)
        rear, front, slow, fast = (part[:, None] * along for part in covered)
        front, fast = excess[:, None] * front, excess[:, None] * fast
        # The law's time runs slower than the clock at first, by up to 35 %.
        return Covered(begin + rear, begin + front, 0.65 * slow, fast)

    def _moving(self, drone: IntArray, time: FloatArray) -> BoolArray:
        """Whether drones (m,) may be beyond their ends at times (m,) [s]."""
        leg, flights = self.leg[drone], self.fleet.profiles
        late = flights.law_time(leg, time - self.release[drone]) - flights.spread[leg]
        return np.asarray(late < flights.duration[leg] + CONSTANTS["settling"])

    def search(self, furthest: float, best: Encounter) -> None:
        """Look at all pairs in slices, in which drones fly ``furthest`` [m] or less.

        The nearest encounter goes into ``best``. Few drones have few pairs to sort.
        """
        leg, flights = self.leg, self.fleet.profiles
        length = np.where(flights.length > 0.0, flights.length, np.inf)
        rate = flights.speed[leg] / length[leg]
        speed = float((rate * self.measure(self.along)).max())
        most = min(leg.size, _SLICES)
        found: list[FloatArray] = []
        for low, high in edges(self.first, self.last, speed, furthest, most):
            near = self._candidates(low, high, best)
            times = np.broadcast_to([low, high], near.shape)
            found.append(np.concatenate([near, times], axis=1))
            many = sum(map(len, found))
            if many > _TOGETHER or (many and high == self.last):
                pairs, times = np.split(np.concatenate(found), 2, axis=1)
                self._decide(pairs.astype(np.int64), times, best)
                found = []

    def _candidates(self, low: float, high: float, best: Encounter) -> IntArray:
        """Pairs (n, 2) of which a drone moves that may come nearer than the best."""
        times = (np.full(self.leg.size, time) for time in (low, high))
        rear, front, *_ = self.parts(np.arange(self.leg.size), *times)
        moving = self.measure(front - rear) > 0.0
        if not moving.any():
            return np.empty((0, 2), dtype=np.int64)
        if best.upper == np.inf:
            start = neighbours(rear)
            start = start[np.any(moving[start], axis=1)]
            best.take(start, high, self._gap(start, np.full(len(start), high)))
        pairs, _ = _near(rear, front, self.measure, best.upper)
        return np.asarray(pairs[np.any(moving[pairs], axis=1)])

    def _decide(self, pairs: IntArray, times: FloatArray, best: Encounter) -> None:
        """Enclose the distances of pairs (n, 2) over times (n, 2) [s]."""
        number = np.repeat(np.arange(len(pairs)), 2).reshape(-1, 2)
        work = np.stack([number, times], axis=2)

        def reached(some: FloatArray) -> FloatArray:
            return self._gap(pairs[some[:, 0].astype(np.int64)], some[:, 1])

        def bounded(some: FloatArray) -> FloatArray:
            chosen, (low, high) = pairs[some[:, 0, 0].astype(np.int64)], some[:, :, 1].T
            return self._bound(chosen, low, high)

        found = least(work, bounded, reached, RESOLUTION, best.upper)
        begin, end = times[found.row]
        time = float(begin + found.fraction * (end - begin))
        # Where the search gave up, nothing is known.
        distance = found.upper if np.isfinite(found.lower) else -np.inf
        best.take(pairs[found.row][None], time, np.array([distance]))

    def _gap(self, pairs: IntArray, time: FloatArray) -> FloatArray:
        """Least distances (n,) of what pairs (n, 2) may be at ``time`` (n,) [s]."""
        one, other = (self.parts(drone, time, time) for drone in pairs.T)
        return part_distance(one[:2], other[:2], self.measure)

    def _bound(self, pairs: IntArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Bounds (n,) of the distances of pairs (n, 2) from low to high [s]."""
        middle = 0.5 * (low + high)
        one, other = (self.parts(drone, low, high) for drone in pairs.T)
        both = product((one.slow, one.fast), (other.slow, other.fast))
        relative = np.max([self.measure(a - b) for a, b in both], axis=0)
        sharp = self._gap(pairs, middle) - 0.5 * (high - low) * relative
        for drone in pairs.T:
            # When a drone settles, its part gets shorter.
            sharp[self._moving(drone, low) & ~self._moving(drone, middle)] = 0.0
        apart = part_distance(one[:2], other[:2], self.measure)
        return np.asarray(np.maximum(apart, sharp))


def stretches(fleet: FleetLegs, measure: Measure) -> Iterator[Stretch]:
    """Cut time so that a drone flies at most one timed leg in a stretch.

    That a drone's legs are surely apart in time is proved by its slots (VRF408).
    """
    flights = fleet.profiles
    over = fleet.release + flights.followed(flights.spread)
    first = fleet.filled(fleet.release - flights.spread, np.inf)
    last = fleet.filled(over, -np.inf)
    following = float(first.min())
    while following < np.inf:
        start = following
        # Up to where a drone begins that still flew the leg before at the start.
        busy = (last[:, :-1] + CONSTANTS["settling"] > start) & (first[:, 1:] > start)
        following = float(first[:, 1:][busy].min(initial=np.inf))
        begun = np.count_nonzero(first < following, axis=1)
        flies = begun > 0
        # A drone not yet off rests where its first timed leg begins.
        leg = fleet.first[:-1] + 2 + np.maximum(begun - 1, 0)
        ends = np.where(flies, over[leg], -np.inf) + CONSTANTS["settling"]
        begin, end = (measure.space(some[leg]) for some in (fleet.begin, fleet.end))
        release, along = np.where(flies, fleet.release[leg], 0.0), end - begin
        stop = min(following, float(ends.max()))
        drones = leg, release, begin, along * flies[:, None]
        yield Stretch(fleet, measure, *drones, start, stop)


def nearest_timed(fleet: FleetLegs, wanted: Separation) -> Encounter:
    """Return the nearest encounter of all timed legs."""
    best = Encounter()
    for measure in measures(wanted):
        for stretch in stretches(fleet, measure):
            stretch.search(_FURTHEST * wanted.distance, best)
    return best


def nearest_untimed(
    fleet: FleetLegs, wanted: Separation, *, landing: bool
) -> Encounter:
    """Return the least distance of the drones' whole lines up, or down.

    Take-off and landing are not timed: any two places on the lines of two drones may be
    taken at once.
    """
    first, last = fleet.first[:-1], fleet.first[1:] - 1
    legs = last if landing else np.column_stack([first, first + 1]).ravel()
    owner, best = fleet.owner[legs], Encounter()
    for measure in measures(wanted):
        begin, end = (measure.space(some[legs]) for some in (fleet.begin, fleet.end))
        pairs = neighbours(begin)
        one, other = ((begin[leg], end[leg]) for leg in pairs.T)
        gap = part_distance(one, other, measure)
        for _ in range(2):
            apart = owner[pairs[:, 0]] != owner[pairs[:, 1]]
            best.take(owner[pairs[apart]], 0.0, gap[apart])
            pairs, gap = _near(begin, end, measure, best.upper)
    return best


def nearest_landing(fleet: FleetLegs, wanted: Separation) -> Encounter:
    """Return how near landings come to what other drones then have still to fly."""
    flights, lag, best = fleet.profiles, CONSTANTS["clock_lag"], Encounter()
    lines = [(m, m.space(fleet.begin), m.space(fleet.end)) for m in measures(wanted)]
    over, leaves = fleet.release + flights.followed(flights.spread) + lag, fleet.leaves
    land, last = fleet.first[1:] - 1, over[fleet.timed].max(initial=-np.inf)
    for drone, own in enumerate(land.tolist()) if leaves[land].min() < last else ():
        legs = np.flatnonzero((over > leaves[own]) & (fleet.owner != drone))
        since, excess = leaves[own] - fleet.release[legs] - lag, flights.excess[legs]
        late = flights.law_time(legs, since) - flights.spread[legs]
        flown, _ = flights.share(legs, late)
        for measure, start, stop in lines:
            way = stop[legs] - start[legs]
            rest, ahead = (start[legs] + k[:, None] * way for k in (flown, excess))
            foot, pad = (np.broadcast_to(one[own], way.shape) for one in (start, stop))
            gap = part_distance((rest, ahead), (foot, pad), measure)
            pairs = np.column_stack([fleet.owner[legs], np.full(legs.size, drone)])
            best.take(pairs, float(leaves[own]), gap)
    return best


def _near(
    begin: FloatArray, end: FloatArray, measure: Measure, least_: float
) -> tuple[IntArray, FloatArray]:
    """Pairs (n, 2) of straight parts nearer than ``least_`` [m], and their distances.

    Parts are given by their ends (drones, axes); a drone may be anywhere on its own.
    """
    middle, radius = 0.5 * (begin + end), 0.5 * measure(end - begin)
    pairs = near_pairs(middle, least_ + 2.0 * float(radius.max()))
    assert pairs is not None  # noqa: S101 - as many as there are
    first, second = pairs.T
    gap = measure(middle.take(first, axis=0) - middle.take(second, axis=0))
    pairs = pairs.compress(gap - radius[first] - radius[second] < least_, axis=0)
    one, other = ((begin.take(k, axis=0), end.take(k, axis=0)) for k in pairs.T)
    gap = part_distance(one, other, measure)
    return pairs.compress(gap < least_, axis=0), gap[gap < least_]


def part_distance(
    one: tuple[FloatArray, FloatArray],
    other: tuple[FloatArray, FloatArray],
    measure: Measure,
) -> FloatArray:
    """Least distances (m,) of straight parts; for the forms per axis, of their boxes.

    Parts are given by their ends in the measure's space, (m, axes) each. The squared
    distance is a convex quadratic of two parameters on the unit square: its least value
    is at the stationary point, if that lies inside, or on one of the four edges.
    """
    (a, b), (c, d) = one, other
    if measure.largest:
        back = np.minimum(a, b) - np.maximum(c, d)
        ahead = np.minimum(c, d) - np.maximum(a, b)
        return measure(np.maximum(np.maximum(back, ahead), 0.0))
    # Axes first: each step then runs along memory.
    u, v, w = (np.ascontiguousarray(way.T) for way in (b - a, d - c, a - c))
    uu, uv, vv, uw, vw = _dot(u, u), _dot(u, v), _dot(v, v), _dot(u, w), _dot(v, w)
    area = uu * vv - uv * uv
    regular = area > 1e-12 * uu * vv
    safe = np.where(regular, area, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = regular & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    shares: list[Any] = [(np.where(inside, s, 0.0), np.where(inside, t, 0.0))]
    for end in (0.0, 1.0):
        s = np.clip((end * uv - uw) / np.where(uu > 0.0, uu, 1.0), 0.0, 1.0)
        t = np.clip((end * uv + vw) / np.where(vv > 0.0, vv, 1.0), 0.0, 1.0)
        shares += [(s, end), (end, t)]
    ways = (w + s * u - t * v for s, t in shares)
    return np.asarray(np.sqrt(np.min([_dot(way, way) for way in ways], axis=0)))


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray((one * other).sum(axis=0))


_LENGTH = Measure((0, 1, 2), (1.0, 1.0, 1.0), largest=False)


class Tubes:
    """Where each drone of a fleet may be drawn at any time.

    A drawn flight is an estimate: where on its leg a drone most likely is. What is
    proved of it is that it lies where the proof of the separation has the drone: on the
    part of its line between the greatest and the least delay, overshoot included, no
    farther beside it than drones were flown.
    """

    def __init__(self, fleet: FleetLegs, descent: float) -> None:
        self._fleet, self._along = fleet, fleet.end - fleet.begin
        self._released = fleet.filled(fleet.release, np.inf)
        self._followed = fleet.profiles.followed(0.0)
        ends = fleet.release + self._followed
        self.last = float(np.max(ends, initial=0.0, where=np.isfinite(ends)))
        """When the last timed leg has been flown [s]."""
        land, slow = fleet.first[1:] - 1, 0.01 * KNOWN["parameters"]["LAND_SPEED"]
        sunk = (fleet.begin - fleet.end)[land, 2].max() / min(descent, slow)
        over = max(self.last, float(fleet.climbs.max())) + fleet.pause.max()
        self._pads, self.latest = fleet.end[land], over + CONSTANTS["landing"] + sunk
        """When all have landed, sinking at ``descent`` [m/s] or slowly [s]."""

    def landed(self, place: FloatArray) -> bool:
        """Whether all drones, at ``place`` (drones, 3) [m], are on their pads."""
        off = np.abs(place - self._pads) if place.size else np.inf
        return bool(np.max(off) <= CONSTANTS["beside"])

    def outside(self, times: FloatArray, place: FloatArray) -> FloatArray:
        """How far off each drone is drawn, over what is allowed, shape (m n,).

        ``place`` (m n, 3) [m] are those of n drones at ``times`` (m,) [s], one time
        after the other; the result is no number where undefined.
        """
        fleet, table = self._fleet, self._fleet.profiles
        drone = np.tile(np.arange(fleet.drones), times.size)
        first, last = fleet.first[drone], fleet.first[drone + 1] - 1
        count = (self._released.T[:, None] <= times[:, None]).sum(axis=0).ravel()
        rank = np.maximum(count, 1)
        # Where there is no timed leg, the landing stands for it.
        leg = first + UNTIMED - 2 + rank
        since = np.repeat(times, fleet.drones) - self._released[drone, rank - 1]
        covered = table.between(leg, since - CONSTANTS["clock_lag"], since)
        # Beyond its end a drone swings for longer than it counts for the separation.
        front = covered.front * table.excess[leg]
        begin, along = (some.take(leg, axis=0) for some in (fleet.begin, self._along))
        rear, front = (begin + part[:, None] * along for part in (covered.rear, front))
        # At any time on its climb before timed legs, on its descent after them.
        rows = np.flatnonzero(count == 0)
        rear[rows], front[rows] = fleet.begin[first[rows]], fleet.begin[first[rows] + 2]
        off = _LENGTH.of_chords(rear - place, front - place)
        done = count > last - first - UNTIMED
        rows = np.flatnonzero(done & (since > self._followed[leg]))
        ends = (some[last[rows]] - place[rows] for some in (fleet.begin, fleet.end))
        lands = _LENGTH.of_chords(*ends) - table.overshoot[leg[rows]]
        off[rows] = np.minimum(lands, off[rows])
        allowed = CONSTANTS["beside_fast"] * covered.fast * table.length[leg]
        return np.asarray(off / (CONSTANTS["beside"] + allowed))
