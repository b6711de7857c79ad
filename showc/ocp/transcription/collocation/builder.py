"""A program under construction: numbers of unknowns, rows and their meaning."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np
from scipy import sparse

from showc.ocp import scaling
from showc.ocp.transcription.collocation.nlp import Block, Kernel, assemble

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.ocp.coupling import Imposed
    from showc.ocp.mesh import Mesh, PhaseMesh
    from showc.ocp.nodes import Scheme
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.quantity import Quantity
    from showc.ocp.transcription.collocation.nlp import Program


@dataclass(frozen=True, slots=True)
class PhaseLayout:
    """Numbers of the unknowns of one phase."""

    start: int
    """Unknown of the start time."""
    durations: IntArray
    """Unknowns of the arcs' durations, shape (arcs,)."""
    states: tuple[IntArray, ...]
    """For each interval: Bernstein coefficients, shape (N + 1, states)."""
    controls: tuple[tuple[IntArray, ...], ...]
    """For each interval and control: Bernstein coefficients, shape (degree + 1,)."""

    def state_row(self, index: int) -> list[IntArray]:
        """Coefficients of one state, interval by interval."""
        return [table[:, index] for table in self.states]

    def control_row(self, index: int) -> list[IntArray]:
        """Coefficients of one control, interval by interval."""
        return [tables[index] for tables in self.controls]


@dataclass(frozen=True, slots=True)
class Layout:
    """Numbers of all unknowns: phases, then statics, then integrals."""

    phases: tuple[PhaseLayout, ...]
    statics: IntArray
    integrals: tuple[IntArray, ...]
    """For each phase: unknowns of its integrals."""
    size: int


def _phase_layout(phase: Phase, mesh: PhaseMesh, first: int) -> tuple[PhaseLayout, int]:
    following = first
    count = len(phase.states)

    def take(number: int) -> IntArray:
        nonlocal following
        following += number
        return np.arange(following - number, following)

    start = int(take(1)[0])
    durations = take(mesh.arc_count)
    border = take(count)
    previous: dict[str, IntArray] = {}
    states, controls = [], []
    for k, points in enumerate(mesh.points):
        inner = take(points * count).reshape(points, count)
        states.append(np.vstack([border[None, :], inner]))
        border = inner[-1]
        tables = []
        for name, control in phase.controls.items():
            degree = control_degree(mesh, k, name, control.degree)
            if control.continuous and degree > 0 and name in previous:
                table = np.concatenate([previous[name][-1:], take(degree)])
            else:
                table = take(degree + 1)
            previous[name] = table
            tables.append(table)
        controls.append(tuple(tables))
    return PhaseLayout(start, durations, tuple(states), tuple(controls)), following


def control_degree(
    mesh: PhaseMesh, interval: int, name: str, degree: int | None
) -> int:
    """Degree of a control on one interval: the mesh's, the problem's, or N - 1."""
    if name in mesh.control_degrees:
        chosen = mesh.control_degrees[name][interval]
        return mesh.points[interval] - 1 if chosen < 0 else chosen
    return mesh.points[interval] - 1 if degree is None else degree


def lay_out(problem: Problem, mesh: Mesh, *, integral_unknowns: bool) -> Layout:
    """Give every unknown of ``problem`` on ``mesh`` its number."""
    following = 0
    phases = []
    for phase, phase_mesh in zip(problem.phases, mesh.phases, strict=True):
        layout, following = _phase_layout(phase, phase_mesh, following)
        phases.append(layout)
    statics = np.arange(following, following + len(problem.statics))
    following += len(problem.statics)
    integrals = []
    for phase in problem.phases:
        count = len(phase.integrals) if integral_unknowns else 0
        integrals.append(np.arange(following, following + count))
        following += count
    return Layout(tuple(phases), statics, tuple(integrals), following)


@dataclass(slots=True)
class Triplets:
    """Triplets of a sparse matrix under construction."""

    rows: list[IntArray] = field(default_factory=list)
    columns: list[IntArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)

    def add(self, rows: object, columns: object, values: object) -> None:
        """Add entries; the three arguments are broadcast against each other."""
        r, c, v = np.broadcast_arrays(rows, columns, values)  # type: ignore[arg-type]
        self.rows.append(r.ravel().astype(np.int64))
        self.columns.append(c.ravel().astype(np.int64))
        self.values.append(v.ravel().astype(np.float64))

    def csr(self, height: int, width: int) -> sparse.csr_matrix:
        """Sum of all entries as a matrix of that shape."""
        if not self.rows:
            return sparse.csr_matrix((height, width))
        return sparse.csr_matrix(
            (
                np.concatenate(self.values),
                (np.concatenate(self.rows), np.concatenate(self.columns)),
            ),
            shape=(height, width),
        )


@dataclass(frozen=True, slots=True)
class Rows:
    """A group of constraint rows and what they mean, for messages and bounds."""

    kind: str
    """``dynamics``, ``path``, ``boundary``, ``link``, ``duration``, ``integral``,
    ``half-space`` or ``coupling``."""
    name: str
    phase: int
    rows: IntArray
    interval: IntArray
    """Mesh interval of each row; -1 where there is none."""
    place: FloatArray
    """Fraction of that interval."""
    scale: float


