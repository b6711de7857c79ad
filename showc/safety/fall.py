"""Falls with drag and wind, enclosed: how long they last and how far they carry.

A drone without thrust, of mass m and drag area A (coefficient times area), in a steady
level wind w, has with p = u - w its level velocity through the air, c its climb and
k = rho A / (2 m)

    p' = -k q p,    c' = -g - k q c,    q = sqrt(|p|² + c²).

p keeps its direction, so p = E p(0) with a factor E that falls from 1. After the time
T the drone has moved by u M + w (T - M), where M is the integral of E over the fall.
T and M depend on the wind only through the speed s = |u - w|.

For a whole box of climbs, speeds s and drag areas, E, c and the height lie between the
solutions of a second system, in which each right-hand side takes its least or greatest
value over the box (Müller 1927, Über das Fundamentaltheorem in der Theorie der
gewöhnlichen Differentialgleichungen; Walter 1970, Differential and Integral
Inequalities). Tables over small boxes hold those bounds; a query takes the worst of all
boxes that it touches.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray


AIR_DENSITY = 1.225
"""Of the standard atmosphere at sea level [kg/m³]; thinner air carries less."""
CELL = 0.5
"""Size of a table's boxes in climb and in airspeed [m/s]."""
COLUMN = 0.125
"""Width of a table's columns in level speed over ground [m/s]."""
LEVEL = 0.25
"""Distance between the heights of a table [m]."""
DRAG_CELLS = 4
"""Boxes into which the range of drag areas is cut."""
STEP = 0.02
"""Step of the integration, classical Runge-Kutta [s]."""
ALLOWANCE = 2e-3
"""Height that every bound is taken farther [m]: the integration's error is below
1e-6 m, that of straight lines between its steps below g STEP² / 8 = 5e-4 m."""
HEAD = 2.0
"""Height over the ground from which a fall may hit a person [m]."""


FAN = np.pi / 18.0
"""Angle between the directions in which a fall's reach is tabled [rad]."""
FANNED = np.arange(19) * FAN
"""These directions, from ahead to back [rad]."""


