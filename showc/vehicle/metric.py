"""Distances of pairs in the separation's own metric."""

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
    return measure_parts(*np.moveaxis(difference, -1, 0), separation=separation)


def measure_parts(
    x: FloatArray, y: FloatArray, z: FloatArray, *, separation: Separation
) -> FloatArray:
    """Distance of pairs from their differences along each axis [m], all of one shape.

    As :func:`measure`, without a copy where the axes lie apart in memory.
    """
    if separation.shape == "any-axis":
        return np.maximum(np.maximum(np.abs(x), np.abs(y)), np.abs(z))
    if separation.shape == "all-axes":
        return np.minimum(np.minimum(np.abs(x), np.abs(y)), np.abs(z))
    square = np.zeros(())
    for part, scale in zip((x, y, z), separation.metric_scale, strict=True):
        way = part * scale if scale != 1.0 else part
        square = square + way * way
    return np.sqrt(square)
