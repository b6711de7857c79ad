"""Whether a trajectory keeps its limits at every instant, by Bernstein coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import bernstein_basis, bernstein_basis_inverse
from showc.vehicle import CONTROL_NAMES, STATE_NAMES
from showc.vehicle.motion import thrust_direction

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.fleet.single_drone.result import HalfSpace
    from showc.flight import Trajectory
    from showc.vehicle import Quadrotor


FLOWN_DEGREE = 7
"""Of velocities as the controls fly them. On the intervals of a solution the thrust's
direction is a polynomial of degree 6 to 1e-6 of itself."""
# Chebyshev-Lobatto points: interpolation there is nearly best.
_FLOWN_NODES = tuple(
    float(s)
    for s in 0.5 - 0.5 * np.cos(np.pi * np.arange(FLOWN_DEGREE) / (FLOWN_DEGREE - 1))
)


@dataclass(frozen=True, slots=True)
class Excess:
    """The limit that is broken most, or kept most narrowly."""

    name: str
    """Which limit."""
    time: float
    """Start of the interval [s]."""
    amount: float
    """How far outside, in units of the limit; negative: the margin left."""
    relative: float
    """``amount`` over the limit's range."""


def _worst(
    name: str,
    breaks: FloatArray,
    values: FloatArray,
    lower: float,
    upper: float,
) -> Excess:
    """Worst excess of coefficients (K, degree + 1)."""
    outside = np.maximum(lower - values, values - upper).max(axis=1)
    at = int(np.argmax(outside))
    span = upper - lower
    scale = span if np.isfinite(span) and span > 0.0 else 1.0
    amount = float(outside[at])
    return Excess(name, float(breaks[at]), amount, amount / scale)


def state_bounds(aircraft: Aircraft) -> tuple[FloatArray, FloatArray]:
    """Lower and upper bounds of the 12 states."""
    limits = aircraft.limits
    hover = aircraft.heading
    turn = 0.0 if aircraft.yaw == "held" else np.pi
    spin = 0.0 if aircraft.yaw == "held" else limits.body_rate[2]
    high = np.array(
        [
            *limits.position_max,
            *limits.velocity_max,
            limits.tilt,
            limits.tilt,
            hover + turn,
            *limits.body_rate[:2],
            spin,
        ]
    )
    low = np.array(
        [
            *limits.position_min,
            *limits.velocity_min,
            -limits.tilt,
            -limits.tilt,
            hover - turn,
            *(-np.array(limits.body_rate[:2])),
            -spin,
        ]
    )
    return low, high


def greatest_excess(aircraft: Aircraft, trajectory: Trajectory) -> Excess:
    """Worst limit of state, control or rotor over a whole trajectory.

    An upper bound: the coefficients enclose the polynomial.
    """
    breaks = trajectory.state.breaks
    low, high = state_bounds(aircraft)
    found = [
        _worst(name, breaks, trajectory.state.coefficients[:, :, k], low[k], high[k])
        for k, name in enumerate(STATE_NAMES)
        if np.isfinite(low[k]) or np.isfinite(high[k])
    ]
    control = trajectory.control.coefficients
    limits = aircraft.limits
    bounds = [(limits.thrust_min, limits.thrust_max)]
    bounds += [(-bound, bound) for bound in limits.torque_max]
    found += [
        _worst(name, breaks, control[:, :, k], *bounds[k])
        for k, name in enumerate(CONTROL_NAMES)
    ]
    found += _round_excesses(aircraft, trajectory)
    shares = control @ aircraft.vehicle.rotor_fractions().T
    found += [
        _worst(f"rotor {k + 1}", breaks, shares[:, :, k], 0.0, 1.0) for k in range(4)
    ]
    return max(found, key=lambda excess: excess.relative)


def _round_excesses(aircraft: Aircraft, trajectory: Trajectory) -> Iterator[Excess]:
    """Worst level speed; worst accelerations, of the velocity and as thrust gives."""
    limits = aircraft.limits
    breaks = trajectory.state.breaks
    velocity = trajectory.state.coefficients[:, :, 3:6]
    if limits.rounds_speed:
        speed = np.hypot(velocity[..., 0], velocity[..., 1])
        yield _worst("level speed", breaks, speed, 0.0, limits.level_speed)
    degree = velocity.shape[1] - 1
    if degree == 0 or not limits.limits_acceleration:
        return
    rate = degree * np.diff(velocity, axis=1) / np.diff(breaks)[:, None, None]
    low, high = -limits.acceleration_down or -np.inf, limits.acceleration_up or np.inf
    for found in (rate, flown_acceleration(aircraft.vehicle, trajectory)):
        if limits.acceleration:
            level = np.hypot(found[..., 0], found[..., 1])
            yield _worst("level acceleration", breaks, level, 0.0, limits.acceleration)
        yield _worst("vertical acceleration", breaks, found[..., 2], low, high)


def flown_acceleration(vehicle: Quadrotor, trajectory: Trajectory) -> FloatArray:
    """Acceleration that thrust and attitude give, as Bernstein coefficients.

    Returns
    -------
    ndarray, shape (K, 7, 3)
        Show frame [m/s²]; interpolated, on the intervals of solutions to 1e-6 of it.
    """
    state, control = trajectory.state, trajectory.control
    nodes = np.array(_FLOWN_NODES)
    angles = state.select([6, 7, 8]).coefficients
    roll, pitch, yaw = np.moveaxis(bernstein_basis(state.degree, nodes) @ angles, -1, 0)
    push = control.coefficients[:, :, 0] @ bernstein_basis(control.degree, nodes).T
    push /= vehicle.mass
    acceleration = np.stack(
        [push * part for part in thrust_direction(roll, pitch, yaw)], axis=-1
    )
    acceleration[..., 2] -= vehicle.gravity
    inverse = bernstein_basis_inverse(FLOWN_DEGREE - 1, _FLOWN_NODES)
    return np.asarray(inverse @ acceleration)


def half_space_excess(
    trajectory: Trajectory, half_spaces: Iterable[HalfSpace]
) -> Excess | None:
    """Worst half-space over its own stretch of time; ``None`` without any."""
    found = []
    for index, space in enumerate(half_spaces):
        position = trajectory.state.select([0, 1, 2]).split([space.start, space.end])
        within = (position.breaks[:-1] >= space.start - 1e-12) & (
            position.breaks[1:] <= space.end + 1e-12
        )
        if not within.any():
            continue
        along = position.coefficients[within] @ np.array(space.normal)
        outside = (space.offset - along).max(axis=1)
        at = int(np.argmax(outside))
        amount = float(outside[at])
        time = float(position.breaks[:-1][within][at])
        found.append(Excess(f"half-space {index}", time, amount, amount))
    return max(found, key=lambda excess: excess.amount) if found else None
