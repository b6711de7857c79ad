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

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.bernstein import least
from showc.verify.kernel.dynamics import GAMMA

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray


RESOLUTION = 1e-6
"""Width of the enclosure of the least distance [m]."""


def enclosed(path: FloatArray, fence: FloatArray) -> tuple[float, int]:
    """Lower bound of the distance of paths (rows, degree + 1, 2), and the worst row."""
    rounding = GAMMA * float(max(np.abs(path).max(), np.abs(fence).max()))
    outside = ~_inside(path[:, 0], fence)
    if outside.any():
        away = np.where(outside, _to_edges(path[:, 0], fence), -1.0)
        worst = int(np.argmax(away))
        return -float(away[worst]) - rounding, worst
    found = least(
        np.ascontiguousarray(path),
        lambda some: _separation(some, fence),
        lambda ends: _to_edges(ends, fence),
        RESOLUTION,
    )
    return found.lower - rounding, found.row


def _separation(path: FloatArray, fence: FloatArray) -> FloatArray:
    """Width (rows,) of the widest strip found between each path and its worst edge."""
    middle = 0.5 * (path[:, 0] + path[:, -1])
    worst = np.full(path.shape[0], np.inf)
    for first, second in zip(fence, np.roll(fence, -1, axis=0), strict=True):
        along = second - first
        length = float(np.hypot(*along))
        across = np.array([-along[1], along[0]]) / (length or 1.0)
        near = middle - _nearest_point(middle, first, along)
        size = np.hypot(near[:, 0], near[:, 1])
        towards = near / np.where(size > 0.0, size, 1.0)[:, None]
        best = np.full(path.shape[0], -np.inf)
        for normal in (across[None], -across[None], towards):
            reach = np.einsum("rjk,rk->rj", path, np.broadcast_to(normal, middle.shape))
            edge = np.maximum(normal @ first, normal @ second)
            best = np.maximum(best, reach.min(axis=1) - edge)
        worst = np.minimum(worst, best)
    return worst


def _nearest_point(
    points: FloatArray, first: FloatArray, along: FloatArray
) -> FloatArray:
    square = float(along @ along) or 1.0
    share = np.clip((points - first) @ along / square, 0.0, 1.0)
    return np.asarray(first + share[:, None] * along)


def _to_edges(points: FloatArray, fence: FloatArray) -> FloatArray:
    """Distance (n,) of points (n, 2) from the nearest edge."""
    found = np.full(points.shape[0], np.inf)
    for first, second in zip(fence, np.roll(fence, -1, axis=0), strict=True):
        off = points - _nearest_point(points, first, second - first)
        found = np.minimum(found, np.hypot(off[:, 0], off[:, 1]))
    return found


def _inside(points: FloatArray, fence: FloatArray) -> BoolArray:
    """Whether points (n, 2) lie inside: a ray along +x crosses an odd number of edges.

    Rounding can err only for points within it of an edge; these have no distance left.
    """
    odd = np.zeros(points.shape[0], dtype=bool)
    for first, second in zip(fence, np.roll(fence, -1, axis=0), strict=True):
        crosses = (first[1] > points[:, 1]) != (second[1] > points[:, 1])
        if crosses.any():
            share = (points[:, 1] - first[1]) / (second[1] - first[1])
            odd ^= crosses & (points[:, 0] < first[0] + share * (second[0] - first[0]))
    return odd
