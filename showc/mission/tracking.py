"""The flight that the autopilot's loops make of a leg: late, and a little too far.

ArduCopter leads a point along the leg by the law, and lets the vehicle follow it. What
it does then is integrated here, for the default quadrotor of ArduPilot's simulation:

- The law's own time t runs at a rate r, which follows, acceleration / jerk late, how
  well the drone keeps up: 0.05 + (its speed along the leg - 1/s times its distance
  behind the point) / the law's speed, 0 to 1.
- Level, in both axes: the speed asked for is the law's and 1/s times the distance to
  the point. The speed missed, smoothed over 0.032 s, asks for the acceleration of the
  law plus 2/s of it, 1/s² of its sum and 0.5 of its change, up to a tilt of 30 degrees.
  The vehicle leans to that 0.125 s and 0.03 s late, and pushes the harder the more it
  lifts. Drag takes 0.25/s times its speed and 0.027/m times its square.
- Upright: the speed missed asks for the acceleration of the law plus 5/s of it; the
  acceleration missed for a lift of 1.26 times it plus 2.5/s times its sum, which comes
  0.075 s late. Drag is the same.

The form is that of the autopilot's controllers under their default gains; the times
of lean and lift, and drag, are fitted to a transcription of those controllers that is
kept outside this repository and gives what was measured in simulation. The law is
taken from a table in steps of 20 ms, straight in between; the loops are integrated by
the midpoint rule in steps of 20 ms. What a drone is off its end is followed for 10 s
after the law's own end, and fades out over the last of them. A drone whose next leg
is released before begins it as it is then.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians, tan
from typing import TYPE_CHECKING

import numpy as np

from showc.mission.parameters import GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.mission.parameters import Parameters
    from showc.mission.stage import Stage

    FloatArray = NDArray[np.float64]

STEP = 0.02
"""Step of the table and of the integration [s]."""

TAIL = 10.0
"""How long after the law's end a drone is followed on [s]."""

FADE = 1.0
"""Time at the end of that in which it comes to rest at its goal [s]."""

SLACK_RATE = 0.05
"""How much slower than the law a drone may be before the law's time slows down."""

STANDS = 1e-5
"""Below this speed of the law its time runs freely [m/s]."""

SMOOTHING = 1.0 / (2.0 * pi * 5.0)
"""Time constant of the speed missed: 5 Hz [s]."""

LEVEL_GAIN, LEVEL_SUM, LEVEL_CHANGE = 2.0, 1.0, 0.5
"""Acceleration over the level speed missed [1/s], over its sum [1/s²], its change."""

UPRIGHT_GAIN = 5.0
"""Acceleration over the upright speed missed [1/s]."""

TILT = radians(30.0)
"""Greatest tilt that is asked for [rad]."""

LEAN_TIMES = 0.125, 0.03
"""Time constants of leaning [s]."""

HOVER = 0.39
"""Throttle of hovering: lift over throttle is free fall over this."""

LIFT_GAIN, LIFT_SUM = 0.05 * GRAVITY / HOVER, 0.1 * GRAVITY / HOVER
"""Lift over the upright acceleration missed, and over its sum [1/s]."""

LIFT_TIME = 0.075
"""Time constant of the lift [s]."""

DRAG, DRAG_SQUARE = 0.25, 0.027
"""Deceleration over speed [1/s], and over its square [1/m]."""

INSTANT = 1e-9
"""Times that are nearer are the same [s]."""

TOGETHER = 512
"""Legs that are integrated at once; bounds the memory."""

