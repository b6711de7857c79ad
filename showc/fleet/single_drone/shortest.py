"""One drone in the least time: the mesh is part of what is sought.

Borders of the mesh intervals come to lie where limits are reached or left (the switch
times of Agamawi, Hager and Rao 2019, without having to know the arcs beforehand):
either their widths are unknowns of the program, or meshes are graded one after the
other by what the last one loses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.estimate import minimum_time_estimate
from showc.fleet.single_drone.assembly import trajectory_of
from showc.fleet.single_drone.grading import Kept, solve_on_graded_meshes
from showc.fleet.single_drone.guess import flat_guess, flown_guess
from showc.fleet.single_drone.intervals import (
    END_GRADING,
    graded_widths,
    interval_count,
)
from showc.fleet.single_drone.judgement import (
    STILL,
    Flights,
    Verdict,
    judge,
    refusal,
)
from showc.fleet.single_drone.model import ROOM, USUAL_SCALES, in_motion
from showc.fleet.single_drone.programs import Programs
from showc.ocp.refinement.strategy import refine

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.fleet.single_drone.result import Result
    from showc.flight import Trajectory
    from showc.ocp.guess import Guess
    from showc.ocp.solution import Solution


EFFORT = 1e-4
"""Weight of effort beside the time [s]."""
INTERVALS = 24
"""Intervals whose borders move."""
CLOSE = 1e-3
"""Error of the time that these are good for."""
SPARE = 1.1
"""Time to start from, over the estimate."""
ON_THE_SPOT, CLOSE_ON_THE_SPOT = 0.1, 0.05
"""Least time to start from [s], and how closely it is then found. An aircraft that only
leans comes back to where it is: on a finer mesh 400 iterations were not enough."""
SETTLED = 2.0
"""Change by a pass over the tolerance below which borders have settled: another pass
gains a tenth of that."""
ROOMS = (ROOM, 0.01)
"""Shares of the limits of acceleration left unused where borders move, one after the
other; graded meshes fly beyond these between their points, by more."""
GRADED = (
    Kept(points=3, room=0.01, margin=1e-6),
    Kept(points=4, room=0.02, margin=1e-3),
    Kept(points=5, room=0.04, margin=4e-3),
)
"""Graded meshes, one try after the other; a solver's tolerance is the least margin, and
rotors were seen to turn beyond their limits by up to 1e-3 of them between points."""
PASSES = 4
"""Greatest number of passes in which interval borders move."""


def minimum_time(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    *,
    tolerance: float = 1e-3,
    like: Trajectory | None = None,
    enough: float = 0.0,
) -> Result:
    """Fly from end to end in the least time.

    Parameters
    ----------
    start, goal
        Places to hover at, shape (3,) [m], or states and thrusts (13,).
    tolerance
        Relative error of the time that is good enough; decides how fine the mesh
        becomes.
    like
        A flight in the least time with a nearly equal displacement, to start from.
    enough
        A time [s] that is as good as the least: the search ends with a flight that
        takes no longer.

    Returns
    -------
    Result
        Its duration is the least time, not rounded, or at most ``enough``. A move of no
        length takes no time and has no trajectory.
    """
    start, goal = aircraft.end(start), aircraft.end(goal)
    # From the origin: drones that make the same move make it in the same way.
    here, there = start.copy(), goal.copy()
    here[:3], there[:3] = 0.0, goal[:3] - start[:3]
    programs = Programs(_moved(aircraft, -start[:3]), here, there)
    if reason := refusal(aircraft, start, goal):
        return Verdict("limit", reason).result(programs)
    still = not (in_motion(start) or in_motion(goal))
    if still and np.linalg.norm(there[:3]) < STILL:
        return Verdict("solved").result(programs)

    def judged(solution: Solution) -> Verdict:
        flight = trajectory_of(
            aircraft, solution, start, goal, solution.duration, origin=start[:3]
        )
        return judge(aircraft, flight)

    goals = _Goals(tolerance, enough)
    attempts = _attempts(programs, here, there, goals, like)
    verdict = refine(Flights(programs, attempts, judged)) or Verdict("infeasible")
    return verdict.result(programs)


def _moved(aircraft: Aircraft, by: FloatArray) -> Aircraft:
    """Return the aircraft with its flight volume moved [m]."""
    limits = aircraft.limits
    low, high = np.array(limits.position_min) + by, np.array(limits.position_max) + by
    lower = (float(low[0]), float(low[1]), float(low[2]))
    upper = (float(high[0]), float(high[1]), float(high[2]))
    return replace(
        aircraft, limits=replace(limits, position_min=lower, position_max=upper)
    )


@dataclass(frozen=True, slots=True)
class _Goals:
    """When a flight is good enough."""

    tolerance: float
    """Relative error of the least time."""
    enough: float
    """Time that is as good as the least [s]."""


def _attempts(
    programs: Programs,
    here: FloatArray,
    way: FloatArray,
    goals: _Goals,
    like: Trajectory | None,
) -> Iterator[Solution]:
    """Flights in the least time, the quickest way of finding one first.

    With yaw held, borders that move mostly come to a good end, and the program serves
    every move; with yaw free they mostly do not. Graded meshes do either way, and as
    closely as wanted; more points make the flight more accurate.
    """
    aircraft, tolerance = programs.aircraft, goals.tolerance
    estimate = float(minimum_time_estimate(aircraft, here[None], way[None])[1][0])
    if estimate < ON_THE_SPOT:
        estimate, tolerance = ON_THE_SPOT, max(tolerance, CLOSE_ON_THE_SPOT)
    limited = aircraft.limits.limits_acceleration
    length = float(np.linalg.norm(way[:3] - here[:3]))
    # However quick a move, its effort weighs little beside its time.
    quick = USUAL_SCALES.raised(length, estimate).angular_acceleration
    effort = EFFORT * (USUAL_SCALES.angular_acceleration / quick) ** 2
    if aircraft.yaw == "held" and tolerance >= CLOSE:
        count = interval_count(estimate, INTERVALS)
        widths = graded_widths(SPARE * estimate, count, END_GRADING)
        starts = [(widths, flat_guess(aircraft, here, way, widths))]
        if like is not None and like.state.intervals == count:
            widths = np.diff(like.state.breaks)
            starts.insert(0, (widths, flown_guess(aircraft, like, widths)))
        for room in ROOMS if limited else ROOMS[:1]:
            programs.leave(room)
            for widths, guess in starts:
                solution = _moving(programs, widths, guess, effort, goals)
                if solution is not None:
                    yield solution
    for kept in GRADED:
        yield solve_on_graded_meshes(
            programs,
            here,
            way,
            SPARE * estimate,
            tolerance=tolerance,
            effort=effort,
            kept=kept,
        )


def _moving(
    programs: Programs,
    widths: FloatArray,
    guess: Guess | Solution,
    effort: float,
    goals: _Goals,
) -> Solution | None:
    """Least time on a number of intervals whose borders move; ``None`` if it fails.

    The borders move in several passes, each within a range about where it starts,
    until that gains little: one pass with a wide range often ends nowhere.
    """
    program = programs.program(widths.size, "movable")
    best: Solution | None = None
    why = "graded towards both ends; borders move to where limits begin to bind"
    for _ in range(PASSES):
        moved = programs.solve(program, widths, guess, {"effort": effort}, why=why)
        why = "from where the borders came to lie, they move on"
        if not moved.result.usable:
            break
        gain = 1.0 - moved.duration / float(widths.sum())
        if moved.duration <= goals.enough:
            return moved
        if best is not None and abs(gain) < SETTLED * goals.tolerance:
            return min(best, moved, key=lambda flight: flight.duration)
        best, widths, guess = moved, moved.phases[0].widths, moved
    return None
