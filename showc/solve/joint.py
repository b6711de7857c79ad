"""A few drones planned with regard to each other from the start.

The core's :func:`showc.ocp.solve_agents` plans them in order of priority, each behind
planes between it and those before it. It takes optimal control for every drone, where
the repair of a large fleet takes splines for most, so it is for a few drones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.plan.metric import line_separation
from showc.solve.assembly import trajectory_of
from showc.solve.conflicts import conflicts
from showc.solve.grading import staged_form
from showc.solve.judgement import STILL, judge, refusal
from showc.solve.model import POSITION, single_problem
from showc.solve.tracks import tracks_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.flight import Trajectory
    from showc.solve.model import Aircraft
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]

FEW = 8
"""Greatest number of drones that are planned so."""
GAP = 0.003
"""Extra time over the slowest drone's least in which they are planned."""
LEISURE = 4.5
"""Time in which giving way costs little, over that of moving by the separation at a
constant 1 m/s²: below it, the repair's bent walls find shorter times."""
EFFORT = 1e-6
"""Weight of effort beside the time of the slowest drone."""


@dataclass(frozen=True, slots=True, eq=False)
class JointResult:
    """How planning several drones together ended."""

    duration: float
    """Common time, whole milliseconds [s]."""
    least: float
    """Least time of the slowest drone alone [s]; 0 if unknown."""
    trajectories: tuple[Trajectory, ...]
    """One for each drone, in order; empty unless solved."""
    message: str
    """What stood in the way; empty if solved."""
    groups: tuple[tuple[int, ...], ...] = ()
    """Drones that had to be planned with regard to each other."""
    solves: int = 0
    """Nonlinear programs solved at a common time."""

    @property
    def solved(self) -> bool:
        """Whether there are trajectories to fly."""
        return bool(self.trajectories)

    @property
    def method(self) -> str:
        """What was done, in words."""
        ordered = sum(map(len, self.groups))
        alone = len(self.trajectories) - ordered
        text = f"{ordered} drones planned together, in order of priority"
        return text + (f"; {alone} without regard to others" if alone else "")

    @property
    def counts(self) -> dict[str, float]:
        """Statistics for the certificate."""
        return {"joint_solves": float(self.solves)}


def suits(
    aircraft: Aircraft,
    separation: Separation,
    start: FloatArray,
    goal: FloatArray,
    least: float,
) -> bool:
    """Whether planning these drones together is better than repairing their ways.

    Measured to be so for a few drones with yaw free on ways of several seconds that
    cross: as little as half of the work, and less extra time. With yaw held the
    repair reaches the same time as quickly.

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m].
    least
        Least time of the slowest drone [s].
    """
    count = start.shape[0]
    if aircraft.yaw == "held" or not 2 <= count <= FEW:
        return False
    if separation.shape not in {"sphere", "ellipsoid"}:
        return False
    if np.linalg.norm(goal - start, axis=1).min() <= STILL:
        return False
    if least < LEISURE * np.sqrt(separation.distance):
        return False
    return line_separation(start, goal, separation) < separation.distance


def fly_jointly(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    separation: Separation,
    parked: FloatArray | None = None,
    *,
    gap: float = GAP,
) -> JointResult:
    """Fly a few drones from hover to hover in the least common time found, apart.

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m].
    separation
        Sphere or ellipsoid.
    parked
        Positions of drones that stand by, shape (m, 3) [m]: they are not planned
        around; a flight that comes too near one is no result.
    gap
        Extra time over the slowest drone's least, as a fraction.

    Returns
    -------
    JointResult
        If solved, every limit is kept at every instant, the controls fly each
        trajectory to 1 mm, and all drones are apart in continuous time.
    """
    # The core loads casadi, which checking a script must not.
    from showc.ocp import Agent, AgentsOptions, solve_agents  # noqa: PLC0415

    for drone, (a, b) in enumerate(zip(start, goal, strict=True)):
        if reason := refusal(aircraft, a, b):
            return JointResult(0.0, 0.0, (), f"drone {drone + 1}: {reason}")
    agents = []
    for a, b in zip(start.tolist(), goal.tolist(), strict=True):
        first, last = (
            dict(zip(POSITION, a, strict=True)),
            dict(zip(POSITION, b, strict=True)),
        )
        ends = {f"start_{axis}": value for axis, value in first.items()}
        ends |= {f"goal_{axis}": value for axis, value in last.items()}
        agents.append(Agent(first, last, ends | {"effort": EFFORT}))
    found = solve_agents(
        single_problem(aircraft, minimum_time=True),
        agents,
        position=POSITION,
        distance=separation.distance,
        metric=separation.metric_scale,
        options=AgentsOptions(gaps=(gap,), together=0, round_up=1e-3),
    )
    least = found.bound if np.isfinite(found.bound) else 0.0
    if not found.solved:
        return JointResult(0.0, least, (), found.message, solves=found.solves)
    duration = round(1000.0 * found.duration) / 1000.0
    flights = tuple(
        trajectory_of(aircraft, staged_form(solution), a, b, duration)
        for solution, a, b in zip(found.solutions, start, goal, strict=True)
    )
    for drone, flight in enumerate(flights):
        verdict = judge(aircraft, flight)
        if verdict.status != "solved":
            message = f"drone {drone + 1}: {verdict.message}"
            return JointResult(duration, least, (), message, solves=found.solves)
    near = conflicts(tracks_of(flights, parked), separation, separation.distance)
    if len(near):
        message = f"{len(near)} pairs come too near, parked drones among them"
        return JointResult(duration, least, (), message, solves=found.solves)
    return JointResult(duration, least, flights, "", found.groups, found.solves)
