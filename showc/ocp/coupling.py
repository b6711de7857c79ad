"""Candidate constraints between subsystems, and where they are imposed.

A problem of many subsystems (vehicles, arms, reactors that share a schedule) has a
constraint for each pair, of which most never come into play: carried along idle they
multiply the work of a solve. A *coupling* is stated with the problem but imposed only
where an audit has found it violated, on the stretches of time concerned.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.nodes import collocation, fitting_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.ocp.mesh import PhaseMesh
    from showc.ocp.nodes import Scheme


GREATEST_DEGREE = 4
"""Greatest degree of a coupling as a polynomial in the states."""


def polynomial_degree(expression: Any, symbols: Any) -> int | None:  # noqa: ANN401
    """Degree of ``expression`` as a polynomial in ``symbols`` (CasADi column).

    ``None`` if it is none, or of a degree above :data:`GREATEST_DEGREE`.
    """
    slopes = casadi.SX(expression)
    for degree in range(GREATEST_DEGREE + 1):
        slopes = casadi.jacobian(slopes, symbols)
        entries: list[Any] = slopes.nonzeros()
        if not entries:
            return degree
        slopes = casadi.vertcat(*entries)
    return None


@dataclass(frozen=True, slots=True)
class Imposed:
    """A coupling that constrains the next solve, and where.

    Times are fractions of the phase, so that they mean the same on every mesh.
    """

    phase: int
    name: str
    stretches: tuple[tuple[float, float], ...]
    """Where it is imposed, widened to whole mesh intervals; sorted, disjoint."""
    places: tuple[float, ...] = ()
    """Instants between the collocation points at which it is imposed besides."""
    margin: float = 0.0
    """By how much its bounds are tightened, in its own unit."""

    def points(self, mesh: PhaseMesh, scheme: Scheme) -> list[FloatArray]:
        """Fractions of each mesh interval at which rows are imposed.

        On a mesh of several arcs, whose durations are not known beforehand, these are
        many on every interval.
        """
        if mesh.arc_count > 1:
            return [np.array(fitting_points(2 * n)) for n in mesh.points]
        breaks = np.concatenate([[0.0], np.cumsum(mesh.fractions)])
        extra = np.array(self.places, dtype=np.float64)
        found = []
        for k, n in enumerate(mesh.points):
            low, high = breaks[k], breaks[k + 1]
            if not any(start < high and end > low for start, end in self.stretches):
                found.append(np.zeros(0))
                continue
            nodes = np.array(collocation(scheme, n)[0])
            inside = (extra[(extra >= low) & (extra < high)] - low) / (high - low)
            # A place next to a node would only repeat its row.
            apart = np.abs(inside[:, None] - nodes).min(axis=1, initial=1.0) > 1e-3
            found.append(np.sort(np.concatenate([nodes, inside[apart]])))
        return found


def merged(
    stretches: Sequence[tuple[float, float]],
) -> tuple[tuple[float, float], ...]:
    """Join stretches that touch or overlap; sorted."""
    joined: list[tuple[float, float]] = []
    for start, end in sorted(stretches):
        if joined and start <= joined[-1][1] + 1e-12:
            joined[-1] = joined[-1][0], max(joined[-1][1], end)
        else:
            joined.append((start, end))
    return tuple(joined)
