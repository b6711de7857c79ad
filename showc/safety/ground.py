"""Regions on the ground that a flight may reach, enclosed.

Every piece of the flight is enclosed in a wide disc about its places, which says for
most that they decide nothing; those that may, in a disc about where falls carry them.
Those that may still are enclosed in the direction that matters, and cut until what they
leave open is small. A bound that all pieces keep, the flight keeps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.safety.discs import Boxes
from showc.safety.landing import Courses
from showc.script.fence import area_of, inside_polygon

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.safety.landing import FallTable
    from showc.safety.pieces import Pieces, Place


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """Distances of n points from m things; the least of each point's is meant."""

    distance: FloatArray
    """Shape (n, m) [m]; the least changes by no more than the way between points."""
    away: FloatArray
    """Unit vectors in which they grow, shape (n, m, 2)."""
    line: FloatArray
    """Shape (n, m): above it the distance from a line across ``away`` serves [m]."""


if TYPE_CHECKING:
    Measure = Callable[[FloatArray], Measured]
    """Of points (n, 2) [m]."""

OPEN = 0.05
"""Distance that bounds may leave open [m]: little beside metres of position error."""
ROUNDS = 24
"""How often pieces are halved at most; each round leaves half of what was open."""
DIRECTIONS = 360
"""Directions of a hull: its corners lie at most 0.004 % outside a circle."""
LIKELY = 8
"""Points that are looked at first for each bound."""
NEAR = 2.0
"""Greatest radius of a piece's own way for which directions are looked at [m]."""
ROUNDING = 1e-9
"""How far corners and parts of pieces may be beyond what holds them [m, m/s]."""
BLOCK = 20_000
"""Pieces that are looked at together, for what the processor keeps at hand."""
SMALL = 1_000
"""Pieces whose wide discs are, for what the processor keeps at hand."""
CELLS = 64
"""Cells along each side of a show; what is far inside one decides nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Discs:
    """What pieces may reach."""

    centre: FloatArray
    """Shape (n, 2) [m]."""
    radius: FloatArray
    """Shape (n,) [m]."""
    motion: FloatArray
    """Part of the radius that shorter pieces do without, about, shape (n,) [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Least:
    """Lower bounds on the distances of a region from m things."""

    bounds: FloatArray
    """Shape (m,) [m]."""
    places: tuple[Place, ...]
    """Which piece each is of; its drone and the middle of its time."""

    @property
    def bound(self) -> float:
        """The least of all [m]."""
        return float(self.bounds.min())

    @property
    def place(self) -> Place:
        """Where that is."""
        return self.places[int(self.bounds.argmin())]


@dataclass(frozen=True, slots=True)
class Stopping:
    """A drone that leaves its path goes straight on, and is then braked."""

    reaction: float
    """Time until it is braked [s]."""
    acceleration: float
    """With which it is braked [m/s²]."""


@dataclass(frozen=True, slots=True)
class Footing:
    """How discs follow from pieces.

    Attributes
    ----------
    table
        Falls; None: the places of the flight themselves.
    wider
        Distance added on all sides [m].
    ground
        Height of the ground [m].
    turn
        Angle by which the show may be turned about its origin [rad].
    stop
        How drones stop; None: they do not.
    """

    table: FallTable | None = None
    wider: float = 0.0
    ground: float = 0.0
    turn: float = 0.0
    stop: Stopping | None = None

    def discs(self, pieces: Pieces) -> Discs:
        """Enclose what ``pieces`` may reach."""
        level = pieces.position[:, :, :2]
        rest, spread = np.full(len(pieces), self.wider), np.zeros(len(pieces))
        if self.table is not None:
            found = self.table(boxes_of(pieces, self.ground))
            level = level + found.carry[:, None, None] * pieces.velocity[:, :, :2]
            rest, spread = rest + found.radius, found.spread
        if self.stop is not None:
            boxes = boxes_of(pieces, self.ground)
            slowest, fastest = (
                self.stop.reaction + 0.5 * speed / self.stop.acceleration
                for speed in (boxes.speed_low, boxes.speed_high)
            )
            middle = 0.5 * (slowest + fastest)
            level = level + middle[:, None, None] * pieces.velocity[:, :, :2]
            spread = 0.5 * (fastest - slowest) * boxes.speed_high
            rest = rest + spread
        centre, motion = _around(level)
        rest = rest + self._chord * (np.hypot(*centre.T) + motion)
        return Discs(centre, motion + rest, motion + spread)

    def wide(self, pieces: Pieces) -> Discs:
        """Enclose what ``pieces`` may reach, whatever the way they fly: quickly."""
        boxes = boxes_of(pieces, self.ground)
        rest = np.full(len(pieces), self.wider)
        if self.table is not None:
            rest += self.table.farthest(boxes)
        if self.stop is not None:
            brake = 0.5 * boxes.speed_high / self.stop.acceleration
            rest += boxes.speed_high * (self.stop.reaction + brake)
        centre, motion = _around(pieces.position[:, :, :2])
        rest = rest + self._chord * (np.hypot(*centre.T) + motion)
        return Discs(centre, motion + rest, motion + rest)

    @property
    def _chord(self) -> float:
        """Chord of the turn about the origin, for each metre from it."""
        return float(2.0 * np.sin(0.5 * min(self.turn, np.pi)))

    def reach(self, pieces: Pieces, direction: FloatArray) -> FloatArray:
        """Bound how far each piece may reach in its own direction (n, 2), (n,) [m]."""
        if self.stop is not None:
            return np.full(len(pieces), np.inf)
        level, boxes = pieces.position[:, :, :2], boxes_of(pieces, self.ground)
        chord = self._chord * np.hypot(level[..., 0], level[..., 1]).max(axis=1)
        if self.table is None:
            found = np.einsum("nkc,nc->nk", level, direction).max(axis=1)
        else:
            slack = self._chord * boxes.speed_high
            velocity = pieces.velocity[:, :, :2]
            found = self.table.reach(Courses(boxes, level, velocity, slack, direction))
        return np.asarray(found + self.wider + chord)


def _around(level: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Discs that hold points (n, points, 2) [m]: centres (n, 2) and radii (n,)."""
    level = _points_first(level)
    centre = 0.5 * (level.min(axis=0) + level.max(axis=0))
    return centre.T, _farthest(level - centre)


def _points_first(values: FloatArray) -> FloatArray:
    """Values (n, points, c) as (points, c, n): least and greatest are found quickly."""
    return np.ascontiguousarray(np.moveaxis(values, 0, 2))


def _farthest(level: FloatArray) -> FloatArray:
    """Length of the longest of vectors (points, 2, n), (n,)."""
    return np.asarray(np.sqrt((level[:, 0] ** 2 + level[:, 1] ** 2).max(axis=0)))


def boxes_of(pieces: Pieces, ground: float) -> Boxes:
    """Enclose the states of ``pieces`` that matter for falls to ``ground`` [m]."""
    values = _points_first(pieces.state[:, :, 2:6])
    height, level, climb = values[:, 0] - ground, values[:, 1:3], values[:, 3]
    middle = 0.5 * (level.min(axis=0) + level.max(axis=0))
    spread, speed = _farthest(level - middle), _farthest(middle[None])
    # A polynomial is no faster than the fastest of its control points, whatever the
    # ball about them holds.
    return Boxes(
        climb.min(axis=0),
        climb.max(axis=0),
        np.maximum(speed - spread, 0.0),
        np.minimum(speed + spread, _farthest(level)),
        height.min(axis=0),
        height.max(axis=0),
    )


def least(
    pieces: Pieces, footing: Footing, measure: Measure, *, steady: bool = False
) -> Least:
    """Bound measures over all that a flight may reach from below.

    Parameters
    ----------
    pieces
        The flight.
    footing
        What it may reach.
    measure
        Numbers that no point may have too small.
    steady
        Whether each of its distances, not only the least, changes by no more than the
        way between points: then most pieces are passed over quickly.
    """
    # Points that are reached for sure say how far bounds need be followed.
    some = pieces.select(np.arange(0, len(pieces), len(pieces) // BLOCK + 1))
    points = some.starts()
    discs = footing.discs(points)
    low = measure(discs.centre).distance - discs.radius[:, None]
    count = min(LIKELY, len(low))
    first = np.argpartition(low, count - 1, axis=0)[:count]
    met = np.stack([_points(points, likely, footing, measure) for likely in first])
    reached = met.min(axis=0)
    likely = first[met.argmin(axis=0), np.arange(reached.size)]
    found, places = reached, [some.middle(piece) for piece in likely.tolist()]
    pieces = pieces.select(
        np.concatenate(list(_deciding(pieces, footing, measure, found, steady=steady)))
    )
    for cut in range(ROUNDS + 1):
        left, top = [], 0
        for part in _blocks(pieces, BLOCK):
            discs = footing.discs(part)
            seen = measure(discs.centre)
            low = seen.distance - discs.radius[:, None]
            near = discs.motion < NEAR
            rows, columns = np.nonzero((low < reached - OPEN) & near[:, None])
            if rows.size:
                low[rows, columns] = np.fmax(
                    low[rows, columns],
                    _sharper(part, footing, seen, discs.centre, (rows, columns)),
                )
                # What is little wider than its points, and what its direction bounds.
                narrow = (low + 2.0 * discs.motion[:, None]).argmin(axis=0)
                looked = np.where(near[:, None], low, np.inf).argmin(axis=0)
                for points in (part.starts(), part.ends()):
                    for likely in (narrow, looked):
                        ends = _points(points, likely, footing, measure)
                        reached = np.minimum(reached, ends)
            open_ = np.any(low < reached - OPEN, axis=1) & np.array(cut < ROUNDS)
            left.append(top + np.flatnonzero(open_))
            top += len(part)
            sure = np.flatnonzero(~open_)
            if not sure.size:
                continue
            first = sure[low[sure].argmin(axis=0)]
            own = low[first, np.arange(first.size)]
            places = [
                part.middle(piece) if better else places[column]
                for column, (piece, better) in enumerate(
                    zip(first.tolist(), own < found, strict=True)
                )
            ]
            found = np.minimum(found, own)
        pieces = pieces.select(np.concatenate(left)).parts(2)
        if not len(pieces):
            break
    return Least(found, tuple(places))


def _deciding(
    pieces: Pieces,
    footing: Footing,
    measure: Measure,
    reached: FloatArray,
    *,
    steady: bool,
) -> Iterator[IntArray]:
    """Yield which pieces may come nearer than what is ``reached`` (m,) [m]."""
    top = 0
    inner = _Inner(pieces, measure, reached) if steady else None
    for part in _blocks(pieces, SMALL):
        discs = footing.wide(part)
        open_ = np.arange(len(part))
        if inner is not None:
            open_ = np.flatnonzero(inner.room(discs.centre) <= discs.radius)
        low = measure(discs.centre[open_]).distance
        low -= discs.radius[open_, None]
        yield top + open_[(low <= reached).any(axis=1)]
        top += len(part)


class _Inner:
    """How much nearer points may come before they decide anything.

    That of the middles of square cells, less the way to them.

    Parameters
    ----------
    pieces
        Around whose places the cells lie.
    measure
        Distances, each of which changes by no more than the way between points.
    reached
        What of them is reached for sure, shape (m,) [m].
    """

    def __init__(self, pieces: Pieces, measure: Measure, reached: FloatArray) -> None:
        ends = pieces.position[:, 0, :2]
        self._corner = ends.min(axis=0)
        self._size = max(float(np.ptp(ends, axis=0).max()), 1.0) / CELLS
        index = np.indices((CELLS, CELLS)).reshape(2, -1).T
        self._middle = self._corner + self._size * (index + 0.5)
        self._room = np.concatenate(
            [
                (measure(some).distance - reached).min(axis=1)
                for some in np.array_split(self._middle, CELLS)
            ]
        )

    def room(self, points: FloatArray) -> FloatArray:
        """Bound it for points (n, 2) from below, (n,) [m]."""
        index = np.clip((points - self._corner) / self._size, 0, CELLS - 1).astype(int)
        cell = index[:, 0] * CELLS + index[:, 1]
        way = points - self._middle[cell]
        return np.asarray(self._room[cell] - np.hypot(way[:, 0], way[:, 1]) - ROUNDING)


def _points(
    points: Pieces, likely: IntArray, footing: Footing, measure: Measure
) -> FloatArray:
    """Bound the distance of one point of the region from each of m things, (m,) [m].

    Of the ``likely`` one (m,) of each.
    """
    points, own = points.select(likely), np.arange(likely.size)
    discs = footing.discs(points)
    seen = measure(discs.centre)
    low = seen.distance[own, own] - discs.radius
    return np.fmax(low, _sharper(points, footing, seen, discs.centre, (own, own)))


def _sharper(
    part: Pieces,
    footing: Footing,
    seen: Measured,
    centre: FloatArray,
    pairs: tuple[IntArray, IntArray],
) -> FloatArray:
    """Bound distances of pieces from things by lines across the way; NaN: no bound.

    Parameters
    ----------
    part
        The pieces.
    footing
        What they may reach.
    seen
        Distances of their ``centre`` (n, 2) [m].
    pairs
        Rows and columns of it, shape (k,).
    """
    rows, columns = pairs
    away = seen.away[rows, columns]
    far = footing.reach(part.select(rows), -away)
    own = np.einsum("kc,kc->k", centre[rows], away)
    found = seen.distance[rows, columns] - own - far
    return np.where(found > seen.line[rows, columns], found, np.nan)


def _blocks(pieces: Pieces, size: int) -> Iterator[Pieces]:
    """Pieces in blocks that bound the memory."""
    for top in range(0, len(pieces), size):
        yield pieces.select(slice(top, top + size))


def hull(pieces: Pieces, footing: Footing) -> FloatArray:
    """Enclose all that a flight may reach in a convex polygon, (n, 2) [m]."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def measure(points: FloatArray) -> Measured:
        # Twice as fast as a product of matrices, whose inner length is two.
        distance = points[:, :1] * -outward[:, 0] - points[:, 1:] * outward[:, 1]
        away = np.broadcast_to(-outward, (*distance.shape, 2))
        return Measured(distance, away, np.broadcast_to(-np.inf, distance.shape))

    return corners_of(outward, -least(pieces, footing, measure, steady=True).bounds)


def corners_of(outward: FloatArray, reach: FloatArray) -> FloatArray:
    """Return the polygon of all points with ``outward . point <= reach``.

    A square is cut by one line after the other (Sutherland and Hodgman 1974, Reentrant
    polygon clipping), so that it is convex where bounds are not those of one set.

    Parameters
    ----------
    outward
        Unit vectors by increasing angle all around, shape (n, 2).
    reach
        Support of a convex set in these directions, or more, shape (n,) [m].

    Returns
    -------
    ndarray, shape (corners, 2)
        In order, counterclockwise.
    """
    far = 2.0 * float(np.abs(reach).max()) + 1.0
    corners = far * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for normal, limit in zip(outward, reach.tolist(), strict=True):
        off = corners @ normal - limit
        after = np.roll(off, -1)
        kept, crossed = off <= ROUNDING, (off > ROUNDING) != (after > ROUNDING)
        share = off / np.where(crossed, off - after, 1.0)
        cut = corners + share[:, None] * (np.roll(corners, -1, axis=0) - corners)
        both = np.stack([corners, cut], axis=1)[np.stack([kept, crossed], axis=1)]
        # What rounding would leave nothing of stays as it is.
        corners = both if len(both) else corners
    return corners


def widened(corners: FloatArray, distance: float) -> FloatArray:
    """Enclose all within ``distance`` [m] of a hull that :func:`hull` has made."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return corners_of(outward, (corners @ outward.T).max(axis=0) + distance)


def area(corners: FloatArray) -> float:
    """Area of a polygon (n, 2) [m²]."""
    return abs(area_of(corners))


def outline(points: FloatArray, *, closed: bool) -> FloatArray:
    """Return a line as a polygon without area, there and back; areas as they are."""
    return points if closed else np.concatenate([points, points[-2:0:-1]])


def outside(corners: FloatArray) -> Measure:
    """Distances from a polygon's edges; negative inside, where they are one."""
    way = np.roll(corners, -1, axis=0) - corners
    square = np.maximum(np.sum(way**2, axis=1), 1e-30)

    def measure(points: FloatArray) -> Measured:
        gap = points[:, None] - corners
        along = np.clip(np.sum(gap * way, axis=2) / square, 0.0, 1.0)
        gap = gap - along[..., None] * way
        distance = np.hypot(gap[..., 0], gap[..., 1])
        away = gap / np.maximum(distance, 1e-12)[..., None]
        within = inside_polygon(points, corners)[:, None]
        deep = -distance.min(axis=1, keepdims=True)
        # From outside: what is beyond the line there is as far from the edge.
        line = np.where(within | (distance < 1e-9), np.inf, 0.0)
        return Measured(np.where(within, deep, distance), away, line)

    return measure


def within(corners: FloatArray) -> Measure:
    """Distance from a polygon's edge inside it, negative outside."""
    away = outside(corners)

    def measure(points: FloatArray) -> Measured:
        found = -away(points).distance.min(axis=1, keepdims=True)
        still = np.zeros((len(points), 1, 2))
        return Measured(found, still, np.full(found.shape, np.inf))

    return measure
