"""Straight flights that share a profile: states and controls in closed form.

Along ``start + s(t) d`` the thrust acceleration is ``u = g e_z + d s''``; with yaw held
the model is differentially flat (Mellinger and Kumar 2011, Minimum snap trajectory
generation, section III): roll, pitch and thrust follow from u, rates from s''', torques
from s''''. No optimisation is involved, and a fleet is worked on at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.flight import Trajectory
from showc.trajectory import PiecewisePolynomial, bernstein_basis_inverse

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.solve.profile import Profile
    from showc.vehicle import Limits, Quadrotor

    FloatArray = NDArray[np.float64]
    BoolArray = NDArray[np.bool_]

STATE_DEGREE = 6
CONTROL_DEGREE = 5


@dataclass(frozen=True, slots=True, eq=False)
class Attitude:
    """Flatness outputs of straight flights, each of shape (n, ...)."""

    acceleration: FloatArray
    """|u| [m/s²]."""
    roll: tuple[FloatArray, FloatArray, FloatArray]
    """Roll [rad] and its first and second derivative by s''."""
    pitch: tuple[FloatArray, FloatArray, FloatArray]
    """Pitch and its derivatives."""


def attitude(
    displacement: FloatArray, second: FloatArray, heading: float, gravity: float
) -> Attitude:
    """Roll, pitch and thrust of flights along straight lines, and how they change.

    Parameters
    ----------
    displacement
        Way of each drone, shape (n, 3) [m], show frame.
    second
        s'' [1/s²], shape (n, ...) or broadcastable to it.
    heading, gravity
        Yaw that is held [rad]; acceleration of free fall [m/s²].
    """
    shape = (-1,) + (1,) * (np.ndim(second) - 1)
    cosine, sine = np.cos(heading), np.sin(heading)
    ax = (cosine * displacement[:, 0] + sine * displacement[:, 1]).reshape(shape)
    ay = (cosine * displacement[:, 1] - sine * displacement[:, 0]).reshape(shape)
    az = displacement[:, 2].reshape(shape)
    ux, uy, uz = ax * second, ay * second, gravity + az * second
    plane = ux**2 + uz**2
    planar = np.sqrt(plane)
    total = plane + uy**2
    pitch = np.arctan2(ux, uz)
    pitch_1 = ax * gravity / plane
    pitch_2 = -2.0 * ax * gravity * (ux * ax + uz * az) / plane**2
    roll = -np.arctan2(uy, planar)
    slope = (ux * ax + uz * az) / planar
    curvature = (ax**2 + az**2) / planar - slope**2 / planar
    numerator = ay * planar - uy * slope
    roll_1 = -numerator / total
    growth = 2.0 * (ux * ax + uy * ay + uz * az)
    roll_2 = (uy * curvature * total + numerator * growth) / total**2
    return Attitude(np.sqrt(total), (roll, roll_1, roll_2), (pitch, pitch_1, pitch_2))


@dataclass(frozen=True, slots=True, eq=False)
class StraightFlights:
    """Straight flights of many drones along one profile."""

    breaks: FloatArray
    """Interval borders common to all, shape (K + 1,) [s]."""
    state: FloatArray
    """Bernstein coefficients, shape (n, K, degree + 1, 12)."""
    control: FloatArray
    """Bernstein coefficients, shape (n, K, degree + 1, 4)."""

    def trajectory(self, index: int) -> Trajectory:
        """Return the flight of one of the drones."""
        return Trajectory(
            PiecewisePolynomial(self.breaks, self.state[index]),
            PiecewisePolynomial(self.breaks, self.control[index]),
        )


def fly_straight(
    vehicle: Quadrotor,
    heading: float,
    start: FloatArray,
    goal: FloatArray,
    profile: Profile,
) -> StraightFlights:
    """Trajectories of drones that fly straight along one profile, yaw held.

    Positions and velocities are exact polynomials; attitude, rates and controls are
    interpolated at Chebyshev-Lobatto nodes (polynomials of degree 6 and 5).

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m].
    """
    way, speed, second = profile.derivatives()
    widths = np.diff(way.breaks)
    displacement = goal - start
    state_nodes = _lobatto(STATE_DEGREE)
    drones, pieces = start.shape[0], widths.size
    state = np.zeros((drones, pieces, STATE_DEGREE + 1, 12))
    fraction = way.elevated(STATE_DEGREE).coefficients
    state[..., :3] = start[:, None, None, :] + fraction * displacement[:, None, None, :]
    state[:, -1, -1, :3] = goal
    state[..., 3:6] = (
        speed.elevated(STATE_DEGREE).coefficients * displacement[:, None, None, :]
    )
    values = _samples(second.coefficients[:, :, 0], widths, state_nodes)
    flat = attitude(displacement, values[0][None], heading, vehicle.gravity)
    to_state = bernstein_basis_inverse(STATE_DEGREE, tuple(state_nodes))
    for column, angle in ((6, flat.roll), (7, flat.pitch)):
        state[..., column] = angle[0] @ to_state.T
        state[..., column + 3] = (angle[1] * values[1]) @ to_state.T
    state[..., 8] = heading

    control_nodes = _lobatto(CONTROL_DEGREE)
    values = _samples(second.coefficients[:, :, 0], widths, control_nodes)
    flat = attitude(displacement, values[0][None], heading, vehicle.gravity)
    ix, iy, _ = vehicle.inertia
    roll_rate, pitch_rate = flat.roll[1] * values[1], flat.pitch[1] * values[1]
    roll_acceleration = flat.roll[2] * values[1] ** 2 + flat.roll[1] * values[2]
    pitch_acceleration = flat.pitch[2] * values[1] ** 2 + flat.pitch[1] * values[2]
    to_control = bernstein_basis_inverse(CONTROL_DEGREE, tuple(control_nodes))
    control = np.stack(
        [
            vehicle.mass * flat.acceleration @ to_control.T,
            ix * roll_acceleration / vehicle.torque_factor @ to_control.T,
            iy * pitch_acceleration / vehicle.torque_factor @ to_control.T,
            # The gyroscopic torque about z is balanced, so that yaw stays still.
            -(ix - iy) * roll_rate * pitch_rate @ to_control.T,
        ],
        axis=-1,
    )
    return StraightFlights(way.breaks, state, control)


def keeps_limits(
    vehicle: Quadrotor, limits: Limits, state: FloatArray, control: FloatArray
) -> BoolArray:
    """Whether flights keep every limit at every instant, by Bernstein coefficients.

    Parameters
    ----------
    state, control
        Bernstein coefficients, shapes (n, K, degree + 1, 12) and (n, K, ., 4).

    Returns
    -------
    ndarray of bool, shape (n,)
        False may also mean that the enclosure is too wide; True is certain up to
        rounding (1e-9 of each limit).
    """
    slack = 1e-9
    lower = state.min(axis=(1, 2))
    upper = state.max(axis=(1, 2))
    size = np.maximum(np.abs(lower), np.abs(upper))
    position_min, position_max = (
        np.asarray(limits.position_min),
        np.asarray(limits.position_max),
    )
    velocity_min, velocity_max = (
        np.asarray(limits.velocity_min),
        np.asarray(limits.velocity_max),
    )
    good = np.all(lower[:, :3] >= position_min - slack, axis=1)
    good &= np.all(upper[:, :3] <= position_max + slack, axis=1)
    good &= np.all(lower[:, 3:6] >= velocity_min * (1.0 + slack), axis=1)
    good &= np.all(upper[:, 3:6] <= velocity_max * (1.0 + slack), axis=1)
    good &= np.all(size[:, 6:8] <= limits.tilt * (1.0 + slack), axis=1)
    good &= np.all(size[:, 9:12] <= np.asarray(limits.body_rate) * (1 + slack), axis=1)
    thrust = control[..., 0]
    good &= thrust.min(axis=(1, 2)) >= limits.thrust_min - slack
    good &= thrust.max(axis=(1, 2)) <= limits.thrust_max * (1.0 + slack)
    torque = np.abs(control[..., 1:]).max(axis=(1, 2))
    good &= np.all(torque <= np.asarray(limits.torque_max) * (1.0 + slack), axis=1)
    rotors = control @ vehicle.rotor_fractions().T
    good &= rotors.min(axis=(1, 2, 3)) >= -slack
    good &= rotors.max(axis=(1, 2, 3)) <= 1.0 + slack
    return np.asarray(good)


def _lobatto(degree: int) -> FloatArray:
    """Chebyshev-Lobatto nodes on [0, 1], ends included, shape (degree + 1,)."""
    return np.asarray(0.5 * (1.0 - np.cos(np.pi * np.arange(degree + 1) / degree)))


def _samples(
    second: FloatArray, widths: FloatArray, nodes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """s'', s''', s'''' at ``nodes`` of each interval, each of shape (K, nodes)."""
    a, b, c = second[:, :1], second[:, 1:2], second[:, 2:3]
    s, width = nodes[None, :], widths[:, None]
    value = a * (1.0 - s) ** 2 + 2.0 * b * s * (1.0 - s) + c * s**2
    rate = 2.0 * ((b - a) * (1.0 - s) + (c - b) * s) / width
    change = np.broadcast_to(2.0 * (a - 2.0 * b + c) / width**2, value.shape)
    return value, rate, change
