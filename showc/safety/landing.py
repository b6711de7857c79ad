"""Where falls end, enclosed: by direction, and more widely in discs.

Falls are integrated from a grid of climbs, airspeeds, drags and heights. A drone with
the velocity u over ground that starts with the airspeed a = u - w lands, after the time
T, at u T - L a, where L = T - (way through the air) / |a|. How far it may go in a
direction b with any wind is a search over |a|: (u, b) T and the greatest of -(a, b) L.
Between the falls of the grid lies what interpolation may miss
(:mod:`showc.safety.remainder`). Discs hold the reaches in all directions, and say from
which states reaches are worth working out.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from showc.safety.fall import AIRSPEED, CELL, DRAG_CELLS, HEAD, SPAN, Fall, falls
from showc.safety.remainder import remainder

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray


ROUNDING = 1e-3
"""What every reach is taken farther for errors of the integration [m]."""
COARSE = 2
"""Cells of climbs that one cell of the discs is wide."""
WIDE = COARSE * CELL
"""Width of the discs' cells in climb and in level speed over ground [m/s]."""
FANNED = np.linspace(0.0, np.pi, 13)
"""Directions of a disc's reaches, from ahead to back [rad]."""
TOGETHER = 256
"""Reaches that are worked out together, for what the processor keeps at hand."""


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """States that may fall, as boxes; every array of shape (n,)."""

    climb_low: FloatArray
    """Least vertical velocity [m/s]."""
    climb_high: FloatArray
    """Greatest vertical velocity [m/s]."""
    speed_low: FloatArray
    """Least level speed over ground [m/s]."""
    speed_high: FloatArray
    """Greatest level speed over ground [m/s]."""
    height_low: FloatArray
    """Least height over the ground [m]."""
    height_high: FloatArray
    """Greatest height over the ground [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Impacts:
    """Falls end within ``radius`` about place + ``carry`` velocity; shape (n,)."""

    carry: FloatArray
    """[s]."""
    radius: FloatArray
    """[m]."""
    spread: FloatArray
    """Part of the radius that smaller boxes do without [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Courses:
    """States that may fall, and the direction in which each may not go too far."""

    boxes: Boxes
    """Climbs, speeds and heights."""
    velocity: FloatArray
    """Points with the level velocity in their hull, shape (n, points, 2) [m/s]."""
    slack: FloatArray
    """How far beside that hull it may be, shape (n,) [m/s]."""
    direction: FloatArray
    """Unit vectors, shape (n, 2)."""

    def __len__(self) -> int:
        return int(self.slack.size)

    def select(self, chosen: IntArray) -> Courses:
        """Return some of them."""
        sides = (getattr(self.boxes, name.name)[chosen] for name in fields(Boxes))
        rest = self.velocity, self.slack, self.direction
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
    missed: FloatArray
    """What interpolation may miss from a climb and a level to the next, shape
    (i - 1, m) [m]."""
    speeds: FloatArray
    """Of discs: level speeds over ground, from 0, shape (j,) [m/s]."""
    ahead: FloatArray
    """How far along the velocity the disc's centre lies, shape (h, j, m) [m]; climbs
    are the first of ``COARSE``, and so on."""
    radius: FloatArray
    """Of the disc, with what interpolation may miss, shape (h, j, m) [m]."""

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
        time, way = falls(climb, airspeeds, drags, levels, fall.gravity)
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
        rows = slice(None, None, COARSE)
        against = _winds(fall.wind, speeds, airspeeds)
        ahead, radius = _discs(speeds, against, times[:, rows], shares[:, rows], levels)
        wider = remainder(fall, climb[::COARSE], fastest, levels, 2.0 * WIDE**2)
        for number, level in enumerate(levels.tolist()):
            # A node serves the cells about it, and falls that end on heads below.
            end = max(level - HEAD - SPAN, 0.0)
            under = int(np.searchsorted(levels, end, side="right")) - 1
            most = wider[:, under : number + 1].max(axis=1)
            radius[:, :, number] += most[:, None] + ROUNDING
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
            missed,
            speeds,
            ahead,
            radius,
        )

    def reach(self, courses: Courses) -> FloatArray:
        """Bound how far falls end from where they begin, in directions, (n,) [m].

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
        along, across = (
            np.einsum("nkc,nc->nk", courses.velocity, axis)
            for axis in (direction, direction[:, ::-1] * (-1.0, 1.0))
        )
        own, beside = (
            0.5 * (part.min(axis=1) + part.max(axis=1)) for part in (along, across)
        )
        off = np.hypot(along - own[:, None], across - beside[:, None]).max(axis=1)
        wind = self.fall.wind + off + courses.slack
        ahead = along.max(axis=1) + courses.slack
        against = _against(own, np.abs(beside), wind, self.airspeeds)
        low = np.maximum(boxes.height_low - HEAD, 0.0)
        high = np.maximum(boxes.height_high, 0.0)
        # The velocity over ground goes over from that of the drone to that of the wind,
        # (u, b) - (a, b). Where neither leads back, the lowest end is the farthest.
        onward = ahead >= 0.0
        against = np.where(
            onward[:, None] & (against > -np.inf),
            np.maximum(against, -ahead[:, None]),
            against,
        )
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
        at = np.empty((len(courses), levels.shape[1], rows.shape[1]))
        for place in np.ndindex(*at.shape[1:]):
            node = rows[:, place[1]], levels[:, place[0]]
            at[:, *place] = self._landed(*node, ahead, against)
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
        near = np.maximum(ahead, 0.0)[:, None] * time + blown * time**2
        found = np.where(fall > 0.1 * gravity, np.minimum(found, near), found)
        met = (heights[:, :-1] < high[:, None]) | (np.arange(found.shape[1]) == 0)
        return np.asarray(np.where(met, found, -np.inf).max(axis=1) + ROUNDING)

    def _landed(
        self, row: IntArray, level: IntArray, ahead: FloatArray, against: FloatArray
    ) -> FloatArray:
        """Greatest reach of the falls of nodes, shape (n,) [m].

        Parameters
        ----------
        row, level
            Of the nodes, shape (n,).
        ahead
            Greatest component of the velocity over ground, shape (n,) [m/s].
        against
            Of the air that is met, shape (n, s) [m/s]; -inf where none is.
        """
        sign = (ahead >= 0.0).astype(int)
        # Over all drags at once; then for each of them, where that may be more.
        blown = (self.widest[2:, row, level] * against).max(axis=0)
        most = ahead[:, None] * self.widest[sign, row, level] + blown
        found = np.full(row.size, -np.inf)
        some, cell = np.arange(row.size), most.argmax(axis=1)
        for _ in range(2):
            where = row[some], level[some], cell
            blown = (self.lost[:, *where] * against[some, cell, None]).max(axis=0)
            each = ahead[some, None] * self.times[sign[some], *where] + blown
            np.maximum.at(found, some, each.max(axis=1))
            some, cell = np.nonzero(most > found[:, None])
        return found

    def _known(self, boxes: Boxes) -> None:
        """Refuse states outside the bounds for which the table was made."""
        if (
            (boxes.climb_low < self.climbs[0]).any()
            or (boxes.climb_high > self.climbs[-1]).any()
            or (boxes.speed_high > self.speeds[-1]).any()
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
        high = np.maximum(boxes.height_high, 0.0)
        low = np.clip(boxes.height_low, 0.0, high)
        fastest = 0.5 * (boxes.speed_low + boxes.speed_high)
        middle = 0.5 * (boxes.climb_low + boxes.climb_high)
        centre, own = self._at(middle, fastest, high)
        carry = centre / np.maximum(fastest, 1e-9)
        carry[fastest < 1e-6] = 0.0
        radius = np.zeros(high.size)
        # A multilinear function is greatest in a corner: of the box, or of a cell.
        looks = np.ceil((high - low) / SPAN).astype(int).clip(min=1)
        for down in range(int(looks.max(initial=0))):
            tall = np.flatnonzero(down < looks)
            height = high[tall] - SPAN * down
            for climb, left in _stops(boxes.climb_low, boxes.climb_high, tall):
                for speed, kept in _stops(
                    boxes.speed_low, boxes.speed_high, tall[left]
                ):
                    some = tall[left][kept]
                    ahead, reach = self._at(climb[kept], speed, height[left][kept])
                    reach += np.abs(ahead - carry[some] * speed)
                    radius[some] = np.maximum(radius[some], reach)
        return Impacts(carry, radius, np.maximum(radius - own, 0.0))

    def _at(
        self, climb: FloatArray, speed: FloatArray, height: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Interpolate centre and radius of the discs of states (n,) [m]."""
        i = ((climb - self.climbs[0]) / WIDE).astype(int)
        i, j = i.clip(0, len(self.ahead) - 2), (speed / WIDE).astype(int)
        j = j.clip(0, self.speeds.size - 2)
        m = np.searchsorted(self.levels, height, side="right") - 1
        m = m.clip(0, self.levels.size - 2)
        x = (climb - self.climbs[COARSE * i]) / WIDE
        y = (speed - self.speeds[j]) / WIDE
        z = (height - self.levels[m]) / (self.levels[m + 1] - self.levels[m])
        ahead, radius = np.zeros((2, climb.size))
        for corner in range(8):
            a, b, c = corner & 1, corner >> 1 & 1, corner >> 2
            share = (x if a else 1.0 - x) * (y if b else 1.0 - y)
            share *= z if c else 1.0 - z
            at = i + a, j + b, m + c
            ahead += share * self.ahead[at]
            radius += share * self.radius[at]
        return ahead, radius

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


