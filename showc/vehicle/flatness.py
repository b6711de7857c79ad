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
