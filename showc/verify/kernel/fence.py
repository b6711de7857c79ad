"""The fence in flight: every drone inside the polygon, with the distance asked for.

**Theorem.** At every instant of a segment the logged level position of every drone lies
inside the fence, at least what :func:`enclosed` returns from each of its edges. The
polygon may be concave. What is flown keeps that distance less its radius
(:mod:`showc.verify.kernel.dynamics`).

Proof. On a mesh interval a position lies in the convex hull of its Bernstein
coefficients (Farouki 2012, section 4). Where n is a unit vector, the least of n . b
over the coefficients b, less the greater of n . c over both ends c of an edge, bounds
the distance between hull and edge from below: the two lie on different sides of a strip
of that width (Boyd and Vandenberghe 2004, Convex Optimization, section 2.5.1). Three
directions are tried for each edge, both its normals and the one from it to the middle
of the flight; the best counts, and the worst edge decides. Intervals that could come
nearer than the nearest end so far are halved, until both are :data:`RESOLUTION` apart.
An interval that begins inside and touches no edge stays inside; that it begins inside
is decided by counting the edges that a ray crosses (Shimrat 1962, Algorithm 112).

*Rounding* takes fewer than 1000 steps, so :data:`GAMMA` of the greatest coordinate
bounds it (Higham 2002, section 3.1).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.bernstein import least
from showc.verify.kernel.dynamics import GAMMA
from showc.verify.kernel.slices import innermost

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray

RESOLUTION = 1e-6  # width of the enclosure of the least distance [m]


def enclosed(path: FloatArray, fence: FloatArray) -> tuple[float, int]:
    """Lower bound of the distance of paths (rows, degree + 1, 2), and the worst row."""
    rounding = GAMMA * float(max(np.abs(path).max(), np.abs(fence).max()))
    outside = ~_inside(path[:, 0], fence)
    if outside.any():
        away = np.where(outside, _distance(path[:, 0], fence), -1.0)
        worst = int(np.argmax(away))
        return -float(away[worst]) - rounding, worst
    bounded, reached = (partial(one, fence=fence) for one in (_separation, _distance))
    found = least(np.ascontiguousarray(path), bounded, reached, RESOLUTION)
    return found.lower - rounding, found.row


def _separation(path: FloatArray, fence: FloatArray) -> FloatArray:
    """Width (rows,) of the widest strip found between each path and its worst edge."""
    middle = 0.5 * (path[:, 0] + path[:, -1])
    worst, seconds = np.full(path.shape[0], np.inf), np.roll(fence, -1, axis=0)
    ways = _to_edges(middle, fence)
    for first, second, way in zip(fence, seconds, ways, strict=True):
        x, y = second - first
        across = np.array([-y, x]) / (float(np.hypot(x, y)) or 1.0)
        size = np.hypot(way[:, 0], way[:, 1])
        towards = -way / np.where(size > 0.0, size, 1.0)[:, None]
        best = np.full(path.shape[0], -np.inf)
        for normal in (across[None], -across[None], towards):
            reach = np.einsum("rjk,rk->rj", path, np.broadcast_to(normal, middle.shape))
            edge = np.maximum(normal @ first, normal @ second)
            best = np.maximum(best, reach.min(axis=1) - edge)
        worst = np.minimum(worst, best)
    return worst


def _to_edges(points: FloatArray, fence: FloatArray) -> FloatArray:
    """Ways (e, n, 2) from points (n, 2) to the nearest one of each edge."""
    corners = fence[:, None] - points
    return innermost(corners, np.roll(corners, -1, axis=0))


def _distance(points: FloatArray, fence: FloatArray) -> FloatArray:
    """Distance (n,) of points (n, 2) from the nearest edge."""
    return np.asarray(np.linalg.norm(_to_edges(points, fence), axis=2).min(axis=0))


def _inside(points: FloatArray, fence: FloatArray) -> BoolArray:
    """Whether points (n, 2) lie inside: a ray along +x crosses an odd number of edges.

    Rounding can err only for points within it of an edge; these have no distance left.
    """
    (x, y), (x1, y1), (x2, y2) = points.T[:, :, None], fence.T, np.roll(fence, -1, 0).T
    crosses = (y1 > y) != (y2 > y)
    level = np.where(y1 == y2, 1.0, y2 - y1)
    before = x < x1 + (y - y1) / level * (x2 - x1)
    return np.asarray(np.count_nonzero(crosses & before, axis=1) % 2 == 1)
