"""rockit: Radau collocation, the control constant on each interval, IPOPT."""

from __future__ import annotations

from importlib.metadata import version as installed
from typing import TYPE_CHECKING

import casadi
import numpy as np
import rockit
from benchmarks.audit import Answer, Piece

if TYPE_CHECKING:
    from benchmarks.problem import Problem


def version() -> str:
    """Version of the peer."""
    return installed("rockit-meco")


def solve(problem: Problem, settings: dict) -> Answer:
    """Solve on ``settings["mesh"]``, intervals and points of each."""
    intervals, degree = settings["mesh"]
    if problem.fixed_duration:
        ocp = rockit.Ocp(t0=0, T=problem.duration[0])
    else:
        ocp = rockit.Ocp(t0=0, T=rockit.FreeTime(problem.duration_guess))
        ocp.subject_to(problem.duration[0] <= (problem.duration[1] >= ocp.T))
    states = [ocp.state() for _ in problem.states]
    controls = [ocp.control() for _ in problem.controls]
    for symbol, rate in zip(
        states, problem.rates(states, controls, casadi), strict=True
    ):
        ocp.set_der(symbol, rate)
    for symbol, state in zip(states, problem.states, strict=True):
        ocp.subject_to(ocp.at_t0(symbol) == state.start)
        if state.end is not None:
            ocp.subject_to(ocp.at_tf(symbol) == state.end)
    for symbol, quantity in zip(
        [*states, *controls], [*problem.states, *problem.controls], strict=True
    ):
        _bound(ocp, symbol, quantity)
    if problem.paths:
        values = problem.path_values(states, controls, casadi)
        for value, path in zip(values, problem.paths, strict=True):
            ocp.subject_to(value >= path.lower)
    sign = -1.0 if problem.maximise else 1.0
    _objective(ocp, problem, states, controls)
    fraction = ocp.t / problem.duration_guess
    for symbol, state in zip(states, problem.states, strict=True):
        ocp.set_initial(
            symbol, state.start + fraction * (state.guess_end - state.start)
        )
    for symbol, control in zip(controls, problem.controls, strict=True):
        ocp.set_initial(symbol, control.guess)
    ocp.solver(
        "ipopt",
        {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes",
                                        "max_iter": 3000}},
    )  # fmt: skip
    ocp.method(rockit.DirectCollocation(N=intervals, M=1, degree=degree))
    solution = ocp.solve()
    status = str(solution.stats["return_status"])
    return Answer(
        objective=sign * float(solution.value(ocp.objective)),
        pieces=_pieces(solution, states, controls, degree),
        solves=1,
        points=intervals * degree,
        message=status,
        solved=status == "Solve_Succeeded",
    )


def _objective(ocp, problem: Problem, states, controls) -> None:
    sign = -1.0 if problem.maximise else 1.0
    names = [state.name for state in problem.states]
    if problem.integrand is not None:
        ocp.add_objective(ocp.integral(problem.cost_rate(states, controls, casadi)))
    elif problem.objective == "t":
        ocp.add_objective(ocp.T)
    else:
        symbol = states[names.index(problem.objective)]
        ocp.add_objective(sign * ocp.at_tf(symbol))


def _bound(ocp, symbol, quantity) -> None:
    if quantity.lower is not None and quantity.upper is not None:
        ocp.subject_to(quantity.lower <= (symbol <= quantity.upper))
    elif quantity.lower is not None:
        ocp.subject_to(symbol >= quantity.lower)
    elif quantity.upper is not None:
        ocp.subject_to(symbol <= quantity.upper)


def _pieces(solution, states, controls, degree: int) -> list[Piece]:
    times, values = solution.sample(casadi.vertcat(*states), grid="integrator_roots")
    borders, at_borders = solution.sample(casadi.vertcat(*states), grid="control")
    _, inputs = solution.sample(casadi.vertcat(*controls), grid="control")
    count = len(borders) - 1
    shape = (len(borders), -1)
    at_borders, inputs = at_borders.reshape(shape), inputs.reshape(shape)
    times = np.asarray(times).reshape(count, degree)
    values = np.asarray(values).reshape(count, degree, -1)
    pieces = []
    for k in range(count):
        nodes = np.concatenate([[borders[k]], times[k]])
        at_nodes = np.concatenate([at_borders[k : k + 1], values[k]])
        middle = np.array([(borders[k] + borders[k + 1]) / 2.0])
        pieces.append(
            Piece(
                borders[k], borders[k + 1], nodes, at_nodes, middle, inputs[k : k + 1]
            )
        )
    return pieces
