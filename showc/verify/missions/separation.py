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
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.missions.distances import (
    metric_scale,
    near_pairs,
    nearest_places,
    part_distance,
)
from showc.verify.missions.legs import joined
from showc.verify.missions.reach import Reach
from showc.verify.missions.stretches import stretches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.log import showc_pb2 as pb
    from showc.verify.missions.law import Profiles
    from showc.verify.missions.legs import MissionLegs
    from showc.verify.missions.stretches import Stretch


RESOLUTION = 2e-3
"""How far the proved distance may lie below the true one [m]."""

COARSE, PIECES = 4, 16
"""Pieces of a stretch of time at first, and of those that are looked into."""

PAIRS = 4096
"""Pairs that are halved together; bounds the memory."""


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
        best = _refined(stretch, flights, rules, best)
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
    stretch: Stretch, flights: Profiles, rules: pb.Separation, best: Nearest | None
) -> Nearest | None:
    """Return the nearest of ``best`` and what happens in ``stretch``."""
    everyone, begin = np.arange(stretch.leg.size), np.zeros(stretch.leg.size)
    span = stretch.last - stretch.first
    reach = Reach(stretch, flights)
    rear, front = reach.places(everyone, begin, span, span)
    moving = np.any(rear != front, axis=0)
    _, stop = reach.places(everyone, begin + 1.0, span, 0.0)
    # The least distance at the end bounds what is worth looking at.
    limit = np.inf if best is None else best.distance
    found = nearest_places(stop.T, rules, moving, limit)
    if found is not None:
        best = Nearest(found[:2], stretch.last, found[2])
    if best is None:
        return None
    pairs = []
    for a, b in near_pairs(rear.T, front.T, rules, best.distance, moving):
        whole = part_distance(
            (rear[:, a], front[:, a]), (rear[:, b], front[:, b]), rules
        )
        near = whole < best.distance
        pairs.append((a[near], b[near]))
    a, b = (np.concatenate(side) for side in zip(*pairs, strict=True))
    for top in range(0, a.size, PAIRS):
        part = slice(top, top + PAIRS)
        best = _halved(reach, rules, (a[part], b[part]), best)
    return best


def _halved(
    reach: Reach,
    rules: pb.Separation,
    pairs: tuple[IntArray, IntArray],
    best: Nearest,
) -> Nearest:
    """Return the nearest of ``best`` and what ``pairs`` do in that stretch."""
    stretch = reach.stretch
    span = stretch.last - stretch.first
    count = COARSE
    piece = np.tile(np.arange(count), pairs[0].size)
    a, b = np.repeat(pairs[0], count), np.repeat(pairs[1], count)
    while a.size:
        rows, width = _Rows.of(a, b, piece), span / count
        part = rows.part.astype(np.float64)
        rear, front = reach.places(rows.drone, part, width, width)
        whole = rows.distance(rear, front, rules)
        # What is further apart throughout can be nearer at no instant.
        near = np.flatnonzero(whole < best.distance)
        a, b, piece, whole = a[near], b[near], piece[near], whole[near]
        if count >= PIECES and a.size:
            rows = _Rows.of(a, b, piece)
            bound, value = _examined(reach, rules, rows, whole, width)
            row = int(value.argmin())
            if value[row] < best.distance:
                time = stretch.first + (int(piece[row]) + 0.5) * width
                pair = int(a[row]), int(b[row])
                best = Nearest(pair, float(time), float(value[row]))
            left = bound < best.distance - RESOLUTION
            a, b, piece = a[left], b[left], piece[left]
        a, b, piece = np.repeat(a, 2), np.repeat(b, 2), np.repeat(2 * piece, 2)
        piece[1::2] += 1
        count *= 2
    return best


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Pairs of drones during pieces of time."""

    drone: IntArray
    """Each drone that is in one of them, shape (m,)."""
    part: IntArray
    """And during which piece, shape (m,)."""
    one: IntArray
    """Where in these the first of each pair is, shape (n,)."""
    other: IntArray
    """And the second, shape (n,)."""

    @classmethod
    def of(cls, a: IntArray, b: IntArray, piece: IntArray) -> _Rows:
        """Return the pairs of ``a`` and ``b`` during ``piece``, all (n,)."""
        base = int(piece.max()) + 1
        keys, place = np.unique(
            np.concatenate([a, b]) * base + np.concatenate([piece, piece]),
            return_inverse=True,
        )
        return cls(keys // base, keys % base, place[: a.size], place[a.size :])

    def distance(
        self, rear: FloatArray, front: FloatArray, rules: pb.Separation
    ) -> FloatArray:
        """Distances (n,) of the pairs' parts, from ``rear`` to ``front`` (3, m)."""
        first, second = (
            (rear.take(rows, axis=1), front.take(rows, axis=1))
            for rows in (self.one, self.other)
        )
        return part_distance(first, second, rules)


def _examined(
    reach: Reach,
    rules: pb.Separation,
    rows: _Rows,
    whole: FloatArray,
    width: float,
) -> tuple[FloatArray, FloatArray]:
    """Lower bounds over pieces of time, and least distances in their middles.

    ``whole`` (n,) are lower bounds already.
    """
    drone, one, other = rows.drone, rows.one, rows.other
    part = rows.part.astype(np.float64)
    rear, front = reach.places(drone, part + 0.5, width, 0.0)
    value = rows.distance(rear, front, rules)
    slow, fast, settles = reach.rates(drone, part, width)
    along = reach.stretch.along.T * metric_scale(rules)[:, None]
    u, v = (along.take(drone[rows], axis=1) for rows in (one, other))
    relative = np.zeros(one.size)
    for speed_a in (slow[one], fast[one]):
        for speed_b in (slow[other], fast[other]):
            gap = speed_a * u - speed_b * v
            np.maximum(relative, np.einsum("kn,kn->n", gap, gap), out=relative)
    sharp = np.maximum(whole, value - 0.5 * width * np.sqrt(relative))
    return np.where(settles[one] | settles[other], whole, sharp), value
