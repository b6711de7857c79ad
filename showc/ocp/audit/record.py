"""What an audit found, written down interval by interval."""

from __future__ import annotations

from typing import TYPE_CHECKING

from showc.ocp.history import Decision, IntervalRecord, PhaseRecord

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.ocp.audit.residuals import PhaseAudit
    from showc.ocp.solution import PhaseSolution


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
