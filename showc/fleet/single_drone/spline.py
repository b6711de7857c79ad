"""Flights off the straight line: splines in the flat outputs by convex programs.

Positions are B-splines of degree 5 on even intervals (four times continuously
differentiable, so torques are continuous). A convex program, linearised about the
iterate before, keeps the limits and the walls and stays as near as it can to a
reference. What it gives is judged by the true limits at every instant afterwards, so
the linearisation is never trusted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.flat import FlatFlights, fly, use_of_limits
from showc.fleet.single_drone.basis import DEGREE
from showc.fleet.single_drone.convex_program import NO_WALLS, Aim, Program, Walls
from showc.fleet.single_drone.judgement import leads
from showc.trajectory import restrict

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.trajectory import PiecewisePolynomial


_ITERATIONS = 6
"""Programs that are solved, each about the flight of the one before."""


@dataclass(frozen=True, slots=True, eq=False)
class SplineFlight:
    """A flight found, as positions and as the states and controls they imply."""

    breaks: FloatArray
    """Even borders, shape (K + 1,) [s]."""
    position: FloatArray
    """Bernstein coefficients, shape (K, 6, 3) [m]."""
    flight: FlatFlights
    """Of this one drone; its intervals are halves of the spline's."""


def follow_spline(  # noqa: PLR0917 - tasks of workers are tuples
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    reference: PiecewisePolynomial,
    intervals: int,
    walls: Walls = NO_WALLS,
) -> SplineFlight | None:
    """Fly from hover to hover, near ``reference``, on the right side of ``walls``.

    Parameters
    ----------
    start, goal
        Shape (3,) [m].
    reference
        Share of the way by time (one component), or positions (three) [m]; its end
        is the duration.
    intervals
        Intervals of the spline, all of one length.
    walls
        Kept as far as they can be: see :class:`Program`.

    Returns
    -------
    SplineFlight or None
        None if no such flight was found; otherwise all limits are kept at every
        instant, proved on Bernstein coefficients.
    """
    for about_way in (True, False):
        # About the way the first program is nearly the last. Where the way has corners
        # that no flight takes, level flight is a better beginning.
        program = Program(aircraft, start, goal, reference, intervals, walls)
        if about_way:
            program.relinearise(program.nearest())
        found = _iterated(aircraft, program)
        if found is not None:
            return found
    return None


def _iterated(aircraft: Aircraft, program: Program) -> SplineFlight | None:
    """Solve programs about one iterate after the other, until one keeps all limits."""
    aim = Aim()
    for _ in range(_ITERATIONS):
        position = program.solve(aim)
        if position is None:
            return None
        flight = _flown(aircraft, program.breaks, position)
        use = use_of_limits(aircraft.vehicle, aircraft.limits, flight)
        if use.greatest[0] <= 1.0:
            if not leads(aircraft.vehicle, [flight.trajectory(0)]).all():
                return None
            return SplineFlight(program.breaks, position, flight)
        aim = aim.corrected(use)
        program.relinearise(position)
    return None


def _flown(aircraft: Aircraft, breaks: FloatArray, position: FloatArray) -> FlatFlights:
    """States and controls; intervals halved, for attitudes are no polynomials."""
    half = np.full((position.shape[0], 1, 1), 0.5)
    parts = np.stack(
        [
            restrict(position, 0.0 * half, half),
            restrict(position, half, 2.0 * half),
        ],
        axis=1,
    ).reshape(1, -1, DEGREE + 1, 3)
    fine = np.linspace(0.0, breaks[-1], 2 * position.shape[0] + 1)
    return fly(aircraft.vehicle, aircraft.heading, fine, parts)
