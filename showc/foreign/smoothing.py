"""Whether a show can be flown: smoothed as little as an aircraft needs.

A file made of straight lines has corners, which no aircraft flies. What it can fly is
the file's flight averaged over a kernel: four boxes of a quarter of its width each (a
cubic B-spline; Schoenberg 1946). The average of piecewise polynomials over a box is
again one, exactly: the difference of its integral at two instants over the width of
the box. So everything below is known at every instant, without sampling. Averages are
never faster than what they average.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.foreign.motion import (
    Greatest,
    chosen,
    common,
    derivative,
    difference,
    greatest,
    jumps,
    length,
    owners,
    portions,
    standing,
)
from showc.processes import side_by_side

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import FloatArray
    from showc.verify.kernel.slices import Tracks


GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s²] (CGPM 1901)."""

BOXES = 4
"""Boxes that make a kernel: the acceleration of straight lines becomes a cubic."""

CORNER = 0.012
"""Jump of velocity at a joint that is rounding of handles on a millimetre grid: 3 mm
over a quarter of a second [m/s]."""

WIDEST = 10.0
"""Widest kernel that is tried [s]: a wider one makes another show."""

NARROWEST = 0.05
"""Step of the widths, and the least [s]: a fifth of the quarter second of a piece."""

FASTEST = 100.0
"""Speed along an axis beyond which nothing is smoothed [m/s]: no multicopter has it."""

_ANGLE, _THRUST, _LENGTH = 1e-3, 1e-3, 1e-4
"""Widths of the enclosures of tilt [rad], thrust over weight, and lengths [m]."""

NAMED = 3
"""Drones whose greatest difference from the file is given."""

_MANY = 4
"""Portions of a fleet from which on they are smoothed side by side."""

_WORST = 8
"""Drones with which the width is sought; the rest are proved with it at the end."""


@dataclass(frozen=True, slots=True)
class Agility:
    """What an aircraft can do."""

    tilt: float
    """Greatest angle between thrust and the vertical [rad]."""
    thrust_min: float
    """Least vertical thrust over weight."""
    thrust_max: float
    """Greatest thrust over weight."""


@dataclass(frozen=True, slots=True)
class Demand:
    """What a flight asks of an aircraft at most."""

    tilt: Greatest
    """[rad]"""
    thrust: Greatest
    """Over weight."""
    lightest: Greatest
    """Minus the least vertical thrust over weight."""

    def within(self, agility: Agility) -> bool:
        """Whether the aircraft can do it."""
        return (
            self.tilt.upper <= agility.tilt
            and self.thrust.upper <= agility.thrust_max
            and -self.lightest.upper >= agility.thrust_min
        )


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """A fleet's flights as an aircraft can fly them."""

    width: float
    """Of the kernel [s]; 0: as they are."""
    demand: Demand
    """What is left to ask."""
    tube: Greatest
    """How far the smoothed flight is from the file's [m]."""
    corners: tuple[Greatest, ...]
    """Where it is furthest: of the drones that leave the file most, worst first."""


def integral(tracks: Tracks) -> Tracks:
    """Integral over time, zero at each drone's start, one degree higher."""
    points = tracks.position.shape[1]
    width = (tracks.ends - tracks.starts)[:, None, None] / points
    steps = np.cumsum(tracks.position * width, axis=1)
    total = np.concatenate([np.zeros((1, steps.shape[2])), np.cumsum(steps[:, -1], 0)])
    before = total[:-1] - total[tracks.first[:-1]][owners(tracks)]
    body = np.concatenate([np.zeros_like(steps[:, :1]), steps], axis=1)
    return replace(tracks, position=body + before[:, None])


def moved(tracks: Tracks, offset: float) -> Tracks:
    """Return the same flights ``offset`` [s] later."""
    return replace(
        tracks,
        begin=tracks.begin + offset,
        end=tracks.end + offset,
        starts=tracks.starts + offset,
        ends=tracks.ends + offset,
    )


def rise(tracks: Tracks, width: float) -> Tracks:
    """Return what changes over ``width`` [s] around each instant, over that width.

    It is the derivative of the average over a box, on the time that is less by half the
    width at both ends.
    """
    half = 0.5 * width
    later, earlier = common(
        moved(tracks, -half),
        moved(tracks, half),
        tracks.begin + half,
        tracks.end - half,
    )
    return replace(later, position=(later.position - earlier.position) / width)


def average(tracks: Tracks, width: float) -> Tracks:
    """Average over a box of ``width`` [s] around each instant."""
    # Near the origin integrals stay small, and their differences exact.
    origin = tracks.position[tracks.first[:-1], :1]
    centred = replace(tracks, position=tracks.position - origin[owners(tracks)])
    result = rise(integral(centred), width)
    return replace(result, position=result.position + origin[owners(result)])


def repeated(
    tracks: Tracks, change: Callable[[Tracks, float], Tracks], width: float, times: int
) -> Tracks:
    """Apply ``change`` over a box ``times`` times."""
    for _ in range(times):
        tracks = change(tracks, width)
    return tracks


def widened(tracks: Tracks, width: float) -> Tracks:
    """Let all drones stand for half of ``width`` [s] longer at both ends."""
    half = 0.5 * width
    return standing(tracks, tracks.begin - half, tracks.end + half)


def demand_of(tracks: Tracks, width: float) -> Demand:
    """Return what flights ask of an aircraft, smoothed over ``width`` [s]."""
    found: list[Demand] = []
    for first, part in portions(tracks):
        found.append(_demand(acceleration(part, width), first))
    return _greatest_demand(found)


