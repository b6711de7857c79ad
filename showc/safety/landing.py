"""Where falls end, enclosed: by direction, and more widely in discs.

Falls are integrated from a grid of climbs, airspeeds, drags and heights. A drone with
the velocity u over ground that starts with the airspeed a = u - w lands, after the time
T, at u T - L a, where L = T - (way through the air) / |a|. How far it may go in a
direction b with any wind is a search over |a|: (u, b) T and the greatest of -(a, b) L.
Between the falls of the grid lies what interpolation may miss
(:mod:`showc.safety.remainder`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from showc.safety.discs import COARSE, ROUNDING, WIDE, Boxes, Discs, Impacts, air_met
from showc.safety.fall import AIRSPEED, CELL, DRAG_CELLS, HEAD, Fall, falls
from showc.safety.remainder import remainder

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray


TOGETHER = 256
"""Reaches that are worked out together, for what the processor keeps at hand."""
DRAG_PARTS = 5
"""Parts of the drags whose falls are integrated one after the other, likewise."""


@dataclass(frozen=True, slots=True, eq=False)
class Courses:
    """States that may fall, and the direction in which each may not go too far."""

    boxes: Boxes
    """Climbs, speeds and heights."""
    place: FloatArray
    """Points with the place in their hull, shape (n, points, 2) [m]."""
    velocity: FloatArray
    """Points with the level velocity in theirs, mixed as those of the place, shape
    (n, points, 2) [m/s]."""
    slack: FloatArray
    """How far beside that hull it may be, shape (n,) [m/s]."""
    direction: FloatArray
    """Unit vectors, shape (n, 2)."""

    def __len__(self) -> int:
        return int(self.slack.size)

    def select(self, chosen: IntArray) -> Courses:
        """Return some of them."""
        sides = (getattr(self.boxes, name.name)[chosen] for name in fields(Boxes))
        rest = self.place, self.velocity, self.slack, self.direction
        return Courses(Boxes(*sides), *(one[chosen] for one in rest))


@dataclass(frozen=True, slots=True, eq=False)
class FallTable:
    """Enclosures of all falls in winds up to one."""

    fall: Fall
    """What falls."""
    climbs: FloatArray
    """Vertical velocities, shape (i,) [m/s]."""
    levels: FloatArray
    """Heights over the ground, from 0, shape (m,) [m]."""
    airspeeds: FloatArray
    """Borders of cells, shape (s + 1,) [m/s]."""
    times: FloatArray
    """Least and greatest T in cells of airspeeds, (2, i, m, s, drags) [s]."""
    lost: FloatArray
    """Least and greatest L in them, likewise [s]."""
    widest: FloatArray
    """Least and greatest T, least and greatest L of all drags, (4, i, m, s) [s]."""
    spans: FloatArray
    """Least T - L and greatest T of all, (2, i, m) [s]."""
    missed: FloatArray
    """What interpolation may miss from a climb and a level to the next, shape
    (i - 1, m) [m]."""
    discs: Discs
    """Wider enclosures, in all directions at once."""

    @classmethod
    def covering(
        cls, fall: Fall, climbs: tuple[float, float], speed: float, height: float
    ) -> FallTable:
        """Make the table for states within bounds.

        Parameters
        ----------
        fall
            What falls.
        climbs
            Least and greatest vertical velocity [m/s].
        speed
            Greatest level speed over ground [m/s].
        height
            Greatest height over the ground [m].
        """
        first = np.floor(climbs[0] / WIDE)
        rows = COARSE * max(np.ceil(climbs[1] / WIDE) - first, 1.0) + 1.0
        climb = WIDE * first + CELL * np.arange(rows)
        speeds = np.asarray(WIDE * np.arange(max(np.ceil(speed / WIDE), 1.0) + 1.0))
        levels = _levels(height)
        drags = np.unique(np.linspace(*fall.drag, DRAG_CELLS + 1))
        cells = np.ceil((speeds[-1] + fall.wind) / AIRSPEED)
        airspeeds = np.asarray(AIRSPEED * np.arange(cells + 1.0))
        parts = [
            falls(climb, airspeeds, some, levels, fall.gravity)
            for some in np.array_split(drags, min(DRAG_PARTS, drags.size))
        ]
        time, way = np.concatenate(parts, axis=3)
        # The wind carries a drone that has no airspeed. Over a cell, time and the way
        # lost are lines, and the latter's share of the airspeed lies between the ends'.
        lost = time - way / np.maximum(airspeeds, AIRSPEED)[:, None, None]
        lost[:, 0] = lost[:, 1]
        lost = np.maximum(lost, 1e-12)
        edges = []
        for part in (time, lost):
            known = np.moveaxis(part, 3, 1)
            one, other = known[:, :, :-1], known[:, :, 1:]
            edges.append(np.stack([np.minimum(one, other), np.maximum(one, other)]))
        times, shares = edges
        fastest = float(speeds[-1]), float(airspeeds[-1])
        # A bound holds on both sides of a climb: the lesser one in each cell.
        missed = remainder(fall, climb, fastest, levels, CELL**2)
        missed = np.minimum(missed[:-1], missed[1:])
        return cls(
            fall,
            climb,
            levels,
            airspeeds,
            times,
            shares,
            np.concatenate(
                [
                    times.min(axis=4)[:1],
                    times.max(axis=4)[1:],
                    shares.min(axis=4)[:1],
                    shares.max(axis=4)[1:],
                ]
            ),
            np.stack(
                [(times[0] - shares[1]).min(axis=(2, 3)), times[1].max(axis=(2, 3))]
            ),
            missed,
            Discs.over(
                fall,
                climbs=climb,
                levels=levels,
                speeds=speeds,
                airspeeds=airspeeds,
                times=times,
                lost=shares,
            ),
        )

    def reach(self, courses: Courses) -> FloatArray:
        """Bound how far ahead falls end, in directions from the origin, (n,) [m].

        Raises
        ------
        ValueError
            If a state may lie outside the bounds for which the table was made.
        """
        self._known(courses.boxes)
        found = np.empty(len(courses))
        # Those that are met by as many nodes together.
        order = np.argsort(
            courses.boxes.height_high - courses.boxes.height_low, kind="stable"
        )
        for top in range(0, order.size, TOGETHER):
            some = order[top : top + TOGETHER]
            found[some] = self._reach(courses.select(some))
        return found

    def _reach(self, courses: Courses) -> FloatArray:
        boxes, direction = courses.boxes, courses.direction
        place, along, across = (
            np.einsum("nkc,nc->nk", points, axis)
            for points, axis in (
                (courses.place, direction),
                (courses.velocity, direction),
                (courses.velocity, direction[:, ::-1] * (-1.0, 1.0)),
            )
        )
        own, beside = (
            0.5 * (part.min(axis=1) + part.max(axis=1)) for part in (along, across)
        )
        off = np.hypot(along - own[:, None], across - beside[:, None]).max(axis=1)
        wind = self.fall.wind + off + courses.slack
        against = air_met(own, np.abs(beside), wind, self.airspeeds)
        along += courses.slack[:, None]
        ahead = along.max(axis=1)
        low = np.maximum(boxes.height_low - HEAD, 0.0)
        high = np.maximum(boxes.height_high, 0.0)
        # The velocity over ground goes over from that of the drone to that of the wind,
        # (u, b) - (a, b). Where neither leads back, the lowest end is the farthest.
        onward = ahead >= 0.0
        along = np.where(onward[:, None], np.maximum(along, 0.0), along)
        low = np.where(onward, high, low)
        row = ((boxes.climb_low - self.climbs[0]) / CELL).astype(int)
        level = np.searchsorted(self.levels, low, side="right") - 1
        last = np.searchsorted(self.levels, high)
        rows = row[:, None] + np.arange(
            int(((boxes.climb_high - self.climbs[row]) / CELL).max()) + 2
        )
        levels = level[:, None] + np.arange(max(int((last - level).max()), 1) + 1)
        rows = np.minimum(rows, self.climbs.size - 1)
        levels = np.minimum(levels, self.levels.size - 1)
        begun, speed = _line(
            place, along, self.spans[:, rows[:, None, :], levels[:, :, None]]
        )
        # -(a, b) = (w, b) - (u, b), and the line bounds (u, b) (T - L) too.
        most = np.minimum(against, (self.fall.wind - speed)[:, None])
        against = np.where(
            onward[:, None] & (against > -np.inf),
            np.maximum(most, -speed[:, None]),
            most,
        )
        at = np.empty((len(courses), levels.shape[1], rows.shape[1]))
        for down, up in np.ndindex(*at.shape[1:]):
            node = rows[:, up], levels[:, down]
            at[:, down, up] = self._landed(*node, speed, against)
        climbs, heights = self.climbs[rows], self.levels[levels]
        meant = np.clip(climbs, boxes.climb_low[:, None], boxes.climb_high[:, None])
        most = _between(climbs[:, None], at, meant[:, None]).max(axis=2)
        ends = np.clip(heights, low[:, None], high[:, None])
        found = _between(heights, most, ends)
        found = np.maximum(found[:, :-1], found[:, 1:])
        missed = self.missed[
            np.minimum(rows[:, None, :-1], len(self.missed) - 1), levels[:, :-1, None]
        ]
        met = climbs[:, None, :-1] < boxes.climb_high[:, None, None]
        met[:, :, 0] = True
        found += np.where(met, missed, 0.0).max(axis=2)
        # Falls from low down are bounded by what gravity and drag do at most.
        climb = np.maximum(boxes.climb_high, 0.0)[:, None]
        start = np.maximum(np.abs(boxes.climb_low)[:, None], climb)
        gravity, drag = self.fall.gravity, self.fall.drag[1]
        sink = np.sqrt(start**2 + 2.0 * gravity * ends[:, 1:])
        through = np.hypot(sink, (np.hypot(own, beside) + wind)[:, None])
        fall = gravity - drag * sink * through
        time = climb / gravity + sink / np.sqrt(gravity * np.maximum(fall, 1e-6))
        blown = 0.5 * drag * through * np.maximum(wind - own, 0.0)[:, None]
        found += begun[:, None]
        near = np.maximum(ahead, 0.0)[:, None] * time + blown * time**2
        near += place.max(axis=1)[:, None]
        found = np.where(fall > 0.1 * gravity, np.minimum(found, near), found)
        met = (heights[:, :-1] < high[:, None]) | (np.arange(found.shape[1]) == 0)
        return np.asarray(np.where(met, found, -np.inf).max(axis=1) + ROUNDING)

    def _landed(
        self, row: IntArray, level: IntArray, speed: FloatArray, against: FloatArray
    ) -> FloatArray:
        """Greatest reach of the falls of nodes, shape (n,) [m].

        Parameters
        ----------
        row, level
            Of the nodes, shape (n,).
        speed
            Of the velocity over ground, shape (n,) [m/s].
        against
            Of the air that is met, shape (n, s) [m/s]; -inf where none is.
        """
        sign = (speed >= 0.0).astype(int)
        # Over all drags at once; then for each of them, where that may be more.
        blown = (self.widest[2:, row, level] * against).max(axis=0)
        most = speed[:, None] * self.widest[sign, row, level] + blown
        found = np.full(row.size, -np.inf)
        some, cell = np.arange(row.size), most.argmax(axis=1)
        for _ in range(2):
            where = row[some], level[some], cell
            blown = (self.lost[:, *where] * against[some, cell, None]).max(axis=0)
            each = speed[some, None] * self.times[sign[some], *where] + blown
            np.maximum.at(found, some, each.max(axis=1))
            some, cell = np.nonzero(most > found[:, None])
        return found

    def _known(self, boxes: Boxes) -> None:
        """Refuse states outside the bounds for which the table was made."""
        if (
            (boxes.climb_low < self.climbs[0]).any()
            or (boxes.climb_high > self.climbs[-1]).any()
            or (boxes.speed_high > self.discs.speeds[-1]).any()
            or (boxes.height_high > self.levels[-1]).any()
        ):
            raise ValueError("a state lies outside the bounds of the table of falls")

    def __call__(self, boxes: Boxes) -> Impacts:
        """Bound all falls from ``boxes`` to where they hit the ground, or a head.

        Raises
        ------
        ValueError
            If a box does not lie within the bounds for which the table was made.
        """
        self._known(boxes)
        return self.discs.impacts(boxes)

    def farthest(self, boxes: Boxes) -> FloatArray:
        """Bound how far falls from ``boxes`` end from where they begin, (n,) [m].

        Raises
        ------
        ValueError
            If a box does not lie within the bounds for which the table was made.
        """
        self._known(boxes)
        return self.discs.farthest(boxes)

    def impact_speed(self, boxes: Boxes) -> FloatArray:
        """Bound the speed with which falls from ``boxes`` end, shape (n,) [m/s]."""
        high = np.maximum(boxes.height_high, 0.0)
        gravity, drag = self.fall.gravity, self.fall.drag[0]
        start = np.maximum(np.abs(boxes.climb_low), np.abs(boxes.climb_high))
        # v dv/dh = g - k |y| v from the top of the rise, with |y| at least v.
        fade = np.exp(-2.0 * drag * high)
        sink = start**2 * fade + gravity / drag * (1.0 - fade)
        # Level velocity over ground is a mean of the first one and the wind's.
        level = np.maximum(boxes.speed_high, self.fall.wind)
        return np.asarray(np.sqrt(sink + level**2))


def _levels(height: float) -> FloatArray:
    """Heights from 0 to ``height`` or more, the farther apart the higher [m]."""
    return np.asarray(
        (0.2 * np.arange(np.ceil(5.0 * np.sqrt(max(height, 1.0))) + 1.0)) ** 2
    )


def _line(
    place: FloatArray, along: FloatArray, spans: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Bound (x, b) + (u, b) t by a line in t: begin [m] and speed [m/s], (n,) each.

    A place is met with its own velocity only: the greatest of them all is convex in t.

    Parameters
    ----------
    place, along
        (x, b) and (u, b) of the points of a hull, shape (n, points) [m, m/s].
    spans
        Least and greatest t, shape (2, n, levels, climbs) [s].
    """
    first, last = spans[0].min(axis=(1, 2)), spans[1].max(axis=(1, 2))
    begun, ended = (
        (place + along * time[:, None]).max(axis=1) for time in (first, last)
    )
    speed = (ended - begun) / np.maximum(last - first, 1e-9)
    return begun - speed * first, speed


def _between(nodes: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate along the last axis; places and nodes (..., n) increase."""
    gaps = np.maximum(np.diff(nodes), 1e-9)
    share = np.clip(
        (at[..., None] - nodes[..., None, :-1]) / gaps[..., None, :], 0.0, 1.0
    )
    return np.asarray(
        values[..., :1] + np.sum(share * np.diff(values)[..., None, :], axis=-1)
    )