STATES = 21
"""Numbers that describe a drone: place, speed, speed missed, its sum, its change, lean
asked for and lean, two each; place, speed, speed missed, sum and lift upright; time and
rate of the law."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Where the drones of n legs are, in steps of 20 ms from their own releases."""

    along: FloatArray
    """Ways from begin to end, show frame, shape (n, 3) [m]."""
    ways: NDArray[np.float32]
    """Ways covered since the legs' begins, shape (steps, n, 3) [m]."""
    until: FloatArray
    """Time since its release at which each drone's next leg is released, shape (n,)
    [s]; inf: it has none."""
    half_way: FloatArray
    """When each drone is half way, shape (n,) [s]."""
    ended: FloatArray
    """When the law's own time has ended, shape (n,) [s]: the next item begins."""

    @property
    def over(self) -> FloatArray:
        """Time from its release after which nothing of a leg moves, shape (n,) [s].

        The last step's, or when the next leg tells where the drone is.
        """
        return np.asarray(np.minimum(self.until, STEP * (self.ways.shape[0] - 1)))

    def places(self, since: FloatArray) -> FloatArray:
        """Ways (..., n, 3) [m] covered at ``since`` (..., n) the releases [s].

        0 before them; the whole way after the last step, and from the release of the
        next leg on, which tells where the drone is then.
        """
        last = self.ways.shape[0] - 1
        shape = np.broadcast_shapes(np.shape(since), self.until.shape)
        own = np.broadcast_to(since, shape).reshape(-1, self.until.size)
        # A leg and the one after it must not both leave out the instant between them.
        done = own >= self.over - INSTANT
        covered = done[..., None] * self.along
        flies = (own >= -INSTANT) & ~done
        # Most instants of a show are before or after all of a stage.
        row, column = np.nonzero(flies)
        place = np.maximum(own[flies], 0.0) / STEP
        before = np.minimum(place.astype(np.int64), last - 1)
        share = (place - before)[:, None]
        low, high = self.ways[before, column], self.ways[before + 1, column]
        covered[row, column] = low * (1.0 - share) + high * share
        return np.asarray(covered.reshape(*shape, 3))

    def near(self, distance: float) -> FloatArray:
        """Return when each drone is first within ``distance`` [m] of its end, (n,) [s].

        The time of the last step for one that never is.
        """
        left = np.linalg.norm(self.along - self.ways, axis=2)
        inside = left <= distance
        first = np.where(inside.any(axis=0), inside.argmax(axis=0), len(inside) - 1)
        column = np.arange(first.size)
        before = np.maximum(first - 1, 0)
        high, low = left[before, column], left[first, column]
        fall = np.where(high > low, high - low, 1.0)
        share = np.clip((high - distance) / fall, 0.0, 1.0)
        return np.asarray(STEP * (before + np.where(first > 0, share, 0.0)))


def tracks(
    flown: Sequence[tuple[float, Stage]], drones: int, parameters: Parameters
) -> list[Tracks]:
    """Return the flights along stages, released at mission times [s], in order.

    ``drones`` is the number of all drones of the fleet; they rest before.
    """
    soonest = np.full(drones, np.inf)
    untils = []
    for release, stage in reversed(flown):
        own = release + stage.wait
        untils.append(soonest[stage.drones] - own)
        soonest[stage.drones] = own
    carried = np.zeros((STATES, drones))
    carried[20] = 1.0
    found = []
    for (_, stage), until in zip(flown, reversed(untils), strict=True):
        lasting = np.minimum(until + STEP, stage.profile.duration + TAIL)
        steps = int(np.ceil(lasting.max(initial=0.0) / STEP))
        parts = []
        for begin in range(0, max(stage.drones.size, 1), TOGETHER):
            some = np.arange(begin, min(begin + TOGETHER, stage.drones.size))
            who = stage.drones[some]
            loops = _Loops(stage, some, parameters)
            part, carried[:, who] = loops.run(
                carried[:, who], until[some], max(steps, 1)
            )
            parts.append(part)
        found.append(
            Tracks(
                np.concatenate([part.along for part in parts]),
                np.concatenate([part.ways for part in parts], axis=1),
                np.concatenate([part.until for part in parts]),
                np.concatenate([part.half_way for part in parts]),
                np.concatenate([part.ended for part in parts]),
            )
        )
    return found


