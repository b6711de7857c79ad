"""The loops by which an autopilot makes vehicles follow a law of straight legs.

The law is tabled in steps of time, once for many legs; between them it is read along
straight lines. What the loops make of it is the change of 21 numbers for each vehicle.
Nothing here is taken from the code that drew the flights.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import GRAVITY, PHASES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.autopilot import Profiles

    FloatArray = NDArray[np.float64]

STATES = 21
"""Rows of a state: place, speed, speed missed, of three axes each; the sum of the speed
missed, of three axes; its change, lean, lean half way, of the two level axes each;
lift; time and rate of the law."""

PLACES, TIME, RATE = slice(0, 3), 19, 20
"""Rows of a state."""

_SPEEDS, _MISSED, _SUMS, _RISE = slice(3, 6), slice(6, 9), slice(9, 11), 11
_CHANGES, _LEAN, _HALF_LEAN, _LIFT = slice(12, 14), slice(14, 16), slice(16, 18), 18
_FOLLOWING = slice(12, 19)
"""Rows that follow others, each late by its own time."""

_FILTER = 10.0 * np.pi
"""Of the speed missed, and of its change [1/s]."""

_STEEPEST = GRAVITY * np.tan(np.radians(30.0))
"""Greatest level acceleration that is asked for [m/s²]."""

_HOVER = 0.39
"""Thrust in hover, as a fraction of the greatest."""

_STILL = 1e-5
"""Below this speed the law waits for nobody [m/s]."""

_FOLLOW = np.array(
    [[_FILTER, _FILTER] + [1.0 / 0.03] * 2 + [8.0] * 2 + [1.0 / 0.075]]
).T
"""How quickly they do, shape (7, 1) [1/s]."""

_AT_ONCE = 10_000
"""Places of laws that are worked out together: they stay in the processor's cache."""


