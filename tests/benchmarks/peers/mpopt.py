"""MPOPT: Radau collocation in CasADi, IPOPT, interval widths adapted to residuals."""

from __future__ import annotations

from importlib.metadata import version as installed
from typing import TYPE_CHECKING

import casadi
import numpy as np
from benchmarks.audit import Answer, Piece
from mpopt import mp

if TYPE_CHECKING:
    from benchmarks.problem import Problem


def version() -> str:
    """Version of the peer."""
    return installed("mpopt")


def solve(problem: Problem, settings: dict) -> Answer:
    """Solve from ``settings["mesh"]``, widths adapted to ``settings["tolerance"]``."""
    states, controls = problem.states, problem.controls
    ocp = mp.OCP(n_states=len(states), n_controls=len(controls))

    def split(x, u):
        return [x[i] for i in range(len(states))], [u[i] for i in range(len(controls))]

    ocp.dynamics[0] = lambda x, u, _: problem.rates(*split(x, u), casadi)
    sign = -1.0 if problem.maximise else 1.0
    names = [state.name for state in states]
    if problem.integrand is not None:
        ocp.running_costs[0] = lambda x, u, _: problem.cost_rate(*split(x, u), casadi)
    elif problem.objective == "t":
        ocp.terminal_costs[0] = lambda _xf, tf, _x0, _t0: tf
    else:
        column = names.index(problem.objective)
        ocp.terminal_costs[0] = lambda xf, _tf, _x0, _t0: sign * xf[column]
    ocp.terminal_constraints[0] = lambda xf, _tf, _x0, _t0: [
        xf[i] - s.end for i, s in enumerate(states) if s.end is not None
    ]
    if problem.paths:
        ocp.path_constraints[0] = lambda x, u, _: [
            path.lower - value
            for path, value in zip(
                problem.paths, problem.path_values(*split(x, u), casadi), strict=True
            )
        ]
    ocp.x00[0] = problem.state_guess(0.0)
    ocp.xf0[0] = problem.state_guess(1.0)
    ocp.u00[0] = ocp.uf0[0] = [c.guess for c in controls]
    ocp.tf0[0] = problem.duration_guess
    ocp.lbtf[0], ocp.ubtf[0] = problem.duration
    ocp.lbx[0] = [-np.inf if s.lower is None else s.lower for s in states]
    ocp.ubx[0] = [np.inf if s.upper is None else s.upper for s in states]
    ocp.lbu[0] = [-np.inf if c.lower is None else c.lower for c in controls]
    ocp.ubu[0] = [np.inf if c.upper is None else c.upper for c in controls]
    ocp.validate()
    intervals, degree = settings["mesh"]
    mp.mpopt_h_adaptive._TOL_RESIDUAL = settings["tolerance"]
    optimiser = mp.mpopt_h_adaptive(ocp, intervals, [degree] * intervals, "LGR")
    solution = optimiser.solve(
        max_iter=10,
        nlp_solver_options={"ipopt.print_level": 0, "print_time": 0},
    )
    status = optimiser.nlp_solver.stats()["return_status"]
    data = optimiser.process_results(solution, plot=False)
    values, inputs, times, _ = data.get_original_data()
    times = times.ravel()
    pieces = []
    for k in range(intervals):
        part = slice(k * degree, (k + 1) * degree + 1)
        nodes = times[part]
        pieces.append(
            Piece(nodes[0], nodes[-1], nodes, values[part], nodes, inputs[part])
        )
    return Answer(
        objective=sign * float(solution["f"]),
        pieces=pieces,
        solves=int(optimiser.iter_count),
        points=intervals * degree,
        message=status,
        solved=status == "Solve_Succeeded",
    )
