"""Straight flights that share a profile, and what drones off their line fly near to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from showc.fleet.shared_profile.flat import FlatFlights, fly

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.shared_profile.profile import Profile
    from showc.trajectory import PiecewisePolynomial
    from showc.vehicle import Quadrotor


def fly_straight(
    vehicle: Quadrotor,
    heading: float,
    start: FloatArray,
    goal: FloatArray,
    profile: Profile,
) -> FlatFlights:
    """Trajectories of drones that fly straight along one profile, yaw held.

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m].
    """
    way = profile.derivatives()[0]
    position = (
        start[:, None, None, :] + way.coefficients * (goal - start)[:, None, None, :]
    )
    # Not start + (goal - start), which rounds.
    position[:, -1, -2:] = goal[:, None, :]
    return fly(vehicle, heading, way.breaks, position)


def followed(
    reference: PiecewisePolynomial,
    start: FloatArray,
    goal: FloatArray,
    times: FloatArray,
) -> FloatArray:
    """Positions of a reference at times (...), shape (..., 3) [m].

    It is the share of the straight way from start to goal (one component), or a
    position (three).
    """
    values = reference(times)
    return values if reference.components == 3 else start + values * (goal - start)
