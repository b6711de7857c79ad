"""Spacing: how close the places of a formation are, and how they are pushed apart.

Places are packed into boxes (sort-tile-recursive packing, Leutenegger, Lopez and
Edgington 1997): boxes that are farther apart than what is sought need no second look,
so that time grows with the number of places and hardly faster, however they stand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.vehicle.metric import measure, measure_parts

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.vehicle import Separation


_TOLERANCE = 1e-9
"""Share of a distance that rounding may take."""
_BOX = 16
"""Places of a box: few enough to compare all with all."""
_BATCH = 256
"""Pairs of boxes looked at together: some two megabytes."""
_CROWDED, _FEW = 20, 1
"""Boxes near a box beyond which places stand in heaps, and how many then matter."""


@dataclass(frozen=True, slots=True)
class Closeness:
    """The closest pair of places among those below a threshold."""

    first: int
    """Place, counting from 0."""
    second: int
    """Another place, or a place of the other formation."""
    distance: float
    """How far apart, in the separation's metric [m]."""


def boxes(points: FloatArray, most: int) -> IntArray:
    """Pack points into boxes of neighbours.

    Parameters
    ----------
    points
        Shape (n, k) [m], n at least 1.
    most
        Most points of a box.

    Returns
    -------
    IntArray
        Indices by box, shape (boxes, points of a box). A box with fewer points says
        its last one again.
    """
    count, extent = len(points), np.ptp(points, axis=0)
    axes = np.flatnonzero(extent > 0.0) if extent.any() else np.array([0])
    parts, total = -(-count // most), 1
    order, slab = np.arange(count), np.zeros(count, dtype=np.int64)
    while len(axes):
        # As many slabs along each axis as make boxes as wide as they are long.
        slabs = parts
        if len(axes) > 1:
            mean = np.exp(np.log(extent[axes]).mean())
            share = parts ** (1.0 / len(axes)) * extent[axes[0]] / mean
            slabs = round(min(max(share, 1.0), parts))
        order = order[np.lexsort((points[order, axes[0]], slab))]
        parts, total, axes = -(-parts // slabs), total * slabs, axes[1:]
        slab = np.arange(count) * total // count
    first = np.flatnonzero(np.diff(slab, prepend=-1))
    last = np.append(first[1:], count)[:, None] - 1
    at = first[:, None] + np.arange(int(np.max(last - first[:, None])) + 1)
    return np.asarray(order[np.minimum(at, last)], dtype=np.int64)


class _Boxes:
    """Two sets of places in boxes, and how far those are apart at least."""

    def __init__(
        self, points: FloatArray, others: FloatArray | None, separation: Separation
    ) -> None:
        self.separation = separation
        self.rows = boxes(points, _BOX)
        self.same = others is None
        self.other_rows = self.rows if others is None else boxes(others, _BOX)
        # Axis by axis: shape (3, boxes, places).
        self.placed = points.T[:, self.rows]
        self.other_placed = (
            self.placed if others is None else others.T[:, self.other_rows]
        )

    def near(self, limit: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Pairs of boxes less than a limit apart, the nearest first, and their gaps."""
        low, high = self.placed.min(axis=2), self.placed.max(axis=2)
        low2, high2 = self.other_placed.min(axis=2), self.other_placed.max(axis=2)
        first, second = _overlapping((low, high), (low2, high2), limit)
        if self.same:
            first, second = first[first <= second], second[first <= second]
        # Rounding is monotone: no pair of places is nearer than its boxes are.
        gap = np.maximum(
            low[:, first] - high2[:, second], low2[:, second] - high[:, first]
        )
        x, y, z = np.maximum(gap, 0.0)
        gaps = measure_parts(x, y, z, separation=self.separation)
        wanted = gaps < limit
        first, second, gaps = first[wanted], second[wanted], gaps[wanted]
        # Boxes with themselves come first: places near each other share a box.
        apart = (first != second) | (not self.same)
        order = np.lexsort((second, first, gaps, apart))
        return first[order], second[order], gaps[order]

    def distances(
        self, first: IntArray, second: IntArray
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Places of pairs of boxes and how far they are apart, each (pairs, m, k)."""
        one, other = self.rows[first][:, :, None], self.other_rows[second][:, None, :]
        one, other = np.broadcast_arrays(one, other)
        x, y, z = (
            np.abs(one_axis[first][:, :, None] - other_axis[second][:, None])
            for one_axis, other_axis in zip(self.placed, self.other_placed, strict=True)
        )
        distance = measure_parts(x, y, z, separation=self.separation)
        if self.same:
            distance[one == other] = np.inf
        return one, other, distance

    def closest(self, limit: float) -> Closeness | None:
        """Return the closest pair below a limit, the first of them in order."""
        if self.same:
            # What is found within the boxes is the farthest that others can matter.
            own = np.arange(len(self.rows))
            nearest = float(self.distances(own, own)[2].min())
            limit = min(limit, float(np.nextafter(nearest, np.inf)))
        first, second, gaps = self.near(limit)
        best, least = None, limit
        for start in range(0, len(first), _BATCH):
            batch = slice(start, start + _BATCH)
            within = gaps[batch] <= least
            if not within.any() or (best is not None and least == 0.0):
                break
            one, other, distance = self.distances(
                first[batch][within], second[batch][within]
            )
            nearest = float(distance.min())
            if nearest > least or nearest >= limit:
                continue
            at = distance == nearest
            pairs = np.stack([one[at], other[at]], axis=1)
            if self.same:
                pairs.sort(axis=1)
            low, high = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))[0]].tolist()
            found = Closeness(low, high, nearest)
            if best is None or _key(found) < _key(best):
                best, least = found, nearest
        return best


