"""Solve with controls linear on each interval, on meshes graded by what they cost.

Such controls keep their bounds at every instant and can be flown as they are. A coarse
even mesh comes first; each mesh after it has more intervals, with borders where the
last solution loses most (:mod:`showc.ocp.refinement.graded.grading`), and starts from
it. For
problems whose controls jump, or ride on state constraints, this is near the optimum in
a few quick solves; it does not reach the accuracy of :func:`showc.ocp.solve` on smooth
ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit.optimality import objective_size
from showc.ocp.audit.record import phase_record
from showc.ocp.audit.residuals import PhaseAuditor
from showc.ocp.history import MeshRecord
from showc.ocp.mesh import Mesh
from showc.ocp.outcome import ErrorEstimate, Result
from showc.ocp.refinement.graded.grading import (
    enough_points,
    graded_breaks,
    linear_mesh,
)
from showc.ocp.transcription.collocation.limits import Overrides, Statement
from showc.ocp.transcription.collocation.transcription import SHARE, Transcription
from showc.ocp.transcription.solver import SolverOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from showc.arrays import FloatArray, IntArray
    from showc.ocp.audit.residuals import PhaseAudit
    from showc.ocp.guess import Guess
    from showc.ocp.mesh import PhaseMesh
    from showc.ocp.problem import Problem
    from showc.ocp.solution import Solution
    from showc.ocp.transcription.collocation.limits import Table


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
    # The optimum need not be sharp, but what is flown must be.
    "constr_viol_tol": 1e-8,
}
_NEAR = 1e-3
"""First barrier parameter where a solution on another mesh is known."""
_STILL = 1e-2
"""Range over its scale below which a state counts as one that hardly moves: its errors
are relative to this range then."""
_REPAIRS = 3
"""Times that the last mesh is mended, each halving the error or being the last."""


@dataclass(frozen=True, slots=True)
class GradedOptions:
    """How a problem is solved on graded meshes; the defaults are meant for all."""

    tolerance: float = 1e-3
    """Relative change of the objective, from one mesh to the next, that ends it."""
    accuracy: float = 2e-5
    """Wanted error of the flown controls: the greatest distance between the states
    and one integration of the clipped controls, over each state's range (or a
    hundredth of its scale, if that is more); and wanted violation of path
    constraints between the points, over their scale."""
    intervals: tuple[int, ...] = (24, 44, 56, 72, 96, 128)
    """Number of intervals of the meshes, shared by the phases."""
    points: int = 3
    """Collocation points of an interval; more where ``accuracy`` takes them."""
    margin: float = 1e-6
    """By how much, in their scale, path constraints are tightened, so that what the
    solver's tolerance leaves stays within."""
    first: Mesh | None = None
    """First mesh; by default even."""
    solver: SolverOptions | None = None
    """How each nonlinear program is solved; by default to a hundredth of the
    tolerance."""
    progress: Callable[[MeshRecord], None] | None = None
    """Called after each mesh."""