class LawTable:
    """Distance, speed and acceleration of legs in steps of ``step`` [s].

    Its memory is used again for the next legs: it takes long to get.
    """

    def __init__(self, step: float) -> None:
        self._step = step
        # Distance, speed, acceleration, and what each gains up to the next step.
        self._law = np.empty((6, 0))

    def fill(self, flights: Profiles) -> None:
        """Work out the table of n legs, one row of legs after the other."""
        count = self._count = flights.length.size
        self._leg = leg = np.arange(count)
        self._row = np.empty(count, dtype=np.int64)
        self._where, self._share = np.empty((2, count))
        self._found = np.empty((6, count))
        self._last = int(np.ceil(flights.duration.max(initial=0.0) / self._step)) + 1
        size = (self._last + 1) * count
        if self._law.shape[1] < size:
            self._law = np.empty((6, size))
        # Phases by the first step in each of them: they follow each other.
        begins = np.ceil(flights.edges[:, 1:PHASES] / self._step).astype(np.int64)
        begun = np.zeros((self._last + 1, count), dtype=np.uint8)
        np.add.at(begun, (begins, leg[:, None]), 1)
        phase = np.zeros(count, dtype=np.int64)
        some = max(1, _AT_ONCE // max(count, 1))
        for begin in range(0, self._last + 1, some):
            part = np.cumsum(begun[begin : begin + some], axis=0, dtype=np.int64)
            part += phase
            phase = part[-1]
            times = self._step * np.arange(begin, begin + len(part))
            since = np.minimum(times[:, None], flights.duration)
            since -= flights.edges[leg, part]
            rows = slice(begin * count, begin * count + part.size)
            legs = np.broadcast_to(leg, part.shape).ravel()
            self._law[:3, rows] = flights.advanced(legs, part.ravel(), since.ravel())
        law, end = self._law, size - count
        np.subtract(law[:3, count:size], law[:3, :end], out=law[3:, :end])
        law[3:, end:size] = 0.0

    def __call__(self, time: FloatArray, result: FloatArray) -> None:
        """Put distance, speed, acceleration (3, n) at times (n,) [s] in ``result``."""
        where, share, row, found = self._where, self._share, self._row, self._found
        np.multiply(time, 1.0 / self._step, out=where)
        np.minimum(where, float(self._last), out=where)
        np.floor(where, out=share)
        np.copyto(row, share, casting="unsafe")
        np.subtract(where, share, out=share)
        row *= self._count
        row += self._leg
        # All rows are within the table; "clip" spares a copy of the result.
        self._law.take(row, axis=1, out=found, mode="clip")
        np.multiply(found[3:], share, out=result)
        result += found[:3]


class Loops:
    """How the states of n vehicles change that follow their legs.

    Everything is worked out in place: arrays of this size take as long to make as to
    fill.
    """

    def __init__(self, law: LawTable, aim: FloatArray, lag: float) -> None:
        self._law, self._aim, self._lag = law, aim, lag
        count = aim.shape[1]
        self._led, self._ahead, self._triple = np.empty((3, 3, count))
        self._target = np.empty((7, count))
        self._pair = np.empty((2, count))
        self._single = np.empty(count)

    def change(self, state: FloatArray, result: FloatArray) -> None:
        """Put the change (21, n) of ``state`` (21, n) into ``result`` [1/s]."""
        missed, target = state[_MISSED], self._target
        self._law(state[TIME], self._led)
        _, _, push = self._led
        result[PLACES] = state[_SPEEDS]
        self._miss(state, result[_MISSED])
        self._accelerate(state, result[_SPEEDS])
        # Level: 2/s of the speed missed, 1/s² of its sum, half its change.
        # Upright: 5/s of the speed missed, by a lift that comes late.
        asked = target[4:]
        np.multiply(push, self._aim, out=asked)
        level, short = asked[:2], asked[2]
        self._pull(level, missed[:2], 2.0)
        level += state[_SUMS]
        self._pull(level, state[_CHANGES], 0.5)
        result[_SUMS] = missed[:2]
        self._limit(level, missed, result[_SUMS])
        np.multiply(missed[2], 5.0, out=self._single)
        short += self._single
        short -= result[_SPEEDS][2]
        np.multiply(short, 0.1 * GRAVITY / _HOVER, out=result[_RISE])
        short *= 0.05 * GRAVITY / _HOVER
        short += state[_RISE]
        # What is asked for is followed by lean half way and lift, and so on.
        target[:2] = result[_MISSED][:2]
        target[2:4] = state[_HALF_LEAN]
        target -= state[_FOLLOWING]
        np.multiply(target, _FOLLOW, out=result[_FOLLOWING])
        self._wait(state, result)

    def _pull(self, asked: FloatArray, by: FloatArray, gain: float) -> None:
        """Add ``gain`` times ``by``, both (2, n), to what is asked for."""
        np.multiply(by, gain, out=self._pair)
        asked += self._pair

    def _miss(self, state: FloatArray, result: FloatArray) -> None:
        """Change (3, n) of the speed missed; keeps place + speed for the law."""
        point, speed, _ = self._led
        np.add(state[PLACES], state[_SPEEDS], out=self._ahead)
        np.add(point, speed, out=self._single)
        np.multiply(self._aim, self._single, out=result)
        result -= self._ahead
        result -= state[_MISSED]
        result *= _FILTER

    def _accelerate(self, state: FloatArray, result: FloatArray) -> None:
        """Change (3, n) of the speeds: lean and lift, less the drag."""
        speeds, triple, single = state[_SPEEDS], self._triple, self._single
        np.multiply(speeds, speeds, out=triple)
        flat, _, fast = triple
        flat += triple[1]
        np.sqrt(flat, out=flat)
        np.abs(speeds[2], out=fast)
        triple *= 0.027
        triple += 0.25
        triple[1] = flat
        triple *= speeds
        np.multiply(state[_LIFT], 1.0 / GRAVITY, out=single)
        single += 1.0
        np.multiply(state[_LEAN], single, out=result[:2])
        result[2] = state[_LIFT]
        result -= triple

    def _limit(self, asked: FloatArray, missed: FloatArray, sums: FloatArray) -> None:
        """Lean no further than is allowed; what is missed is then not summed up."""
        np.multiply(asked, asked, out=self._pair)
        size = np.add(self._pair[0], self._pair[1], out=self._single)
        steep = np.flatnonzero(size > _STEEPEST**2)
        if steep.size:
            stuck = steep[np.sum(missed[:2, steep] * asked[:, steep], axis=0) > 0.0]
            sums[:, stuck] = 0.0
            asked[:, steep] *= _STEEPEST / np.sqrt(size[steep])

    def _wait(self, state: FloatArray, result: FloatArray) -> None:
        """Let the law wait for who cannot keep up."""
        point, speed, _ = self._led
        wanted = np.multiply(self._aim, self._ahead, out=self._triple)[0]
        wanted += self._triple[1]
        wanted += self._triple[2]
        wanted -= point
        wanted /= np.maximum(speed, _STILL, out=self._single)
        wanted += 0.05
        np.maximum(wanted, 0.0, out=wanted)
        np.minimum(wanted, 1.0, out=wanted)
        np.copyto(wanted, 1.0, where=speed < _STILL)
        result[TIME] = state[RATE]
        np.subtract(wanted, state[RATE], out=result[RATE])
        result[RATE] *= 1.0 / self._lag
