"""Flying trajectories again: the controls, integrated, against the polynomials.

The controls, cut to what the rotors can do, are integrated from the first state, all
drones at once. Gauss quadrature has 10 points on each half of every interval (local
order 20). Rates couple through the gyroscopic terms only; they are found by fixed-point
(Picard) iteration over the whole leg, the rest follows by quadrature.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from showc.trajectory import bernstein_basis
from showc.vehicle.motion import angular_acceleration, thrust_direction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.flight import Trajectory
    from showc.vehicle import Quadrotor


POINTS, PARTS = 10, 2
"""Gauss points of a part, and parts of an interval, between which controls are
integrated."""
SWEEPS = 60
"""Greatest number of fixed-point sweeps; the iteration converges factorially."""
_TOGETHER = 100
"""Flights that are integrated at once: some 20 MB on 20 intervals each."""


@dataclass(frozen=True, slots=True, eq=False)
class ReplayErrors:
    """Greatest differences between the flight replayed and the polynomials."""

    position: FloatArray
    """Of each drone, shape (n,) [m]."""
    velocity: FloatArray
    """Of each drone, shape (n,) [m/s]."""
    attitude: FloatArray
    """Greatest of |roll|, |pitch|, |yaw| differences, shape (n,) [rad]."""


def _integration() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss points on [0, 1], matrix of integrals up to them, weights."""
    roots, weights = legendre.leggauss(POINTS)
    to_series = np.linalg.inv(legendre.legvander(roots, POINTS - 1))
    integrals = np.stack(
        [
            legendre.legval(roots, legendre.legint(unit, lbnd=-1.0))
            for unit in np.eye(POINTS)
        ],
        axis=1,
    )
    return 0.5 * (roots + 1.0), 0.5 * integrals @ to_series, 0.5 * weights


_POINTS, _MATRIX, _WEIGHTS = _integration()
_SUMS = np.vstack([_MATRIX, _WEIGHTS])
"""Integrals up to every point, and over the whole step."""


def replay(vehicle: Quadrotor, trajectories: Sequence[Trajectory]) -> ReplayErrors:
    """Integrate the controls of each trajectory and compare.

    Parameters
    ----------
    trajectories
        Flights with states and controls on the same breaks each.
    """
    if not trajectories:
        return ReplayErrors(np.zeros(0), np.zeros(0), np.zeros(0))
    errors = np.zeros((3, len(trajectories)))
    shapes: dict[tuple[int, int, int], list[int]] = {}
    for index, trajectory in enumerate(trajectories):
        state, control = trajectory.state, trajectory.control
        key = (state.intervals, state.degree, control.degree)
        shapes.setdefault(key, []).append(index)
    for alike in shapes.values():
        for top in range(0, len(alike), _TOGETHER):
            indices = alike[top : top + _TOGETHER]
            group = [trajectories[index] for index in indices]
            errors[:, indices] = _replay_alike(vehicle, group)
    return ReplayErrors(*errors)


def _replay_alike(vehicle: Quadrotor, trajectories: list[Trajectory]) -> FloatArray:
    """Replay trajectories of equal shape; arrays are (drones, steps, points, ...).

    Returns
    -------
    ndarray
        Errors of position, velocity and attitude, shape (3, drones).
    """
    fractions = ((np.arange(PARTS)[:, None] + _POINTS) / PARTS).ravel()
    breaks = np.stack([item.state.breaks for item in trajectories])
    widths = np.repeat(np.diff(breaks, axis=1), PARTS, axis=1) / PARTS

    def sampled(coefficients: FloatArray) -> FloatArray:
        basis = bernstein_basis(coefficients.shape[2] - 1, fractions)
        values = basis @ coefficients
        return np.asarray(values.reshape(*widths.shape, POINTS, coefficients.shape[3]))

    state = sampled(np.stack([item.state.coefficients for item in trajectories]))
    control = sampled(np.stack([item.control.coefficients for item in trajectories]))
    control = _flyable(vehicle, control)
    first = state_at_start(trajectories)

    def integrated(rate: FloatArray, initial: FloatArray) -> FloatArray:
        """Integral up to every point; ``rate`` (drones, steps, points, c)."""
        # Matrix products take half the time of sums over indices.
        inner = _SUMS @ rate
        steps = widths[..., None, None] * inner
        gains = steps[:, :, -1]
        before = np.cumsum(gains, axis=1) - gains + initial[:, None]
        return np.asarray(before[:, :, None] + steps[:, :, :-1])

    rates = state[..., 9:12]
    for _ in range(SWEEPS):
        turning = angular_acceleration(
            vehicle,
            (rates[..., 0], rates[..., 1], rates[..., 2]),
            (control[..., 1], control[..., 2], control[..., 3]),
        )
        updated = integrated(np.stack(turning, axis=-1), first[:, 9:12])
        change = float(np.abs(updated - rates).max())
        rates = updated
        if change < 1e-13:
            break
    angles = integrated(rates, first[:, 6:9])
    push = control[..., 0] / vehicle.mass
    direction = thrust_direction(angles[..., 0], angles[..., 1], angles[..., 2])
    acceleration = np.stack([push * part for part in direction], axis=-1)
    acceleration[..., 2] -= vehicle.gravity
    velocity = integrated(acceleration, first[:, 3:6])
    position = integrated(velocity, first[:, 0:3])
    missed = np.linalg.norm(position - state[..., 0:3], axis=-1)
    slipped = np.linalg.norm(velocity - state[..., 3:6], axis=-1)
    turned = np.abs(angles - state[..., 6:9])
    return np.stack(
        [missed.max(axis=(1, 2)), slipped.max(axis=(1, 2)), turned.max(axis=(1, 2, 3))]
    )


def state_at_start(trajectories: Sequence[Trajectory]) -> FloatArray:
    """First states of trajectories, shape (n, 12)."""
    return np.stack([item.state.coefficients[0, 0] for item in trajectories])


def _flyable(vehicle: Quadrotor, control: FloatArray) -> FloatArray:
    """Cut controls to what the rotors can do: squared speeds within [0, greatest]."""
    fractions = vehicle.rotor_fractions()
    shares = control @ fractions.T
    if shares.min() >= 0.0 and shares.max() <= 1.0:
        return control
    return np.asarray(np.clip(shares, 0.0, 1.0) @ np.linalg.inv(fractions).T)
