"""When an autopilot starts its leg after the clock says so, and how surely."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Timing:
    """Delay of the flown leg behind the nominal one, as an interval [s]."""

    delay: float = 0.35
    """Middle of the interval: how far ArduCopter flies behind its own leg law."""
    spread: float = 0.20
    """Half its width."""

    @property
    def low(self) -> float:
        """Least delay [s]."""
        return self.delay - self.spread

    @property
    def high(self) -> float:
        """Greatest delay [s]."""
        return self.delay + self.spread


CLOCKED = Timing()
"""Legs released by the vehicle's UTC clock, as measured on ArduCopter 4.6."""

SPIN_UP = 2.5
"""Time on the ground between the start of a mission and lift-off [s]."""

TAKEOFF_SPREAD = 0.5
"""Take-off is not timed better than this [s]."""

ARRIVAL_SPREAD = 0.3
"""What every leg adds to the uncertainty when no clock starts the next one [s]."""
