"""Reading the solver's answer: polynomials, costates, and what is violated where."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi
import numpy as np

from showc.ocp.mesh import alike
from showc.ocp.nodes import bernstein_values, collocation
from showc.ocp.solution import PhaseSolution
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.ocp.solution import Multipliers
    from showc.ocp.transcription.collocation.limits import Box
    from showc.ocp.transcription.collocation.transcription import Transcription


def worst_violation(
    built: Transcription, point: Multipliers, limits: Box, vector: FloatArray
) -> str:
    """Say which constraint is violated most, and where.

    ``vector`` holds the parameters of the program.
    """
    parts = built.discretisation
    _, rows = parts.program.values(point.unknowns, vector)
    value = np.asarray(rows).ravel()
    low = limits.row_lower / parts.row_scale
    high = limits.row_upper / parts.row_scale
    violation = np.maximum(np.maximum(low - value, value - high), 0.0)
    if not np.all(np.isfinite(value)):
        violation = np.where(np.isfinite(value), violation, np.inf)
    if value.size == 0 or violation.max() <= 10.0 * built.options.tolerance:
        return "All constraints are kept; the objective is not yet least."
    worst = int(np.argmax(violation))
    group = next(g for g in parts.groups if g.rows[0] <= worst <= g.rows[-1])
    at = worst - int(group.rows[0])
    phase = built.problem.phases[group.phase]
    amount = violation[worst] * parts.row_scale[worst]
    where = f"in phase {phase.name!r}"
    if group.interval[at] >= 0:
        place = parts.layout.phases[group.phase]
        unknowns = point.unknowns * parts.unknown_scale
        widths = built.mesh.phases[group.phase].widths(unknowns[place.durations])
        k = int(group.interval[at])
        time = unknowns[place.start] + widths[:k].sum() + group.place[at] * widths[k]
        where += f" at t = {time:.6g}"
    return f"Violated most: {group.kind} of {group.name!r} {where}, by {amount:.3g}."


def phase_solution(
    built: Transcription,
    index: int,
    unknowns: FloatArray,
    multipliers: Multipliers,
    parameters: FloatArray,
) -> PhaseSolution:
    """Read the trajectory of one phase from the unscaled unknowns.

    ``parameters`` are values of those of the problem.
    """
    phase, mesh = built.problem.phases[index], built.mesh.phases[index]
    place = built.discretisation.layout.phases[index]
    arcs = unknowns[place.durations]
    widths = mesh.widths(arcs)
    # A phase of no duration still needs increasing breaks.
    widths = np.maximum(widths, 1e-12 * max(float(widths.sum()), 1e-6))
    begin = float(unknowns[place.start])
    breaks = begin + np.concatenate([[0.0], np.cumsum(widths)])
    times, costates, pressures, inner = _costates(
        built, index, begin, widths, multipliers
    )
    return PhaseSolution(
        phase.name,
        mesh,
        arcs,
        tuple(phase.states),
        tuple(phase.controls),
        _join([unknowns[t] for t in place.states], breaks),
        _join(
            _same_degree([tuple(unknowns[c] for c in row) for row in place.controls]),
            breaks,
        ),
        times,
        costates,
        built.scheme,
        pressures,
        inner,
        _bound_gaps(built, index, unknowns, multipliers),
        _integral_prices(built, index, multipliers, parameters),
    )


def _integral_prices(
    built: Transcription, index: int, multipliers: Multipliers, parameters: FloatArray
) -> FloatArray:
    """Differentiate the objective by the integrals of a phase, shape (integrals,).

    An integral that is an unknown has an equation, whose multiplier tells; one that
    only enters the objective has a factor of known numbers there.
    """
    problem, parts = built.problem, built.discretisation
    symbols = [symbol for symbol, _ in problem.phases[index].integrals]
    if parts.layout.integrals[index].size:
        rows = [
            group.rows[0]
            for group in parts.groups
            if group.phase == index and group.kind == "integral"
        ]
        force = multipliers.of_constraints[rows]
        return np.asarray(-multipliers.objective_scale * force)
    if not symbols:
        return np.zeros(0)
    factors = casadi.jacobian(problem.objective, casadi.vertcat(*symbols))
    given = casadi.vertcat(
        casadi.SX(0, 1), *[symbol for symbol, _ in problem.parameters.values()]
    )
    function = casadi.Function("prices", [given], [casadi.densify(factors)])
    sign = -1.0 if problem.maximises else 1.0
    return np.asarray(sign * np.asarray(function(parameters)).ravel())


def _bound_gaps(
    built: Transcription,
    index: int,
    unknowns: FloatArray,
    multipliers: Multipliers,
) -> FloatArray:
    """Multiply multipliers of the states' bounds by the room between hull and curve.

    A Bernstein coefficient at its bound leaves the polynomial a little off it;
    multiplier times that distance is what the objective could still gain. How far the
    coefficient itself is from its bound is the solver's affair.
    """
    place, mesh = built.discretisation.layout.phases[index], built.mesh.phases[index]
    pull = multipliers.of_bounds / built.discretisation.unknown_scale
    pull = pull * multipliers.objective_scale
    losses = np.zeros((mesh.intervals, len(built.problem.phases[index].states)))
    for n, chosen in alike(mesh.points):
        table = np.stack([place.states[k] for k in chosen])
        s = tuple((np.arange(n + 1) / n).tolist())
        value = bernstein_values(n, s) @ unknowns[table]
        # A positive multiplier belongs to the upper bound, a negative one to the
        # lower; borders count half for each of their intervals.
        loss = np.maximum(pull[table] * (unknowns[table] - value), 0.0)
        loss[~np.isfinite(loss)] = 0.0
        losses[chosen] = loss[:, 1:-1].sum(axis=1)
    return losses


def _costates(
    built: Transcription,
    index: int,
    begin: float,
    widths: FloatArray,
    multipliers: Multipliers,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Give times of the points, costates and path multipliers there.

    The latter once more without what presses at the ends of intervals.

    The multipliers of the defects over the quadrature weights are costates, those
    of the path constraints over weight and width are densities in time.
    """
    mesh = built.mesh.phases[index]
    nodes = [collocation(built.scheme, n) for n in mesh.points]
    ends = begin + np.cumsum(widths)
    times = np.concatenate(
        [end - h + h * s for end, h, (s, _) in zip(ends, widths, nodes, strict=True)]
    )
    weights = np.concatenate([w for _, w in nodes])
    spans = np.repeat(np.maximum(widths, 1e-300), mesh.points) * weights
    costates, pressures = [np.zeros((times.size, 0))], [np.zeros((times.size, 0))]
    at_ends = [np.zeros((times.size, 0))]
    seen: list[str] = []
    first = np.concatenate([[0], np.cumsum(mesh.points)])
    for group in built.discretisation.groups:
        if group.phase != index or group.kind not in {"dynamics", "path"}:
            continue
        force = multipliers.of_constraints[group.rows] / group.scale
        force = (force * multipliers.objective_scale)[:, None]
        if group.kind == "dynamics":
            costates.append(-force / weights[:, None])
        elif group.name not in seen:
            seen.append(group.name)
            pressures.append(force / spans[:, None])
            at_ends.append(np.zeros((times.size, 1)))
        else:
            # A single point between the nodes acts on the polynomials as these
            # multipliers at the nodes do.
            at = 1 + seen.index(group.name)
            for k, s, weight in zip(
                group.interval, group.place, force[:, 0], strict=True
            ):
                n = mesh.points[k]
                nodal = slice(first[k], first[k] + n)
                share = np.linalg.solve(
                    bernstein_values(n - 1, tuple(map(float, nodes[k][0]))).T,
                    bernstein_values(n - 1, (float(s),))[0],
                )
                pressures[at][nodal, 0] += weight * share / spans[nodal]
                if s in {0.0, 1.0}:
                    at_ends[at][nodal, 0] += weight * share / spans[nodal]
    every = np.hstack(pressures)
    return times, np.hstack(costates), every, every - np.hstack(at_ends)


