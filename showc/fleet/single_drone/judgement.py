"""Whether a task makes sense before any search, and a trajectory after it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.single_drone.audit import Excess, greatest_excess
from showc.fleet.single_drone.model import POSITION
from showc.fleet.single_drone.replay import replay
from showc.fleet.single_drone.result import Result
from showc.ocp.refinement.strategy import Strategy

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from showc.arrays import BoolArray, FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.fleet.single_drone.programs import Programs
    from showc.fleet.single_drone.result import Status
    from showc.flight import Trajectory
    from showc.ocp.solution import Solution
    from showc.vehicle import Quadrotor


POSITION_ACCURACY = 4e-4
"""Greatest replay error [m]; a proof allows 5e-4."""
VELOCITY_ACCURACY = 2e-4
"""Greatest replay error of the velocity [m/s]; a proof allows 5e-4."""
ATTITUDE_ACCURACY = float(np.deg2rad(0.01))
"""Greatest replay error of roll, pitch and yaw [rad], however short the flight."""
_WINDOW = 20.0
"""Time [s] for which a proof flies on from one state."""
KEPT = 1e-9
"""Excess over a limit, relative to its range, that counts as rounding."""
STILL = 1e-9
"""Moves shorter than this are hovers [m]."""


def refusal(aircraft: Aircraft, start: FloatArray, goal: FloatArray) -> str:
    """Say why the task contradicts its limits before any search; empty if not."""
    if conflict := aircraft.conflict():
        return conflict
    lower = np.array(aircraft.limits.position_min)
    upper = np.array(aircraft.limits.position_max)
    for name, end in (("start", start), ("goal", goal)):
        place = end[:3]
        if not np.all(np.isfinite(end)):
            return f"the {name} {place.tolist()} is no position"
        outside = np.maximum(lower - place, place - upper)
        axis = int(np.argmax(outside))
        if outside[axis] > STILL:
            return (
                f"the {name} has {POSITION[axis]} = {place[axis]:.3f} m; the flight "
                f"volume allows {lower[axis]:.3f} to {upper[axis]:.3f} m"
            )
    return ""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What flying a trajectory again and auditing its limits has shown."""

    status: Status
    message: str = ""
    position_error: float = 0.0
    attitude_error: float = 0.0
    trajectory: Trajectory | None = None

    @property
    def found(self) -> str:
        """What came out, in words."""
        missed = f"the controls, flown, miss it by {1e3 * self.position_error:.2g} mm"
        return self.message or missed

    def result(self, programs: Programs, duration: float = 0.0) -> Result:
        """Return it as a result; only a solved one has its trajectory.

        ``duration`` is that of what is not solved [s].
        """
        flight = self.trajectory if self.status == "solved" else None
        if flight is not None:
            flight = replace(flight, meshes=tuple(programs.meshes))
            duration = flight.state.end
        return Result(
            self.status,
            duration,
            flight,
            self.message,
            self.position_error,
            self.attitude_error,
            programs.iterations,
            programs.solves,
            0 if flight is None else flight.state.intervals,
        )


class Flights(Strategy[Verdict]):
    """Condensed or graded solutions, one mesh after the other, each flown again.

    Parameters
    ----------
    programs
        Keeps what flying has shown.
    solutions
        On the meshes to try, the most promising first.
    judged
        Flies a solution and audits its limits.
    """

    def __init__(
        self,
        programs: Programs,
        solutions: Iterator[Solution],
        judged: Callable[[Solution], Verdict],
    ) -> None:
        self.programs, self.solutions, self.judged = programs, solutions, judged

    def begin(self) -> Verdict | None:
        """Return the first verdict; ``None`` if there is no mesh to try."""
        return self.step()

    def reached(self, current: Verdict) -> bool:
        """Whether the flight can be flown."""
        return current.status == "solved"

    def step(self, current: Verdict | None = None) -> Verdict | None:  # noqa: ARG002
        """Solve the next mesh and fly what comes of it."""
        solution = next(self.solutions, None)
        if solution is None:
            return None
        if not solution.result.usable:
            return Verdict("infeasible", solution.message)
        verdict = self.judged(solution)
        self.programs.found(verdict.found)
        return verdict


def attitude_accuracy(vehicle: Quadrotor, duration: float) -> float:
    """Greatest replay error of roll, pitch and yaw [rad] over a ``duration`` [s].

    A proof allows for full thrust along either of two angles that are wrong throughout:
    within t seconds their sum moves a drone by t² / 2 times that acceleration at most.
    """
    push, time = vehicle.thrust_max / vehicle.mass, min(duration, _WINDOW)
    return min(ATTITUDE_ACCURACY, POSITION_ACCURACY / (push * time**2))


def leads(vehicle: Quadrotor, trajectories: Sequence[Trajectory]) -> BoolArray:
    """Whether the controls of each lead along its path, as near as a proof wants."""
    flown = replay(vehicle, trajectories)
    times = [trajectory.state.end for trajectory in trajectories]
    turned = np.array([attitude_accuracy(vehicle, time) for time in times])
    near = flown.position <= POSITION_ACCURACY
    near &= flown.velocity <= VELOCITY_ACCURACY
    return np.asarray(near & (flown.attitude <= turned))


def judge(aircraft: Aircraft, trajectory: Trajectory) -> Verdict:
    """Fly a trajectory again and audit its limits."""
    flown = replay(aircraft.vehicle, [trajectory])
    missed, turned = float(flown.position[0]), float(flown.attitude[0])
    slipped = float(flown.velocity[0])
    allowed = attitude_accuracy(aircraft.vehicle, trajectory.state.end)
    worst: Excess = greatest_excess(aircraft, trajectory)
    status: Status = "solved"
    message = ""
    if worst.relative > KEPT:
        status = "infeasible"
        message = (
            f"{worst.name} is {worst.amount:.3g} outside its limit near "
            f"{worst.time:.2f} s"
        )
    elif missed > POSITION_ACCURACY or slipped > VELOCITY_ACCURACY or turned > allowed:
        status = "inaccurate"
        message = (
            f"the controls miss the trajectory by {1e3 * missed:.3g} mm, "
            f"{1e3 * slipped:.3g} mm/s and {np.rad2deg(turned):.3g} deg; wanted "
            f"{1e3 * POSITION_ACCURACY:.3g} mm, {1e3 * VELOCITY_ACCURACY:.3g} mm/s "
            f"and {np.rad2deg(allowed):.3g} deg"
        )
    return Verdict(status, message, missed, turned, trajectory)
