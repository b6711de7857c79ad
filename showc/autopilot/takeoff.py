"""How an autopilot takes off: it follows no law of legs.

While the drone stands on the ground, ArduCopter raises the throttle, from nothing to
full within TKOFF_SLEW_TIME, until it notices that the drone rises: by half the greatest
upright acceleration, or a tenth of the greatest speed up. From then on it leads a point
to the height asked for, by limits of speed, acceleration and jerk (its
``shape_pos_vel_accel``), 400 times a second. It ends the take-off when that is nearly
there and slower than a tenth of the greatest speed up. It rises by a metre at least,
whatever is asked for.
"""

from __future__ import annotations

from functools import cache
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.controller import HOVER
from showc.autopilot.parameters import GAINS
from showc.vehicle import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.autopilot.parameters import Parameters


SLEW_TIME = 2.0
"""TKOFF_SLEW_TIME [s]: ArduCopter's default; missions leave it."""

JERK = GAINS["PSC_JERK_Z"]
"""Greatest upright jerk [m/s³]."""

LOOP = 1.0 / 400.0
"""Time of a loop of the autopilot [s]: SCHED_LOOP_RATE is 400 Hz by default."""

LEAST_HEIGHT = 1.0
"""To what height ArduCopter takes off at least, above where it stands [m]."""

TENTH = 0.1
"""Part of the greatest speed up at which a take-off is noticed, and over."""


def takeoff_times(heights: Sequence[int], parameters: Parameters) -> FloatArray:
    """Return how long after leaving the ground take-offs are over.

    ``heights`` (n,) [cm] above the ground; the result (n,) [s]. Against a transcription
    of the autopilot's controllers it is right to 0.005 s.
    """
    return np.array([_takeoff(height, parameters)[0][-1] for height in heights])


def takeoff_risen(
    heights: Sequence[int], parameters: Parameters, since: FloatArray
) -> FloatArray:
    """Return which part of its height each drone has risen, shape (m, n), 0 to 1.

    Parameters
    ----------
    heights
        At which the take-offs end, above the ground, shape (n,) [cm].
    since
        Time since the drones left the ground, shape (m, n) [s].
    """
    parts = []
    for height, own in zip(heights, since.T, strict=True):
        times, risen = _takeoff(height, parameters)
        # It is over a little below or above its end, where the next leg begins.
        parts.append(np.interp(own, times, risen / risen[-1]))
    return np.array(parts).T


@cache
def _takeoff(height: int, parameters: Parameters) -> tuple[FloatArray, FloatArray]:
    """Return times since leaving the ground [s], and how far the point rose [m]."""
    goal, speed = 0.01 * height, parameters.climb_speed
    acceleration = parameters.acceleration_vertical
    rate = STANDARD_GRAVITY / HOVER / SLEW_TIME
    noticed = min(0.5 * acceleration / rate, sqrt(2.0 * TENTH * speed / rate))
    time, pushed = noticed, rate * noticed
    risen, rising = rate * noticed**3 / 6.0, rate * noticed**2 / 2.0
    near = goal - 0.5 * (TENTH * speed) ** 2 / acceleration
    gain = JERK / acceleration
    times, ways = [0.0, time], [0.0, risen]
    while risen < near or rising >= TENTH * speed:
        wanted = min(_approach(goal - risen, 0.5 * gain, 0.5 * acceleration), speed)
        push = _approach(wanted - rising, gain, JERK)
        push = min(max(push, -acceleration), acceleration)
        pushed += min(max(push - pushed, -JERK * LOOP), JERK * LOOP)
        risen += rising * LOOP + 0.5 * pushed * LOOP**2
        rising += pushed * LOOP
        time += LOOP
        times.append(time)
        ways.append(risen)
    return np.array(times), np.array(ways)


def _approach(error: float, gain: float, limit: float) -> float:
    """Rate at which an ``error`` is taken away, so that it changes within ``limit``.

    ArduPilot's ``sqrt_controller``: ``gain`` times the error, less for large ones.
    """
    size, linear = abs(error), limit / gain**2
    rate = gain * size if size <= linear else sqrt(2.0 * limit * (size - 0.5 * linear))
    rate = min(rate, size / LOOP)
    return rate if error > 0.0 else -rate
