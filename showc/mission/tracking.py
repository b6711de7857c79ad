"""The flight that the autopilot's loops make of a leg: late, and a little too far.

ArduCopter leads a point along the leg by the law, and lets the vehicle follow it. What
it does then is integrated here, for the default quadrotor of ArduPilot's simulation:

- The law's own time t runs at a rate r, which follows, acceleration / jerk late, how
  well the drone keeps up: 0.05 + (its speed along the leg - 1/s times its distance
  behind the point) / the law's speed, 0 to 1.
- Level: the speed asked for is the law's and 1/s times the distance to the point. The
  speed missed, smoothed over 0.032 s, asks for the acceleration of the law plus 2/s
  of it, 1/s² of its sum and 0.5 of its change, up to a tilt of 30 degrees. The vehicle
  leans to that 0.125 s and 0.03 s late, and pushes the harder the more it lifts. Drag
  takes 0.25/s times its speed and 0.027/m times its square.
- Upright: the speed missed asks for the acceleration of the law plus 5/s of it; the
  acceleration missed for a lift of 1.26 times it plus 2.5/s times its sum, which comes
  0.075 s late. Drag is the same.

The form is that of the autopilot's controllers under their default gains; the times
of lean and lift, and drag, are fitted to a transcription of those controllers that is
kept outside this repository and gives what was measured in simulation. The law is
taken from a table in steps of 20 ms, straight in between; the loops are integrated by
the midpoint rule in steps of 20 ms. What a drone is off its end is followed for 6 s
after the law's own end, and fades out over the last of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, radians, tan
from typing import TYPE_CHECKING

import numpy as np

from showc.mission.parameters import GRAVITY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.mission.law import LegProfile
    from showc.mission.parameters import Parameters

    FloatArray = NDArray[np.float64]

STEP = 0.02
"""Step of the table and of the integration [s]."""

TAIL = 6.0
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

TOGETHER = 1024
"""Legs that are integrated at once; bounds the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Where the drones of n legs are, in steps of 20 ms from their own releases."""

    level: NDArray[np.float32]
    """Part of the level way covered, shape (steps, n); above 1 beyond the end."""
    upright: NDArray[np.float32]
    """Part of the way up or down covered, likewise."""
    half_way: FloatArray
    """When each drone is half way, shape (n,) [s]."""
    ended: FloatArray
    """When the law's own time has ended, shape (n,) [s]: the next item begins."""

    @property
    def length(self) -> float:
        """Time of the last step [s]: nothing moves after it."""
        return float(STEP * (self.level.shape[0] - 1))

    def parts(self, since: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parts of the level and the upright ways at ``since`` (..., n) the releases.

        0 before them; after the last step as at the last step. Both (..., n).
        """
        last = self.level.shape[0] - 1
        place = np.clip(np.asarray(since) / STEP, 0.0, float(last))
        before = np.minimum(place.astype(np.int64), max(last - 1, 0))
        share = place - before
        column = np.arange(self.level.shape[1])
        after = np.minimum(before + 1, last)
        level, upright = (
            table[before, column] * (1.0 - share) + table[after, column] * share
            for table in (self.level, self.upright)
        )
        return np.asarray(level), np.asarray(upright)

    def places(self, since: FloatArray, along: FloatArray) -> FloatArray:
        """Ways (..., n, 3) [m] covered of ``along`` (n, 3) [m], at ``since`` (..., n).

        The third axis of ``along`` points up.
        """
        level, upright = self.parts(since)
        return np.stack([level, level, upright], axis=-1) * along

    def near(self, along: FloatArray, distance: float) -> FloatArray:
        """Return when each drone is first within ``distance`` [m] of its end, (n,) [s].

        ``along`` (n, 3) [m] is the way from begin to end, its third axis up.
        """
        flat = np.hypot(along[:, 0], along[:, 1])
        left = np.hypot((1.0 - self.level) * flat, (1.0 - self.upright) * along[:, 2])
        inside = left <= distance
        first = np.where(inside.any(axis=0), inside.argmax(axis=0), len(inside) - 1)
        column = np.arange(first.size)
        before = np.maximum(first - 1, 0)
        high, low = left[before, column], left[first, column]
        fall = np.where(high > low, high - low, 1.0)
        share = np.clip((high - distance) / fall, 0.0, 1.0)
        return np.asarray(STEP * (before + np.where(first > 0, share, 0.0)))


def tracks(
    profile: LegProfile, level: FloatArray, climb: FloatArray, parameters: Parameters
) -> Tracks:
    """Return the flights along the n legs of ``profile``.

    ``level`` (n,) and ``climb`` (n,) are the horizontal and vertical parts of their
    directions.
    """
    parts = []
    steps = int(np.ceil((profile.duration.max(initial=0.0) + TAIL) / STEP))
    for begin in range(0, max(len(profile), 1), TOGETHER):
        some = np.arange(begin, min(begin + TOGETHER, len(profile)))
        loops = _Loops(profile.select(some), level[some], climb[some], parameters)
        parts.append(loops.run(steps))
    return Tracks(
        np.concatenate([part.level for part in parts], axis=1),
        np.concatenate([part.upright for part in parts], axis=1),
        np.concatenate([part.half_way for part in parts]),
        np.concatenate([part.ended for part in parts]),
    )


class _Loops:
    """The loops of n drones, and the table of their law."""

    def __init__(
        self,
        profile: LegProfile,
        level: FloatArray,
        climb: FloatArray,
        parameters: Parameters,
    ) -> None:
        self.profile, self.level, self.climb = profile, level, climb
        self.late = parameters.acceleration / parameters.jerk
        times = (
            STEP
            * np.arange(2 + int(np.ceil(profile.duration.max(initial=0.0) / STEP)))[
                :, None
            ]
        )
        self.rows = times.shape[0] - 1
        self.column = np.arange(len(profile))
        self.table = np.stack(profile.motion(times), axis=-1).reshape(-1, 3)

    def run(self, steps: int) -> Tracks:
        """Integrate over ``steps`` steps."""
        count = len(self.profile)
        state = np.zeros((14, count))
        state[1] = 1.0
        level, upright = np.zeros((2, steps + 1, count), dtype=np.float32)
        along = self.profile.length
        ended = np.full(count, steps * STEP)
        half_way = ended.copy()
        ways = self.profile.length * np.stack([self.level, self.climb])
        ways = np.where(ways == 0.0, np.inf, ways)
        due = self.profile.duration
        for step in range(1, steps + 1):
            before = state
            middle = state + 0.5 * STEP * self._rates(state)
            state = state + STEP * self._rates(middle)
            left = np.clip((due + TAIL - STEP * step) / FADE, 0.0, 1.0)
            level[step] = 1.0 + left * (state[2] / ways[0] - 1.0)
            upright[step] = 1.0 + left * (state[9] / ways[1] - 1.0)
            _note(ended, step, before[0], state[0], due)
            _note(half_way, step, self._along(before), self._along(state), 0.5 * along)
        moves = along > 0.0
        return Tracks(
            level, upright, np.where(moves, half_way, 0.0), np.where(moves, ended, 0.0)
        )

    def _along(self, state: FloatArray) -> FloatArray:
        """Way covered along the leg, shape (n,) [m]."""
        return np.asarray(self.level * state[2] + self.climb * state[9])

    def _law(self, time: FloatArray) -> FloatArray:
        """Distance, speed, acceleration of the law, shape (3, n)."""
        place = np.minimum(time / STEP, float(self.rows))
        row = np.minimum(place.astype(np.int64), self.rows - 1)
        at = row * self.column.size + self.column
        low, high = self.table[at], self.table[at + self.column.size]
        return np.asarray((low + (high - low) * (place - row)[:, None]).T)

    def _rates(self, state: FloatArray) -> FloatArray:
        """Rates of change (14, n) of the ``state`` (14, n)."""
        time, rate, x, v, missed, total, change, lean, push = state[:9]
        z, w, missed_up, lift_total, lift = state[9:]
        distance, speed, acceleration = self._law(time)
        behind, below = self.level * distance - x, self.climb * distance - z
        keeps = self.level * (v - behind) + self.climb * (w - below)
        free = speed < STANDS
        wanted = np.where(
            free,
            1.0,
            np.clip(SLACK_RATE + keeps / np.where(free, 1.0, speed), 0.0, 1.0),
        )
        missed_rate = (behind + self.level * speed - v - missed) / SMOOTHING
        asked = (
            LEVEL_GAIN * missed
            + LEVEL_SUM * total
            + LEVEL_CHANGE * change
            + self.level * acceleration
        )
        most = GRAVITY * tan(TILT)
        # Nothing is summed up towards where nothing more can be had.
        held = (np.abs(asked) > most) & (missed * asked > 0.0)
        asked = np.clip(asked, -most, most)
        rise = lift - w * (DRAG + DRAG_SQUARE * np.abs(w))
        wanted_up = UPRIGHT_GAIN * missed_up + self.climb * acceleration
        return np.stack(
            [
                rate,
                (wanted - rate) / self.late,
                v,
                push * (1.0 + lift / GRAVITY) - v * (DRAG + DRAG_SQUARE * np.abs(v)),
                missed_rate,
                np.where(held, 0.0, missed),
                (missed_rate - change) / SMOOTHING,
                (asked - lean) / LEAN_TIMES[0],
                (lean - push) / LEAN_TIMES[1],
                w,
                rise,
                (below + self.climb * speed - w - missed_up) / SMOOTHING,
                LIFT_SUM * (wanted_up - rise),
                (LIFT_GAIN * (wanted_up - rise) + lift_total - lift) / LIFT_TIME,
            ]
        )


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
