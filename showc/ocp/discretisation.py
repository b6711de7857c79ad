"""Direct collocation of a problem on a mesh: built once, solved many times.

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

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np
from scipy import sparse

from showc.ocp import scaling
from showc.ocp.layout import Layout, PhaseLayout, lay_out
from showc.ocp.nlp import Block, Kernel, assemble
from showc.ocp.nodes import Scheme, bernstein_derivative, bernstein_values, collocation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.ocp.mesh import Mesh, PhaseMesh
    from showc.ocp.nlp import Program
    from showc.ocp.problem import Phase, Problem

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Rows:
    """A group of constraint rows and what they mean, for messages and bounds."""

    kind: str
    """``dynamics``, ``path``, ``boundary``, ``link``, ``duration``, ``integral``
    or ``half-space``."""
    name: str
    phase: int
    rows: IntArray
    interval: IntArray
    """Mesh interval of each row; -1 where there is none."""
    place: FloatArray
    """Fraction of that interval."""
    scale: float


@dataclass(slots=True)
class _Matrix:
    """Triplets of a sparse matrix under construction."""

    rows: list[IntArray] = field(default_factory=list)
    columns: list[IntArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)

    def add(self, rows: object, columns: object, values: object) -> None:
        r, c, v = np.broadcast_arrays(rows, columns, values)  # type: ignore[arg-type]
        self.rows.append(r.ravel().astype(np.int64))
        self.columns.append(c.ravel().astype(np.int64))
        self.values.append(v.ravel().astype(np.float64))

    def csr(self, height: int, width: int) -> sparse.csr_matrix:
        if not self.rows:
            return sparse.csr_matrix((height, width))
        return sparse.csr_matrix(
            (
                np.concatenate(self.values),
                (np.concatenate(self.rows), np.concatenate(self.columns)),
            ),
            shape=(height, width),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Scales:
    """Scale of each state, control, duration and static, phase by phase."""

    states: tuple[FloatArray, ...]
    controls: tuple[FloatArray, ...]
    durations: tuple[float, ...]
    statics: FloatArray
    objective: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Discretisation:
    """A problem on a mesh as a program, with the meaning of unknowns and rows."""

    layout: Layout
    program: Program
    groups: tuple[Rows, ...]
    unknown_scale: FloatArray
    """Unknown = scale x scaled unknown, shape (unknowns,)."""
    row_scale: FloatArray
    """Row = scale x scaled row, shape (constraints,)."""
    parameter_names: tuple[str, ...]
    half_space_offsets: dict[str, tuple[int, int, int]]
    """For each group of half-spaces: first parameter, rows, states."""


class _Builder:
    """Collects rows and blocks while the phases are walked through."""

    def __init__(
        self, problem: Problem, mesh: Mesh, scheme: Scheme, scales: Scales
    ) -> None:
        self.problem, self.mesh, self.scheme = problem, mesh, scheme
        self.scales = scales
        self.direct = self._integrals_are_direct()
        self.layout = lay_out(problem, mesh, integral_unknowns=not self.direct)
        self.linear = _Matrix()
        self.groups: list[Rows] = []
        self.row_count = 0
        self.pending: list[tuple[Kernel, int, Any, Any, Any, FloatArray]] = []
        self.half_space_offsets: dict[str, tuple[int, int, int]] = {}
        self.symbols = [symbol for symbol, _ in problem.parameters.values()]
        self.q = casadi.vertcat(casadi.SX(0, 1), *self.symbols)
        self.parameter_count = len(self.symbols)
        self.sign = (-1.0 if problem.maximises else 1.0) / scales.objective

    def _integral_symbols(self) -> list[Any]:
        return [s for phase in self.problem.phases for s, _ in phase.integrals]

    def _integrals_are_direct(self) -> bool:
        """Whether integrals enter only the objective, with known factors."""
        symbols = self._integral_symbols()
        if not symbols:
            return True
        vector = casadi.vertcat(*symbols)
        others = [c.symbol for c in self.problem.boundary_constraints]
        if any(casadi.depends_on(expression, vector) for expression in others):
            return False
        factors = casadi.jacobian(self.problem.objective, vector)
        known = [symbol for symbol, _ in self.problem.parameters.values()]
        found = {str(s) for s in casadi.symvar(factors)}
        return found <= {str(s) for s in known}

    def new_rows(
        self,
        kind: str,
        name: str,
        phase: int,
        interval: object,
        place: object,
        scale: float,
    ) -> IntArray:
        """Add rows of one meaning; returns their numbers."""
        where, at = np.broadcast_arrays(interval, place)  # type: ignore[arg-type]
        rows = np.arange(self.row_count, self.row_count + where.size)
        self.row_count += where.size
        self.groups.append(
            Rows(kind, name, phase, rows, where.ravel(), at.ravel(), scale)
        )
        return rows

    def shared_parameters(self, count: int) -> _Matrix:
        """P of a block whose every column sees the problem's parameters."""
        matrix = _Matrix()
        n = len(self.symbols)
        number = np.arange(n)[None, :]
        matrix.add(np.arange(count)[:, None] * n + number, number, 1.0)
        return matrix

    def add_phase(self, index: int) -> None:
        phase, mesh = self.problem.phases[index], self.mesh.phases[index]
        place = self.layout.phases[index]
        points = [np.array(collocation(self.scheme, n)[0]) for n in mesh.points]
        weights = np.concatenate([collocation(self.scheme, n)[1] for n in mesh.points])
        self._add_nodes(index, phase, mesh, place, points, weights)
        if phase.path_constraints and any(mesh.path_points):
            extra = [np.array(p, dtype=np.float64) for p in mesh.path_points]
            self._add_path(index, phase, mesh, place, extra)
        for half_space in phase.half_spaces:
            self._add_half_space(index, half_space, mesh, place)
        if mesh.arc_count > 1:
            scale = self.scales.durations[index]
            row = self.new_rows("duration", "duration", index, -1, 0.0, scale)
            self.linear.add(row, place.durations, 1.0 / scale)

    def _node_inputs(
        self,
        phase: Phase,
        mesh: PhaseMesh,
        place: PhaseLayout,
        points: list[FloatArray],
        used: list[int],
        size: int,
    ) -> _Matrix:
        """A of a block evaluated at ``points``: (x, u, t, h, statics), used rows."""
        matrix = _Matrix()
        position = {number: at for at, number in enumerate(used)}
        nx, nu = len(phase.states), len(phase.controls)
        first = 0
        for k, s in enumerate(points):
            if not s.size:
                continue
            base = (first + np.arange(s.size)) * size
            key = tuple(float(v) for v in s)
            basis = bernstein_values(mesh.points[k], key)
            for i in range(nx):
                if i in position:
                    row = (base + position[i])[:, None]
                    matrix.add(row, place.states[k][:, i][None, :], basis)
            for j in range(nu):
                if nx + j in position:
                    table = place.controls[k][j]
                    values = bernstein_values(table.size - 1, key)
                    row = (base + position[nx + j])[:, None]
                    matrix.add(row, table[None, :], values)
            arc = mesh.arcs[k]
            before = sum(mesh.fractions[m] for m in range(k) if mesh.arcs[m] == arc)
            if nx + nu in position:
                row = base + position[nx + nu]
                matrix.add(row, place.start, 1.0)
                if arc:
                    matrix.add(row[:, None], place.durations[None, :arc], 1.0)
                matrix.add(row, place.durations[arc], before + mesh.fractions[k] * s)
            if nx + nu + 1 in position:
                row = base + position[nx + nu + 1]
                matrix.add(row, place.durations[arc], mesh.fractions[k])
            for m, static in enumerate(self.layout.statics):
                if nx + nu + 2 + m in position:
                    matrix.add(base + position[nx + nu + 2 + m], static, 1.0)
            first += s.size
        return matrix

    def _kernel(self, name: str, z: Any, y: Any) -> tuple[Kernel, list[int]]:  # noqa: ANN401
        """Kernel of ``y`` in the inputs it depends on, and their numbers."""
        pattern = casadi.jacobian_sparsity(y, z)
        used = sorted({int(c) for c in pattern.get_triplet()[1]})
        chosen = casadi.vertcat(casadi.SX(0, 1), *[z[i] for i in used])
        return Kernel.of(name, chosen, self.q, y), used

    def _add_nodes(
        self,
        index: int,
        phase: Phase,
        mesh: PhaseMesh,
        place: PhaseLayout,
        points: list[FloatArray],
        weights: FloatArray,
    ) -> None:
        width = casadi.SX.sym("h")
        z = self._node_symbols(phase, width)
        names = list(phase.states)
        outputs = [width * phase.derivatives[name] for name in names]
        outputs += [c.symbol for c in phase.path_constraints]
        integrands = [width * expression for _, expression in phase.integrals]
        if self.direct and integrands:
            factors = casadi.jacobian(
                self.problem.objective, casadi.vertcat(*[s for s, _ in phase.integrals])
            )
            outputs.append(casadi.mtimes(factors, casadi.vertcat(*integrands)))
        elif integrands:
            outputs += integrands
        y = casadi.vertcat(*outputs)
        kernel, used = self._kernel(f"node{index}", z, y)
        count, ny = weights.size, y.numel()
        inputs = self._node_inputs(phase, mesh, place, points, used, len(used))

        rows = _Matrix()
        column = np.arange(count) * ny
        interval = np.repeat(np.arange(mesh.intervals), mesh.points)
        fraction = np.concatenate(points)
        for i, name in enumerate(names):
            scale = float(self.scales.states[index][i])
            row = self.new_rows("dynamics", name, index, interval, fraction, scale)
            rows.add(row, column + i, -1.0 / scale)
            first = 0
            for k, s in enumerate(points):
                slope = bernstein_derivative(mesh.points[k], tuple(float(v) for v in s))
                block = row[first : first + s.size][:, None]
                self.linear.add(block, place.states[k][:, i][None, :], slope / scale)
                first += s.size
        for c, constraint in enumerate(phase.path_constraints):
            scale = self._row_scale(constraint)
            row = self.new_rows(
                "path", constraint.name, index, interval, fraction, scale
            )
            rows.add(row, column + len(names) + c, 1.0 / scale)
        objective = np.zeros(count * ny)
        after = len(names) + len(phase.path_constraints)
        if self.direct and integrands:
            objective[column + after] = self.sign * weights
        elif integrands:
            for m, unknown in enumerate(self.layout.integrals[index]):
                row = self.new_rows("integral", f"integral {m}", index, -1, 0.0, 1.0)
                self.linear.add(row, unknown, 1.0)
                rows.add(row[0], column + after + m, -weights)
        parameters = self.shared_parameters(count)
        self.pending.append((kernel, count, inputs, parameters, rows, objective))

    def _node_symbols(self, phase: Phase, width: Any) -> Any:  # noqa: ANN401
        return casadi.vertcat(
            *[state.quantity.symbol for state in phase.states.values()],
            *[control.quantity.symbol for control in phase.controls.values()],
            phase.time,
            width,
            *[static.symbol for static in self.problem.statics],
        )

    def _row_scale(self, constraint: Any) -> float:  # noqa: ANN401
        if constraint.scale is not None:
            return float(constraint.scale)
        bounds = [
            float(b) if isinstance(b, (int, float)) else np.inf
            for b in (constraint.lower, constraint.upper)
        ]
        return scaling.from_bounds(*bounds)

    def _add_path(
        self,
        index: int,
        phase: Phase,
        mesh: PhaseMesh,
        place: PhaseLayout,
        points: list[FloatArray],
    ) -> None:
        """Path constraints at points besides the collocation points."""
        z = self._node_symbols(phase, casadi.SX.sym("h"))
        y = casadi.vertcat(*[c.symbol for c in phase.path_constraints])
        kernel, used = self._kernel(f"path{index}", z, y)
        inputs = self._node_inputs(phase, mesh, place, points, used, len(used))
        fraction = np.concatenate(points)
        count, ny = fraction.size, y.numel()
        interval = np.repeat(np.arange(mesh.intervals), [p.size for p in points])
        rows = _Matrix()
        for c, constraint in enumerate(phase.path_constraints):
            scale = self._row_scale(constraint)
            row = self.new_rows(
                "path", constraint.name, index, interval, fraction, scale
            )
            rows.add(row, np.arange(count) * ny + c, 1.0 / scale)
        self.pending.append(
            (
                kernel,
                count,
                inputs,
                self.shared_parameters(count),
                rows,
                np.zeros(count * ny),
            )
        )

    def _add_half_space(
        self,
        index: int,
        half_space: Any,  # noqa: ANN401
        mesh: PhaseMesh,
        place: PhaseLayout,
    ) -> None:
        names = list(self.problem.phases[index].states)
        chosen = [names.index(name) for name in half_space.states]
        size, number = len(chosen), half_space.rows
        z = casadi.SX.sym("c", size)
        normals = casadi.SX.sym("n", number * size)
        y = casadi.mtimes(casadi.reshape(normals, size, number).T, z)
        kernel = Kernel.of(f"half{len(self.half_space_offsets)}", z, normals, y)
        coefficients = np.vstack([table[:, chosen] for table in place.states])
        interval = np.repeat(
            np.arange(mesh.intervals), np.asarray(mesh.points, dtype=int) + 1
        )
        fraction = np.concatenate([np.linspace(0.0, 1.0, n + 1) for n in mesh.points])
        count = interval.size
        inputs, parameters, rows = _Matrix(), _Matrix(), _Matrix()
        inputs.add(np.arange(count * size), coefficients.ravel(), 1.0)
        first = self.parameter_count
        step = np.arange(number * size)[None, :]
        parameters.add(
            np.arange(count)[:, None] * number * size + step,
            first + interval[:, None] * number * size + step,
            1.0,
        )
        self.parameter_count += mesh.intervals * number * size
        self.half_space_offsets[half_space.name] = (first, number, size)
        scale = float(self.scales.states[index][chosen].max())
        row = self.new_rows(
            "half-space",
            half_space.name,
            index,
            np.repeat(interval, number),
            np.repeat(fraction, number),
            scale,
        )
        rows.add(row, np.arange(count * number), 1.0 / scale)
        self.pending.append(
            (kernel, count, inputs, parameters, rows, np.zeros(count * number))
        )

    def add_boundary(self) -> None:
        """Objective of end values, boundary constraints, links."""
        symbols, sources = [], []
        for phase, place, mesh in zip(
            self.problem.phases, self.layout.phases, self.mesh.phases, strict=True
        ):
            symbols += [phase.initial_time, phase.duration]
            sources += [[place.start], list(place.durations)]
            for i, state in enumerate(phase.states.values()):
                symbols += [state.initial, state.final]
                sources += [[place.states[0][0, i]], [place.states[-1][-1, i]]]
            for j, control in enumerate(phase.controls.values()):
                symbols += [control.initial, control.final]
                sources += [[place.controls[0][j][0]], [place.controls[-1][j][-1]]]
            del mesh
        symbols += [static.symbol for static in self.problem.statics]
        sources += [[static] for static in self.layout.statics]
        objective = casadi.SX(self.problem.objective)
        integrals = self._integral_symbols()
        if self.direct and integrals:
            zero = [casadi.SX(0)] * len(integrals)
            objective = casadi.substitute(
                objective, casadi.vertcat(*integrals), casadi.vertcat(*zero)
            )
        elif integrals:
            symbols += integrals
            sources += [[u] for table in self.layout.integrals for u in table]
        constraints = self.problem.boundary_constraints
        y = casadi.vertcat(objective, *[c.symbol for c in constraints])
        kernel, used = self._kernel("boundary", casadi.vertcat(*symbols), y)
        inputs, rows = _Matrix(), _Matrix()
        for at, number in enumerate(used):
            inputs.add(at, np.asarray(sources[number]), 1.0)
        for c, constraint in enumerate(constraints):
            scale = self._row_scale(constraint)
            row = self.new_rows("boundary", constraint.name, 0, -1, 0.0, scale)
            rows.add(row, 1 + c, 1.0 / scale)
        weight = np.zeros(y.numel())
        weight[0] = self.sign
        self.pending.append(
            (kernel, 1, inputs, self.shared_parameters(1), rows, weight)
        )
        for before, after, names in self.problem.links:
            self._link(before, after, names)

    def _link(self, before: int, after: int, names: tuple[str, ...]) -> None:
        first, second = self.layout.phases[before], self.layout.phases[after]
        scale = self.scales.durations[before]
        row = self.new_rows("link", "time", after, -1, 0.0, scale)
        self.linear.add(row, second.start, 1.0 / scale)
        self.linear.add(row, first.start, -1.0 / scale)
        self.linear.add(row, first.durations, -1.0 / scale)
        for name in names:
            i = list(self.problem.phases[before].states).index(name)
            j = list(self.problem.phases[after].states).index(name)
            scale = float(self.scales.states[after][j])
            row = self.new_rows("link", name, after, -1, 0.0, scale)
            self.linear.add(row, second.states[0][0, j], 1.0 / scale)
            self.linear.add(row, first.states[-1][-1, i], -1.0 / scale)

    def unknown_scale(self) -> FloatArray:
        """Scale of every unknown."""
        scale = np.ones(self.layout.size)
        for index, place in enumerate(self.layout.phases):
            scale[place.start] = self.scales.durations[index]
            scale[place.durations] = self.scales.durations[index]
            for table in place.states:
                scale[table] = self.scales.states[index][None, :]
            for tables in place.controls:
                for j, control in enumerate(tables):
                    scale[control] = self.scales.controls[index][j]
        scale[self.layout.statics] = self.scales.statics
        return scale

    def finish(self) -> Discretisation:
        """Assemble everything collected."""
        scale = self.unknown_scale()
        diagonal = sparse.diags(scale)
        size, n = self.layout.size, self.parameter_count
        blocks = []
        for kernel, count, inputs, parameters, rows, objective in self.pending:
            nz = kernel.value.size1_in(0)
            nq = kernel.value.size1_in(1)
            ny = kernel.value.size1_out(0)
            blocks.append(
                Block(
                    kernel,
                    count,
                    (inputs.csr(count * nz, size) @ diagonal).tocsr(),
                    parameters.csr(count * nq, n),
                    rows.csr(self.row_count, count * ny).tocsc(),
                    objective,
                )
            )
        linear = (self.linear.csr(self.row_count, size) @ diagonal).tocsr()
        row_scale = np.ones(self.row_count)
        for group in self.groups:
            row_scale[group.rows] = group.scale
        return Discretisation(
            self.layout,
            assemble(blocks, linear, n),
            tuple(self.groups),
            scale,
            row_scale,
            tuple(self.problem.parameters),
            self.half_space_offsets,
        )


def discretise(
    problem: Problem, mesh: Mesh, scheme: Scheme, scales: Scales
) -> Discretisation:
    """Write ``problem`` on ``mesh`` as a program.

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
    builder = _Builder(problem, mesh, scheme, scales)
    for index in range(len(problem.phases)):
        builder.add_phase(index)
    builder.add_boundary()
    return builder.finish()
