"""Where the drones most likely are on their legs, worked out anew from the words.

The autopilot leads a point along the leg and lets the vehicle follow; what its loops
make of that is integrated in steps of 20 ms, by the midpoint rule, over a table of the
law in the same steps. Once the law is over and a vehicle is slow, the loops are linear
but for products of small numbers: what is left of its way is then told at once.
Nothing here is taken from the code that drew the flights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.law_table import LawTable
from showc.verify.loops import RATE, STATES, TIME, Loops
from showc.verify.response import PLACE, Axis, level_axis, upright_axis
from showc.verify.settling import Settling

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


_TOGETHER = 16
"""Steps that are put in their places together, and after which is asked who settles."""

_WORTH = 128
"""Drones whose settling is worth being followed by itself."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """The flights of n legs, in steps from their releases."""

    ways: NDArray[np.float32]
    """Ways covered since the legs' begins, shape (steps, 3, n), show frame [m]."""
    column: IntArray
    """Where in these each leg is, shape (n,)."""
    ended: FloatArray
    """When the law's own time has ended, shape (n,) [s]."""
    until: FloatArray
    """Time from its release to that of each drone's next leg, shape (n,) [s]."""
    memory: NDArray[np.float32]
    """What the ways lie in; it may be longer."""

    def covered(self, since: FloatArray) -> FloatArray:
        """Ways (m, 3, n) [m] of each leg at ``since`` (m, n) its release [s].

        Nothing is before it, and nothing behind the last step.
        """
        steps, _, count = self.ways.shape
        place = np.minimum(np.maximum(since / STEP, 0.0), steps - 1)
        low = place.astype(np.int64)
        share = np.subtract(place, low, out=place)
        rest = 1.0 - share
        further = (low < steps - 1) * np.int64(3 * count)
        low *= 3 * count
        low += self.column
        further += low
        found = np.empty((len(since), 3, count))
        table = self.ways.ravel()
        for axis in range(3):
            way, own = found[:, axis], table[axis * count :]
            np.multiply(own.take(low), rest, out=way)
            way += own.take(further) * share
        return found


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
        last = round(AFTER / STEP)
        self._axes = (
            Axis(*level_axis(), STEP, last),
            Axis(*upright_axis(), STEP, last),
        )
        self._settling = Settling(self._axes, lag)
        self._lag = lag
        self._law = LawTable(STEP)
        self.states = np.zeros((STATES, drones))
        self.states[RATE] = 1.0
        self._spare: list[NDArray[np.float32]] = []

    def reuse(self, tracked: Tracked) -> None:
        """Take back the memory of flights that nobody looks at any more.

        It takes long to get: much longer than to fill.
        """
        self._spare.append(tracked.memory)

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
        size = (steps + 1) * 3 * count
        memory = self._spare.pop() if self._spare else np.empty(0, dtype=np.float32)
        if memory.size < size:
            memory = np.empty(size, dtype=np.float32)
        ways = memory[:size].reshape(steps + 1, 3, count)
        ended, later = np.zeros(count), np.full(count, np.inf)
        # Those that take longest come first: who is followed no longer is cut off.
        order = np.argsort(-flights.duration, kind="stable")
        for begin in range(0, count, BLOCK):
            columns = slice(begin, min(begin + BLOCK, count))
            rows = order[columns]
            part, who = flights.chosen(rows), drones[rows]
            self._law.fill(part)
            vehicles = _Vehicles(part, along[rows], self._settling)
            state = self.states[:, who]
            state[TIME] = 0.0
            loops = Loops(self._law, self._axes, vehicles.aim, self._lag, state)
            vehicles.run(
                loops,
                ways[..., columns],
                None if until is None else until[rows],
                None if holds is None else holds[rows],
            )
            self.states[:, who] = vehicles.carried
            ended[rows], later[rows] = vehicles.ended, vehicles.until
        return Tracked(ways, np.argsort(order), ended, later, memory)


