"""How far inside a fence a fleet stays, at every instant.

The signed distance of a point to a polygon, positive on the side where drones may be,
changes by no more than the point moves. So a piece of flight whose control points lie
within a radius of some point keeps at least that point's distance less the radius;
pieces that could come nearer than the nearest place known are halved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.foreign.motion import Greatest
from showc.verify.kernel.bernstein import halves

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.foreign.show import FencePolygon
    from showc.verify.kernel.slices import Tracks


RESOLUTION = 1e-4
"""Width of the enclosure [m]: a tenth of the millimetre that files count in."""

_ROUNDS = 40
"""Halvings at most: an hour is then cut to 3 nanoseconds."""
_AT_ONCE = 50_000
"""Points whose distances are found together; bounds the memory."""


def inside_by(points: FloatArray, polygon: FencePolygon) -> FloatArray:
    """Signed distance of ``points`` (n, 2) [m]: positive where drones may be; (n,)."""
    result = np.empty(points.shape[0])
    begin = polygon.points
    way = np.roll(begin, -1, axis=0) - begin
    square = np.maximum(np.einsum("mk,mk->m", way, way), 1e-18)
    for low in range(0, points.shape[0], _AT_ONCE):
        block = points[low : low + _AT_ONCE]
        rest = block[:, None] - begin
        share = np.clip(np.einsum("nmk,mk->nm", rest, way) / square, 0.0, 1.0)
        off = rest - share[:, :, None] * way
        near = np.sqrt(np.einsum("nmk,nmk->nm", off, off).min(axis=1))
        # A ray along +x crosses the border an odd number of times from inside.
        above = begin[:, 1] > block[:, None, 1]
        crossing = above != np.roll(above, -1, axis=1)
        rise = np.where(way[:, 1] == 0.0, 1.0, way[:, 1])
        at = begin[:, 0] + (block[:, None, 1] - begin[:, 1]) / rise * way[:, 0]
        odd = (crossing & (block[:, None, 0] < at)).sum(axis=1) % 2 == 1
        result[low : low + _AT_ONCE] = np.where(odd, near, -near)
    return np.asarray(result if polygon.inclusion else -result)


def furthest_outside(tracks: Tracks, fence: Sequence[FencePolygon]) -> Greatest:
    """Enclose how far a drone is outside the fence at most; negative: inside [m].

    Inside means inside every polygon of inclusion and outside every other.
    """

    def outside(points: FloatArray) -> FloatArray:
        depth = [inside_by(points, polygon) for polygon in fence]
        return np.asarray(-np.min(depth, axis=0))

    work = tracks.position[:, :, :2]
    rows = np.arange(tracks.starts.size)
    low, high = tracks.starts, tracks.ends
    lower, row, time = -np.inf, 0, float(tracks.begin)
    for _ in range(_ROUNDS):
        middle = 0.5 * (work[:, 0] + work[:, -1])
        radius = np.sqrt(((work - middle[:, None]) ** 2).sum(axis=2).max(axis=1))
        begins = outside(work[:, 0])
        index = int(np.argmax(begins))
        if begins[index] > lower:
            lower, row, time = float(begins[index]), int(rows[index]), float(low[index])
        ends = outside(work[:, -1])
        index = int(np.argmax(ends))
        if ends[index] > lower:
            lower, row, time = float(ends[index]), int(rows[index]), float(high[index])
        bound = outside(middle) + radius
        keep = bound > lower + RESOLUTION
        if not keep.any():
            upper = lower + RESOLUTION
            break
        left, right = halves(work[keep])
        half = 0.5 * (low[keep] + high[keep])
        rows = np.tile(rows[keep], 2)
        low, high = (
            np.concatenate([low[keep], half]),
            np.concatenate([half, high[keep]]),
        )
        work = np.concatenate([left, right])
    else:
        upper = float(bound.max())
    owner = int(np.searchsorted(tracks.first, row, side="right")) - 1
    return Greatest(upper, lower, owner, time)
