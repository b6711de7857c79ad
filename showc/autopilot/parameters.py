"""The autopilot parameters a mission depends on, and the file that carries them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import floor, pi, radians, tan
from typing import TYPE_CHECKING, Self

from showc.vehicle import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.script.show import Show

FIRMWARE = "ArduCopter 4.6"
"""The firmware whose parameter names, units and leg law these are."""

AIRFRAME = "ArduCopter 4.6's own simulated quadrotor"
"""Whose gains these are."""

LAND_SLOW_HEIGHT = 4.0
"""Below this ArduCopter lands slowly [m]: its height may be wrong by as much, less the
last metre. By default it would be 10 m, at half a metre a second."""

LAND_SLOW_SPEED = 0.5
"""How slowly [m/s]: ArduCopter's default of LAND_SPEED."""


GAINS: dict[str, float] = {
    "ANGLE_MAX": 3000.0,
    "PSC_JERK_Z": 5.0,
    "PSC_POSXY_P": 1.0,
    "PSC_POSZ_P": 1.0,
    "PSC_VELXY_D": 0.25,
    "PSC_VELXY_FF": 0.0,
    "PSC_VELXY_I": 1.0,
    "PSC_VELXY_P": 2.0,
    "PSC_VELZ_P": 5.0,
}
"""Gains with which missions were flown, in ArduPilot's units: its own defaults.

Those of the envelope follow more closely, and are wrong here: a leg's time stands still
while the drone swings back over its end. Of 24 legs flown with them three ended 5 to 10
s late, beyond their slots."""


@dataclass(frozen=True, slots=True)
class Gains:
    """How hard the autopilot corrects what its vehicle misses, in SI."""

    place: float
    """Level speed over the distance missed: PSC_POSXY_P [1/s]."""
    speed: float
    """Level acceleration over the speed missed: PSC_VELXY_P [1/s]."""
    total: float
    """The same over its sum: PSC_VELXY_I [1/s²]."""
    change: float
    """The same over its change: PSC_VELXY_D."""
    forward: float
    """Level acceleration over the speed asked for, against drag: PSC_VELXY_FF [1/s]."""
    height: float
    """Upright speed over the height missed: PSC_POSZ_P [1/s]."""
    climb: float
    """Upright acceleration over the speed missed: PSC_VELZ_P [1/s]."""
    lean: float
    """Steepest lean: ANGLE_MAX [rad]."""

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Self:
        """Return the gains among ``values`` by name, in ArduPilot's units."""
        return cls(
            values["PSC_POSXY_P"],
            values["PSC_VELXY_P"],
            values["PSC_VELXY_I"],
            values["PSC_VELXY_D"],
            values["PSC_VELXY_FF"],
            values["PSC_POSZ_P"],
            values["PSC_VELZ_P"],
            radians(values["ANGLE_MAX"] / 100.0),
        )


MEASURED = Gains.of(GAINS)
"""The same in SI."""