def acceleration(tracks: Tracks, width: float) -> Tracks:
    """Return the acceleration of flights smoothed over ``width`` [s]; 0: as is."""
    if width == 0.0:
        return derivative(derivative(tracks))
    box = width / BOXES
    quiet = repeated(widened(tracks, width), average, box, BOXES - 2)
    return repeated(quiet, rise, box, 2)


def _demand(change: Tracks, first: int) -> Demand:
    """Return what accelerations ask; ``first`` is the number of their first drone."""
    force = replace(
        change, position=change.position / GRAVITY + np.array([0.0, 0.0, 1.0])
    )
    found = (
        greatest(force, tilt_of, _ANGLE),
        greatest(force, length((0, 1, 2)), _THRUST),
        greatest(force, lambda value: -value[..., 2], _THRUST),
    )
    return Demand(*(replace(one, drone=one.drone + first) for one in found))


def _greatest_demand(found: list[Demand]) -> Demand:
    return Demand(
        max((one.tilt for one in found), key=lambda value: value.upper),
        max((one.thrust for one in found), key=lambda value: value.upper),
        max((one.lightest for one in found), key=lambda value: value.upper),
    )


def tilt_of(force: FloatArray) -> FloatArray:
    """Angle between a force and the vertical [rad]; half a turn where it is down.

    Cones of less than a right angle are convex, so the angle is quasi-convex there.
    """
    flat = np.hypot(force[..., 0], force[..., 1])
    angle = np.arctan2(flat, force[..., 2])
    return np.where(force[..., 2] > 0.0, angle, np.pi)


def smoothed(tracks: Tracks, width: float) -> Tracks:
    """Return the flights averaged over a kernel of ``width`` [s]."""
    return repeated(widened(tracks, width), average, width / BOXES, BOXES)


def least_smoothing(tracks: Tracks, agility: Agility) -> Smoothed | None:
    """Find the narrowest kernel, in steps of 0.05 s, that an aircraft can follow.

    Returns
    -------
    Smoothed or None
        None if not even the widest kernel is enough.
    """
    if smooth_enough(tracks):
        demand = demand_of(tracks, 0.0)
        if demand.within(agility):
            still = Greatest(0.0, 0.0, 0, tracks.begin)
            return Smoothed(0.0, demand, still, ())
    velocity = derivative(tracks)
    if np.abs(velocity.position).max() > FASTEST:
        return None
    steps, most = _steps_for_some(tracks, agility), round(WIDEST / NARROWEST)
    while steps <= most:
        width = round(steps * NARROWEST, 6)
        demand, corners = _smoothed_all(tracks, width)
        if demand.within(agility):
            return Smoothed(width, demand, corners[0], tuple(corners))
        steps += max(1, steps // 10)
    return None


def _steps_for_some(tracks: Tracks, agility: Agility) -> int:
    """Count the steps of a kernel that is enough for those that turn hardest."""
    worst = _hardest(tracks)
    low, high = 0, round(WIDEST / NARROWEST)
    if not demand_of(worst, WIDEST).within(agility):
        return high + 1
    while high - low > 1:
        middle = (low + high) // 2
        if demand_of(worst, middle * NARROWEST).within(agility):
            high = middle
        else:
            low = middle
    return high


def _smoothed_all(tracks: Tracks, width: float) -> tuple[Demand, list[Greatest]]:
    """Say what flights ask, smoothed over ``width`` [s], and where they leave the file.

    Some drones at a time; of a great fleet side by side.
    """

    def found(first: int, part: Tracks) -> tuple[Demand, list[Greatest]]:
        box = width / BOXES
        quiet = repeated(widened(part, width), average, box, BOXES - 2)
        demand = _demand(repeated(quiet, rise, box, 2), first)
        soft = repeated(quiet, average, box, 2)
        return demand, _furthest(difference(soft, part), first)

    parts = [partial(found, first, part) for first, part in portions(tracks)]
    every = side_by_side(parts, None if len(parts) >= _MANY else 1)
    corners = sorted((one for _, some in every for one in some), key=_by_size)
    return _greatest_demand([one for one, _ in every]), corners[:NAMED]


def _by_size(one: Greatest) -> tuple[float, int]:
    return -one.upper, one.drone


def _furthest(apart: Tracks, first: int) -> list[Greatest]:
    """Return the greatest differences of the drones that are furthest off."""
    measured = length((0, 1, 2))
    reach = np.maximum.reduceat(measured(apart.position).max(axis=1), apart.first[:-1])
    found: list[Greatest] = []
    for drone in np.argsort(-reach, kind="stable").tolist():
        if len(found) >= NAMED and reach[drone] <= found[NAMED - 1].lower:
            break
        one = greatest(chosen(apart, slice(drone, drone + 1)), measured, _LENGTH)
        found.append(replace(one, drone=drone + first))
        found.sort(key=_by_size)
    return found[:NAMED]


def smooth_enough(tracks: Tracks) -> bool:
    """Whether velocity goes on without jumps, but for rounding."""
    _, off = jumps(derivative(tracks))
    return bool(np.sqrt((off**2).sum(axis=1)).max(initial=0.0) <= CORNER)


def _hardest(tracks: Tracks) -> Tracks:
    """Return the drones that turn hardest: they need most smoothing."""
    size = np.zeros(tracks.drones)
    for first, part in portions(tracks):
        change = repeated(widened(part, 2.0), rise, 0.5, 2)
        reach = np.sqrt((change.position**2).sum(axis=2)).max(axis=1)
        np.maximum.at(size, owners(change) + first, reach)
    worst = np.sort(np.argsort(-size)[:_WORST])
    rows = np.isin(owners(tracks), worst)
    return replace(
        tracks,
        first=np.concatenate([[0], np.cumsum(np.diff(tracks.first)[worst])]),
        starts=tracks.starts[rows],
        ends=tracks.ends[rows],
        position=tracks.position[rows],
    )
