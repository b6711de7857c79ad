"""How far inside a fence a fleet stays, at every instant.

The signed distance of a point to a polygon, positive on the side where drones may be,
changes by no more than the point moves. So a piece of flight whose control points lie
within a radius of some point keeps at least that point's distance less the radius. It
also keeps the distance of its chord, less how far its control points are from that.
Pieces that could come nearer than the nearest place known are halved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from showc.foreign.motion import Greatest
from showc.verify.kernel.bernstein import halves

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.foreign.show import FencePolygon
    from showc.verify.kernel.slices import Tracks


RESOLUTION = 1e-4
"""Width of the enclosure [m]: a tenth of the millimetre that files count in."""

MOST_CORNERS = 1000
"""Corners of all polygons of a fence: ten times what autopilots hold."""

MOST_PAIRS = 100_000_000
"""Pieces of flight, each with every corner of a fence, that are looked at: a thousand
drones of ten minutes, two pieces a second, and eighty corners."""

_ROUNDS = 40
"""Halvings at most: an hour is then cut to 3 nanoseconds."""
_AT_ONCE = 50_000
"""Distances of a point to a side that are found together; bounds the memory."""


def inside_by(points: FloatArray, polygon: FencePolygon) -> FloatArray:
    """Signed distance of ``points`` (n, 2) [m]: positive where drones may be; (n,)."""
    result = np.empty(points.shape[0])
    begin_x, begin_y = polygon.points.T
    way_x, way_y = (np.roll(polygon.points, -1, axis=0) - polygon.points).T
    square = np.maximum(way_x**2 + way_y**2, 1e-18)
    slope = way_x / np.where(way_y == 0.0, 1.0, way_y)
    block = max(1, _AT_ONCE // begin_x.size)
    for low in range(0, points.shape[0], block):
        x, y = points[low : low + block, :, None].transpose(1, 0, 2)
        rest_x, rest_y = x - begin_x, y - begin_y
        share = np.clip((rest_x * way_x + rest_y * way_y) / square, 0.0, 1.0)
        off = (rest_x - share * way_x) ** 2 + (rest_y - share * way_y) ** 2
        near = np.sqrt(off.min(axis=1))
        # A ray along +x crosses the border an odd number of times from inside.
        above = begin_y > y
        crossing = above != np.roll(above, -1, axis=1)
        odd = (crossing & (rest_x < rest_y * slope)).sum(axis=1) % 2 == 1
        result[low : low + block] = np.where(odd, near, -near)
    return np.asarray(result if polygon.inclusion else -result)


def along(begin: FloatArray, end: FloatArray, polygon: FencePolygon) -> FloatArray:
    """Distance of straight ways to the corners of a border; (n,) [m].

    Zero where a way crosses the border. With the distances of its ends, this gives the
    least distance of the whole way.
    """
    result = np.empty(begin.shape[0])
    corner_x, corner_y = polygon.points.T
    side_x, side_y = (np.roll(polygon.points, -1, axis=0) - polygon.points).T
    block = max(1, _AT_ONCE // corner_x.size)
    for low in range(0, begin.shape[0], block):
        x, y = begin[low : low + block, :, None].transpose(1, 0, 2)
        way_x, way_y = end[low : low + block, :, None].transpose(1, 0, 2) - (x, y)
        square = np.maximum(way_x**2 + way_y**2, 1e-18)
        rest_x, rest_y = corner_x - x, corner_y - y
        share = np.clip((rest_x * way_x + rest_y * way_y) / square, 0.0, 1.0)
        off = (rest_x - share * way_x) ** 2 + (rest_y - share * way_y) ** 2
        left = way_x * rest_y - way_y * rest_x > 0.0
        parted = left != np.roll(left, -1, axis=1)
        # On which side of each side of the border both ends of the way lie.
        first = side_y * rest_x - side_x * rest_y
        last = first - (side_y * way_x - side_x * way_y)
        crossed = (parted & ((first > 0.0) != (last > 0.0))).any(axis=1)
        near = np.sqrt(off.min(axis=1))
        result[low : low + block] = np.where(crossed, 0.0, near)
    return result


def beyond_reach(tracks: Tracks, fence: Sequence[FencePolygon]) -> str | None:
    """Say why flights are not held against a fence; None: they are."""
    pieces = int(tracks.starts.size)
    corners = sum(len(polygon.points) for polygon in fence)
    if pieces * corners <= MOST_PAIRS:
        return None
    return (
        f"{pieces:,} pieces of flight and {corners:,} corners are {pieces * corners:,} "
        f"pairs; at most {MOST_PAIRS:,} are judged: draw the fence with fewer corners"
    )


@dataclass(slots=True)
class Work:
    """Pairs of a piece and a corner that a search may still look at."""

    left: int = MOST_PAIRS


def furthest_outside(
    tracks: Tracks, fence: Sequence[FencePolygon], work: Work | None = None
) -> Greatest:
    """Enclose how far a drone is outside the fence at most; negative: inside [m].

    Inside means inside every polygon of inclusion and outside every other. Where the
    ``work`` does not suffice, the enclosure is wider than ``RESOLUTION``.
    """
    work = Work() if work is None else work
    pieces = _Pieces.of(tracks)
    corners = sum(len(polygon.points) for polygon in fence)
    lower, row, time = -np.inf, 0, float(tracks.begin)
    upper = -np.inf
    for _ in range(_ROUNDS):
        begins = _depths(pieces.points[:, 0], fence)
        ends = _depths(pieces.points[:, -1], fence)
        for depths, moments in ((begins, pieces.low), (ends, pieces.high)):
            outside = -depths.min(axis=0)
            index = int(np.argmax(outside))
            if outside[index] > lower:
                lower, row = float(outside[index]), int(pieces.rows[index])
                time = float(moments[index])
        bound = pieces.bound(begins, ends, fence, lower + RESOLUTION)
        keep = bound > lower + RESOLUTION
        upper = max(lower + RESOLUTION, float(bound.max()))
        work.left -= pieces.rows.size * corners
        if not keep.any() or work.left < 2 * int(keep.sum()) * corners:
            break
        pieces = pieces.halved(keep)
    owner = int(np.searchsorted(tracks.first, row, side="right")) - 1
    return Greatest(upper, lower, owner, time)


def _depths(points: FloatArray, fence: Sequence[FencePolygon]) -> FloatArray:
    return np.array([inside_by(points, polygon) for polygon in fence])


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """Pieces of flight over the ground, each of a drone's piece or a part of it."""

    points: FloatArray
    """Control points, shape (n, degree + 1, 2) [m]."""
    rows: IntArray
    """Piece of the fleet that each is of."""
    low: FloatArray
    """When each begins [s]."""
    high: FloatArray
    """When it ends [s]."""

    @classmethod
    def of(cls, tracks: Tracks) -> Self:
        rows = np.arange(tracks.starts.size)
        return cls(tracks.position[:, :, :2], rows, tracks.starts, tracks.ends)

    def bound(
        self,
        begins: FloatArray,
        ends: FloatArray,
        fence: Sequence[FencePolygon],
        enough: float,
    ) -> FloatArray:
        """Bound how far outside each is [m], no closer than is ``enough``.

        A piece lies no further from a point than its control points, and no further
        from its chord than these do. The depths of the ends are (polygons, n).
        """
        first = self.points[:, :1]
        reach = np.sqrt(((self.points - first) ** 2).sum(axis=2).max(axis=1))
        bound = np.asarray(reach - begins.min(axis=0))
        rows = np.flatnonzero(bound > enough)
        points = self.points[rows]
        begin, end = points[:, 0], points[:, -1]
        way = end - begin
        square = np.maximum((way**2).sum(axis=1), 1e-18)
        rest = points - begin[:, None]
        share = np.clip(np.einsum("nck,nk->nc", rest, way) / square[:, None], 0.0, 1.0)
        off = rest - share[:, :, None] * way[:, None]
        strayed = np.sqrt((off**2).sum(axis=2).max(axis=1))
        middle = 0.5 * (begin + end)
        radius = np.sqrt(((points - middle[:, None]) ** 2).sum(axis=2).max(axis=1))
        closer = np.full(rows.size, -np.inf)
        for number, polygon in enumerate(fence):
            ends_in = np.minimum(begins[number, rows], ends[number, rows])
            near = np.minimum(ends_in, along(begin, end, polygon))
            round_it = radius - inside_by(middle, polygon)
            # Where both ends are inside and the chord crosses nothing, all of it is.
            chord = np.where(near > 0.0, strayed - near, np.inf)
            closer = np.maximum(closer, np.minimum(round_it, chord))
        bound[rows] = np.minimum(bound[rows], closer)
        return bound

    def halved(self, keep: BoolArray) -> _Pieces:
        """Return the halves of those to keep."""
        left, right = halves(self.points[keep])
        low, high = self.low[keep], self.high[keep]
        half = 0.5 * (low + high)
        return _Pieces(
            np.concatenate([left, right]),
            np.tile(self.rows[keep], 2),
            np.concatenate([low, half]),
            np.concatenate([half, high]),
        )
