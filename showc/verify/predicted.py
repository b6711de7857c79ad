"""Separation of the flights that the autopilots will make, from the missions' bytes.

Every drone is late by something between 0.15 and 0.55 s, leg by leg, so at time t it is
on the part of its line between its nominal places at t - 0.55 s and t - 0.15 s. The
distance of two such parts is the least that any two delays give, and it changes no
faster than the drones' greatest relative speed: pieces of time are halved until none
can hold anything nearer than what was found, by more than the resolution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import GREATEST_DELAY, LEAST_DELAY
from showc.verify.legs import joined

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

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

TOGETHER = 0.5
"""Releases within this time of each other are looked at together [s]."""

ROWS = 200
"""Drones whose pairs are looked at together."""

DAY = 86400.0


class OverlappingLegsError(Exception):
    """A drone may still fly one leg when the next one is released."""

    def __init__(self, drone: int, time: float) -> None:
        super().__init__(f"drone {drone + 1} at {time:.2f} s")
        self.drone = drone
        self.time = time


@dataclass(frozen=True, slots=True)
class Nearest:
    """The pair that can come nearest."""

    pair: tuple[int, int]
    """Drones, counting from 0."""
    time: float
    """On the missions' clock [s]."""
    distance: float
    """In the separation's metric, at most the resolution above the least [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Stretch:
    """One leg of every drone, or rest, during a stretch of time."""

    begin: FloatArray
    along: FloatArray
    leg: IntArray
    release: FloatArray
    first: float
    last: float


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
    releases = _on_one_day(missions)
    for drone, (mission, release) in enumerate(zip(missions, releases, strict=True)):
        timed = np.flatnonzero(np.isfinite(release))
        ends = release + mission.profiles.duration + GREATEST_DELAY
        late = np.flatnonzero(ends[timed[:-1]] > release[timed[1:]] + LEAST_DELAY)
        if late.size:
            raise OverlappingLegsError(drone, float(release[timed[late[0] + 1]]))
    best: Nearest | None = None
    for stretch in _stretches(missions, releases, flights, first_leg):
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
    best: Nearest | None = None
    for a, b in _pairs(np.ones(len(p), dtype=np.bool_)):
        value = _distance((p[a], p[a] + u[a]), (p[b], p[b] + u[b]), rules)
        if value.size and (best is None or value.min() < best.distance):
            row = int(value.argmin())
            best = Nearest((int(a[row]), int(b[row])), 0.0, float(value[row]))
    return best


def _on_one_day(missions: Sequence[MissionLegs]) -> list[FloatArray]:
    """Releases of all drones, those behind midnight after those before it."""
    first = [
        mission.release[np.isfinite(mission.release)][:1].sum() for mission in missions
    ]
    late = max(first, default=0.0)
    return [
        mission.release + (DAY if moment < late - DAY / 2.0 else 0.0)
        for mission, moment in zip(missions, first, strict=True)
    ]


def _cuts(releases: Sequence[FloatArray], ends: Sequence[FloatArray]) -> FloatArray:
    """Return times [s] between which nobody can fly more than one leg.

    Releases that lie close together share a cut, unless a drone's own leg before it
    still runs then.
    """
    moments = np.sort(np.concatenate(releases)) + LEAST_DELAY
    cuts: list[float] = []
    for moment in moments.tolist():
        if not cuts or moment - cuts[-1] > TOGETHER:
            cuts.append(moment)
    while True:
        edges = np.array(cuts)
        missing = set()
        for release, end in zip(releases, ends, strict=True):
            begins = release[1:] + LEAST_DELAY
            shared = edges[np.searchsorted(edges, begins + 1e-9) - 1]
            missing |= set(begins[end[:-1] > shared + 1e-9].tolist())
        missing -= set(cuts)
        if not missing:
            return edges
        cuts = sorted([*cuts, *missing])


def _stretches(
    missions: Sequence[MissionLegs],
    releases: Sequence[FloatArray],
    flights: Profiles,
    first_leg: IntArray,
) -> Iterator[_Stretch]:
    """Cut time so that everybody flies at most one leg in a stretch."""
    timed = [np.flatnonzero(np.isfinite(release)) for release in releases]
    known = [release[rows] for release, rows in zip(releases, timed, strict=True)]
    if not any(moments.size for moments in known):
        return
    rows_of = [first + rows for first, rows in zip(first_leg, timed, strict=True)]
    ends = [
        moments + flights.duration[rows] + GREATEST_DELAY
        for moments, rows in zip(known, rows_of, strict=True)
    ]
    cuts = _cuts(known, ends)
    for first, last in zip(cuts, [*cuts[1:], np.inf], strict=True):
        chosen = [
            _current(missions[drone], timed[drone], known[drone], first, last)
            for drone in range(len(missions))
        ]
        legs = first_leg + np.array([leg for leg, _, _ in chosen])
        release = np.array([moment for _, moment, _ in chosen])
        begin = np.array(
            [
                mission.places[leg]
                for mission, (leg, _, _) in zip(missions, chosen, strict=True)
            ]
        )
        along = np.array(
            [
                (mission.places[leg + 1] - mission.places[leg]) * flies
                for mission, (leg, _, flies) in zip(missions, chosen, strict=True)
            ]
        )
        end = (release + flights.duration[legs] + GREATEST_DELAY).max()
        if min(last, end) > first:
            yield _Stretch(
                begin, along, legs, release, float(first), float(min(last, end))
            )


def _current(
    mission: MissionLegs,
    timed: IntArray,
    moments: FloatArray,
    first: float,
    last: float,
) -> tuple[int, float, bool]:
    """Leg of a drone in a stretch, its release, and whether it is flown at all."""
    begun = int(np.searchsorted(moments + LEAST_DELAY, last - 1e-9))
    if begun:
        return int(timed[begun - 1]), float(moments[begun - 1]), True
    # Not yet off: it rests where its first timed leg begins.
    leg = int(timed[0]) if timed.size else max(mission.release.size - 1, 0)
    return leg, first - DAY, False


def _refined(
    stretch: _Stretch, flights: Profiles, rules: pb.Separation, best: Nearest | None
) -> Nearest | None:
    """Return the nearest of ``best`` and what happens in ``stretch``."""
    everyone = np.arange(stretch.leg.size)
    span = stretch.last - stretch.first
    rear, front, _, _ = _reach(stretch, flights, everyone, everyone * 0, span)
    moving = np.any(rear != front, axis=1)
    found = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))]
    limit = np.inf if best is None else best.distance
    for a, b in _pairs(moving):
        # The least distance at the end bounds what is worth looking at.
        value = _distance((front[a], front[a]), (front[b], front[b]), rules)
        if value.size and value.min() < limit:
            row = int(value.argmin())
            limit = float(value[row])
            best = Nearest((int(a[row]), int(b[row])), stretch.last, limit)
        found.append((a, b))
    near_a, near_b = [], []
    for a, b in found:
        near = _distance((rear[a], front[a]), (rear[b], front[b]), rules) < limit
        near_a.append(a[near])
        near_b.append(b[near])
    a, b = np.concatenate(near_a), np.concatenate(near_b)
    count = PIECES
    piece = np.tile(np.arange(count), a.size)
    a, b = np.repeat(a, count), np.repeat(b, count)
    while a.size and best is not None:
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
    stretch: _Stretch,
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
    rear, front, slow, fast = _reach(stretch, flights, drone, part, width)
    middle_rear, middle_front, _, _ = _reach(
        stretch, flights, drone, part + 0.5, width, instant=True
    )
    one, other = place[: a.size], place[a.size :]
    value = _distance(
        (middle_rear[one], middle_front[one]),
        (middle_rear[other], middle_front[other]),
        rules,
    )
    whole = _distance((rear[one], front[one]), (rear[other], front[other]), rules)
    scale = _scale(rules)
    u, v = stretch.along[a] * scale, stretch.along[b] * scale
    relative = np.zeros(a.size)
    for speed_a in (slow[one], fast[one]):
        for speed_b in (slow[other], fast[other]):
            gap = speed_a[:, None] * u - speed_b[:, None] * v
            relative = np.maximum(relative, np.sum(gap * gap, axis=1))
    return np.maximum(whole, value - 0.5 * width * np.sqrt(relative)), value


def _reach(
    stretch: _Stretch,
    flights: Profiles,
    drone: IntArray,
    part: NDArray[np.int64] | FloatArray,
    width: float,
    *,
    instant: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rearmost and foremost places (m, 3), least and greatest rates (m,) [1/s]."""
    leg, release = stretch.leg[drone], stretch.release[drone]
    begun = stretch.first + part * width - release
    late, early = begun - GREATEST_DELAY, begun - LEAST_DELAY
    if not instant:
        early = early + width
    rear, slow_rear = flights.fraction(leg, late)
    front, slow_front = flights.fraction(leg, early)
    # The speed rises, stays and falls: it is greatest nearest to the leg's middle.
    _, fast = flights.fraction(leg, np.clip(0.5 * flights.duration[leg], late, early))
    begin, along = stretch.begin[drone], stretch.along[drone]
    return (
        begin + rear[:, None] * along,
        begin + front[:, None] * along,
        np.minimum(slow_rear, slow_front),
        fast,
    )