class _Vehicles:
    """How n vehicles follow their legs."""

    def __init__(
        self, flights: Profiles, along: FloatArray, settling: Settling
    ) -> None:
        self._flights, self._settling = flights, settling
        flat = np.linalg.norm(along[:, :2], axis=1)
        unit = along[:, :2] / np.where(flat > 0.0, flat, 1.0)[:, None]
        self.aim = np.vstack([unit.T * flights.level, flights.climb])
        self._goal, self._end = self.aim * flights.length, along.T
        self._scale = _scale(flights, along)
        # When nothing of what they are off their ends counts any more.
        self._gone = flights.duration + AFTER

    def run(
        self,
        loops: Loops,
        ways: NDArray[np.float32],
        until: FloatArray | None,
        holds: FloatArray | None,
    ) -> None:
        """Follow the ``loops`` into ``ways`` (steps + 1, 3, n).

        Sets when the laws' times end, when the next legs are released, and with which
        states these begin, seen from the ends: at rest, if that is not reached.
        """
        self._loops, self._ways, self._holds = loops, ways, holds
        self._flying = self._flights.length > 0.0
        self._due = np.where(self._flying, self._flights.duration / STEP, -1.0)
        steps, count = len(ways) - 1, self._due.size
        self.ended = np.where(self._flying, steps * STEP, 0.0)
        self.until = np.full(count, np.inf) if until is None else until.copy()
        if holds is not None:
            self.until[~self._flying] = holds[~self._flying]
        self.carried = np.zeros((STATES, count))
        self.carried[RATE] = 1.0
        self._over = np.count_nonzero(~self._flying)
        begin = 0
        places = np.empty((_TOGETHER, 3, count))
        self._look_ahead(0)
        for step in range(steps + 1):
            if step:
                loops.advance()
                self._end_legs(step)
            places[step - begin] = loops.kinds[PLACE]
            if step == self._next:
                self._hand_over(step)
            # From there on every drone is on its next leg, rounding included.
            done = step == steps or self._latest < step - 1
            if not done and step and step - begin + 1 < _TOGETHER:
                continue
            self._put(begin, places[: step - begin + 1])
            begin = step + 1
            if done:
                ways[begin:, :, :count] = ways[step, :, :count]
                break
            self._settle(step)
            count = loops.time.size
            places = places[..., :count]
            if not count:
                break

    def _look_ahead(self, step: int) -> None:
        """Find when, from ``step`` on, a next leg begins, and the last of all."""
        count = self._loops.time.size
        self._handover = np.round(np.minimum(self.until, 1e9) / STEP).astype(np.int64)
        some = self._handover[:count]
        self._next = int(some[some >= step].min(initial=1 << 60))
        self._latest = int(some.max(initial=-1))

    def _end_legs(self, step: int) -> None:
        """Note whose law has ended within the last step."""
        loops = self._loops
        time, before = loops.time, loops.time_before
        over = time >= self._due[: time.size]
        found = np.count_nonzero(over)
        if found == self._over:
            return
        self._over = found
        rows = np.flatnonzero(over & self._flying[: time.size])
        self._flying[rows] = False
        share = (self._due[rows] - before[rows]) / (time[rows] - before[rows])
        self.ended[rows] = STEP * (step - 1 + share)
        if self._holds is not None:
            self.until[rows] = self.ended[rows] + self._holds[rows]
            self._look_ahead(step)
            # A leg that ends within a step may hand over before that step.
            early = rows[self._handover[rows] == step - 1]
            self._carry(early, step - 1, loops.kinds_before, loops.rate_before)

    def _hand_over(self, step: int) -> None:
        """Let the next legs of some drones begin at ``step``."""
        loops = self._loops
        rows = np.flatnonzero(self._handover[: loops.time.size] == step)
        self._carry(rows, step, loops.kinds, loops.rate)
        self._look_ahead(step + 1)

    def _carry(
        self, rows: IntArray, step: int, kinds: FloatArray, rate: FloatArray
    ) -> None:
        """Begin the next legs of drones ``rows`` (m,) with the states at ``step``."""
        state = kinds[..., rows]
        state[PLACE] -= self._goal[:, rows]
        state *= self._left(step, rows)
        self.carried[:TIME, rows] = state.reshape(TIME, -1)
        self.carried[RATE, rows] = rate[rows]

    def _settle(self, step: int) -> None:
        """Finish the last drones, as far as all is told of them."""
        loops = self._loops
        count = loops.time.size
        off = loops.kinds.copy()
        off[PLACE] -= self._goal[:, :count]
        # A step behind its end, the table of the law is at rest.
        settled = loops.time >= self._due[:count] + 1.0
        settled[settled] = self._settling.slow(off[..., settled])
        left = np.flatnonzero(~(settled | (self._handover[:count] < step - 1)))
        kept = int(left[-1]) + 1 if left.size else 0
        # Who is left alone is followed for little more.
        if kept and count - kept < _WORTH:
            return
        rows, off = slice(kept, count), off[..., kept:]
        off[..., ~settled[kept:]] = 0.0
        steps, end = self._handover[rows] - step, step + 1 + self._settling.steps
        places = self._ways[step + 1 : end, :, rows]
        state = self._settling.follow(off, self._scale[:, rows], steps, places)
        self._fade(step + 1, places, rows)
        places += self._end[:, rows].astype(np.float32)
        # Behind the steps that are known, nothing of it counts.
        self._ways[end:, :, rows] = self._end[:, rows]
        later = np.flatnonzero((steps > 0) & (self._handover[rows] < len(self._ways)))
        state = state[..., later] * self._left(
            self._handover[rows][later], kept + later
        )
        self.carried[:TIME, kept + later] = state.reshape(TIME, -1)
        rate = loops.rate[rows][later]
        self.carried[RATE, kept + later] = self._settling.rates(rate, steps[later])
        loops.keep(kept)
        self._over = np.count_nonzero(loops.time >= self._due[:kept])
        self._look_ahead(step + 1)

    def _put(self, begin: int, places: FloatArray) -> None:
        """Put places (m, 3, k) from step ``begin`` on among the ways."""
        rows = slice(places.shape[2])
        places -= self._goal[:, rows]
        self._fade(begin, places, rows)
        places *= self._scale[:, rows]
        ways = self._ways[begin : begin + len(places), :, rows]
        np.add(places, self._end[:, rows], out=ways, casting="same_kind")

    def _fade(
        self, begin: int, off: FloatArray | NDArray[np.float32], rows: slice
    ) -> None:
        """Let what drones are ``off`` (m, 3, k) from step ``begin`` on fade."""
        # Up to this step, nothing does.
        whole = max(begin, int((self._gone[rows].min() - FADING) / STEP))
        if whole < begin + len(off):
            steps = np.arange(whole, begin + len(off))
            off[whole - begin :] *= self._left(steps[:, None, None], rows)

    def _left(self, step: int | IntArray, rows: IntArray | slice) -> FloatArray:
        """Return how much of what drones ``rows`` are off their ends still counts."""
        left = (self._gone[rows] - STEP * step) / FADING
        return np.asarray(np.minimum(np.maximum(left, 0.0), 1.0))


def _scale(flights: Profiles, along: FloatArray) -> FloatArray:
    """From the autopilot's metre to the show's, level and upright, (3, n)."""
    flat = np.linalg.norm(along[:, :2], axis=1)
    level, climb = flights.length * flights.level, flights.length * flights.climb
    across = np.where(level > 0.0, flat / np.where(level > 0.0, level, 1.0), 1.0)
    up = along[:, 2] / np.where(climb != 0.0, climb, 1.0)
    return np.stack([across, across, np.where(climb != 0.0, up, 1.0)])
