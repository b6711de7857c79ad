"""Where drones may be during pieces of a stretch of time, and how fast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.missions.law import SETTLING

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.verify.missions.law import Profiles
    from showc.verify.missions.stretches import Stretch


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """All drones in a stretch of time."""

    stretch: Stretch
    """What they fly."""
    flights: Profiles
    """The table of all legs."""

    def places(
        self, drone: IntArray, part: FloatArray, width: float, length: float
    ) -> tuple[FloatArray, FloatArray]:
        """Rearmost and foremost places, each (3, m) [m].

        Of drones ``drone`` (m,) during ``length`` [s] from ``part`` (m,) times
        ``width`` [s] after the stretch's begin.
        """
        leg = self.stretch.leg[drone]
        late, early = self._law_times(drone, part * width, length)
        rear, _ = self.flights.fraction(leg, late)
        front, _ = self.flights.fraction(leg, early)
        moving = late < self.flights.duration[leg] + SETTLING
        front *= np.where(moving, self.flights.excess[leg], 1.0)
        begin, along = self.stretch.begin.T[:, drone], self.stretch.along.T[:, drone]
        return begin + rear * along, begin + front * along

    def rates(
        self, drone: IntArray, part: FloatArray, width: float
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Least and greatest rates (m,) [1/s] at which they cover their legs.

        Of drones ``drone`` (m,) during ``width`` [s] from ``part`` (m,) times that
        after the stretch's begin; and whether each settles before the middle.
        """
        leg = self.stretch.leg[drone]
        late, early = self._law_times(drone, part * width, width)
        middle, _ = self._law_times(drone, (part + 0.5) * width, 0.0)
        _, slow_rear = self.flights.fraction(leg, late)
        _, slow_front = self.flights.fraction(leg, early)
        # The speed rises, stays and falls: it is greatest nearest to the leg's middle.
        duration = self.flights.duration[leg]
        _, fast = self.flights.fraction(leg, np.clip(0.5 * duration, late, early))
        moving = late < duration + SETTLING
        fast *= np.where(moving, self.flights.excess[leg], 1.0)
        # The law's time runs slower than the clock at first, by up to 35 %.
        slow = 0.65 * np.minimum(slow_rear, slow_front)
        return slow, fast, moving & ~(middle < duration + SETTLING)

    def _law_times(
        self, drone: IntArray, after: FloatArray, length: float
    ) -> tuple[FloatArray, FloatArray]:
        """Law's times (m,) [s] of the latest at the start, the earliest at the end."""
        leg = self.stretch.leg[drone]
        since = self.stretch.first + after - self.stretch.release[drone]
        spread = self.flights.spread[leg]
        late = self.flights.law_time(leg, since) - spread
        return late, self.flights.law_time(leg, since + length) + spread
