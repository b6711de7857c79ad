"""Whether a trajectory keeps its limits at every instant, by Bernstein coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import bernstein_basis, bernstein_basis_inverse
from showc.vehicle import CONTROL_NAMES, STATE_NAMES
from showc.vehicle.jerk import greatest_jerk, lean_factor
from showc.vehicle.motion import thrust_direction

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.flight import Trajectory
    from showc.vehicle import Quadrotor


_ROTORS = tuple(f"rotor {number}" for number in range(1, 5))
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


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Limits of some polynomials on the same intervals, m of them."""

    names: tuple[str, ...]
    values: FloatArray
    """Coefficients, shape (K, degree + 1, m)."""
    lower: FloatArray
    """Shape (m,)."""
    upper: FloatArray
    """Shape (m,)."""

    def worst(self, breaks: FloatArray) -> Excess:
        """Return the limit that is broken most, as a share of its range."""
        least, most = self.values.min(axis=(0, 1)), self.values.max(axis=(0, 1))
        amount = np.maximum(self.lower - least, most - self.upper)
        span = self.upper - self.lower
        relative = amount / np.where(np.isfinite(span) & (span > 0.0), span, 1.0)
        at = int(np.argmax(relative))
        one = self.values[..., at]
        outside = np.maximum(self.lower[at] - one, one - self.upper[at]).max(axis=1)
        time = float(breaks[int(np.argmax(outside))])
        return Excess(self.names[at], time, float(amount[at]), float(relative[at]))


@lru_cache(maxsize=64)
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
    state, control = trajectory.state.coefficients, trajectory.control.coefficients
    limits = aircraft.limits
    torque = np.array(limits.torque_max)
    groups = [
        _Group(STATE_NAMES, state, *state_bounds(aircraft)),
        _Group(
            CONTROL_NAMES,
            control,
            np.array([limits.thrust_min, *-torque]),
            np.array([limits.thrust_max, *torque]),
        ),
        _Group(
            _ROTORS,
            control @ aircraft.vehicle.rotor_fractions().T,
            np.zeros(len(_ROTORS)),
            np.ones(len(_ROTORS)),
        ),
        *_round_groups(aircraft, trajectory),
    ]
    breaks = trajectory.state.breaks
    found = [group.worst(breaks) for group in groups]
    return max(found, key=lambda excess: excess.relative)


def _round_groups(aircraft: Aircraft, trajectory: Trajectory) -> Iterator[_Group]:
    """Level speed; accelerations, of the velocity and as thrust gives them."""
    limits = aircraft.limits
    velocity = trajectory.state.coefficients[:, :, 3:6]
    none = np.zeros(1)
    if limits.rounds_speed:
        speed = np.hypot(velocity[..., :1], velocity[..., 1:2])
        yield _Group(("level speed",), speed, none, np.array([limits.level_speed]))
    if limits.jerk:
        jerk = greatest_jerk(
            aircraft.vehicle,
            lean_factor(limits.tilt, aircraft.yaw),
            trajectory.state.breaks,
            trajectory.state.coefficients,
            trajectory.control.coefficients,
        )
        yield _Group(("jerk",), jerk[..., None], none, np.array([limits.jerk]))
    degree = velocity.shape[1] - 1
    if degree == 0 or not limits.limits_acceleration:
        return
    widths = np.diff(trajectory.state.breaks)[:, None, None]
    rate = degree * np.diff(velocity, axis=1) / widths
    low, high = -limits.acceleration_down or -np.inf, limits.acceleration_up or np.inf
    for found in (rate, flown_acceleration(aircraft.vehicle, trajectory)):
        level = np.hypot(found[..., 0], found[..., 1])
        yield _Group(
            ("level acceleration", "vertical acceleration"),
            np.stack([level, found[..., 2]], axis=-1),
            np.array([0.0, low]),
            np.array([limits.acceleration or np.inf, high]),
        )


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
