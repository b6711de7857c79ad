"""Launch and landing: every drone straight up or down, all on one profile.

Thrust may jump, and a drone that stays upright is a point on a line whose acceleration
lies between two bounds. The least time between two hovers is then known in closed form:
full push, cruise at the greatest speed if it is reached, full brake (Bryson and Ho
1975, Applied optimal control, section 3.9).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.flight import Trajectory
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft


@dataclass(frozen=True, slots=True)
class Ascent:
    """A profile s(t) from 0 to 1: push, cruise, brake; none of them negative."""

    push: float
    """Time of speeding up [s]."""
    cruise: float
    """Time at the greatest speed [s]."""
    brake: float
    """Time of slowing down [s]."""

    @property
    def duration(self) -> float:
        """Time of the whole [s]."""
        return self.push + self.cruise + self.brake

    def stretched(self, duration: float) -> Ascent:
        """Return the same shape over another ``duration`` [s]."""
        scale = duration / self.duration
        return Ascent(scale * self.push, scale * self.cruise, scale * self.brake)


def vertical_accelerations(aircraft: Aircraft) -> tuple[float, float]:
    """Greatest acceleration upward and downward of an upright drone [m/s²]."""
    limits, vehicle = aircraft.limits, aircraft.vehicle
    most = min(limits.thrust_max, vehicle.thrust_max) / vehicle.mass
    up = min(most - vehicle.gravity, limits.acceleration_up or np.inf)
    least = limits.thrust_min / vehicle.mass
    return up, min(vehicle.gravity - least, limits.acceleration_down or np.inf)


def quickest_ascent(aircraft: Aircraft, heights: FloatArray) -> Ascent:
    """Find the quickest profile on which every drone keeps its limits.

    Parameters
    ----------
    heights
        Way of each drone, upward, shape (n,), not all zero [m].
    """
    limits = aircraft.limits
    up, down = vertical_accelerations(aircraft)
    rise, fall = max(float(heights.max()), 0.0), max(float(-heights.min()), 0.0)

    def least(rising: float, falling: float) -> float:
        """Greatest rate of s under two bounds per length of the way."""
        return min(
            rising / rise if rise else np.inf, falling / fall if fall else np.inf
        )

    speed = least(limits.velocity_max[2], -limits.velocity_min[2])
    push, brake = least(up, down), least(down, up)
    mean = 1.0 / push + 1.0 / brake
    reached = min(speed, np.sqrt(2.0 / mean))
    cruise = max(1.0 / reached - 0.5 * reached * mean, 0.0)
    return Ascent(reached / push, cruise, reached / brake)


def fly_upright(
    aircraft: Aircraft, start: FloatArray, goal: FloatArray, ascent: Ascent
) -> tuple[Trajectory, ...]:
    """Fly every drone on one profile, upright, x and y held.

    Parameters
    ----------
    start, goal
        Shape (n, 3) [m]; x and y of a drone are equal in both.

    Returns
    -------
    tuple of Trajectory
        Exact: positions quadratic, thrust constant on each of up to three intervals.
    """
    vehicle, duration = aircraft.vehicle, ascent.duration
    speed = 1.0 / (0.5 * ascent.push + ascent.cruise + 0.5 * ascent.brake)
    pieces = [
        (width, first, last)
        for width, first, last in (
            (ascent.push, 0.0, speed),
            (ascent.cruise, speed, speed),
            (ascent.brake, speed, 0.0),
        )
        if width > 1e-9 * duration
    ]
    widths, first, last = (np.array(part) for part in zip(*pieces, strict=True))
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    breaks[-1] = duration
    way = np.concatenate([[0.0], np.cumsum(0.5 * widths * (first + last))])
    # Rounding leaves the end an ulp beside 1.
    way[-1] = 1.0
    share = np.stack([way[:-1], way[:-1] + 0.5 * widths * first, way[1:]], axis=1)
    rate = np.stack([first, 0.5 * (first + last), last], axis=1)
    flights = []
    for begin, end in zip(start, goal, strict=True):
        state = np.zeros((widths.size, 3, 12))
        height = end[2] - begin[2]
        state[..., :2] = begin[:2]
        state[..., 2] = begin[2] + share * height
        state[-1, -1, 2] = end[2]
        state[..., 5] = rate * height
        state[..., 8] = aircraft.heading
        control = np.zeros((widths.size, 1, 4))
        push = vehicle.gravity + height * (last - first) / widths
        control[:, 0, 0] = vehicle.mass * push
        flights.append(
            Trajectory(
                PiecewisePolynomial(breaks, state), PiecewisePolynomial(breaks, control)
            )
        )
    return tuple(flights)
