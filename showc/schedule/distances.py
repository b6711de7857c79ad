"""Distances of points and of straight parts, in the separation's metric."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.autopilot.stage import Stage
    from showc.vehicle import Separation

    Pairs = tuple[IntArray, IntArray]

BLOCK = 500_000
"""Pairs that are looked at together; bounds the memory."""


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
    if np.any(scale != 1.0):
        first, second = ((side[0] * scale, side[1] * scale) for side in (first, second))
    return segment_distance(
        first[0], first[1] - first[0], second[0], second[1] - second[0]
    )


def point_distance(
    point: FloatArray, part: tuple[FloatArray, FloatArray], separation: Separation
) -> FloatArray:
    """Least distance (m,) of points (m, 3) from straight parts, as part_distance."""
    if separation.shape in {"any-axis", "all-axes"}:
        return part_distance((point, point), part, separation)
    scale = np.array(separation.metric_scale)
    squared = _squared_to_segment(
        (point - part[0]) * scale, (part[1] - part[0]) * scale
    )
    return np.asarray(np.sqrt(squared))


def nearest_pair(
    points: FloatArray, separation: Separation, moving: BoolArray
) -> tuple[int, int, float]:
    """Return the nearest two of ``points`` (n, 3) with a mover, and their distance.

    ``moving`` (n,) marks drones that move. Infinite where there is no such pair.
    """
    boxes = _Boxes(points, points, separation, moving)
    limit = np.inf
    # Neighbours in some orders are near each other, in a grid the nearest.
    for keys in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        order = np.lexsort(tuple(boxes.low[axis] for axis in keys))
        gap = boxes.gaps(order[:-1], order[1:])
        limit = min(limit, float(gap.min(initial=np.inf)))
    best = np.inf, 0, 0
    for a, b, gap in boxes.within(limit):
        if gap.size:
            least = np.lexsort((b, a, gap))[0]
            best = min(best, (float(gap[least]), int(a[least]), int(b[least])))
    return best[1], best[2], best[0]


def near_pairs(
    parts: tuple[FloatArray, FloatArray],
    separation: Separation,
    distance: float,
    moving: BoolArray,
) -> tuple[IntArray, IntArray]:
    """Return the pairs with a mover whose straight parts may be within ``distance``.

    ``parts`` holds the two ends of each, (n, 3). Quick: boxes around the parts are no
    farther from each other than the parts. First below second, each of shape (m,).
    """
    boxes = _Boxes(*parts, separation, moving)
    # Rounding must not hide a pair.
    count = moving.size
    found = [a * count + b for a, b, _ in boxes.within(distance * (1.0 + 1e-9))]
    if not found:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    a, b = np.divmod(np.sort(np.concatenate(found)), count)
    return a, b


class _Boxes:
    """Boxes around straight parts, whose ends are (n, 3) [m], in the metric.

    ``moving`` (n,) marks drones that move; pairs that both rest are left out.
    """

    def __init__(
        self,
        one: FloatArray,
        other: FloatArray,
        separation: Separation,
        moving: BoolArray,
    ) -> None:
        scale = np.array(separation.metric_scale)
        self.low = np.ascontiguousarray((np.minimum(one, other) * scale).T)
        self.high = np.ascontiguousarray((np.maximum(one, other) * scale).T)
        self.shape, self.moving = separation.shape, moving

    def within(self, limit: float) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
        """Pairs no farther apart than ``limit`` [m], first below second; in any order.

        Yields
        ------
        tuple of ndarray
            Positions of the first and the second, and how far they are apart [m].
        """
        for a, b in self._candidates(limit):
            for axis in range(3):
                # One axis that is too far is enough, but where it takes all.
                if self.shape != "all-axes":
                    near = self._gap(axis, a, b) <= limit
                    a, b = a[near], b[near]  # noqa: PLW2901
            gap = self.gaps(a, b)
            near = gap <= limit
            yield np.minimum(a, b)[near], np.maximum(a, b)[near], gap[near]

    def gaps(self, a: IntArray, b: IntArray) -> FloatArray:
        """How far the boxes of pairs (m,) are apart [m]; infinite if neither moves."""
        x, y, z = (self._gap(axis, a, b) for axis in range(3))
        if self.shape == "all-axes":
            found = np.minimum(np.minimum(x, y), z)
        elif self.shape == "any-axis":
            found = np.maximum(np.maximum(x, y), z)
        else:
            found = np.sqrt(x * x + y * y + z * z)
        found[~(self.moving[a] | self.moving[b])] = np.inf
        return found

    def _gap(self, axis: int, a: IntArray, b: IntArray) -> FloatArray:
        low, high = self.low[axis], self.high[axis]
        return np.asarray(
            np.maximum(np.maximum(low[a] - high[b], low[b] - high[a]), 0.0)
        )

    def _candidates(self, limit: float) -> Iterator[tuple[IntArray, IntArray]]:
        """Pairs that are within ``limit`` on the axis on which the fewest are."""
        count = self.moving.size
        rank = np.arange(count)
        # Whose low ends are between a box's low end and its high end, and the limit.
        orders = [np.argsort(low, kind="stable") for low in self.low]
        lasts = [
            np.searchsorted(low[order], high[order] + limit, side="right")
            for low, high, order in zip(self.low, self.high, orders, strict=True)
        ]
        axis = int(np.argmin([last.sum() for last in lasts]))
        order, last = orders[axis], lasts[axis]
        if self.shape == "all-axes":
            last = np.full(count, count)
        partners = np.maximum(last - rank - 1, 0)
        begun = np.concatenate([[0], np.cumsum(partners)])
        first = 0
        while first < count:
            end = int(np.searchsorted(begun, begun[first] + BLOCK, side="right")) - 1
            end = max(end, first + 1)
            rows = np.repeat(rank[first:end], partners[first:end])
            place = np.arange(begun[first], begun[end]) - begun[rows]
            yield order[rows], order[rows + 1 + place]
            first = end


def segment_distance(
    p: FloatArray, u: FloatArray, q: FloatArray, v: FloatArray
) -> FloatArray:
    """Least distance (m,) between segments p + [0, 1] u and q + [0, 1] v, all (m, 3).

    The place on the first line that is nearest to the second, moved into the segment;
    the nearest place to it on the second one; and the nearest to that on the first one
    (Ericson 2005, Real-Time Collision Detection, section 5.1.9). The least distance of
    parallel segments is at an end of one of them.
    """
    w = p - q
    uu, uv, vv = dot(u, u), dot(u, v), dot(v, v)
    uw, vw = dot(u, w), dot(v, w)
    determinant = uu * vv - uv * uv
    regular = determinant > 1e-12 * uu * vv
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.clip((uv * vw - vv * uw) / determinant, 0.0, 1.0)
        t = np.clip((uv * s + vw) / vv, 0.0, 1.0)
        s = np.clip((uv * t - uw) / uu, 0.0, 1.0)
    gap = w + s[:, None] * u - t[:, None] * v
    squared = dot(gap, gap)
    parallel = np.flatnonzero(~regular)
    if parallel.size:
        w, u, v = w[parallel], u[parallel], v[parallel]
        squared[parallel] = np.minimum.reduce(
            [
                _squared_to_segment(w, v),
                _squared_to_segment(w + u, v),
                _squared_to_segment(-w, u),
                _squared_to_segment(v - w, u),
            ]
        )
    return np.asarray(np.sqrt(squared))


def _squared_to_segment(point: FloatArray, along: FloatArray) -> FloatArray:
    """Squared distances (m,) of points from segments [0, 1] ``along``, both (m, 3)."""
    length = dot(along, along)
    at = dot(point, along) / np.where(length > 0.0, length, 1.0)
    rest = point - np.clip(at, 0.0, 1.0)[:, None] * along
    return dot(rest, rest)


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products (m,) of the vectors ``a`` and ``b``, both (m, 3)."""
    return np.asarray(np.einsum("ij,ij->i", a, b))


