"""The battery, and what the rotors take from it."""

from __future__ import annotations

from dataclasses import dataclass


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
