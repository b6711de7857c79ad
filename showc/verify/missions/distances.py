"""Distances of straight parts in the separation's metric, for pairs by the block."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log import showc_pb2 as pb


ROWS = 128
"""Drones whose distances from all others are looked at together."""


def nearest_places(
    places: FloatArray,
    rules: pb.Separation,
    moving: BoolArray,
    limit: float = np.inf,
) -> tuple[int, int, float] | None:
    """Return the nearest two of ``places`` (n, 3), one of them a mover's at least.

    Returns
    -------
    tuple or None
        Both rows, the lower first, and their distance; None if no such pair is nearer
        than ``limit`` [m].
    """
    best: tuple[float, int, int] | None = None
    for rows, columns, gap in _gaps(places, places, rules, moving, limit):
        value = float(gap.min())
        if not value < limit or (best is not None and value > best[0]):
            continue
        one, other = np.nonzero(gap == value)
        first = np.minimum(rows[one], columns[other])
        second = np.maximum(rows[one], columns[other])
        lowest = np.lexsort((second, first))[0]
        found = value, int(first[lowest]), int(second[lowest])
        best = found if best is None else min(best, found)
    return None if best is None else (best[1], best[2], best[0])


def near_pairs(
    one: FloatArray,
    other: FloatArray,
    rules: pb.Separation,
    limit: float,
    moving: BoolArray,
) -> Iterator[tuple[IntArray, IntArray]]:
    """Pairs with a mover whose parts may come within ``limit``, block by block.

    A part is the straight line from ``one`` to ``other``, both (n, 3) [m]; pairs left
    out have boxes about them that are further apart than ``limit``.
    """
    low, high = np.minimum(one, other), np.maximum(one, other)
    for rows, columns, gap in _gaps(low, high, rules, moving, limit):
        row, column = np.nonzero(gap <= limit)
        first, second = rows[row], columns[column]
        yield np.minimum(first, second), np.maximum(first, second)


def _gaps(
    low: FloatArray,
    high: FloatArray,
    rules: pb.Separation,
    moving: BoolArray,
    limit: float,
) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Distances between boxes from ``low`` to ``high`` (n, 3), block by block.

    Boxes are taken as they lie along one axis, so that what lies too far along it need
    not be looked at; every pair within ``limit`` [m] is in one of the blocks.

    Yields
    ------
    ndarray, ndarray
        Which boxes the block's rows and columns are.
    ndarray
        Shape (rows, columns) [m]; infinite where the column is not behind the row, or
        neither moves.
    """
    scale, points = metric_scale(rules), low is high
    axis = int(np.argmax(np.ptp(low * scale, axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    low = np.ascontiguousarray((low[order] * scale).T)
    high = np.ascontiguousarray((high[order] * scale).T)
    moving = moving[order]
    all_move, behind = bool(moving.all()), np.tri(ROWS, dtype=np.bool_)
    per_axis = rules.shape in {rules.ANY_AXIS, rules.ALL_AXES}
    join = np.minimum if rules.shape == rules.ALL_AXES else np.maximum
    # A margin for what the sum is rounded by.
    reach = np.inf if rules.shape == rules.ALL_AXES else limit * (1.0 + 1e-12) + 1e-9
    for top in range(0, moving.size, ROWS):
        rows = slice(top, top + ROWS)
        stop = np.searchsorted(low[axis], high[axis, rows].max() + reach, side="right")
        columns = slice(top, max(int(stop), top + 1))
        axes = []
        for number in range(3):
            gap = low[number, rows, None] - high[number, None, columns]
            if points:
                np.abs(gap, out=gap)
            else:
                back = low[number, None, columns] - high[number, rows, None]
                np.maximum(gap, back, out=gap)
                np.maximum(gap, 0.0, out=gap)
            axes.append(gap if per_axis else np.square(gap, out=gap))
        if per_axis:
            found = join(join(axes[0], axes[1]), axes[2])
        else:
            axes[0] += axes[1]
            axes[0] += axes[2]
            found = np.sqrt(axes[0], out=axes[0])
        if not all_move:
            found[~(moving[rows, None] | moving[None, columns])] = np.inf
        # The columns begin with the rows themselves.
        begin = found[:, :ROWS]
        begin[behind[: len(begin), : begin.shape[1]]] = np.inf
        yield order[rows], order[columns], found


def metric_scale(rules: pb.Separation) -> FloatArray:
    """Factors that turn the separation's ellipsoid into a sphere."""
    stretched = rules.shape == rules.ELLIPSOID
    return np.array([1.0, 1.0, 1.0 / rules.vertical_stretch if stretched else 1.0])


def part_distance(
    one: tuple[FloatArray, FloatArray],
    other: tuple[FloatArray, FloatArray],
    rules: pb.Separation,
) -> FloatArray:
    """Least distance (m,) of straight parts; for the forms per axis, of their boxes.

    Parts are given by their ends, axis by axis, shape (3, m) [m].
    """
    if rules.shape in {rules.ANY_AXIS, rules.ALL_AXES}:
        gap = np.maximum(
            np.minimum(*one) - np.maximum(*other), np.minimum(*other) - np.maximum(*one)
        )
        gap = np.maximum(gap, 0.0)
        return np.asarray(
            gap.max(axis=0) if rules.shape == rules.ANY_AXIS else gap.min(axis=0)
        )
    scale = metric_scale(rules)[:, None]
    return segment_distance(
        one[0] * scale, one[1] * scale, other[0] * scale, other[1] * scale
    )


def segment_distance(
    a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray
) -> FloatArray:
    """Least distance (m,) of the segments from ``a`` to ``b`` and from ``c`` to ``d``.

    A convex quadratic of two parameters on the unit square: its least value is at the
    stationary point, if that lies inside, or on one of the four edges.
    """
    u, v, w = b - a, d - c, a - c
    uu, uv, vv = _dot(u, u), _dot(u, v), _dot(v, v)
    best = np.full(uu.size, np.inf)
    # A drone at rest has an edge of no length.
    along_u, along_v = (np.where(size > 0.0, size, 1.0) for size in (uu, vv))
    for way, along, size in (
        (w, v, along_v),
        (b - c, v, along_v),
        (-w, u, along_u),
        (d - a, u, along_u),
    ):
        share = _dot(way, along)
        share /= size
        np.minimum(np.maximum(share, 0.0, out=share), 1.0, out=share)
        gap = way - share * along
        np.minimum(best, _dot(gap, gap), out=best)
    uw, vw = _dot(u, w), _dot(v, w)
    area = uu * vv - uv * uv
    regular = area > 1e-12 * uu * vv
    safe = np.where(regular, area, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = regular & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    rows = np.flatnonzero(inside)
    gap = w[:, rows] + s[rows] * u[:, rows] - t[rows] * v[:, rows]
    best[rows] = np.minimum(best[rows], _dot(gap, gap))
    return np.asarray(np.sqrt(best))


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    """Products (m,) of the columns of two arrays (3, m)."""
    product = one * other
    product[2] += product[1]
    product[2] += product[0]
    return np.asarray(product[2])
