"""Even distribution: few points that cover many candidates well.

Farthest-point sampling (Gonzalez 1985) starts it: each new point is the candidate
furthest from those chosen, so that no two are ever close. A few rounds of Lloyd's
method (Lloyd 1982) then centre each point in what it covers. Nothing is random.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray


_ROUNDS, _FEW_ROUNDS, _MANY = 8, 3, 300
_BLOCK = 65_536
"""Distances worked out at a time: two arrays of them stay in the cache."""


def candidates_for(count: int) -> int:
    """Return how many candidates suffice for a number of points."""
    return max(3000, 12 * count)


def spread_evenly(
    candidates: FloatArray, count: int, *, rounds: int | None = None
) -> IntArray:
    """Choose candidates that cover all of them evenly.

    Parameters
    ----------
    candidates
        Shape (candidates, k) [m], in any fixed order.
    count
        Number of points, at most the number of candidates.
    rounds
        Rounds of Lloyd's method; None: as many as take little time. The round is kept
        whose two closest points are the furthest apart, because separation is what
        counts most.

    Returns
    -------
    IntArray
        Indices of the chosen candidates, shape (count,), in order of the candidates'
        first coordinates.
    """
    if rounds is None:
        rounds = _ROUNDS if count <= _MANY else _FEW_ROUNDS
    chosen = farthest_points(candidates, count)
    best, width = chosen, _least_gap(candidates[chosen])
    for _ in range(rounds if 1 < count < len(candidates) else 0):
        owner = _owners(candidates, candidates[chosen])
        size = np.maximum(np.bincount(owner, minlength=count), 1)
        middle = np.column_stack(
            [
                np.bincount(owner, weights=column, minlength=count) / size
                for column in candidates.T
            ]
        )
        moved = _nearest_members(candidates, owner, middle, chosen)
        if np.array_equal(moved, chosen):
            break
        chosen = moved
        gap = _least_gap(candidates[chosen])
        if gap > width:
            best, width = chosen, gap
    placed = np.round(candidates[best], 9)
    return np.asarray(best[np.lexsort(placed.T[::-1])], dtype=np.int64)


def farthest_points(candidates: FloatArray, count: int) -> IntArray:
    """Choose candidates one by one, each furthest from all before; (count,)."""
    middle = candidates.mean(axis=0)
    away = np.sum((candidates - middle) ** 2, axis=1)
    chosen = np.empty(count, dtype=np.int64)
    chosen[0] = int(np.argmax(np.round(away, 9)))
    distance = np.full(len(candidates), np.inf)
    columns = [np.ascontiguousarray(column) for column in candidates.T]
    square, step = np.empty(len(candidates)), np.empty(len(candidates))
    for index in range(1, count):
        last = chosen[index - 1]
        square.fill(0.0)
        for column in columns:
            np.subtract(column, column[last], out=step)
            np.multiply(step, step, out=step)
            np.add(square, step, out=square)
        np.minimum(distance, square, out=distance)
        chosen[index] = int(np.argmax(distance))
    return chosen


def _owners(candidates: FloatArray, points: FloatArray) -> IntArray:
    """Return the nearest point of each candidate, (candidates,)."""
    owner = np.empty(len(candidates), dtype=np.int64)
    rows = max(_BLOCK // max(len(points), 1), 1)
    # Plain differences and no matrix product: ties fall the same way every time.
    small, few = candidates.astype(np.float32), points.astype(np.float32)
    columns = [np.ascontiguousarray(column) for column in few.T]
    squares = np.empty((rows, len(few)), dtype=np.float32)
    steps = np.empty_like(squares)
    for start in range(0, len(candidates), rows):
        part = small[start : start + rows]
        square, step = squares[: len(part)], steps[: len(part)]
        square.fill(0.0)
        for axis, column in enumerate(columns):
            np.subtract(part[:, axis, None], column, out=step)
            np.multiply(step, step, out=step)
            np.add(square, step, out=square)
        owner[start : start + rows] = square.argmin(axis=1)
    return owner


def _nearest_members(
    candidates: FloatArray, owner: IntArray, middle: FloatArray, chosen: IntArray
) -> IntArray:
    """Return the candidate of each region that is nearest to the region's middle."""
    distance = np.sum((candidates - middle[owner]) ** 2, axis=1)
    order = np.lexsort((np.arange(len(candidates)), distance, owner))
    first = np.searchsorted(owner[order], np.arange(len(middle)))
    moved = chosen.copy()
    present = (first < len(order)) & (
        owner[order[np.minimum(first, len(order) - 1)]] == np.arange(len(middle))
    )
    moved[present] = order[first[present]]
    return moved


def _least_gap(points: FloatArray) -> float:
    """Return the smallest squared distance between two points."""
    order = np.argsort(points[:, 0], kind="stable")
    placed = points[order]
    least = np.inf
    for offset in range(1, len(placed)):
        step = placed[offset:] - placed[:-offset]
        if float((step[:, 0] ** 2).min()) >= least:
            break
        least = min(least, float(np.sum(step * step, axis=1).min()))
    return least
