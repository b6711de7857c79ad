"""The aircraft in the air: twelve states, lagging rotors, drag, wind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.vehicle.motion import state_derivative

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.vehicle import Quadrotor

AIR_DENSITY = 1.225
"""Of the standard atmosphere at sea level [kg/m³]."""


@dataclass(frozen=True, slots=True)
class Imperfections:
    """What lies between a command and its effect, and between a state and its estimate.

    The figures are typical of small quadrotors with RTK; none is of one aircraft.
    """

    rotor_lag: float = 0.03
    """Time constant of the rotors' thrust [s]."""
    delay: float = 0.02
    """Time between an estimate and its command [s]."""
    position: float = 0.02
    """Standard deviation of the estimated position, each axis [m]."""
    velocity: float = 0.05
    """Likewise of the velocity [m/s]."""
    attitude: float = 0.005
    """Likewise of roll, pitch and yaw [rad]."""
    rate: float = 0.01
    """Likewise of the body rates [rad/s]."""
    correlation: float = 0.5
    """Time over which errors of position, velocity and attitude fade [s]."""


@dataclass(frozen=True, slots=True)
class Plant:
    """Equations of motion of a fleet in wind."""

    vehicle: Quadrotor
    drag_area: float
    """Drag coefficient times area of the flying aircraft [m²]."""
    lag: float
    """Time constant of the rotors' thrust [s]."""

    def clipped(self, control: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Limit controls (n, 4) to what rotors can do, and say which were, (n,)."""
        fractions = control @ self.vehicle.rotor_fractions().T
        kept = np.clip(fractions, 0.0, 1.0)
        most = self.vehicle.rotor_speed_max**2
        allocated = kept @ (self.vehicle.allocation() * most).T
        return allocated, np.asarray(np.any(kept != fractions, axis=1))

    def after(
        self,
        state: FloatArray,
        control: FloatArray,
        command: FloatArray,
        wind: FloatArray,
        step: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Fly a ``step`` [s]; return states (n, 12) and controls (n, 4) after it.

        Parameters
        ----------
        state, control
            Before the step; the controls are what the rotors give.
        command
            What the rotors are asked for, shape (n, 4); they follow with their lag.
        wind
            Velocity of the air, shape (n, 3) [m/s].
        step
            [s].
        """
        fade = np.exp(-0.5 * step / self.lag)
        middle = command + fade * (control - command)
        last = command + fade**2 * (control - command)
        first = self._slope(state, control, wind)
        second = self._slope(state + 0.5 * step * first, middle, wind)
        third = self._slope(state + 0.5 * step * second, middle, wind)
        fourth = self._slope(state + step * third, last, wind)
        return state + step / 6.0 * (first + 2.0 * (second + third) + fourth), last

    def _slope(
        self, state: FloatArray, control: FloatArray, wind: FloatArray
    ) -> FloatArray:
        found = state_derivative(self.vehicle, state, control)
        through = state[:, 3:6] - wind
        speed = np.linalg.norm(through, axis=1)[:, None]
        factor = 0.5 * AIR_DENSITY * self.drag_area / self.vehicle.mass
        found[:, 3:6] -= factor * speed * through
        return found
