"""What solving one drone takes and gives; plain data that processes can exchange."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from showc.flight import Trajectory

Status = Literal["solved", "infeasible", "inaccurate", "limit"]


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """How a solve ended, in data and in a sentence.

    ``solved``: the trajectory is flyable and keeps every limit.
    ``infeasible``: none was found that does. ``inaccurate``: one was found, but its
    controls do not fly it closely enough even on the finest mesh. ``limit``: limits
    contradict the task before any search (a hover outside the volume, say).
    """

    status: Status
    duration: float
    """Time of the flight asked for, or found [s]."""
    trajectory: Trajectory | None
    """From time 0 to ``duration``; ``None`` unless solved."""
    message: str = ""
    """Which constraint stood in the way, where, and what to do; empty if solved."""
    position_error: float = 0.0
    """Greatest distance between the controls integrated and the polynomials [m]."""
    attitude_error: float = 0.0
    """The same for roll, pitch, yaw [rad]."""
    iterations: int = 0
    """Iterations of the nonlinear programming solver, all solves together."""
    solves: int = 0
    """Nonlinear programs solved."""
    intervals: int = 0
    """Mesh intervals of the trajectory."""

    @property
    def solved(self) -> bool:
        """Whether there is a trajectory to fly."""
        return self.status == "solved"
