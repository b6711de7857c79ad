"""The autopilot's loops: how a drone changes that follows a leg, a step at a time.

ArduCopter leads a point along the leg by the law, and lets the vehicle follow it. What
it does then, for the default quadrotor of ArduPilot's simulation:

- The law's own time t runs at a rate r, which follows, acceleration / jerk late, how
  well the drone keeps up: 0.05 + (its speed along the leg - the gain of the place times
  its distance behind the point) / the law's speed, 0 to 1.
- Level, in both axes: the speed asked for is the law's and the gain of the place times
  the distance to the point. The speed missed, smoothed over 0.032 s, asks for an
  acceleration, up to the steepest lean: that of the law, plus gains times it, its sum,
  its change and the speed asked for. The vehicle leans to that 0.125 s and 0.03 s late,
  and pushes the harder the more it lifts. Drag takes 0.25/s times its speed and 0.027/m
  times its square.
- Upright: the speed missed asks for the acceleration of the law plus a gain times it;
  the acceleration missed for a lift of 1.26 times it plus 2.5/s times its sum, which
  comes 0.075 s late. Drag is the same.

The form is that of the autopilot's controllers, the gains are those of the parameters;
the times of lean and lift, and drag, are fitted to a transcription of those
controllers. It is kept outside this repository and gives what was measured in
simulation. The law is taken from a table in steps of 20 ms, straight in between; the
loops are integrated by the midpoint rule in steps of 20 ms.

Arrays of a few hundred drones take as long to make as to fill, and those of a few
drones take no time but that of the calls: everything is worked out in place, and rows
that are treated alike lie together.
"""

from __future__ import annotations

from math import pi, tan
from typing import TYPE_CHECKING

import numpy as np

from showc.vehicle import STANDARD_GRAVITY

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.autopilot.parameters import Parameters
    from showc.autopilot.s_curve import LegProfile


STEP = 0.02
"""Step of the table and of the integration [s]: shorter than the shortest time constant
of the loops, ``LEAN_TIMES[1]``."""

SLACK_RATE = 0.05
"""How much slower than the law a drone may be before the law's time slows down."""

STANDS = 1e-5
"""Below this speed of the law its time runs freely [m/s]."""

SMOOTHING = 1.0 / (2.0 * pi * 5.0)
"""Time constant of the speed missed: 5 Hz [s]."""

LEAN_TIMES = 0.125, 0.03
"""Time constants of leaning: of the lean asked for, and of the vehicle [s]; fitted, as
said above."""

HOVER = 0.39
"""Throttle of hovering: lift over throttle is free fall over this."""

LIFT_GAIN, LIFT_SUM = 0.05 * STANDARD_GRAVITY / HOVER, 0.1 * STANDARD_GRAVITY / HOVER
"""Lift over the upright acceleration missed, and over its sum [1/s]."""

LIFT_TIME = 0.075
"""Time constant of the lift [s]; fitted, too."""

DRAG, DRAG_SQUARE = 0.25, 0.027
"""Deceleration over speed [1/s], and over its square [1/m]."""

STATES = 22
"""Numbers that describe a drone, in this order: place (3) [m], the law's time [steps],
sum of the speed missed (2, and one that nothing heeds) [m]; speed (3) [m/s], rate of
the law's time, speed missed (3) [m/s]; part of the level acceleration asked for that
is the change of the speed missed, lean asked for, lean (2 each) [m/s²]; lift [m/s²];
lift asked for by the sum of the acceleration missed [m/s²]. Of three axes two are level
and the last is upright."""

PLACE, TIME, RATE = slice(0, 3), 3, 10
"""Rows of a state."""


def states_at_rest(count: int) -> FloatArray:
    """Return the states (STATES, ``count``) of drones that rest at their places."""
    found = np.zeros((STATES, count))
    found[RATE] = 1.0
    return found


