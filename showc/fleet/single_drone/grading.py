"""Least time of one drone on graded meshes: the way that never fails to converge.

Grading (:class:`showc.ocp.Grading`) needs a new program for every move, but few
iterations whatever the move, yaw free or held.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.single_drone.guess import flat_guess
from showc.fleet.single_drone.intervals import END_GRADING, graded_widths
from showc.fleet.single_drone.model import USUAL_SCALES, single_problem

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.programs import Programs
    from showc.ocp.solution import Solution


FIRST = 24
"""Intervals of the first mesh."""
LONGER = 2.0
"""A change of the time by so much more than the tolerance still ends it: the last mesh
errs by half of what it changed, or less."""
ACCURACY = 5e-5
"""Wanted error of the flown controls over each state's range: what the flight must keep
is proved afterwards."""


@dataclass(frozen=True, slots=True)
class Kept:
    """Where a flight on a graded mesh keeps its limits: between points it exceeds them.

    The room for accelerations is the program's: see :meth:`Programs.leave`.
    """

    points: int
    """Least number of collocation points of an interval."""
    room: float
    """Share of the limits of acceleration left unused."""
    margin: float
    """Share of the range of each path constraint left unused; rotors have no other."""


def solve_on_graded_meshes(
    programs: Programs,
    start: FloatArray,
    goal: FloatArray,
    guessed: float,
    *,
    tolerance: float,
    effort: float,
    kept: Kept,
) -> Solution:
    """Fly from hover to hover in the least time.

    Parameters
    ----------
    programs
        Of the aircraft between these hovers; counts the work.
    start, goal
        Positions, shape (3,) [m].
    guessed
        Duration to start from [s].
    tolerance
        Wanted relative error of the time.
    effort
        Weight of the effort beside the time.
    kept
        Where limits are kept, and with how much room.

    Returns
    -------
    Solution
        States of degree ``kept.points`` or more, inputs linear on each interval.
    """
    # The core loads casadi, which checking a script must not.
    from showc.ocp.mesh import Mesh  # noqa: PLC0415
    from showc.ocp.refinement.constraint_generation import solve  # noqa: PLC0415
    from showc.ocp.refinement.graded import linear_mesh  # noqa: PLC0415
    from showc.ocp.refinement.options import Grading, Options  # noqa: PLC0415
    from showc.ocp.transcription.condensed.transcription import END  # noqa: PLC0415

    programs.leave(kept.room)
    aircraft = programs.aircraft
    scales = USUAL_SCALES.raised(float(np.linalg.norm((goal - start)[:3])), guessed)
    problem = single_problem(aircraft, minimum_time=True, scales=scales)
    phase, room = problem.phases[0], END * aircraft.vehicle.hover_thrust
    for (which, name), value in programs.thrusts.items():
        symbol = phase.controls[name].quantity.symbol
        there = phase.initial(symbol) if which == "start" else phase.final(symbol)
        problem.constrain_boundary(there, value - room, value + room)
    widths = graded_widths(guessed, FIRST, END_GRADING)
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    solution = solve(
        problem,
        guess=flat_guess(aircraft, start, goal, widths),
        parameters=programs.ends | {"effort": effort},
        options=Options.graded(
            LONGER * tolerance,
            grading=Grading(accuracy=ACCURACY, points=kept.points, margin=kept.margin),
            mesh=Mesh((linear_mesh(breaks, [kept.points] * FIRST, (), kept.margin),)),
        ),
    )
    programs.refined(solution, "graded towards both ends, where the attitude moves")
    return solution
