"""A problem solved to a tolerance by collocation, its couplings left out."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from showc.ocp.outcome import Result
from showc.ocp.refinement.attempts import Attempts
from showc.ocp.refinement.graded import Graded
from showc.ocp.refinement.hp import Hp
from showc.ocp.refinement.options import Options
from showc.ocp.refinement.strategy import refine
from showc.ocp.transcription.collocation.limits import Overrides

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.ocp.guess import Guess
    from showc.ocp.problem import Problem
    from showc.ocp.refinement.collocated import Collocated
    from showc.ocp.refinement.judgement import Judgement
    from showc.ocp.solution import Solution


def solve(
    problem: Problem,
    *,
    guess: Guess | Solution | None = None,
    parameters: Mapping[str, float] | None = None,
    overrides: Overrides | None = None,
    options: Options | None = None,
) -> Solution:
    """Solve ``problem`` to a tolerance, its couplings left out.

    Arguments, result and errors are those of :func:`showc.ocp.solve`. Where the mesh
    has arcs and does not reach the tolerance, these may have been seen too early: then
    it is refined once more without.
    """
    chosen, given = options or Options(), (parameters or {}, overrides or Overrides())
    solution = _refined(Attempts(problem, chosen, *given), guess)
    arcs = solution.mesh.phases if solution.result is Result.COARSE else ()
    if chosen.grading or all(part.arc_count == 1 for part in arcs):
        return solution
    plain = replace(chosen, switches=False)
    other = _refined(Attempts(problem, plain, *given), guess)
    if other.result is not Result.SOLVED:
        return solution
    return replace(
        other,
        iterations=solution.iterations + other.iterations,
        history=solution.history + other.history,
    )


def _refined(attempts: Attempts, guess: Guess | Solution | None) -> Solution:
    """Solve on one mesh after the other."""
    work = (Graded if attempts.options.grading else Hp)(attempts, guess)
    best = refine(work)
    if best is None:
        return work.failed("no solution on any first mesh")
    latest = work.latest
    if latest is not best and not work.history.knows(latest.solution):
        work.history.note(latest.solution, latest, "an earlier mesh was better")
    done = work.done(best)
    work.history.note(best.solution, best, "tolerance reached" if done else "stopped")
    return _finished(work, best, done=done)


def _finished(work: Collocated, best: Judgement, *, done: bool) -> Solution:
    result = Result.SOLVED if done else Result.COARSE
    options, table = work.options, work.attempts.table
    audits, error = best.audits, best.error
    if not options.grading:
        audits = tuple(
            auditor.shot(audit, best.solution, table)
            for auditor, audit in zip(work.auditors, audits, strict=True)
        )
        error = replace(error, shooting=max(a.shooting for a in audits))
    message = result.value
    if not done:
        wanted = f"{options.tolerance:.0e}"
        if options.grading:
            wanted += (
                f", and {options.grading.accuracy:.0e} for controls flown (now "
                f"{error.shooting:.1e}) and path constraints"
            )
        message += (
            f" Dynamics {error.dynamics:.1e}, path constraints {error.path:.1e}, "
            f"objective {error.objective:.1e}; wanted {wanted}."
        )
        worst = next((a.worst_path for a in audits if a.worst_path), "")
        if worst and error.path > options.tolerance:
            message += f" Violated most between the nodes: {worst}."
    return replace(
        best.solution,
        result=result,
        message=message,
        iterations=work.attempts.iterations,
        error=error,
        history=tuple(work.history.records),
        sensitivities=work.attempts.sensitivities(best),
    )
