"""One mesh interval of a cascade as a stage: its functions and its rows.

A stage takes the values of the states at the start of an interval and the coefficients
of its controls. It maps them to the values at its end (by the cascade of its dynamics),
to a share of the objective, and to rows that keep every limit at every instant of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import casadi
import numpy as np

from showc.ocp.nodes import collocation
from showc.ocp.transcription.condensed.cascade import (
    Cascade,
    Composition,
    depends_on,
    elevate,
)
from showc.ocp.transcription.condensed.lifting import Lifting

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import FloatArray
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.quantity import HalfSpaces, Quantity


Symbol = Any
TimeKind = Literal["given", "free", "movable"]
"""``given``: widths of the intervals are data. ``free``: their ratios are data, the
duration is an unknown. ``movable``: every width is an unknown."""


@dataclass(frozen=True, slots=True)
class Row:
    """What one constraint row of a stage is, for its bounds and for messages."""

    key: tuple[str, ...]
    """Where its bounds stand: ("bounds", name), ("path", name), ("half", group, r)."""
    scale: float
    """The row is the quantity over this."""
    at_start: bool = False
    """Whether the start conditions alone decide it on the first interval."""
    at_end: bool = False
    """Whether the end conditions alone decide it on the last interval."""


@dataclass(frozen=True, slots=True)
class Stage:
    """Functions of one interval; all unknowns scaled."""

    variables: tuple[Symbol, Symbol, Symbol, Symbol]
    """x, u, q and p; q holds width, signals, half-spaces."""
    expressions: tuple[Symbol, Symbol, Symbol]
    """Next x, rows and cost, in these and in the symbols of ``lifting``."""
    lifting: Lifting
    """What the collocated derivatives are, by names."""
    coefficients: Any
    """(x, u, q, p) -> all Bernstein coefficients in one row, unscaled."""
    rows: tuple[Row, ...]
    degrees: dict[str, int]
    """Degree of every state and control, in the order of ``coefficients``."""
    state_names: tuple[str, ...]
    state_scales: tuple[float, ...]
    control_names: tuple[str, ...]
    control_scales: tuple[float, ...]
    """Scale of each entry of u: one for every coefficient of every control."""
    data: int
    """Length of q."""
    signal_slice: slice
    half_space_slices: dict[str, slice]
    """Normals of each group within q, row by row."""
    cost_nodes: tuple[float, ...]
    """Fractions of the interval at which the signals are wanted."""
    terminal: Any
    """(x, p) -> share of the objective at the end."""

    @property
    def states(self) -> int:
        """Length of x."""
        return len(self.state_scales)

    @property
    def inputs(self) -> int:
        """Length of u."""
        return len(self.control_scales)


def scale_of(quantity: Quantity) -> float:
    """Typical magnitude of a quantity: as stated, or from its bounds, or 1."""
    if quantity.scale is not None:
        return float(quantity.scale)
    numbers = [
        abs(float(bound))
        for bound in (quantity.lower, quantity.upper)
        if isinstance(bound, (int, float)) and np.isfinite(bound) and bound != 0.0
    ]
    return max(numbers, default=1.0)


def is_fixed(pair: tuple[Any, Any]) -> bool:
    """Tell whether lower and upper bound are one value."""
    return bool(casadi.is_equal(casadi.SX(pair[0]), casadi.SX(pair[1])))


def within(pair: tuple[Any, Any], quantity: Any) -> tuple[Any, Any]:  # noqa: ANN401
    """Narrow end conditions by the bounds that hold at every instant."""
    if is_fixed(pair):
        return pair
    return (
        casadi.fmax(casadi.SX(pair[0]), casadi.SX(quantity.lower)),
        casadi.fmin(casadi.SX(pair[1]), casadi.SX(quantity.upper)),
    )


@dataclass(frozen=True, slots=True)
class _Objective:
    """The objective as running cost, price of time and cost at the end."""

    running: Symbol
    time: Symbol
    terminal: Symbol


def _split_objective(problem: Problem) -> _Objective:
    phase = problem.phases[0]
    objective = -problem.objective if problem.maximises else problem.objective
    running = casadi.SX(0)
    for symbol, integrand in phase.integrals:
        weight = casadi.jacobian(objective, symbol)
        objective = casadi.substitute(objective, symbol, 0)
        running += weight * integrand
    price = casadi.jacobian(objective, phase.duration)
    terminal = casadi.substitute(objective, phase.duration, 0)
    forbidden = {"duration": phase.duration} | {
        f"integral {k}": symbol for k, (symbol, _) in enumerate(phase.integrals)
    }
    initial = {f"{name} at the start": s.initial for name, s in phase.states.items()}
    for part, names in ((price, forbidden), (running, forbidden), (terminal, initial)):
        if found := depends_on(part, names):
            raise ValueError(
                f"the objective of {problem.name!r} is not affine in {found[0]}; a "
                "condensed transcription sums shares of the intervals"
            )
    return _Objective(running, price, terminal)


def build_stage(
    problem: Problem,
    *,
    points: int,
    time: TimeKind,
    signals: Sequence[str],
    cost_points: int,
    width_weight: float,
) -> Stage:
    """Write the functions of one interval.

    Parameters
    ----------
    problem
        One phase, no statics, no boundary constraints; dynamics a cascade.
    points
        Gauss points of derivatives that are no polynomials.
    time
        How widths are given.
    signals
        Parameters of the problem that vary along the phase.
    cost_points
        Gauss points of running costs.
    width_weight
        Weight that keeps movable widths near those they start from.

    Raises
    ------
    ValueError
        If the problem has a form that stages cannot express.
    """
    if len(problem.phases) != 1 or problem.statics or problem.boundary_constraints:
        raise ValueError(
            f"problem {problem.name!r} has {len(problem.phases)} phases, "
            f"{len(problem.statics)} statics and "
            f"{len(problem.boundary_constraints)} boundary constraints; stages take "
            "one phase and none of the others"
        )
    phase = problem.phases[0]
    cascade = Cascade.of(phase)
    cost = _split_objective(problem)
    state_names = tuple(phase.states)
    state_scales = [scale_of(phase.states[name].quantity) for name in state_names]
    x = casadi.SX.sym("x", len(state_names) + (time == "free"))
    starts = {n: x[k] * state_scales[k] for k, n in enumerate(state_names)}
    if time == "free":
        state_scales.append(1.0)

    control_names = tuple(phase.controls)
    control_scales: list[float] = []
    lengths = [(phase.controls[name].degree or 0) + 1 for name in control_names]
    u = casadi.SX.sym("u", sum(lengths) + (time == "movable"))
    controls: dict[str, list[Symbol]] = {}
    for name, length in zip(control_names, lengths, strict=True):
        scale, first = scale_of(phase.controls[name].quantity), len(control_scales)
        controls[name] = [scale * u[first + k] for k in range(length)]
        control_scales += [scale] * length

    nodes, weights = collocation("gauss", cost_points)
    groups = {group.name: group.rows * len(group.states) for group in phase.half_spaces}
    signal_slice = slice(1, 1 + cost_points * len(signals))
    slices: dict[str, slice] = {}
    used = signal_slice.stop
    for name, size in groups.items():
        slices[name] = slice(used, used + size)
        used += size
    q = casadi.SX.sym("q", used)
    width = {"given": q[0], "free": q[0] * x[-1], "movable": q[0] * u[-1]}[time]
    lifting = Lifting()
    known = cascade.polynomials(starts, controls, width, points, lifting)
    whole = {
        name: lifting.restored(casadi.vertcat(*known[name]))[0]
        for name in (*state_names, *control_names)
    }
    reach = _reach(cascade, whole, u)
    rows = _limit_rows(phase, known, reach)
    if time == "movable":
        rows.append((u[-1], Row(("width",), 1.0)))
        control_scales.append(1.0)
    rows += _path_rows(cascade, known, points, width)
    for group in phase.half_spaces:
        rows += _half_space_rows(phase, group, known, reach, q[slices[group.name]])

    names = [symbol for symbol, _ in problem.parameters.values()]
    p = casadi.vertcat(*names) if names else casadi.SX(0, 1)
    total = width * _mean(
        Composition.of(cost.running, cascade.members).at(
            known, cascade.members, [float(s) for s in nodes], lifting
        ),
        [problem.parameters[name][0] for name in signals],
        q[signal_slice],
        weights,
    )
    if time == "movable":
        total += cost.time * width + width_weight * q[0] * (u[-1] - 1.0) ** 2
    ending = _ending(phase, cost, x)
    if time == "free":
        ending += cost.time * x[-1]

    following = [known[n][-1] / state_scales[k] for k, n in enumerate(state_names)]
    if time == "free":
        following.append(x[-1])
    return Stage(
        (x, u, q, p),
        (
            casadi.vertcat(*following),
            casadi.vertcat(*(value / row.scale for value, row in rows)),
            total,
        ),
        lifting,
        casadi.Function(
            "coefficients", [x, u, q, p], [casadi.vertcat(*whole.values())]
        ),
        tuple(row for _, row in rows),
        {name: len(known[name]) - 1 for name in whole},
        state_names,
        tuple(state_scales),
        control_names,
        tuple(control_scales),
        used,
        signal_slice,
        slices,
        tuple(float(s) for s in nodes),
        casadi.Function("ending", [x, p], [ending]),
    )


def _mean(
    shares: list[Symbol], varying: list[Symbol], given: Symbol, weights: FloatArray
) -> Symbol:
    """Weighted sum over the cost nodes, signals put in node by node."""
    total = casadi.SX(0)
    count = len(varying)
    for k, share in enumerate(shares):
        value = casadi.SX(share)
        if count:
            here = given[k * count : (k + 1) * count]
            value = casadi.substitute(value, casadi.vertcat(*varying), here)
        total += float(weights[k]) * value
    return total


def _ending(phase: Phase, cost: _Objective, x: Symbol) -> Symbol:
    """Cost at the end as a function of the scaled states."""
    states = phase.states.values()
    values = [x[k] * scale_of(state.quantity) for k, state in enumerate(states)]
    return casadi.substitute(
        cost.terminal,
        casadi.vertcat(*(state.final for state in states)),
        casadi.vertcat(*values),
    )


_Rows = list[tuple[Symbol, Row]]
"""Expressions and what they are."""


def _limit_rows(
    phase: Phase, known: Mapping[str, list[Symbol]], reach: Mapping[str, int]
) -> _Rows:
    """Coefficients of bounded states and controls.

    A state's last coefficient is the first of the interval after, and has its row
    there.
    """
    rows: _Rows = []
    for name, state in phase.states.items():
        if _bounded(state.quantity):
            scale, last = scale_of(state.quantity), len(known[name]) - 1
            rows += [
                (
                    value,
                    Row(
                        ("bounds", name), scale, k < reach[name], last - k < reach[name]
                    ),
                )
                for k, value in enumerate(known[name][:-1])
            ]
    for name, control in phase.controls.items():
        if _bounded(control.quantity):
            row = Row(("bounds", name), scale_of(control.quantity))
            rows += [(value, row) for value in known[name]]
    return rows


def _path_rows(
    cascade: Cascade, known: Mapping[str, list[Symbol]], points: int, width: Symbol
) -> _Rows:
    """Path constraints: on coefficients where polynomial, else at points."""
    nodes = (0.0, *(float(s) for s in collocation("gauss", points)[0]), 1.0)
    rows: _Rows = []
    for constraint in cascade.phase.path_constraints:
        row = Row(("path", constraint.name), scale_of(constraint))
        if names := cascade.phase.rates.get(constraint.name):
            slopes = _slopes([known[name] for name in names], width)
            rows += [(value, row) for value in slopes]
            continue
        made = Composition.of(constraint.symbol, cascade.members)
        values = (
            made.at(known, cascade.members, nodes)
            if made.order is None
            else made.coefficients(known, cascade.members)
        )
        rows += [(value, row) for value in values]
    return rows


def _slopes(curves: list[list[Symbol]], width: Symbol) -> list[Symbol]:
    """Coefficients of one curve's rate, or squared lengths of those of several."""
    degree = max(len(curve) for curve in curves) - 1
    raised = [elevate(curve, degree) for curve in curves]
    each = [
        [(after - before) * (degree / width) for before, after in pairwise(curve)]
        for curve in raised
    ]
    if len(each) == 1:
        return each[0]
    return [sum(rate**2 for rate in rates) for rates in zip(*each, strict=True)]


