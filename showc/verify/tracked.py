"""Where the drones most likely are on their legs, worked out anew from the words.

The autopilot leads a point along the leg and lets the vehicle follow; what its loops
make of that is integrated in steps of 20 ms, by the midpoint rule, over a table of the
law in the same steps. Nothing here is taken from the code that drew the flights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from showc.verify.autopilot import Profiles

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

STEP = 0.02
"""[s]"""

AFTER = 10.0
"""How long after the law's end a drone is followed [s]."""

FADING = 1.0
"""Time at the end of that in which it comes to rest at its goal [s]."""

BLOCK = 500
"""Legs that are integrated together; bounds the memory."""

_AT_ONCE = 10_000
"""Places of laws that are worked out together: they stay in the processor's cache."""

STATES = 21
"""Rows of a state: level place, speed, speed missed, its sum, its change, lean half
way, lean, two each; place, speed, speed missed, sum and lift upright; time and rate of
the law."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """The flights of n legs, in steps from their releases."""

    ways: NDArray[np.float32]
    """Ways covered since the legs' begins, shape (n, steps, 3), show frame [m]."""
    ended: FloatArray
    """When the law's own time has ended, shape (n,) [s]."""
    until: FloatArray
    """Time from its release to that of each drone's next leg, shape (n,) [s]."""

    def covered(self, leg: IntArray, since: FloatArray) -> FloatArray:
        """Ways (m, 3) [m] of legs ``leg`` (m,) at ``since`` (m,) [s], 0 or more."""
        most = self.ways.shape[1] - 1
        place = np.clip(since / STEP, 0.0, most)
        low = np.floor(place).astype(np.int64)
        rest = (place - low)[:, None]
        return np.asarray(
            self.ways[leg, low] * (1.0 - rest)
            + self.ways[leg, np.minimum(low + 1, most)] * rest
        )


class Fleet:
    """All drones of a fleet, as they fly one leg after the other.

    Parameters
    ----------
    drones
        How many; they are at rest.
    lag
        Greatest acceleration over jerk: how late the law's time changes its rate [s].
    """

    def __init__(self, drones: int, lag: float) -> None:
        self.lag = lag
        self.states = np.zeros((STATES, drones))
        self.states[20] = 1.0

    def fly(
        self,
        drones: IntArray,
        flights: Profiles,
        along: FloatArray,
        until: FloatArray | Callable[[FloatArray], FloatArray],
    ) -> Tracked:
        """Fly the next legs of the ``drones`` (n,).

        ``flights`` are their n legs, ``along`` (n, 3) [m] the ways in the show frame.
        ``until`` (n,) is when the leg after it is released, or tells that from when
        the law of each has ended (n,); both from this leg's release [s].
        """
        lasting = flights.duration + AFTER
        if not callable(until):
            lasting = np.minimum(lasting, until + STEP)
        steps = max(int(np.ceil(lasting.max(initial=0.0) / STEP)), 1)
        count = drones.size
        ways = np.zeros((count, steps + 1, 3), dtype=np.float32)
        ended = np.zeros(count)
        histories = []
        for begin in range(0, count, BLOCK):
            rows = slice(begin, min(begin + BLOCK, count))
            part = flights.part(rows.start, rows.stop)
            vehicles = _Vehicles(part, along[rows], self.lag)
            history = vehicles.run(self.states[:, drones[rows]], steps)
            ways[rows], ended[rows] = vehicles.ways(history), _ended(part, history)
            later = (until(ended) if callable(until) else until)[rows]
            histories.append(vehicles.handed_over(history, later))
        if histories:
            self.states[:, drones] = np.concatenate(histories, axis=1)
        return Tracked(ways, ended, until(ended) if callable(until) else until)


def _ended(flights: Profiles, history: FloatArray) -> FloatArray:
    """When the law's own time passes the legs' durations, shape (n,) [s]."""
    clock = history[:, 19]
    found = np.full(flights.length.size, STEP * (len(clock) - 1))
    for leg in np.flatnonzero(clock[-1] >= flights.duration):
        row = int(np.searchsorted(clock[:, leg], flights.duration[leg]))
        before, after = clock[row - 1, leg], clock[row, leg]
        share = (flights.duration[leg] - before) / (after - before)
        found[leg] = STEP * (row - 1 + share)
    return np.where(flights.length > 0.0, found, 0.0)


