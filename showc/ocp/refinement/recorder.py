"""Keeping the history of an adaptive solve while it is made."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from showc.ocp.history import Decision, IntervalRecord, MeshRecord, PhaseRecord

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.ocp.audit.residuals import PhaseAudit
    from showc.ocp.refinement.judgement import Judgement
    from showc.ocp.refinement.proposal import Proposal
    from showc.ocp.solution import PhaseSolution, Solution


class Recorder:
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
