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

BLOCK = 1024
"""Legs that are integrated together; bounds the memory."""

_AT_ONCE = 10_000
"""Places of laws that are worked out together: they stay in the processor's cache."""

STATES = 21
"""Rows of a state: level place, speed, speed missed, its sum, its change, lean half
way, lean, two each; place, speed, speed missed, sum and lift upright; time and rate of
the law."""


_PLACES = [0, 1, 14]
"""Rows of a state that are places."""


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
        *,
        until: FloatArray | None = None,
        holds: FloatArray | None = None,
    ) -> Tracked:
        """Fly the next legs of the ``drones`` (n,).

        ``flights`` are their n legs, ``along`` (n, 3) [m] the ways in the show frame.
        The leg after it is released ``until`` (n,) from this leg's release, or
        ``holds`` (n,) after the law's own time for this leg has ended [s].
        """
        lasting = flights.duration + AFTER
        if until is not None:
            lasting = np.minimum(lasting, until + STEP)
        steps = max(int(np.ceil(lasting.max(initial=0.0) / STEP)), 1)
        count = drones.size
        ways = np.zeros((count, steps + 1, 3), dtype=np.float32)
        ended, later = np.zeros(count), np.full(count, np.inf)
        for begin in range(0, count, BLOCK):
            rows = slice(begin, min(begin + BLOCK, count))
            vehicles = _Vehicles(
                flights.part(rows.start, rows.stop), along[rows], self.lag
            )
            who = drones[rows]
            vehicles.run(
                self.states[:, who],
                ways[rows],
                None if until is None else until[rows],
                None if holds is None else holds[rows],
            )
            self.states[:, who] = vehicles.carried
            ended[rows], later[rows] = vehicles.ended, vehicles.until
        return Tracked(ways, ended, later)


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

    def run(
        self,
        state: FloatArray,
        ways: NDArray[np.float32],
        until: FloatArray | None,
        holds: FloatArray | None,
    ) -> None:
        """Integrate from ``state`` (21, n) into ``ways`` (n, steps + 1, 3).

        Sets when the laws' times end, when the next legs are released, and with which
        states these begin, seen from the ends: at rest, if that is not reached.
        """
        moves = self.flights.length > 0.0
        steps = ways.shape[1] - 1
        due = np.where(moves, self.flights.duration, 0.0)
        self.ended = np.where(moves, steps * STEP, 0.0)
        self.until = np.full(self.count, np.inf) if until is None else until.copy()
        if holds is not None:
            self.until[~moves] = holds[~moves]
        self.carried = np.zeros_like(state)
        self.carried[20] = 1.0
        goal, scale = self.aim * self.flights.length, self._scale()
        places = np.empty((steps + 1, 3, self.count), dtype=np.float32)
        flying = moves.copy()
        now = state.copy()
        now[19] = 0.0
        before = now
        for step in range(steps + 1):
            if step:
                before = now
                half = now + 0.5 * STEP * self.change(now)
                now = now + STEP * self.change(half)
            over = flying & (now[19] >= due)
            if step and over.any():
                flying &= ~over
                first, second = before[19, over], now[19, over]
                share = (due[over] - first) / (second - first)
                self.ended[over] = STEP * (step - 1 + share)
                if holds is not None:
                    self.until[over] = self.ended[over] + holds[over]
            off = (now[_PLACES] - goal) * self._left(step)
            places[step] = off * scale
            handover = np.round(np.minimum(self.until, 1e9) / STEP).astype(np.int64)
            self._hand_over(handover == step, now, off, step)
            # A leg that ends within a step may hand over before that step.
            if step:
                early = over & (handover == step - 1)
                was = (before[_PLACES] - goal) * self._left(step - 1)
                self._hand_over(early, before, was, step - 1)
            if np.all(handover < step - 1):
                # From here on every drone is on its next leg, rounding included.
                places[step + 1 :] = places[step]
                break
        ways[:] = places.transpose(2, 0, 1)
        ways += self.along[:, None].astype(np.float32)

    def _hand_over(
        self, some: NDArray[np.bool_], state: FloatArray, off: FloatArray, step: int
    ) -> None:
        if some.any():
            self.carried[:, some] = state[:, some] * self._left(step)[some]
            for row, place in enumerate(_PLACES):
                self.carried[place, some] = off[row, some]
            self.carried[20, some] = state[20, some]

    def _left(self, step: int) -> FloatArray:
        """Return how much of what the drones are off their ends still counts, (n,)."""
        left = (self.flights.duration + AFTER - STEP * step) / FADING
        return np.asarray(np.minimum(np.maximum(left, 0.0), 1.0))

    def _scale(self) -> FloatArray:
        """From the autopilot's metre to the show's, level and upright, (3, n)."""
        flat = np.linalg.norm(self.along[:, :2], axis=1)
        level = self.flights.length * self.flights.level
        climb = self.flights.length * self.flights.climb
        across = np.where(level > 0.0, flat / np.where(level > 0.0, level, 1.0), 1.0)
        up = self.along[:, 2] / np.where(climb != 0.0, climb, 1.0)
        return np.stack([across, across, np.where(climb != 0.0, up, 1.0)])

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
