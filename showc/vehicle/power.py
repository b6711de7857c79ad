"""Power: what rotors take for their thrust, by momentum theory.

A rotor of disc area A with thrust T that climbs at c takes the ideal power

    T (c + v),    v = -c / 2 + sqrt(c² / 4 + T / (2 rho A))

(Leishman 2006, Principles of Helicopter Aerodynamics, 2.13); going down it is taken to
need what hovering needs. The electrical power is an idle part and the ideal power over
an efficiency, which follows from the power of hovering at sea level. All of this is a
model: hover power within some per cent where it was measured, an estimate elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.vehicle.motion import thrust_direction

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.vehicle.quadrotor import Quadrotor

SEA_LEVEL = 1.225
"""Density of the standard atmosphere at sea level [kg/m³]."""


@dataclass(frozen=True, slots=True)
class Battery:
    """What an aircraft flies on."""

    capacity: float
    """Charge when full [C]."""
    voltage: float
    """Open-circuit voltage when full [V]."""
    voltage_min: float
    """Least voltage under load [V]."""
    resistance: float
    """Of battery, wiring and regulators [ohm]."""
    usable: float
    """Part of the capacity that may be taken, 0 to 1."""
    reserve: float
    """Part of the capacity that must be left of the usable one, 0 to 1."""
    hover_power: float
    """Electrical power of hovering [W]."""
    idle_power: float
    """Part of it that does not depend on thrust [W]."""
    rotor_radius: float
    """[m]."""

    @property
    def allowed(self) -> float:
        """Part of the capacity that a flight with its abort may take."""
        return self.usable - self.reserve


def air_density(altitude: float) -> float:
    """Density of the standard atmosphere up to 11 km [kg/m³].

    ISO 2533: temperature falls by 6.5 K/km from 288.15 K; ``altitude`` above sea level
    [m].
    """
    return float(SEA_LEVEL * (1.0 - 2.25577e-5 * altitude) ** 4.25588)


@dataclass(frozen=True, slots=True)
class Power:
    """What rotors take."""

    idle: float
    """Power without thrust [W]."""
    efficiency: float
    """Ideal power over the electrical power beyond the idle one."""
    disc: float
    """Area of one rotor's disc [m²]."""
    density: float = SEA_LEVEL
    """Of the air [kg/m³]."""

    @classmethod
    def of(cls, battery: Battery, vehicle: Quadrotor, altitude: float = 0.0) -> Power:
        """Fit the efficiency to the hover power; fly at an ``altitude`` [m]."""
        disc = float(np.pi * battery.rotor_radius**2)
        quarter = vehicle.hover_thrust / 4.0
        ideal = 4.0 * quarter**1.5 / np.sqrt(2.0 * SEA_LEVEL * disc)
        return cls(
            battery.idle_power,
            float(ideal / (battery.hover_power - battery.idle_power)),
            disc,
            air_density(altitude),
        )

    def __call__(self, thrust: FloatArray, climb: FloatArray) -> FloatArray:
        """Electrical power [W].

        Parameters
        ----------
        thrust
            Of each rotor, shape (..., 4) [N].
        climb
            Velocity along the rotors' axis, shape (...) [m/s].
        """
        pull, rise = np.maximum(thrust, 0.0), np.maximum(climb, 0.0)[..., None]
        flow = 0.5 * rise + np.sqrt(
            0.25 * rise**2 + pull / (2.0 * self.density * self.disc)
        )
        return np.asarray(self.idle + np.sum(pull * flow, axis=-1) / self.efficiency)

    def hover(self, vehicle: Quadrotor) -> float:
        """Power of hovering [W]."""
        return float(self(np.full(4, vehicle.hover_thrust / 4.0), np.zeros(())))

    def flown(
        self, vehicle: Quadrotor, state: FloatArray, control: FloatArray
    ) -> FloatArray:
        """Electrical power of states (..., 12) and controls U1..U4 (..., 4) [W]."""
        up = np.stack(
            thrust_direction(state[..., 6], state[..., 7], state[..., 8]), axis=-1
        )
        climb = np.sum(up * state[..., 3:6], axis=-1)
        return self(rotor_thrusts(vehicle, control), climb)


def rotor_thrusts(vehicle: Quadrotor, control: FloatArray) -> FloatArray:
    """Thrust of each rotor, shape (..., 4) [N], of controls U1..U4 (..., 4)."""
    most = vehicle.thrust_coefficient * vehicle.rotor_speed_max**2
    return np.asarray(control @ vehicle.rotor_fractions().T * most)
