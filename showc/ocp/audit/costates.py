"""Costates between the points of a discrete program, without their oscillation.

Where a state is at its bound the costates of a discrete program are determined only as
far as its controls can tell them apart. What is left oscillates; there they are
replaced by their best approximation by polynomials of the controls' degree.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from showc.ocp.mesh import alike
from showc.ocp.nodes import bernstein_values, collocation
from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray
    from showc.ocp.phase import Phase
    from showc.ocp.solution import PhaseSolution


def interpolated(
    phase: PhaseSolution, places: tuple[float, ...], nodal: FloatArray
) -> FloatArray:
    """Values at fractions of each interval from values at the points."""
    points = phase.mesh.points
    first = np.cumsum(points) - points
    out = np.zeros((len(points), len(places), nodal.shape[1]))
    for n, chosen in alike(points):
        from_nodes = np.linalg.inv(
            bernstein_basis(n - 1, collocation(phase.scheme, n)[0])
        )
        matrix = bernstein_values(n - 1, places) @ from_nodes
        out[chosen] = matrix @ nodal[first[chosen, None] + np.arange(n)]
    return out


def degrees_of(phase: Phase, part: PhaseSolution, k: int) -> tuple[int, ...]:
    """Degree of each control on interval k."""
    given, least = part.mesh.control_degrees, part.mesh.points[k] - 1
    found = [
        given[name][k] if name in given else control.degree
        for name, control in phase.controls.items()
    ]
    return tuple(least if d is None or d < 0 else min(d, least) for d in found)


def without_oscillation(
    phase: Phase, part: PhaseSolution, along: BoolArray
) -> FloatArray:
    """Costates at the points, shape (points, states), without their oscillation.

    ``along``: on which intervals a state is at its bound, shape (K,); on these the
    best approximation of the greatest degree of a control is taken, as
    the audit does for slopes of the Hamiltonian.
    """
    found = part.costates.copy()
    points = np.asarray(part.mesh.points)
    first = np.cumsum(points) - points
    chosen = np.flatnonzero(along)
    most = [max(1, *degrees_of(phase, part, int(k))) for k in chosen]
    for (n, degree), at in alike(zip(points[chosen].tolist(), most, strict=True)):
        if degree < n - 1:
            nodes, weights = collocation(part.scheme, n)
            here = first[chosen[at], None] + np.arange(n)
            wanted = best_approximation(nodes, weights, degree, nodes)
            found[here] = wanted @ found[here]
    return found


def best_approximation(
    nodes: FloatArray, weights: FloatArray, degree: int, places: FloatArray
) -> FloatArray:
    """Matrix from values at ``nodes`` to the best approximation at ``places``.

    The polynomial of that degree with the least squares weighted by the quadrature.
    """
    basis = legendre.legvander(2.0 * nodes - 1.0, degree)
    weighted = basis.T * weights
    fitted = np.linalg.solve(weighted @ basis, weighted)
    return np.asarray(legendre.legvander(2.0 * places - 1.0, degree) @ fitted)
