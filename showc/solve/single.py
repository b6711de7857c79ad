"""One drone on one leg: in minimum time, or in a given time near a reference.

Each program is built once a process and solved many times. A solve starts on a coarse
mesh; its trajectory is flown again and audited, and only where that shows a need a
finer mesh follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.flight import Trajectory
from showc.solve.assembly import trajectory_of
from showc.solve.audit import Excess, greatest_excess, half_space_excess
from showc.solve.estimate import minimum_time_estimate
from showc.solve.guess import flat_guess, flown_guess
from showc.solve.intervals import finer, graded_widths, interval_count
from showc.solve.model import HALF_SPACES, POSITION, SIGNALS, Aircraft, single_problem
from showc.solve.replay import replay
from showc.solve.result import HalfSpace, Result, Status
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from showc.ocp.stages import TimeKind
    from showc.ocp.staged import (
        StagedGuess,
        StagedSolution,
        StagedSolver,
        StagedTranscription,
    )

    FloatArray = NDArray[np.float64]

__all__ = [
    "Aircraft",
    "HalfSpace",
    "Result",
    "follow",
    "hover",
    "minimum_time",
    "minimum_time_estimate",
]

POSITION_ACCURACY = 1e-3
"""Default of the greatest replay error [m]."""
ATTITUDE_ACCURACY = np.deg2rad(0.01)
"""Greatest replay error of roll, pitch and yaw [rad]."""
KEPT = 1e-9
"""Excess over a limit, relative to its range, that counts as rounding."""
STILL = 1e-9
"""Moves shorter than this are hovers [m]."""

EFFORT_TIMED = 1e-4
"""Weight of effort beside the time when time is least [s]."""
EFFORT = 1e-3
"""Weight of effort beside the squared distance to a reference."""
NEARNESS = 10.0
"""Weight of the squared distance to the reference over the squared length."""
HALF_SPACE_SLOTS = (0, 2, 4, 8, 16)
"""Numbers of half-spaces for an interval that programs are built with."""
MINIMUM_TIME_INTERVALS = 24
TIGHT = 1.1
"""Time over the quick low estimate below which coarse meshes are not tried."""
AMPLE = 1.4
"""Time over that estimate above which the coarsest mesh is tried first."""


@lru_cache(maxsize=48)
def _program(
    aircraft: Aircraft,
    intervals: int,
    time: TimeKind,
    half_spaces: int,
    solver: StagedSolver,
) -> StagedTranscription:
    from showc.ocp.staged import StagedOptions, StagedTranscription  # noqa: PLC0415

    timed = time != "given"
    return StagedTranscription(
        single_problem(aircraft, minimum_time=timed, half_spaces=half_spaces),
        intervals,
        time=time,
        signals=() if timed else SIGNALS,
        options=StagedOptions(solver=solver),
    )


def hover(aircraft: Aircraft, position: FloatArray, duration: float) -> Trajectory:
    """Stay at ``position`` (3,) [m] for ``duration`` [s]: exact, nothing is solved."""
    state = aircraft.vehicle.hover_state(
        np.asarray(position, dtype=np.float64), aircraft.heading
    )
    control = aircraft.vehicle.hover_control()
    return Trajectory(
        PiecewisePolynomial.constant(state, 0.0, duration),
        PiecewisePolynomial.constant(control, 0.0, duration),
    )


def _refusal(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    half_spaces: Sequence[HalfSpace] = (),
    duration: float = np.inf,
) -> str:
    """Say why the task contradicts its limits before any search; empty if not."""
    if problem := aircraft.conflict():
        return problem
    lower = np.array(aircraft.limits.position_min)
    upper = np.array(aircraft.limits.position_max)
    for name, place in (("start", start), ("goal", goal)):
        if not np.all(np.isfinite(place)):
            return f"the {name} {place.tolist()} is no position"
        outside = np.maximum(lower - place, place - upper)
        axis = int(np.argmax(outside))
        if outside[axis] > STILL:
            return (
                f"the {name} has {POSITION[axis]} = {place[axis]:.3f} m; the flight "
                f"volume allows {lower[axis]:.3f} to {upper[axis]:.3f} m"
            )
    for space in half_spaces:
        ends = ([("start", start)] if space.start <= 0.0 else []) + (
            [("goal", goal)] if space.end >= duration else []
        )
        for name, place in ends:
            short = space.offset - float(np.dot(space.normal, place))
            if short > 1e-6:
                return f"the {name} lies {short:.6f} m outside a half-space"
    return ""


def _ends(start: FloatArray, goal: FloatArray) -> dict[str, float]:
    named = {f"start_{axis}": float(start[k]) for k, axis in enumerate(POSITION)}
    return named | {f"goal_{axis}": float(goal[k]) for k, axis in enumerate(POSITION)}


class _Count:
    """Counts what was done, for the result."""

    def __init__(self) -> None:
        self.iterations = 0
        self.solves = 0

    def add(self, solution: StagedSolution) -> StagedSolution:
        self.iterations += solution.iterations
        self.solves += 1
        return solution


def _result(
    count: _Count,
    status: Status,
    duration: float,
    message: str = "",
    trajectory: Trajectory | None = None,
    errors: tuple[float, float] = (0.0, 0.0),
) -> Result:
    return Result(
        status,
        duration,
        trajectory,
        message,
        errors[0],
        errors[1],
        count.iterations,
        count.solves,
        0 if trajectory is None else trajectory.state.intervals,
    )


def _judge(
    aircraft: Aircraft,
    trajectory: Trajectory,
    half_spaces: Sequence[HalfSpace],
    accuracy: float,
) -> tuple[Status, str, tuple[float, float]]:
    """Fly a trajectory again and audit its limits."""
    flown = replay(aircraft.vehicle, [trajectory])
    errors = float(flown.position[0]), float(flown.attitude[0])
    worst: Excess = greatest_excess(aircraft, trajectory)
    if worst.relative > KEPT:
        return (
            "infeasible",
            f"{worst.name} is {worst.amount:.3g} outside its limit near "
            f"{worst.time:.2f} s",
            errors,
        )
    crossed = half_space_excess(trajectory, half_spaces)
    if crossed is not None and crossed.amount > KEPT:
        return (
            "infeasible",
            f"{crossed.name} is crossed by {crossed.amount:.3g} m near "
            f"{crossed.time:.2f} s",
            errors,
        )
    if errors[0] > accuracy or errors[1] > ATTITUDE_ACCURACY:
        return (
            "inaccurate",
            f"the controls miss the trajectory by {1e3 * errors[0]:.3g} mm and "
            f"{np.rad2deg(errors[1]):.3g} deg; wanted {1e3 * accuracy:.3g} mm",
            errors,
        )
    return "solved", "", errors


def minimum_time(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    *,
    tolerance: float = 1e-3,
) -> Result:
    """Fly from hover to hover in the least time.

    The mesh is found by the solver: the widths of the intervals are unknowns, so
    that their borders come to lie where a limit is reached or left.

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
    count = _Count()
    start, goal = np.array(start, dtype=np.float64), np.array(goal, dtype=np.float64)
    if refusal := _refusal(aircraft, start, goal):
        return _result(count, "limit", 0.0, refusal)
    if np.linalg.norm(goal - start) < STILL:
        return _result(count, "solved", 0.0)
    intervals: int | None = MINIMUM_TIME_INTERVALS
    best: Result | None = None
    message = ""
    while intervals is not None:
        found, message = _shortest(aircraft, start, goal, intervals, count)
        if found is not None:
            if best is not None and found.duration > best.duration * (1.0 - tolerance):
                return best if best.duration <= found.duration else found
            best = found
            if intervals >= 80:
                return found
        intervals = finer(intervals)
    return best or _result(count, "infeasible", 0.0, message)


