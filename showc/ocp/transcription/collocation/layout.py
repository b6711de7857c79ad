"""Where every unknown of a transcription lies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import IntArray
    from showc.ocp.mesh import Mesh, PhaseMesh
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem


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
