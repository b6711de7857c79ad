"""What a solved mesh is worth: errors, and where they come from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit.optimality import objective_size
from showc.ocp.outcome import ErrorEstimate
from showc.ocp.refinement.options import BOUNDARY_SHARE, CAUTION, VAGUE
from showc.ocp.refinement.refine import not_helped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray
    from showc.ocp.audit.residuals import PhaseAudit, PhaseAuditor
    from showc.ocp.problem import Problem
    from showc.ocp.refinement.attempts import Attempts
    from showc.ocp.refinement.switches import Structure
    from showc.ocp.solution import PhaseSolution, Solution
    from showc.ocp.transcription.collocation.statement import Table
    from showc.ocp.transcription.collocation.transcription import Transcription


DISTRUST = 3e-5
"""Least share of the estimated loss that counts whatever the objective moved: what
refinement does not move may still be missed (seen on a control with a jump)."""
HUGE = 1e200
"""Errors beyond this count as one: over a tolerance they stay finite."""


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """One solved and audited mesh."""

    solution: Solution
    audits: tuple[PhaseAudit, ...]
    error: ErrorEstimate
    shares: tuple[FloatArray, ...]
    """Share of each interval in the objective's relative error, phase by phase."""
    indicators: tuple[FloatArray, ...] = ()
    """Error over tolerance of each interval, phase by phase."""
    suspects: tuple[BoolArray, ...] = ()
    """Intervals whose share of the objective's error is too great if the estimate is
    taken as it is, phase by phase."""
    must_cut: tuple[BoolArray, ...] = ()
    """Intervals whose error is that of a control of given degree, phase by phase."""
    stubborn: tuple[BoolArray, ...] = ()
    """Intervals whose dynamics a higher degree did not help, phase by phase."""
    structures: tuple[Structure | None, ...] = ()
    """The arcs the mesh was made for, phase by phase; empty: none were looked for."""
    moved: float = 0.0
    """Relative change of the objective since the mesh before."""
    flattery: float = 0.0
    """By how much the objective may be better than the truth, relative: it costs this
    much to mend dynamics and path constraints between the nodes."""
    quadrature: float = 0.0
    """Part of that by which points misjudge integrals, relative."""
    program: Transcription | None = None
    """What was solved."""

    @property
    def greatest(self) -> float:
        """Greatest of the errors."""
        error = self.error
        return max(error.dynamics, error.path, error.objective)

    @property
    def merit(self) -> float:
        """Order of solutions: the greatest error, the objective's with caution."""
        error = self.error
        return max(error.dynamics, error.path, error.objective / CAUTION)


def judge(
    attempts: Attempts,
    auditors: Sequence[PhaseAuditor],
    solution: Solution,
    former: Judgement | None,
    structures: Sequence[Structure | None],
    *,
    mended: bool,
) -> Judgement:
    """Audit the latest solution of ``attempts`` and turn the errors into indicators.

    The dual-weighted estimate of the objective's error is an upper bound in practice;
    where all flagged intervals have just been refined (``former`` is the mesh before,
    ``mended``) and the objective hardly moved, twice the greater of the last two moves
    is the better estimate. Not so where the solver found nothing to do, which its
    tolerance may hide; nor for a control that is held at its bound on an arc of
    ``structures``, or in another valley of the Hamiltonian than the lowest: no
    refinement moves it, whatever is lost by that.
    """
    problem, table = attempts.problem, attempts.table
    tolerance = attempts.options.tolerance
    audits = tuple(a.audit(solution, table) for a in auditors)
    size = objective_size(solution)
    if problem.aimless:
        # Nothing can be lost; what the solver's multipliers say is noise.
        solution = replace(solution, slack=0.0)
        audits = tuple(audit.without_objective() for audit in audits)
        size = np.inf
    lost = [
        a.objective_dynamics
        + a.objective_control
        + a.beside
        + p.bound_gaps.sum(axis=1)
        + _path_cost(auditor, p, table, np.asarray(p.mesh.path_margins) + a.path)
        for auditor, a, p in zip(auditors, audits, solution.phases, strict=True)
    ]
    flattery = sum(
        float(np.sum(a.objective_dynamics + _path_cost(auditor, p, table, a.path)))
        for auditor, a, p in zip(auditors, audits, solution.phases, strict=True)
    )
    held = [
        _held(a, p, s)
        for a, p, s in zip(audits, solution.phases, structures, strict=True)
    ]
    total = sum(float(part.sum()) for part in lost) / size
    stuck = sum(float(part.sum()) for part in held) / size
    weight, move = 1.0, 0.0
    if former is not None:
        move = abs(solution.objective - former.solution.objective) / size
        moved = 2.0 * max(move, former.moved)
        told = mended and solution.iterations > 0 and _was_mended(former, solution)
        if told and moved < total:
            weight = max(moved / total, DISTRUST)
    indicators, suspects = [], []
    counted = [weight * (p - h) + h for p, h in zip(lost, held, strict=True)]
    estimate = weight * (total - stuck) + stuck
    for a, part, taken in zip(audits, lost, counted, strict=True):
        each = len(part) / (2.0 * CAUTION) / size
        suspects.append(part * each > tolerance)
        # What presses beside a constraint tells little before it is kept.
        share = (taken - np.where(a.path > tolerance, weight * a.beside, 0.0)) * each
        # Where a constraint is active all along, more points of it would only
        # contradict each other: a finer polynomial keeps it better.
        along = np.where(a.path_active > BOUNDARY_SHARE, a.path, 0.0)
        worst = np.maximum(np.maximum(a.dynamics, share), along)
        indicators.append(np.minimum(worst, HUGE) / tolerance)
    top = max(float(part.max()) for part in indicators)
    if estimate > CAUTION * tolerance and 0.0 < top <= 1.0:
        # Many small shares add up to too much: the greatest are the ones to mend.
        indicators = [1.5 * part / top for part in indicators]
    left_open = solution.slack / sum(part.size for part in lost)
    error = ErrorEstimate(
        max(float(a.dynamics.max()) for a in audits),
        0.0,
        max(float(a.path.max()) for a in audits),
        estimate + solution.slack / size,
    )
    must_cut = tuple(
        _limited(problem, solution, i, audit, tolerance)
        for i, audit in enumerate(audits)
    )
    return Judgement(
        solution,
        audits,
        error,
        tuple((part + left_open) / size for part in counted),
        tuple(indicators),
        tuple(suspects),
        must_cut,
        () if former is None else _stubborn(solution, audits, former),
        tuple(structures),
        moved=move,
        flattery=flattery / size,
        quadrature=sum(float(a.quadrature.sum()) for a in audits) / size,
        program=attempts.latest,
    )


