"""What a setpoint has to be beyond its trajectory for the vehicle to be on it.

ArduCopter follows position, velocity and acceleration, and corrects what is missed of
them. On the trajectory nothing is missed, and so nothing pushes against drag but
``PSC_VELXY_FF``; and its lean is reckoned with full weight, so that level pushes lose
what a falling vehicle lacks in lift. At 7 m/s level and 4.4 m/s down both together cost
0.41 m: 7.5 of the 2 m/s² that are missing come for a metre.

The loops of :mod:`showc.autopilot.controller`, solved for what they are to be sent,
give the shift: with v, a of the trajectory, k(v) the drag, d the shift and e = d' + p d
the speed missed,

- level: d'' = (a + k v) g / (g + a_z + k v_z) - a - F v - (P + F) e - I ∫e, the first
  term read ``AHEAD`` of its time, which the lean takes;
- upright: d'' = m - P_z e, with m the acceleration that must be missed for a lift of
  a_z + k v_z: (that lift - its sum) / gain.

Sent are place + d, velocity + d', acceleration + d'': a motion like any other, so that
nothing in the autopilot smooths it away. Gains and drag are those of ArduCopter 4.6's
own simulated quadrotor; flown within 0.2 m of the trajectories of all shows.
"""

from __future__ import annotations

from math import tan
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.controller import DRAG, DRAG_SQUARE, LIFT_GAIN, LIFT_SUM
from showc.vehicle import STANDARD_GRAVITY

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.autopilot.parameters import Gains


AHEAD = 0.11
"""How late lean and lift follow what is asked for [s]."""

LEAST_LIFT = 0.2 * STANDARD_GRAVITY
"""Lift below which no level push is made up for [m/s²]: leans would be too steep."""

LONGEST = 0.1
"""Longest time over which a shift is carried on [s]: two setpoints' at 20 Hz. After a
longer gap the autopilot's own corrections have to do."""


class Feedforward:
    """Shifts of n vehicles, from setpoint to setpoint.

    Parameters
    ----------
    gains
        With which they fly.
    count
        Their number n.

    Attributes
    ----------
    place, speed, push
        How much the setpoint lies beyond the trajectory, and moves so: arrays (n, 3)
        in any frame whose third axis is up [m, m/s, m/s²].
    """

    def __init__(self, gains: Gains, count: int) -> None:
        self._hold = np.array([gains.place, gains.place, gains.height])
        self._gain = gains.speed + gains.forward
        self._gains = gains
        self.place, self.speed, self.push = np.zeros((3, count, 3))
        # Sums of the level speed missed [m], and of the lift asked for [m/s²].
        self._total, self._lift = np.zeros((count, 2)), np.zeros(count)
        self._missed = np.zeros(count)

    def advance(
        self,
        span: float,
        now: tuple[FloatArray, FloatArray],
        soon: tuple[FloatArray, FloatArray],
    ) -> None:
        """Carry the shifts on over ``span`` [s] since the last setpoints.

        Parameters
        ----------
        now, soon
            Velocities (n, 3) [m/s] and accelerations (n, 3) [m/s²] of the trajectories
            at the setpoints' time, and ``AHEAD`` of it.
        """
        span = min(span, LONGEST)
        missed = self.speed + self._hold * self.place
        missed += 0.5 * span * self.push
        self._total += span * missed[:, :2]
        self._lift += span * LIFT_SUM * self._missed
        # As the autopilot carries its setpoint on between two of them.
        self.place += span * self.speed + 0.5 * span**2 * self.push
        self.speed += span * self.push
        missed = self.speed + self._hold * self.place
        gains = self._gains
        wanted, lift = self._wanted(*soon)
        self.push[:, :2] = wanted - now[1][:, :2] - gains.forward * now[0][:, :2]
        self.push[:, :2] -= self._gain * missed[:, :2] + gains.total * self._total
        self._missed = (lift - self._lift) / LIFT_GAIN
        self.push[:, 2] = self._missed - gains.climb * missed[:, 2]

    def _wanted(
        self, velocity: FloatArray, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the lean (n, 2) and the lift (n,) that make this motion [m/s²]."""
        fast = np.hypot(velocity[:, 0], velocity[:, 1])
        level = (DRAG + DRAG_SQUARE * fast)[:, None] * velocity[:, :2]
        rise = velocity[:, 2]
        lift = acceleration[:, 2] + (DRAG + DRAG_SQUARE * np.abs(rise)) * rise
        share = STANDARD_GRAVITY / np.maximum(STANDARD_GRAVITY + lift, LEAST_LIFT)
        lean = (acceleration[:, :2] + level) * share[:, None]
        size = np.linalg.norm(lean, axis=1)
        steepest = STANDARD_GRAVITY * tan(self._gains.lean)
        return lean * np.minimum(1.0, steepest / np.maximum(size, 1e-9))[:, None], lift
