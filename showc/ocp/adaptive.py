"""Solve a problem to a tolerance: mesh, audit, refine, place switches, repeat."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit import PhaseAuditor
from showc.ocp.history import MeshRecord, phase_record
from showc.ocp.judgement import Judgement, is_worse, judge
from showc.ocp.limits import Overrides, Statement
from showc.ocp.optimality import ranges
from showc.ocp.options import (
    CAUTION,
    CHEAP,
    EFFORT,
    LOOSE,
    ROUGH,
    SWITCH_TRIALS,
    TRIAL_EFFORT,
    VAGUE,
    Options,
)
from showc.ocp.proposal import (
    Proposal,
    place_switches,
    plain_mesh,
    refined,
    with_ends,
)
from showc.ocp.solution import Result, Solution
from showc.ocp.transcription import Transcription

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from showc.ocp.guess import Guess
    from showc.ocp.mesh import Mesh
    from showc.ocp.problem import Problem
    from showc.ocp.solver import SolverOptions
    from showc.ocp.switches import Structure

    FloatArray = NDArray[np.float64]


class _Refinement:
    """The state of one adaptive solve."""

    def __init__(
        self,
        problem: Problem,
        options: Options,
        parameters: Mapping[str, float],
        overrides: Overrides,
    ) -> None:
        self.problem, self.options = problem, options
        self.parameters, self.overrides = parameters, overrides
        self.statement = Statement(problem)
        table = self.statement.table(self.statement.parameters(parameters))
        self.table = table.with_bounds(problem, overrides)
        self.auditors = [
            PhaseAuditor(problem, phase, i) for i, phase in enumerate(problem.phases)
        ]
        self.scales = dict(options.scales)
        self.records: list[MeshRecord] = []
        self.iterations = 0
        self.latest: Transcription | None = None
        """The transcription solved last."""
        self.rescaled = False
        self.guess: Guess | Solution | None = None
        """The guess the user gave."""
        self.former: Transcription | None = None
        """The transcription of the solution that the next mesh starts from."""

    # --- one mesh ----------------------------------------------------------------

    def attempt(
        self,
        mesh: Mesh,
        guess: Guess | Solution | None,
        *,
        arcs: Sequence[FloatArray] | None = None,
        structures: Sequence[Structure | None] | None = None,
        solver: SolverOptions | None = None,
    ) -> Solution:
        """Solve on one mesh."""
        mesh = with_ends(self.problem, mesh)
        transcription = Transcription(
            self.problem,
            mesh,
            scheme=self.options.scheme,
            scales=self.scales,
            options=self._limited(solver or self.options.solver, mesh),
            couplings=self.options.couplings,
        )
        solution = transcription.solve(
            parameters=self.parameters,
            overrides=self._fixed_at_bounds(mesh, structures),
            guess=guess,
            arcs=arcs,
            former=self.former if isinstance(guess, Solution) else None,
        )
        self.iterations += solution.iterations
        self.latest = transcription
        return solution

    def _limited(self, solver: SolverOptions, mesh: Mesh) -> SolverOptions:
        """Fewer iterations for a large program: a good start needs few."""
        least = max(100, int(EFFORT / self._unknowns(mesh)))
        return replace(solver, iterations=min(solver.iterations, least))

    def _unknowns(self, mesh: Mesh) -> int:
        """About how many unknowns a program on ``mesh`` has."""
        return sum(
            part.point_count * (len(phase.states) + len(phase.controls))
            for part, phase in zip(mesh.phases, self.problem.phases, strict=True)
        )

    def _fixed_at_bounds(
        self, mesh: Mesh, structures: Sequence[Structure | None] | None
    ) -> Overrides:
        """Hold controls at their bounds on the arcs found so."""
        bounds = dict(self.overrides.bounds)
        for i, phase in enumerate(self.problem.phases):
            structure = structures[i] if structures else None
            if structure is None:
                continue
            arcs = np.array(mesh.phases[i].arcs)
            for j, name in enumerate(phase.controls):
                kinds = structure.classes[arcs, j]
                low, high = self.table["bounds", phase.name, name]
                bounds.pop(name, None)
                bounds[f"{phase.name}.{name}"] = (
                    np.where(kinds == 1, high, low),
                    np.where(kinds == -1, low, high),
                )
        return replace(self.overrides, bounds=bounds)

    def first(self, guess: Guess | Solution | None) -> Solution:
        """Solve the first mesh, by other ways where the plain one fails."""
        self.guess = guess
        mesh = self.options.mesh or plain_mesh(self.auditors, 10, 4)
        solution = self.attempt(mesh, guess)
        if solution.result.usable or solution.result is Result.CONTRADICTION:
            return solution
        best = solution
        base = self.options.solver
        for name, scale in self._other_durations(guess):
            self.note(
                best, None, f"the solver failed; a duration of {scale:g} is tried"
            )
            self.scales[name] = scale
            solution = self.attempt(mesh, guess)
            if solution.result.usable:
                return solution
            del self.scales[name]
        for other, strategy in (
            (mesh, {"mu_strategy": "monotone"}),
            (plain_mesh(self.auditors, 20, 3), {"mu_strategy": "adaptive"}),
            (plain_mesh(self.auditors, 30, 3), {"mu_strategy": "monotone"}),
            (plain_mesh(self.auditors, 6, 6), {"mu_strategy": "adaptive"}),
        ):
            self.note(best, None, "the solver failed; another way is tried")
            extra = {**strategy, **base.extra}
            solver = replace(base, extra=extra, iterations=2 * base.iterations)
            solution = self.attempt(other, guess, solver=solver)
            if solution.result.usable:
                return solution
        return best

    def _other_durations(
        self, guess: Guess | Solution | None
    ) -> list[tuple[str, float]]:
        """Orders of magnitude for a duration of which nothing is known."""
        if guess is not None or len(self.problem.phases) > 1:
            return []
        phase = self.problem.phases[0]
        low, high = self.table["duration", phase.name]
        name = f"{phase.name}.duration"
        if name in self.scales or np.isfinite(high):
            return []
        return [(name, max(low, 1.0) * factor) for factor in (1e2, 1e4, 1e-2, 1e6)]

    def amend(self, number: int, proposal: Proposal) -> None:
        """Write into a line of the history what was done after a trial that failed."""
        record = self.records[number]
        phases = tuple(
            replace(
                phase,
                intervals=tuple(
                    replace(interval, decision=new.after(interval.decision))
                    for interval, new in zip(phase.intervals, chosen, strict=True)
                ),
            )
            for phase, chosen in zip(record.phases, proposal.decisions, strict=True)
        )
        words = f"{record.action}; that was no better, so {proposal.words}"
        self.records[number] = replace(record, action=words, phases=phases)

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
            solution.iterations,
            solution.result,
            None if judged is None else judged.error,
            words,
            phases,
        )
        self.records.append(record)
        if self.options.progress is not None:
            self.options.progress(record)

    def judge(
        self,
        solution: Solution,
        former: Judgement | None,
        structures: Sequence[Structure | None],
        *,
        mended: bool = True,
    ) -> Judgement:
        """Audit a solution of the present problem."""
        return judge(
            self.problem,
            self.auditors,
            solution,
            former,
            structures,
            table=self.table,
            tolerance=self.options.tolerance,
            mended=mended,
        )

    def take(self, proposal: Proposal, current: Judgement) -> Judgement | None:
        """Solve and judge a proposal; ``None`` if it is no step forward."""
        switching, former_before = proposal.places_switches, self.former
        base, tolerance = self.options.solver, self.options.tolerance
        unknowns = self._unknowns(proposal.mesh)
        limit = base.iterations
        if switching:
            limit = min(limit, int(np.clip(TRIAL_EFFORT / unknowns, 60, 150)))
        loose = (
            not switching
            and unknowns > CHEAP
            and current.greatest > 1e3 * tolerance
            and base.tolerance < LOOSE
        )
        solution = self.attempt(
            proposal.mesh,
            current.solution,
            arcs=proposal.arcs,
            structures=proposal.structures,
            solver=replace(
                base,
                iterations=limit,
                tolerance=LOOSE if loose else base.tolerance,
            ),
        )
        if not solution.result.usable and not switching:
            solution = self._afresh(proposal, current, solution)
        if loose and solution.result.usable:
            solution = self._tightened(proposal, current, solution)
        fresh = None
        if solution.result.usable and not is_worse(self.problem, solution, current):
            former = None if switching else current
            fresh = self.judge(
                solution, former, proposal.structures, mended=proposal.complete
            )
            rough = max(fresh.error.dynamics, fresh.error.path)
            # Wrong arcs are mended by the next meshes, if these cost little.
            errs = unknowns > CHEAP and fresh.error.objective > max(
                2.0 * current.error.objective, self.options.tolerance
            )
            if switching and (errs or rough > 3.0 * current.greatest):
                fresh = None
        if fresh is None:
            self.note(solution, None, "no better; back to the mesh before")
            # The mesh before is still there to start from, if it is not to blame.
            self.former = former_before if switching else None
        else:
            self.accept(fresh)
        return fresh

    def _tightened(
        self, proposal: Proposal, current: Judgement, solution: Solution
    ) -> Solution:
        """Solve to the full tolerance what turns out to need no finer mesh."""
        fresh = self.judge(
            solution, current, proposal.structures, mended=proposal.complete
        )
        close = fresh.greatest < 1e2 * self.options.tolerance
        # Arcs can only be read off where active bounds are met closely.
        arcs = self.options.switches and fresh.error.objective < VAGUE
        if not close and not arcs:
            return solution
        self.note(solution, fresh, "solved to the full tolerance")
        self.former = self.latest
        again = self.attempt(proposal.mesh, solution, structures=proposal.structures)
        return again if again.result.usable else solution

    def reached(self, passed: Judgement) -> bool:
        """Whether all errors are within the tolerance."""
        tolerance, error = self.options.tolerance, passed.error
        least = max(error.dynamics, error.path) <= tolerance
        return least and error.objective <= CAUTION * tolerance

    def _afresh(
        self, proposal: Proposal, current: Judgement, failed: Solution
    ) -> Solution:
        """Try a mesh on which the solver failed in other ways."""
        base = self.options.solver
        self.former = None
        if failed.iterations * failed.multipliers.unknowns.size > 0.5 * EFFORT:
            return failed
        starts: tuple[tuple[Guess | Solution | None, dict[str, object]], ...] = (
            (self.guess, {"mu_oracle": "probing"}),
            (current.solution, {"mu_strategy": "monotone"}),
        )
        solution = failed
        for guess, strategy in starts:
            self.note(solution, None, "the solver failed; it starts afresh")
            solution = self.attempt(
                proposal.mesh,
                guess,
                arcs=proposal.arcs,
                structures=proposal.structures,
                solver=replace(base, extra={**strategy, **base.extra}),
            )
            if solution.result.usable:
                break
        return solution

    def finer(self, current: Judgement) -> Proposal | None:
        """Return the next finer mesh; ``None``: there is none, or it is too large."""
        proposal = refined(current, self.options)
        same = with_ends(self.problem, proposal.mesh) == current.solution.mesh
        large = proposal.mesh.point_count > self.options.points
        return None if same or large else proposal

    def accept(self, judgement: Judgement) -> None:
        """Let later meshes start from a solution, if it is worth it."""
        good = judgement.error.dynamics < ROUGH
        self.former = self.latest if good else None
        if good and not self.rescaled:
            self.rescaled = True
            self.rescale(judgement.solution)

    def rescale(self, solution: Solution) -> None:
        """Take scales that bounds do not tell from a first trajectory."""
        size = 0.0
        for phase, part in zip(self.problem.phases, solution.phases, strict=True):
            span = ranges(part.states)
            for i, (name, state) in enumerate(phase.states.items()):
                key = f"{phase.name}.{name}"
                bounds = self.table["bounds", phase.name, name]
                told = np.all(np.isfinite(bounds)) or state.quantity.scale is not None
                if not told and name not in self.options.scales:
                    self.scales[key] = float(span[i])
            size_of = np.abs(part.controls.coefficients).max(axis=(0, 1), initial=0.0)
            for j, (name, control) in enumerate(phase.controls.items()):
                bounds = self.table["bounds", phase.name, name]
                told = np.all(np.isfinite(bounds)) or control.quantity.scale is not None
                if not told and name not in self.options.scales and size_of[j] > 0.0:
                    self.scales[f"{phase.name}.{name}"] = float(size_of[j])
            key = f"{phase.name}.duration"
            if key not in self.options.scales:
                self.scales[key] = max(part.duration, 1e-12)
            value = np.abs(part.costates).max(axis=0, initial=0.0) * span
            size = max(size, float(value.max(initial=0.0)))
        if np.isfinite(size) and size > 0.0:
            self.scales["objective"] = size


def solve(
    problem: Problem,
    *,
    guess: Guess | Solution | None = None,
    parameters: Mapping[str, float] | None = None,
    overrides: Overrides | None = None,
    options: Options | None = None,
) -> Solution:
    """Solve ``problem`` to a tolerance.

    Parameters
    ----------
    problem
        What is to be solved.
    guess
        Where to start; by default straight lines between the end values.
    parameters
        Values of the problem's parameters.
    overrides
        Bounds and end values that differ from the problem's own.
    options
        Tolerance and limits of effort.

    Returns
    -------
    Solution
        With the history of its meshes and its error estimate. ``result`` is
        ``SOLVED`` only if all errors are within the tolerance; ``COARSE`` if the best
        mesh misses it; else what went wrong, with the constraint and place in
        ``message``.

    Raises
    ------
    ValueError
        If the problem is not completely stated or a name is unknown.
    """
    chosen = options or Options()
    work = _Refinement(problem, chosen, parameters or {}, overrides or Overrides())
    solution = work.first(guess)
    if not solution.result.usable:
        work.note(solution, None, "no solution on any first mesh")
        return replace(
            solution, iterations=work.iterations, history=tuple(work.records)
        )
    none: list[Structure | None] = [None] * len(problem.phases)
    best = current = work.judge(solution, None, none)
    work.accept(current)
    trials = SWITCH_TRIALS if chosen.switches else 0
    refused: list[Structure] = []
    while len(work.records) < chosen.meshes - 1 and not work.reached(current):
        proposal = None
        if trials > 0:
            proposal = place_switches(current, work.auditors, work.table, refused)
            trials -= proposal is not None
        if proposal is None:
            proposal = work.finer(current)
        if proposal is None:
            break
        number = len(work.records)
        work.note(current.solution, current, proposal)
        fresh = work.take(proposal, current)
        if fresh is None and proposal.places_switches:
            refused += [s for s in proposal.structures if s is not None]
            proposal = work.finer(current)
            if proposal is not None:
                work.amend(number, proposal)
                fresh = work.take(proposal, current)
        if fresh is None or proposal is None:
            break
        current = fresh
        if current.merit < best.merit or proposal.places_switches:
            best = current
    best = min(best, current, key=lambda passed: passed.merit)
    done = best.greatest <= chosen.tolerance
    work.note(best.solution, best, "tolerance reached" if done else "stopped")
    return _finished(work, best, done=done)


def _finished(work: _Refinement, best: Judgement, *, done: bool) -> Solution:
    result = Result.SOLVED if done else Result.COARSE
    audits = [a.audit(best.solution, work.table, shoot=True) for a in work.auditors]
    error = replace(best.error, shooting=max(a.shooting for a in audits))
    message = result.value
    if not done:
        message += (
            f" Dynamics {error.dynamics:.1e}, path constraints {error.path:.1e}, "
            f"objective {error.objective:.1e}; wanted {work.options.tolerance:.0e}."
        )
        worst = next((a.worst_path for a in audits if a.worst_path), "")
        if worst and error.path > work.options.tolerance:
            message += f" Violated most between the nodes: {worst}."
    return replace(
        best.solution,
        result=result,
        message=message,
        iterations=work.iterations,
        error=error,
        history=tuple(work.records),
    )
