"""From a solution of the core to a trajectory of 12 states and 4 controls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.single_drone.audit import (
    FLOWN_DEGREE,
    flown_acceleration,
    greatest_excess,
)
from showc.fleet.single_drone.model import POSITION
from showc.flight import Trajectory
from showc.trajectory import (
    PiecewisePolynomial,
    bernstein_basis,
    bernstein_basis_inverse,
)
from showc.vehicle.motion import torques_for

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.ocp.solution import Solution


CONTROL_DEGREE = 4
"""Rates have degree 2, so gyroscopic torques 4."""

ROUNDING = 1e-9
"""Excess over a limit, relative to its range, that counts as rounding."""

_STATES = (*POSITION, "vx", "vy", "vz", "roll", "pitch", "yaw", "p", "q", "r")
_NODES = tuple(float(s) for s in np.linspace(0.0, 1.0, CONTROL_DEGREE + 1))
"""Where controls are read off: as many places as polynomials have coefficients."""


def _raised(breaks: FloatArray, coefficients: FloatArray, degree: int) -> FloatArray:
    piece = PiecewisePolynomial(breaks, coefficients[:, :, None])
    return piece.elevated(degree).coefficients[:, :, 0]


def trajectory_of(
    aircraft: Aircraft,
    solution: Solution,
    start: FloatArray,
    goal: FloatArray,
    duration: float,
    *,
    origin: FloatArray | None = None,
) -> Trajectory:
    """Assemble the trajectory of one drone.

    Torques U2, U3, U4 are exact polynomials of degree 4: inertia times the angular
    acceleration less the gyroscopic terms. The ends are set to what is asked for
    exactly; what this changes is below the solver's tolerance.

    Parameters
    ----------
    start, goal
        Places to hover at, shape (3,) [m], or states and thrusts (13,).
    duration
        Time of the last break [s]; equals the sum of the widths up to rounding.
    origin
        Where the solution counts its positions from, shape (3,) [m]; by default the
        origin of the show frame.
    """
    part = solution.phases[0]
    breaks = part.states.breaks * (duration / part.states.end)
    breaks[-1] = duration
    table: dict[str, FloatArray] = {
        name: curves.coefficients[:, :, k]
        for names, curves in (
            (part.state_names, part.states),
            (part.control_names, part.controls),
        )
        for k, name in enumerate(names)
    }
    count = part.states.intervals
    constant = {
        "yaw": np.full((count, 1), aircraft.heading),
        "r": np.zeros((count, 1)),
        "r_dot": np.zeros((count, 1)),
    }

    def get(name: str) -> FloatArray:
        return table[name] if name in table else constant[name]

    degree = part.states.degree
    state = np.stack([_raised(breaks, get(name), degree) for name in _STATES], axis=2)
    if origin is not None:
        state[..., :3] += origin
    ends = np.stack([aircraft.end(end) for end in (start, goal)])
    state[0, 0], state[-1, -1] = ends[:, :-1]

    def values(name: str) -> FloatArray:
        coefficients = get(name)
        basis = bernstein_basis(coefficients.shape[1] - 1, np.array(_NODES))
        return np.asarray(coefficients @ basis.T)

    torques = torques_for(
        aircraft.vehicle,
        (values("p"), values("q"), values("r")),
        (values("p_dot"), values("q_dot"), values("r_dot")),
    )
    inverse = bernstein_basis_inverse(CONTROL_DEGREE, _NODES)
    given = [get("thrust"), *(np.asarray(torque) @ inverse.T for torque in torques)]
    degree = max(one.shape[1] for one in given) - 1
    control = np.stack([_raised(breaks, one, degree) for one in given], axis=2)
    if aircraft.limits.jerk:
        control[0, 0, 0], control[-1, -1, 0] = ends[:, -1]
    trajectory = Trajectory(
        PiecewisePolynomial(breaks, state), PiecewisePolynomial(breaks, control)
    )
    return _matched(aircraft, trajectory)


def _matched(aircraft: Aircraft, trajectory: Trajectory) -> Trajectory:
    """Write positions and velocities as the controls fly them between the breaks.

    Inside an interval a solution's velocity is off from what its thrust gives by up to
    1 mm/s; at the breaks it is exact to the order of its quadrature. Where what is
    flown leaves a limit, level or vertical motion stays as it was, or both.
    """
    state, control = trajectory.state, trajectory.control
    acceleration = flown_acceleration(aircraft.vehicle, trajectory)
    width = np.diff(state.breaks)[:, None, None]
    ends = state.coefficients[:, [0, -1]]
    velocity = _between(ends[:, :, 3:6], acceleration, width)
    position = _between(ends[:, :, :3], velocity, width)
    kept = state.elevated(FLOWN_DEGREE + 1).coefficients.copy()
    if aircraft.yaw == "held":
        kept[:, :, 8] = aircraft.heading
    raised = PiecewisePolynomial(state.breaks, velocity).elevated(FLOWN_DEGREE + 1)
    for axes in ([0, 1, 2], [0, 1], [2]):
        new = kept.copy()
        new[..., axes] = position[..., axes]
        new[..., [3 + axis for axis in axes]] = raised.coefficients[..., axes]
        flown = Trajectory(PiecewisePolynomial(state.breaks, new), control)
        if greatest_excess(aircraft, flown).relative <= ROUNDING:
            return flown
    return trajectory


def _between(ends: FloatArray, slope: FloatArray, width: FloatArray) -> FloatArray:
    """Integrate slopes (K, degree + 1, 3) from the first of the ends (K, 2, 3).

    What is missed at the second of them is spread evenly over the interval.
    """
    size = slope.shape[1]
    result = np.zeros((slope.shape[0], size + 1, 3))
    result[:, 1:] = np.cumsum(slope, axis=1) * (width / size)
    missed = ends[:, 1:] - ends[:, :1] - result[:, -1:]
    result += ends[:, :1] + np.linspace(0.0, 1.0, size + 1)[:, None] * missed
    result[:, -1] = ends[:, 1]
    return result
