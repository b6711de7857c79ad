"""Where the drones most likely are on their legs, worked out anew from the words.

The autopilot leads a point along the leg and lets the vehicle follow; what its loops
make of that is integrated in steps of 20 ms, by the midpoint rule, over a table of the
law in the same steps. Nothing here is taken from the code that drew the flights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import GRAVITY, Profiles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

STEP = 0.02
"""[s]"""

AFTER = 6.0
"""How long after the law's end a drone is followed [s]."""

FADING = 1.0
"""Time at the end of that in which it comes to rest at its goal [s]."""

BLOCK = 1000
"""Legs that are integrated together: few enough to stay in the processor's cache."""

_AT_ONCE = 10_000
"""Places of laws that are worked out together, for the same reason."""

_STEEPEST = GRAVITY * np.tan(np.radians(30.0))
"""Greatest acceleration asked for on the level [m/s²]."""

_COLUMNS = tuple(Profiles.__dataclass_fields__)


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """The flights of n legs, in steps from their releases."""

    flat: NDArray[np.float32]
    """Part of the level way covered, shape (n, steps)."""
    steep: NDArray[np.float32]
    """Part of the way up or down covered, shape (n, steps)."""
    ended: FloatArray
    """When the law's own time has ended, shape (n,) [s]."""

    def covered(
        self, leg: IntArray, since: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Parts (m,), level and upright, of legs ``leg`` (m,) at ``since`` (m,) [s]."""
        most = self.flat.shape[1] - 1
        place = np.clip(since / STEP, 0.0, most)
        low = np.floor(place).astype(np.int64)
        high = np.minimum(low + 1, most)
        rest = place - low
        flat = self.flat[leg, low] * (1.0 - rest) + self.flat[leg, high] * rest
        steep = self.steep[leg, low] * (1.0 - rest) + self.steep[leg, high] * rest
        return flat, steep


def tracked(flights: Profiles, lag: float) -> Tracked:
    """Return the flights along the legs of ``flights``.

    ``lag`` [s] is greatest acceleration over jerk: how late the law's time changes its
    rate.
    """
    count = flights.length.size
    longest = float(flights.duration.max(initial=0.0)) + AFTER
    steps = int(np.ceil(longest / STEP))
    # Who has come to rest at the goal stays there.
    flat = np.ones((count, steps + 1), dtype=np.float32)
    steep = np.ones_like(flat)
    ended = np.zeros(count)
    # Legs of about one duration together: none waits long for the others.
    order = np.argsort(flights.duration, kind="stable")
    for begin in range(0, count, BLOCK):
        rows = order[begin : begin + BLOCK]
        part = Profiles(*(getattr(flights, name)[rows] for name in _COLUMNS))
        own_flat, own_steep, ended[rows] = _integrated(part, lag, steps)
        flat[rows, : own_flat.shape[1]] = own_flat
        steep[rows, : own_steep.shape[1]] = own_steep
    return Tracked(flat, steep, ended)


def _integrated(
    flights: Profiles, lag: float, steps: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Parts covered (n, own + 1), level and upright, and when the law ends (n,).

    ``own`` is the number of steps until all have come to rest, at most ``steps``; the
    law of a leg that has not ended by then is followed on, up to ``steps``.
    """
    count = flights.length.size
    longest = float(flights.duration.max(initial=0.0)) + AFTER
    own = min(int(np.ceil(longest / STEP)), steps)
    vehicles = _Vehicles(flights, lag)
    now = np.zeros((14, count))
    now[13] = 1.0
    moves = flights.length > 0.0
    flat = np.zeros((own + 1, count))
    steep = np.zeros((own + 1, count))
    clock = np.zeros((steps + 1, count))
    for step in range(steps):
        if step >= own and np.all(~moves | (now[12] >= flights.duration)):
            clock = clock[: step + 1]
            break
        half = now + 0.5 * STEP * vehicles.change(now)
        now += STEP * vehicles.change(half)
        clock[step + 1] = now[12]
        if step < own:
            flat[step + 1], steep[step + 1] = now[0], now[1]
    flat = _parts(flat, flights.length * flights.level, flights.duration)
    steep = _parts(steep, flights.length * flights.climb, flights.duration)
    flat[0] = steep[0] = 0.0
    ended = np.full(count, STEP * steps)
    for leg in np.flatnonzero(moves & (clock[-1] >= flights.duration)):
        row = int(np.searchsorted(clock[:, leg], flights.duration[leg]))
        before, after = clock[row - 1, leg], clock[row, leg]
        share = (flights.duration[leg] - before) / (after - before)
        ended[leg] = STEP * (row - 1 + share)
    return flat.T, steep.T, np.where(moves, ended, 0.0)


def _parts(way: FloatArray, whole: FloatArray, duration: FloatArray) -> FloatArray:
    """Parts of ``whole`` (n,) [m] that ``way`` (steps, n) [m] is.

    Whatever is left comes to nothing over the last second.
    """
    left = duration + AFTER - STEP * np.arange(len(way))[:, None]
    off = way / np.where(whole != 0.0, whole, np.inf) - 1.0
    return np.asarray(1.0 + np.clip(left / FADING, 0.0, 1.0) * off)


class _Vehicles:
    """How the states of n vehicles change.

    Rows of a state, level and upright in turn: place, speed, speed missed, its sum;
    then the change of the level speed missed, lean half way, lean, lift; time and rate
    of the law.
    """

    def __init__(self, flights: Profiles, lag: float) -> None:
        self.lag = lag
        self.way = np.stack([flights.level, flights.climb])
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
        first *= 1.0 - share
        second *= share
        first += second
        return first

    def change(self, state: FloatArray) -> FloatArray:
        """Change (14, n) of ``state`` (14, n) [1/s]."""
        place, speed, missed, total = state[0:2], state[2:4], state[4:6], state[6:8]
        cx, half_lean, lean, lift, time, rate = state[8:]
        point, pace, push = self.led(time)
        gap, lead = point * self.way - place, push * self.way
        drag = _drag(speed)
        result = np.empty_like(state)
        result[0:2] = speed
        result[4:6] = (gap + pace * self.way - speed - missed) * (10.0 * np.pi)
        # Level: 2/s of the speed missed, 1/s² of its sum, half its change.
        result[8] = (result[4] - cx) * (10.0 * np.pi)
        asked = 2.0 * missed[0] + total[0] + 0.5 * cx + lead[0]
        given = np.minimum(np.maximum(asked, -_STEEPEST), _STEEPEST)
        stuck = (given != asked) & (missed[0] * asked > 0.0)
        result[6] = np.where(stuck, 0.0, missed[0])
        result[9] = (given - half_lean) / 0.125
        result[10] = (half_lean - lean) / 0.03
        result[2] = lean * (1.0 + lift / GRAVITY) - drag[0]
        # Upright: 5/s of the speed missed, by a lift that comes late.
        result[3] = lift - drag[1]
        short = 5.0 * missed[1] + lead[1] - result[3]
        result[7] = 0.1 * GRAVITY / 0.39 * short
        result[11] = (0.05 * GRAVITY / 0.39 * short + total[1] - lift) / 0.075
        # The law waits for who cannot keep up.
        ahead = (speed - gap) * self.way
        still = pace < 1e-5
        slow = np.where(still, 1.0, pace)
        wanted = 0.05 + (ahead[0] + ahead[1]) / slow
        wanted = np.minimum(np.maximum(wanted, 0.0), 1.0)
        result[12] = rate
        result[13] = (np.where(still, 1.0, wanted) - rate) / self.lag
        return result


def _drag(speed: FloatArray) -> FloatArray:
    """Deceleration [m/s²]."""
    return speed * (0.25 + 0.027 * np.abs(speed))
