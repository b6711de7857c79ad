"""How long take-offs last, worked out anew from the words.

An autopilot raises the throttle until it notices that the drone rises, and then leads a
point to the height by limits of speed, acceleration and jerk, 400 times a second.
Nothing here is taken from the code that made the missions.
"""

from __future__ import annotations

import math
from functools import cache

from showc.verify.waypoints import MissionFormatError

LIFT_RATE = 9.80665 / 0.39 / 2.0
"""Free fall over the throttle of hovering, over the 2 s that the throttle takes from
nothing to full [m/s³]."""

JERK = 5.0
"""PSC_JERK_Z [m/s³]."""

LOOPS = 400.0
"""A second."""

LONGEST = 200.0
"""What takes longer is not followed any further [s]."""

SOONER = 0.085
"""How much sooner than from rest the climb ends that follows a take-off [s]: it begins
while the drone still rises."""


@cache
def takeoff_time(height: float, speed: float, acceleration: float) -> float:
    """Time [s] from leaving the ground until a take-off to ``height`` [m] is over.

    ``speed`` [m/s] and ``acceleration`` [m/s²] are WPNAV_SPEED_UP and WPNAV_ACCEL_Z.

    Raises
    ------
    MissionFormatError
        If it is never over with these.
    """
    if not (0.0 < speed < math.inf and 0.0 < acceleration < math.inf):
        raise MissionFormatError(
            f"nobody takes off with {speed:g} m/s and {acceleration:g} m/s²"
        )
    slow = speed / 10.0
    # It rises: by half the acceleration, or a tenth of the speed.
    begun = min(acceleration / 2.0 / LIFT_RATE, math.sqrt(2.0 * slow / LIFT_RATE))
    place, pace, push = (LIFT_RATE * begun**n / math.factorial(n) for n in (3, 2, 1))
    enough = height - slow**2 / (2.0 * acceleration)
    loops = 0
    while not (place >= enough and pace < slow) and loops < LONGEST * LOOPS:
        loops += 1
        follow = _rate(height - place, JERK / acceleration / 2.0, acceleration / 2.0)
        asked = _rate(min(follow, speed) - pace, JERK / acceleration, JERK)
        asked = math.copysign(min(abs(asked), acceleration), asked)
        change = asked - push
        push += math.copysign(min(abs(change), JERK / LOOPS), change)
        place += (pace + push / LOOPS / 2.0) / LOOPS
        pace += push / LOOPS
    return begun + loops / LOOPS


def _rate(missing: float, gain: float, limit: float) -> float:
    """Rate that takes away what is ``missing``: in proportion, or by its root."""
    far = abs(missing)
    bend = limit / gain**2
    rate = gain * far
    if far > bend:
        rate = math.sqrt(2.0 * limit * (far - bend / 2.0))
    return math.copysign(min(rate, far * LOOPS), missing)
