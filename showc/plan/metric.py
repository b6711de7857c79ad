"""Distances in the separation's own metric."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.vehicle import Separation


def scaled(points: FloatArray, separation: Separation) -> FloatArray:
    """Points (..., 3) [m] in coordinates where the ellipsoid is a sphere."""
    return np.asarray(points * np.asarray(separation.metric_scale))


def measure(difference: FloatArray, separation: Separation) -> FloatArray:
    """Distance of pairs at ``difference`` (..., 3) [m], shape (...,) [m].

    The pair keeps the separation if and only if this is at least
    ``separation.distance``; see :class:`showc.vehicle.Separation` for the four forms.
    """
    if separation.shape == "any-axis":
        return np.asarray(np.max(np.abs(difference), axis=-1))
    if separation.shape == "all-axes":
        return np.asarray(np.min(np.abs(difference), axis=-1))
    return np.asarray(np.linalg.norm(scaled(difference, separation), axis=-1))


def line_separation(
    start: FloatArray, goal: FloatArray, separation: Separation, block: int = 512
) -> float:
    """Least distance of any pair that shares one profile along straight lines.

    All drones are at ``start + s (goal - start)`` for a common s from 0 to 1, so the
    least distance of a pair is the distance of a segment to the origin: exact for the
    sphere and the ellipsoid. The axis forms are not convex; for them the distance is
    the least over s of a piecewise-linear function, taken at its corners.

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m].
    separation
        The metric.
    block
        Rows of the pair matrix worked on at once; bounds the memory.

    Returns
    -------
    float
        [m]; infinity for fewer than two drones.
    """
    if start.shape[0] < 2:
        return float("inf")
    axis_form = separation.shape in ("any-axis", "all-axes")
    first, last = scaled(start, separation), scaled(goal, separation)
    least = float("inf")
    columns = np.arange(start.shape[0])
    for top in range(0, start.shape[0], block):
        rows = slice(top, top + block)
        origin = first[rows, None] - first[None]
        change = (last[rows, None] - last[None]) - origin
        if axis_form:
            distance = _axis_form_least(origin, change, separation)
        else:
            square = np.einsum("ijk,ijk->ij", change, change)
            along = -np.einsum("ijk,ijk->ij", origin, change)
            fraction = np.clip(along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
            nearest = origin + fraction[..., None] * change
            distance = np.sqrt(np.einsum("ijk,ijk->ij", nearest, nearest))
        later = columns[None, :] > columns[rows, None]
        if later.any():
            least = min(least, float(distance[later].min()))
    return least


def _axis_form_least(
    origin: FloatArray, change: FloatArray, separation: Separation
) -> FloatArray:
    """Least of max or min of |origin + s change| over s in [0, 1], shape (...)."""
    pairs = [(0, 1), (0, 2), (1, 2)]
    numerators, denominators = [-origin], [change]
    for sign in (1.0, -1.0):
        left = np.stack([origin[..., a] - sign * origin[..., b] for a, b in pairs], -1)
        rate = np.stack([change[..., a] - sign * change[..., b] for a, b in pairs], -1)
        numerators.append(-left)
        denominators.append(rate)
    numerator = np.concatenate(numerators, axis=-1)
    denominator = np.concatenate(denominators, axis=-1)
    safe = np.where(denominator == 0.0, 1.0, denominator)
    corners = np.clip(numerator / safe, 0.0, 1.0)
    ends = np.broadcast_to(np.array([0.0, 1.0]), (*corners.shape[:-1], 2))
    fractions = np.concatenate([corners, ends], axis=-1)
    values = origin[..., None, :] + fractions[..., :, None] * change[..., None, :]
    return np.asarray(measure(values, separation).min(axis=-1))
