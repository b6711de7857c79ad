"""One drone at the common time: near the reference, and on its side of the walls.

Near the profile, and behind its first walls, splines come first: they need no program
to be built. Where a drone has no slack left for them, and where walls were not enough,
optimal control does the work.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.estimate import minimum_time_estimate
from showc.fleet.single_drone.avoiding import avoid
from showc.fleet.single_drone.following import follow, hover
from showc.fleet.single_drone.model import in_motion
from showc.fleet.single_drone.shortest import minimum_time
from showc.fleet.single_drone.spline import follow_spline
from showc.flight import Trajectory
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.avoiding import Passage
    from showc.fleet.single_drone.model import Aircraft


_MOMENT, _SHARE = 1.5e-3, 3e-3
"""Time left over after a flight in which nothing but hovering is worth it: what
rounding up to whole milliseconds leaves [s], or such a share of the time."""
_SUPPLE = 0.01
"""Share of the time that splines of level moves need to spare: with less they flew none
of 63 drones, with 7 % all of 18. In a climb or a descent 0.3 % was enough for 26."""
STRAIGHT, SPLINE, OPTIMAL = "straight", "spline", "optimal control"
Outcome = tuple[str, Trajectory | None, str]
"""How a drone is flown, its flight if there is one, why not if there is none."""


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of a drone's flight before it is looked for."""

    shortest: Trajectory | None = None
    """Its flight in least time: then it is one of the slowest. Splines are not supple
    enough for these, and not tried."""
    like: Trajectory | None = None
    """A flight in least time from the origin, to a place that is as far and on the same
    side as the drone's goal, roughly: what the search for its own begins with."""
    bending: bool = False
    """Whether drones will have to be bent afterwards: then the program for it is used
    here already, so that all processes build it at the same time."""


def fly_near(  # noqa: PLR0917 - tasks of workers are tuples
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    reference: PiecewisePolynomial,
    intervals: int,
    known: Known,
) -> Outcome:
    """Fly one drone as near as can be to the shared profile on its straight line."""
    duration, straight = reference.end, reference.components == 1
    shortest = known.shortest
    quick = partial(
        minimum_time, aircraft, start, goal, like=known.like, enough=duration
    )
    if shortest is None and not known.bending:
        found = None
        if not _hurried(aircraft, goal - start, known.like, duration):
            found = follow_spline(aircraft, start, goal, reference, intervals)
        if found is not None:
            return SPLINE, found.flight.trajectory(0), ""
        if straight:
            # Too slow for splines, it is often nearly the slowest.
            shortest = quick().trajectory
    if shortest is not None and _nearly(shortest.state.end, duration):
        return OPTIMAL, lingering(aircraft, shortest, goal, duration), ""
    flight = avoid(aircraft, start, goal, reference, shortest=shortest)
    if flight is not None:
        return OPTIMAL, flight, ""
    if not straight:
        return OPTIMAL, None, "no flight near the way was found"
    if shortest is None:
        # With so little time that its least is worth knowing.
        shortest = quick().trajectory
        if shortest is not None and _nearly(shortest.state.end, duration):
            return OPTIMAL, lingering(aircraft, shortest, goal, duration), ""
    result = follow(
        aircraft, start, goal, duration, reference=reference, shortest=shortest
    )
    return OPTIMAL, result.trajectory if result.solved else None, result.message


def _hurried(
    aircraft: Aircraft, way: FloatArray, like: Trajectory | None, duration: float
) -> bool:
    """Whether a displacement (3,) [m] leaves no time for splines in a duration [s].

    The estimate of its least time errs by several percent, but as much for the flight
    that is like it. What takes a spline long is to lean: climbs may be quick.
    """
    if like is None:
        return False
    ways = np.stack([way, like.state.coefficients[-1, -1, :3], way * [1.0, 1.0, 0.0]])
    low, _ = minimum_time_estimate(aircraft, np.zeros_like(ways), ways)
    level, least = low[2] / low[0], like.state.end * low[0] / low[1]
    return bool(min(level, least / duration) > 1.0 - _SUPPLE)


def _nearly(least: float, duration: float) -> bool:
    """Whether a time [s] leaves next to nothing over a drone's least one [s]."""
    return 0.0 <= duration - least < max(_MOMENT, _SHARE * duration)


def lingering(
    aircraft: Aircraft,
    flight: Trajectory,
    place: FloatArray,
    duration: float,
    *,
    early: bool = False,
) -> Trajectory:
    """Return a flight and a hover over what is left of the duration [s], or before."""
    left = duration - flight.state.end
    if left == 0.0:
        return flight
    breaks = np.append(flight.state.breaks, duration)
    if early:
        breaks = np.append(0.0, flight.state.breaks + left)
        breaks[-1] = duration
    still = hover(aircraft, place, duration)

    def longer(part: PiecewisePolynomial, rest: PiecewisePolynomial) -> FloatArray:
        more = np.broadcast_to(
            rest.coefficients[:, :1], (1, *part.coefficients[0].shape)
        )
        parts = [more, part.coefficients] if early else [part.coefficients, more]
        return np.concatenate(parts)

    return Trajectory(
        PiecewisePolynomial(breaks, longer(flight.state, still.state)),
        PiecewisePolynomial(breaks, longer(flight.control, still.control)),
        flight.meshes,
    )


def fly_smoothly(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    duration: float,
    shortest: Trajectory | None = None,
) -> Outcome:
    """Fly one drone with the least effort between ends of which some are in motion.

    Parameters
    ----------
    start, goal
        Places to hover at, shape (3,) [m], or states and thrusts (13,).
    duration
        Time of the flight [s].
    shortest
        Its flight in least time, if it is known.
    """
    if shortest is not None and _nearly(shortest.state.end, duration):
        for end, early in ((goal, False), (start, True)):
            if not in_motion(end):
                flight = lingering(aircraft, shortest, end[:3], duration, early=early)
                return OPTIMAL, flight, ""
    result = follow(aircraft, start, goal, duration, shortest=shortest)
    return OPTIMAL, result.trajectory if result.solved else None, result.message


def fly_behind(  # noqa: PLR0917 - tasks of workers are tuples
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    reference: PiecewisePolynomial,
    passage: Passage,
    earlier: Trajectory | None = None,
    first_walls: bool = False,  # noqa: FBT001, FBT002 - likewise
) -> Outcome:
    """Fly one drone on its side of the walls.

    Parameters
    ----------
    passage
        The walls, laid about the way of the iterate before. Optimal control weighs
        them against effort and falls a little short of the clearance.
    earlier
        Its flight of the round before if that is by optimal control.
    first_walls
        Whether none of the walls follows on one that was not enough. Then a spline, a
        tenth of the work, comes first for a drone not flown by optimal control yet.

    Returns
    -------
    Outcome
        The flight keeps every limit; the walls it keeps as far as it can.
    """
    methods = (
        [SPLINE, OPTIMAL] if first_walls and earlier is None else [OPTIMAL, SPLINE]
    )
    if in_motion(start) or in_motion(goal):
        # Splines hover at their ends.
        methods = [OPTIMAL]
    for method in methods:
        if method == SPLINE:
            places = start[:3], goal[:3]
            pieces = passage.way.intervals if passage.way else 1
            found = follow_spline(aircraft, *places, reference, pieces, passage.walls)
            flight = None if found is None else found.flight.trajectory(0)
        else:
            flight = avoid(aircraft, start, goal, reference, passage, earlier)
        if flight is not None:
            return method, flight, ""
    return OPTIMAL, None, "no flight behind the walls was found"
