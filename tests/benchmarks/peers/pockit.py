"""Pockit: Radau collocation, SymPy compiled by Numba, IPOPT through cyipopt.

The package gives checks and refinement steps; this module writes the loop around them
and marks the controls of problems known to be bang-bang, as its documentation asks the
user to (marked wrongly, it cuts the mesh without end).
"""

from __future__ import annotations

import ctypes
import site
from importlib.metadata import version as installed
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import sympy


def _load_ipopt() -> None:
    # cyipopt is built against the IPOPT inside the CasADi wheel, whose folder the
    # loader does not search.
    for folder in site.getsitepackages():
        for library in Path(folder).glob("casadi/libipopt.so.3"):
            ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)


_load_ipopt()

from benchmarks.audit import Answer, Piece  # noqa: E402
from pockit.optimizer import ipopt  # noqa: E402
from pockit.radau import System, constant_guess  # noqa: E402

if TYPE_CHECKING:
    from benchmarks.problem import Problem

FUNCTIONS = SimpleNamespace(
    sin=sympy.sin, cos=sympy.cos, exp=sympy.exp, sqrt=sympy.sqrt
)
MESHES = 25


def version() -> str:
    """Version of the peer."""
    return installed("pockit-optimal-control")


def solve(problem: Problem, settings: dict) -> Answer:
    """Solve from ``settings["mesh"]``, refined until its own check passes."""
    intervals, degree = settings["mesh"]
    tolerance = settings["tolerance"]
    system, phase = _system(problem, intervals, degree)
    statics = _statics(problem)
    guess = [_guess(problem, phase), statics] if statics else _guess(problem, phase)
    options = {"print_level": 0, "sb": "yes", "max_iter": 3000}
    value, info = ipopt.solve(system, guess, options)
    limits = {
        "absolute_tolerance_continuous": tolerance,
        "relative_tolerance_continuous": tolerance,
    }
    solves, passed = 1, system.check(value, **limits)
    while not passed and solves < MESHES:
        value = system.refine(value, **limits)
        value, info = ipopt.solve(system, value, options)
        solves += 1
        passed = system.check(value, **limits)
    sign = -1.0 if problem.maximise else 1.0
    message = info["status_msg"]
    message = message.decode() if isinstance(message, bytes) else str(message)
    if not passed:
        message = f"its own check did not pass in {MESHES} meshes; {message}"
    pieces = _pieces(problem, value[0] if statics else value)
    return Answer(
        objective=sign * float(info["obj_val"]),
        pieces=pieces,
        solves=solves,
        points=sum(len(piece.control_times) for piece in pieces),
        message=message,
        solved=bool(passed) and info["status"] == 0,
    )


def _system(problem: Problem, intervals: int, degree: int):
    states, controls = problem.states, problem.controls
    # The final time and a final state in the objective are static parameters: that is
    # how the package lets an objective name them.
    names = ["final_time", "final_state"][: len(_statics(problem))]
    system = System(names)
    free_time = None if problem.fixed_duration else system.s[0]
    phase = system.new_phase([s.name for s in states], [c.name for c in controls])
    x, u = list(phase.x), list(phase.u)
    phase.set_dynamics(problem.rates(x, u, FUNCTIONS))
    if problem.integrand is not None:
        phase.set_integral([problem.cost_rate(x, u, FUNCTIONS)])
    rows, lower, upper, marks = [], [], [], []
    for symbol, quantity in zip([*x, *u], [*states, *controls], strict=True):
        if quantity.lower is None and quantity.upper is None:
            continue
        rows.append(symbol)
        lower.append(-np.inf if quantity.lower is None else quantity.lower)
        upper.append(np.inf if quantity.upper is None else quantity.upper)
        marks.append(problem.bang_bang and quantity in controls)
    for path, value in zip(
        problem.paths, problem.path_values(x, u, FUNCTIONS), strict=True
    ):
        rows.append(value)
        lower.append(path.lower)
        upper.append(np.inf)
        marks.append(False)
    if rows:
        phase.set_phase_constraint(rows, lower, upper, marks)
    phase.set_boundary_condition(
        [s.start for s in states],
        [system.s[1] if s.name == problem.objective else s.end for s in states],
        0.0,
        problem.duration[0] if problem.fixed_duration else free_time,
    )
    phase.set_discretization(intervals, degree)
    system.set_phase([phase])
    sign = -1 if problem.maximise else 1
    if problem.integrand is not None:
        system.set_objective(phase.I[0])
    elif problem.objective == "t":
        system.set_objective(free_time)
    else:
        system.set_objective(sign * system.s[1])
    if not problem.fixed_duration:
        # Without a lower bound the final time runs away to minus infinity.
        low, high = problem.duration
        system.set_system_constraint([free_time], [low], [high])
    return system, phase


def _statics(problem: Problem) -> list[float]:
    ends = [s.guess_end for s in problem.states if s.name == problem.objective]
    return ends if problem.fixed_duration else [problem.duration_guess, *ends]


def _guess(problem: Problem, phase):
    guess = constant_guess(phase, 0.0)
    guess.t_0, guess.t_f = 0.0, problem.duration_guess
    duration = problem.duration_guess
    line = np.array([problem.state_guess(t / duration) for t in guess.t_x])
    for column in range(len(problem.states)):
        guess.x[column] = line[:, column]
    for column, control in enumerate(problem.controls):
        guess.u[column] = np.full(len(guess.t_u), control.guess)
    return guess


def _pieces(problem: Problem, value) -> list[Piece]:
    counts = [int(count) for count in value._num_point]
    state_times, control_times = np.asarray(value.t_x), np.asarray(value.t_u)
    states = np.stack([value.x[i] for i in range(len(problem.states))], 1)
    controls = np.stack([value.u[i] for i in range(len(problem.controls))], 1)
    pieces, first = [], 0
    for count in counts:
        part, inner = slice(first, first + count + 1), slice(first, first + count)
        nodes = state_times[part]
        pieces.append(
            Piece(
                nodes[0],
                nodes[-1],
                nodes,
                states[part],
                control_times[inner],
                controls[inner],
            )
        )
        first += count
    return pieces