class _Work:
    """The state of one solve."""

    def __init__(
        self,
        problem: Problem,
        options: GradedOptions,
        parameters: Mapping[str, float],
        overrides: Overrides,
    ) -> None:
        self.problem, self.options = problem, options
        self.parameters, self.overrides = parameters, overrides
        statement = Statement(problem)
        table = statement.table(statement.parameters(parameters))
        self.table: Table = table.with_bounds(problem, overrides)
        self.auditors = [
            PhaseAuditor(problem, phase, i) for i, phase in enumerate(problem.phases)
        ]
        scales = statement.scales({}).states
        for auditor, scale in zip(self.auditors, scales, strict=True):
            auditor.least_range = _STILL * scale
        self.scales: dict[str, float] = {}
        self.records: list[MeshRecord] = []
        self.iterations = 0

    def attempt(
        self, mesh: Mesh, guess: Guess | Solution | None, extra: dict[str, object]
    ) -> Solution:
        """Solve on one mesh."""
        chosen = self.options.solver or SolverOptions(
            tolerance=1e-2 * self.options.tolerance, iterations=400
        )
        built = Transcription(
            self.problem,
            mesh,
            scales=self.scales,
            options=replace(chosen, extra={**_QUICK, **extra, **chosen.extra}),
        )
        solution = built.solve(
            parameters=self.parameters, overrides=self.overrides, guess=guess
        )
        self.iterations += solution.iterations
        return solution

    def first(self, guess: Guess | Solution | None) -> Solution:
        """Solve the first mesh, by other ways where the plain one fails."""
        counts = self.options.intervals
        rough: dict[str, object] = {"tol": 1e-4} if len(counts) > 1 else {}
        for number, way in _STARTS:
            mesh = self.even(counts[min(number, len(counts) - 1)])
            if number == 0 and self.options.first is not None:
                mesh = self.options.first
            solution = self.attempt(mesh, guess, {**way, **rough})
            usable = solution.result.usable
            if usable or solution.result is Result.CONTRADICTION:
                break
            self.note(solution, None, "the solver failed; another way is tried")
        return solution

    def next(
        self, solution: Solution, audits: tuple[PhaseAudit, ...], count: int
    ) -> Solution:
        """Solve on a mesh graded by what ``solution`` loses."""
        phases = []
        each = self.each(count)
        for auditor, part, audit in zip(
            self.auditors, solution.phases, audits, strict=True
        ):
            lower, upper = auditor.control_bounds(self.table)
            low, high = part.controls.bounds()
            span = np.where(np.isfinite(upper - lower), upper - lower, high - low)
            gap = audit.objective_control + part.bound_gaps.sum(axis=1)
            span = np.where(span > 0.0, span, 1.0)
            breaks = graded_breaks(part, gap, span, each)
            points = enough_points(
                part,
                audit.dynamics,
                breaks,
                accuracy=self.options.accuracy,
                least=self.options.points,
            )
            phases.append(self.mesh_of(breaks, points, auditor))
            self.scales[f"{part.name}.duration"] = max(part.duration, 1e-12)
        self.scales["objective"] = SHARE * objective_size(solution)
        return self.attempt(Mesh(tuple(phases)), solution, {"mu_init": _NEAR})

    def even(self, count: int) -> Mesh:
        """Mesh of equal intervals."""
        each = self.each(count)
        breaks, points = np.linspace(0.0, 1.0, each + 1), [self.options.points] * each
        return Mesh(
            tuple(self.mesh_of(breaks, points, auditor) for auditor in self.auditors)
        )

    def each(self, count: int) -> int:
        """Return the number of intervals of one phase."""
        return max(10, -(-count // len(self.problem.phases)))

    def mesh_of(
        self, breaks: FloatArray, points: IntArray | list[int], auditor: PhaseAuditor
    ) -> PhaseMesh:
        """Mesh with the controls linear whose degree is left to the solver.

        Equations on the way cannot be tightened, and determine controls at every
        point: those in them stay polynomials of full degree.
        """
        bounds = auditor.path_bounds(self.table)
        equations = bool(np.any(bounds[:, 1] <= bounds[:, 0]))
        free = tuple(
            name
            for j, (name, item) in enumerate(auditor.phase.controls.items())
            if item.degree is None
            and not (equations and auditor.principle.path_bound[j])
        )
        return linear_mesh(
            breaks, points, free, None if equations else self.options.margin
        )

    def audit(self, solution: Solution) -> tuple[PhaseAudit, ...]:
        """Look between the nodes."""
        return tuple(a.audit(solution, self.table, shoot=True) for a in self.auditors)

    def repaired(
        self, solution: Solution, audits: tuple[PhaseAudit, ...]
    ) -> tuple[Solution, tuple[PhaseAudit, ...]]:
        """Mend the last mesh where its controls, flown, miss the states or a limit."""
        before = np.inf
        for _ in range(_REPAIRS):
            flown, path = _errors(audits)
            if max(flown, path) <= self.options.accuracy or flown + path > before:
                break
            before = 0.5 * (flown + path)
            more = int(flown > self.options.accuracy)
            phases = []
            for part, audit in zip(solution.phases, audits, strict=True):
                mesh = part.mesh
                room = min(mesh.path_margins) > 0.0
                margins = np.asarray(mesh.path_margins) + 1.5 * room * audit.path
                phases.append(
                    replace(
                        mesh,
                        points=tuple(n + more for n in mesh.points),
                        path_margins=tuple(float(m) for m in margins),
                    )
                )
            words = "more points" if more else "path constraints tightened"
            self.note(solution, audits, words)
            better = self.attempt(Mesh(tuple(phases)), solution, {"mu_init": _NEAR})
            if not better.result.usable:
                break
            solution, audits = better, self.audit(better)
        return solution, audits

    def note(
        self,
        solution: Solution,
        audits: tuple[PhaseAudit, ...] | None,
        action: str,
        moved: float = float("nan"),
    ) -> None:
        """Write one line of the history."""
        error = None if audits is None else _estimate(audits, moved)
        record = MeshRecord(
            solution.mesh.interval_count,
            solution.mesh.point_count,
            solution.objective,
            solution.iterations,
            solution.result,
            error,
            action,
            tuple(
                phase_record(part, audits[i] if audits else None, None, None)
                for i, part in enumerate(solution.phases)
            ),
        )
        self.records.append(record)
        if self.options.progress is not None:
            self.options.progress(record)


def _errors(audits: tuple[PhaseAudit, ...]) -> tuple[float, float]:
    """Greatest error of the flown controls, and of path constraints."""
    flown = max(audit.shooting for audit in audits)
    return flown, max(float(audit.path.max()) for audit in audits)


def _estimate(audits: tuple[PhaseAudit, ...], moved: float) -> ErrorEstimate:
    flown, path = _errors(audits)
    dynamics = max(float(audit.dynamics.max()) for audit in audits)
    return ErrorEstimate(dynamics, flown, path, moved)


def solve_graded(
    problem: Problem,
    *,
    guess: Guess | Solution | None = None,
    parameters: Mapping[str, float] | None = None,
    overrides: Overrides | None = None,
    options: GradedOptions | None = None,
) -> Solution:
    """Solve ``problem`` with controls that are linear on each interval.

    Parameters
    ----------
    problem
        What is to be solved. Controls of a given degree keep it.
    guess
        Where to start; by default straight lines between the end values.
    parameters
        Values of the problem's parameters.
    overrides
        Bounds and end values that differ from the problem's own, none of them by
        interval.
    options
        Tolerances and meshes.

    Returns
    -------
    Solution
        With the history of its meshes. ``error.objective`` is the relative change of
        the objective on the last mesh, ``error.shooting`` what one integration of the
        clipped controls misses. ``result`` is ``SOLVED`` only if all are within the
        tolerances; ``COARSE`` if a mesh is solved that misses one of them.

    Raises
    ------
    ValueError
        If the problem is not completely stated or a name is unknown.
    """
    chosen = options or GradedOptions()
    work = _Work(problem, chosen, parameters or {}, overrides or Overrides())
    solution = work.first(guess)
    if not solution.result.usable:
        work.note(solution, None, "no solution on the first mesh")
        return replace(
            solution, iterations=work.iterations, history=tuple(work.records)
        )
    audits = work.audit(solution)
    moved = float("inf")
    for count in chosen.intervals[1:]:
        if moved <= chosen.tolerance:
            break
        work.note(solution, audits, f"graded anew with {count} intervals", moved)
        fresh = work.next(solution, audits, count)
        if not fresh.result.usable:
            work.note(fresh, None, "the solver failed; a finer mesh is tried")
            continue
        moved = abs(fresh.objective - solution.objective) / objective_size(fresh)
        solution, audits = fresh, work.audit(fresh)
    solution, audits = work.repaired(solution, audits)
    flown, path = _errors(audits)
    done = moved <= chosen.tolerance and max(flown, path) <= chosen.accuracy
    result = Result.SOLVED if done else Result.COARSE
    message = result.value
    if not done:
        message += (
            f" Last change of the objective {moved:.1e} (wanted "
            f"{chosen.tolerance:.0e}), flown controls {flown:.1e}, path constraints "
            f"{path:.1e} (wanted {chosen.accuracy:.0e})."
        )
    work.note(solution, audits, "tolerance reached" if done else "stopped", moved)
    return replace(
        solution,
        result=result,
        message=message,
        iterations=work.iterations,
        error=_estimate(audits, moved),
        history=tuple(work.records),
    )
