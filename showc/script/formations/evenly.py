"""Even distribution: few points that cover many candidates well.

Farthest-point sampling (Gonzalez 1985) starts it: each new point is the candidate
furthest from those chosen, so that no two are ever close. A few rounds of Lloyd's
method (Lloyd 1982) then centre each point in what it covers. Nothing is random.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.spacing import boxes, closest
from showc.vehicle import Separation

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray


_ROUNDS = 8
"""Most rounds of Lloyd's method; more moved no point of the formations tried."""
_CENTRED = 300
"""Up to how many points they are centred [points]. Of 500 points or more in drawings,
meshes and images, no round ever parted the two closest further."""
_BOX = 192
"""Candidates of a box: as many as take no longer than the steps of Python."""
_BLOCK = 65_536
"""Distances worked out at a time: two arrays of them stay in the cache."""


def candidates_for(count: int) -> int:
    """Return how many candidates suffice for a number of points."""
    return max(3000, min(12 * count, 12_000 + 6 * count))


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
        Rounds of Lloyd's method; None: as many as can help. The round is kept whose
        two closest points are the furthest apart, because separation is what counts
        most.

    Returns
    -------
    IntArray
        Indices of the chosen candidates, shape (count,), in order of the candidates'
        first coordinates.
    """
    if rounds is None:
        rounds = _ROUNDS if count <= _CENTRED else 0
    chosen = farthest_points(candidates, count)
    rounds = rounds if 1 < count < len(candidates) else 0
    best, width = chosen, _least_gap(candidates[chosen]) if rounds else 0.0
    for _ in range(rounds):
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
    """Choose candidates one by one, each furthest from all before.

    Only boxes of candidates are looked at again that a new point may be nearer to
    than all before; which is chosen does not depend on the boxes.

    Returns
    -------
    IntArray
        Indices of the chosen, shape (count,).
    """
    middle = candidates.mean(axis=0)
    away = np.sum((candidates - middle) ** 2, axis=1)
    chosen = np.empty(count, dtype=np.int64)
    chosen[0] = int(np.argmax(np.round(away, 9)))
    rows = np.sort(boxes(candidates, _BOX), axis=1)
    points = np.ascontiguousarray(np.moveaxis(candidates[rows], 2, 1))
    low, high = points.min(axis=2).T.copy(), points.max(axis=2).T.copy()
    distance = np.full(rows.shape, np.inf)
    # Of each box, the candidate that is furthest from what is chosen.
    most, furthest = np.full(len(rows), np.inf), rows[:, 0].copy()
    order = np.arange(len(rows))
    for index in range(count):
        if index:
            # Of several the first: boxes lie in no order of their candidates.
            chosen[index] = furthest[most == most.max()].min()
        last = candidates[chosen[index], :, None]
        gap = np.maximum(np.maximum(low - last, last - high), 0.0)
        gap *= gap
        near = (np.add.reduce(gap, axis=0) < most).nonzero()[0]
        step = points.take(near, axis=0)
        step -= last
        step *= step
        square = np.add.reduce(step, axis=1)
        np.minimum(square, distance.take(near, axis=0), out=square)
        distance[near] = square
        at = square.argmax(axis=1)
        most[near] = square[order[: near.size], at]
        furthest[near] = rows[near, at]
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
    """Return the smallest distance between two points [m]."""
    flat = np.zeros((len(points), 3 - points.shape[1]))
    apart = float(np.ptp(points, axis=0).sum())
    pair = closest(np.hstack([points, flat]), 2.0 * apart, Separation(1.0))
    return pair.distance if pair is not None else 0.0
