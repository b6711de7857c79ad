"""How a mesh came about: what was found on each interval, and what was done there.

An adaptive solve keeps one :class:`MeshRecord` for each nonlinear program it solved.
A record holds the mesh as it lies in time, the estimated errors of every interval, and
the decision of the refinement on that interval with its reason.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.ocp.adaptive.judgement import Judgement
    from showc.ocp.adaptive.proposal import Proposal
    from showc.ocp.audit.residuals import PhaseAudit
    from showc.ocp.solution import ErrorEstimate, PhaseSolution, Result, Solution


class Step(Enum):
    """What the refinement does to one interval; the value says it in words."""

    KEPT = "kept as it is"
    CUT = "cut into several intervals"
    RAISED = "given a higher degree"
    MERGED = "merged with the interval before"
    CONSTRAINED = "path constraint held at more places"
    SWITCH = "border of an arc placed"


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


def phase_record(
    part: PhaseSolution,
    audit: PhaseAudit | None,
    shares: Sequence[float] | None,
    decisions: Sequence[Decision] | None,
) -> PhaseRecord:
    """Record of one phase of a solution.

    Parameters
    ----------
    part
        The phase as solved.
    audit
        Its audit; ``None`` if there was none.
    shares
        Each interval's share of the objective's relative error, shape (K,).
    decisions
        What is done next, interval by interval; ``None``: nothing.
    """
    breaks = [float(time) for time in part.states.breaks]
    arcs = part.mesh.arcs
    intervals = tuple(
        IntervalRecord(
            breaks[k],
            breaks[k + 1],
            part.mesh.points[k],
            None if audit is None else float(audit.dynamics[k]),
            None if shares is None else float(shares[k]),
            None if audit is None else float(audit.path[k]),
            Decision() if decisions is None else decisions[k],
        )
        for k in range(part.mesh.intervals)
    )
    borders = [breaks[k] for k in range(1, len(arcs)) if arcs[k] != arcs[k - 1]]
    return PhaseRecord(part.name, intervals, tuple(borders))


class History:
    """The records of one adaptive solve, as they are written.

    Parameters
    ----------
    progress
        Called with every record.
    """

    def __init__(self, progress: Callable[[MeshRecord], None] | None = None) -> None:
        self.records: list[MeshRecord] = []
        self.progress = progress
        self._seen: list[Solution] = []

    def knows(self, solution: Solution) -> bool:
        """Whether ``solution`` has a record already."""
        return any(solution is seen for seen in self._seen)

    def note(
        self, solution: Solution, judged: Judgement | None, action: str | Proposal
    ) -> None:
        """Write one line of the history.

        ``judged``: the judgement of ``solution``, if it was audited; ``action``: the
        proposal that follows, or a sentence.
        """
        words = action if isinstance(action, str) else action.words
        phases = tuple(
            phase_record(
                part,
                None if judged is None else judged.audits[i],
                None if judged is None else judged.shares[i].tolist(),
                None if isinstance(action, str) else action.decisions[i],
            )
            for i, part in enumerate(solution.phases)
        )
        record = MeshRecord(
            solution.mesh.interval_count,
            solution.mesh.point_count,
            solution.objective,
            0 if self.knows(solution) else solution.iterations,
            solution.result,
            None if judged is None else judged.error,
            words,
            phases,
        )
        self.records.append(record)
        self._seen.append(solution)
        if self.progress is not None:
            self.progress(record)

    def amend(self, number: int, proposal: Proposal) -> None:
        """Write into a line of the history what was done after a trial that failed."""
        record = self.records[number]
        phases = tuple(
            replace(
                phase,
                intervals=tuple(
                    replace(interval, decision=new.after(interval.decision.undone()))
                    for interval, new in zip(phase.intervals, chosen, strict=True)
                ),
            )
            for phase, chosen in zip(record.phases, proposal.decisions, strict=True)
        )
        words = f"{record.action}; that was no better, so {proposal.words}"
        self.records[number] = replace(record, action=words, phases=phases)
