"""Graded meshes: borders where a low-degree control costs the objective most.

On intervals of width h_k let G_k be the integral of the gap in Pontryagin's principle
(:mod:`showc.ocp.audit.residuals`) and V_k the variation of the controls over their
ranges. The mesh is dense where

    d_k = floor + (1 - floor) ((1 - m) sqrt(G_k) / (h_k g) + m V_k / (h_k v))

is great, g and v being the means of sqrt(G) / h and V / h over the phase; the new
borders give every interval the same share of its integral (equidistribution: de Boor
1973, Good approximation by splines with variable knots; Huang, Russell 2011, Adaptive
moving mesh methods, chapter 2). A switch inside an interval costs about h², so
sqrt(G) / h is the same before and after a cut and the mesh settles; the variation keeps
intervals at switches that are resolved already.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.mesh import PhaseMesh

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.ocp.solution import PhaseSolution


FLOOR = 0.2
"""Share of the intervals that is spread evenly."""
VARIATION = 0.3
"""Weight m of the controls' variation."""
DECAY = 0.5
"""Least ratio of the densities of neighbours: what was found is known to no better
than an interval."""


def graded_breaks(
    phase: PhaseSolution, gap: FloatArray, span: FloatArray, intervals: int
) -> FloatArray:
    """Borders of a new mesh with a given number of intervals.

    Parameters
    ----------
    phase
        A solution on some mesh.
    gap
        Integral of the gap in the minimum principle over each of its intervals,
        shape (K,).
    span
        Range of each control, shape (controls,).

    Returns
    -------
    ndarray, shape (intervals + 1,)
        Times, the first and last those of the phase.
    """
    breaks = phase.states.breaks
    widths = np.diff(breaks)
    lost = np.sqrt(np.maximum(gap, 0.0))
    density = (1.0 - VARIATION) * _share(lost, widths)
    density += VARIATION * _share(variation(phase, span), widths)
    spread = density.copy()
    spread[1:] = np.maximum(spread[1:], DECAY * density[:-1])
    spread[:-1] = np.maximum(spread[:-1], DECAY * density[1:])
    density = FLOOR + (1.0 - FLOOR) * spread / np.average(spread, weights=widths)
    area = np.concatenate([[0.0], np.cumsum(density * widths)])
    return np.asarray(
        np.interp(np.linspace(0.0, area[-1], intervals + 1), area, breaks)
    )


def variation(phase: PhaseSolution, span: FloatArray) -> FloatArray:
    """Variation of the controls over their ranges on each interval, shape (K,).

    Jumps between intervals count half on either side.
    """
    coefficients = phase.controls.coefficients / span
    inside = np.abs(np.diff(coefficients, axis=1)).sum(axis=(1, 2))
    jumps = np.abs(coefficients[1:, 0] - coefficients[:-1, -1]).sum(axis=1)
    inside[:-1] += 0.5 * jumps
    inside[1:] += 0.5 * jumps
    return np.asarray(inside)


def _share(amount: FloatArray, widths: FloatArray) -> FloatArray:
    """Density of an amount per interval, of mean 1; even where there is none."""
    total = float(amount.sum())
    if not np.isfinite(total) or total <= 0.0:
        return np.ones(widths.size)
    return np.asarray(amount / widths * (widths.sum() / total))


def enough_points(
    phase: PhaseSolution,
    error: FloatArray,
    breaks: FloatArray,
    *,
    accuracy: float,
    least: int,
) -> IntArray:
    """Points of each interval of a new mesh that promise ``accuracy``, shape (K,).

    With N points the error on an interval falls with its width to the power N + 1.

    Parameters
    ----------
    phase
        The solution on the former mesh.
    error
        Its errors of the dynamics over the states' ranges, interval by interval.
    breaks
        Borders of the new mesh.
    accuracy
        Wanted error.
    least
        Least number of points.
    """
    former = phase.states.breaks
    middle = 0.5 * (breaks[:-1] + breaks[1:])
    owner = np.clip(np.searchsorted(former, middle) - 1, 0, former.size - 2)
    points = np.asarray(phase.mesh.points)[owner]
    ratio = np.diff(breaks) / np.diff(former)[owner]
    promised = error[owner] * ratio ** (points + 1)
    return np.where(promised > accuracy, points + 1, np.maximum(points - 1, least))


def linear_mesh(
    breaks: FloatArray,
    points: IntArray | list[int],
    controls: tuple[str, ...],
    margin: float | None,
) -> PhaseMesh:
    """Mesh with ``controls`` linear on each interval.

    Path constraints hold at both ends of every interval too, with a ``margin``; at
    the collocation points alone if that is ``None``.
    """
    count = breaks.size - 1
    plain = PhaseMesh.from_breaks(breaks, [int(n) for n in points])
    return PhaseMesh(
        plain.fractions,
        plain.points,
        control_degrees=dict.fromkeys(controls, (1,) * count),
        path_points=(() if margin is None else (0.0, 1.0),) * count,
        path_margins=(margin or 0.0,) * count,
    )
