"""Grading: meshes with borders where controls of low degree cost the objective most.

Controls linear on each interval keep their bounds at every instant and can be flown as
they are. A coarse even mesh comes first; each mesh after it has more intervals, with
borders where the last solution loses most, and starts from it. For problems whose
controls jump, or ride on state constraints, this is near the optimum in a few quick
solves; it does not reach the accuracy of hp-refinement on smooth ones.

On intervals of width h_k let G_k be the integral of the gap in Pontryagin's principle
(:mod:`showc.ocp.audit.residuals`) and V_k the variation of the controls over their
ranges. The mesh is dense where

    d_k = floor + (1 - floor) ((1 - m) sqrt(G_k) / (h_k g) + m V_k / (h_k v))

is great, g and v being the means of sqrt(G) / h and V / h over the phase; the new
borders give every interval the same share of its integral (equidistribution: de Boor
1973, Good approximation by splines with variable knots; Huang, Russell 2011, Adaptive
moving mesh methods, chapter 2). A switch inside an interval costs about h², so
sqrt(G) / h is the same before and after a cut and the mesh settles; the variation keeps
intervals at switches that are resolved already.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit.optimality import objective_size
from showc.ocp.history import Decision, Step
from showc.ocp.mesh import Mesh, PhaseMesh
from showc.ocp.outcome import ErrorEstimate, Result
from showc.ocp.refinement.collocated import Collocated
from showc.ocp.refinement.judgement import Judgement
from showc.ocp.refinement.options import Grading
from showc.ocp.refinement.proposal import Proposal
from showc.ocp.transcription.collocation.statement import Statement
from showc.ocp.transcription.collocation.transcription import SHARE

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.ocp.audit.residuals import PhaseAudit, PhaseAuditor
    from showc.ocp.guess import Guess
    from showc.ocp.refinement.attempts import Attempts
    from showc.ocp.solution import PhaseSolution, Solution


_STARTS: tuple[tuple[int, dict[str, object]], ...] = (
    (0, {}),
    (0, {"mu_strategy": "adaptive"}),
    (1, {"mu_strategy": "adaptive"}),
    (2, {"mu_init": 1.0, "mu_linear_decrease_factor": 0.5}),
)
"""Ways to start, tried one after the other: which of the meshes, and how."""
_QUICK: dict[str, object] = {
    "mu_strategy": "monotone",
    "mu_linear_decrease_factor": 0.2,
    "mu_superlinear_decrease_power": 1.5,
    # Scaled from bounds already; and METIS, which MUMPS takes for larger systems,
    # gives twice the work on these long thin ones.
    "mumps_permuting_scaling": 0,
    "mumps_scaling": 0,
    "mumps_pivot_order": 2,
    "max_soc": 0,
    # Residuals are looked at all the same, and refined where they are too great.
    "min_refinement_steps": 0,
    # The optimum need not be sharp, but what is flown must be.
    "constr_viol_tol": 1e-8,
}
_NEAR = 1e-3
"""First barrier parameter where a solution on another mesh is known."""
_ROUGHLY = 1e-4
"""Solver's tolerance on meshes that only tell the next one where to be fine."""
_STILL = 1e-2
"""Range over its scale below which a state counts as one that hardly moves: its errors
are relative to this range then."""
_PACE = 4.0
"""Power of the number of intervals by which the objective's error is taken to fall: 4
to 6 were measured while arcs are being found, 2 is that of linear controls after it."""
_LEAST_SHARE = 0.1
"""Least share of the estimated loss that counts as lost; 0.15 to 0.3 were measured."""
_REPAIRS = 3
"""Times that the last mesh is mended, each halving the error or being the last."""
FLOOR = 0.2
"""Share of the intervals that is spread evenly."""
VARIATION = 0.3
"""Weight m of the controls' variation."""
DECAY = 0.5
"""Least ratio of the densities of neighbours: what was found is known to no better
than an interval."""


