"""Moving formations: flights of drones that follow a motion exactly enough.

The motion is no polynomial. On each interval the flight is the polynomial of degree
seven that agrees with it in position, velocity, acceleration and jerk at both ends
(Hermite interpolation): where the motion's eighth derivative is at most M it is off by
M h^8 / (2^8 8!). The error is measured between the ends and goes into the certificate.
Attitude and controls follow by differential flatness.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import comb, factorial
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.flat import SLACK, fly, use_of_limits
from showc.fleet.single_drone.judgement import (
    POSITION_ACCURACY,
    VELOCITY_ACCURACY,
    attitude_accuracy,
)
from showc.fleet.single_drone.replay import replay
from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.fleet.shared_profile.flat import FlatFlights, Use
    from showc.fleet.single_drone.model import Aircraft
    from showc.flight import Trajectory
    from showc.plan.itinerary import Leg

DEGREE = 7
"""Of positions: value and three derivatives meet at both ends of an interval."""
_WIDEST = 0.8
"""Width of intervals to begin with [s]: a quarter turn of the quickest motions."""
_HALVINGS = 5
"""How often intervals are halved at most: to a 32nd, where the error of polynomials of
degree seven is a trillionth of the first."""
_CLOSE = 1e-5
"""Error against the motion at which intervals are fine enough [m]: a hundredth of what
the verification allows."""
_INNER: FloatArray = np.array([0.25, 0.5, 0.75])
"""Fractions of an interval at which the error is measured."""
_SAFE = 0.5
"""Share of the accuracy of a replay that is used; the verification bounds it."""


@dataclass(frozen=True, slots=True, eq=False)
class MovingFlight:
    """What came of a motion."""

    trajectories: tuple[Trajectory, ...]
    """One for each drone of the leg."""
    flights: FlatFlights
    """The same as arrays."""
    use: Use
    """How much of each limit they use."""
    error: float
    """Greatest distance from the motion that was measured [m]."""
    missed: float
    """Greatest error of a replay of the controls, as a share of what a proof allows of
    position, velocity or attitude."""

    def trouble(self, drones: IntArray) -> str:
        """Say which limit the motion breaks, and what to do; empty if none.

        Parameters
        ----------
        drones
            Those of the leg, counting from 0, shape (n,).
        """
        use = self.use
        if use.outside.any():
            drone = drones[int(np.argmax(use.outside))] + 1
            return (
                f"drone {drone} leaves the flight volume during the motion; make the "
                "motion smaller, or move the formation"
            )
        parts = {
            "greatest speed": use.velocity,
            "greatest tilt": use.tilt,
            "greatest body rate": use.rate,
            "greatest thrust or torque": use.power,
            "greatest acceleration, jerk or level speed": use.acceleration,
        }
        name = max(parts, key=lambda one: float(parts[one].max()))
        row = int(np.argmax(parts[name]))
        if not np.isfinite(parts[name][row]):
            return (
                f"the thrust of drone {drones[row] + 1} would jump where the motion is "
                "joined or left: it rises or falls from rest there, which a limit of "
                "jerk leaves no time for; hold it a little longer or shorter"
            )
        if parts[name][row] > 1.0 + SLACK:
            return (
                f"drone {drones[row] + 1} would need {parts[name][row]:.2f} times the "
                f"{name} during the motion; let it take longer (`hold`, `period`, "
                "`ramp`), or make it smaller"
            )
        if use.weak.any():
            return "the motion asks for less thrust than there must be; make it slower"
        if not (self.error <= _CLOSE and self.missed <= 1.0):
            return (
                f"the motion is too quick to be followed: off by {self.error:.1e} m, "
                f"its controls by {self.missed:.2f} of what is allowed; make it slower"
            )
        return ""


def fly_motion(leg: Leg, aircraft: Aircraft, duration: float) -> MovingFlight:
    """Fly a leg's motion in a given time [s]; limits are for the caller to judge."""
    width = _WIDEST
    for _ in range(_HALVINGS):
        found = _flown(leg, aircraft, duration, width)
        if width < _TIGHT and found.use.greatest.max() > _HOPELESS:
            return found
        fine = found.error <= _CLOSE and found.missed <= _SAFE
        if fine and found.use.greatest.max() <= 1.0:
            return found
        width *= 0.5
    return found


_TIGHT = 0.3
"""Width of intervals whose coefficients enclose a flight tightly [s]."""
_HOPELESS = 1.3
"""Use of a limit that no narrower enclosure brings down to 1."""


def _flown(leg: Leg, aircraft: Aircraft, duration: float, width: float) -> MovingFlight:
    borders = np.unique(np.concatenate([one.borders(duration) for one in leg.motion]))
    # Borders nearer than rounding would make intervals of no width.
    borders = borders[np.concatenate([[True], np.diff(borders) > 1e-6])]
    borders[-1] = duration
    breaks = np.concatenate(
        [
            np.linspace(one, other, max(1, round((other - one) / width)) + 1)[:-1]
            for one, other in pairwise(borders)
        ]
        + [[duration]]
    )
    widths = np.diff(breaks)
    inner = (breaks[:-1, None] + widths[:, None] * _INNER).ravel()
    still = np.broadcast_to(
        leg.start[:, None, None, :], (leg.drones.size, widths.size, DEGREE + 1, 3)
    )
    position, error = still.copy(), 0.0
    basis = bernstein_basis(DEGREE, _INNER)
    for one in leg.motion:
        knots = one.derivatives(duration, breaks)
        pieces = _hermite(knots, widths)
        wanted = one.positions(duration, inner)
        flown = np.einsum("jk,nikc->ijnc", basis, pieces).reshape(wanted.shape)
        error = max(error, float(np.linalg.norm(flown - wanted, axis=-1).max()))
        position[one.rows] = pieces
    position[:, 0, 0], position[:, -1, -1] = leg.start, leg.goal
    flights = fly(aircraft.vehicle, aircraft.heading, breaks, position)
    trajectories = tuple(flights.trajectory(row) for row in range(leg.drones.size))
    use = use_of_limits(aircraft.vehicle, leg.limits, flights)
    missed = np.inf
    if use.greatest.max() <= _HOPELESS:
        replayed = replay(aircraft.vehicle, trajectories)
        turned = attitude_accuracy(aircraft.vehicle, duration)
        missed = max(
            float(replayed.position.max()) / POSITION_ACCURACY,
            float(replayed.velocity.max()) / VELOCITY_ACCURACY,
            float(replayed.attitude.max()) / turned,
        )
    return MovingFlight(trajectories, flights, use, error, missed)


def _hermite(knots: FloatArray, widths: FloatArray) -> FloatArray:
    """Bernstein coefficients (n, K, 8, 3) from derivatives (4, K + 1, n, 3) at knots.

    The k-th forward difference of the first coefficients is h^k f^(k) (7 - k)! / 7!,
    and of the last ones, backwards, the same with -h (Farouki 2012, section 5).
    """
    orders, count, drones, _ = knots.shape
    result = np.empty((drones, count - 1, DEGREE + 1, 3))
    for begin, sign in ((True, 1.0), (False, -1.0)):
        given = knots[:, :-1] if begin else knots[:, 1:]
        differences = [
            given[k]
            * (sign * widths[:, None, None]) ** k
            * (factorial(DEGREE - k) / factorial(DEGREE))
            for k in range(orders)
        ]
        for j in range(orders):
            value = sum(comb(j, k) * differences[k] for k in range(j + 1))
            result[:, :, j if begin else DEGREE - j] = np.swapaxes(value, 0, 1)
    return result