def _stops(
    low: FloatArray, high: FloatArray, some: IntArray
) -> Iterator[tuple[FloatArray, IntArray]]:
    """Places of a box along one axis where a corner may lie.

    Yields values, and which of ``some`` have one: both ends, and borders between.
    """
    first, last = low[some], high[some]
    yield first, np.arange(some.size)
    border = WIDE * (np.floor(first / WIDE) + 1.0)
    while (border < last).any():
        left = np.flatnonzero(border < last)
        yield border[left], left
        border = border + WIDE
    wide = np.flatnonzero(last > first)
    if wide.size:
        yield last[wide], wide


def _levels(height: float) -> FloatArray:
    """Heights from 0 to ``height`` or more, the farther apart the higher [m]."""
    return np.asarray(
        (0.2 * np.arange(np.ceil(5.0 * np.sqrt(max(height, 1.0))) + 1.0)) ** 2
    )


def _between(nodes: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate along the last axis; places and nodes (..., n) increase."""
    gaps = np.maximum(np.diff(nodes), 1e-9)
    share = np.clip(
        (at[..., None] - nodes[..., None, :-1]) / gaps[..., None, :], 0.0, 1.0
    )
    return np.asarray(
        values[..., :1] + np.sum(share * np.diff(values)[..., None, :], axis=-1)
    )


def _winds(wind: float, speeds: FloatArray, airspeeds: FloatArray) -> FloatArray:
    """Air that may be met in the directions of a disc, (j, directions, s) [m/s]."""
    own = np.multiply.outer(speeds, np.cos(FANNED)).ravel()
    beside = np.multiply.outer(speeds, np.sin(FANNED)).ravel()
    found = _against(own, beside, np.full(own.size, wind), airspeeds)
    return found.reshape(speeds.size, FANNED.size, -1)


def _discs(
    speeds: FloatArray,
    against: FloatArray,
    times: FloatArray,
    lost: FloatArray,
    levels: FloatArray,
) -> FloatArray:
    """Enclose falls in discs: centres along the velocity, and radii, (2, i, j, m) [m].

    Parameters
    ----------
    speeds
        Level speeds over ground, shape (j,) [m/s].
    against
        Air that may be met, as :func:`_winds` has it.
    times, lost, levels
        As in the table, for some of its climbs.
    """
    found = np.zeros((2, times.shape[1], speeds.size, levels.size))
    for number, own in enumerate(speeds.tolist()):
        met = against[number, 0] > -np.inf
        reach = np.empty((times.shape[1], levels.size, FANNED.size))
        # Row by row, for what the processor keeps at hand.
        for row in range(times.shape[1]):
            time, part = times[:, row][:, :, met], lost[:, row][:, :, met]
            for index, ahead in enumerate((own * np.cos(FANNED)).tolist()):
                share = against[number, index, met][:, None]
                landed = np.maximum(part[0] * share, part[1] * share)
                landed += ahead * time[int(ahead >= 0.0)]
                reach[row, :, index] = landed.max(axis=(1, 2))
        reach = _down_to_heads(levels, reach)
        # The disc touches the falls that go farthest ahead and back.
        if own:
            found[0, :, number] = 0.5 * (reach[..., 0] - reach[..., -1])
        beyond = reach - found[0, :, number, :, None] * np.cos(FANNED)
        found[1, :, number] = beyond.max(axis=-1) / np.cos(0.5 * FANNED[1])
    return found


def _against(
    own: FloatArray, beside: FloatArray, wind: FloatArray, airspeeds: FloatArray
) -> FloatArray:
    """Greatest component of the air that is met, -(a, b), over cells of |a|.

    Parameters
    ----------
    own, beside
        Components of the velocity along b, and beside it (at least 0), (n,) [m/s].
    wind
        Greatest wind, shape (n,) [m/s].
    airspeeds
        Borders of the cells, shape (s + 1,) [m/s].

    Returns
    -------
    ndarray, shape (n, s)
        [m/s]; -inf where no wind leads to that airspeed.
    """
    speed, own, beside, wind = (
        part[:, None] for part in (np.hypot(own, beside), own, beside, wind)
    )
    least, most = np.maximum(speed - wind, 0.0), speed + wind
    low, high = (np.clip(part, least, most) for part in (airspeeds[:-1], airspeeds[1:]))
    # All a lie in a disc about the velocity. On the circles |a| = s the component grows
    # until s is that of the disc's point farthest from b, and then falls.
    size = np.clip(np.hypot(beside, wind - own), low, high)
    room = wind**2 - size**2 - speed**2
    corner = np.arccos(np.clip(room / np.maximum(2.0 * size * speed, 1e-12), -1.0, 1.0))
    angle = np.arctan2(beside, own)
    found = size * np.cos(np.maximum(corner - angle, 0.0))
    met = (airspeeds[:-1] <= most) & (airspeeds[1:] >= least)
    return np.where(met, found, -np.inf)


def _down_to_heads(levels: FloatArray, reach: FloatArray) -> FloatArray:
    """Greatest reach (i, m, angles) of falls that end up to a head above the ground."""
    window = HEAD + SPAN
    found = np.empty_like(reach)
    for number, level in enumerate(levels.tolist()):
        last = max(level - window, 0.0)
        under = int(np.searchsorted(levels, last, side="right")) - 1
        share = 0.0
        if under + 1 < levels.size:
            share = (last - levels[under]) / (levels[under + 1] - levels[under])
        end = reach[:, under]
        if share > 0.0:
            end = (1.0 - share) * end + share * reach[:, under + 1]
        between = reach[:, under + 1 : number + 1]
        found[:, number] = np.maximum(end, between.max(axis=1, initial=-np.inf))
    return found
