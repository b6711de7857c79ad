"""How a solve ended, and how far what it found is from the optimum."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Result(Enum):
    """How a solve ended; the value is a sentence for the user."""

    SOLVED = "The problem is solved to the tolerance asked for."
    ACCEPTABLE = "The solver stopped near a solution, at a looser tolerance."
    COARSE = "A solution is found, but the mesh does not reach the tolerance."
    INFEASIBLE = "No trajectory keeps all constraints near the one the search ended at."
    CONTRADICTION = "The bounds contradict each other before any search."
    ITERATION_LIMIT = "The solver used all its iterations."
    TIME_LIMIT = "The solver used all its time."
    UNBOUNDED = "The objective improves without limit; a bound is missing."
    DIVERGED = "The iterates grow without limit; a bound is missing."
    INVALID_NUMBER = "The problem's functions gave an invalid number."
    FAILED = "The solver failed for a reason of its own."

    @property
    def usable(self) -> bool:
        """Whether the trajectory satisfies the equations it was solved for."""
        return self in {Result.SOLVED, Result.ACCEPTABLE, Result.COARSE}


@dataclass(frozen=True, slots=True)
class ErrorEstimate:
    """How far a solution is from the true optimum, estimated a posteriori."""

    dynamics: float
    """Greatest distance, relative to each state's range, between the states and a
    re-integration of the clipped controls from the start of each interval."""
    shooting: float
    """The same for one integration from the start of each phase to its end."""
    path: float
    """Greatest violation of a path constraint between the nodes, in its scale."""
    objective: float
    """Estimated relative error of the objective."""
