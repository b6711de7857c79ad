"""Discs: where falls end in any direction, by climb, level speed and height.

Wider than reaches in single directions (:mod:`showc.safety.landing`), and cheaper: they
say from which states those are worth working out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.safety.fall import CELL, HEAD, SPAN
from showc.safety.remainder import remainder

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.safety.fall import Fall


ROUNDING = 1e-3
"""What every reach is taken farther for errors of the integration [m]."""
COARSE = 2
"""Cells of climbs that one cell of the discs is wide."""
WIDE = COARSE * CELL
"""Width of the discs' cells in climb and in level speed over ground [m/s]."""
FANNED = np.linspace(0.0, np.pi, 13)
"""Directions of a disc's reaches, from ahead to back [rad]."""


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
class Discs:
    """A disc that holds the reaches of falls in all directions, for each state."""

    climbs: FloatArray
    """Vertical velocities, shape (h,) [m/s]."""
    levels: FloatArray
    """Heights over the ground, from 0, shape (m,) [m]."""
    speeds: FloatArray
    """Level speeds over ground, from 0, shape (j,) [m/s]."""
    ahead: FloatArray
    """How far along the velocity the disc's centre lies, shape (h, j, m) [m]."""
    radius: FloatArray
    """Of the disc, with what interpolation may miss, shape (h, j, m) [m]."""

    @classmethod
    def over(
        cls,
        fall: Fall,
        *,
        climbs: FloatArray,
        levels: FloatArray,
        speeds: FloatArray,
        airspeeds: FloatArray,
        times: FloatArray,
        lost: FloatArray,
    ) -> Discs:
        """Enclose falls from every ``COARSE``-th climb of a table of falls.

        Parameters
        ----------
        speeds
            Level speeds over ground, shape (j,) [m/s].
        fall, climbs, levels, airspeeds, times, lost
            As in the table.
        """
        climbs, times, lost = climbs[::COARSE], times[:, ::COARSE], lost[:, ::COARSE]
        own = np.multiply.outer(speeds, np.cos(FANNED)).ravel()
        beside = np.multiply.outer(speeds, np.sin(FANNED)).ravel()
        against = air_met(own, beside, np.full(own.size, fall.wind), airspeeds)
        against = against.reshape(speeds.size, FANNED.size, -1)
        ahead, radius = _enclosed(speeds, against, times, lost, levels)
        fastest = float(speeds[-1]), float(airspeeds[-1])
        wider = remainder(fall, climbs, fastest, levels, 2.0 * WIDE**2)
        for number, level in enumerate(levels.tolist()):
            # A node serves the cells about it, and falls that end on heads below.
            end = max(level - HEAD - SPAN, 0.0)
            under = int(np.searchsorted(levels, end, side="right")) - 1
            most = wider[:, under : number + 1].max(axis=1)
            radius[:, :, number] += most[:, None] + ROUNDING
        return cls(climbs, levels, speeds, ahead, radius)

    def impacts(self, boxes: Boxes) -> Impacts:
        """Bound all falls from ``boxes`` to where they hit the ground, or a head."""
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

    def farthest(self, boxes: Boxes) -> FloatArray:
        """Bound how far falls from ``boxes`` end from where they begin, (n,) [m].

        In any direction: whatever falls from a box climbs no faster, is no faster over
        ground and no higher than its corner, and no farther than all such falls.

        Raises
        ------
        ValueError
            If a box does not lie within the bounds for which the table was made.
        """
        most = np.abs(self.ahead) + self.radius
        for axis in range(3):
            most = np.maximum.accumulate(most, axis=axis)
        climb = np.ceil((boxes.climb_high - self.climbs[0]) / WIDE).astype(int)
        speed = np.ceil(boxes.speed_high / WIDE).astype(int)
        return np.asarray(
            most[climb, speed, np.searchsorted(self.levels, boxes.height_high)]
        )

    def _at(
        self, climb: FloatArray, speed: FloatArray, height: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Interpolate centre and radius of the discs of states (n,) [m]."""
        i = ((climb - self.climbs[0]) / WIDE).astype(int)
        i, j = i.clip(0, len(self.ahead) - 2), (speed / WIDE).astype(int)
        j = j.clip(0, self.speeds.size - 2)
        m = np.searchsorted(self.levels, height, side="right") - 1
        m = m.clip(0, self.levels.size - 2)
        x = (climb - self.climbs[i]) / WIDE
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


def _enclosed(
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
        Air that may be met in their directions, shape (j, directions, s) [m/s].
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


def air_met(
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