class _Vehicles:
    """How n vehicles follow their legs."""

    def __init__(self, flights: Profiles, along: FloatArray, lag: float) -> None:
        self.lag, self.flights, self.along = lag, flights, along
        flat = np.linalg.norm(along[:, :2], axis=1)
        unit = along[:, :2] / np.where(flat > 0.0, flat, 1.0)[:, None]
        self.aim = np.vstack([unit.T * flights.level, flights.climb])
        count = flights.length.size
        self.last = int(np.ceil(flights.duration.max(initial=0.0) / STEP)) + 1
        self.leg, self.count = np.arange(count), count
        # Distance, speed, acceleration over the law's time, one row for all legs.
        self.law = np.empty((3, (self.last + 1) * count))
        some = max(1, _AT_ONCE // max(count, 1))
        for begin in range(0, self.last + 1, some):
            own = np.arange(begin, min(begin + some, self.last + 1))
            times, legs = np.repeat(STEP * own, count), np.tile(self.leg, own.size)
            place = slice(begin * count, begin * count + times.size)
            self.law[:, place] = flights.motion(legs, times).T

    def led(self, time: FloatArray) -> FloatArray:
        """Distance, speed, acceleration (3, n) of the law at its times (n,) [s]."""
        where = np.minimum(time / STEP, float(self.last))
        row = np.minimum(where.astype(np.int64), self.last - 1)
        share = where - row
        row *= self.count
        row += self.leg
        first = self.law.take(row, axis=1)
        row += self.count
        second = self.law.take(row, axis=1)
        second -= first
        second *= share
        first += second
        return first

    def run(self, state: FloatArray, steps: int) -> FloatArray:
        """States (steps + 1, 21, n), from that at the release, by the midpoint rule."""
        history = np.empty((steps + 1, *state.shape))
        history[0] = state
        history[0, 19] = 0.0
        for step in range(steps):
            now = history[step]
            half = now + 0.5 * STEP * self.change(now)
            history[step + 1] = now + STEP * self.change(half)
        return history

    def _off(self, history: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places from the ends (steps, 3, n) [m], and what is left of them to count."""
        left = self.flights.duration + AFTER - STEP * np.arange(len(history))[:, None]
        left = np.clip(left / FADING, 0.0, 1.0)
        off = history[:, [0, 1, 14]] - self.aim * self.flights.length
        return off * left[:, None], left

    def ways(self, history: FloatArray) -> FloatArray:
        """Ways covered (n, steps + 1, 3), show frame [m]."""
        off, _ = self._off(history)
        flat = np.linalg.norm(self.along[:, :2], axis=1)
        level = self.flights.length * self.flights.level
        climb = self.flights.length * self.flights.climb
        # The autopilot's metre is no metre of the show.
        off[:, :2] *= np.where(level > 0.0, flat / np.where(level > 0.0, level, 1.0), 1)
        upright = self.along[:, 2] / np.where(climb != 0.0, climb, 1.0)
        off[:, 2] *= np.where(climb != 0.0, upright, 1.0)
        return np.asarray(off.transpose(2, 0, 1) + self.along[:, None])

    def handed_over(self, history: FloatArray, until: FloatArray) -> FloatArray:
        """States (21, n) at ``until`` (n,) [s], seen from the ends; at rest if late."""
        result = np.zeros(history.shape[1:])
        result[20] = 1.0
        row = np.round(np.minimum(until, 1e9) / STEP).astype(np.int64)
        some = np.flatnonzero(row < len(history))
        off, left = self._off(history)
        taken = history[row[some], :, some].T * left[row[some], some]
        taken[[0, 1, 14]] = off[row[some], :, some].T
        taken[20] = history[row[some], 20, some]
        result[:, some] = taken
        return result

    def change(self, state: FloatArray) -> FloatArray:
        """Change (21, n) of ``state`` (21, n) [1/s]."""
        x, vx, mx, sx, cx, half_lean, lean = state[:14].reshape(7, 2, -1)
        z, vz, mz, sz, lift, time, rate = state[14:]
        point, speed, push = self.led(time)
        level, climb = self.aim[:2], self.aim[2]
        gap_x, gap_z = point * level - x, point * climb - z
        result = np.empty_like(state)
        # Level: 2/s of the speed missed, 1/s² of its sum, half its change.
        missing = (gap_x + speed * level - vx - mx) * (10.0 * np.pi)
        asked = 2.0 * mx + sx + 0.5 * cx + push * level
        limit = GRAVITY * np.tan(np.radians(30.0))
        size = np.sqrt(asked[0] * asked[0] + asked[1] * asked[1])
        stuck = (size > limit) & (mx[0] * asked[0] + mx[1] * asked[1] > 0.0)
        asked = asked * np.minimum(1.0, limit / np.maximum(size, limit))
        result[0:2] = vx
        flat = np.sqrt(vx[0] * vx[0] + vx[1] * vx[1])
        result[2:4] = lean * (1.0 + lift / GRAVITY) - vx * (0.25 + 0.027 * flat)
        result[4:6] = missing
        result[6:8] = np.where(stuck, 0.0, mx)
        result[8:10] = (missing - cx) * (10.0 * np.pi)
        result[10:12] = (asked - half_lean) / 0.125
        result[12:14] = (half_lean - lean) / 0.03
        # Upright: 5/s of the speed missed, by a lift that comes late.
        result[14] = vz
        result[15] = lift - vz * (0.25 + 0.027 * np.abs(vz))
        result[16] = (gap_z + speed * climb - vz - mz) * (10.0 * np.pi)
        short = 5.0 * mz + push * climb - result[15]
        result[17] = 0.1 * GRAVITY / 0.39 * short
        result[18] = (0.05 * GRAVITY / 0.39 * short + sz - lift) / 0.075
        # The law waits for who cannot keep up.
        toward = (vx - gap_x) * level
        ahead = toward[0] + toward[1] + (vz - gap_z) * climb
        still = speed < 1e-5
        wanted = 0.05 + ahead / np.where(still, 1.0, speed)
        wanted = np.where(still, 1.0, np.minimum(np.maximum(wanted, 0.0), 1.0))
        result[19] = rate
        result[20] = (wanted - rate) / self.lag
        return result
