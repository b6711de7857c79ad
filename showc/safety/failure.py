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
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.processes import side_by_side
from showc.safety.fall import runge_kutta, shares_of_step

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.safety.fall import Fall
    from showc.trajectory import PiecewisePolynomial

STEP = 0.1
"""Time between two moments of a fall [s]; the way in between is added to the distance
at which drones meet."""
SECOND = 1.0
"""Time between two moments at which drones fail [s]."""
TOGETHER = 16
"""Seconds that are looked at together: for the memory of their falls."""
ROWS = 64
"""Falling drones that are looked at together, for what the processor keeps at hand."""
ALONE = 10_000
"""Drones and seconds up to which copies of the process take longer than they save."""


@dataclass(frozen=True, slots=True, eq=False)
class Failures:
    """Which drones may be met by one that falls."""

    times: FloatArray
    """When drones fail, shape (n,) [s]."""
    met: IntArray
    """How many others may be met, shape (n, drones)."""
    others: NDArray[np.unsignedinteger[Any]]
    """Those, counting from 0: of the first time's first drone first, shape (m,)."""

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
        """Drones that may be met, counting from 0, increasing."""
        row = step * self.met.shape[1] + drone
        last = int(self.met.ravel()[: row + 1].sum())
        return list(self.others[last - int(self.met[step, drone]) : last].tolist())

    def meetings(self) -> Iterator[tuple[tuple[int, int], list[int]]]:
        """Yield each time's index and falling drone that may meet others, and those."""
        last = 0
        for step, drone in np.argwhere(self.met).tolist():
            first, last = last, last + int(self.met[step, drone])
            yield (step, drone), list(self.others[first:last].tolist())


@dataclass(frozen=True, slots=True, eq=False)
class _Cones:
    """Where falling drones may be between two moments; boxes about the wind's disc.

    Of n drones at each of a few seconds.
    """

    centre: FloatArray
    """Shape (seconds, n, 2) [m]."""
    radius: FloatArray
    """Shape (seconds, n) [m]."""
    low: FloatArray
    """Least height, shape (seconds, n) [m]."""
    high: FloatArray
    """Greatest height, shape (seconds, n) [m]."""

    def of(self, second: int, drones: IntArray) -> _Cones:
        """Return those of some drones at one second alone."""
        at = second, drones
        return _Cones(self.centre[at], self.radius[at], self.low[at], self.high[at])


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
        """Return the state (8, n) a ``step`` [s] later."""
        climb = np.abs(state[:2]).max(axis=0)
        shares = shares_of_step(self.drag[1] * np.hypot(self.fast, climb), step)
        for _ in range(shares):
            state = runge_kutta(self._slope, state, step / shares)
        return state

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
    fastest = max(
        float(np.sum(state.coefficients[:, :, 3:6] ** 2, axis=2).max())
        for state in states
    )
    # A way of half a step on both sides of its middle, and the size of both drones.
    room = 0.5 * STEP * np.sqrt(fastest) + size
    parts = [
        partial(_meetings, states, times[top : top + TOGETHER], fall, (room, ground))
        for top in range(0, times.size, TOGETHER)
    ]
    jobs = None if times.size * len(states) > ALONE else 1
    found = side_by_side(parts, jobs)
    return Failures(
        times,
        np.concatenate([met for met, _ in found]),
        np.concatenate([others for _, others in found]),
    )


def _meetings(
    states: Sequence[PiecewisePolynomial],
    times: FloatArray,
    fall: Fall,
    bounds: tuple[float, float],
) -> tuple[IntArray, NDArray[np.unsignedinteger[Any]]]:
    """Find how many others may be met from each of a few ``times``, and which.

    As :class:`Failures` has it. ``bounds`` are the room that a meeting takes, and the
    height at which a fall ends [m].
    """
    room, ground = bounds
    drones = len(states)
    cones = _fall(np.stack([state(times) for state in states], axis=1), fall)
    # In the middle of each step, to the end of the last fall.
    middles = 0.5 * STEP + np.arange(
        0.0, times[-1] - times[0] + STEP * len(cones), STEP
    )
    places = np.stack([state(times[0] + middles)[:, :3] for state in states], axis=1)
    met, others = [], []
    for number in range(times.size):
        may = np.zeros((drones, drones), dtype=np.bool_)
        for step, cone in enumerate(cones):
            falling = np.flatnonzero(cone.high[number] > ground)
            if not falling.size:
                break
            place = places[round(number * SECOND / STEP) + step]
            _meet(may, cone.of(number, falling), falling, place, room)
        np.fill_diagonal(may, val=False)
        met.append(may.sum(axis=1))
        others.append(np.nonzero(may)[1].astype(np.min_scalar_type(drones)))
    return np.stack(met), np.concatenate(others)


def _fall(state: FloatArray, fall: Fall) -> list[_Cones]:
    """Enclose falls of all drones from states (seconds, drones, 6), step by step."""
    shape = state.shape[:2]
    place, level, climb = state[..., :2], state[..., 3:5], state[..., 5].ravel()
    height = state[..., 2]
    speed = np.linalg.norm(level, axis=2)
    slow, fast = np.maximum(speed - fall.wind, 0.0), speed + fall.wind
    system = _Bounding(slow.ravel(), fast.ravel(), fall.drag, fall.gravity)
    now = system.start(climb, climb)
    cones: list[_Cones] = []
    time = 0.0
    while (height.ravel() + now[5]).max() > 0.0:
        later = system.after(now, STEP)
        time += STEP
        # M and the drift grow; heights between two steps lie between their ends, but
        # for the top of a rise, which is less than g STEP² / 8 above them.
        carry_low, carry_high = now[6].reshape(shape), later[7].reshape(shape)
        drift = time - later[6].reshape(shape)
        spare = fall.gravity * STEP**2 / 8.0
        cones.append(
            _Cones(
                place + 0.5 * (carry_low + carry_high)[..., None] * level,
                0.5 * (carry_high - carry_low) * speed + fall.wind * drift,
                height + np.minimum(now[4], later[4]).reshape(shape),
                height + np.maximum(now[5], later[5]).reshape(shape) + spare,
            )
        )
        now = later
    return cones


def _meet(
    may: BoolArray, cone: _Cones, falling: IntArray, places: FloatArray, room: float
) -> None:
    """Mark in ``may`` (drones, drones) which others each falling drone may meet.

    Some falling drones at a time, that are next to each other in height, and only
    others at their heights: few, where a fleet is spread in height, and few steps of a
    fall, where it is not.
    """
    order = np.argsort(places[:, 2], kind="stable")
    x, y, height = places[order].T
    low, high, reach = cone.low - room, cone.high + room, (cone.radius + room) ** 2
    rising = np.argsort(low, kind="stable")
    for top in range(0, falling.size, ROWS):
        some = rising[top : top + ROWS, None]
        first = int(np.searchsorted(height, low[some].min(), side="left"))
        last = int(np.searchsorted(height, high[some].max(), side="right"))
        if first >= last:
            continue
        at = slice(first, last)
        centre = cone.centre[some]
        near = (x[at] - centre[..., 0]) ** 2 + (y[at] - centre[..., 1]) ** 2
        hit = near <= reach[some]
        hit &= height[at] >= low[some]
        hit &= height[at] <= high[some]
        row, other = np.nonzero(hit)
        may[falling[some[row, 0]], order[first + other]] = True
