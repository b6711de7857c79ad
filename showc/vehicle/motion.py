"""The equations of motion, written once for numbers and for symbols.

A thrust U1 tilts with the body: with roll phi, pitch theta, yaw psi (rotations about
z, y, x in that order) its direction in the show frame is

    b = (cos phi sin theta cos psi + sin phi sin psi,
         cos phi sin theta sin psi - sin phi cos psi,
         cos phi cos theta).

Every function takes the sine and cosine to use, so that numpy arrays and CasADi
symbols go through the same formula.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import FloatArray
    from showc.vehicle.quadrotor import Quadrotor

    Scalar = Any
    """A float, a numpy array or a CasADi scalar."""


def thrust_direction(
    roll: Scalar,
    pitch: Scalar,
    yaw: Scalar,
    *,
    sin: Callable[[Any], Any] = np.sin,
    cos: Callable[[Any], Any] = np.cos,
) -> tuple[Scalar, Scalar, Scalar]:
    """Components of the unit vector of the thrust in the show frame.

    Parameters
    ----------
    roll, pitch, yaw
        Attitude [rad].
    sin, cos
        Functions to use: numpy's, or CasADi's for symbols.
    """
    forward, up = cos(roll) * sin(pitch), cos(roll) * cos(pitch)
    side = sin(roll)
    return (
        forward * cos(yaw) + side * sin(yaw),
        forward * sin(yaw) - side * cos(yaw),
        up,
    )


def angular_acceleration(
    vehicle: Quadrotor,
    rates: tuple[Scalar, Scalar, Scalar],
    torques: tuple[Scalar, Scalar, Scalar],
) -> tuple[Scalar, Scalar, Scalar]:
    """Rates of the body rates p, q, r [rad/s²].

    ``p' = k U2 / Ix + (Iy - Iz) / Ix q r`` and so on, with k the vehicle's
    ``torque_factor`` on U2 and U3.

    Parameters
    ----------
    rates
        Body rates p, q, r [rad/s].
    torques
        U2, U3, U4 [N m].
    """
    p, q, r = rates
    ix, iy, iz = vehicle.inertia
    factor = vehicle.torque_factor
    return (
        factor * torques[0] / ix + (iy - iz) / ix * q * r,
        factor * torques[1] / iy + (iz - ix) / iy * p * r,
        torques[2] / iz + (ix - iy) / iz * p * q,
    )


def torques_for(
    vehicle: Quadrotor,
    rates: tuple[Scalar, Scalar, Scalar],
    accelerations: tuple[Scalar, Scalar, Scalar],
) -> tuple[Scalar, Scalar, Scalar]:
    """Torques U2, U3, U4 [N m] that give the angular ``accelerations`` [rad/s²].

    The inverse of :func:`angular_acceleration`.
    """
    p, q, r = rates
    ix, iy, iz = vehicle.inertia
    factor = vehicle.torque_factor
    return (
        (ix * accelerations[0] - (iy - iz) * q * r) / factor,
        (iy * accelerations[1] - (iz - ix) * p * r) / factor,
        iz * accelerations[2] - (ix - iy) * p * q,
    )


def state_derivative(
    vehicle: Quadrotor, state: FloatArray, control: FloatArray
) -> FloatArray:
    """Time derivative of states.

    Parameters
    ----------
    state
        Shape (..., 12), in the order of ``STATE_NAMES``.
    control
        Shape (..., 4), in the order of ``CONTROL_NAMES``.

    Returns
    -------
    ndarray, shape (..., 12)
    """
    derivative = np.empty(
        (*np.broadcast_shapes(state.shape[:-1], control.shape[:-1]), 12)
    )
    derivative[..., 0:3] = state[..., 3:6]
    direction = thrust_direction(state[..., 6], state[..., 7], state[..., 8])
    push = control[..., 0] / vehicle.mass
    for axis in range(3):
        derivative[..., 3 + axis] = push * direction[axis]
    derivative[..., 5] -= vehicle.gravity
    derivative[..., 6:9] = state[..., 9:12]
    turning = angular_acceleration(
        vehicle,
        (state[..., 9], state[..., 10], state[..., 11]),
        (control[..., 1], control[..., 2], control[..., 3]),
    )
    for axis in range(3):
        derivative[..., 9 + axis] = turning[axis]
    return derivative


def energy(vehicle: Quadrotor, state: FloatArray) -> FloatArray:
    """Kinetic (of translation) and potential energy [J] of states (..., 12)."""
    speed_squared = np.sum(state[..., 3:6] ** 2, axis=-1)
    return np.asarray(
        vehicle.mass * (0.5 * speed_squared + vehicle.gravity * state[..., 2])
    )