@dataclass(frozen=True, slots=True, eq=False)
class Scales:
    """Scale of each state, control, duration and static, phase by phase."""

    states: tuple[FloatArray, ...]
    controls: tuple[FloatArray, ...]
    durations: tuple[float, ...]
    statics: FloatArray
    objective: float | None = None
    """``None``: taken from the objective's slopes at and about the start."""
    constraints: Mapping[tuple[str, str], float] = field(default_factory=dict)
    """Of path constraints by phase and name, and of boundary constraints (phase ``""``)
    where bounds do not tell."""


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
    half_space_offsets: dict[str, tuple[int, int, int]]
    """For each group of half-spaces: first parameter, rows, states."""
    coupling_margins: dict[tuple[int, str], float]
    """By phase and name: by how much an imposed coupling is tightened."""


@dataclass(frozen=True, slots=True, eq=False)
class _Pending:
    """A block whose number of rows and unknowns is not yet final."""

    kernel: Kernel
    count: int
    inputs: Triplets
    parameters: Triplets
    rows: Triplets
    objective: FloatArray


class Builder:
    """Collects rows and blocks while the phases are walked through."""

    def __init__(
        self,
        problem: Problem,
        mesh: Mesh,
        scheme: Scheme,
        scales: Scales,
        couplings: Sequence[Imposed] = (),
    ) -> None:
        self.problem, self.mesh, self.scheme = problem, mesh, scheme
        self.couplings = couplings
        self.scales = scales
        self.direct = self._integrals_are_direct()
        self.layout = lay_out(problem, mesh, integral_unknowns=not self.direct)
        self.linear = Triplets()
        self.groups: list[Rows] = []
        self.row_count = 0
        self.pending: list[_Pending] = []
        self.half_space_offsets: dict[str, tuple[int, int, int]] = {}
        self.symbols = [symbol for symbol, _ in problem.parameters.values()]
        self.q = casadi.vertcat(casadi.SX(0, 1), *self.symbols)
        self.parameter_count = len(self.symbols)
        self.sign = -1.0 if problem.maximises else 1.0

    def integral_symbols(self) -> list[Any]:
        """Symbols of all integrals, phase by phase."""
        return [s for phase in self.problem.phases for s, _ in phase.integrals]

    def _integrals_are_direct(self) -> bool:
        """Whether integrals enter only the objective, with known factors."""
        symbols = self.integral_symbols()
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
        interval: object = -1,
        place: object = 0.0,
        *,
        scale: float = 1.0,
    ) -> IntArray:
        """Add rows of one meaning; returns their numbers."""
        where, at = np.broadcast_arrays(interval, place)  # type: ignore[arg-type]
        rows = np.arange(self.row_count, self.row_count + where.size)
        self.row_count += where.size
        self.groups.append(
            Rows(kind, name, phase, rows, where.ravel(), at.ravel(), scale)
        )
        return rows

    def shared_parameters(self, count: int) -> Triplets:
        """P of a block whose every column sees the problem's parameters."""
        matrix = Triplets()
        n = len(self.symbols)
        number = np.arange(n)[None, :]
        matrix.add(np.arange(count)[:, None] * n + number, number, 1.0)
        return matrix

    def add_block(
        self,
        kernel: Kernel,
        count: int,
        *,
        inputs: Triplets,
        rows: Triplets,
        parameters: Triplets | None = None,
        objective: FloatArray | None = None,
    ) -> None:
        """Add a block; by default its columns see the problem's parameters."""
        outputs = count * int(kernel.value.size1_out(0))
        self.pending.append(
            _Pending(
                kernel,
                count,
                inputs,
                parameters or self.shared_parameters(count),
                rows,
                np.zeros(outputs) if objective is None else objective,
            )
        )

    def kernel(self, name: str, z: Any, y: Any) -> tuple[Kernel, list[int]]:  # noqa: ANN401
        """Kernel of ``y`` in the inputs it depends on, and their numbers."""
        pattern = casadi.jacobian_sparsity(y, z)
        used = sorted({int(c) for c in pattern.get_triplet()[1]})
        chosen = casadi.vertcat(casadi.SX(0, 1), *[z[i] for i in used])
        return Kernel.of(name, chosen, self.q, y), used

    def row_scale(self, constraint: Quantity, phase: str = "") -> float:
        """Scale of a constraint's rows: as given, from its bounds, or its slopes."""
        if constraint.scale is not None:
            return float(constraint.scale)
        bounds = [
            float(b) if isinstance(b, (int, float)) else np.inf
            for b in (constraint.lower, constraint.upper)
        ]
        if not any(np.isfinite(bound) and bound != 0.0 for bound in bounds):
            return self.scales.constraints.get((phase, constraint.name), 1.0)
        return scaling.from_bounds(*bounds)

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
        for part in self.pending:
            kernel, count = part.kernel, part.count
            nz = kernel.value.size1_in(0)
            nq = kernel.value.size1_in(1)
            ny = kernel.value.size1_out(0)
            blocks.append(
                Block(
                    kernel,
                    count,
                    (part.inputs.csr(count * nz, size) @ diagonal).tocsr(),
                    part.parameters.csr(count * nq, n),
                    part.rows.csr(self.row_count, count * ny).tocsc(),
                    part.objective,
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
            self.half_space_offsets,
            {(entry.phase, entry.name): entry.margin for entry in self.couplings},
        )
