"""When an autopilot flies its leg after the clock says so, and how surely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import ExportError

if TYPE_CHECKING:
    from showc.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Measured:
    """How far off its predicted flight a drone was flown, in one wind."""

    wind: float
    """Up to this wind [m/s]."""
    bands: tuple[tuple[float, float], ...]
    """Legs up to a speed [m/s], and the greatest distance on them [m]."""
    late: float
    """Latest arrival after the predicted one on legs up to 5.2 m/s [s]."""
    late_fast: float
    """The same on faster ones [s]."""


TUBES = (
    Measured(0.0, ((5.0, 0.79), (6.5, 1.10), (8.7, 1.82)), 0.21, 0.21),
    Measured(5.0, ((5.0, 0.91), (8.7, 3.34)), 0.70, 0.70),
    Measured(8.0, ((5.0, 2.62), (8.7, 8.74)), 2.19, 5.66),
)
"""Measured on ArduCopter 4.6.2's own simulation, default quadrotor, 759 legs on the
clock in calm air, and 15 flights of fleets in wind."""

BRISK = 5.2
"""Fastest leg of the flights by which slower ones are judged in wind [m/s]."""

LEAST_SPREAD = 0.20
"""Half the width of the interval of delays, where less was measured: legs of one speed
differ by as much [s]."""


def tube(wind: float) -> Measured:
    """Return what was measured in a wind of ``wind`` [m/s], or the next stronger one.

    Raises
    ------
    ExportError
        If none was so strong.
    """
    for row in TUBES:
        if wind <= row.wind:
            return row
    raise ExportError(
        f"site.wind is {wind:g} m/s, and how missions are flown in more than "
        f"{TUBES[-1].wind:g} m/s was not measured; state less wind"
    )


@dataclass(frozen=True, slots=True)
class Timing:
    """What is not known about when and how far a drone flies its leg."""

    fixed: float | None = None
    """Half the width of the interval in which each drone's delay lies, about the delay
    of its leg [s]; infinite: the leg may be anywhere at any time; None: as measured."""
    wind: float = 0.0
    """In which that was measured [m/s]."""
    overshoots: bool = True
    """Whether drones may be beyond the end of their leg by its overshoot."""

    def spread(self, speed: FloatArray) -> FloatArray:
        """Half the width of each drone's interval of delays (n,) [s].

        ``speed`` (n,) [m/s] is the cruise speed of each one's leg: the measured width
        of the tube, over the speed at which it was measured.
        """
        if self.fixed is not None:
            return np.full(speed.shape, self.fixed)
        bands = tube(self.wind).bands
        found = np.full(speed.shape, bands[-1][1] / bands[-1][0])
        for top, width in reversed(bands[:-1]):
            found = np.where(speed <= top, width / top, found)
        return np.asarray(np.maximum(found, LEAST_SPREAD))

    def late(self, speed: FloatArray) -> FloatArray:
        """By how much each drone may arrive late, (n,) [s]; at least the spread."""
        row = tube(self.wind)
        late = np.where(speed <= BRISK, row.late, row.late_fast)
        return np.asarray(np.maximum(late, self.spread(speed)))


EXACT = Timing(0.0, overshoots=False)
"""Every leg is flown as the law says, late by its delay."""

ANYTIME = Timing(float("inf"), overshoots=False)
"""Nothing is known about when the leg is flown."""

CLOCK_LAG = 0.17
"""The vehicles' clocks are late by up to this, all alike [s]: simulated receivers cut
their time to 0.2 s, real ones report it when it has passed."""

ARMED = 2.33
"""A vehicle must have been armed for so long when its mission starts, else it lifts off
later [s]: ``ARMING_DELAY_SEC`` is 2.0 s, and the throttle is raised after it."""

ARMED_IN_TIME = (
    f"arm every vehicle at least {ARMED:g} s before its mission starts, within 10 s: "
    "else it lifts off late, or disarms"
)
"""What an operator must know of arming: it disarms after ``DISARM_DELAY``, 10 s."""

LIFT_OFF = 0.90
"""Time from the start of a mission to lift-off, once armed for that long [s]: take-offs
to 2.5 m took 3.49 to 3.50 s, of which 2.59 s in the air."""
