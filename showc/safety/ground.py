"""Regions on the ground that a flight may reach, enclosed in discs.

Every piece of the flight is enclosed in a disc; discs that decide a question are cut
until what they leave open is small. A bound that all discs keep, the flight keeps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.safety.landing import Boxes
from showc.safety.pieces import Pieces, Place
from showc.script.fence import fence_distance, inside_polygon

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from showc.arrays import FloatArray
    from showc.safety.landing import FallTable

    Measure = Callable[[FloatArray], FloatArray]
    """From points (n, 2) to m numbers each, (n, m), none of which changes by more than
    the way between two points [m]."""

OPEN = 0.05
"""Distance that bounds may leave open [m]."""
ROUNDS = 24
"""How often pieces are halved at most; each round leaves half of what was open."""
DIRECTIONS = 240
"""Directions of a hull: its corners lie at most 0.01 % outside a circle."""
BLOCK = 20_000
"""Pieces that are looked at together."""


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
    """Lower bounds on measures over a region."""

    bound: FloatArray
    """Shape (m,) [m]."""
    places: tuple[Place, ...]
    """Which piece each is of; its drone and the middle of its time."""


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
            boxes = boxes_of(pieces, self.ground)
            found = self.table(boxes)
            level = level + found.carry[:, None, None] * pieces.velocity[:, :, :2]
            rest, spread = rest + found.radius, found.spread
        low, high = level.min(axis=1), level.max(axis=1)
        centre = 0.5 * (low + high)
        motion = np.hypot(*np.moveaxis(level - centre[:, None], 2, 0)).max(axis=1)
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
            low, high = level.min(axis=1), level.max(axis=1)
            centre = 0.5 * (low + high)
            motion = np.hypot(*np.moveaxis(level - centre[:, None], 2, 0)).max(axis=1)
        if self.turn:
            # A chord: 2 R sin(turn / 2), up to half a turn.
            far = np.hypot(centre[:, 0], centre[:, 1]) + motion
            rest = rest + 2.0 * far * np.sin(0.5 * min(self.turn, np.pi))
        return Discs(centre, motion + rest, motion + spread)


def boxes_of(pieces: Pieces, ground: float) -> Boxes:
    """Enclose the states of ``pieces`` that matter for falls to ``ground`` [m]."""
    climb, height = pieces.velocity[:, :, 2], pieces.position[:, :, 2] - ground
    level = pieces.velocity[:, :, :2]
    middle = 0.5 * (level.min(axis=1) + level.max(axis=1))
    spread = np.linalg.norm(level - middle[:, None], axis=2).max(axis=1)
    speed = np.linalg.norm(middle, axis=1)
    return Boxes(
        climb.min(axis=1),
        climb.max(axis=1),
        np.maximum(speed - spread, 0.0),
        speed + spread,
        height.min(axis=1),
        height.max(axis=1),
    )


def least(pieces: Pieces, footing: Footing, measure: Measure) -> Least:
    """Bound measures over all that a flight may reach from below.

    Parameters
    ----------
    pieces
        The flight.
    footing
        What it may reach.
    measure
        Numbers that no point may have too small.
    """
    found = reached = np.full(1, np.inf)
    places: list[Place] = []
    for cut in range(ROUNDS + 1):
        left = []
        for part in _blocks(pieces):
            discs = footing.discs(part)
            low = measure(discs.centre) - discs.radius[:, None]
            # Points that are reached for sure say how far bounds need be followed.
            likely = np.unique((low + 2.0 * discs.motion[:, None]).argmin(axis=0))
            points = footing.discs(part.select(likely).starts())
            seen = measure(points.centre) - points.radius[:, None]
            reached = np.minimum(reached, seen.min(axis=0))
            open_ = (low < reached - OPEN).any(axis=1) & (cut < ROUNDS)
            left.append(part.select(open_))
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
        pieces = Pieces.joined(left).parts(2)
        if not len(pieces):
            break
    return Least(found, tuple(places))


def _blocks(pieces: Pieces) -> Iterator[Pieces]:
    """Pieces in blocks that bound the memory."""
    for top in range(0, len(pieces), BLOCK):
        yield pieces.select(np.arange(top, min(top + BLOCK, len(pieces))))


def hull(pieces: Pieces, footing: Footing) -> FloatArray:
    """Enclose all that a flight may reach in a convex polygon, (n, 2) [m]."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reach = -least(pieces, footing, lambda points: -points @ outward.T).bound
    return corners_of(outward, reach)


def corners_of(outward: FloatArray, reach: FloatArray) -> FloatArray:
    """Return the polygon of all points with ``outward . point <= reach``.

    Parameters
    ----------
    outward
        Unit vectors by increasing angle all around, shape (n, 2).
    reach
        Support of a convex set in these directions, shape (n,) [m].

    Returns
    -------
    ndarray, shape (n, 2)
        A corner between each direction and the next; several may coincide.
    """
    one, other = outward, np.roll(outward, -1, axis=0)
    cross = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    level, next_level = reach, np.roll(reach, -1)
    return np.stack(
        [
            (level * other[:, 1] - next_level * one[:, 1]) / cross,
            (next_level * one[:, 0] - level * other[:, 0]) / cross,
        ],
        axis=1,
    )


def widened(corners: FloatArray, distance: float) -> FloatArray:
    """Enclose all within ``distance`` [m] of a hull that :func:`hull` has made."""
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return corners_of(outward, (corners @ outward.T).max(axis=0) + distance)


def area(corners: FloatArray) -> float:
    """Area of a polygon (n, 2) [m²]."""
    x, y = corners.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))


def outline(points: FloatArray, *, closed: bool) -> FloatArray:
    """Return a line as a polygon without area, there and back; areas as they are."""
    return points if closed else np.concatenate([points, points[-2:0:-1]])


def outside(corners: FloatArray) -> Measure:
    """Distance from a polygon, negative inside."""

    def measure(points: FloatArray) -> FloatArray:
        distance = fence_distance(points, corners)
        within = inside_polygon(points, corners)
        return np.where(within, -distance, distance)[:, None]

    return measure


def within(corners: FloatArray) -> Measure:
    """Distance from a polygon's edge inside it, negative outside."""
    away = outside(corners)
    return lambda points: -away(points)
