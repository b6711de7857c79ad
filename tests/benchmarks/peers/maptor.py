"""MAPTOR: Radau collocation in CasADi, IPOPT, refinement by explicit simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi
import maptor
import numpy as np
from benchmarks.audit import Answer, Piece
from maptor.radau import _compute_radau_collocation_components

if TYPE_CHECKING:
    from benchmarks.problem import Problem

QUIET = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": 0,
    "ipopt.max_iter": 3000,
}


def version() -> str:
    """Version of the peer."""
    return maptor.__version__


def solve(problem: Problem, settings: dict) -> Answer:
    """Solve from ``settings["mesh"]``; refined to the tolerance, if one is given."""
    ocp = maptor.Problem(problem.name)
    phase = ocp.set_phase(1)
    low, high = problem.duration
    time = phase.time(initial=0.0, final=low if low == high else (low, high))
    states = [
        phase.state(s.name, initial=s.start, final=s.end, boundary=_pair(s))
        for s in problem.states
    ]
    controls = [phase.control(c.name, boundary=_pair(c)) for c in problem.controls]
    rates = problem.rates(states, controls, casadi)
    phase.dynamics(dict(zip(states, rates, strict=True)))
    if problem.paths:
        values = problem.path_values(states, controls, casadi)
        pairs = zip(values, problem.paths, strict=True)
        phase.path_constraints(*[value >= path.lower for value, path in pairs])
    sign = -1.0 if problem.maximise else 1.0
    if problem.integrand is not None:
        cost = phase.add_integral(problem.cost_rate(states, controls, casadi))
    elif problem.objective == "t":
        cost = time.final
    else:
        names = [state.name for state in problem.states]
        cost = states[names.index(problem.objective)].final
    ocp.minimize(sign * cost)
    intervals, degree = settings["mesh"]
    phase.mesh([degree] * intervals, np.linspace(-1.0, 1.0, intervals + 1))
    _guess(phase, problem, intervals, degree)
    if settings.get("tolerance"):
        solution = maptor.solve_adaptive(
            ocp,
            error_tolerance=settings["tolerance"],
            nlp_options=QUIET,
            show_summary=False,
        )
        solves = solution.adaptive["iterations"] + 1
    else:
        solution = maptor.solve_fixed_mesh(ocp, nlp_options=QUIET, show_summary=False)
        solves = 1
    return _answer(solution, sign, solves, problem)


def _pair(quantity) -> tuple[float | None, float | None] | None:
    if quantity.lower is None and quantity.upper is None:
        return None
    return quantity.lower, quantity.upper


def _guess(phase, problem: Problem, intervals: int, degree: int) -> None:
    radau = _compute_radau_collocation_components(degree)
    nodes = (np.asarray(radau.state_approximation_nodes) + 1.0) / 2.0
    constant = np.array([[c.guess] * degree for c in problem.controls])
    states = [
        np.array([problem.state_guess((k + node) / intervals) for node in nodes]).T
        for k in range(intervals)
    ]
    phase.guess(
        states=states,
        controls=[constant] * intervals,
        initial_time=0.0,
        terminal_time=problem.duration_guess,
        integrals=0.0 if problem.integrand is not None else None,
    )


def _answer(solution, sign: float, solves: int, problem: Problem) -> Answer:
    status = solution.status
    if not status["success"]:
        raise RuntimeError(f"no solution: {status['message']}")
    data = solution.phases[1]
    mesh = data["mesh"]
    degrees = [int(degree) for degree in mesh["polynomial_degrees"]]
    start, end = data["times"]["initial"], data["times"]["final"]
    borders = start + (np.asarray(mesh["mesh_nodes"]) + 1.0) / 2.0 * (end - start)
    raw = solution._raw_solution
    state_values = raw.phase_solved_state_trajectories_per_interval[1]
    control_values = raw.phase_solved_control_trajectories_per_interval[1]
    pieces = []
    for k, degree in enumerate(degrees):
        radau = _compute_radau_collocation_components(degree)
        width = (borders[k + 1] - borders[k]) / 2.0
        at_states = borders[k] + width * (
            np.asarray(radau.state_approximation_nodes) + 1
        )
        at_controls = borders[k] + width * (np.asarray(radau.collocation_nodes) + 1.0)
        pieces.append(
            Piece(
                borders[k],
                borders[k + 1],
                at_states,
                np.asarray(state_values[k]).reshape(len(problem.states), -1).T,
                at_controls,
                np.asarray(control_values[k]).reshape(len(problem.controls), -1).T,
            )
        )
    return Answer(
        objective=sign * float(status["objective"]),
        pieces=pieces,
        solves=int(solves),
        points=sum(degrees),
        message=str(status["message"]),
        solved=bool(status["success"]),
    )
