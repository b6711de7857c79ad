"""Attitude and thrust from the acceleration: differential flatness.

The quadrotor is flat in its position and yaw (Mellinger and Kumar 2011, Minimum snap
trajectory generation and control for quadrotors, section III): the thrust vector is
``m (a + g e_z)``, and for the rotation order of this model roll and pitch follow in
closed form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from showc.arrays import FloatArray
    from showc.vehicle.quadrotor import Quadrotor


def attitude_and_thrust(
    vehicle: Quadrotor, acceleration: FloatArray, yaw: ArrayLike = 0.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Roll [rad], pitch [rad] and thrust [N] that give an acceleration.

    Parameters
    ----------
    acceleration
        Acceleration in the show frame, shape (..., 3) [m/s²].
    yaw
        Yaw, broadcastable to (...) [rad].

    Returns
    -------
    tuple of ndarray
        Each of shape (...). In free fall (no thrust) roll and pitch are zero.
    """
    specific = np.array(acceleration, dtype=np.float64)
    specific[..., 2] += vehicle.gravity
    cosine, sine = np.cos(yaw), np.sin(yaw)
    ahead = cosine * specific[..., 0] + sine * specific[..., 1]
    left = cosine * specific[..., 1] - sine * specific[..., 0]
    up = specific[..., 2]
    roll = -np.arctan2(left, np.hypot(ahead, up))
    pitch = np.arctan2(ahead, up)
    return roll, pitch, vehicle.mass * np.linalg.norm(specific, axis=-1)


def state_in_motion(
    vehicle: Quadrotor, derivatives: FloatArray, yaw: float
) -> FloatArray:
    """States that follow from positions and their derivatives, yaw held.

    Parameters
    ----------
    derivatives
        Position, velocity, acceleration and jerk, shape (4, n, 3), show frame (SI).
    yaw
        [rad].

    Returns
    -------
    ndarray, shape (n, 13)
        The 12 states, and the thrust [N].
    """
    position, velocity, acceleration, jerk = derivatives
    roll, pitch, thrust = attitude_and_thrust(vehicle, acceleration, yaw)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    push = acceleration + np.array([0.0, 0.0, vehicle.gravity])
    (x, y, z), (x1, y1, z1) = (
        (cosine * a + sine * b, cosine * b - sine * a, c)
        for a, b, c in (push.T, jerk.T)
    )
    plane = np.hypot(x, z)
    plane_1 = (x * x1 + z * z1) / plane
    rates = np.zeros_like(position)
    rates[:, 0] = (y * plane_1 - y1 * plane) / (plane**2 + y**2)
    rates[:, 1] = (x1 * z - x * z1) / plane**2
    angles = np.stack([roll, pitch, np.full_like(roll, yaw)], axis=1)
    return np.hstack([position, velocity, angles, rates, thrust[:, None]])