def _pairs(moving: NDArray[np.bool_]) -> Iterator[tuple[IntArray, IntArray]]:
    """All pairs with at least one that moves, block by block."""
    count = moving.size
    for top in range(0, count, ROWS):
        rows = np.arange(top, min(top + ROWS, count))
        a, b = (side.ravel() for side in np.meshgrid(rows, np.arange(count)))
        wanted = (a < b) & (moving[a] | moving[b])
        yield a[wanted], b[wanted]


def _scale(rules: pb.Separation) -> FloatArray:
    """Factors that turn the separation's ellipsoid into a sphere."""
    stretched = rules.shape == rules.ELLIPSOID
    return np.array([1.0, 1.0, 1.0 / rules.vertical_stretch if stretched else 1.0])


def _distance(
    one: tuple[FloatArray, FloatArray],
    other: tuple[FloatArray, FloatArray],
    rules: pb.Separation,
) -> FloatArray:
    """Least distance (m,) of straight parts; for the forms per axis, of their boxes."""
    if rules.shape in {rules.ANY_AXIS, rules.ALL_AXES}:
        gap = np.maximum(
            np.minimum(*one) - np.maximum(*other), np.minimum(*other) - np.maximum(*one)
        )
        gap = np.maximum(gap, 0.0)
        return np.asarray(
            gap.max(axis=1) if rules.shape == rules.ANY_AXIS else gap.min(axis=1)
        )
    scale = _scale(rules)
    return _segment_distance(
        one[0] * scale, one[1] * scale, other[0] * scale, other[1] * scale
    )


