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

    Both take each axis on its own as a move with bounded speed and acceleration. The
    low one lets full thrust lean at the greatest tilt, the high one flies level;
    neither is a proof.

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m], or states, whose velocities count too.

    Returns
    -------
    tuple of ndarray
        Each of shape (n,) [s].
    """
    limits, vehicle = aircraft.limits, aircraft.vehicle
    way = (goal - start)[:, :3]
    leaving, arriving = (
        end[:, 3:6] if end.shape[1] > way.shape[1] else np.zeros_like(way)
        for end in (start, goal)
    )
    distance = np.abs(way)
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
        # Which way to push first: what a change of speed alone would cover decides.
        change = np.abs(arriving - leaving) / acceleration
        ahead = way >= 0.5 * (leaving + arriving) * change
        sign = np.where(ahead, 1.0, -1.0)
        bound = np.where(ahead, limits.velocity_max, -np.array(limits.velocity_min))
        far, first, last = sign * way, sign * leaving, sign * arriving
        squares = 0.5 * (first**2 + last**2)
        peak = np.sqrt(np.maximum(acceleration * far + squares, 0.0))
        speed = np.maximum(np.minimum(peak, bound), np.maximum(first, last))
        cruise = np.maximum(far - (speed**2 - squares) / acceleration, 0.0)
        cruise /= np.maximum(speed, 1e-9)
        move = (2.0 * speed - first - last) / acceleration + cruise
        return np.asarray((move + turns).max(axis=1))

    return slowest(leaning), slowest(min(level, leaning))
