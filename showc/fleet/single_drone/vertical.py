"""Launch and landing: every drone straight up or down, all on one profile.

A drone that stays upright is a point on a line whose acceleration lies between two
bounds. Where thrust may jump, the least time between two hovers is known in closed
form: full push, cruise at the greatest speed if it is reached, full brake (Bryson and
Ho 1975, Applied optimal control, section 3.9). Where jerk is limited, push and brake
are trapezoids of the acceleration, or triangles (Biagiotti and Melchiorri 2008,
Trajectory planning for automatic machines and robots, section 3.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.profile import integral
from showc.flight import Trajectory
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft


_HALVINGS = 60
"""Halvings of a speed: it is then found to the last bit."""
_ROUNDING = 1e-12
"""Way beyond the whole of it that is rounding."""


@dataclass(frozen=True, slots=True)
class Ramp:
    """A change of speed from rest to rest of the acceleration."""

    rise: float
    """Time in which the acceleration sets in, and in which it ends [s]."""
    plateau: float
    """Time between [s]."""

    @classmethod
    def quickest(cls, speed: float, acceleration: float, jerk: float) -> Ramp:
        """Reach a speed in the least time; a jerk of infinity lets thrust jump."""
        rise = min(acceleration / jerk, sqrt(speed / jerk))
        reached = acceleration if jerk == inf else rise * jerk
        return cls(rise, max(speed / reached - rise, 0.0))

    @property
    def duration(self) -> float:
        """Time of the whole [s]."""
        return 2.0 * self.rise + self.plateau

    def stretched(self, scale: float) -> Ramp:
        """Return the same shape, ``scale`` times as long."""
        return Ramp(scale * self.rise, scale * self.plateau)


@dataclass(frozen=True, slots=True)
class Ascent:
    """A profile s(t) from 0 to 1: push, cruise, brake; none of them negative."""

    push: Ramp
    """Speeding up."""
    cruise: float
    """Time at the greatest speed [s]."""
    brake: Ramp
    """Slowing down."""

    @property
    def duration(self) -> float:
        """Time of the whole [s]."""
        return self.push.duration + self.cruise + self.brake.duration

    def stretched(self, duration: float) -> Ascent:
        """Return the same shape over another ``duration`` [s]."""
        scale = duration / self.duration
        return Ascent(
            self.push.stretched(scale),
            scale * self.cruise,
            self.brake.stretched(scale),
        )

    def derivatives(self) -> tuple[PiecewisePolynomial, ...]:
        """Return s, s' [1/s] and s'' [1/s²] as piecewise polynomials, same breaks."""
        push, brake = self.push, self.brake
        speed = 1.0 / (0.5 * push.duration + self.cruise + 0.5 * brake.duration)
        up, down = (
            speed / (push.rise + push.plateau),
            speed / (brake.rise + brake.plateau),
        )
        pieces = [
            (width, first, last)
            for width, first, last in (
                (push.rise, 0.0, up),
                (push.plateau, up, up),
                (push.rise, up, 0.0),
                (self.cruise, 0.0, 0.0),
                (brake.rise, 0.0, -down),
                (brake.plateau, -down, -down),
                (brake.rise, -down, 0.0),
            )
            if width > 1e-9 * self.duration
        ]
        widths, *ends = (np.array(part) for part in zip(*pieces, strict=True))
        breaks = np.concatenate([[0.0], np.cumsum(widths)])
        breaks[-1] = self.duration
        pull = np.stack(ends, axis=1)
        if push.rise == brake.rise == 0.0:
            pull = pull[:, :1]
        rate = integral(pull, widths)
        share = integral(rate, widths)
        # Rounding leaves the end an ulp beside rest and 1.
        rate[-1, -1], share[-1, -1] = 0.0, 1.0
        return tuple(
            PiecewisePolynomial(breaks, part[..., None]) for part in (share, rate, pull)
        )


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
    jerk = least(limits.jerk or np.inf, limits.jerk or np.inf)

    def ramps(reached: float) -> tuple[Ramp, Ramp]:
        return Ramp.quickest(reached, push, jerk), Ramp.quickest(reached, brake, jerk)

    def gone(reached: float) -> float:
        """Way of both ramps."""
        return 0.5 * reached * sum(ramp.duration for ramp in ramps(reached))

    reached = min(speed, sqrt(2.0 / (1.0 / push + 1.0 / brake)))
    if gone(reached) > 1.0 + _ROUNDING:
        low = 0.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + reached)
            low, reached = (middle, reached) if gone(middle) < 1.0 else (low, middle)
        reached = low
    cruise = (1.0 - gone(reached)) / reached if reached == speed else 0.0
    first, last = ramps(reached)
    return Ascent(first, cruise, last)


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
        Exact: thrust constant on each of up to three intervals, positions quadratic;
        where jerk is limited linear and cubic, on up to seven.
    """
    vehicle = aircraft.vehicle
    share, rate, pull = ascent.derivatives()
    breaks, degree = share.breaks, share.degree
    rates = rate.elevated(degree).coefficients[..., 0]
    flights = []
    for begin, end in zip(start, goal, strict=True):
        state = np.zeros((share.intervals, degree + 1, 12))
        height = end[2] - begin[2]
        state[..., :2] = begin[:2]
        state[..., 2] = begin[2] + share.coefficients[..., 0] * height
        state[-1, -1, 2] = end[2]
        state[..., 5] = rates * height
        state[..., 8] = aircraft.heading
        control = np.zeros((share.intervals, pull.degree + 1, 4))
        push = vehicle.gravity + height * pull.coefficients[..., 0]
        control[..., 0] = vehicle.mass * push
        flights.append(
            Trajectory(
                PiecewisePolynomial(breaks, state), PiecewisePolynomial(breaks, control)
            )
        )
    return tuple(flights)