def crossing_pairs(stage: Stage, separation: Separation, required: float) -> Pairs:
    """Pairs of a stage's drones whose lines come nearer than ``required`` [m].

    Lines go on beyond their ends by the overshoot.

    Returns
    -------
    tuple of ndarray
        Positions in the stage, first below second, each of shape (m,).
    """
    farthest = stage.farthest
    everyone = np.ones(stage.drones.size, dtype=np.bool_)
    a, b = near_pairs((stage.begin, farthest), separation, required, everyone)
    near = (
        part_distance(
            (stage.begin[a], farthest[a]), (stage.begin[b], farthest[b]), separation
        )
        < required
    )
    return a[near], b[near]


def conflict_colours(stage: Stage, separation: Separation, required: float) -> IntArray:
    """Give drones whose lines meet different numbers, few and small; shape (n,).

    Greedy colouring, drones with most conflicts first (Welsh and Powell 1967).
    """
    a, b = crossing_pairs(stage, separation, required)
    count = stage.drones.size
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for one, other in zip(a.tolist(), b.tolist(), strict=True):
        neighbours[one].append(other)
        neighbours[other].append(one)
    colour = np.full(count, -1, dtype=np.int64)
    for node in _by_degree(neighbours):
        taken = {int(colour[other]) for other in neighbours[node]}
        colour[node] = next(free for free in range(count) if free not in taken)
    return colour


def _by_degree(neighbours: list[list[int]]) -> Iterator[int]:
    return iter(sorted(range(len(neighbours)), key=lambda i: (-len(neighbours[i]), i)))