def _same_degree(tables: list[tuple[FloatArray, ...]]) -> list[FloatArray]:
    """Stack the controls' coefficients on each interval, elevated to one degree."""
    if not tables[0]:
        return [np.zeros((1, 0))] * len(tables)
    degree = max(row.size for rows in tables for row in rows) - 1
    controls = [
        _raised([row[:, None] for row in rows], degree)
        for rows in zip(*tables, strict=True)
    ]
    return list(np.concatenate(controls, axis=2))


def _join(tables: list[FloatArray], breaks: FloatArray) -> PiecewisePolynomial:
    """One piecewise polynomial from tables (degree + 1, components)."""
    degree = max(table.shape[0] for table in tables) - 1
    return PiecewisePolynomial(breaks, _raised(tables, degree))


def _raised(tables: list[FloatArray], degree: int) -> FloatArray:
    """Bernstein coefficients (n + 1, components) raised to ``degree``, stacked."""
    out = np.zeros((len(tables), degree + 1, tables[0].shape[1]))
    for size, chosen in alike(len(table) for table in tables):
        rows = np.stack([tables[k] for k in chosen])
        if size <= degree:
            curve = PiecewisePolynomial(np.arange(chosen.size + 1.0), rows)
            rows = curve.elevated(degree).coefficients
        out[chosen] = rows
    return out
