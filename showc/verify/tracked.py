"""Where the drones most likely are on their legs, worked out anew from the words.

The autopilot leads a point along the leg and lets the vehicle follow; what its loops
make of that is integrated in steps of 20 ms, by the midpoint rule, over a table of the
law in the same steps. Nothing here is taken from the code that drew the flights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.loops import PLACES, RATE, STATES, TIME, LawTable, Loops

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


_TOGETHER = 32
"""Steps that are put in their places together, drone by drone."""


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
        steps = self.ways.shape[1]
        place = np.clip(since / STEP, 0.0, steps - 1)
        low = place.astype(np.int64)
        rest = (place - low)[:, None]
        row = leg * steps + low
        table = self.ways.reshape(-1, 3)
        result = table.take(row, axis=0) * (1.0 - rest)
        # Behind the last step nothing is, and nothing of it counts.
        row += low + 1 < steps
        result += table.take(row, axis=0) * rest
        return np.asarray(result)


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
        self._law = LawTable(STEP)
        self.states = np.zeros((STATES, drones))
        self.states[RATE] = 1.0

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
        ways = np.empty((count, steps + 1, 3), dtype=np.float32)
        ended, later = np.zeros(count), np.full(count, np.inf)
        for begin in range(0, count, BLOCK):
            rows = slice(begin, min(begin + BLOCK, count))
            part = flights.part(rows.start, rows.stop)
            self._law.fill(part)
            vehicles = _Vehicles(part, along[rows], self._law, self.lag)
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

    def __init__(
        self, flights: Profiles, along: FloatArray, law: LawTable, lag: float
    ) -> None:
        self.flights, self.along = flights, along
        self.count = flights.length.size
        flat = np.linalg.norm(along[:, :2], axis=1)
        unit = along[:, :2] / np.where(flat > 0.0, flat, 1.0)[:, None]
        aim = np.vstack([unit.T * flights.level, flights.climb])
        self.loops = Loops(law, aim, lag)
        self.goal, self.scale = aim * flights.length, self._scale()
        # Up to this step, nothing fades.
        self.whole = int((flights.duration.min(initial=0.0) + AFTER - FADING) / STEP)

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
        self.carried[RATE] = 1.0
        end, begin = self.along[:, None].astype(np.float32), 0
        places = np.empty((_TOGETHER, 3, self.count), dtype=np.float32)
        flying = moves.copy()
        now = state.copy()
        now[TIME] = 0.0
        before, half = np.empty_like(now), np.empty_like(now)
        handover = self._handover()
        latest = handover.max()
        for step in range(steps + 1):
            if step:
                before, now = now, before
                self._advance(before, half, now)
            over = flying & (now[TIME] >= due)
            ending = bool(step and over.any())
            if ending:
                flying &= ~over
                first, second = before[TIME, over], now[TIME, over]
                share = (due[over] - first) / (second - first)
                self.ended[over] = STEP * (step - 1 + share)
                if holds is not None:
                    self.until[over] = self.ended[over] + holds[over]
                    handover = self._handover()
                    latest = handover.max()
            off = self._off(now, step)
            place = places[step - begin]
            np.multiply(off, self.scale, out=place, casting="same_kind")
            self._hand_over(handover == step, now, off, step)
            # A leg that ends within a step may hand over before that step.
            if ending:
                early = over & (handover == step - 1)
                self._hand_over(early, before, self._off(before, step - 1), step - 1)
            # From there on every drone is on its next leg, rounding included.
            done = step == steps or bool(latest < step - 1)
            if done or step - begin + 1 == _TOGETHER:
                some = places[: step - begin + 1].transpose(2, 0, 1)
                np.add(some, end, out=ways[:, begin : step + 1])
                begin = step + 1
            if done:
                ways[:, begin:] = ways[:, step : step + 1]
                break

    def _advance(self, state: FloatArray, half: FloatArray, after: FloatArray) -> None:
        """Put what is half a step, and a step after ``state`` (21, n), in place."""
        self.loops.change(state, half)
        half *= 0.5 * STEP
        half += state
        self.loops.change(half, after)
        after *= STEP
        after += state

    def _handover(self) -> IntArray:
        """Step at which each next leg begins, (n,)."""
        return np.round(np.minimum(self.until, 1e9) / STEP).astype(np.int64)

    def _off(self, state: FloatArray, step: int) -> FloatArray:
        """How far each is off its end, in the autopilot's metres, (3, n)."""
        off = state[PLACES] - self.goal
        if step > self.whole:
            off *= self._left(step)
        return off

    def _hand_over(
        self, some: NDArray[np.bool_], state: FloatArray, off: FloatArray, step: int
    ) -> None:
        if some.any():
            self.carried[:, some] = state[:, some] * self._left(step)[some]
            self.carried[PLACES, some] = off[:, some]
            self.carried[RATE, some] = state[RATE, some]

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