class _Loops:
    """The loops of n drones, and the table of their law."""

    def __init__(
        self, stage: Stage, some: NDArray[np.int64], parameters: Parameters
    ) -> None:
        self.profile = profile = stage.profile.select(some)
        self.along = stage.end[some] - stage.begin[some]
        flat = np.hypot(self.along[:, 0], self.along[:, 1])
        self.direction = (
            stage.level[some] * self.along[:, :2].T / np.where(flat > 0.0, flat, 1.0)
        )
        self.climb = stage.climb[some]
        self.late = parameters.acceleration / parameters.jerk
        times = STEP * np.arange(
            2 + int(np.ceil(profile.duration.max(initial=0.0) / STEP))
        )
        self.rows = times.size - 1
        self.column = np.arange(len(profile))
        self.table = np.stack(profile.motion(times[:, None]), axis=-1).reshape(-1, 3)

    def run(
        self, state: FloatArray, until: FloatArray, steps: int
    ) -> tuple[Tracks, FloatArray]:
        """Integrate from ``state`` (21, n), relative to the begins, over ``steps``.

        Returns the flights, and the states (21, n) at ``until`` (n,) [s], relative to
        the ends.
        """
        profile, due = self.profile, self.profile.duration
        count = len(profile)
        goal = profile.length * np.vstack([self.direction, self.climb])
        # From the autopilot's metric to the show's, which agree to a few parts in 1000.
        scale = self.along.T / np.where(goal != 0.0, goal, np.inf)
        level = np.where(np.any(scale[:2] != 0.0, axis=0), scale[:2].max(axis=0), 1.0)
        scale = np.vstack([level, level, np.where(scale[2] != 0.0, scale[2], 1.0)])
        ways = np.zeros((steps + 1, count, 3), dtype=np.float32)
        ended = np.full(count, steps * STEP)
        half_way = ended.copy()
        state = state.copy()
        state[19] = 0.0
        carried = np.zeros((STATES, count))
        carried[20] = 1.0
        handover = np.round(np.minimum(until, 1e9) / STEP).astype(np.int64)
        for step in range(steps + 1):
            if step:
                before = state
                middle = state + 0.5 * STEP * self._rates(state)
                state = state + STEP * self._rates(middle)
                _note(ended, step, before[19], state[19], due)
                _note(
                    half_way,
                    step,
                    self._covered(before),
                    self._covered(state),
                    0.5 * profile.length,
                )
            left = np.clip((due + TAIL - STEP * step) / FADE, 0.0, 1.0)
            off = left * (np.vstack([state[:2], state[14]]) - goal)
            ways[step] = self.along + (scale * off).T
            ends = handover == step
            if ends.any():
                rest = left[ends] * state[:, ends]
                rest[[0, 1, 14]] = off[:, ends]
                rest[20] = state[20, ends]
                carried[:, ends] = rest
        moves = profile.length > 0.0
        half_way, ended = np.where(moves, half_way, 0.0), np.where(moves, ended, 0.0)
        return Tracks(self.along, ways, until, half_way, ended), carried

    def _covered(self, state: FloatArray) -> FloatArray:
        """Way covered along the leg, shape (n,) [m]."""
        level = np.sum(self.direction * state[:2], axis=0)
        return np.asarray(level + self.climb * state[14])

    def _law(self, time: FloatArray) -> FloatArray:
        """Distance, speed, acceleration of the law, shape (3, n)."""
        place = np.minimum(time / STEP, float(self.rows))
        row = np.minimum(place.astype(np.int64), self.rows - 1)
        at = row * self.column.size + self.column
        low, high = self.table[at], self.table[at + self.column.size]
        return np.asarray((low + (high - low) * (place - row)[:, None]).T)

    def _rates(self, state: FloatArray) -> FloatArray:
        """Rates of change (21, n) of the ``state`` (21, n)."""
        x, v, missed, total, change, lean, push = state[:14].reshape(7, 2, -1)
        z, w, missed_up, lift_total, lift, time, rate = state[14:]
        distance, speed, acceleration = self._law(time)
        behind = self.direction * distance - x
        below = self.climb * distance - z
        keeps = self.direction * (v - behind)
        keeps = keeps[0] + keeps[1] + self.climb * (w - below)
        free = speed < STANDS
        wanted = np.where(
            free,
            1.0,
            np.minimum(
                np.maximum(SLACK_RATE + keeps / np.where(free, 1.0, speed), 0.0), 1.0
            ),
        )
        missed_rate = (behind + self.direction * speed - v - missed) / SMOOTHING
        asked = (
            LEVEL_GAIN * missed
            + LEVEL_SUM * total
            + LEVEL_CHANGE * change
            + self.direction * acceleration
        )
        most = GRAVITY * tan(TILT)
        size = np.sqrt(asked[0] * asked[0] + asked[1] * asked[1])
        over = size > most
        # Nothing is summed up towards where nothing more can be had.
        held = over & (missed[0] * asked[0] + missed[1] * asked[1] > 0.0)
        asked = asked * np.where(over, most / np.where(over, size, 1.0), 1.0)
        rise = lift - w * (DRAG + DRAG_SQUARE * np.abs(w))
        wanted_up = UPRIGHT_GAIN * missed_up + self.climb * acceleration
        drag = DRAG + DRAG_SQUARE * np.sqrt(v[0] * v[0] + v[1] * v[1])
        rates = np.empty_like(state)
        rates[:2] = v
        rates[2:4] = push * (1.0 + lift / GRAVITY) - v * drag
        rates[4:6] = missed_rate
        rates[6:8] = np.where(held, 0.0, missed)
        rates[8:10] = (missed_rate - change) / SMOOTHING
        rates[10:12] = (asked - lean) / LEAN_TIMES[0]
        rates[12:14] = (lean - push) / LEAN_TIMES[1]
        rates[14] = w
        rates[15] = rise
        rates[16] = (below + self.climb * speed - w - missed_up) / SMOOTHING
        rates[17] = LIFT_SUM * (wanted_up - rise)
        rates[18] = (LIFT_GAIN * (wanted_up - rise) + lift_total - lift) / LIFT_TIME
        rates[19] = rate
        rates[20] = (wanted - rate) / self.late
        return rates


def _note(
    moment: FloatArray,
    step: int,
    before: FloatArray,
    after: FloatArray,
    mark: FloatArray,
) -> None:
    """Put into ``moment`` (n,) [s] when values pass ``mark`` during ``step``."""
    passes = (before < mark) & (after >= mark)
    share = (mark[passes] - before[passes]) / (after[passes] - before[passes])
    # Of several times the first.
    moment[passes] = np.minimum(moment[passes], STEP * (step - 1 + share))
