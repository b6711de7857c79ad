"""How ArduCopter follows the leg that it has planned: late, and a little too far.

The bound that slots and proofs are worked out with; :mod:`showc.autopilot.tracking` has
the flights themselves. While a drone gains speed it lags, and the autopilot holds back
the time of its own leg until the drone catches up; against drag the lag grows on, and
what the controller has summed up against it carries the drone beyond the end. Upright
legs need no tilt and have little drag: they are followed sooner. So, t after the
release, a drone is, give or take 0.2 s, where the law has its leg at the time
t - delay(t), with

    delay(t) = 0.16 s + level² (0.28 s - 0.44 s exp(-t / 1.33 s)),

level being the horizontal part of the direction. Measured in simulation with the
default quadrotor, on legs of 4 to 40 m up to 5 m/s: 0.15 to 0.45 s late, 0.45 m beyond
the end of 30 m. Flights leave that by at most 0.1 m + 0.05 s of their speed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray


UPRIGHT_DELAY = 0.16
"""Delay of a leg straight up or down [s]."""

LEVEL_DELAY = 0.28
"""What a level one adds to it in the end [s]."""

EARLY = 0.44
"""How much less it adds at the release [s]."""

GROWTH = 1.33
"""Time in which that is lost by the factor e [s]."""

SLOWEST = 1.0 - EARLY / GROWTH
"""The delay grows, and so the law's time runs at this rate at least."""

OVERSHOOT_LEVEL, OVERSHOOT_UPRIGHT = 0.090, 0.045
"""Overshoot over cruise speed of legs that are level, or upright [s]."""

SETTLING = 1.5
"""For how long after its leg a drone may be beyond its end [s]."""


def law_time(level: FloatArray, since: FloatArray) -> FloatArray:
    """Time of the law's leg at which a drone is now.

    Parameters
    ----------
    level
        Horizontal part of the legs' directions, 0 to 1, shape (n,).
    since
        Time since the release, shape (..., n) [s]. The result grows with it.
    """
    missing = EARLY * np.exp(-np.maximum(since, 0.0) / GROWTH)
    return np.asarray(since - UPRIGHT_DELAY - level**2 * (LEVEL_DELAY - missing))


def time_followed(level: FloatArray, duration: FloatArray) -> FloatArray:
    """Time since the release at which a drone is where the law is at ``duration``.

    The inverse of :func:`law_time`, by Newton's method; both of shape (n,) [s].
    """
    since, square = duration + UPRIGHT_DELAY, level**2
    for _ in range(6):
        # As law_time has it, with one exponential for value and slope.
        missing = EARLY * np.exp(-np.maximum(since, 0.0) / GROWTH)
        now = since - UPRIGHT_DELAY - square * (LEVEL_DELAY - missing)
        slope = 1.0 - square * np.where(since > 0.0, missing / GROWTH, 0.0)
        since = since - (now - duration) / slope
    return np.asarray(since)


def leg_overshoot(level: FloatArray, speed: FloatArray) -> FloatArray:
    """How far (n,) [m] a drone may fly beyond the end of its leg.

    ``level`` (n,) is the horizontal part of the direction, ``speed`` (n,) [m/s] the
    cruise speed.
    """
    part = OVERSHOOT_UPRIGHT + (OVERSHOOT_LEVEL - OVERSHOOT_UPRIGHT) * level**2
    return np.asarray(part * speed)
