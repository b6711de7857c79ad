"""How a mesh came about: what was found on each interval, and what was done there.

An adaptive solve keeps one :class:`MeshRecord` for each nonlinear program it solved.
A record holds the mesh as it lies in time, the estimated errors of every interval, and
the decision of the refinement on that interval with its reason.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from showc.ocp.outcome import ErrorEstimate, Result


class Step(Enum):
    """What the refinement does to one interval; the value says it in words."""

    KEPT = "kept as it is"
    CUT = "cut into several intervals"
    RAISED = "given a higher degree"
    MERGED = "merged with the interval before"
    CONSTRAINED = "path constraint held at more places"
    SWITCH = "border of an arc placed"
    GRADED = "borders laid anew by what it loses"


@dataclass(frozen=True, slots=True)
class Decision:
    """What is done to one interval, and why."""

    step: Step = Step.KEPT
    reason: str = ""
    """Why, with the figure that decided; empty where nothing is done."""
    constraint: str = ""
    """The path constraint found violated between its points; empty if none."""

    def undone(self) -> Decision:
        """Return that this was tried and led to nothing better."""
        reason = f"{self.reason} (tried, no better)" if self.reason else ""
        return Decision(Step.KEPT, reason, self.constraint)

    def after(self, earlier: Decision) -> Decision:
        """Return this decision with an ``earlier`` one on the same interval."""
        reasons = [reason for reason in (earlier.reason, self.reason) if reason]
        return Decision(
            earlier.step if self.step is Step.KEPT else self.step,
            "; ".join(reasons),
            self.constraint or earlier.constraint,
        )


@dataclass(frozen=True, slots=True)
class IntervalRecord:
    """One interval of a mesh that was solved."""

    start: float
    """Time of its left border, in the problem's unit of time."""
    end: float
    """Time of its right border."""
    points: int
    """Number of collocation points, which is the degree of its states."""
    dynamics: float | None
    """Error of the states against a re-integration, over their range; ``None`` in
    the three errors: the mesh was not audited."""
    objective: float | None
    """Its share of the objective's relative error."""
    path: float | None
    """Greatest violation of a path constraint between its points, over its scale."""
    decision: Decision

    @property
    def error(self) -> float | None:
        """Greatest of its three errors."""
        found = [e for e in (self.dynamics, self.objective, self.path) if e is not None]
        return max(found) if found else None


@dataclass(frozen=True, slots=True)
class PhaseRecord:
    """The mesh of one phase."""

    name: str
    intervals: tuple[IntervalRecord, ...]
    switches: tuple[float, ...]
    """Times of the borders between its arcs, which are unknowns of the problem."""


@dataclass(frozen=True, slots=True)
class MeshRecord:
    """One pass of the refinement: one nonlinear program on one mesh."""

    intervals: int
    points: int
    objective: float
    iterations: int
    result: Result
    error: ErrorEstimate | None
    action: str
    """What the refinement did next, and why."""
    phases: tuple[PhaseRecord, ...] = ()
    """The mesh as it lay in time, interval by interval."""
