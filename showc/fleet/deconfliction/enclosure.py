"""Flights within the fence: ways round its corners, and walls that keep them there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.walls import NODES
from showc.fleet.shared_profile.straight import fly_straight
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.flight import Trajectory
from showc.trajectory import PiecewisePolynomial, concatenate

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.shared_profile.profile import Profile
    from showc.fleet.single_drone.model import Aircraft
    from showc.script.fence import Fence


_REACH = 4.0
"""Distance from a flight beyond which the fence lays no walls [m]."""
_ROOM = 5e-3
"""How much more than the margin walls keep [m]: they give way a little."""
_LONE = 0.25
"""Share of the drones up to which those that leave the fence go round on their own."""
_ROOMS = np.linspace(0.0, 1.0, 9)
"""Shares of the radius of those that go round together that their middle keeps from
the fence: the least that is enough. What counts is how wide they are, not how long."""
_CUT = 1.0
"""How far within corners of its way a drone cuts them [m]: half of what the curve
leaves of 5 m/s, in half of its time."""
_STEPS = 4
"""Pieces of a reference on each interval of a spline."""
_CURVE = 1.2
"""Time over which a reference takes a corner [s]: that of tilting to the other side."""


@dataclass(frozen=True, slots=True, eq=False)
class Detour:
    """A way round the fence's corners, from hover to hover."""

    places: FloatArray
    """Corners of the way, both ends included, shape (m, 3) [m]."""
    pace: FloatArray | None = None
    """Times that its pieces are given, up to a factor, shape (m - 1,); None: those at
    the greatest speed."""

    def cruises(self, aircraft: Aircraft) -> FloatArray:
        """Return times of its pieces at the greatest speed, shape (m - 1,) [s]."""
        if self.pace is not None:
            return self.pace
        limits, way = aircraft.limits, np.diff(self.places, axis=0)
        fastest = np.where(way > 0.0, limits.velocity_max, limits.velocity_min)
        level = np.hypot(way[:, 0], way[:, 1]) / (limits.level_speed or np.inf)
        return np.asarray(np.maximum((way / fastest).max(axis=1), level))

    def straightened(self, aircraft: Aircraft) -> FloatArray:
        """Return a straight way that takes as long at the greatest speed, (3,) [m]."""
        cruises = self.cruises(aircraft)
        longest = int(np.argmax(cruises))
        way = self.places[longest + 1] - self.places[longest]
        return np.asarray(way * (cruises.sum() / cruises[longest]))

    def reference(
        self, aircraft: Aircraft, profile: Profile, intervals: int
    ) -> PiecewisePolynomial:
        """Return the way flown on a shared profile, 3 components.

        What the profile shares out is not the length but the time at the greatest
        speed: no piece asks for more speed than another.
        """
        duration = profile.duration
        breaks = np.linspace(0.0, duration, _STEPS * intervals + 1)
        gone = np.concatenate([[0.0], np.cumsum(self.cruises(aircraft))])
        # The mean over a time cuts the corners: a curve that a drone can follow.
        window = np.clip(
            np.arange(-_STEPS, _STEPS + 1) * (0.5 * _CURVE / _STEPS) + breaks[:, None],
            0.0,
            duration,
        )
        share = profile.derivatives()[0](window)[..., 0]
        at = np.stack(
            [
                np.interp(share * gone[-1], gone, axis).mean(axis=1)
                for axis in self.places.T
            ],
            axis=1,
        )
        at[0], at[-1] = self.places[0], self.places[-1]
        return PiecewisePolynomial(breaks, np.stack([at[:-1], at[1:]], axis=1))

    def profiles(self, aircraft: Aircraft) -> list[Profile]:
        """Return the quickest profile of each piece, from hover to hover."""
        return [_quickest(aircraft, *way) for way in np.diff(self.places, axis=0)]

    def halting_time(self, aircraft: Aircraft) -> float:
        """Return the least time with a stop at every corner [s]."""
        return sum(profile.duration for profile in self.profiles(aircraft))

    def halting(self, aircraft: Aircraft, duration: float) -> Trajectory | None:
        """Fly it with a stop at every corner; None if that takes longer."""
        profiles, least = self.profiles(aircraft), self.halting_time(aircraft)
        if least > duration:
            return None
        state, control, clock = [], [], 0.0
        for number, profile in enumerate(profiles):
            ends = self.places[number : number + 1], self.places[number + 1][None]
            last = number == len(profiles) - 1
            takes = profile.duration * (duration / least)
            stretched = profile.stretched(duration - clock if last else takes)
            flight = fly_straight(
                aircraft.vehicle, aircraft.heading, *ends, stretched
            ).trajectory(0)
            state.append(flight.state.shifted(clock))
            control.append(flight.control.shifted(clock))
            clock = float(state[-1].end)
        return Trajectory(concatenate(state), concatenate(control))


@lru_cache(maxsize=4096)
def _quickest(aircraft: Aircraft, x: float, y: float, z: float) -> Profile:
    """Find the quickest profile of a straight way [m], kept: stops are tried again."""
    way = np.array([[x, y, z]])
    return shared_profile(
        aircraft.vehicle, aircraft.limits, aircraft.heading, np.zeros_like(way), way
    )


def displacement(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    around: Mapping[int, Detour],
) -> FloatArray:
    """Return straight ways that cruise as long as a fleet's do, shape (n, 3) [m].

    Parameters
    ----------
    start, goal
        Shape (n, 3) [m].
    around
        Ways of those that do not go straight, by row.
    """
    found = goal - start
    for row, way in around.items():
        found[row] = way.straightened(aircraft)
    return found