def _shortest(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    intervals: int,
    count: _Count,
) -> tuple[Result | None, str]:
    """Least time on so many intervals, first in fixed proportions, then movable."""
    guessed = float(minimum_time_estimate(aircraft, start[None], goal[None])[1][0])
    widths = graded_widths(1.1 * guessed, intervals)
    parameters = _ends(start, goal) | {"effort": EFFORT_TIMED}
    guess = flat_guess(aircraft, start, goal, widths)
    kinds: tuple[tuple[TimeKind, StagedSolver], ...] = (
        ("free", "fatrop"),
        ("free", "ipopt"),
    )
    solution: StagedSolution | None = None
    message = ""
    for time, solver in kinds:
        program = _program(aircraft, intervals, time, 0, solver)
        found = count.add(
            program.solve(widths=widths, guess=guess, parameters=parameters)
        )
        if found.result.usable:
            solution = found
            break
        message = found.message
    if solution is None:
        return None, message
    for solver in ("fatrop", "ipopt"):
        program = _program(aircraft, intervals, "movable", 0, solver)
        found = count.add(
            program.solve(
                widths=solution.widths, guess=solution.guess, parameters=parameters
            )
        )
        if found.result.usable and found.duration <= solution.duration:
            solution = found
            break
    trajectory = trajectory_of(aircraft, solution, start, goal, solution.duration)
    status, message, errors = _judge(aircraft, trajectory, (), POSITION_ACCURACY)
    if status != "solved":
        return None, message
    return (
        _result(count, status, solution.duration, "", trajectory, errors),
        "",
    )