def _half_space_rows(
    phase: Phase,
    group: HalfSpaces,
    known: Mapping[str, list[Symbol]],
    reach: Mapping[str, int],
    normals: Symbol,
) -> _Rows:
    """Projections of coefficients on the normals of one group of half-spaces."""
    size = len(group.states)
    degree = max(len(known[name]) for name in group.states) - 1
    fixed = min(reach[name] for name in group.states)
    scale = max(scale_of(phase.states[name].quantity) for name in group.states)
    raised = [elevate(known[name], degree) for name in group.states]
    rows: _Rows = []
    for r in range(group.rows):
        for j in range(degree + 1):
            vector = casadi.vertcat(*(coefficients[j] for coefficients in raised))
            value = casadi.dot(normals[r * size : (r + 1) * size], vector)
            key = ("half", group.name, str(r))
            rows.append((value, Row(key, scale, j < fixed, degree - j < fixed)))
    return rows


def _bounded(quantity: Quantity) -> bool:
    """Whether a quantity has any bound that is not infinite by its statement."""
    return any(
        not isinstance(bound, (int, float)) or np.isfinite(bound)
        for bound in (quantity.lower, quantity.upper)
    )


def _reach(cascade: Cascade, known: Mapping[str, Symbol], u: Symbol) -> dict[str, int]:
    """How many first coefficients of each state no control acts upon.

    Where all states are given at an end of the phase, so are these coefficients: rows
    on them would have no interior if the state stands on its limit there.
    """
    states = cascade.phase.states
    entries = {str(u[k]): u[k] for k in range(u.numel())}
    fixed = all(
        is_fixed(pair) for state in states.values() for pair in (state.start, state.end)
    )
    return {
        name: next(
            (
                k
                for k in range(known[name].numel())
                if depends_on(known[name][k], entries)
            ),
            known[name].numel(),
        )
        if fixed
        else 0
        for name in states
    }
