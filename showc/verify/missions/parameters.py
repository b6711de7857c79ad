"""The autopilot parameters under which missions are flown as they are proved."""

from __future__ import annotations

from math import floor, tan
from typing import TYPE_CHECKING

from showc.verify.missions.law import GRAVITY

if TYPE_CHECKING:
    from showc.script.show import Show

FIRMWARE = "ArduCopter 4.6"
"""The firmware whose parameter names, units and leg law are known."""

AIRFRAME = "ArduCopter 4.6's own simulated quadrotor"
"""The airframe whose gains are known."""

PARAMETERS = "missions/ardupilot.parm"
"""Name of the file."""


def parameters(show: Show) -> dict[str, str]:
    """Parameters under which the leg law holds, within the limits of a script's show.

    Accelerations and speeds are in cm/s² and cm/s: the measured ones, or less where
    tilt and velocities of the show allow no more.
    """
    limits = show.limits
    values = {
        "ANGLE_MAX": 3000,
        "ATC_ACCEL_P_MAX": 110000,
        "ATC_ACCEL_R_MAX": 110000,
        "ATC_INPUT_TC": 0.15,
        "ATC_RATE_P_MAX": 0,
        "ATC_RATE_R_MAX": 0,
        "LAND_ALT_LOW": 400,
        "LAND_SPEED": 50,
        "LAND_SPEED_HIGH": _heeded(3.0, show.landing.descent_speed),
        "PSC_JERK_XY": 20,
        "PSC_JERK_Z": 5,
        "PSC_POSXY_P": 1,
        "PSC_POSZ_P": 1,
        "PSC_VELXY_D": 0.25,
        "PSC_VELXY_FF": 0,
        "PSC_VELXY_I": 1,
        "PSC_VELXY_P": 2,
        "PSC_VELZ_P": 5,
        "WPNAV_ACCEL": max(50, min(350, floor(100.0 * GRAVITY * tan(limits.tilt)))),
        "WPNAV_ACCEL_C": 0,
        "WPNAV_ACCEL_Z": 250,
        "WPNAV_JERK": 20,
        "WPNAV_SPEED": 1000,
        "WPNAV_SPEED_DN": _heeded(3.0, -limits.velocity_min[2]),
        "WPNAV_SPEED_UP": _heeded(4.0, limits.velocity_max[2]),
        "WP_YAW_BEHAVIOR": 0,
    }
    return {name: f"{value:g}" for name, value in values.items()}


def _heeded(measured: float, allowed: float) -> int:
    """Speed [cm/s]: the measured one, or what is allowed; none below 10 is heeded."""
    return max(10, floor(100.0 * min(measured, allowed) + 1e-7))


def parameter_file(show: Show) -> bytes:
    """Return the bytes that ``ardupilot.parm`` must have."""
    lines = [
        f"# Parameters of {FIRMWARE} that the missions beside this file depend on.",
        "# Names, units and the law of a leg differ between versions: load this file",
        "# onto that firmware only, and before the missions.",
        f"# Gains of PSC_ are those of {AIRFRAME}: carry over the",
        "# rest, and tune yours until it follows as well.",
        *(f"{name},{value}" for name, value in sorted(parameters(show).items())),
    ]
    return ("\n".join(lines) + "\n").encode("ascii")