@dataclass(frozen=True, slots=True)
class Fall:
    """What falls, and in which wind."""

    mass: float
    """[kg]."""
    drag_area: tuple[float, float]
    """Least and greatest drag coefficient times area [m²]."""
    wind: float
    """Greatest steady wind, from any direction [m/s]."""
    gravity: float = 9.81
    """[m/s²]."""

    @property
    def drag(self) -> tuple[float, float]:
        """Least and greatest k = rho A / (2 m) [1/m]."""
        low, high = self.drag_area
        factor = 0.5 * AIR_DENSITY / self.mass
        return factor * low, factor * high


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
    speed: FloatArray
    """Greatest speed of the impact [m/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class FallTable:
    """Bounds on all falls in one wind, by climb, level speed and height.

    The bounds are maxima over the boxes of climb, airspeed and drag area from which a
    fall may come. The wind of a box is bounded by the speeds of its column and through
    the air: a drone that flies fast through
    the air is not carried by a wind from behind.
    """

    lowest_climb: float
    """Lower border of the first box in climb [m/s]."""
    carry: FloatArray
    """Centre of the disc over the velocity, shape (climbs, speeds, heights) [s]."""
    reach: FloatArray
    """Greatest way along each of ``FANNED``, (climbs, speeds, heights, angles) [m]."""
    growth: FloatArray
    """Bound on the growth of M from height 0, shape (climbs, speeds, heights) [s]."""
    speed: FloatArray
    """Greatest speed of the impact, shape (climbs, speeds, heights) [m/s]."""

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
        lowest = CELL * float(np.floor(climbs[0] / CELL))
        rows = int((climbs[1] - lowest) / CELL) + 1
        columns = int(speed / COLUMN) + 1
        airspeeds = ceil((columns * COLUMN + fall.wind) / CELL)
        levels = np.asarray(LEVEL * np.arange(ceil(max(height, 0.0) / LEVEL) + 1))
        bounds = _box_bounds(fall, lowest, (rows, airspeeds), levels)
        shape = rows, columns, levels.size
        growth, impact = np.zeros((2, *shape))
        reach = np.zeros((*shape, FANNED.size))
        for column in range(columns):
            slowest, fastest = column * COLUMN, (column + 1) * COLUMN
            first = int(max(0.0, slowest - fall.wind) / CELL)
            met = slice(first, ceil((fastest + fall.wind) / CELL))
            low = np.ascontiguousarray(bounds.carry_low[:, :, met])
            high = np.ascontiguousarray(bounds.carry_high[:, :, met])
            drift = np.ascontiguousarray(bounds.drift[:, :, met])
            airspeeds_met = np.asarray(CELL * np.arange(met.start, met.stop))
            for number, angle in enumerate(FANNED):
                wind = _wind_along(angle, (slowest, fastest), airspeeds_met, fall.wind)
                way = np.cos(angle) * (high if angle < 0.5 * np.pi else low)
                # Backwards the slowest of the column goes least far ahead.
                way *= fastest if angle < 0.5 * np.pi else slowest
                way += drift * wind[:, None]
                reach[:, column, :, number] = way.max(axis=(0, 2))
            rise = np.diff(low, axis=3).max(axis=(0, 2))
            growth[:, column, 1:] = np.cumsum(rise, axis=1)
            # Level velocity over ground is a mean of the first one and the wind's.
            level = max(fastest, fall.wind)
            impact[:, column] = np.hypot(bounds.sink[:, :, met].max(axis=(0, 2)), level)
        # The disc touches the falls that go farthest ahead and back.
        widest = COLUMN * (1.0 + np.arange(columns))[:, None]
        carry = np.maximum(reach[..., 0] - reach[..., -1], 0.0) / (2.0 * widest)
        return cls(lowest, carry, reach, growth, impact)

    def __call__(self, boxes: Boxes) -> Impacts:
        """Bound all falls from ``boxes`` to where they hit the ground, or a head.

        Raises
        ------
        ValueError
            If a box does not lie within the bounds for which the table was made.
        """
        row = np.floor((boxes.climb_low - self.lowest_climb) / CELL).astype(int)
        last_row = np.floor((boxes.climb_high - self.lowest_climb) / CELL).astype(int)
        column = np.floor(boxes.speed_low / COLUMN).astype(int)
        last_column = np.floor(boxes.speed_high / COLUMN).astype(int)
        below = np.floor((boxes.height_low - HEAD) / LEVEL).astype(int).clip(min=0)
        above = np.ceil(boxes.height_high / LEVEL).astype(int).clip(min=0)
        rows, columns, levels = self.carry.shape
        if (
            (row < 0).any()
            or (last_row >= rows).any()
            or (last_column >= columns).any()
            or (above >= levels).any()
        ):
            raise ValueError("a state lies outside the bounds of the table of falls")
        carry = self.carry[last_row, last_column, above]
        radius, speed = np.zeros((2, row.size))
        for down in range(int((last_row - row).max(initial=0)) + 1):
            tall = np.flatnonzero(row + down <= last_row)
            for right in range(int((last_column - column)[tall].max(initial=0)) + 1):
                met = tall[column[tall] + right <= last_column[tall]]
                i, j, level = row[met] + down, column[met] + right, above[met]
                fastest = COLUMN * (j + 1)
                # Along an angle the disc's centre has come at least this far.
                ahead = np.where(
                    0.5 * np.pi > FANNED, (COLUMN * j)[:, None], fastest[:, None]
                )
                own = np.cos(FANNED) * ahead * carry[met][:, None]
                reach = (self.reach[i, j, level] - own).max(axis=1) / np.cos(0.5 * FAN)
                rise = self.growth[i, j, level] - self.growth[i, j, below[met]]
                reach += fastest * rise
                radius[met] = np.maximum(radius[met], reach)
                speed[met] = np.maximum(speed[met], self.speed[i, j, level])
        return Impacts(carry, radius, speed)


def _wind_along(
    angle: float, speeds: tuple[float, float], airspeeds: FloatArray, wind: float
) -> FloatArray:
    """Greatest component of a wind that leaves a drone an airspeed, (n,) [m/s].

    Parameters
    ----------
    angle
        Direction of the component, from that of the drone's velocity [rad].
    speeds
        Least and greatest level speed over ground [m/s].
    airspeeds
        Least of each box, shape (n,) [m/s].
    wind
        Greatest wind [m/s].
    """
    # |u - w| >= s with |w| <= W keeps w ahead of u below (U² + W² - s²) / (2 U): w lies
    # within the circle W, short of a chord across it. Over a column the chord is
    # farthest at one of its ends, or where U² = W² - s².
    ends = [
        (speed**2 + wind**2 - airspeeds**2) / (2.0 * speed)
        for speed in (max(speeds[0], 1e-9), speeds[1])
    ]
    chord = np.clip(np.maximum(*ends), -wind, wind)
    if wind == 0.0:
        return np.zeros(airspeeds.size)
    corner = np.arccos(chord / wind)
    # Beyond the chord's corner the circle is the limit, before it the corner.
    return np.where(angle >= corner, wind, wind * np.cos(corner - angle))


@dataclass(frozen=True, slots=True, eq=False)
class _BoxBounds:
    """Bounds by boxes; every array of shape (drags, climbs, airspeeds, heights)."""

    carry_low: FloatArray
    """Least M [s]."""
    carry_high: FloatArray
    """Greatest M [s]."""
    drift: FloatArray
    """Greatest T - M [s]."""
    sink: FloatArray
    """Greatest downward speed [m/s]."""


def _box_bounds(
    fall: Fall, lowest: float, boxes: tuple[int, int], levels: FloatArray
) -> _BoxBounds:
    """Bound the falls from each box to each of ``levels`` [m] below."""
    rows, columns = boxes
    row, column = np.divmod(np.arange(rows * columns), columns)
    climb = lowest + CELL * row
    speed = CELL * column
    edges = np.linspace(*fall.drag, DRAG_CELLS + 1)
    shape = (DRAG_CELLS, row.size, levels.size)
    low, high, drift, sink = (np.zeros(shape) for _ in range(4))
    for cell, drag in enumerate(pairwise(edges.tolist())):
        for number, course in enumerate(
            _courses(climb, speed, drag, fall.gravity, float(levels[-1]))
        ):
            # A height is reached for good between the first instant at which the lower
            # solution is there and the last at which the upper one still is.
            times = course.times
            last = np.interp(levels + ALLOWANCE, course.fallen_least, times)
            first = np.interp(levels - ALLOWANCE, course.fallen_most, times)
            low[cell, number] = np.interp(first, times, course.carry_low)
            high[cell, number] = np.interp(last, times, course.carry_high)
            drift[cell, number] = last - np.interp(last, times, course.carry_low)
            # Between two steps the speed is at most that of the later one.
            step = np.ceil(last / STEP).astype(int).clip(max=times.size - 1)
            sink[cell, number] = course.sink[step]
    return _BoxBounds(
        *(
            bound.reshape(DRAG_CELLS, rows, columns, -1)
            for bound in (low, high, drift, sink)
        )
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Course:
    """Bounds on a fall over time, from one box; every array of shape (steps,)."""

    times: FloatArray
    """[s]."""
    fallen_least: FloatArray
    """Least distance below the start, increasing [m]."""
    fallen_most: FloatArray
    """Greatest distance below the start, increasing [m]."""
    carry_low: FloatArray
    """Least integral of E [s]."""
    carry_high: FloatArray
    """Greatest integral of E [s]."""
    sink: FloatArray
    """Greatest downward speed so far [m/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Bounding:
    """The system whose solutions bound all falls from boxes of states, (n,) of them.

    Its state has 8 rows: climb low and high, E low and high, height low and high, and
    the integral of E, low and high.
    """

    slow: FloatArray
    """Least level airspeed at the start, shape (n,) [m/s]."""
    fast: FloatArray
    """Greatest level airspeed at the start, shape (n,) [m/s]."""
    drag: tuple[float, float]
    """Least and greatest k [1/m]."""
    gravity: float
    """[m/s²]."""

    def start(self, climb_low: FloatArray, climb_high: FloatArray) -> FloatArray:
        """Return the first state, (8, n), of climbs between two bounds (n,) [m/s]."""
        zero, one = np.zeros(climb_low.size), np.ones(climb_low.size)
        return np.stack([climb_low, climb_high, one, one, zero, zero, zero, zero])

    def after(self, state: FloatArray, step: float) -> FloatArray:
        """Return the state (8, n) a ``step`` [s] later, by classical Runge-Kutta."""
        first = self._slope(state)
        second = self._slope(state + 0.5 * step * first)
        third = self._slope(state + 0.5 * step * second)
        fourth = self._slope(state + step * third)
        return np.asarray(
            state + step / 6.0 * (first + 2.0 * (second + third) + fourth)
        )

    def _slope(self, now: FloatArray) -> FloatArray:
        little, much = self.drag
        slow, fast = self.slow, self.fast
        sinking, rising, less, more = now[:4]
        nearest = np.where(
            (sinking < 0.0) & (rising > 0.0),
            0.0,
            np.minimum(np.abs(sinking), np.abs(rising)),
        )
        farthest = np.maximum(np.abs(sinking), np.abs(rising))
        # What drags least and most on the way, given which side of zero a bound is.
        up = rising > 0.0
        rising_drag = np.where(
            up,
            little * np.hypot(slow * less, rising),
            much * np.hypot(fast * more, rising),
        )
        up = sinking > 0.0
        sinking_drag = np.where(
            up,
            much * np.hypot(fast * more, sinking),
            little * np.hypot(slow * less, sinking),
        )
        return np.stack(
            [
                -self.gravity - sinking_drag * sinking,
                -self.gravity - rising_drag * rising,
                -much * np.hypot(fast * less, farthest) * less,
                -little * np.hypot(slow * more, nearest) * more,
                sinking,
                rising,
                less,
                more,
            ]
        )


def _courses(
    climb: FloatArray,
    speed: FloatArray,
    drag: tuple[float, float],
    gravity: float,
    height: float,
) -> Iterator[_Course]:
    """Integrate the bounding system of every box until all have fallen ``height``."""
    system = Bounding(speed, speed + CELL, drag, gravity)
    state = system.start(climb, climb + CELL)
    history = [state]
    while state[5].max() > -height - 2.0 * ALLOWANCE:
        state = system.after(state, STEP)
        history.append(state)
    course = np.stack(history)
    times = np.asarray(STEP * np.arange(len(history)))
    # Heights that a rising drone passes twice are reached when it is there for good;
    # a hair's slope keeps the abscissae of the interpolation increasing.
    hair = 1e-9 * np.arange(len(history))
    for number in range(climb.size):
        low, high = -course[:, 5, number], -course[:, 4, number]
        yield _Course(
            times,
            np.maximum.accumulate(low) + hair,
            np.maximum.accumulate(high) + hair,
            course[:, 6, number],
            course[:, 7, number],
            np.maximum.accumulate(np.maximum(-course[:, 0, number], 0.0)),
        )
