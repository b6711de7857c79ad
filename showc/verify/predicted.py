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

from showc.verify.autopilot import SETTLING, SPREAD
from showc.verify.legs import joined
from showc.verify.parts import (
    metric_scale,
    near_pairs,
    nearest_places,
    part_distance,
)
from showc.verify.stretches import Stretch, stretches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.log import showc_pb2 as pb
    from showc.verify.autopilot import Profiles
    from showc.verify.legs import MissionLegs

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

RESOLUTION = 2e-3
"""How far the proved distance may lie below the true one [m]."""

PIECES = 16
"""Pieces of a stretch of time at first."""

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
            top, bottom = mission.places[count - 1], mission.places[count]
        else:
            climbed = int(timed[0]) if timed.size else max(count - 1, 0)
            top, bottom = mission.places[climbed], mission.places[0]
        begin.append(bottom)
        along.append(top - bottom)
    p, u = np.array(begin), np.array(along)
    everyone = np.ones(len(p), dtype=np.bool_)
    found = nearest_places(p, rules, everyone)
    if found is None:
        return None
    a, b, distance = found
    for one, other in near_pairs(p, p + u, rules, distance, everyone):
        value = part_distance(
            (p[one], p[one] + u[one]), (p[other], p[other] + u[other]), rules
        )
        if value.size and value.min() < distance:
            row = int(value.argmin())
            a, b, distance = int(one[row]), int(other[row]), float(value[row])
    return Nearest((a, b), 0.0, distance)


def _refined(
    stretch: Stretch, flights: Profiles, rules: pb.Separation, best: Nearest | None
) -> Nearest | None:
    """Return the nearest of ``best`` and what happens in ``stretch``."""
    everyone = np.arange(stretch.leg.size)
    span = stretch.last - stretch.first
    rear, front, _, _, _ = _reach(stretch, flights, everyone, everyone * 0, span)
    moving = np.any(rear != front, axis=1)
    _, stop, _, _, _ = _reach(
        stretch, flights, everyone, np.ones(everyone.size), span, instant=True
    )
    # The least distance at the end bounds what is worth looking at.
    limit = np.inf if best is None else best.distance
    found = nearest_places(stop, rules, moving, limit)
    if found is not None:
        best = Nearest(found[:2], stretch.last, found[2])
    if best is None:
        return None
    pairs = []
    for a, b in near_pairs(rear, front, rules, best.distance, moving):
        whole = part_distance((rear[a], front[a]), (rear[b], front[b]), rules)
        near = whole < best.distance
        pairs.append((a[near], b[near]))
    a, b = (np.concatenate(side) for side in zip(*pairs, strict=True))
    for top in range(0, a.size, PAIRS):
        part = slice(top, top + PAIRS)
        best = _halved(stretch, flights, rules, (a[part], b[part]), best)
    return best


def _halved(
    stretch: Stretch,
    flights: Profiles,
    rules: pb.Separation,
    pairs: tuple[IntArray, IntArray],
    best: Nearest,
) -> Nearest:
    """Return the nearest of ``best`` and what ``pairs`` do in ``stretch``."""
    span = stretch.last - stretch.first
    count = PIECES
    piece = np.tile(np.arange(count), pairs[0].size)
    a, b = np.repeat(pairs[0], count), np.repeat(pairs[1], count)
    while a.size:
        width = span / count
        bound, value = _examined(stretch, flights, rules, (a, b, piece), width)
        row = int(value.argmin())
        if value[row] < best.distance:
            time = stretch.first + (int(piece[row]) + 0.5) * width
            best = Nearest((int(a[row]), int(b[row])), float(time), float(value[row]))
        left = bound < best.distance - RESOLUTION
        a, b = np.repeat(a[left], 2), np.repeat(b[left], 2)
        piece = np.repeat(2 * piece[left], 2)
        piece[1::2] += 1
        count *= 2
    return best


def _examined(
    stretch: Stretch,
    flights: Profiles,
    rules: pb.Separation,
    rows: tuple[IntArray, IntArray, IntArray],
    width: float,
) -> tuple[FloatArray, FloatArray]:
    """Lower bounds over pieces of time, and least distances in their middles."""
    a, b, piece = rows
    base = int(piece.max()) + 1
    keys, place = np.unique(
        np.concatenate([a, b]) * base + np.concatenate([piece, piece]),
        return_inverse=True,
    )
    drone, part = keys // base, keys % base
    rear, front, slow, fast, moving = _reach(stretch, flights, drone, part, width)
    middle_rear, middle_front, _, _, still_moving = _reach(
        stretch, flights, drone, part + 0.5, width, instant=True
    )
    # Where a drone settles it jumps: no speed bounds what was before.
    settles = moving & ~still_moving
    one, other = place[: a.size], place[a.size :]
    value = part_distance(
        (middle_rear[one], middle_front[one]),
        (middle_rear[other], middle_front[other]),
        rules,
    )
    whole = part_distance((rear[one], front[one]), (rear[other], front[other]), rules)
    scale = metric_scale(rules)
    u, v = stretch.along[a] * scale, stretch.along[b] * scale
    relative = np.zeros(a.size)
    for speed_a in (slow[one], fast[one]):
        for speed_b in (slow[other], fast[other]):
            gap = speed_a[:, None] * u - speed_b[:, None] * v
            np.maximum(relative, np.einsum("nk,nk->n", gap, gap), out=relative)
    sharp = np.maximum(whole, value - 0.5 * width * np.sqrt(relative))
    return np.where(settles[one] | settles[other], whole, sharp), value


def _reach(
    stretch: Stretch,
    flights: Profiles,
    drone: IntArray,
    part: NDArray[np.int64] | FloatArray,
    width: float,
    *,
    instant: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
    """Rearmost and foremost places (m, 3), least and greatest rates (m,) [1/s].

    And whether each drone has not settled at the start.
    """
    leg, release = stretch.leg[drone], stretch.release[drone]
    since = stretch.first + part * width - release
    late = flights.law_time(leg, since) - SPREAD
    early = flights.law_time(leg, since + (0.0 if instant else width)) + SPREAD
    rear, slow_rear = flights.fraction(leg, late)
    front, slow_front = flights.fraction(leg, early)
    # The speed rises, stays and falls: it is greatest nearest to the leg's middle.
    _, fast = flights.fraction(leg, np.clip(0.5 * flights.duration[leg], late, early))
    begin, along = stretch.begin[drone], stretch.along[drone]
    moving = late < flights.duration[leg] + SETTLING
    excess = np.where(moving, flights.excess[leg], 1.0)
    return (
        begin + rear[:, None] * along,
        begin + (excess * front)[:, None] * along,
        # The law's time runs slower than the clock at first, by up to 35 %.
        0.65 * np.minimum(slow_rear, slow_front),
        excess * fast,
        moving,
    )