def detours(
    fence: Fence, aircraft: Aircraft, start: FloatArray, goal: FloatArray
) -> dict[int, Detour | None]:
    """Find ways for a fleet some of whose straight ways leave the fence.

    Of drones that see each other at both ends, a few go round on their own. Where more
    must and there is room, all of these follow the way of their middle, each drone with
    its place about it: at every instant the drones are then to each other as on
    straight ways, and as far apart. Else each that must takes its own shortest way.

    Parameters
    ----------
    start, goal
        Shape (n, 3) [m].

    Returns
    -------
    dict
        By row; None for a drone that has no way. Empty if all straight ways stay.
    """
    found: dict[int, Detour | None] = {}
    leaving = np.array(
        [
            not fence.straight(one[:2], other[None, :2])[0]
            for one, other in zip(start, goal, strict=True)
        ]
    )
    for rows in _flocks(fence, start, goal) if leaving.any() else ():
        together = None
        if leaving[rows].sum() > _LONE * rows.size:
            together = _together(fence, aircraft, start[rows], goal[rows])
        if together is not None:
            found |= dict(zip(rows.tolist(), together, strict=True))
            continue
        for row in rows[leaving[rows]].tolist():
            found[row] = detour(fence, start[row], goal[row])
    return dict(sorted(found.items()))


def _flocks(fence: Fence, start: FloatArray, goal: FloatArray) -> list[IntArray]:
    """Rows of drones that see those of one of them at both ends."""
    left, found = np.arange(start.shape[0]), []
    while left.size:
        first = left[0]
        seen = fence.straight(start[first, :2], start[left, :2])
        seen &= fence.straight(goal[first, :2], goal[left, :2])
        seen[0] = True
        found.append(left[seen])
        left = left[~seen]
    return found


def _together(
    fence: Fence, aircraft: Aircraft, start: FloatArray, goal: FloatArray
) -> list[Detour] | None:
    """Find one way for all, each drone with its place about the fleet's middle.

    The nearer its middle passes the corners, the shorter it is.
    """
    first, last = start.mean(axis=0), goal.mean(axis=0)
    offsets = np.concatenate([start - first, goal - last])
    room = float(np.hypot(offsets[:, 0], offsets[:, 1]).max())
    for share in _ROOMS:
        wide = replace(fence, margin=fence.margin + share * room)
        if not wide.keeps(np.stack([first[:2], last[:2]])).all():
            return None
        middle = detour(wide, first, last)
        if middle is None:
            return None
        places = middle.places
        gone = np.concatenate([[0.0], np.cumsum(middle.cruises(aircraft))])
        gone = (gone / gone[-1])[:, None, None]
        ways = places[:, None] + (1.0 - gone) * (start - first) + gone * (goal - last)
        ways[0], ways[-1] = start, goal
        if _stay(fence, ways):
            break
    else:
        return None
    found = [Detour(ways[:, row]) for row in range(start.shape[0])]
    pace = np.max([way.cruises(aircraft) for way in found], axis=0)
    return [replace(way, pace=pace) for way in found]


def _stay(fence: Fence, ways: FloatArray) -> bool:
    """Whether ways (m, n, 3) stay within a fence, with room for curves at corners."""
    curved = replace(fence, margin=fence.margin + _CUT)
    if not curved.keeps(ways[1:-1, :, :2].reshape(-1, 2)).all():
        return False
    return all(
        fence.straight(one[:2], other[None, :2])[0]
        for before, after in pairwise(ways)
        for one, other in zip(before, after, strict=True)
    )


def detour(fence: Fence, start: FloatArray, goal: FloatArray) -> Detour | None:
    """Find the shortest way within a fence; None if there is none.

    Heights change evenly along it.

    Parameters
    ----------
    start, goal
        Shape (3,) [m].
    """
    way = fence.way(start[:2], goal[:2])
    if way is None:
        return None
    gone = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))]
    )
    share = gone / max(float(gone[-1]), 1e-12)
    height = start[2] + share * (goal[2] - start[2])
    places = np.column_stack([way, height])
    places[0], places[-1] = start, goal
    return Detour(places)


def fence_walls(
    fence: Fence, positions: FloatArray, extra: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Lay walls about a flight so that each interval stays in a convex corridor.

    Parameters
    ----------
    positions
        At ``NODES`` of each interval, shape (K, 7, 3), within the fence [m].
    extra
        How much more than the margin to keep [m], as far as the ends allow it.

    Returns
    -------
    tuple
        Intervals (m,), normals (m, 2, 3), offsets at ``NODES`` (m, 7) [m].
    """
    interval, normals, offsets = [], [], []
    last = positions.shape[0] - 1
    for number, nodes in enumerate(positions[..., :2]):
        start, end = nodes[0], nodes[-1]
        margin = fence.margin + _ROOM + extra
        for plane in fence.corridor(start, end, fence.margin + _REACH, margin):
            normal = np.array(plane.normal)
            # Both ends are given: no wall may ask for more than they allow.
            offset = plane.offset
            if number == 0:
                offset = min(offset, float(normal @ start))
            if number == last:
                offset = min(offset, float(normal @ end))
            interval.append(number)
            normals.append((*plane.normal, 0.0))
            offsets.append(offset)
    normal = np.array(normals).reshape(-1, 1, 3)
    return (
        np.array(interval, dtype=np.int64),
        np.repeat(normal, 2, axis=1),
        np.repeat(np.array(offsets).reshape(-1, 1), NODES.size, axis=1),
    )
