"""Quick estimates of the minimum time of many drones, without solving."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft


def minimum_time_estimate(
    aircraft: Aircraft, start: FloatArray, goal: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Two estimates of the minimum time: a low one and a high one.

    Both take each axis on its own as a rest-to-rest move with bounded speed and
    acceleration. The low one lets full thrust lean at the greatest tilt, the high one
    flies level; neither is a proof.

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
    distance = np.abs(way)
    speed = np.where(way < 0.0, -np.array(limits.velocity_min), limits.velocity_max)
    greatest = min(limits.thrust_max, vehicle.thrust_max) / vehicle.mass
    climb = max(greatest - vehicle.gravity, 1e-3)
    drop = max(vehicle.gravity - limits.thrust_min / vehicle.mass, 1e-3)
    climb = min(climb, limits.acceleration_up or np.inf)
    drop = min(drop, limits.acceleration_down or np.inf)
    vertical = 2.0 / (1.0 / climb + 1.0 / drop)
    most = limits.acceleration or np.inf
    leaning = min(greatest * np.sin(limits.tilt), most)
    level = min(vehicle.gravity * np.tan(limits.tilt), most)
    turning = 2.0 * limits.tilt / min(limits.body_rate[:2])

    def slowest(horizontal: float) -> FloatArray:
        acceleration = np.array([horizontal, horizontal, vertical])
        # The acceleration sets in and ends as jerk allows.
        turns = acceleration / (limits.jerk or np.inf)
        turns = np.maximum(turns, [turning, turning, 0.0]) * (distance > 0.0)
        move = np.where(
            distance * acceleration > speed**2,
            distance / speed + speed / acceleration,
            2.0 * np.sqrt(distance / acceleration),
        )
        return np.asarray((move + turns).max(axis=1))

    return slowest(leaning), slowest(min(level, leaning))
