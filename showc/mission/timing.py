"""When an autopilot flies its leg after the clock says so, and how surely."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Timing:
    """What is not known about when and how far a drone flies its leg."""

    spread: float = 0.20
    """Half the width of the interval in which each drone's delay lies, about the delay
    of its leg [s]; infinite: the leg may be anywhere at any time."""
    overshoots: bool = True
    """Whether drones may be beyond the end of their leg by its overshoot."""


CLOCKED = Timing()
"""Legs released by the vehicle's UTC clock, as measured on ArduCopter 4.6."""

EXACT = Timing(0.0, overshoots=False)
"""Every leg is flown as the law says, late by its delay."""

ANYTIME = Timing(float("inf"), overshoots=False)
"""Nothing is known about when the leg is flown."""

CLOCK_LAG = 0.17
"""The vehicles' clocks are late by up to this, all alike [s]: simulated receivers cut
their time to 0.2 s, real ones report it when it has passed."""

SPIN_UP = 2.25
"""Time on the ground between the start of a mission and lift-off [s]: 2.0 to 2.5."""
