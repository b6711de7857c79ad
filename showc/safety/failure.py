"""One drone fails: which others fly where it may fall.

A drone that loses its thrust at some second falls through a cone that wind and drag
widen. Time runs on: another drone matters if it is in the cone at the moment at which
the falling one may be. The cone is enclosed, and so is the way of each other drone
between two moments; drones that are not named cannot be met.

With E the share of the level velocity through the air that drag has left: of a whole
box of climbs, airspeeds and drag areas, E, the climb and the height lie between the
solutions of a second system, in which each right-hand side takes its least or greatest
value over the box (Müller 1927, Über das Fundamentaltheorem in der Theorie der
gewöhnlichen Differentialgleichungen; Walter 1970, Differential and Integral
Inequalities).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.safety.fall import Fall
    from showc.trajectory import PiecewisePolynomial

STEP = 0.1
"""Time between two moments of a fall [s]."""
SECOND = 1.0
"""Time between two moments at which drones fail [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Failures:
    """Which drones may be met by one that falls."""

    times: FloatArray
    """When drones fail, shape (n,) [s]."""
    met: IntArray
    """How many others may be met, shape (n, drones)."""
    pairs: IntArray
    """Index of the time, falling drone and drone that may be met, shape (m, 3)."""

    @property
    def share(self) -> float:
        """Part of all drones and seconds from which another drone may be met."""
        return float(np.mean(self.met > 0))

    @property
    def worst(self) -> tuple[int, int]:
        """Index of the time, and the drone, from which most others may be met."""
        step, drone = np.unravel_index(int(self.met.argmax()), self.met.shape)
        return int(step), int(drone)

    def below(self, step: int, drone: int) -> list[int]:
        """Drones that may be met, counting from 0."""
        mine = (self.pairs[:, 0] == step) & (self.pairs[:, 1] == drone)
        return sorted(self.pairs[mine, 2].tolist())


@dataclass(frozen=True, slots=True, eq=False)
class _Cones:
    """Where falling drones may be between two moments; boxes about the wind's disc."""

    centre: FloatArray
    """Shape (n, 2) [m]."""
    radius: FloatArray
    """Shape (n,) [m]."""
    low: FloatArray
    """Least height, shape (n,) [m]."""
    high: FloatArray
    """Greatest height, shape (n,) [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Bounding:
    """The system whose solutions bound all falls from boxes of states, (n,) of them.

    Its state has 8 rows: climb low and high, E low and high, height low and high, and
    the integral M of E, low and high.
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


def failures(
    states: Sequence[PiecewisePolynomial], fall: Fall, size: float, ground: float
) -> Failures:
    """Find which drones fly where others may fall, for every drone and second.

    Parameters
    ----------
    states
        Position and velocity of each drone over the show, 6 components or more.
    fall
        What falls, and in which wind.
    size
        Of a drone, from tip to tip [m].
    ground
        Height at which a fall ends [m].
    """
    times = np.arange(states[0].start, states[0].end, SECOND)
    ticks = np.arange(states[0].start, states[0].end + STEP, 0.5 * STEP)
    flown = np.stack([state.select(slice(0, 6))(ticks) for state in states], axis=1)
    fastest = max(
        float(np.linalg.norm(state.coefficients[:, :, 3:6], axis=2).max())
        for state in states
    )
    # A way of half a step on both sides of its middle, and the size of both drones.
    room = 0.5 * STEP * fastest + size
    per_second = round(SECOND / (0.5 * STEP))
    found = [np.empty((0, 3), dtype=np.int64)]
    for number in range(times.size):
        first = number * per_second
        cones = _fall(flown[first], fall)
        for step, cone in enumerate(cones):
            tick = min(first + 2 * step + 1, ticks.size - 1)
            falling = np.flatnonzero(cone.high > ground)
            if not falling.size:
                break
            pairs = _meetings(cone, falling, flown[tick, :, :3], room)
            found.append(np.insert(pairs, 0, number, axis=1))
    pairs = np.unique(np.concatenate(found), axis=0)
    met = np.zeros((times.size, len(states)), dtype=np.int64)
    np.add.at(met, (pairs[:, 0], pairs[:, 1]), 1)
    return Failures(times, met, pairs)


def _fall(state: FloatArray, fall: Fall) -> list[_Cones]:
    """Enclose the falls of all drones from states (drones, 6), step by step."""
    level, climb = state[:, 3:5], state[:, 5]
    speed = np.linalg.norm(level, axis=1)
    slow, fast = np.maximum(speed - fall.wind, 0.0), speed + fall.wind
    system = _Bounding(slow, fast, fall.drag, fall.gravity)
    now = system.start(climb, climb)
    cones: list[_Cones] = []
    time = 0.0
    while (state[:, 2] + now[5]).max() > 0.0 and len(cones) < round(30.0 / STEP):
        later = system.after(now, STEP)
        time += STEP
        # M and the drift grow; heights between two steps lie between their ends, but
        # for the top of a rise, which is less than g STEP² / 8 above them.
        carry_low, carry_high = now[6], later[7]
        drift = time - later[6]
        centre = state[:, :2] + 0.5 * (carry_low + carry_high)[:, None] * level
        spare = fall.gravity * STEP**2 / 8.0
        cones.append(
            _Cones(
                centre,
                0.5 * (carry_high - carry_low) * speed + fall.wind * drift,
                state[:, 2] + np.minimum(now[4], later[4]),
                state[:, 2] + np.maximum(now[5], later[5]) + spare,
            )
        )
        now = later
    return cones


def _meetings(
    cone: _Cones, falling: IntArray, places: FloatArray, room: float
) -> IntArray:
    """Pairs of a falling drone and another that it may meet, shape (m, 2)."""
    # Only drones at the cone's heights: few, where a fleet is spread in height, and few
    # steps of a fall, where it is not.
    order = np.argsort(places[:, 2], kind="stable")
    height = places[order, 2]
    lowest = np.searchsorted(height, cone.low[falling] - room, side="left")
    beyond = np.searchsorted(height, cone.high[falling] + room, side="right")
    count = np.maximum(beyond - lowest, 0)
    first = np.repeat(falling, count)
    within = np.arange(first.size) - np.repeat(np.cumsum(count) - count, count)
    other = order[np.repeat(lowest, count) + within]
    away = places[other, :2] - cone.centre[first]
    reach = cone.radius[first] + room
    near = (away[:, 0] ** 2 + away[:, 1] ** 2 <= reach**2) & (first != other)
    return np.stack([first[near], other[near]], axis=1)
