"""One drone in a given time, as near as can be to a reference.

A solve starts on a coarse mesh; its trajectory is flown again and audited, and only
where that shows a need another mesh or start follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.estimate import minimum_time_estimate
from showc.fleet.single_drone.assembly import trajectory_of
from showc.fleet.single_drone.guess import flat_guess, flown_guess
from showc.fleet.single_drone.intervals import (
    END_GRADING,
    finer,
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
from showc.fleet.single_drone.model import in_motion
from showc.fleet.single_drone.programs import Programs
from showc.fleet.single_drone.shortest import minimum_time
from showc.flight import Trajectory
from showc.ocp.refinement.strategy import refine
from showc.script.lanes import whole_milliseconds
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.fleet.single_drone.result import Result
    from showc.ocp.guess import Guess
    from showc.ocp.solution import Solution
    from showc.ocp.transcription.solver import SolverName


EFFORT = 1e-3
"""Weight of effort beside the squared distance to the reference."""
NEARNESS = 10.0
"""Weight of the squared distance to the reference over the squared length."""
TIGHT = 1.06
"""Time over the quick low estimate below which coarse meshes are not tried."""
HOPELESS = 0.998
"""Time over the least time found below which nothing more is tried."""
AMPLE = 1.35
"""Time over that estimate above which the coarsest mesh is tried first."""


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


def follow(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    duration: float,
    *,
    reference: PiecewisePolynomial | None = None,
    shortest: Trajectory | None = None,
) -> Result:
    """Fly from end to end in a given time, as near as can be to a reference.

    Parameters
    ----------
    start, goal
        Places to hover at, shape (3,) [m], or states and thrusts (13,).
    duration
        Time of the flight [s].
    reference
        Fraction of the way over time (one component), or positions (three) [m], from
        0 to ``duration``. ``None``: the least effort.
    shortest
        The flight in least time between the same hovers, if it is known.
    """
    start, goal = aircraft.end(start), aircraft.end(goal)
    programs = Programs(aircraft, start, goal)
    if reason := refusal(aircraft, start, goal):
        return Verdict("limit", reason).result(programs, duration)
    still = not (in_motion(start) or in_motion(goal))
    still = still and float(np.linalg.norm((goal - start)[:3])) < STILL
    if still and (reference is None or reference.components == 1):
        flight = _pause(aircraft, start[:3], goal[:3], duration)
        return Verdict("solved", trajectory=flight).result(programs)
    if shortest is not None:
        programs.meshes += shortest.meshes
    task = _Task(aircraft, start, goal, duration, reference, shortest)

    def judged(solution: Solution) -> Verdict:
        flight = trajectory_of(aircraft, solution, start, goal, duration)
        return judge(aircraft, flight)

    solutions = (_solve(task, programs, rung) for rung in _ladder(task))
    verdict = refine(Flights(programs, solutions, judged)) or Verdict("infeasible")
    if verdict.status == "infeasible":
        message = f"no flight in {duration:.3f} s was found: {verdict.message}"
        least = task.shortest_flight()[0]
        if duration < least:
            message = (
                f"no flight in {duration:.3f} s: the shortest found, other drones "
                f"aside, takes {whole_milliseconds(least):.3f} s"
            )
        verdict = Verdict("infeasible", message)
    return verdict.result(programs, duration)


def _pause(
    aircraft: Aircraft, start: FloatArray, goal: FloatArray, duration: float
) -> Trajectory:
    """Hover, from ``start`` exactly to ``goal`` exactly where rounding parts them."""
    flight = hover(aircraft, goal, duration)
    if np.array_equal(start, goal):
        return flight
    ends = aircraft.vehicle.hover_state(np.stack([start, goal]), aircraft.heading)
    return Trajectory(
        PiecewisePolynomial(flight.state.breaks, ends[None]), flight.control
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """One call of :func:`follow`."""

    aircraft: Aircraft
    start: FloatArray
    goal: FloatArray
    duration: float
    reference: PiecewisePolynomial | None
    shortest: Trajectory | None

    def shortest_flight(self) -> tuple[float, Trajectory | None]:
        """Return the least time [s] and its flight, solved for if it is not known."""
        if self.shortest is not None:
            return self.shortest.state.end, self.shortest
        least = _least(self.aircraft, tuple(self.start), tuple(self.goal))
        return least.duration, least.trajectory

    def guess(self, widths: FloatArray) -> Guess:
        """Where to start on these intervals."""
        return flat_guess(self.aircraft, self.start, self.goal, widths, self.reference)

    def stretched(self, flight: Trajectory) -> FloatArray:
        """Widths of the intervals of a flight, stretched to the duration."""
        widths = np.diff(flight.state.breaks)
        return np.asarray(widths * (self.duration / widths.sum()))


@dataclass(frozen=True, slots=True, eq=False)
class _Rung:
    """A mesh to try, and how."""

    widths: FloatArray
    """Of its intervals, shape (K,) [s]."""
    guess: Guess
    why: str
    """Why on this mesh."""
    solver: SolverName = "fatrop"


def _ladder(task: _Task) -> Iterator[_Rung]:
    """Meshes and starts to try, cheapest first.

    With time to spare a coarse mesh does. Near the least time the flight needs its
    interval borders where limits are reached and left: then the least-time flight of
    the same drone, stretched to the duration, gives both mesh and start.
    """
    duration = task.duration
    low, _ = minimum_time_estimate(task.aircraft, task.start[None], task.goal[None])
    slack = duration / max(float(low[0]), 1e-9)
    if task.shortest is None and slack > TIGHT:
        least = 12 if slack > AMPLE else 16
        count: int | None = interval_count(duration, least)
        for which in ("a coarse mesh", "the next finer"):
            widths = graded_widths(duration, count or 16)
            words = f"{which}: {slack:.3g} times the least time estimated is given"
            yield _Rung(widths, task.guess(widths), words)
            count = finer(count or 16)
    if task.shortest is None:
        count = interval_count(duration, 24)
        widths = graded_widths(duration, count, END_GRADING)
        words = "graded towards both ends: near the least time"
        yield _Rung(widths, task.guess(widths), words)
    time, shortest = task.shortest_flight()
    if duration < HOPELESS * time:
        return
    if shortest is not None and time <= duration:
        widths = task.stretched(shortest)
        near = flown_guess(task.aircraft, shortest, widths)
        words = "the mesh of the flight in least time, stretched"
        if task.shortest is not None:
            yield _Rung(widths, task.guess(widths), words)
        words += ", started from that flight"
        yield _Rung(widths, near, words)
        yield _Rung(widths, near, words, "ipopt")
    for count in (32, 56):
        widths = graded_widths(duration, interval_count(duration, count), END_GRADING)
        words = "nothing else did: even finer"
        yield _Rung(widths, task.guess(widths), words, "ipopt")


@lru_cache(maxsize=256)
def _least(
    aircraft: Aircraft, start: tuple[float, ...], goal: tuple[float, ...]
) -> Result:
    """Least-time flight, kept: a fleet asks again when its time is raised."""
    return minimum_time(aircraft, np.array(start), np.array(goal))


def _solve(task: _Task, programs: Programs, rung: _Rung) -> Solution:
    """Solve the program of a given time on one mesh."""
    widths = rung.widths
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    program = programs.program(widths.size, "given", rung.solver)
    nodes = np.array(program.stage.cost_nodes)
    times = breaks[:-1, None] + widths[:, None] * nodes
    signals, nearness = np.zeros((*times.shape, 3)), 0.0
    if task.reference is not None:
        start, way = task.start[:3], (task.goal - task.start)[:3]
        length = max(float(np.linalg.norm(way)), 1.0)
        nearness = NEARNESS / length**2
        signals = task.reference(times)
        if task.reference.components == 1:
            signals = start + signals * way
    return programs.solve(
        program,
        widths,
        rung.guess,
        {"effort": EFFORT, "nearness": nearness},
        why=rung.why,
        signals=signals,
    )