class Graded(Collocated):
    """Refinement by grading; ``options.grading`` says how."""

    def __init__(self, attempts: Attempts, guess: Guess | Solution | None) -> None:
        super().__init__(attempts, guess)
        self.grading = self.options.grading or Grading()
        scales = Statement(self.problem).scales({}).states
        for auditor, scale in zip(self.auditors, scales, strict=True):
            auditor.least_range = _STILL * scale
        self._counts = list(self.grading.intervals[1:])
        self._before, self._repairs = np.inf, 0

    def _attempt(
        self, mesh: Mesh, guess: Guess | Solution | None, extra: dict[str, object]
    ) -> Solution:
        """Solve on one mesh."""
        solver = self.options.solver
        chosen = replace(solver, extra={**_QUICK, **extra, **solver.extra})
        return self.attempts.attempt(mesh, guess, solver=chosen)

    def first(self) -> Solution:
        """Solve the first mesh, by other ways where the plain one fails."""
        counts = self.grading.intervals
        rough: dict[str, object] = {"tol": _ROUGHLY} if len(counts) > 1 else {}
        for number, way in _STARTS:
            mesh = self._even(counts[min(number, len(counts) - 1)])
            if number == 0 and self.options.mesh is not None:
                mesh = self.options.mesh
            solution = self._attempt(mesh, self.guess, {**way, **rough})
            usable = solution.result.usable
            if usable or solution.result is Result.CONTRADICTION:
                break
            self.history.note(solution, None, "the solver failed; another way is tried")
        return solution

    def start(self, solution: Solution) -> Judgement:
        """Judge the first solution."""
        return self._judged(solution, None)

    def _judged(
        self, solution: Solution, former: Judgement | None, rough: float = 0.0
    ) -> Judgement:
        """Audit a solution; ``rough`` is what the solver's tolerance left open."""
        size, table = objective_size(solution), self.attempts.table
        audits = [auditor.audit(solution, table) for auditor in self.auditors]
        shares = tuple(
            _lost(part, audit) / size
            for part, audit in zip(solution.phases, audits, strict=True)
        )
        missing = max(_missing(solution, shares, former), rough)
        if self.problem.aimless:
            missing = 0.0
        if missing <= self.options.tolerance or not self._counts:
            # It may be the last: its controls are to be flown.
            audits = [
                auditor.shot(audit, solution, table)
                for auditor, audit in zip(self.auditors, audits, strict=True)
            ]
        error = ErrorEstimate(
            max(float(audit.dynamics.max()) for audit in audits),
            max(audit.shooting for audit in audits),
            max(float(audit.path.max()) for audit in audits),
            missing,
        )
        program = self.attempts.latest
        return Judgement(solution, tuple(audits), error, shares, program=program)

    def reached(self, current: Judgement) -> bool:
        """Whether the objective has settled and its controls can be flown."""
        error = current.error
        flyable = max(error.shooting, error.path) <= self.grading.accuracy
        return flyable and error.objective <= self.options.tolerance

    def step(self, current: Judgement) -> Judgement | None:
        """Solve a mesh graded by what the last one loses; mend the last."""
        while self._counts and current.error.objective > self.options.tolerance:
            proposal = self._graded(current, self._next(current))
            # A second mesh of several moves the objective by far more than that.
            second = np.isinf(current.error.objective) and bool(self._counts)
            rough = _ROUGHLY if second else 0.0
            fresh = self._take(proposal, current, rough)
            if fresh.result.usable:
                return self._judged(fresh, current, rough)
            words = "the solver failed; a finer mesh is tried"
            self.history.note(fresh, None, words)
        error = current.error
        both = error.shooting + error.path
        flyable = max(error.shooting, error.path) <= self.grading.accuracy
        if flyable or self._repairs >= _REPAIRS or both > self._before:
            return None
        self._repairs, self._before = self._repairs + 1, 0.5 * both
        better = self._take(self._repaired(current), current)
        if not better.result.usable:
            return None
        return self._judged(better, current, error.objective)

    def _next(self, current: Judgement) -> int:
        """Take the least number of intervals that should be enough, or the last.

        The second mesh comes as it stands: a single one does not tell its error.
        """
        error = current.error.objective / self.options.tolerance
        if np.isfinite(error):
            wanted = current.solution.mesh.interval_count * error ** (1.0 / _PACE)
            while len(self._counts) > 1 and self._counts[0] < wanted:
                self._counts.pop(0)
        return self._counts.pop(0)

    def _take(
        self, proposal: Proposal, current: Judgement, rough: float = 0.0
    ) -> Solution:
        """Solve a proposal, to a tolerance of ``rough`` if that is not 0."""
        self.history.note(current.solution, current, proposal)
        extra: dict[str, object] = {"tol": rough} if rough else {}
        return self._attempt(
            proposal.mesh, current.solution, {"mu_init": _NEAR, **extra}
        )

    def _graded(self, current: Judgement, count: int) -> Proposal:
        """Mesh of ``count`` intervals graded by what a solution loses."""
        solution, phases, decisions = current.solution, [], []
        each = self._each(count)
        for auditor, part, audit, shares in zip(
            self.auditors, solution.phases, current.audits, current.shares, strict=True
        ):
            lower, upper = auditor.control_bounds(self.attempts.table)
            low, high = part.controls.bounds()
            span = np.where(np.isfinite(upper - lower), upper - lower, high - low)
            span = np.where(span > 0.0, span, 1.0)
            breaks = graded_breaks(part, _lost(part, audit), span, each)
            points = enough_points(
                part,
                audit.dynamics,
                breaks,
                accuracy=self.grading.accuracy,
                least=self.grading.points,
            )
            phases.append(self._mesh_of(breaks, points, auditor))
            decisions.append(_reasons(part, breaks, shares))
            self.attempts.scales[f"{part.name}.duration"] = max(part.duration, 1e-12)
        self.attempts.scales["objective"] = SHARE * objective_size(solution)
        words = f"graded anew with {each * len(phases)} intervals"
        return _proposal(Mesh(tuple(phases)), current, tuple(decisions), words)

    def _repaired(self, current: Judgement) -> Proposal:
        """Mesh with more points or tighter constraints where flown controls miss."""
        more = int(current.error.shooting > self.grading.accuracy)
        words = "more points" if more else "path constraints tightened"
        step = Step.RAISED if more else Step.CONSTRAINED
        phases, decisions = [], []
        for part, audit in zip(current.solution.phases, current.audits, strict=True):
            mesh = part.mesh
            room = min(mesh.path_margins) > 0.0
            margins = np.asarray(mesh.path_margins) + 1.5 * room * audit.path
            decisions.append((Decision(step, words),) * mesh.intervals)
            phases.append(
                replace(
                    mesh,
                    points=tuple(n + more for n in mesh.points),
                    path_margins=tuple(float(m) for m in margins),
                )
            )
        return _proposal(Mesh(tuple(phases)), current, tuple(decisions), words)

    def _even(self, count: int) -> Mesh:
        """Mesh of equal intervals."""
        each = self._each(count)
        breaks, points = np.linspace(0.0, 1.0, each + 1), [self.grading.points] * each
        return Mesh(
            tuple(self._mesh_of(breaks, points, auditor) for auditor in self.auditors)
        )

    def _each(self, count: int) -> int:
        """Return the number of intervals of one phase."""
        return max(10, -(-count // len(self.problem.phases)))

    def _mesh_of(
        self, breaks: FloatArray, points: IntArray | list[int], auditor: PhaseAuditor
    ) -> PhaseMesh:
        """Mesh with the controls linear whose degree is left to the solver.

        Equations on the way cannot be tightened, and determine controls at every
        point: those in them stay polynomials of full degree.
        """
        bounds = auditor.path_bounds(self.attempts.table)
        equations = bool(np.any(bounds[:, 1] <= bounds[:, 0]))
        free = tuple(
            name
            for j, (name, item) in enumerate(auditor.phase.controls.items())
            if item.degree is None
            and not (equations and auditor.principle.constrained.bound[j])
        )
        margin = None if equations else self.grading.margin
        return linear_mesh(breaks, points, free, margin)


def _missing(
    solution: Solution, shares: tuple[FloatArray, ...], former: Judgement | None
) -> float:
    """Estimate the relative error of the objective; infinite after a first mesh.

    From mesh to mesh the objective moves by a share of what the estimated loss falls
    by, and as great a share of what is left of it is yet to come. The last move is an
    estimate, too: moves fall by more than half from mesh to mesh.
    """
    if former is None:
        return float("inf")
    size = objective_size(solution)
    left = sum(float(part.sum()) for part in shares)
    fell = sum(float(part.sum()) for part in former.shares) - left
    moved = abs(solution.objective - former.solution.objective) / size
    share = min(moved / fell, 1.0) if fell > 0.0 else 1.0
    return min(max(share, _LEAST_SHARE) * left + solution.slack / size, moved)


def _lost(part: PhaseSolution, audit: PhaseAudit) -> FloatArray:
    """Return what the objective could gain on each interval, shape (K,)."""
    return np.asarray(audit.objective_control + part.bound_gaps.sum(axis=1))


def _reasons(
    part: PhaseSolution, breaks: FloatArray, shares: FloatArray
) -> tuple[Decision, ...]:
    """Say for each interval how many new ones begin in it, and for what loss."""
    new = np.bincount(
        np.clip(
            np.searchsorted(part.states.breaks, breaks[:-1], side="right") - 1,
            0,
            part.mesh.intervals - 1,
        ),
        minlength=part.mesh.intervals,
    )
    return tuple(
        Decision(Step.GRADED, f"loses {share:.1e} of the objective: {count} begin here")
        for count, share in zip(new, shares, strict=True)
    )


def _proposal(
    mesh: Mesh,
    current: Judgement,
    decisions: tuple[tuple[Decision, ...], ...],
    words: str,
) -> Proposal:
    phases = current.solution.phases
    arcs = tuple(part.arc_durations for part in phases)
    return Proposal(mesh, arcs, (None,) * len(phases), decisions, words)


def graded_breaks(
    phase: PhaseSolution, gap: FloatArray, span: FloatArray, intervals: int
) -> FloatArray:
    """Borders of a new mesh with a given number of intervals.

    Parameters
    ----------
    phase
        A solution on some mesh.
    gap
        Integral of the gap in the minimum principle over each of its intervals,
        shape (K,).
    span
        Range of each control, shape (controls,).

    Returns
    -------
    ndarray, shape (intervals + 1,)
        Times, the first and last those of the phase.
    """
    breaks = phase.states.breaks
    widths = np.diff(breaks)
    lost = np.sqrt(np.maximum(gap, 0.0))
    density = (1.0 - VARIATION) * _share(lost, widths)
    density += VARIATION * _share(variation(phase, span), widths)
    spread = density.copy()
    spread[1:] = np.maximum(spread[1:], DECAY * density[:-1])
    spread[:-1] = np.maximum(spread[:-1], DECAY * density[1:])
    density = FLOOR + (1.0 - FLOOR) * spread / np.average(spread, weights=widths)
    area = np.concatenate([[0.0], np.cumsum(density * widths)])
    return np.asarray(
        np.interp(np.linspace(0.0, area[-1], intervals + 1), area, breaks)
    )


def variation(phase: PhaseSolution, span: FloatArray) -> FloatArray:
    """Variation of the controls over their ranges on each interval, shape (K,).

    Jumps between intervals count half on either side.
    """
    coefficients = phase.controls.coefficients / span
    inside = np.abs(np.diff(coefficients, axis=1)).sum(axis=(1, 2))
    jumps = np.abs(coefficients[1:, 0] - coefficients[:-1, -1]).sum(axis=1)
    inside[:-1] += 0.5 * jumps
    inside[1:] += 0.5 * jumps
    return np.asarray(inside)


def _share(amount: FloatArray, widths: FloatArray) -> FloatArray:
    """Density of an amount per interval, of mean 1; even where there is none."""
    total = float(amount.sum())
    if not np.isfinite(total) or total <= 0.0:
        return np.ones(widths.size)
    return np.asarray(amount / widths * (widths.sum() / total))


def enough_points(
    phase: PhaseSolution,
    error: FloatArray,
    breaks: FloatArray,
    *,
    accuracy: float,
    least: int,
) -> IntArray:
    """Points of each interval of a new mesh that promise ``accuracy``, shape (K,).

    With N points the error on an interval falls with its width to the power N + 1.

    Parameters
    ----------
    phase
        The solution on the former mesh.
    error
        Its errors of the dynamics over the states' ranges, interval by interval.
    breaks
        Borders of the new mesh.
    accuracy
        Wanted error.
    least
        Least number of points.
    """
    former = phase.states.breaks
    middle = 0.5 * (breaks[:-1] + breaks[1:])
    owner = np.clip(np.searchsorted(former, middle) - 1, 0, former.size - 2)
    points = np.asarray(phase.mesh.points)[owner]
    ratio = np.diff(breaks) / np.diff(former)[owner]
    promised = error[owner] * ratio ** (points + 1)
    return np.where(promised > accuracy, points + 1, np.maximum(points - 1, least))


def linear_mesh(
    breaks: FloatArray,
    points: IntArray | list[int],
    controls: tuple[str, ...],
    margin: float | None,
) -> PhaseMesh:
    """Mesh with ``controls`` linear on each interval.

    Path constraints hold at both ends of every interval too, with a ``margin``; at
    the collocation points alone if that is ``None``.
    """
    count = breaks.size - 1
    plain = PhaseMesh.from_breaks(breaks, [int(n) for n in points])
    return PhaseMesh(
        plain.fractions,
        plain.points,
        control_degrees=dict.fromkeys(controls, (1,) * count),
        path_points=(() if margin is None else (0.0, 1.0),) * count,
        path_margins=(margin or 0.0,) * count,
    )
