"""The fence: a polygon on the ground, concave or not, kept with a margin.

Distances to it, ways round its corners, and convex corridors within it. A way is a
shortest path in the visibility graph of points about the reflex corners (Lozano-Pérez
and Wesley 1979, An algorithm for planning collision-free paths among polyhedral
obstacles); a corridor is cut off plane by plane at the nearest point of the fence
(Liu et al. 2017, Planning dynamically feasible trajectories for quadrotors using safe
flight corridors).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import BoolArray, FloatArray
    from showc.script.show import Site


TOLERANCE = 1e-6
"""How much nearer than the margin rounding may bring a drone [m]."""
LEAST = 1e-5
"""Distance from a fence that is kept in any case [m]: nearer, no rounded number tells
inside from outside."""
_SPARE = (2.5, 1.0, 0.3, 0.01)
"""How much farther than the margin ways pass corners [m], the first that is possible:
what a drone needs for a curve."""
_TURN = np.pi / 4.0
"""Greatest angle between neighbouring points about a corner [rad]."""
_HALVINGS = 40
"""Halvings of a piece that leave less of it than rounding does."""


def inside_polygon(points: FloatArray, corners: FloatArray) -> BoolArray:
    """Tell which points, shape (n, 2), lie inside a polygon, by the even-odd rule."""
    x, y = points[:, 0], points[:, 1]
    inside = np.zeros(len(points), dtype=bool)
    closed = np.vstack([corners, corners[:1]])
    for (ax, ay), (bx, by) in pairwise(closed):
        crosses = (ay > y) != (by > y)
        if ay == by:
            continue
        inside ^= crosses & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
    return inside


def crossed_edges(corners: FloatArray) -> tuple[int, int] | None:
    """Return the first two edges of a polygon (n, 2) that cross, by their first corner.

    Returns
    -------
    tuple of int, or None
        Counting from 0; None if the outline crosses itself nowhere.
    """
    after = np.roll(corners, -1, axis=0)
    for number, (start, end) in enumerate(zip(corners, after, strict=True)):
        goals = np.broadcast_to(end, (len(corners), 2))
        crossed = np.flatnonzero(_crosses(start, goals, corners, after))
        if crossed.size:
            return number, int(crossed[0])
    return None


def area_of(corners: FloatArray) -> float:
    """Return the area of a polygon (n, 2) [m²], positive if it is counter-clockwise."""
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def polygons_meet(one: FloatArray, other: FloatArray) -> bool:
    """Tell whether two polygons (n, 2) and (m, 2) have points in common."""
    if inside_polygon(one, other).any() or inside_polygon(other, one).any():
        return True
    after = np.roll(other, -1, axis=0)
    return any(
        _crosses(start, np.broadcast_to(end, (len(other), 2)), other, after).any()
        for start, end in zip(one, np.roll(one, -1, axis=0), strict=True)
    )


def fence_distance(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return how far points, (n, 2), are from a polygon's boundary, (n,) [m]."""
    nearest = np.full(len(points), np.inf)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        gap = points - _nearest_on(start, end, points)
        nearest = np.minimum(nearest, np.hypot(gap[:, 0], gap[:, 1]))
    return nearest


def _nearest_on(start: FloatArray, end: FloatArray, points: FloatArray) -> FloatArray:
    """Points of a line nearest to ``points``, shape (n, 2) [m]."""
    way = end - start
    along = (points - start) @ way / max(float(way @ way), 1e-30)
    return np.asarray(start + np.clip(along, 0.0, 1.0)[:, None] * way)


@dataclass(frozen=True, slots=True)
class Plane:
    """A half-plane of a corridor: ``normal . (x, y) >= offset``."""

    normal: tuple[float, float]
    """Unit vector, show frame."""
    offset: float
    """[m]."""


