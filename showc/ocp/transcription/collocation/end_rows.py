"""Objective of end values, boundary constraints, and links between phases."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi
import numpy as np

from showc.ocp.transcription.collocation.triplets import Triplets

if TYPE_CHECKING:
    from showc.ocp.transcription.collocation.builder import Builder


def add_boundary(builder: Builder) -> None:
    """Add the objective of end values, boundary constraints and links."""
    symbols, sources = [], []
    for phase, place in zip(builder.problem.phases, builder.layout.phases, strict=True):
        symbols += [phase.initial_time, phase.duration]
        sources += [[place.start], list(place.durations)]
        for i, state in enumerate(phase.states.values()):
            symbols += [state.initial, state.final]
            sources += [[place.states[0][0, i]], [place.states[-1][-1, i]]]
        for j, control in enumerate(phase.controls.values()):
            symbols += [control.initial, control.final]
            sources += [[place.controls[0][j][0]], [place.controls[-1][j][-1]]]
    symbols += [static.symbol for static in builder.problem.statics]
    sources += [[static] for static in builder.layout.statics]
    objective = casadi.SX(builder.problem.objective)
    integrals = builder.integral_symbols()
    if builder.direct and integrals:
        zero = [casadi.SX(0)] * len(integrals)
        objective = casadi.substitute(
            objective, casadi.vertcat(*integrals), casadi.vertcat(*zero)
        )
    elif integrals:
        symbols += integrals
        sources += [[u] for table in builder.layout.integrals for u in table]
    constraints = builder.problem.boundary_constraints
    y = casadi.vertcat(objective, *[c.symbol for c in constraints])
    kernel, used = builder.kernel("boundary", casadi.vertcat(*symbols), y)
    inputs, rows = Triplets(), Triplets()
    for at, number in enumerate(used):
        inputs.add(at, np.asarray(sources[number]), 1.0)
    for c, constraint in enumerate(constraints):
        scale = builder.row_scale(constraint)
        row = builder.new_rows("boundary", constraint.name, 0, scale=scale)
        rows.add(row, 1 + c, 1.0 / scale)
    weight = np.zeros(y.numel())
    weight[0] = builder.sign
    builder.add_block(kernel, 1, inputs=inputs, rows=rows, objective=weight)
    for before, after, names in builder.problem.links:
        _link(builder, before, after, names)


def _link(builder: Builder, before: int, after: int, names: tuple[str, ...]) -> None:
    first, second = builder.layout.phases[before], builder.layout.phases[after]
    scale = builder.scales.durations[before]
    row = builder.new_rows("link", "time", after, scale=scale)
    builder.linear.add(row, second.start, 1.0 / scale)
    builder.linear.add(row, first.start, -1.0 / scale)
    builder.linear.add(row, first.durations, -1.0 / scale)
    for name in names:
        i = list(builder.problem.phases[before].states).index(name)
        j = list(builder.problem.phases[after].states).index(name)
        scale = float(builder.scales.states[after][j])
        row = builder.new_rows("link", name, after, scale=scale)
        builder.linear.add(row, second.states[0][0, j], 1.0 / scale)
        builder.linear.add(row, first.states[-1][-1, i], -1.0 / scale)