def follow(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    duration: float,
    *,
    reference: PiecewisePolynomial | None = None,
    half_spaces: Sequence[HalfSpace] = (),
    accuracy: float = POSITION_ACCURACY,
    start_from: Trajectory | None = None,
) -> Result:
    """Fly from hover to hover in a given time, as near as can be to a reference.

    Parameters
    ----------
    start, goal
        Positions, shape (3,) [m].
    duration
        Time of the flight [s].
    reference
        Fraction of the way over time (one component), or positions (three) [m], from
        0 to ``duration``. ``None``: the least effort.
    half_spaces
        Kept at every instant of their stretch of time, widened outward to whole mesh
        intervals.
    accuracy
        Greatest distance between the controls integrated and the trajectory [m].
    start_from
        An earlier flight between the same hovers to start from.
    """
    count = _Count()
    start, goal = np.array(start, dtype=np.float64), np.array(goal, dtype=np.float64)
    if refusal := _refusal(aircraft, start, goal, half_spaces, duration):
        return _result(count, "limit", duration, refusal)
    still = float(np.linalg.norm(goal - start)) < STILL
    if still and not half_spaces and (reference is None or reference.components == 1):
        return _result(count, "solved", duration, "", hover(aircraft, goal, duration))
    task = _Task(aircraft, start, goal, duration, reference, tuple(half_spaces))
    worst: tuple[Status, str] = ("infeasible", "")
    for widths, solver, guess in _ladder(task, start_from):
        solution = count.add(_solve_given(task, widths, solver, guess))
        if not solution.result.usable:
            worst = "infeasible", solution.message
            continue
        trajectory = trajectory_of(aircraft, solution, start, goal, duration)
        status, message, errors = _judge(aircraft, trajectory, half_spaces, accuracy)
        if status == "solved":
            return _result(count, status, duration, "", trajectory, errors)
        worst = status, message
    status, message = worst
    if status == "infeasible":
        message = f"no flight in {duration:.3f} s was found: {message}"
    return _result(count, status, duration, message)


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """One call of :func:`follow`."""

    aircraft: Aircraft
    start: FloatArray
    goal: FloatArray
    duration: float
    reference: PiecewisePolynomial | None
    half_spaces: tuple[HalfSpace, ...]