WINDY_SPEED = 2.7
"""Greatest horizontal speed of a leg in wind [m/s]: against 5 m/s of it drones come
0.25 s behind while they gain speed, besides what clocks are late by, and stay so. At
4.1 m/s that was 1.58 m on a leg of 130 m; asked for is 1 m."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """What the leg law of ArduCopter takes from the vehicle, in SI.

    The defaults are those under which synchronised legs were measured.
    """

    speed: float = 8.0
    """Greatest horizontal speed of a leg [m/s]: the law was held against flights up
    to here."""
    cruise_speed: float = 10.0
    """WPNAV_SPEED [m/s], until a mission sets another."""
    speed_up: float = 4.0
    """Greatest climb speed of a leg [m/s]."""
    climb_speed: float = 4.0
    """WPNAV_SPEED_UP [m/s], of take-off and climb: an autopilot whose parameters were
    loaded since it was built takes its vertical speeds from them once more when it
    first flies to a waypoint, whatever its mission has said before."""
    speed_down: float = 3.0
    """WPNAV_SPEED_DN [m/s]."""
    acceleration: float = 3.5
    """WPNAV_ACCEL [m/s²]."""
    acceleration_vertical: float = 2.5
    """WPNAV_ACCEL_Z [m/s²]."""
    jerk: float = 20.0
    """WPNAV_JERK [m/s³]."""
    input_time_constant: float = 0.15
    """ATC_INPUT_TC [s]."""
    angular_acceleration: float = 1100.0
    """ATC_ACCEL_R_MAX and ATC_ACCEL_P_MAX [deg/s²]."""
    descent_speed: float = 1.0
    """LAND_SPEED_HIGH [m/s]: when a landing begins is known to half a second."""
    gains: Gains = MEASURED
    """How hard it corrects."""

    @property
    def snap(self) -> float:
        """Greatest rate of change of the jerk that the law allows [m/s⁴]."""
        by_attitude = self.angular_acceleration * pi / 180.0 * STANDARD_GRAVITY
        by_input = pi * self.jerk / (2.0 * max(self.input_time_constant, 0.1))
        return 0.5 * min(by_input, by_attitude)


def parameters_for(show: Show) -> Parameters:
    """Return the measured set, lowered where the show's limits are stricter.

    Acceleration stays below what the tilt limit gives, on whole cm/s² as the
    parameter file stores it.
    """
    measured = Parameters()
    up = min(measured.speed_up, show.limits.velocity_max[2])
    tilt = floor(100.0 * STANDARD_GRAVITY * tan(show.limits.tilt)) / 100.0
    return replace(
        measured,
        speed=WINDY_SPEED if show.site.wind else measured.speed,
        acceleration=max(0.5, min(measured.acceleration, tilt)),
        speed_up=_on_grid(up),
        climb_speed=_on_grid(min(up, show.launch.climb_speed)),
        speed_down=_on_grid(min(measured.speed_down, -show.limits.velocity_min[2])),
        descent_speed=_on_grid(min(measured.descent_speed, show.landing.descent_speed)),
    )


def _on_grid(speed: float) -> float:
    """Round a speed down to whole cm/s [m/s], never below what ArduPilot heeds."""
    return max(0.1, floor(speed * 100.0 + 1e-9) / 100.0)


def parameter_file(parameters: Parameters) -> bytes:
    """Return the ``.parm`` file to load onto every vehicle before the missions."""
    centi = {
        "WPNAV_SPEED": parameters.cruise_speed,
        "WPNAV_SPEED_UP": parameters.climb_speed,
        "WPNAV_SPEED_DN": parameters.speed_down,
        "WPNAV_ACCEL": parameters.acceleration,
        "WPNAV_ACCEL_Z": parameters.acceleration_vertical,
        "LAND_SPEED_HIGH": parameters.descent_speed,
        "LAND_SPEED": LAND_SLOW_SPEED,
        "LAND_ALT_LOW": LAND_SLOW_HEIGHT,
    }
    plain = {
        "WPNAV_JERK": parameters.jerk,
        "WPNAV_ACCEL_C": 0.0,
        "PSC_JERK_XY": 20.0,
        **GAINS,
        "ATC_INPUT_TC": parameters.input_time_constant,
        "ATC_ACCEL_R_MAX": 100.0 * parameters.angular_acceleration,
        "ATC_ACCEL_P_MAX": 100.0 * parameters.angular_acceleration,
        # Limits of the rates would lower the jerk.
        "ATC_RATE_R_MAX": 0.0,
        "ATC_RATE_P_MAX": 0.0,
        "WP_YAW_BEHAVIOR": 0.0,
    }
    values = {name: round(100.0 * value) for name, value in centi.items()} | plain
    lines = [
        f"# Parameters of {FIRMWARE} that the missions beside this file depend on.",
        "# Names, units and the law of a leg differ between versions: load this file",
        "# onto that firmware only, and before the missions.",
        f"# Gains of PSC_ are those of {AIRFRAME}: carry over the",
        "# rest, and tune yours until it follows as well.",
        *(f"{name},{values[name]:g}" for name in sorted(values)),
    ]
    return ("\n".join(lines) + "\n").encode("ascii")
