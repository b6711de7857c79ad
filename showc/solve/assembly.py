"""From a staged solution to a trajectory of 12 states and 4 controls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.flight import Trajectory
from showc.solve.model import POSITION
from showc.trajectory import (
    PiecewisePolynomial,
    bernstein_basis,
    bernstein_basis_inverse,
)
from showc.vehicle.motion import torques_for

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from showc.ocp.staged.transcription import StagedSolution
    from showc.solve.model import Aircraft

    FloatArray = NDArray[np.float64]

CONTROL_DEGREE = 4
"""Rates have degree 2, so gyroscopic torques 4."""

_STATES = (*POSITION, "vx", "vy", "vz", "roll", "pitch", "yaw", "p", "q", "r")
_NODES = tuple(float(s) for s in np.linspace(0.0, 1.0, CONTROL_DEGREE + 1))


def _raised(breaks: FloatArray, coefficients: FloatArray, degree: int) -> FloatArray:
    piece = PiecewisePolynomial(breaks, coefficients[:, :, None])
    return piece.elevated(degree).coefficients[:, :, 0]


def trajectory_of(
    aircraft: Aircraft,
    solution: StagedSolution,
    start: FloatArray,
    goal: FloatArray,
    duration: float,
    *,
    tag: str = "",
) -> Trajectory:
    """Assemble the trajectory of one drone.

    Torques U2, U3, U4 are exact polynomials of degree 4: inertia times the angular
    acceleration less the gyroscopic terms. The ends are set to the hovers exactly;
    what this changes is below the solver's tolerance.

    Parameters
    ----------
    start, goal
        Positions of the hovers, shape (3,) [m].
    duration
        Time of the last break [s]; equals the sum of the widths up to rounding.
    tag
        What the drone's names end in when the solution has several.
    """
    widths = solution.widths
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    breaks *= duration / breaks[-1]
    breaks[-1] = duration
    table: Mapping[str, FloatArray] = solution.coefficients
    count = widths.size
    constant = {
        "yaw": np.full((count, 1), aircraft.heading),
        "r": np.zeros((count, 1)),
        "r_dot": np.zeros((count, 1)),
    }

    def get(name: str) -> FloatArray:
        return table[name + tag] if name + tag in table else constant[name]

    degree = max(get(name).shape[1] for name in _STATES) - 1
    state = np.stack([_raised(breaks, get(name), degree) for name in _STATES], axis=2)
    hover = aircraft.vehicle.hover_state(np.stack([start, goal]), aircraft.heading)
    state[0, 0], state[-1, -1] = hover

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
    control = np.stack(
        [
            _raised(breaks, get("thrust"), CONTROL_DEGREE),
            *(np.asarray(torque) @ inverse.T for torque in torques),
        ],
        axis=2,
    )
    return Trajectory(
        PiecewisePolynomial(breaks, state), PiecewisePolynomial(breaks, control)
    )
