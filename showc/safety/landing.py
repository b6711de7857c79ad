"""Where falls end, enclosed in discs: a table over climb, speed and height.

Falls from a grid of states are integrated, and others lie between them: the table holds
the worst of all winds and drag areas, and what interpolation may miss
(:mod:`showc.safety.remainder`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.safety.fall import AIRSPEED, CELL, DRAG_CELLS, HEAD, SPAN, Fall, falls
from showc.safety.remainder import remainder

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray


ROUNDING = 1e-3
"""What every radius is taken farther for errors of the integration [m]."""
FAN = np.pi / 18.0
"""Angle between the directions in which a fall's reach is worked out [rad]."""
PARTS = 4
"""Parts of a cell of airspeeds over which winds are bounded."""
FANNED = np.arange(19) * FAN
"""These directions, from ahead to back [rad]."""


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
class FallTable:
    """Discs that hold all falls in one wind, by climb, level speed and height."""

    fall: Fall
    """What falls."""
    climbs: FloatArray
    """Vertical velocities, shape (i,) [m/s]."""
    speeds: FloatArray
    """Level speeds over ground, from 0, shape (j,) [m/s]."""
    levels: FloatArray
    """Heights over the ground, from 0, shape (m,) [m]."""
    ahead: FloatArray
    """How far along the velocity the disc's centre lies, (i, j, m) [m]."""
    radius: FloatArray
    """Of the disc, with what interpolation may miss, (i, j, m) [m]."""

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
        first = np.floor(climbs[0] / CELL)
        rows = np.arange(first, max(np.ceil(climbs[1] / CELL), first + 1.0) + 1.0)
        climb = CELL * rows
        speeds = CELL * np.arange(max(np.ceil(speed / CELL), 1.0) + 1.0)
        levels = _levels(height)
        drags = np.unique(np.linspace(*fall.drag, DRAG_CELLS + 1))
        count = int(np.ceil((speeds[-1] + fall.wind) / AIRSPEED)) + 1
        airspeeds = np.asarray(AIRSPEED * np.arange(count))
        time, way = falls(climb, airspeeds, drags, levels, fall.gravity)
        # What the air takes: the wind carries a drone that has no airspeed.
        lost = airspeeds[:, None, None] * time - way
        missed = remainder(fall, climb, (float(speeds[-1]), airspeeds[-1]), levels)
        ahead, radius = np.zeros((2, climb.size, speeds.size, levels.size))
        # Over a cell of airspeeds the way lost is a line: the greater end, and shares.
        greater = np.maximum(lost[:, :-1], lost[:, 1:])
        slope = 1.0 - np.minimum(lost[:, :-1], lost[:, 1:]) / np.maximum(greater, 1e-12)
        slope = np.where(greater > 0.0, slope, 0.0)
        gentle, steep = slope.min(axis=2), slope.max(axis=2)
        longest = np.maximum(time[:, :-1], time[:, 1:])
        shortest = np.minimum(time[:, :-1], time[:, 1:])
        for number, own in enumerate(speeds.tolist()):
            low = min(int(max(0.0, own - fall.wind) / AIRSPEED), airspeeds.size - 2)
            high = max(int(np.ceil((own + fall.wind) / AIRSPEED)), low + 1)
            met = slice(low, high)
            reach = np.empty((climb.size, levels.size, FANNED.size))
            against = _against(own, airspeeds[met.start : met.stop + 1], fall.wind)
            # Row by row, for what the processor keeps at hand.
            for row in range(climb.size):
                through_air = greater[row, met]
                share = _shares(against, gentle[row, met], steep[row, met])
                for index, angle in enumerate(FANNED.tolist()):
                    along = np.cos(angle) * own
                    with_ground = longest if along > 0.0 else shortest
                    landed = share[index][:, None] * through_air
                    landed += along * with_ground[row, met]
                    reach[row, :, index] = landed.max(axis=0).max(axis=0)
            reach = _down_to_heads(levels, reach)
            # The disc touches the falls that go farthest ahead and back.
            centre = (
                0.5 * (reach[..., 0] - reach[..., -1]) if own else 0.0 * reach[..., 0]
            )
            beyond = reach - centre[..., None] * np.cos(FANNED)
            ahead[:, number] = centre
            radius[:, number] = beyond.max(axis=-1) / np.cos(0.5 * FAN)
        radius += missed[:, None] + ROUNDING
        return cls(fall, climb, speeds, levels, ahead, radius)

    def __call__(self, boxes: Boxes) -> Impacts:
        """Bound all falls from ``boxes`` to where they hit the ground, or a head.

        Raises
        ------
        ValueError
            If a box does not lie within the bounds for which the table was made.
        """
        if (
            (boxes.climb_low < self.climbs[0]).any()
            or (boxes.climb_high > self.climbs[-1]).any()
            or (boxes.speed_high > self.speeds[-1]).any()
            or (boxes.height_high > self.levels[-1]).any()
        ):
            raise ValueError("a state lies outside the bounds of the table of falls")
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
        i = ((climb - self.climbs[0]) / CELL).astype(int).clip(0, self.climbs.size - 2)
        j = (speed / CELL).astype(int).clip(0, self.speeds.size - 2)
        m = np.searchsorted(self.levels, height, side="right") - 1
        m = m.clip(0, self.levels.size - 2)
        x = (climb - self.climbs[i]) / CELL
        y = (speed - self.speeds[j]) / CELL
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
    border = CELL * (np.floor(first / CELL) + 1.0)
    while (border < last).any():
        left = np.flatnonzero(border < last)
        yield border[left], left
        border = border + CELL
    wide = np.flatnonzero(last > first)
    if wide.size:
        yield last[wide], wide


