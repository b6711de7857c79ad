"""The loops by which an autopilot makes vehicles follow a law of straight legs.

They are followed by the midpoint rule, a step of which is a product of matrices but for
what is not linear: drag that grows with the speed, lift that leans, a greatest lean,
and a law that waits for its vehicle. Nothing here is taken from the code that drew the
flights.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from showc.verify.autopilot import GRAVITY
from showc.verify.response import (
    DRAG,
    HALF_LEAN,
    KINDS,
    LEAN,
    MISSED,
    PLACE,
    POINT,
    PUSH,
    SPEED,
    SUM,
    TILT,
    asked,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.law_table import LawTable
    from showc.verify.response import Axis

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

STATES = 3 * KINDS + 2
"""Numbers of a vehicle's state: x, y and z of each of the kinds of its axes' states;
time of the law, in steps, and its rate."""

TIME, RATE = 3 * KINDS, 3 * KINDS + 1
"""Rows of a state."""

_STEEPEST = GRAVITY * np.tan(np.radians(30.0))
"""Greatest level acceleration that is asked for [m/s²]."""

_STILL = 1e-5
"""Below this speed the law waits for nobody [m/s]."""

# Rows of a vehicle's numbers: place and speed together, which the law waits for, the
# level acceleration asked for, its states, the inputs at a step's begin and in its
# middle. Those that come last are known last.
_AHEAD, _ASKED = 0, 1
_KINDS = slice(2, 2 + KINDS)
_DRAG, _TILT, _POINT, _PUSH = 9, 10, 11, 12
_LATE_POINT, _LATE_PUSH, _LATE_DRAG, _LATE_TILT = 13, 14, 15, 16
_POINTS, _PUSHES = slice(11, 14, 2), slice(12, 15, 2)
_SPEED, _MISSED, _SUM, _LEAN, _HALF_LEAN = (
    _KINDS.start + kind for kind in (SPEED, MISSED, SUM, LEAN, HALF_LEAN)
)
_BEGUN, _ALL = slice(2, 13), slice(2, 17)
_ROWS = 17

_Stuck: TypeAlias = "tuple[IntArray, FloatArray]"
"""Vehicles that do not sum up what they miss, and what that is, (m,) and (2, m)."""


def _products(axis: Axis, *, level: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Matrices from the rows of one axis to half a step, a step, and what is derived.

    Returns
    -------
    ndarray
        Place and speed together, acceleration asked for, speed, lean and speed missed
        after half a step, from the rows that have begun, shape (5, 11).
    ndarray
        Place and speed together, acceleration asked for, and the states after a step,
        from all rows, shape (9, 15).
    ndarray
        The first two of these from the states, shape (2, 7).
    """
    derived = np.zeros((2, KINDS))
    derived[0, [PLACE, SPEED]] = 1.0
    if level:
        derived[1] = asked()
    begin = {DRAG: _DRAG, TILT: _TILT, POINT: _POINT, PUSH: _PUSH}
    late = {DRAG: _LATE_DRAG, TILT: _LATE_TILT, POINT: _LATE_POINT, PUSH: _LATE_PUSH}
    half, whole = np.zeros((2, KINDS, _ROWS))
    half[:, _KINDS], whole[:, _KINDS] = axis.half, axis.whole
    for kind, row in begin.items():
        half[:, row], whole[:, row] = axis.half_inputs[:, kind], axis.begun[:, kind]
    for kind, row in late.items():
        whole[:, row] = axis.middle[:, kind]
    wanted = np.vstack([derived, np.eye(KINDS)[[SPEED, LEAN, MISSED]]])
    return (
        wanted @ half[:, _BEGUN],
        np.vstack([derived, np.eye(KINDS)]) @ whole[:, _ALL],
        derived,
    )


def _clock(gain: float) -> FloatArray:
    """Return a step of the law's clock, shape (3, 5).

    From its time now and half a step later, its rate, and the rates wanted at the begin
    and in the middle of the step; ``gain`` is half a step over the lag.
    """
    time = np.array([1.0, 0.0, 1.0 - gain, gain, 0.0])
    slower = 1.0 - 2.0 * gain + 2.0 * gain**2
    rate = np.array([0.0, 0.0, slower, -2.0 * gain**2, 2.0 * gain])
    return np.stack([time, time + 0.5 * rate, rate])