def _segment_distance(
    a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray
) -> FloatArray:
    """Least distance (m,) of the segments from ``a`` to ``b`` and from ``c`` to ``d``.

    A convex quadratic of two parameters on the unit square: its least value is at the
    stationary point, if that lies inside, or on one of the four edges.
    """
    u, v, w = b - a, d - c, a - c
    best = np.full(a.shape[0], np.inf)
    for point, start, along in ((a, c, v), (b, c, v), (c, a, u), (d, a, u)):
        length = np.sum(along * along, axis=1)
        s = np.sum((point - start) * along, axis=1) / np.where(length > 0, length, 1.0)
        gap = point - start - np.clip(s, 0.0, 1.0)[:, None] * along
        best = np.minimum(best, np.sum(gap * gap, axis=1))
    uu, uv, vv = (np.sum(x * y, axis=1) for x, y in ((u, u), (u, v), (v, v)))
    uw, vw = np.sum(u * w, axis=1), np.sum(v * w, axis=1)
    area = uu * vv - uv * uv
    regular = area > 1e-12 * uu * vv
    safe = np.where(regular, area, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = regular & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    gap = w + s[:, None] * u - t[:, None] * v
    best = np.where(inside, np.minimum(best, np.sum(gap * gap, axis=1)), best)
    return np.asarray(np.sqrt(best))
