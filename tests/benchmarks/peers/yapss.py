"""YAPSS: Radau or Gauss collocation on a mesh of the user's, IPOPT, no refinement."""

from __future__ import annotations

from importlib.metadata import version as installed
from typing import TYPE_CHECKING

import numpy as np
import yapss
import yapss.math
from benchmarks.audit import Answer, Piece

if TYPE_CHECKING:
    from benchmarks.problem import Problem

LARGE = 1e20


def version() -> str:
    """Version of the peer."""
    return installed("yapss")


def solve(problem: Problem, settings: dict) -> Answer:
    """Solve on ``settings["mesh"]``, intervals and points of each."""
    intervals, degree = settings["mesh"]
    states, controls = problem.states, problem.controls
    has_integral = problem.integrand is not None
    ocp = yapss.Problem(
        name=problem.name,
        nx=[len(states)],
        nu=[len(controls)],
        nq=[1 if has_integral else 0],
        nh=[len(problem.paths)],
    )
    sign = -1.0 if problem.maximise else 1.0
    names = [state.name for state in states]

    def objective(arg) -> None:
        phase = arg.phase[0]
        if has_integral:
            arg.objective = sign * phase.integral[0]
        elif problem.objective == "t":
            arg.objective = sign * phase.final_time
        else:
            arg.objective = sign * phase.final_state[names.index(problem.objective)]

    def continuous(arg) -> None:
        phase = arg.phase[0]
        state, control = list(phase.state), list(phase.control)
        phase.dynamics[:] = problem.rates(state, control, yapss.math)
        if has_integral:
            phase.integrand[:] = (problem.cost_rate(state, control, yapss.math),)
        if problem.paths:
            phase.path[:] = problem.path_values(state, control, yapss.math)

    ocp.functions.objective = objective
    ocp.functions.continuous = continuous
    _bounds(ocp.bounds.phase[0], problem)
    guess = ocp.guess.phase[0]
    guess.time = [0.0, problem.duration_guess]
    ends = zip(problem.state_guess(0.0), problem.state_guess(1.0), strict=True)
    guess.state = [list(pair) for pair in ends]
    guess.control = [[c.guess, c.guess] for c in controls]
    mesh = ocp.mesh.phase[0]
    mesh.collocation_points = [degree] * intervals
    mesh.fraction = [1.0 / intervals] * intervals
    ocp.spectral_method = "lgr"
    ocp.derivatives.method = "auto"
    ocp.derivatives.order = "second"
    ocp.ipopt_options.print_level = 0
    ocp.ipopt_options.sb = "yes"
    ocp.ipopt_options.max_iter = 3000
    solution = ocp.solve()
    message = solution.nlp_info.ipopt_status_message
    return Answer(
        objective=sign * float(solution.objective),
        pieces=_pieces(solution.phase[0], intervals, degree),
        solves=1,
        points=intervals * degree,
        message=message if isinstance(message, str) else message.decode(),
        solved=solution.nlp_info.ipopt_status == 0,
    )


def _bounds(bounds, problem: Problem) -> None:
    states, controls = problem.states, problem.controls
    bounds.initial_time.lower = bounds.initial_time.upper = 0.0
    bounds.final_time.lower, bounds.final_time.upper = problem.duration
    bounds.initial_state.lower[:] = [s.start for s in states]
    bounds.initial_state.upper[:] = [s.start for s in states]
    lower = [-LARGE if s.lower is None else s.lower for s in states]
    upper = [LARGE if s.upper is None else s.upper for s in states]
    bounds.state.lower[:], bounds.state.upper[:] = lower, upper
    bounds.final_state.lower[:] = [
        low if s.end is None else s.end for s, low in zip(states, lower, strict=True)
    ]
    bounds.final_state.upper[:] = [
        high if s.end is None else s.end for s, high in zip(states, upper, strict=True)
    ]
    bounds.control.lower[:] = [-LARGE if c.lower is None else c.lower for c in controls]
    bounds.control.upper[:] = [LARGE if c.upper is None else c.upper for c in controls]
    if problem.paths:
        bounds.path.lower[:] = [path.lower for path in problem.paths]


def _pieces(phase, intervals: int, degree: int) -> list[Piece]:
    borders = np.linspace(0.0, float(phase.final_time), intervals + 1)
    pieces = []
    for k in range(intervals):
        first = k * degree
        pieces.append(
            Piece(
                borders[k],
                borders[k + 1],
                np.asarray(phase.time[first : first + degree + 1]),
                np.stack([row[first : first + degree + 1] for row in phase.state], 1),
                np.asarray(phase.time_c[first : first + degree]),
                np.stack([row[first : first + degree] for row in phase.control], 1),
            )
        )
    return pieces
