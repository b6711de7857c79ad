"""Distances of points and of straight parts, in the separation's metric."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

ROWS = 128
"""Drones whose distances from all others are looked at together."""


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


def nearest_pair(
    points: FloatArray, separation: Separation, moving: NDArray[np.bool_]
) -> tuple[int, int, float]:
    """Return the nearest two of ``points`` (n, 3) with a mover, and their distance.

    ``moving`` (n,) says who moves. Infinite where there is no such pair.
    """
    best = 0, 0, np.inf
    for top, gap in _gaps(points, points, separation, moving):
        row, column = np.unravel_index(int(gap.argmin()), gap.shape)
        value = float(gap[row, column])
        if value < best[2]:
            best = top + int(row), top + int(column), value
    return best


def near_pairs(
    parts: tuple[FloatArray, FloatArray],
    separation: Separation,
    distance: float,
    moving: NDArray[np.bool_],
) -> tuple[IntArray, IntArray]:
    """Return the pairs with a mover whose straight parts may be within ``distance``.

    ``parts`` holds the two ends of each, (n, 3). Quick: boxes around the parts are no
    farther from each other than the parts. First below second, each of shape (m,).
    """
    found_a, found_b = [], []
    low, high = np.minimum(*parts), np.maximum(*parts)
    # Rounding must not hide a pair.
    limit = distance * (1.0 + 1e-9)
    for top, gap in _gaps(low, high, separation, moving):
        a, b = np.nonzero(gap <= limit)
        found_a.append(a + top)
        found_b.append(b + top)
    return np.concatenate(found_a), np.concatenate(found_b)


def _gaps(
    low: FloatArray,
    high: FloatArray,
    separation: Separation,
    moving: NDArray[np.bool_],
) -> Iterator[tuple[int, FloatArray]]:
    """Distances between boxes from ``low`` to ``high`` (n, 3), block by block.

    Yields
    ------
    int
        First row and first column of the block.
    ndarray
        Shape (rows, columns) [m]; infinite where the column is not behind the row, or
        neither moves.
    """
    per_axis = separation.shape in {"any-axis", "all-axes"}
    scale = np.array(separation.metric_scale)
    join = np.minimum if separation.shape == "all-axes" else np.maximum
    below = np.ascontiguousarray((low * scale).T)
    above = np.ascontiguousarray((high * scale).T)
    for top in range(0, moving.size, ROWS):
        rows, columns = slice(top, top + ROWS), slice(top, None)
        axes = []
        for axis in range(3):
            gap = below[axis, rows, None] - above[axis, None, columns]
            other = below[axis, None, columns] - above[axis, rows, None]
            np.maximum(gap, other, out=gap)
            np.maximum(gap, 0.0, out=gap)
            axes.append(gap if per_axis else np.square(gap, out=gap))
        if per_axis:
            found = join(join(axes[0], axes[1]), axes[2])
        else:
            found = np.sqrt(axes[0] + axes[1] + axes[2])
        count = found.shape[0]
        found[:, :count][np.tril_indices(count)] = np.inf
        found[~(moving[rows, None] | moving[None, columns])] = np.inf
        yield top, found


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
