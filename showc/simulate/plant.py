"""The aircraft in the air: twelve states, lagging rotors, drag, wind.

The plan takes the rates of the Euler angles as the body rates; an aircraft does not.
Here they follow from each other as those of a rigid body do (Stevens, Lewis and Johnson
2016, Aircraft Control and Simulation, 1.4-4):

    phi' = p + (q sin phi + r cos phi) tan theta,
    theta' = q cos phi - r sin phi,
    psi' = (q sin phi + r cos phi) / cos theta.
"""

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
_ROUNDING = 1e-9
"""Share of a rotor's greatest thrust that a command may be off."""


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

    def allotted(self, control: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Limit controls (n, 4) to what rotors can do, and say which were, (n,).

        As mixers of autopilots do: yaw gives way first, then the thrust, and only what
        is beyond the range of a rotor is taken off roll and pitch.
        """
        share = self.vehicle.rotor_fractions()
        lift, turn = control[:, :1] * share[:, 0], control[:, 1:3] @ share[:, 1:3].T
        spin = control[:, 3:] * share[:, 3]
        asked = lift + turn + spin
        # At most the whole range between the least and the greatest turning rotor.
        turn = turn / np.maximum(np.ptp(turn, axis=1, keepdims=True), 1.0)
        lift = np.clip(
            lift,
            -turn.min(axis=1, keepdims=True),
            1.0 - turn.max(axis=1, keepdims=True),
        )
        given = lift + turn
        # Where adding the spin ends: at full speed, or at none.
        room = np.where(spin > 0.0, 1.0 - given, given)
        size = np.maximum(np.abs(spin), 1e-12)
        given += np.clip((room / size).min(axis=1), 0.0, 1.0)[:, None] * spin
        given = np.clip(given, 0.0, 1.0)
        limited = (np.abs(given - asked) > _ROUNDING).any(axis=1)
        most = self.vehicle.rotor_speed_max**2
        return given @ (self.vehicle.allocation() * most).T, limited

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
        roll, pitch = state[:, 6], state[:, 7]
        p, q, r = state[:, 9:12].T
        turning = q * np.sin(roll) + r * np.cos(roll)
        found[:, 6] = p + turning * np.tan(pitch)
        found[:, 7] = q * np.cos(roll) - r * np.sin(roll)
        found[:, 8] = turning / np.cos(pitch)
        through = state[:, 3:6] - wind
        speed = np.linalg.norm(through, axis=1)[:, None]
        factor = 0.5 * AIR_DENSITY * self.drag_area / self.vehicle.mass
        found[:, 3:6] -= factor * speed * through
        return found
