"""Distances of points and of straight parts, in the separation's metric."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]


def part_distance(
    first: tuple[FloatArray, FloatArray],
    second: tuple[FloatArray, FloatArray],
    separation: Separation,
) -> FloatArray:
    """Least distance (m,) of straight parts, in the separation's metric.

    Exact for the sphere and the ellipsoid; for the forms per axis the parts' boxes
    give a lower bound.
    """
    if separation.shape in {"any-axis", "all-axes"}:
        gap = np.maximum(
            np.minimum(*first) - np.maximum(*second),
            np.minimum(*second) - np.maximum(*first),
        )
        gap = np.maximum(gap, 0.0)
        return np.asarray(
            gap.max(axis=1) if separation.shape == "any-axis" else gap.min(axis=1)
        )
    scale = np.array(separation.metric_scale)
    p, q = first[0] * scale, second[0] * scale
    return segment_distance(p, first[1] * scale - p, q, second[1] * scale - q)


def boxes_within(
    parts: tuple[FloatArray, FloatArray],
    pairs: tuple[IntArray, IntArray],
    separation: Separation,
    distance: float,
) -> NDArray[np.bool_]:
    """Return which ``pairs`` of straight parts may be nearer than ``distance`` [m].

    ``parts`` holds the two ends of each, (n, 3). Quick: boxes around the parts are no
    farther from each other than the parts.
    """
    if separation.shape in {"any-axis", "all-axes"}:
        return np.ones(pairs[0].size, dtype=np.bool_)
    scale = np.array(separation.metric_scale)
    low, high = np.minimum(*parts) * scale, np.maximum(*parts) * scale
    one, other = pairs
    squared = np.zeros(one.size)
    for axis in range(3):
        below, above = low[:, axis], high[:, axis]
        gap = np.maximum(below[one] - above[other], below[other] - above[one])
        np.maximum(gap, 0.0, out=gap)
        squared += gap * gap
    # Rounding must not hide a pair.
    return np.asarray(squared <= (distance * (1.0 + 1e-9)) ** 2)


def point_distance(
    first: FloatArray, second: FloatArray, separation: Separation
) -> FloatArray:
    """Distance (m,) of points (m, 3), in the separation's metric."""
    gap = np.abs(first - second)
    if separation.shape == "any-axis":
        return np.asarray(gap.max(axis=1))
    if separation.shape == "all-axes":
        return np.asarray(gap.min(axis=1))
    gap *= np.array(separation.metric_scale)
    return np.asarray(np.sqrt(dot(gap, gap)))


def segment_distance(
    p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray
) -> FloatArray:
    """Least distance (m,) between segments p + [0, 1] u and q + [0, 1] v, all (m, 3).

    Either the lines' common normal ends inside both, or the least distance is at an
    end of one of them (Ericson 2005, Real-Time Collision Detection, section 5.1.9).
    """
    w = p - q
    uu, uv, vv = dot(u, u), dot(u, v), dot(v, v)
    uw, vw = dot(u, w), dot(v, w)
    determinant = uu * vv - uv * uv
    regular = determinant > 1e-12 * uu * vv
    safe = np.where(regular, determinant, 1.0)
    s = np.where(regular, (uv * vw - vv * uw) / safe, 0.0)
    t = np.where(regular, (uu * vw - uv * uw) / safe, 0.0)
    s, t = np.clip(s, 0.0, 1.0), np.clip(t, 0.0, 1.0)
    gap = w + s[:, None] * u - t[:, None] * v
    squared = dot(gap, gap)
    for point, base, along, length in (
        (w, np.zeros_like(w), v, vv),
        (w + u, np.zeros_like(w), v, vv),
    ):
        at = np.clip(
            dot(point - base, along) / np.where(length > 0.0, length, 1.0), 0.0, 1.0
        )
        rest = point - at[:, None] * along
        squared = np.minimum(squared, dot(rest, rest))
    for point in (-w, v - w):
        at = np.clip(dot(point, u) / np.where(uu > 0.0, uu, 1.0), 0.0, 1.0)
        rest = point - at[:, None] * u
        squared = np.minimum(squared, dot(rest, rest))
    return np.asarray(np.sqrt(squared))


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products (m,) of the vectors ``a`` and ``b``, both (m, 3)."""
    return np.asarray(np.einsum("ij,ij->i", a, b))