@dataclass(frozen=True, eq=False)
class Fence:
    """A fence and the distance that is kept from it."""

    corners: FloatArray
    """Shape (n, 2), in order, show frame [m]."""
    margin: float = 0.0
    """[m]."""

    @classmethod
    def of(cls, site: Site) -> Fence | None:
        """Return a site's fence; None where the volume's walls are the fence.

        Its margin is at least :data:`LEAST`.
        """
        if site.fence is None:
            return None
        margin = max(site.fence_margin, LEAST)
        return cls(np.asarray(site.fence, dtype=np.float64), margin)

    @property
    def breach(self) -> str:
        """What a drone does that does not keep it, in words."""
        if self.margin <= LEAST:
            return "leaves the fence"
        return f"comes nearer than {self.margin:.2f} m to the fence"

    def clearance(self, points: FloatArray) -> FloatArray:
        """Return how far within the fence points (n, 2) are, negative outside [m]."""
        distance = fence_distance(points, self.corners)
        return np.where(inside_polygon(points, self.corners), distance, -distance)

    def keeps(self, points: FloatArray) -> BoolArray:
        """Tell which points (n, 2) keep the margin."""
        return np.asarray(self.clearance(points) >= self.margin - TOLERANCE)

    def first_breach(
        self, coefficients: FloatArray, breaks: FloatArray
    ) -> float | None:
        """Find where a flight comes too near the fence: a time [s], or None.

        Parts of the flight are enclosed in the circles that hold their coefficients.
        They are halved until each circle keeps the margin or a point of the flight does
        not.

        Parameters
        ----------
        coefficients
            Bernstein coefficients of x and y, shape (K, degree + 1, 2) [m].
        breaks
            Shape (K + 1,) [s].
        """
        parts, start, width = coefficients, breaks[:-1], np.diff(breaks)
        for _ in range(_HALVINGS):
            middle = 0.5 * (parts.min(axis=1) + parts.max(axis=1))
            radius = np.linalg.norm(parts - middle[:, None], axis=2).max(axis=1)
            open_ = self.clearance(middle) - radius < self.margin - TOLERANCE
            if not open_.any():
                return None
            parts, start, width = parts[open_], start[open_], width[open_]
            wrong = ~self.keeps(parts[:, 0]) | ~self.keeps(parts[:, -1])
            if wrong.any():
                return float(start[wrong].min())
            left, right = _halves(parts)
            parts = np.concatenate([left, right])
            start = np.concatenate([start, start + 0.5 * width])
            width = np.tile(0.5 * width, 2)
        return float(start.min())

    @cached_property
    def _webs(self) -> dict[float, tuple[FloatArray, FloatArray]]:
        """Points about the reflex corners and ways between them, as they are made."""
        return {}

    @cached_property
    def _inner(self) -> Fence:
        """The fence, with a margin within polygons about corners that has its room."""
        return Fence(self.corners, self.margin * float(np.cos(0.5 * _TURN)))

    def _web(self, spare: float) -> tuple[FloatArray, FloatArray]:
        """Points about corners with ``spare`` room, (m, 2), ways between, (m, m)."""
        if spare not in self._webs:
            nodes = self._around(spare)
            links = [self._lengths(node, nodes) for node in nodes]
            self._webs[spare] = nodes, np.array(links).reshape(len(nodes), len(nodes))
        return self._webs[spare]

    def _around(self, spare: float) -> FloatArray:
        """Points about the reflex corners that keep the margin, shape (m, 2) [m]."""
        corners = self.corners
        turning = np.sign(area_of(corners)) or 1.0
        found = [np.zeros((0, 2))]
        for before, corner, after in zip(
            np.roll(corners, 1, axis=0),
            corners,
            np.roll(corners, -1, axis=0),
            strict=True,
        ):
            into, out = corner - before, after - corner
            turn = turning * np.arctan2(into[0] * out[1] - into[1] * out[0], into @ out)
            if turn >= 0.0:
                continue
            first = np.arctan2(into[1], into[0]) + turning * 0.5 * np.pi
            count = int(np.ceil(-turn / _TURN)) + 1
            bearing = first + turning * turn * np.linspace(0.0, 1.0, count)
            aside = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
            step = -turn / (count - 1)
            points = corner + aside * (self.margin + spare) / np.cos(0.5 * step)
            found.append(points[self.clearance(points) >= self.margin])
        return np.concatenate(found)

    def _lengths(self, start: FloatArray, goals: FloatArray) -> FloatArray:
        """Lengths of straight ways that keep the margin, (n,) [m]; infinite else."""
        way = goals - start
        length = np.hypot(way[:, 0], way[:, 1])
        kept = self.keeps(goals) & bool(self.keeps(start[None])[0])
        # A way whose ends lie inside and that crosses no edge lies inside.
        for one, other in zip(
            self.corners, np.roll(self.corners, -1, axis=0), strict=True
        ):
            gap = np.full(len(goals), np.inf)
            for end in (one, other):
                along = (end - start) @ way.T / np.maximum(length**2, 1e-30)
                nearest = start + np.clip(along, 0.0, 1.0)[:, None] * way
                gap = np.minimum(gap, np.linalg.norm(end - nearest, axis=1))
            gap[_crosses(start, goals, one, other)] = 0.0
            kept &= gap >= self.margin - TOLERANCE
            if self.margin <= TOLERANCE:
                kept &= ~_crosses(start, goals, one, other)
        return np.where(kept, length, np.inf)

    def straight(self, start: FloatArray, goals: FloatArray) -> BoolArray:
        """Tell which straight ways from a point (2,) to others (n, 2) keep it."""
        return np.isfinite(self._lengths(start, goals))

    def way(self, start: FloatArray, goal: FloatArray) -> FloatArray | None:
        """Find the shortest way, shape (m, 2) [m], both ends included; None if none.

        Parameters
        ----------
        start, goal
            Shape (2,) [m].
        """
        if self.straight(start, goal[None])[0]:
            return np.stack([start, goal])
        for spare in _SPARE:
            found = self._way(start, goal, spare)
            if found is not None:
                return found
        return None

    def least_length(
        self,
        start: FloatArray,
        goal: FloatArray,
        measure: Callable[[FloatArray], FloatArray] | None = None,
    ) -> float:
        """Return a length that no way within the fence falls short of.

        Of the rounded room that the margin takes about a corner, it counts a polygon.

        Parameters
        ----------
        start, goal
            Shape (2,) [m].
        measure
            Lengths (n,) of straight ways (n, 2) [m] by a norm; None: in metres. By any
            norm, a shortest way turns at reflex corners alone.
        """
        measure = _metres if measure is None else measure
        ways = np.diff(self._inner.tightest(start, goal, measure), axis=0)
        return float(measure(ways).sum())

    def tightest(
        self,
        start: FloatArray,
        goal: FloatArray,
        measure: Callable[[FloatArray], FloatArray],
    ) -> FloatArray:
        """Find the shortest way by a norm that may touch the margin, shape (m, 2) [m].

        A straight one where there is none.
        """
        way = None
        if not self.straight(start, goal[None])[0]:
            way = self._way(start, goal, 0.0, measure)
        return np.stack([start, goal]) if way is None else way

    def _way(
        self,
        start: FloatArray,
        goal: FloatArray,
        spare: float,
        measure: Callable[[FloatArray], FloatArray] | None = None,
    ) -> FloatArray | None:
        nodes, links = self._web(spare)
        if not len(nodes):
            return None
        last = self._lengths(goal, nodes)
        reached = self._lengths(start, nodes)
        if measure is not None:
            apart = measure((nodes - nodes[:, None]).reshape(-1, 2))
            links = np.where(np.isfinite(links), apart.reshape(links.shape), np.inf)
            last = np.where(np.isfinite(last), measure(goal - nodes), np.inf)
            reached = np.where(np.isfinite(reached), measure(nodes - start), np.inf)
        # Dijkstra's algorithm, from the start; the goal is the last node.
        before = np.full(len(nodes), -1)
        waiting = np.ones(len(nodes), dtype=bool)
        while waiting.any():
            ahead = np.where(waiting, reached, np.inf)
            here = int(np.argmin(ahead))
            if not np.isfinite(ahead[here]):
                break
            waiting[here] = False
            through = reached[here] + links[here]
            shorter = waiting & (through < reached)
            reached = np.where(shorter, through, reached)
            before[shorter] = here
        total = reached + last
        here = int(np.argmin(total))
        if not np.isfinite(total[here]):
            return None
        places = [goal]
        while here >= 0:
            places.append(nodes[here])
            here = int(before[here])
        return np.stack([*places, start])[::-1]

    def corridor(
        self, start: FloatArray, end: FloatArray, reach: float, margin: float
    ) -> list[Plane]:
        """Cut the room about a straight piece of a way down to a convex one.

        Where the piece leaves the fence, planes lead back.

        Parameters
        ----------
        start, end
            Ends of the piece, shape (2,) [m].
        reach
            Distance beyond which the fence does not matter [m].
        margin
            Distance that the planes keep from the fence [m].
        """
        edges = np.stack([self.corners, np.roll(self.corners, -1, axis=0)], axis=1)
        leaves = not inside_polygon(np.stack([start, end]), self.corners).all()
        planes: list[Plane] = []
        while len(edges):
            on_edge, on_way = _nearest_pairs(edges, start, end)
            gap = on_way - on_edge
            distance = np.hypot(gap[:, 0], gap[:, 1])
            first = int(np.argmin(distance))
            if distance[first] > reach or distance[first] < TOLERANCE:
                break
            normal = gap[first] / distance[first]
            if leaves and not inside_polygon(on_way[first][None], self.corners)[0]:
                normal = -normal
            level = float(normal @ on_edge[first])
            planes.append(Plane((float(normal[0]), float(normal[1])), level + margin))
            # All of the nearest edge is behind, unless the piece crosses it.
            edges = _in_front(np.delete(edges, first, axis=0), normal, level)
        return planes


