"""Carry multipliers from a solution on one mesh to the program of another.

Costates and path multipliers are functions of time and are interpolated. The
multiplier of a bound acts on one Bernstein coefficient; spread over that
coefficient's share of its interval it is a density, which is gathered again by the
coefficients of the new mesh.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.nodes import collocation
from showc.ocp.solution import Multipliers
from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.ocp.solution import PhaseSolution, Solution
    from showc.ocp.transcription.collocation.transcription import Transcription


def _nodal_at(phase: PhaseSolution, nodal: FloatArray, times: FloatArray) -> FloatArray:
    """Interpolate values at the collocation points: (times, components)."""
    breaks = phase.states.breaks
    first = np.concatenate([[0], np.cumsum(phase.mesh.points)])
    interval = np.clip(
        np.searchsorted(breaks, times, side="right") - 1, 0, breaks.size - 2
    )
    out = np.zeros((times.size, nodal.shape[1]))
    for k in np.unique(interval):
        inside = interval == k
        n = phase.mesh.points[k]
        s = (times[inside] - breaks[k]) / (breaks[k + 1] - breaks[k])
        nodes = collocation(phase.scheme, n)[0]
        matrix = np.linalg.solve(
            bernstein_basis(n - 1, nodes).T, bernstein_basis(n - 1, s).T
        ).T
        out[inside] = matrix @ nodal[first[k] : first[k + 1]]
    return out


def _shares(
    breaks: FloatArray, row: list[IntArray]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Unknown, start and end of the share of time of every coefficient of a row."""
    unknowns, left, right = [], [], []
    for k, table in enumerate(row):
        edges = np.linspace(breaks[k], breaks[k + 1], table.size + 1)
        unknowns.append(table)
        left.append(edges[:-1])
        right.append(edges[1:])
    return np.concatenate(unknowns), np.concatenate(left), np.concatenate(right)


def transfer(
    old: Transcription,
    solution: Solution,
    new: Transcription,
    point: FloatArray,
    objective_scale: float,
) -> Multipliers:
    """Multipliers for ``new`` at its scaled starting ``point``.

    ``objective_scale`` is what the objective of ``new`` is divided by.
    """
    before, after = old.discretisation, new.discretisation
    of_bounds = np.zeros(after.layout.size)
    of_rows = np.zeros(after.row_scale.size)
    pull = solution.multipliers.of_bounds / before.unknown_scale
    pull = pull * solution.multipliers.objective_scale
    for p, phase in enumerate(solution.phases):
        mesh = new.mesh.phases[p]
        place, former = after.layout.phases[p], before.layout.phases[p]
        unknowns = point * after.unknown_scale
        widths = mesh.widths(unknowns[place.durations])
        # Arcs may have moved: compare by the fraction of the phase.
        breaks = np.concatenate([[0.0], np.cumsum(widths)])
        breaks = phase.start + breaks * phase.duration / breaks[-1]
        rows = [
            (former.state_row(i), place.state_row(i))
            for i in range(len(phase.state_names))
        ]
        rows += [
            (former.control_row(j), place.control_row(j))
            for j in range(len(phase.control_names))
        ]
        for old_row, new_row in rows:
            numbers, left, right = _shares(phase.states.breaks, old_row)
            total = np.concatenate([[0.0], np.cumsum(pull[numbers])])
            edges = np.concatenate([left, right[-1:]])
            numbers, left, right = _shares(breaks, new_row)
            gathered = np.interp(right, edges, total) - np.interp(left, edges, total)
            np.add.at(of_bounds, numbers, gathered)
        _rows_of_phase(new, p, phase, breaks, of_rows)
    return Multipliers(
        point,
        of_bounds * after.unknown_scale / objective_scale,
        of_rows * after.row_scale / objective_scale,
        objective_scale,
    )


def _rows_of_phase(
    new: Transcription,
    index: int,
    phase: PhaseSolution,
    breaks: FloatArray,
    of_rows: FloatArray,
) -> None:
    """Fill in the multipliers of the rows of one phase."""
    mesh = new.mesh.phases[index]
    nodes = [collocation(new.scheme, n) for n in mesh.points]
    widths = np.diff(breaks)
    times = np.concatenate(
        [b + h * s for b, h, (s, _) in zip(breaks[:-1], widths, nodes, strict=True)]
    )
    weights = np.concatenate([w for _, w in nodes])
    costates = _nodal_at(phase, phase.costates, times)
    pressures = _nodal_at(phase, phase.path_multipliers, times)
    spans = np.repeat(widths, mesh.points) * weights
    states = constraints = 0
    for group in new.discretisation.groups:
        if group.phase != index:
            continue
        if group.kind == "dynamics":
            of_rows[group.rows] = -costates[:, states] * weights
            states += 1
        elif group.kind == "path" and constraints < pressures.shape[1]:
            of_rows[group.rows] = pressures[:, constraints] * spans
            constraints += 1
