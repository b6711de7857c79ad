"""showc's own core through its public API, with its defaults."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import casadi
import numpy as np
from benchmarks.audit import Answer, Piece

import showc
from showc import ocp
from showc.ocp.adaptive import solve as refine

if TYPE_CHECKING:
    from benchmarks.problem import Problem

    from showc.trajectory import PiecewisePolynomial


def version() -> str:
    """Version of showc."""
    return showc.__version__


def build(problem: Problem) -> ocp.Problem:
    """State the problem through the API."""
    low, high = problem.duration
    stated = ocp.Problem(problem.name)
    phase = stated.phase(duration=low if low == high else (low, high))
    states = [
        phase.state(s.name, s.lower, s.upper, start=s.start, end=s.end)
        for s in problem.states
    ]
    controls = [phase.control(c.name, c.lower, c.upper) for c in problem.controls]
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
    """Solve with the defaults; ``settings`` are not used."""
    del settings
    return answer(refine(build(problem)))


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
    at_states, at_controls = _nodes(states.degree), _nodes(controls.degree)
    pieces = []
    for start, end in pairwise(borders):
        state_times = start + (end - start) * at_states
        control_times = start + (end - start) * at_controls
        pieces.append(
            Piece(
                start,
                end,
                state_times,
                states(state_times),
                control_times,
                controls(control_times),
            )
        )
    return pieces


def _nodes(degree: int) -> np.ndarray:
    # Inside the interval, so that no value is taken from a neighbour.
    return (np.polynomial.legendre.leggauss(degree + 1)[0] + 1.0) / 2.0
