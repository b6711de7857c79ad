"""Quick estimates of the minimum time of many drones, without solving."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.solve.model import Aircraft

    FloatArray = NDArray[np.float64]


def minimum_time_estimate(
    aircraft: Aircraft, start: FloatArray, goal: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Two estimates of the minimum time: a low one and a high one.

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m].

    Returns
    -------
    tuple of ndarray
        Each of shape (n,) [s].
    """
    limits, vehicle = aircraft.limits, aircraft.vehicle
    way = goal - start
    speed = np.where(way < 0.0, -np.array(limits.velocity_min), limits.velocity_max)
    level = vehicle.gravity * np.tan(limits.tilt)
    climb = limits.thrust_max / vehicle.mass - vehicle.gravity
    drop = vehicle.gravity - limits.thrust_min / vehicle.mass
    push = np.minimum(climb, drop)
    acceleration = np.array([level, level, push])
    distance = np.abs(way)
    ramp = np.where(
        distance * acceleration > speed**2,
        distance / speed + speed / acceleration,
        2.0 * np.sqrt(distance / acceleration),
    )
    turning = limits.tilt / min(limits.body_rate[:2])
    low = np.max(distance / speed, axis=1)
    return low, ramp.max(axis=1) + 2.0 * turning
