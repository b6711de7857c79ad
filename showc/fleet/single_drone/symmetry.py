"""Moves that are mirror images of each other: what flies one flies the other.

A flight with yaw held is mirrored in a vertical plane of the airframe. That turns the
sign of one horizontal axis, of the angle, rate and torque that act along it, and of the
gyroscopic torque about z; the equations of motion keep their form whatever the inertia.
Limits keep theirs where they are the same to both sides. A fleet that swaps places on a
circle therefore has a few kinds of move, not one for each drone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.flight import Trajectory
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft


_ALIGNED = 1e-12
"""Sine of the angle between directions that rounding alone keeps apart."""
_STATE_AHEAD, _STATE_LEFT = (7, 10), (6, 9)
"""Pitch and its rate go with motion ahead, roll and its rate with motion left."""
_CONTROL_AHEAD, _CONTROL_LEFT = (2, 3), (1, 3)
"""Of the controls, the torques about y and z go with motion ahead, about x and z with
motion left."""


def images(aircraft: Aircraft) -> FloatArray:
    """Signs of x, y and z under which flights of the aircraft stay flights.

    Returns
    -------
    ndarray, shape (m, 3)
        The first row is all ones. Two limits are left for the caller to judge: the
        flight volume, and rotor speeds while a yaw torque balances a turn about both
        axes at once (rotors turn the other way round in a mirror).
    """
    kept = [np.ones(3)]
    limits = aircraft.limits
    if aircraft.yaw != "held":
        return np.array(kept)
    even = np.asarray(limits.velocity_max) == -np.asarray(limits.velocity_min)
    aligned = min(abs(np.sin(aircraft.heading)), abs(np.cos(aircraft.heading)))
    for signs in ((-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (-1.0, -1.0, 1.0)):
        turned = np.array(signs) < 0.0
        if even[turned].all() and (turned.sum() == 2 or aligned <= _ALIGNED):
            kept.append(np.array(signs))
    return np.array(kept)


def kinds(aircraft: Aircraft, way: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn every move into the one that stands for it and its images.

    Parameters
    ----------
    way
        Displacements, shape (n, 3) [m].

    Returns
    -------
    tuple of ndarray
        The move that stands for each, shape (n, 3) [m], equal for images of each
        other (to 1e-9 m, so that rounding parts none); and the signs, shape (n, 3),
        with which it is the move itself.
    """
    signs = images(aircraft)
    # Adding zero turns -0.0, which sorts and hashes apart, into 0.0.
    rounded = np.round(way, 9) + 0.0
    options = rounded[:, None] * signs + 0.0
    best = np.zeros(way.shape[0], dtype=np.int64)
    rows = np.arange(way.shape[0])
    for index in range(1, signs.shape[0]):
        present, other = options[rows, best], options[:, index]
        differs = present != other
        axis = np.argmax(differs, axis=1)
        larger = other[rows, axis] > present[rows, axis]
        best = np.where(differs.any(axis=1) & larger, index, best)
    # Every image is its own inverse.
    return options[rows, best], signs[best]


def image(
    aircraft: Aircraft,
    flight: Trajectory,
    signs: FloatArray,
    start: FloatArray,
    goal: FloatArray,
) -> Trajectory:
    """Return the image of a flight, from ``start`` exactly to ``goal`` exactly.

    Parameters
    ----------
    signs
        One of :func:`images`, shape (3,).
    start, goal
        Shape (3,) [m]; as far apart as the image of the flight goes.
    """
    state_signs, control_signs = _signs(aircraft, signs)
    state = flight.state.coefficients.copy()
    origin = state[0, 0, :3].copy()
    state *= state_signs
    state[..., 8] = flight.state.coefficients[..., 8]
    state[..., :3] += start - signs * origin
    state[0, 0, :3], state[-1, -1, :3] = start, goal
    return Trajectory(
        PiecewisePolynomial(flight.state.breaks, state),
        PiecewisePolynomial(
            flight.control.breaks, flight.control.coefficients * control_signs
        ),
        flight.meshes,
    )


def _signs(aircraft: Aircraft, signs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Signs of the 12 states and 4 controls."""
    state, control = np.ones(12), np.ones(4)
    state[:3] = state[3:6] = signs
    across = abs(np.cos(aircraft.heading)) < abs(np.sin(aircraft.heading))
    ahead, left = signs[[1, 0]] if across else signs[[0, 1]]
    for sign, states, controls in (
        (ahead, _STATE_AHEAD, _CONTROL_AHEAD),
        (left, _STATE_LEFT, _CONTROL_LEFT),
    ):
        state[list(states)] *= sign
        control[list(controls)] *= sign
    return state, control
