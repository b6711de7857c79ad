"""Distances of straight parts in the separation's metric, for pairs by the block."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.log import showc_pb2 as pb

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

ROWS = 128
"""Drones whose distances from all others are looked at together."""


def moving_pairs(moving: NDArray[np.bool_]) -> Iterator[tuple[IntArray, IntArray]]:
    """All pairs with at least one that moves, block by block."""
    for top in range(0, moving.size, ROWS):
        rows = np.arange(top, min(top + ROWS, moving.size))
        a, b = (side.ravel() for side in np.meshgrid(rows, np.arange(moving.size)))
        wanted = (a < b) & (moving[a] | moving[b])
        yield a[wanted], b[wanted]


def nearest_places(
    places: FloatArray, rules: pb.Separation, moving: NDArray[np.bool_]
) -> tuple[int, int, float] | None:
    """Return the nearest two of ``places`` (n, 3), one of them a mover's at least.

    Returns
    -------
    tuple or None
        Both rows, the lower first, and their distance; None if there is no such pair.
    """
    best: tuple[int, int, float] | None = None
    for top, gap in _gaps(places, places, rules, moving):
        row, column = np.unravel_index(int(gap.argmin()), gap.shape)
        value = float(gap[row, column])
        if value < (np.inf if best is None else best[2]):
            best = top + int(row), top + int(column), value
    return best


def near_pairs(
    one: FloatArray,
    other: FloatArray,
    rules: pb.Separation,
    limit: float,
    moving: NDArray[np.bool_],
) -> Iterator[tuple[IntArray, IntArray]]:
    """Pairs with a mover whose parts may come within ``limit``, block by block.

    A part is the straight line from ``one`` to ``other``, both (n, 3) [m]; pairs left
    out have boxes about them that are further apart than ``limit``.
    """
    low, high = np.minimum(one, other), np.maximum(one, other)
    for top, gap in _gaps(low, high, rules, moving):
        first, second = np.nonzero(gap <= limit)
        yield first + top, second + top


def _gaps(
    low: FloatArray, high: FloatArray, rules: pb.Separation, moving: NDArray[np.bool_]
) -> Iterator[tuple[int, FloatArray]]:
    """Distances between boxes, block by block.

    Yields
    ------
    int
        First row and first column of the block.
    ndarray
        Shape (rows, columns) [m]; infinite where the column is not behind the row, or
        neither moves.
    """
    scale = metric_scale(rules)
    low = np.ascontiguousarray((low * scale).T)
    high = np.ascontiguousarray((high * scale).T)
    per_axis = rules.shape in {rules.ANY_AXIS, rules.ALL_AXES}
    join = np.minimum if rules.shape == rules.ALL_AXES else np.maximum
    for top in range(0, moving.size, ROWS):
        rows, columns = slice(top, top + ROWS), slice(top, None)
        axes = []
        for axis in range(3):
            gap = low[axis, rows, None] - high[axis, None, columns]
            np.maximum(gap, low[axis, None, columns] - high[axis, rows, None], out=gap)
            np.maximum(gap, 0.0, out=gap)
            axes.append(gap if per_axis else np.square(gap, out=gap))
        if per_axis:
            found = join(join(axes[0], axes[1]), axes[2])
        else:
            found = np.sqrt(axes[0] + axes[1] + axes[2])
        idle = ~(moving[rows, None] | moving[None, columns])
        index = np.arange(found.shape[1])
        found[idle | (index <= index[: found.shape[0], None])] = np.inf
        yield top, found


def metric_scale(rules: pb.Separation) -> FloatArray:
    """Factors that turn the separation's ellipsoid into a sphere."""
    stretched = rules.shape == rules.ELLIPSOID
    return np.array([1.0, 1.0, 1.0 / rules.vertical_stretch if stretched else 1.0])


def part_distance(
    one: tuple[FloatArray, FloatArray],
    other: tuple[FloatArray, FloatArray],
    rules: pb.Separation,
) -> FloatArray:
    """Least distance (m,) of straight parts; for the forms per axis, of their boxes."""
    if rules.shape in {rules.ANY_AXIS, rules.ALL_AXES}:
        gap = np.maximum(
            np.minimum(*one) - np.maximum(*other), np.minimum(*other) - np.maximum(*one)
        )
        gap = np.maximum(gap, 0.0)
        return np.asarray(
            gap.max(axis=1) if rules.shape == rules.ANY_AXIS else gap.min(axis=1)
        )
    scale = metric_scale(rules)
    return _segment_distance(
        one[0] * scale, one[1] * scale, other[0] * scale, other[1] * scale
    )


def _segment_distance(
    a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray
) -> FloatArray:
    """Least distance (m,) of the segments from ``a`` to ``b`` and from ``c`` to ``d``.

    A convex quadratic of two parameters on the unit square: its least value is at the
    stationary point, if that lies inside, or on one of the four edges.
    """
    u, v, w = b - a, d - c, a - c
    best = np.full(a.shape[0], np.inf)
    for point, start, along in ((a, c, v), (b, c, v), (c, a, u), (d, a, u)):
        length = np.sum(along * along, axis=1)
        s = np.sum((point - start) * along, axis=1) / np.where(length > 0, length, 1.0)
        gap = point - start - np.clip(s, 0.0, 1.0)[:, None] * along
        best = np.minimum(best, np.sum(gap * gap, axis=1))
    uu, uv, vv = (np.sum(x * y, axis=1) for x, y in ((u, u), (u, v), (v, v)))
    uw, vw = np.sum(u * w, axis=1), np.sum(v * w, axis=1)
    area = uu * vv - uv * uv
    regular = area > 1e-12 * uu * vv
    safe = np.where(regular, area, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = regular & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    gap = w + s[:, None] * u - t[:, None] * v
    best = np.where(inside, np.minimum(best, np.sum(gap * gap, axis=1)), best)
    return np.asarray(np.sqrt(best))
