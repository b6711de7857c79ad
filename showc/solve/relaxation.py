"""The relaxed drone of the lower bound: what it may do at every instant.

Velocity in its box, thrust acceleration in the set U(t) that thrust, tilt, body rates
and angular accelerations allow at time t after one hover and T - t before the next: a
superset of what the aircraft can do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.vehicle import Limits, Quadrotor

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Relaxation:
    """What the bound lets a drone do: a superset of what it can do."""

    vehicle: Quadrotor
    limits: Limits
    yaw: Literal["held", "free"] = "held"
    heading: float = 0.0
    """Yaw at both hovers [rad]."""

    @property
    def specific_thrust(self) -> tuple[float, float]:
        """Least and greatest thrust over mass [m/s²]."""
        mass = self.vehicle.mass
        most = min(self.limits.thrust_max, self.vehicle.thrust_max)
        return self.limits.thrust_min / mass, most / mass

    @property
    def angular_acceleration(self) -> tuple[float, float]:
        """Greatest |p'| and |q'| [rad/s²], by torque and rotor limits."""
        ix, iy, iz = self.vehicle.inertia
        p, q, r = self.limits.body_rate
        gyroscopic = (abs(iy - iz) / ix * q * r, abs(iz - ix) / iy * p * r)
        torque = [
            min(self.limits.torque_max[axis], self.vehicle.torque_max[axis])
            * self.vehicle.torque_factor
            / self.vehicle.inertia[axis]
            for axis in (0, 1)
        ]
        if self.yaw == "held":
            return torque[0], torque[1]
        return torque[0] + gyroscopic[0], torque[1] + gyroscopic[1]

    def caps(self, since_hover: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Greatest |roll| and |pitch| [rad] at a time ``since_hover`` [s]."""
        rate, alpha = self.limits.body_rate, self.angular_acceleration
        roll, pitch = (
            np.minimum(
                self.limits.tilt,
                np.minimum(
                    rate[axis] * since_hover, 0.5 * alpha[axis] * since_hover**2
                ),
            )
            for axis in (0, 1)
        )
        return roll, pitch

    def turned(self, vectors: FloatArray) -> FloatArray:
        """Vectors (..., 3) of the show frame in the frame of the heading."""
        if self.yaw == "free":
            return vectors
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0, 0, 1]])
        return np.asarray(vectors @ rotation)

    def thrust_support(
        self, multiplier: FloatArray, roll: FloatArray, pitch: FloatArray
    ) -> FloatArray:
        """Greatest ``multiplier . u`` over U with the given caps, shape (...).

        Parameters
        ----------
        multiplier
            Shape (..., 3), show frame.
        roll, pitch
            Greatest |roll| and |pitch|, shape (...) [rad], below 90 degrees.
        """
        turned = self.turned(multiplier)
        lx, ly, lz = turned[..., 0], turned[..., 1], turned[..., 2]
        if self.yaw == "free":
            across = np.hypot(lx, ly)
            cone = np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0))
            most = _arc(lz, across, cone)
        else:
            most = _arc(_arc(lz, np.abs(lx), pitch), np.abs(ly), roll)
        least_thrust, most_thrust = self.specific_thrust
        return np.asarray(np.maximum(most_thrust * most, least_thrust * most))

    def velocity_support(self, multiplier: FloatArray) -> FloatArray:
        """Greatest ``multiplier . v`` over the velocity box, shape (...)."""
        return np.asarray(
            np.maximum(
                multiplier * np.asarray(self.limits.velocity_max),
                multiplier * np.asarray(self.limits.velocity_min),
            ).sum(axis=-1)
        )

    def vertices(
        self, roll: FloatArray, pitch: FloatArray, steps: int = 3
    ) -> FloatArray:
        """Points of U, shape (k, m, 3) [m/s²], whose hull nearly fills U's.

        Parameters
        ----------
        roll, pitch
            Greatest |roll| and |pitch|, shape (k,) [rad].
        """
        least_thrust, most_thrust = self.specific_thrust
        if self.yaw == "free":
            cone = np.arccos(np.cos(roll) * np.cos(pitch))[:, None]
            turn = 2.0 * np.pi * np.arange(12) / 12
            up = np.array([0.0, 0.0, 1.0])
            rim = np.stack(
                [
                    np.cos(turn) * np.sin(cone),
                    np.sin(turn) * np.sin(cone),
                    np.broadcast_to(np.cos(cone), (cone.size, turn.size)),
                ],
                axis=-1,
            )
            top = np.broadcast_to(up, (cone.size, 1, 3))
            directions = np.concatenate([rim, top], axis=1)
        else:
            grid = np.linspace(-1.0, 1.0, steps)
            phi = roll[:, None] * np.tile(grid, steps)
            theta = pitch[:, None] * np.repeat(grid, steps)
            directions = np.stack(
                [
                    np.cos(phi) * np.sin(theta),
                    -np.sin(phi),
                    np.cos(phi) * np.cos(theta),
                ],
                axis=-1,
            )
            cosine, sine = math.cos(self.heading), math.sin(self.heading)
            rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
            directions = directions @ rotation.T
        return np.concatenate(
            [most_thrust * directions, least_thrust * directions], axis=1
        )


def _arc(ahead: FloatArray, across: FloatArray, cap: FloatArray) -> FloatArray:
    """Greatest ``ahead cos(x) + across sin(x)`` over 0 <= x <= cap, across >= 0."""
    inside = np.arctan2(across, ahead) <= cap
    return np.asarray(
        np.where(
            inside,
            np.hypot(ahead, across),
            ahead * np.cos(cap) + across * np.sin(cap),
        )
    )