class Loops:
    """States of n vehicles that follow their legs, step by step.

    Everything is worked out in place: arrays of this size take as long to make as to
    fill.

    Parameters
    ----------
    law
        Table of their legs, in the steps that are taken.
    axes
        How a level axis and the upright one change in such a step.
    aim
        Directions of the legs, shape (3, n).
    lag
        How late the law's time changes its rate [s].
    state
        Where they begin, shape (23, n).
    """

    def __init__(
        self,
        law: LawTable,
        axes: tuple[Axis, Axis],
        aim: FloatArray,
        lag: float,
        state: FloatArray,
    ) -> None:
        self._law, self._aim, self._axis = law, aim, axes[0]
        products = [
            _products(axes[number == 2], level=number < 2) for number in range(3)
        ]
        self._to_half, self._to_whole, derived = (
            np.stack(matrices) for matrices in zip(*products, strict=True)
        )
        self._to_clock = _clock(0.5 * law.step / lag)
        count = aim.shape[1]
        self._numbers, self._before = np.zeros((2, 3, _ROWS, count))
        self._clock, self._clock_before = np.zeros((2, 5, count))
        self.kinds[:] = state[:TIME].reshape(KINDS, 3, count)
        np.matmul(derived, self._numbers[:, _KINDS], out=self._numbers[:, :2])
        time, rate = state[TIME], state[RATE]
        self._clock[:3] = time, time + 0.5 * rate, rate
        self._make_room()

    @property
    def kinds(self) -> FloatArray:
        """States of the axes, shape (7, 3, n)."""
        return self._numbers[:, _KINDS].transpose(1, 0, 2)

    @property
    def kinds_before(self) -> FloatArray:
        """States of the axes a step before, shape (7, 3, n)."""
        return self._before[:, _KINDS].transpose(1, 0, 2)

    @property
    def time(self) -> FloatArray:
        """Time of the law, in steps, shape (n,)."""
        return np.asarray(self._clock[0])

    @property
    def time_before(self) -> FloatArray:
        """That a step before."""
        return np.asarray(self._clock_before[0])

    @property
    def rate(self) -> FloatArray:
        """Rate of the law's time, shape (n,)."""
        return np.asarray(self._clock[2])

    @property
    def rate_before(self) -> FloatArray:
        """That a step before."""
        return np.asarray(self._clock_before[2])

    def keep(self, count: int) -> None:
        """Follow only the first ``count`` vehicles from here on."""
        self._aim, self._numbers, self._before, self._clock, self._clock_before = (
            np.ascontiguousarray(numbers[..., :count])
            for numbers in (
                *(self._aim, self._numbers, self._before),
                *(self._clock, self._clock_before),
            )
        )
        self._make_room()

    def _make_room(self) -> None:
        count = self._aim.shape[1]
        self._lead = np.empty((2, count))
        self._led = np.empty((3, 2, count))
        self._half = np.empty((3, 5, count))
        self._triple, self._sizes = np.empty((3, count)), np.empty((2, count))
        self._towards = np.empty((2, 3, count))
        self._level, self._squares = np.empty((2, 2, 2, count))
        self._still = np.empty((2, count), dtype=np.bool_)

    def advance(self) -> None:
        """Take one step."""
        now, half, after = self._numbers, self._half, self._before
        # The law's time in the middle of the step is known at its begin.
        self._law(self._clock[:2], self._led)
        point, speed, push = self._led
        np.add(point, speed, out=self._lead)
        aim = self._aim[:, None]
        np.multiply(aim, self._lead, out=now[:, _POINTS])
        np.multiply(aim, push, out=now[:, _PUSHES])
        self._curve(now[:, _SPEED], now[:, _LEAN], now[:, _DRAG], now[:, _TILT])
        np.matmul(self._to_half, now[:, _BEGUN], out=half)
        self._curve(half[:, 2], half[:, 3], now[:, _LATE_DRAG], now[:, _LATE_TILT])
        stuck = self._limit(now, half)
        np.matmul(self._to_whole, now[:, _ALL], out=after[:, : _KINDS.stop])
        if stuck:
            self._unsum(after, *stuck)
        self._wait(now[:, _AHEAD], half[:, 0], point, speed)
        self._numbers, self._before = after, now

    def _curve(
        self, speed: FloatArray, lean: FloatArray, drag: FloatArray, tilt: FloatArray
    ) -> None:
        """Put speed (3, n) times its size, level and upright, and lean times lift."""
        triple, (flat, upright) = self._triple, self._sizes
        np.multiply(speed, speed, out=triple)
        triple[0] += triple[1]
        np.sqrt(triple[::2], out=self._sizes)
        np.multiply(speed[:2], flat, out=drag[:2])
        np.multiply(speed[2], upright, out=drag[2])
        np.multiply(lean[:2], lean[2], out=tilt[:2])

    def _wait(
        self, now: FloatArray, half: FloatArray, point: FloatArray, speed: FloatArray
    ) -> None:
        """Let the law wait for who cannot keep up; changes ``speed``."""
        towards, wanted = self._towards, self._clock[3:]
        np.multiply(self._aim, now, out=towards[0])
        np.multiply(self._aim, half, out=towards[1])
        np.add(towards[:, 0], towards[:, 1], out=wanted)
        wanted += towards[:, 2]
        wanted -= point
        np.less(speed, _STILL, out=self._still)
        wanted /= np.maximum(speed, _STILL, out=speed)
        wanted += 0.05
        np.maximum(wanted, 0.0, out=wanted)
        np.minimum(wanted, 1.0, out=wanted)
        np.copyto(wanted, 1.0, where=self._still)
        clock, after = self._clock, self._clock_before
        np.matmul(self._to_clock, clock, out=after[:3])
        self._clock, self._clock_before = after, clock

    def _limit(self, now: FloatArray, half: FloatArray) -> tuple[_Stuck, ...]:
        """Lean no further than is allowed; what is missed is then not summed up.

        Changes what is asked for at the step's begin and in its middle, and returns
        who does not sum then, if anybody leans too far.
        """
        level, squares, sizes = self._level, self._squares, self._sizes
        np.add(now[:2, _ASKED], now[:2, _PUSH], out=level[0])
        np.add(half[:2, 1], now[:2, _LATE_PUSH], out=level[1])
        np.multiply(level, level, out=squares)
        np.add(squares[:, 0], squares[:, 1], out=sizes)
        if not sizes.max(initial=0.0) > _STEEPEST**2:
            return ()
        begin = _held(level[0], now[:2, _MISSED], now[:2, _PUSH])
        # Half a step later, the sum is less by what was not added.
        some, missed = begin
        level[1][:, some] -= 0.5 * self._law.step * missed
        return begin, _held(level[1], half[:2, 4], now[:2, _LATE_PUSH])

    def _unsum(self, after: FloatArray, begin: _Stuck, middle: _Stuck) -> None:
        """Take back, after a step, what was summed up and should not have been."""
        step, level = self._law.step, after[:2]
        some, missed = begin
        share = 0.5 * step**2 * self._axis.states[HALF_LEAN, SUM]
        level[:, _HALF_LEAN][:, some] -= share * missed
        some, missed = middle
        level[:, _SUM][:, some] -= step * missed
        level[:, _ASKED][:, some] -= step * missed


def _held(asked_for: FloatArray, missed: FloatArray, push: FloatArray) -> _Stuck:
    """Take from ``push`` (2, n) what is too much, and find who misses it in vain."""
    size = np.hypot(*asked_for)
    steep = np.flatnonzero(size > _STEEPEST)
    push[:, steep] += asked_for[:, steep] * (_STEEPEST / size[steep] - 1.0)
    vain = steep[np.sum(missed[:, steep] * asked_for[:, steep], axis=0) > 0.0]
    return vain, missed[:, vain]
