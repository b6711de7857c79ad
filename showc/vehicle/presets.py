"""Known aircraft: physical parameters and the limits they are flown with."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, radians, sqrt
from types import MappingProxyType
from typing import TYPE_CHECKING

from showc.vehicle.limits import Envelope, Limits
from showc.vehicle.power import Battery
from showc.vehicle.quadrotor import Body, Quadrotor

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class Preset:
    """An aircraft and the limits it is flown with unless a script says otherwise."""

    description: str
    """One line for people: what it is and where its numbers come from."""
    vehicle: Quadrotor
    """Its physical parameters."""
    limits: Limits
    """Its limits; the flight volume is unbounded, the site sets it."""
    body: Body
    """Its size and drag as it falls; the drag is an estimate."""
    battery: Battery
    """What it flies on."""
    envelope: Envelope | None = None
    """What its autopilot follows; None: not measured."""


_UNBOUNDED = ((-inf, -inf, -inf), (inf, inf, inf))

# Five shows flown with these gains in ArduCopter 4.6's own simulation, positions,
# velocities and accelerations sent at 20 Hz, up to 8 m/s level and 4.2 m/s²: errors of
# at most 0.38 m. Eleven shows with VELXY_P 4 and FF 0.2 at 50 Hz: at most 0.3 m level
# and 0.25 m in height up to the values below, growing beyond them.
ARDUCOPTER = Envelope(
    level_speed=8.0,
    acceleration=4.2,
    acceleration_up=3.0,
    acceleration_down=3.8,
    airframe="ArduCopter 4.6.2's simulated default quadrotor, within 0.3 m in calm air",
    parameters=(
        ("WPNAV_ACCEL", 500.0),
        ("WPNAV_ACCEL_Z", 500.0),
        ("WPNAV_SPEED", 1500.0),
        ("WPNAV_SPEED_UP", 500.0),
        ("WPNAV_SPEED_DN", 500.0),
        ("PSC_JERK_XY", 50.0),
        ("PSC_JERK_Z", 50.0),
        ("ATC_ACCEL_P_MAX", 260000.0),
        ("ATC_ACCEL_R_MAX", 260000.0),
        ("ATC_INPUT_TC", 0.1),
        ("ANGLE_MAX", 4500.0),
        ("PSC_POSXY_P", 1.5),
        ("PSC_VELXY_P", 5.0),
        ("PSC_VELXY_I", 2.0),
        ("PSC_VELXY_FF", 0.25),
        ("PSC_POSZ_P", 1.5),
        ("PSC_VELZ_P", 8.0),
    ),
)
"""What ArduCopter follows, and its parameters in its own units."""

FORMATION = Preset(
    "625 g quadrotor of the literature on formation flight, with the limits printed "
    "there: 5 m/s per axis, 20 deg, 1.7 rad/s",
    Quadrotor(
        name="formation-625g",
        mass=0.625,
        arm_length=0.1275,
        thrust_coefficient=2.103e-6,
        torque_coefficient=2.091e-8,
        inertia=(2.3e-3, 2.4e-3, 2.6e-3),
        # 4 kF w² is the printed greatest thrust of 21.03 N.
        rotor_speed_max=sqrt(2.5e6),
    ),
    Limits(
        velocity_min=(-5.0, -5.0, -5.0),
        velocity_max=(5.0, 5.0, 5.0),
        tilt=radians(20.0),
        body_rate=(1.7, 1.7, 1.7),
        thrust_min=0.0,
        thrust_max=21.03,
        torque_max=(0.67, 0.67, 0.105),
        position_min=_UNBOUNDED[0],
        position_max=_UNBOUNDED[1],
    ),
    # Motors 0.255 m apart across the frame, with propellers of 6 in, the greatest that
    # pass each other. A flat plate's coefficient of 1 and 0.03 m², within a third.
    Body(size=0.41, drag_area=(0.02, 0.04)),
    # Nothing of this was measured: three cells of 2200 mAh, the ideal power of 36 W on
    # propellers of 6 in at half of it as losses, and 25 mohm for pack and regulators.
    Battery(
        capacity=2200.0 * 3.6,
        voltage=12.6,
        voltage_min=9.9,
        resistance=0.025,
        usable=0.8,
        reserve=0.1,
        hover_power=72.0,
        idle_power=4.0,
        rotor_radius=0.0762,
    ),
    ARDUCOPTER,
)

CRAZYFLIE = Preset(
    "28 g Crazyflie 2.x (Foerster 2015, System identification of the Crazyflie 2.0), "
    "1.5 m/s per axis for indoor shows",
    Quadrotor(
        name="crazyflie-28g",
        mass=0.028,
        # The motors stand on the diagonals; 46 mm is the arm, its projection on the
        # body axes the lever of the allocation.
        arm_length=0.046 / sqrt(2.0),
        thrust_coefficient=2.88e-8,
        torque_coefficient=7.24e-10,
        inertia=(1.395e-5, 1.436e-5, 2.173e-5),
        rotor_speed_max=2272.0,
    ),
    Limits(
        velocity_min=(-1.5, -1.5, -1.0),
        velocity_max=(1.5, 1.5, 1.5),
        tilt=radians(20.0),
        body_rate=(3.0, 3.0, 3.0),
        thrust_min=0.0,
        thrust_max=4.0 * 2.88e-8 * 2272.0**2,
        torque_max=(
            2.88e-8 * 0.046 / sqrt(2.0) * 2272.0**2,
            2.88e-8 * 0.046 / sqrt(2.0) * 2272.0**2,
            2.0 * 7.24e-10 * 2272.0**2,
        ),
        position_min=_UNBOUNDED[0],
        position_max=_UNBOUNDED[1],
    ),
    # Motors 92 mm apart, propellers of 46 mm; frame, battery and propeller discs show
    # 30 cm² edge-on and 80 cm² flat.
    Body(size=0.138, drag_area=(0.003, 0.008)),
    # Bitcraze's table of thrust, current and voltage (wiki, misc:investigations:thrust)
    # over 0 to 33 g: 2.07 W and 4.99 times the ideal power on rotors of 23.1 mm; the
    # terminal voltage falls by 0.175 V for an ampere.
    Battery(
        capacity=250.0 * 3.6,
        voltage=4.2,
        voltage_min=3.0,
        resistance=0.175,
        usable=0.9,
        reserve=0.1,
        hover_power=7.6,
        idle_power=2.07,
        rotor_radius=0.0231,
    ),
)

PRESETS: Mapping[str, Preset] = MappingProxyType(
    {preset.vehicle.name: preset for preset in (FORMATION, CRAZYFLIE)}
)
"""All presets by name."""

DEFAULT_PRESET = FORMATION.vehicle.name
"""What flies when a script names nothing else."""
