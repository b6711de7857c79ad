"""showc itself, in six ways.

``core``: the general optimal control core through its public API, with its defaults.
``graded``: the core's grading with its defaults, controls linear on intervals.
``mesh``: the core on a fixed mesh. ``drone``: the least time of one drone. ``fleet``:
a leg of several drones as ``compile`` solves it, in one process, without the cache.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import TYPE_CHECKING

import casadi
import numpy as np
from benchmarks.audit import Answer, Piece
from benchmarks.quadrotor import SEPARATION

import showc
from showc import ocp
from showc.fleet import SolveOptions, solve_leg
from showc.fleet.execution.pool import InProcess
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.shortest import minimum_time
from showc.plan.itinerary import Leg
from showc.progress import Silent
from showc.vehicle import PRESETS, Separation

if TYPE_CHECKING:
    from benchmarks.problem import Problem

    from showc.trajectory import PiecewisePolynomial

# Names of the core are loaded as they are used: here and now, for imports are no part
# of what is measured.
for _name in ocp.__all__:
    getattr(ocp, _name)


def version() -> str:
    """Version of showc."""
    return showc.__version__


def build(problem: Problem, degree: int | None = None) -> ocp.Problem:
    """State the problem through the API; ``degree`` of the controls, if not free."""
    low, high = problem.duration
    stated = ocp.Problem(problem.name)
    phase = stated.phase(duration=low if low == high else (low, high))
    states = [
        phase.state(s.name, s.lower, s.upper, start=s.start, end=s.end)
        for s in problem.states
    ]
    controls = [
        phase.control(c.name, c.lower, c.upper, degree=degree) for c in problem.controls
    ]
    rates = problem.rates(states, controls, casadi)
    for state, rate in zip(states, rates, strict=True):
        phase.derivative(state, rate)
    values = problem.path_values(states, controls, casadi)
    for path, value in zip(problem.paths, values, strict=True):
        phase.constrain(value, path.lower, None, name=path.name)
    if problem.integrand is not None:
        cost = phase.integral(problem.cost_rate(states, controls, casadi))
    elif problem.objective == "t":
        cost = phase.duration
    else:
        names = [state.name for state in problem.states]
        cost = phase.final(states[names.index(problem.objective)])
    (stated.maximise if problem.maximise else stated.minimise)(cost)
    return stated


def solve(problem: Problem, settings: dict) -> Answer:
    """Solve in the way ``settings["way"]`` names, ``core`` by default."""
    way = settings.get("way", "core")
    if way == "drone":
        return _one_drone(problem)
    if way == "mesh":
        return _fixed_mesh(problem)
    if way == "graded":
        chosen = ocp.Options.graded(**settings.get("options", {}))
        return answer(ocp.solve(build(problem), options=chosen))
    if way == "fleet":
        return _fleet(problem, settings)
    return answer(ocp.solve(build(problem)))


def _fixed_mesh(problem: Problem) -> Answer:
    """Solve once, controls linear on intervals that are short near both ends."""
    parts = ((0.0, 0.3, 25), (0.3, 0.7, 6), (0.7, 1.0, 25))
    breaks = np.unique(np.concatenate([np.linspace(*part) for part in parts]))
    points = [3] * (breaks.size - 1)
    built = ocp.Transcription(
        build(problem, degree=1),
        ocp.Mesh((ocp.PhaseMesh.from_breaks(breaks, points),)),
        scales={"phase.duration": problem.duration_guess},
        options=ocp.SolverOptions(
            tolerance=1e-6,
            extra={"mu_strategy": "monotone", "mu_linear_decrease_factor": 0.1},
        ),
    )
    guess = ocp.Guess(
        curves={c.name: c.guess for c in problem.controls if c.guess},
        durations={"phase": problem.duration_guess},
    )
    return replace(answer(built.solve(guess=guess)), solves=1)


def aircraft() -> Aircraft:
    """Return the aircraft of the benchmarks: torques as widely printed, yaw free."""
    preset = PRESETS["formation-625g"]
    vehicle = replace(preset.vehicle, torque_arm="multiplied")
    limits = replace(
        preset.limits,
        position_min=(-200.0, -200.0, -200.0),
        position_max=(200.0, 200.0, 200.0),
    )
    return Aircraft(vehicle, limits, "free")


def _places(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    columns = problem.place_columns()
    start = [[problem.states[i].start for i in triple] for triple in columns]
    goal = [[problem.states[i].end for i in triple] for triple in columns]
    return np.array(start), np.array(goal)


def _one_drone(problem: Problem) -> Answer:
    (start,), (goal,) = _places(problem)
    result = minimum_time(aircraft(), start, goal)
    if result.trajectory is None:
        raise RuntimeError(result.message)
    return Answer(
        objective=result.duration,
        pieces=_pieces(result.trajectory.state, result.trajectory.control),
        solves=result.solves,
        points=result.intervals,
        message=result.status,
        solved=result.solved,
    )


def _fleet(problem: Problem, settings: dict) -> Answer:
    start, goal = _places(problem)
    count = len(start)
    craft = aircraft()
    leg = Leg(
        index=0,
        name=problem.name,
        kind="transition",
        drones=np.arange(count),
        start=start,
        goal=goal,
        from_formation="start",
        to_formation="goal",
        places=np.arange(count),
        limits=craft.limits,
        duration=None,
        after=(),
        mark=None,
    )
    show = SimpleNamespace(
        vehicle=craft.vehicle,
        separation=Separation(SEPARATION),
        yaw=craft.yaw,
        heading=0.0,
        drones=count,
    )
    options = SolveOptions(jobs=1, use_cache=False, gap=settings["gap"])
    flight = solve_leg(leg, show, options, InProcess(), Silent())
    borders = np.unique(
        np.concatenate([each.state.breaks for each in flight.trajectories])
    )
    borders = borders[np.concatenate([[True], np.diff(borders) > 1e-9])]
    borders[-1] = flight.duration
    # Drones may have polynomials of different degree: give all the same nodes.
    states = [each.state for each in flight.trajectories]
    controls = [each.control for each in flight.trajectories]
    states = [s.elevated(max(each.degree for each in states)) for s in states]
    controls = [c.elevated(max(each.degree for each in controls)) for c in controls]
    pieces = []
    for first, last in pairwise(borders):
        parts = [
            _piece(state, control, first, last)
            for state, control in zip(states, controls, strict=True)
        ]
        pieces.append(
            Piece(
                first,
                last,
                parts[0].state_times,
                np.concatenate([part.states for part in parts], axis=1),
                parts[0].control_times,
                np.concatenate([part.controls for part in parts], axis=1),
            )
        )
    statistics = flight.certificate.statistics
    return Answer(
        objective=flight.duration,
        pieces=pieces,
        solves=int(statistics.get("solves", 0)),
        points=len(borders) - 1,
        message=flight.certificate.method,
        solved=True,
    )


def answer(solution: ocp.Solution) -> Answer:
    """Turn a solution into what the audit reads."""
    pieces = []
    for phase in solution.phases:
        pieces += _pieces(phase.states, phase.controls)
    return Answer(
        objective=float(solution.objective),
        pieces=pieces,
        solves=len(solution.history),
        points=solution.mesh.point_count,
        message=solution.message or solution.result.value,
        solved=solution.result is ocp.Result.SOLVED,
    )


def _pieces(states: PiecewisePolynomial, controls: PiecewisePolynomial) -> list[Piece]:
    borders = np.union1d(states.breaks, controls.breaks)
    return [_piece(states, controls, start, end) for start, end in pairwise(borders)]


def _piece(
    states: PiecewisePolynomial,
    controls: PiecewisePolynomial,
    start: float,
    end: float,
) -> Piece:
    state_times = start + (end - start) * _nodes(states.degree)
    control_times = start + (end - start) * _nodes(controls.degree)
    return Piece(
        start,
        end,
        state_times,
        states(state_times),
        control_times,
        controls(control_times),
    )


def _nodes(degree: int) -> np.ndarray:
    # Inside the interval, so that no value is taken from a neighbour.
    return (np.polynomial.legendre.leggauss(degree + 1)[0] + 1.0) / 2.0