def _held(
    audit: PhaseAudit, part: PhaseSolution, structure: Structure | None
) -> FloatArray:
    """Gap by controls that no refinement moves, in the objective's unit, shape (K,).

    Not where a state is at its bound: costates may jump there, and a finer mesh tells
    them better.
    """
    found = np.asarray(audit.by_control[-1] * audit.clear)
    if structure is not None:
        held = structure.fixed[list(part.mesh.arcs)].T & audit.clear
        found += (audit.by_control[:-2] * held).sum(axis=0)
    return found


def _stubborn(
    solution: Solution, audits: Sequence[PhaseAudit], former: Judgement
) -> tuple[BoolArray, ...]:
    """Find intervals whose error a higher degree did not help since ``former``."""
    size = objective_size(solution)
    return tuple(
        not_helped(new.mesh, _own(audit, size), old.mesh, _own(before, size))
        for new, audit, old, before in zip(
            solution.phases,
            audits,
            former.solution.phases,
            former.audits,
            strict=True,
        )
    )


def _own(audit: PhaseAudit, size: float) -> FloatArray:
    """Error of each interval, of its dynamics or its controls, shape (K,)."""
    share = audit.objective_control / size * len(audit.dynamics) / 2.0
    return np.maximum(audit.dynamics, share)


def _path_cost(
    auditor: PhaseAuditor, part: PhaseSolution, table: Table, amounts: FloatArray
) -> FloatArray:
    """Multipliers of path constraints times the scaled ``amounts`` by which they move.

    Shapes (K,), amounts and result.
    """
    mesh = part.mesh
    if not np.any(amounts):
        return np.zeros(mesh.intervals)
    scale = auditor.path_scales(table)
    force = np.abs(part.path_multipliers) @ scale
    owner = np.repeat(np.arange(mesh.intervals), mesh.points)
    mean = np.bincount(owner, weights=force) / np.asarray(mesh.points)
    return np.asarray(mean * np.diff(part.states.breaks) * amounts)


def _was_mended(former: Judgement, solution: Solution) -> bool:
    """Whether the refinement since ``former`` touched what it had flagged.

    Raising the points of an interval does nothing for a control of given degree.
    """
    return all(
        new.intervals > old.intervals or not limited.any()
        for new, old, limited in zip(
            solution.mesh.phases,
            former.solution.mesh.phases,
            former.must_cut,
            strict=True,
        )
    )


def _limited(
    problem: Problem,
    solution: Solution,
    index: int,
    audit: PhaseAudit,
    tolerance: float,
) -> BoolArray:
    """Intervals whose error is the control's, where its degree is given."""
    part, phase = solution.phases[index], problem.phases[index]
    chosen = part.mesh.control_degrees
    given = any(
        control.degree is not None or min(chosen.get(name, (-1,))) >= 0
        for name, control in phase.controls.items()
    )
    size = objective_size(solution)
    share = audit.objective_control / size * len(audit.dynamics) / 2.0
    return np.asarray((share > np.maximum(audit.dynamics, tolerance)) & given)


def is_worse(problem: Problem, solution: Solution, former: Judgement) -> bool:
    """Whether the objective got worse than the errors of ``former`` explain."""
    error = former.error
    if error.dynamics > 1e-3 or error.path > 1e-3:
        return False
    sign = -1.0 if problem.maximises else 1.0
    loss = sign * (solution.objective - former.solution.objective)
    size = objective_size(former.solution)
    left_open = former.solution.slack / size
    allowed = max(1e-5, 10.0 * error.dynamics, 3.0 * error.path, 3.0 * left_open)
    # No multiplier is in what points misjudge of an integral.
    allowed = max(allowed, 3.0 * former.quadrature)
    # Where ends repeat what the dynamics keep (a quaternion's norm), multipliers may be
    # anything: an estimate that is so great tells nothing.
    if former.flattery <= VAGUE:
        allowed = max(allowed, 3.0 * former.flattery)
    return bool(loss / size > allowed)


def refutes(problem: Problem, fresh: Judgement, former: Judgement) -> bool:
    """Whether ``fresh`` is better than the estimated error of ``former`` allows."""
    sign = -1.0 if problem.maximises else 1.0
    gain = sign * (former.solution.objective - fresh.solution.objective)
    size = objective_size(former.solution)
    return bool(gain / size > former.error.objective + 2.0 * fresh.flattery)