def _levels(height: float) -> FloatArray:
    """Heights from 0 to ``height`` or more, the farther apart the higher [m]."""
    low = (0.1 * np.arange(10)) ** 2
    count = max(int(np.ceil((np.sqrt(max(height, 1.0)) - 1.0) / 0.2)), 1)
    return np.concatenate([low, (1.0 + 0.2 * np.arange(count + 1)) ** 2])


def _against(speed: float, airspeeds: FloatArray, wind: float) -> FloatArray:
    """Greatest component of the unit vector against the air over parts of cells.

    Parameters
    ----------
    speed
        Level speed over ground [m/s].
    airspeeds
        Borders of the cells, at equal distances, shape (n + 1,) [m/s].
    wind
        Greatest wind [m/s].

    Returns
    -------
    ndarray, shape (angles, n, PARTS)
        For each of the directions ``FANNED`` from the drone's velocity.
    """
    # |u + s b| <= W keeps b ahead of u below (W² - u² - s²) / (2 u s). Over a part that
    # is greatest at one of its ends, or where s² = u² - W².
    cells = airspeeds.size - 1
    border = airspeeds[0] + AIRSPEED / PARTS * np.arange(cells * PARTS + 1)
    room = (wind**2 - speed**2 - border**2) / np.maximum(2.0 * speed * border, 1e-12)
    most = np.maximum(room[:-1], room[1:])
    top = np.sqrt(max(speed**2 - wind**2, 0.0))
    if top > 0.0:
        holds = (border[:-1] <= top + 1e-9) & (top - 1e-9 <= border[1:])
        most[holds] = np.maximum(most[holds], -top / speed)
    corner = np.arccos(np.clip(most, -1.0, 1.0))
    angle = FANNED[:, None]
    found = np.where(angle >= corner, 1.0, np.cos(corner - angle))
    return found.reshape(FANNED.size, cells, PARTS)


def _shares(against: FloatArray, gentle: FloatArray, steep: FloatArray) -> FloatArray:
    """Bound a component of the way lost, as a share of the greatest in a cell.

    Parameters
    ----------
    against
        As :func:`_against` has it, shape (angles, n, PARTS).
    gentle, steep
        Least and greatest share by which the way is less at the cell's lower end,
        shape (n, levels).

    Returns
    -------
    ndarray, shape (angles, n, levels)
    """
    found = np.full((against.shape[0], *gentle.shape), -np.inf)
    for part in range(PARTS):
        along = against[:, :, part, None]
        upper, lower = 1.0 - (part + 1.0) / PARTS, 1.0 - part / PARTS
        share = np.where(along >= 0.0, 1.0 - upper * gentle, 1.0 - lower * steep)
        np.maximum(found, along * share, out=found)
    return found


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
