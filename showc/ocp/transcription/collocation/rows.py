"""A problem on a mesh as a program: rows of phases, their ends and links.

Unknowns are Bernstein coefficients: of each state on each mesh interval (degree N
for N collocation points, neighbours share the border), of each control on each
interval (any degree), the durations of the arcs, start times and statics. With c
the coefficients of interval k of width h and f the dynamics, the defects are

    sum_j D_ij c_j - h f(x_i, u_i, t_i) = 0,   x_i = sum_j B_ij c_j,   i = 1 .. N,

D and B being derivative and value of the Bernstein basis at the points. Bounds of
states and controls are bounds of unknowns; by the hull property they hold at every
instant, not only at the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.mesh import alike
from showc.ocp.nodes import bernstein_derivative, bernstein_values, collocation
from showc.ocp.transcription.collocation.builder import Builder, Triplets
from showc.ocp.transcription.collocation.nlp import Kernel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.ocp.coupling import Imposed
    from showc.ocp.mesh import Mesh, PhaseMesh
    from showc.ocp.nodes import Scheme
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.quantity import HalfSpaces
    from showc.ocp.transcription.collocation.builder import (
        Discretisation,
        PhaseLayout,
        Scales,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """One phase with its mesh and the place of its unknowns."""

    index: int
    phase: Phase
    mesh: PhaseMesh
    place: PhaseLayout


def discretise(
    problem: Problem,
    mesh: Mesh,
    scheme: Scheme,
    scales: Scales,
    couplings: Sequence[Imposed] = (),
) -> Discretisation:
    """Write ``problem`` on ``mesh`` as a program, with the ``couplings`` imposed.

    Raises
    ------
    ValueError
        If the problem is not completely stated or the mesh has other phases.
    """
    problem.check()
    if len(mesh.phases) != len(problem.phases):
        raise ValueError(
            f"mesh for {len(mesh.phases)} phases, problem {problem.name!r} has "
            f"{len(problem.phases)}"
        )
    builder = Builder(problem, mesh, scheme, scales, couplings)
    for index in range(len(problem.phases)):
        _add_phase(builder, index)
    _add_boundary(builder)
    return builder.finish()


def _add_phase(builder: Builder, index: int) -> None:
    """Add all rows and blocks of one phase."""
    phase, mesh = builder.problem.phases[index], builder.mesh.phases[index]
    part = _Part(index, phase, mesh, builder.layout.phases[index])
    _add_nodes(builder, part)
    if phase.path_constraints and any(mesh.path_points):
        _add_path(builder, part)
    for half_space in phase.half_spaces:
        _add_half_space(builder, part, half_space)
    for imposed in builder.couplings:
        if imposed.phase == index:
            _add_coupling(builder, part, imposed)
    if mesh.arc_count > 1:
        scale = builder.scales.durations[index]
        row = builder.new_rows("duration", "duration", index, scale=scale)
        builder.linear.add(row, part.place.durations, 1.0 / scale)


def _add_nodes(builder: Builder, part: _Part) -> None:
    """Defects, path constraints and integrals at the collocation points."""
    phase, mesh, place, index = part.phase, part.mesh, part.place, part.index
    points = [np.array(collocation(builder.scheme, n)[0]) for n in mesh.points]
    weights = np.concatenate([collocation(builder.scheme, n)[1] for n in mesh.points])
    width = casadi.SX.sym("h")
    names = list(phase.states)
    outputs = [width * phase.derivatives[name] for name in names]
    outputs += [c.symbol for c in phase.path_constraints]
    integrands = [width * expression for _, expression in phase.integrals]
    if builder.direct and integrands:
        symbols = casadi.vertcat(*[symbol for symbol, _ in phase.integrals])
        factors = casadi.jacobian(builder.problem.objective, symbols)
        outputs.append(casadi.mtimes(factors, casadi.vertcat(*integrands)))
    elif integrands:
        outputs += integrands
    y = casadi.vertcat(*outputs)
    z = _node_symbols(builder, phase, width)
    kernel, used = builder.kernel(f"node{index}", z, y)
    count, ny = weights.size, y.numel()

    rows = Triplets()
    column = np.arange(count) * ny
    interval = np.repeat(np.arange(mesh.intervals), mesh.points)
    fraction = np.concatenate(points)
    defects = np.zeros((len(names), count), dtype=np.int64)
    scales = np.asarray(builder.scales.states[index], dtype=np.float64)
    for i, name in enumerate(names):
        scale = float(scales[i])
        row = builder.new_rows("dynamics", name, index, interval, fraction, scale=scale)
        rows.add(row, column + i, -1.0 / scale)
        defects[i] = row
    first = np.cumsum(mesh.points) - mesh.points
    for n, chosen in alike(mesh.points):
        slope = bernstein_derivative(n, tuple(points[chosen[0]].tolist()))
        tables = np.stack([place.states[k] for k in chosen])
        block = defects[:, first[chosen, None] + np.arange(n)]
        builder.linear.add(
            block[..., None],
            tables.transpose(2, 0, 1)[:, :, None, :],
            (slope / scales[:, None, None])[:, None],
        )
    for c, constraint in enumerate(phase.path_constraints):
        scale = builder.row_scale(constraint, phase.name)
        title = constraint.name
        row = builder.new_rows("path", title, index, interval, fraction, scale=scale)
        rows.add(row, column + len(names) + c, 1.0 / scale)
    objective = np.zeros(count * ny)
    after = len(names) + len(phase.path_constraints)
    if builder.direct and integrands:
        objective[column + after] = builder.sign * weights
    elif integrands:
        for m, unknown in enumerate(builder.layout.integrals[index]):
            row = builder.new_rows("integral", f"integral {m}", index)
            builder.linear.add(row, unknown, 1.0)
            rows.add(row[0], column + after + m, -weights)
    inputs = _node_inputs(builder, part, points, used)
    builder.add_block(kernel, count, inputs=inputs, rows=rows, objective=objective)


def _node_symbols(builder: Builder, phase: Phase, width: Any) -> Any:  # noqa: ANN401
    """Stack the inputs of a node: states, controls, time, width, statics."""
    return casadi.vertcat(
        *[state.quantity.symbol for state in phase.states.values()],
        *[control.quantity.symbol for control in phase.controls.values()],
        phase.time,
        width,
        *[static.symbol for static in builder.problem.statics],
    )


def _node_inputs(
    builder: Builder, part: _Part, points: list[FloatArray], used: list[int]
) -> Triplets:
    """Matrix from unknowns to the ``used`` inputs at ``points`` of each interval."""
    phase, mesh, place = part.phase, part.mesh, part.place
    matrix = Triplets()
    nx, nu = len(phase.states), len(phase.controls)
    arcs, fractions = np.asarray(mesh.arcs), np.asarray(mesh.fractions)
    before = np.zeros(mesh.intervals)
    for arc in range(mesh.arc_count):
        own = arcs == arc
        before[own] = np.concatenate([[0.0], np.cumsum(fractions[own])[:-1]])
    sizes = [s.size for s in points]
    first = np.cumsum(sizes) - sizes
    degrees = [tuple(table.size - 1 for table in tables) for tables in place.controls]
    places = [tuple(s.tolist()) for s in points]
    for (n, key, degree), chosen in alike(
        zip(mesh.points, places, degrees, strict=True)
    ):
        s = np.array(key)
        rows = (first[chosen, None] + np.arange(s.size)) * len(used)
        states = np.stack([place.states[k] for k in chosen])
        for at, number in enumerate(used):
            row = rows + at
            if number < nx:
                basis = bernstein_values(n, key)
                matrix.add(row[..., None], states[:, None, :, number], basis)
            elif number < nx + nu:
                j = number - nx
                table = np.stack([place.controls[k][j] for k in chosen])
                basis = bernstein_values(degree[j], key)
                matrix.add(row[..., None], table[:, None], basis)
            elif number == nx + nu:
                own = place.durations[arcs[chosen], None]
                matrix.add(row, place.start, 1.0)
                for arc in range(mesh.arc_count):
                    matrix.add(row[arcs[chosen] > arc], place.durations[arc], 1.0)
                along = before[chosen, None] + fractions[chosen, None] * s
                matrix.add(row, own, along)
            elif number == nx + nu + 1:
                own = place.durations[arcs[chosen], None]
                matrix.add(row, own, fractions[chosen, None])
            else:
                matrix.add(row, builder.layout.statics[number - nx - nu - 2], 1.0)
    return matrix


def _add_path(builder: Builder, part: _Part) -> None:
    """Path constraints at points besides the collocation points."""
    phase, mesh = part.phase, part.mesh
    points = [np.array(places, dtype=np.float64) for places in mesh.path_points]
    z = _node_symbols(builder, phase, casadi.SX.sym("h"))
    y = casadi.vertcat(*[c.symbol for c in phase.path_constraints])
    kernel, used = builder.kernel(f"path{part.index}", z, y)
    fraction = np.concatenate(points)
    interval = np.repeat(np.arange(mesh.intervals), [p.size for p in points])
    rows = Triplets()
    for c, constraint in enumerate(phase.path_constraints):
        scale = builder.row_scale(constraint, phase.name)
        row = builder.new_rows(
            "path", constraint.name, part.index, interval, fraction, scale=scale
        )
        rows.add(row, np.arange(fraction.size) * y.numel() + c, 1.0 / scale)
    inputs = _node_inputs(builder, part, points, used)
    builder.add_block(kernel, fraction.size, inputs=inputs, rows=rows)


def _add_coupling(builder: Builder, part: _Part, imposed: Imposed) -> None:
    """One coupling where it is imposed."""
    coupling = next(c for c in part.phase.couplings if c.name == imposed.name)
    points = imposed.points(part.mesh, builder.scheme)
    fraction = np.concatenate(points)
    interval = np.repeat(np.arange(part.mesh.intervals), [p.size for p in points])
    z = _node_symbols(builder, part.phase, casadi.SX.sym("h"))
    name = f"coupling{part.index}_{part.phase.couplings.index(coupling)}"
    kernel, used = builder.kernel(name, z, coupling.symbol)
    scale = builder.row_scale(coupling)
    row = builder.new_rows(
        "coupling", imposed.name, part.index, interval, fraction, scale=scale
    )
    rows = Triplets()
    rows.add(row, np.arange(fraction.size), 1.0 / scale)
    inputs = _node_inputs(builder, part, points, used)
    builder.add_block(kernel, fraction.size, inputs=inputs, rows=rows)


def _add_half_space(builder: Builder, part: _Part, half_space: HalfSpaces) -> None:
    """Linear constraints on Bernstein coefficients, normals given per solve."""
    mesh, names = part.mesh, list(part.phase.states)
    chosen = [names.index(name) for name in half_space.states]
    size, number = len(chosen), half_space.rows
    z = casadi.SX.sym("c", size)
    normals = casadi.SX.sym("n", number * size)
    y = casadi.mtimes(casadi.reshape(normals, size, number).T, z)
    kernel = Kernel.of(f"half{len(builder.half_space_offsets)}", z, normals, y)
    coefficients = np.vstack([table[:, chosen] for table in part.place.states])
    interval = np.repeat(
        np.arange(mesh.intervals), np.asarray(mesh.points, dtype=int) + 1
    )
    fraction = np.concatenate([np.linspace(0.0, 1.0, n + 1) for n in mesh.points])
    count = interval.size
    inputs, parameters, rows = Triplets(), Triplets(), Triplets()
    inputs.add(np.arange(count * size), coefficients.ravel(), 1.0)
    first = builder.parameter_count
    step = np.arange(number * size)[None, :]
    parameters.add(
        np.arange(count)[:, None] * number * size + step,
        first + interval[:, None] * number * size + step,
        1.0,
    )
    builder.parameter_count += mesh.intervals * number * size
    builder.half_space_offsets[half_space.name] = (first, number, size)
    scale = float(builder.scales.states[part.index][chosen].max())
    row = builder.new_rows(
        "half-space",
        half_space.name,
        part.index,
        np.repeat(interval, number),
        np.repeat(fraction, number),
        scale=scale,
    )
    rows.add(row, np.arange(count * number), 1.0 / scale)
    builder.add_block(kernel, count, inputs=inputs, rows=rows, parameters=parameters)


def _add_boundary(builder: Builder) -> None:
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
