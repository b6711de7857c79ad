"""One drone in the least time: the mesh is part of what is sought.

The widths of the mesh intervals are unknowns of the program, so that their borders come
to lie where a limit is reached or left (the switch times of Agamawi, Hager and Rao
2019, without having to know the arcs beforehand).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.solve.assembly import trajectory_of
from showc.solve.estimate import minimum_time_estimate
from showc.solve.guess import flat_guess
from showc.solve.intervals import END_GRADING, finer, graded_widths, interval_count
from showc.solve.judgement import STILL, Verdict, judge, refusal
from showc.solve.programs import Programs

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.flight import Trajectory
    from showc.ocp.staged import StagedGuess, StagedSolution, StagedSolver
    from showc.ocp.stages import TimeKind
    from showc.solve.model import Aircraft
    from showc.solve.result import Result

    FloatArray = NDArray[np.float64]

EFFORT = 1e-4
"""Weight of effort beside the time [s]."""
INTERVALS = 24
FINE_INTERVALS = 40
"""The same where the time is wanted closer than to 0.1 %."""
TRUSTED = 1.1
"""A flight that keeps all limits but is not proved shortest is built upon if it takes
no longer than this times the guess it started from."""
PROMISING = 0.95
"""The same where borders move from the first, over the time of the mesh it started
from."""
BOTH: tuple[StagedSolver, ...] = ("fatrop", "ipopt")
PASSES = 4
"""Greatest number of passes in which interval borders move."""


def minimum_time(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    *,
    tolerance: float = 1e-3,
) -> Result:
    """Fly from hover to hover in the least time.

    Parameters
    ----------
    start, goal
        Positions, shape (3,) [m].
    tolerance
        Relative error of the time that is good enough; decides how fine the mesh
        becomes.

    Returns
    -------
    Result
        Its duration is the least time, not rounded. A move of no length takes no
        time and has no trajectory.
    """
    # The core loads casadi, which checking a script must not.
    from showc.ocp.solution import Result as Ending  # noqa: PLC0415

    start, goal = np.array(start, dtype=np.float64), np.array(goal, dtype=np.float64)
    programs = Programs(aircraft, start, goal)
    if reason := refusal(aircraft, start, goal):
        return Verdict("limit", reason).result(programs, 0.0)
    if np.linalg.norm(goal - start) < STILL:
        return Verdict("solved").result(programs, 0.0)
    guessed = float(minimum_time_estimate(aircraft, start[None], goal[None])[1][0])
    least = INTERVALS if tolerance >= 1e-3 else FINE_INTERVALS
    intervals: int | None = interval_count(guessed, least)
    verdict = Verdict("infeasible")
    best: tuple[float, Trajectory, Verdict] | None = None
    for _ in range(3):
        if intervals is None:
            break
        widths = graded_widths(1.1 * guessed, intervals, END_GRADING)
        guess = flat_guess(aircraft, start, goal, widths)
        solution = _shortest(programs, widths, guess, tolerance)
        intervals = finer(intervals)
        if not solution.result.usable:
            verdict = Verdict("infeasible", solution.message)
            continue
        duration = solution.duration
        trajectory = trajectory_of(aircraft, solution, start, goal, duration)
        verdict = judge(aircraft, trajectory)
        if verdict.status == "solved" and (best is None or duration < best[0]):
            best = duration, trajectory, verdict
        if best is not None and solution.result is Ending.SOLVED:
            break
    if best is not None:
        return best[2].result(programs, best[0], best[1])
    return verdict.result(programs, 0.0)


def _shortest(
    programs: Programs, widths: FloatArray, guess: StagedGuess, tolerance: float
) -> StagedSolution:
    """Least time on so many intervals, their borders movable from the start.

    The borders move in several passes, each within a range about where it starts,
    until that gains little: one pass with a wide range often ends nowhere. Where the
    first pass fails, as it mostly does with yaw free, intervals in fixed proportions
    come first: a program of its own, so it is only built if needed.
    """
    moving = False
    if programs.aircraft.yaw == "held":
        solution = _solved(programs, "movable", widths, guess, ("fatrop",))
        moving = solution.result.usable and _near(solution, widths, PROMISING)
    if not moving:
        solution = _solved(programs, "free", widths, guess, BOTH)
    if not solution.result.usable:
        return solution
    # Once borders have moved, a pass that fails has little left to gain.
    solvers: tuple[StagedSolver, ...] = ("fatrop",) if moving else BOTH
    for _ in range(PASSES):
        moved = _solved(programs, "movable", solution.widths, solution.guess, solvers)
        gain = 1.0 - moved.duration / solution.duration
        if not moved.result.usable or gain <= 0.0:
            break
        solution = moved
        if gain < 0.3 * tolerance:
            break
    return solution


def _solved(
    programs: Programs,
    time: TimeKind,
    widths: FloatArray,
    guess: StagedGuess,
    solvers: tuple[StagedSolver, ...],
) -> StagedSolution:
    """Solve with one solver after the other until one converges."""
    from showc.ocp.solution import Result as Ending  # noqa: PLC0415 - as above

    for solver in solvers:
        program = programs.program(widths.size, time, solver=solver)
        solution = programs.solve(program, widths, guess, {"effort": EFFORT})
        trusted = TRUSTED if time == "free" else 1.0
        near = _near(solution, widths, trusted)
        if solution.result is Ending.SOLVED or (solution.result.usable and near):
            break
    return solution


def _near(solution: StagedSolution, widths: FloatArray, trusted: float) -> bool:
    return solution.duration < trusted * float(widths.sum())