def _ladder(
    task: _Task, start_from: Trajectory | None
) -> Iterator[tuple[FloatArray, StagedSolver, StagedGuess]]:
    """Meshes and starts to try, cheapest first.

    With time to spare a coarse mesh does. Near the least time the flight needs its
    interval borders where limits are reached and left: then the least-time flight of
    the same drone, stretched to the duration, gives both mesh and start.
    """
    aircraft, duration = task.aircraft, task.duration

    def guess(widths: FloatArray) -> StagedGuess:
        if start_from is not None:
            return flown_guess(aircraft, start_from, widths)
        return flat_guess(aircraft, task.start, task.goal, widths, task.reference)

    low, _ = minimum_time_estimate(aircraft, task.start[None], task.goal[None])
    slack = duration / max(float(low[0]), 1e-9)
    if slack > TIGHT:
        least = 12 if slack > AMPLE else 16
        count: int | None = interval_count(duration, least)
        for _ in range(2):
            widths = graded_widths(duration, count or 16)
            yield widths, "fatrop", guess(widths)
            count = finer(count or 16)
    widths = graded_widths(duration, interval_count(duration, 24), 0.85)
    yield widths, "fatrop", guess(widths)
    shortest = minimum_time(aircraft, task.start, task.goal)
    if shortest.trajectory is not None and shortest.duration <= duration:
        widths = np.diff(shortest.trajectory.state.breaks)
        widths *= duration / widths.sum()
        near = flown_guess(aircraft, shortest.trajectory, widths)
        yield widths, "fatrop", near
        yield widths, "ipopt", near
    for count in (32, 56):
        widths = graded_widths(duration, interval_count(duration, count), 0.85)
        yield widths, "ipopt", guess(widths)


def _solve_given(
    task: _Task, widths: FloatArray, solver: StagedSolver, guess: StagedGuess
) -> StagedSolution:
    """Solve the program of a given time on one mesh."""
    aircraft = task.aircraft
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    normals, offsets = _slots(task.half_spaces, breaks)
    slots = normals.shape[1]
    program = _program(aircraft, widths.size, "given", slots, solver)
    length = max(float(np.linalg.norm(task.goal - task.start)), 1.0)
    parameters = _ends(task.start, task.goal) | {
        "effort": EFFORT,
        "nearness": 0.0 if task.reference is None else NEARNESS / length**2,
    }
    nodes = np.array(program.stage.cost_nodes)
    times = breaks[:-1, None] + widths[:, None] * nodes
    if task.reference is None:
        signals = np.zeros((*times.shape, 3))
    else:
        values = task.reference(times)
        if task.reference.components == 1:
            values = task.start + values * (task.goal - task.start)
        signals = values
    return program.solve(
        widths=widths,
        guess=guess,
        parameters=parameters,
        signals=signals,
        half_spaces={HALF_SPACES: (normals, offsets)} if slots else None,
    )


def _slots(
    half_spaces: Sequence[HalfSpace], breaks: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lay half-spaces into the slots of the intervals that they touch.

    Returns normals (K, slots, 3) and offsets (K, slots), minus infinity where unused;
    the number of slots is one that programs are built with.
    """
    intervals = breaks.size - 1
    placed: list[list[HalfSpace]] = [[] for _ in range(intervals)]
    for space in half_spaces:
        touched = (breaks[1:] > space.start) & (breaks[:-1] < space.end)
        for k in np.nonzero(touched)[0]:
            placed[int(k)].append(space)
    most = max((len(entry) for entry in placed), default=0)
    slots = next((n for n in HALF_SPACE_SLOTS if n >= most), most)
    normals = np.zeros((intervals, slots, 3))
    offsets = np.full((intervals, slots), -np.inf)
    for k, entry in enumerate(placed):
        for j, space in enumerate(entry):
            normals[k, j], offsets[k, j] = space.normal, space.offset
    return normals, offsets
