"""Several agents in one problem: for groups that no order of priority keeps apart.

Each agent's states, controls and constraints are copied into one phase, with the
squared distance of every pair as a coupling: pairs are imposed where an audit finds
them too near, until none is (:mod:`showc.ocp.adaptive.constraint_generation`).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.adaptive.constraint_generation import Couplings, enforce
from showc.ocp.agents.agent import QUICK
from showc.ocp.agents.walls import NEAR, sampled
from showc.ocp.collocation.limits import Overrides
from showc.ocp.collocation.solver import SolverOptions
from showc.ocp.collocation.transcription import Transcription
from showc.ocp.guess import Curve, Guess, curves_of
from showc.ocp.mesh import Mesh
from showc.ocp.problem import Problem
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from showc.ocp.agents.agent import Agent, LeastEffort
    from showc.ocp.agents.walls import Apart
    from showc.ocp.coupling import Imposed
    from showc.ocp.solution import Solution

    FloatArray = NDArray[np.float64]

ITERATIONS = 100
"""Iterations of one solve."""
ROUNDS = 4
"""Times that pairs are added or tightened."""
SPARE = 1e-5
"""How much more than the distance is kept, over it."""


def _tag(number: int) -> str:
    return f" of agent {number + 1}"


def join(program: LeastEffort, count: int, apart: Apart) -> Problem:
    """Problem of ``count`` agents in one phase, pairs as couplings, least effort.

    Names of states, controls, parameters and path constraints end in the agent's
    number.
    """
    (single,) = program.problem.phases
    problem = Problem(f"{count} x {program.problem.name}")
    phase = problem.phase(single.name, duration=single.duration_bounds)
    effort: Any = 0.0
    places = []
    for number in range(count):
        tag = _tag(number)
        old = [symbol for symbol, _ in program.problem.parameters.values()]
        new = [
            problem.parameter(name + tag, default)
            for name, (_, default) in program.problem.parameters.items()
        ]

        def own(expression: Any, old: list[Any] = old, new: list[Any] = new) -> Any:  # noqa: ANN401
            """Expression of one agent in that agent's symbols."""
            if not isinstance(expression, casadi.SX) or not old:
                return expression
            return casadi.substitute(
                expression, casadi.vertcat(*old), casadi.vertcat(*new)
            )

        for name, state in single.states.items():
            quantity = state.quantity
            symbol = phase.state(
                name + tag,
                own(quantity.lower),
                own(quantity.upper),
                start=(own(state.start[0]), own(state.start[1])),
                end=(own(state.end[0]), own(state.end[1])),
                scale=quantity.scale,
            )
            old, new = [*old, quantity.symbol], [*new, symbol]
        for name, control in single.controls.items():
            quantity = control.quantity
            symbol = phase.control(
                name + tag,
                own(quantity.lower),
                own(quantity.upper),
                degree=control.degree,
                continuous=control.continuous,
                scale=quantity.scale,
            )
            old, new = [*old, quantity.symbol], [*new, symbol]
        for name, expression in single.derivatives.items():
            symbol = phase.states[name + tag].quantity.symbol
            phase.derivative(symbol, own(expression, old, new))
        for c in single.path_constraints:
            phase.constrain(
                own(c.symbol, old, new),
                own(c.lower),
                own(c.upper),
                name=c.name + tag,
                scale=c.scale,
            )
        effort += sum(own(term, old, new) for _, term in single.integrals)
        places.append(
            [phase.states[name + tag].quantity.symbol for name in program.position]
        )
    for i, j in combinations(range(count), 2):
        squared = sum(
            (factor * (a - b)) ** 2
            for a, b, factor in zip(places[i], places[j], apart.metric, strict=True)
        )
        least = (apart.distance * (1.0 + SPARE)) ** 2
        phase.couple(squared, least, None, name=f"{i + 1} and {j + 1}")
    problem.minimise(phase.integral(effort))
    return problem