def _metres(ways: FloatArray) -> FloatArray:
    """Lengths of straight ways (n, 2), shape (n,) [m]."""
    return np.asarray(np.hypot(ways[:, 0], ways[:, 1]))


def _halves(parts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split polynomials (m, degree + 1, 2) in the middle, by de Casteljau."""
    left, right = [parts[:, 0]], [parts[:, -1]]
    while parts.shape[1] > 1:
        parts = 0.5 * (parts[:, :-1] + parts[:, 1:])
        left.append(parts[:, 0])
        right.append(parts[:, -1])
    return np.stack(left, axis=1), np.stack(right[::-1], axis=1)


def _crosses(
    start: FloatArray, goals: FloatArray, one: FloatArray, other: FloatArray
) -> BoolArray:
    """Tell which of the ways from ``start`` to ``goals`` (n, 2) cross an edge."""

    def side(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
        along, toward = b - a, c - a
        return np.asarray(
            along[..., 0] * toward[..., 1] - along[..., 1] * toward[..., 0]
        )

    apart = side(start, goals, one) * side(start, goals, other) < 0.0
    return np.asarray(apart & (side(one, other, start) * side(one, other, goals) < 0.0))


def _nearest_pairs(
    edges: FloatArray, start: FloatArray, end: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Nearest points of each edge (n, 2, 2) and of a way that crosses none of them."""
    best = np.full(len(edges), np.inf)
    on_edge, on_way = np.zeros((len(edges), 2)), np.zeros((len(edges), 2))
    way = end - start
    for corner in (edges[:, 0], edges[:, 1]):
        along = (corner - start) @ way / max(float(way @ way), 1e-30)
        near = start + np.clip(along, 0.0, 1.0)[:, None] * way
        gap = np.linalg.norm(corner - near, axis=1)
        closer = gap < best
        best = np.where(closer, gap, best)
        on_edge[closer], on_way[closer] = corner[closer], near[closer]
    span = edges[:, 1] - edges[:, 0]
    square = np.maximum(np.einsum("ij,ij->i", span, span), 1e-30)
    for place in (start, end):
        along = np.einsum("ij,ij->i", place - edges[:, 0], span) / square
        near = edges[:, 0] + np.clip(along, 0.0, 1.0)[:, None] * span
        gap = np.linalg.norm(place - near, axis=1)
        closer = gap < best
        best = np.where(closer, gap, best)
        on_edge[closer], on_way[closer] = near[closer], place
    return on_edge, on_way


def _in_front(edges: FloatArray, normal: FloatArray, level: float) -> FloatArray:
    """Parts of edges (n, 2, 2) on the side of a plane to which its normal points."""
    height = edges @ normal - level
    front = height > TOLERANCE
    kept = edges[front.any(axis=1)].copy()
    height, front = height[front.any(axis=1)], front[front.any(axis=1)]
    for number in np.flatnonzero(~front.all(axis=1)):
        behind = int(np.argmin(front[number]))
        share = height[number, behind] / (
            height[number, behind] - height[number, 1 - behind]
        )
        kept[number, behind] += share * (
            kept[number, 1 - behind] - kept[number, behind]
        )
    return kept
