"""One drone at the common time: near the reference, and on its side of the walls.

Splines come first, for they are quick and keep the walls; where a drone has no slack
left for them, optimal control follows a reference that is pushed behind the walls.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.solve.program import WALL_DEGREE
from showc.solve.single import follow
from showc.solve.spline import follow_spline
from showc.solve.walls import NODES
from showc.trajectory import (
    PiecewisePolynomial,
    bernstein_basis,
    bernstein_basis_inverse,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.flight import Trajectory
    from showc.solve.program import Walls
    from showc.solve.single import Aircraft

    FloatArray = NDArray[np.float64]

STRAIGHT, SPLINE, OPTIMAL = "straight", "spline", "optimal control"
Outcome = tuple[str, "Trajectory | None", str]
"""How a drone is flown, its flight if there is one, why not if there is none."""


def stay_near(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    reference: PiecewisePolynomial,
    intervals: int,
) -> Outcome:
    """Fly one drone as near as can be to the shared profile on its straight line."""
    found = follow_spline(aircraft, start, goal, reference, intervals)
    if found is not None:
        return SPLINE, found.flight.trajectory(0), ""
    result = follow(aircraft, start, goal, reference.end, reference=reference)
    return OPTIMAL, result.trajectory if result.solved else None, result.message


def stay_apart(  # noqa: PLR0917 - tasks of workers are tuples
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    reference: PiecewisePolynomial,
    intervals: int,
    walls: Walls,
    present: FloatArray,
    clearance: float,
) -> Outcome:
    """Fly one drone on its side of the walls.

    Parameters
    ----------
    present
        Positions of the iterate before at ``NODES`` of each interval, shape (K, 7, 3)
        [m]: the way that is pushed behind the walls if no spline can follow.
    clearance
        How far behind them [m]; optimal control weighs its reference against effort
        and falls a little short of it.

    Returns
    -------
    Outcome
        The flight keeps every limit; the walls it keeps as far as it can.
    """
    found = follow_spline(aircraft, start, goal, reference, intervals, walls)
    if found is not None:
        return SPLINE, found.flight.trajectory(0), ""
    pushed = _pushed(present, walls, clearance)
    inverse = bernstein_basis_inverse(WALL_DEGREE, tuple(NODES))
    way = PiecewisePolynomial(
        np.linspace(0.0, reference.end, intervals + 1),
        np.einsum("ij,kja->kia", inverse, pushed),
    )
    result = follow(aircraft, start, goal, reference.end, reference=way)
    return OPTIMAL, result.trajectory if result.solved else None, result.message


def _pushed(present: FloatArray, walls: Walls, clearance: float) -> FloatArray:
    """Positions moved to the right side of every wall, a little farther."""
    pushed = present.copy()
    offset = walls.offset @ bernstein_basis(WALL_DEGREE, NODES).T
    for row, interval in enumerate(walls.interval.tolist()):
        normal = (1.0 - NODES)[:, None] * walls.normal[row, 0] + NODES[
            :, None
        ] * walls.normal[row, 1]
        at = pushed[interval]
        square = np.einsum("ij,ij->i", normal, normal)
        lack = offset[row] - np.einsum("ij,ij->i", normal, at)
        lack = np.where(lack > 0.0, lack + clearance, 0.0)
        pushed[interval] = at + (lack / np.maximum(square, 0.1))[:, None] * normal
    return pushed