def _overlapping(
    one: tuple[FloatArray, FloatArray],
    other: tuple[FloatArray, FloatArray],
    limit: float,
) -> tuple[IntArray, IntArray]:
    """Pairs of boxes that may be less than a limit apart, by one level axis alone.

    Parameters
    ----------
    one, other
        Lower and upper corners of boxes, each of shape (3, boxes) [m].
    limit
        [m].
    """
    axis = int(np.argmax(np.ptp(one[0][:2], axis=1)))
    order = np.argsort(other[0][axis], kind="stable")
    low = other[0][axis][order]
    # The highest end of any box up to here: it never falls.
    high = np.maximum.accumulate(other[1][axis][order])
    # Twice the limit, for what rounding takes is not to matter.
    begin = np.searchsorted(high, one[0][axis] - 2.0 * limit)
    end = np.searchsorted(low, one[1][axis] + 2.0 * limit, side="right")
    many = np.maximum(end - begin, 0)
    first = np.repeat(np.arange(len(many)), many)
    past = np.cumsum(many) - many
    second = order[np.arange(len(first)) - np.repeat(past - begin, many)]
    return first, np.asarray(second, dtype=np.int64)


def _limit(threshold: float) -> float:
    return threshold * (1.0 - _TOLERANCE)


def close_pairs(
    points: FloatArray, threshold: float, separation: Separation
) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Yield pairs closer than a threshold, in batches: first, second, distance.

    All of them where places are spread; where they stand in heaps, only those with
    neighbours, so that time grows no faster than the number of places.

    Parameters
    ----------
    points
        Shape (n, 3) [m], n at least 1.
    threshold
        [m].
    separation
        Gives the metric, ``all-axes`` excepted.
    """
    packed = _Boxes(points, None, separation)
    first, second, _ = packed.near(_limit(threshold))
    if len(first) > _CROWDED * len(packed.rows):
        beside = second - first <= _FEW
        first, second = first[beside], second[beside]
    upper = np.triu(np.ones((packed.rows.shape[1],) * 2, dtype=bool), 1)
    for start in range(0, len(first), _BATCH):
        batch = slice(start, start + _BATCH)
        one, other, distance = packed.distances(first[batch], second[batch])
        # A box that says its last place again says its pairs again.
        told = packed.rows[:, 1:] == packed.rows[:, :-1]
        told = np.pad(told, ((0, 0), (1, 0)))
        near = (distance < _limit(threshold)) & ~told[first[batch]][:, :, None]
        near &= ~told[second[batch]][:, None, :]
        near &= (first[batch] != second[batch])[:, None, None] | upper
        yield one[near], other[near], distance[near]


def closest(
    points: FloatArray, threshold: float, separation: Separation
) -> Closeness | None:
    """Return the closest pair below a threshold, or None if all keep it."""
    if len(points) < 2:
        return None
    if separation.shape == "all-axes":
        return _closest_level(points, _limit(threshold), separation)
    return _Boxes(points, None, separation).closest(_limit(threshold))


def crowded(points: FloatArray, threshold: float, separation: Separation) -> int:
    """Count the places that are closer to another than a threshold.

    Parameters
    ----------
    points
        Shape (n, 3) [m], n at least 1.
    threshold
        [m].
    separation
        Gives the metric.
    """
    limit = _limit(threshold)
    tight = np.zeros(len(points), dtype=bool)
    if separation.shape == "all-axes":
        for column in points.T:
            order = np.argsort(column)
            at = np.flatnonzero(np.diff(column[order]) < limit)
            tight[order[at]] = tight[order[at + 1]] = True
        return int(tight.sum())
    packed = _Boxes(points, None, separation)
    first, second, _ = packed.near(limit)
    while len(first):
        one, other, distance = packed.distances(first[:_BATCH], second[:_BATCH])
        near = distance < limit
        tight[one[near]] = tight[other[near]] = True
        first, second = first[_BATCH:], second[_BATCH:]
        # Nothing is to be learnt from boxes all of whose places are known.
        open_ = ~np.all(tight[packed.rows], axis=1)
        wanted = np.flatnonzero(open_[first] | open_[second])
        first, second = first[wanted], second[wanted]
    return int(tight.sum())


def closest_between(
    points: FloatArray, others: FloatArray, threshold: float, separation: Separation
) -> Closeness | None:
    """Return the closest pair of one place of each of two sets, below a threshold."""
    if not len(points) or not len(others):
        return None
    if separation.shape == "all-axes":
        return _closest_level_between(points, others, _limit(threshold))
    return _Boxes(points, others, separation).closest(_limit(threshold))


def _closest_level(
    points: FloatArray, limit: float, separation: Separation
) -> Closeness | None:
    """Return the closest pair where the least difference along an axis counts.

    The two are neighbours in the order along that axis.
    """
    pairs = []
    for column in points.T:
        order = np.argsort(column, kind="stable")
        pairs.append(np.sort(np.stack([order[:-1], order[1:]], axis=1), axis=1))
    first, second = np.concatenate(pairs).T
    distance = measure(points[first] - points[second], separation)
    at = int(np.lexsort((second, first, distance))[0])
    if distance[at] >= limit:
        return None
    return Closeness(int(first[at]), int(second[at]), float(distance[at]))


def _closest_level_between(
    points: FloatArray, others: FloatArray, limit: float
) -> Closeness | None:
    """Return the same for one place of each of two sets."""
    best: Closeness | None = None
    every = np.arange(len(points))
    for column, beside in zip(points.T, others.T, strict=True):
        order = np.argsort(beside, kind="stable")
        right = np.searchsorted(beside[order], column)
        for at in (np.maximum(right - 1, 0), np.minimum(right, len(order) - 1)):
            distance = np.abs(beside[order[at]] - column)
            one = int(np.lexsort((order[at], every, distance))[0])
            found = Closeness(one, int(order[at[one]]), float(distance[one]))
            if found.distance < limit and (best is None or _key(found) < _key(best)):
                best = found
    return best


def _key(pair: Closeness) -> tuple[float, int, int]:
    return pair.distance, pair.first, pair.second


_MOST_ROUNDS, _EFFORT, _MARGIN = 400, 60_000, 1.0 + 1e-3
"""Most rounds of pushing; most places moved in all of them, which bounds the time; and
the part of the spacing that is aimed at, for rounds end before they reach it."""


def spread_apart(
    points: FloatArray, spacing: float, separation: Separation
) -> FloatArray:
    """Push places apart until each pair keeps the spacing.

    Close pairs push each other, half the lack each, round after round; a flat
    formation stays flat. What is not apart after a number of rounds is scaled up
    about its middle, which always ends.

    Parameters
    ----------
    points
        Places, shape (places, 3) [m].
    spacing
        Wanted distance in the separation's metric [m].
    separation
        Gives the metric; ``all-axes`` is treated as a sphere.

    Returns
    -------
    FloatArray
        New places, shape (places, 3) [m]; the same number, in the same order.
    """
    scale = np.array(separation.metric_scale)
    metric = type(separation)(separation.distance)
    placed = _apart(points * scale)
    goal = spacing * _MARGIN
    # Many places settle slowly; what they lack then, the scaling gives them.
    for _ in range(min(_MOST_ROUNDS, max(_EFFORT // len(points), 1))):
        push = np.zeros_like(placed)
        close = False
        for first, second, distance in close_pairs(placed, goal, metric):
            close = close or first.size > 0
            direction = placed[second] - placed[first]
            step = (0.5 * (goal - distance) / distance)[:, None] * direction
            for axis in range(3):
                for places, sign in ((second, 1.0), (first, -1.0)):
                    push[:, axis] += sign * np.bincount(
                        places, weights=step[:, axis], minlength=len(placed)
                    )
        if not close:
            break
        placed = placed + push
    left = closest(placed, spacing, metric)
    if left is not None:
        middle = placed.mean(axis=0)
        placed = middle + (placed - middle) * (goal / left.distance)
    return np.asarray(placed / scale, dtype=np.float64)


def _apart(points: FloatArray) -> FloatArray:
    """Move coinciding places apart by a hair, within the formation's plane."""
    centred = points - points.mean(axis=0)
    size = max(float(np.abs(centred).max()), 1.0)
    axes = np.linalg.svd(centred, full_matrices=False)[2] if len(points) > 1 else None
    if axes is None:
        return points
    right = axes[0]
    up = axes[1] if len(axes) > 1 else np.roll(right, 1)
    angle = 2.399963229728653 * np.arange(len(points))  # the golden angle
    hair = 1e-6 * size * np.sqrt((np.arange(len(points)) + 1.0) / len(points))
    flat = float(np.ptp(centred @ up)) > 1e-9 * size
    side = np.sin(angle)[:, None] * up if flat else 0.0
    _, index, count = np.unique(
        np.round(points / (1e-7 * size)), axis=0, return_index=True, return_counts=True
    )
    alone = np.zeros(len(points), dtype=bool)
    alone[index[count == 1]] = True
    moved = points + hair[:, None] * (np.cos(angle)[:, None] * right + side)
    return np.where(alone[:, None], points, moved)