def solve_joined(
    program: LeastEffort,
    agents: Sequence[Agent],
    duration: float,
    *,
    alone: Sequence[Solution],
    start: Sequence[FloatArray],
    apart: Apart,
) -> list[Solution] | None:
    """Solve a group in one problem.

    Parameters
    ----------
    alone
        Solutions without regard to each other: attitude and controls to start from.
    start
        Places to start from, at five instants of each interval, shape (K, 5, n).

    Returns
    -------
    list or None
        One solution for each agent; ``None`` if none was found that keeps all apart.
    """
    problem = join(program, len(agents), apart)
    (mesh,) = program.mesh.phases
    degrees = {
        name + _tag(k): tuple(degree)
        for name, degree in mesh.control_degrees.items()
        for k in range(len(agents))
    }
    joint_mesh = Mesh((replace(mesh, control_degrees=degrees),))
    overrides = Overrides(
        starts={
            n + _tag(k): v for k, a in enumerate(agents) for n, v in a.starts.items()
        },
        ends={n + _tag(k): v for k, a in enumerate(agents) for n, v in a.ends.items()},
        durations={program.name: duration},
    )
    parameters = {
        n + _tag(k): v for k, a in enumerate(agents) for n, v in a.parameters.items()
    }
    scales = {f"{program.name}.duration": duration}

    def once(imposed: tuple[Imposed, ...], former: Solution | None) -> Solution:
        built = Transcription(
            problem,
            joint_mesh,
            scales=scales,
            options=SolverOptions(tolerance=1e-6, iterations=ITERATIONS, extra=QUICK),
            couplings=imposed,
        )
        guess: Guess | Solution = first if former is None else former
        return built.solve(parameters=parameters, overrides=overrides, guess=guess)

    first = Guess(_curves(program, alone, start), {program.name: duration})
    couplings = Couplings(problem, parameters)
    fractions = np.concatenate([[0.0], np.cumsum(mesh.fractions)])
    ways = [sampled(program.place(solution)) for solution in alone]
    for i, j in combinations(range(len(agents)), 2):
        distance = np.minimum(
            _distance(ways[i], ways[j], apart), _distance(start[i], start[j], apart)
        )
        near = np.nonzero(distance < NEAR * apart.distance)[0]
        if near.size:
            stretch = float(fractions[near[0]]), float(fractions[near[-1] + 1])
            couplings.expect(0, f"{i + 1} and {j + 1}", stretch)
    found = enforce(couplings, once, rounds=ROUNDS)
    if not found.result.usable:
        return None
    return [_part(found, program, k) for k in range(len(agents))]


def _distance(first: FloatArray, second: FloatArray, apart: Apart) -> FloatArray:
    """Least distance of sampled places on each interval, shape (K,)."""
    relative = (first - second) * np.asarray(apart.metric)
    return np.asarray(np.linalg.norm(relative, axis=2).min(axis=1))


def _curves(
    program: LeastEffort, alone: Sequence[Solution], start: Sequence[FloatArray]
) -> dict[str, Curve]:
    """Curves of all agents: of the ways alone, but the places of ``start``."""
    curves: dict[str, Curve] = {}
    for number, (solution, places) in enumerate(zip(alone, start, strict=True)):
        (part,) = solution.phases
        for name, curve in curves_of(part).items():
            curves[name + _tag(number)] = curve
        breaks = (part.states.breaks - part.start) / part.duration
        inner = np.linspace(0.0, 1.0, places.shape[1])[:-1]
        at = (breaks[:-1, None] + np.diff(breaks)[:, None] * inner).ravel()
        at = np.append(at, 1.0)
        for axis, name in enumerate(program.position):
            values = np.append(places[:, :-1, axis].ravel(), places[-1, -1, axis])
            curves[name + _tag(number)] = _table(at, values)
    return curves


def _table(at: FloatArray, values: FloatArray) -> Curve:
    return lambda fraction: np.interp(fraction, at, values)


def _part(solution: Solution, program: LeastEffort, number: int) -> Solution:
    """Read one agent's solution out of a joint one."""
    (part,) = solution.phases
    (single,) = program.problem.phases
    tag = _tag(number)

    def columns(names: Sequence[str], all_names: tuple[str, ...]) -> list[int]:
        return [all_names.index(name + tag) for name in names]

    states, controls = list(single.states), list(single.controls)
    rows = columns(states, part.state_names)
    chosen = columns(controls, part.control_names)
    parameters: Mapping[str, float] = {
        name: solution.parameters[name + tag] for name in program.problem.parameters
    }
    own = replace(
        part,
        mesh=program.mesh.phases[0],
        state_names=tuple(states),
        control_names=tuple(controls),
        states=_columns(part.states, rows),
        controls=_columns(part.controls, chosen),
        costates=part.costates[:, rows],
        path_multipliers=np.zeros(
            (part.costates.shape[0], len(single.path_constraints))
        ),
        bound_gaps=part.bound_gaps[:, rows],
    )
    return replace(
        solution,
        phases=(own,),
        mesh=program.mesh,
        parameters=dict(parameters),
    )


def _columns(curve: PiecewisePolynomial, rows: list[int]) -> PiecewisePolynomial:
    return PiecewisePolynomial(curve.breaks, curve.coefficients[:, :, rows])
