"""The quadrotor: its physical parameters and the allocation of its rotors.

State (12), in this order everywhere: position x, y, z [m] and velocity vx, vy, vz
[m/s] in the show frame (z up); roll phi, pitch theta, yaw psi [rad]; body rates p,
q, r [rad/s]. Control (4): total thrust U1 [N], torques U2, U3, U4 [N m].

The model is the small-angle one of the literature on formation flight: the Euler
angles' rates are taken as the body rates. Torques U2 and U3 come out of the rotor
allocation in N m, arm included, so the consistent equations are
``p' = U2 / Ix + (Iy - Iz) / Ix q r``. A widely copied text prints ``l U2 / Ix`` with
the same U2, which counts the arm twice; ``torque_arm="multiplied"`` gives that form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray


STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s²] (CGPM 1901)."""

STATE_NAMES = (
    "x", "y", "z", "vx", "vy", "vz", "roll", "pitch", "yaw", "p", "q", "r",
)  # fmt: skip
CONTROL_NAMES = ("thrust", "torque_x", "torque_y", "torque_z")


@dataclass(frozen=True, slots=True)
class Body:
    """What a fall depends on besides the mass."""

    size: float
    """Greatest size, from propeller tip to propeller tip [m]."""
    drag_area: tuple[float, float]
    """Least and greatest drag coefficient times area, however it tumbles [m²]."""


@dataclass(frozen=True, slots=True)
class Quadrotor:
    """Physical parameters of one type of aircraft."""

    name: str
    """Name of the preset, or ``custom``."""
    mass: float
    """Take-off mass [kg]."""
    arm_length: float
    """Distance from the centre of mass to a motor [m]."""
    thrust_coefficient: float
    """Thrust of a rotor over its squared speed, kF [N s²/rad²]."""
    torque_coefficient: float
    """Drag torque of a rotor over its squared speed, kM [N m s²/rad²]."""
    inertia: tuple[float, float, float]
    """Moments of inertia Ix, Iy, Iz about the body axes [kg m²]."""
    rotor_speed_max: float
    """Greatest speed of a rotor [rad/s]."""
    torque_arm: Literal["included", "multiplied"] = "included"
    """Whether U2 and U3 already contain the arm (consistent) or not (as printed)."""
    gravity: float = STANDARD_GRAVITY
    """Acceleration of free fall [m/s²]."""

    @property
    def hover_thrust(self) -> float:
        """Thrust that carries the weight [N]."""
        return self.mass * self.gravity

    @property
    def thrust_max(self) -> float:
        """Thrust of all four rotors at full speed, 4 kF w² [N]."""
        return 4.0 * self.thrust_coefficient * self.rotor_speed_max**2

    @property
    def torque_max(self) -> tuple[float, float, float]:
        """Greatest |U2|, |U3| = kF l w² and |U4| = 2 kM w² [N m]."""
        roll = self.thrust_coefficient * self.arm_length * self.rotor_speed_max**2
        yaw = 2.0 * self.torque_coefficient * self.rotor_speed_max**2
        return roll, roll, yaw

    @property
    def torque_factor(self) -> float:
        """Factor on U2 and U3 in the equations of motion: 1, or the arm [m]."""
        return 1.0 if self.torque_arm == "included" else self.arm_length

    def allocation(self) -> FloatArray:
        """Matrix from squared rotor speeds [rad²/s²] to (U1, U2, U3, U4), (4, 4)."""
        force = self.thrust_coefficient
        arm = force * self.arm_length
        drag = self.torque_coefficient
        return np.array(
            [
                [force, force, force, force],
                [0.0, -arm, 0.0, arm],
                [arm, 0.0, -arm, 0.0],
                [drag, -drag, drag, -drag],
            ]
        )

    def rotor_fractions(self) -> FloatArray:
        """Matrix (4, 4) from U1..U4 to squared rotor speeds over the greatest.

        A control can be flown if and only if all four fractions lie in [0, 1].
        """
        inverse = np.linalg.inv(self.allocation())
        return np.asarray(inverse / self.rotor_speed_max**2, dtype=np.float64)

    def hover_state(self, position: FloatArray, yaw: float = 0.0) -> FloatArray:
        """Return the states (..., 12) of hovering at ``position`` (..., 3) [m]."""
        state = np.zeros((*np.shape(position)[:-1], 12))
        state[..., :3] = position
        state[..., 8] = yaw
        return state

    def hover_control(self) -> FloatArray:
        """Return the control (4,) of hovering."""
        return np.array([self.hover_thrust, 0.0, 0.0, 0.0])