class _Rows:
    """A state (STATES, n), or its change, with names for its rows."""

    def __init__(self, values: FloatArray) -> None:
        self.all = values
        self.place, self.time, self.total = values[PLACE], values[TIME], values[4:6]
        self.speed, self.rate, self.missed = values[7:10], values[RATE], values[11:14]
        self.change, self.lean_asked = values[14:16], values[16:18]
        self.lean, self.lift, self.lift_total = values[18:20], values[20], values[21]
        # What is summed up, and what of.
        self.sums, self.summands = values[:7], values[7:14]
        self.late, self.level_missed = values[14:20], values[11:13]
        self.level_speed, self.upright_speed = values[7:9], values[9]


def _gains(span: float, late: float) -> FloatArray:
    """Return what makes changes over ``span`` [s] of what ``_change`` gives.

    That is the difference to what each row follows; this is over its time constant.
    """
    gains = np.ones((STATES, 1))
    gains[TIME] = 1.0 / STEP
    gains[RATE] = 1.0 / late
    gains[11:16] = 1.0 / SMOOTHING
    gains[16:18], gains[18:20] = (1.0 / time for time in LEAN_TIMES)
    gains[20] = 1.0 / LIFT_TIME
    gains[21] = LIFT_SUM
    return span * gains


class Loops:
    """The loops of n drones that follow a leg each.

    Parameters
    ----------
    profile
        How the law has their n legs.
    aim
        Unit vectors of the legs, shape (3, n); zero for legs of no length.
    parameters
        The autopilot's: its gains, and how late the law's time changes its rate.

    Attributes
    ----------
    state
        Their states, shape (STATES, n); those of ``advance``.
    """

    def __init__(
        self, profile: LegProfile, aim: FloatArray, parameters: Parameters
    ) -> None:
        count = len(profile)
        late = parameters.acceleration / parameters.jerk
        gains = self._own = parameters.gains
        self._hold = np.array([[gains.place], [gains.place], [gains.height]])
        self._missed_gains = np.array([[gains.speed], [gains.speed], [gains.climb]])
        self._steepest = STANDARD_GRAVITY * tan(gains.lean)
        self.aim = aim
        self.last = 1 + int(np.ceil(profile.duration.max(initial=0.0) / STEP))
        self.table = _table(profile, self.last)
        self.finished = False
        self.state = states_at_rest(count)
        self._now = _Rows(self.state)
        self._half = _Rows(np.empty((STATES, count)))
        self._step = _Rows(np.empty((STATES, count)))
        self._half_gains, self._gains = (_gains(s * STEP, late) for s in (0.5, 1.0))
        self._column = np.arange(count)
        self._at = np.empty(count, dtype=np.int64)
        self._read = np.empty((6, count))
        self._law, self._slope = self._read[:3], self._read[3:]
        self._share, self._one = np.empty((2, count))
        self._moves = np.empty(count, dtype=np.bool_)
        self._three, self._asked = np.empty((2, 3, count))
        self._level_asked, self._upright_asked = self._asked[:2], self._asked[2]
        self._wanted = np.ones(count)
        self._push = np.empty(count)
        self._forward = np.empty((2, count))

    def advance(self) -> None:
        """Put the states a step on, by the midpoint rule."""
        half, step = self._half, self._step
        self._change(self._now, half)
        half.all *= self._half_gains
        half.all += self.state
        self._change(half, step)
        step.all *= self._gains
        self.state += step.all

    def look_ahead(self) -> None:
        """Note when the law has come to the end of all legs: it rests from then on."""
        if not self.finished and self.state[TIME].min(initial=np.inf) >= self.last:
            self.finished = True
            self._law[:] = self.table[:3, -self._column.size :]
            self._wanted.fill(1.0)

    def _change(self, now: _Rows, out: _Rows) -> None:
        """Put the changes of ``now``, without their gains, into ``out``."""
        three, asked, one = self._three, self._asked, self._one
        if not self.finished:
            self._look_up(now.time)
        point, speed, push = self._law
        np.copyto(out.sums, now.summands)
        # The speed asked for is the law's, and a part of the distance to its place.
        np.multiply(self._hold, point, out=three)
        three += speed
        np.multiply(self.aim, three, out=out.missed)
        out.missed -= np.multiply(self._hold, now.place, out=three)
        np.multiply(out.level_missed, self._own.forward, out=self._forward)
        # What is missed of it.
        out.missed -= now.speed
        out.missed -= now.missed
        if not self.finished:
            self._wait(now, point, speed)
        np.subtract(self._wanted, now.rate, out=out.rate)
        # Asked for are the law's acceleration and what the speed missed makes of it.
        np.multiply(self.aim, push, out=asked)
        np.multiply(now.missed, self._missed_gains, out=three)
        asked += three
        level = self._level_asked
        level += np.multiply(now.total, self._own.total, out=three[:2])
        level += now.change
        level += self._forward
        self._keep_upright(now, out)
        # Each of these follows another one, late.
        np.multiply(out.level_missed, self._own.change / SMOOTHING, out=out.change)
        out.lean_asked[:] = level
        out.lean[:] = now.lean_asked
        out.late -= now.late
        # Lean and lift push, drag brakes.
        np.multiply(now.speed, now.speed, out=three)
        flat = three[0]
        flat += three[1]
        three[1] = flat
        np.sqrt(three, out=three)
        three *= -DRAG_SQUARE
        three -= DRAG
        np.multiply(three, now.speed, out=out.speed)
        np.multiply(now.lift, 1.0 / STANDARD_GRAVITY, out=one)
        one += 1.0
        np.multiply(now.lean, one, out=three[:2])
        three[2] = now.lift
        out.speed += three
        # The upright acceleration missed asks for lift.
        upright = self._upright_asked
        np.subtract(upright, out.upright_speed, out=out.lift_total)
        np.multiply(out.lift_total, LIFT_GAIN, out=out.lift)
        out.lift += now.lift_total
        out.lift -= now.lift

    def _look_up(self, time: FloatArray) -> None:
        """Read distance, speed and acceleration of the law at ``time`` (n,) [steps]."""
        share, at = self._share, self._at
        np.minimum(time, self.last, out=share)
        np.copyto(at, share, casting="unsafe")
        share -= at
        at *= self._column.size
        at += self._column
        # All are within the table: "clip" only spares a copy.
        self.table.take(at, axis=1, out=self._read, mode="clip")
        self._slope *= share
        self._law += self._slope

    def _wait(self, now: _Rows, point: FloatArray, speed: FloatArray) -> None:
        """Find the rate that the law's time follows."""
        three, wanted, hold = self._three, self._wanted, self._own.place
        np.multiply(now.place, hold, out=three)
        three += now.speed
        three *= self.aim
        keeps = np.add(three[0], three[1], out=three[0])
        keeps += three[2]
        keeps -= np.multiply(point, hold, out=self._one)
        # Where the law stands, it does not wait.
        np.greater_equal(speed, STANDS, out=self._moves)
        wanted.fill(1.0)
        np.divide(keeps, speed, out=wanted, where=self._moves)
        wanted += SLACK_RATE
        np.maximum(wanted, 0.0, out=wanted)
        np.minimum(wanted, 1.0, out=wanted)

    def _keep_upright(self, now: _Rows, out: _Rows) -> None:
        """Lean no further than is allowed; what is missed is then not summed up."""
        level = self._level_asked
        squares = np.multiply(level, level, out=self._three[:2])
        size = np.add(squares[0], squares[1], out=self._push)
        if np.maximum.reduce(size) <= self._steepest**2:
            return
        over = np.flatnonzero(size > self._steepest**2)
        helps = np.sum(now.level_missed[:, over] * level[:, over], axis=0) > 0.0
        level[:, over] *= self._steepest / np.sqrt(size[over])
        # Nothing is summed up towards where nothing more can be had.
        out.total[:, over[helps]] = 0.0


def _table(profile: LegProfile, last: int) -> FloatArray:
    """Law of n legs at steps 0 to ``last``, and what each adds till the next.

    Distance [m], speed [m/s] and acceleration [m/s²], and the same three once more, as
    differences; shape (6, (last + 1) n), the legs of a step together.
    """
    times = STEP * np.arange(last + 1)[:, None]
    count = len(profile)
    found = np.empty((6, (last + 1) * count))
    for row, values in enumerate(profile.motion(times)):
        found[row] = values.ravel()
    found[3:, : last * count] = found[:3, count:] - found[:3, : last * count]
    found[3:, last * count :] = 0.0
    return found
