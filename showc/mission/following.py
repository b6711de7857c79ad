"""How ArduCopter follows the leg that it has planned: late, and a little too far.

While a drone gains speed it lags, and the autopilot holds back the time of its own leg
until the drone catches up; against drag the lag grows on, and what the controller has
summed up against it carries the drone beyond the end. Upright legs need no tilt and
have no such drag: they are followed sooner. The two formulas are fitted to a model of
that cascade (position, velocity with integral, tilt, the slowed time of the leg) which
gives the delays, errors and overshoots that were measured in simulation with the
default quadrotor, on legs of 4 to 40 m up to 5 m/s: 0.15 to 0.45 s, 0.45 m beyond the
end of 30 m.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

UPRIGHT_DELAY = 0.15
"""Delay of a leg straight up or down [s]."""

LEVEL_DELAY = 0.29
"""What a long level leg adds to it [s]."""

SHORT_LEG = 0.47
"""How much less a short one adds [s], in the limit of no length."""

DECAY = 2.0
"""Time of a leg in which that is lost by the factor e [s]."""

OVERSHOOT_LEVEL, OVERSHOOT_UPRIGHT = 0.090, 0.045
"""Overshoot over cruise speed of legs that are level, or upright [s]."""

SETTLING = 1.5
"""For how long after its leg a drone may be beyond its end [s]."""


def leg_delay(level: FloatArray, duration: FloatArray) -> FloatArray:
    """Delay (n,) [s] with which the drone is where the law has its leg.

    Parameters
    ----------
    level
        Horizontal part of the legs' directions, 0 to 1, shape (n,).
    duration
        Times of the legs by the law, shape (n,) [s].
    """
    added = LEVEL_DELAY - SHORT_LEG * np.exp(-duration / DECAY)
    return np.asarray(UPRIGHT_DELAY + level**2 * added)


def leg_overshoot(level: FloatArray, speed: FloatArray) -> FloatArray:
    """How far (n,) [m] a drone may fly beyond the end of its leg.

    ``level`` (n,) is the horizontal part of the direction, ``speed`` (n,) [m/s] the
    cruise speed.
    """
    part = OVERSHOOT_UPRIGHT + (OVERSHOOT_LEVEL - OVERSHOOT_UPRIGHT) * level**2
    return np.asarray(part * speed)
