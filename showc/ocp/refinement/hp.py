"""hp-refinement: intervals cut or raised one by one, switch times as unknowns."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit.optimality import objective_size
from showc.ocp.guess import Guess
from showc.ocp.outcome import Result
from showc.ocp.refinement.judgement import Judgement, is_worse, judge, refutes
from showc.ocp.refinement.multistart import uneven, unmoved, varied
from showc.ocp.refinement.options import (
    CAUTION,
    CHEAP,
    CLOSE,
    EFFORT,
    INNER_DEGREE,
    LOOSE,
    LOOSELY,
    OPEN,
    ROUGH,
    SWITCH_TRIALS,
    TIGHTER,
    TRIAL_EFFORT,
    UNEVENNESS,
    WEIGHINGS,
)
from showc.ocp.refinement.proposal import (
    Proposal,
    place_switches,
    plain_mesh,
    refined,
    with_ends,
)
from showc.ocp.refinement.strategy import Strategy
from showc.ocp.solution import Solution

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.ocp.refinement.attempts import Attempts
    from showc.ocp.refinement.switches import Structure


class Hp(Strategy):
    """Refinement by intervals and arcs."""

    def __init__(self, attempts: Attempts) -> None:
        super().__init__(attempts)
        # Where a coupling binds is known as a fraction of the phase, which moves with
        # the borders of arcs.
        placing = self.options.switches and not self.options.couplings
        self.trials = SWITCH_TRIALS if placing else 0
        """How often switch times may still be placed."""
        self.refused: list[Structure] = []
        """Structures that did not help."""
        self.loose = False
        """Whether the latest mesh was solved loosely: arcs cannot be read off it."""
        self.rescaled = False
        self.guess: Guess | Solution | None = None
        """The guess the user gave."""

    def first(self, guess: Guess | Solution | None) -> Solution:
        """Solve the first mesh, by other ways where the plain one fails."""
        self.guess = guess
        mesh = self.options.mesh or plain_mesh(self.auditors, 10, 4)
        solution = self.attempts.attempt(mesh, guess)
        if solution.result is Result.CONTRADICTION:
            return solution
        if solution.result.usable:
            return self._unsymmetric(self._weighed(solution), guess)
        best = solution
        base = self.options.solver
        known = self.attempts.scales
        for scales in self._other_durations(guess):
            longest = max(scales.values())
            words = f"the solver failed; a duration of {longest:g} is tried"
            self.history.note(solution, None, words)
            self.attempts.scales = known | scales
            solution = self.attempts.attempt(mesh, guess)
            if solution.result.usable:
                return self._weighed(solution)
        self.attempts.scales = known
        free = partial(plain_mesh, self.auditors, degree=INNER_DEGREE)
        for other, strategy in (
            (mesh, {"mu_strategy": "monotone"}),
            (free(10, 4), {"mu_strategy": "monotone"}),
            (free(20, 3), {"mu_strategy": "adaptive"}),
            (free(30, 3), {"mu_strategy": "monotone"}),
            (free(6, 6), {"mu_strategy": "adaptive"}),
        ):
            self.history.note(solution, None, "the solver failed; another way is tried")
            extra = {**strategy, **base.extra}
            solver = replace(base, extra=extra, iterations=2 * base.iterations)
            solution = self.attempts.attempt(other, guess, solver=solver)
            if solution.result.usable:
                return self._weighed(solution)
        if not isinstance(guess, Solution):
            # Where all slopes vanish, or have no value, other places have some.
            for number in (1, 2):
                words = "the solver failed; a start with waves is tried"
                self.history.note(solution, None, words)
                start = varied(self.problem, guess, self.attempts.parameters, number)
                solution = self.attempts.attempt(mesh, start)
                if solution.result.usable:
                    return self._weighed(solution)
        self.history.note(solution, None, "the solver failed; no other way is left")
        return best

    def _weighed(self, solution: Solution) -> Solution:
        """Solve again where the solver's tolerance was loose for what it found.

        The first scale of the objective is a guess. A solver that stops at 1e-8 of a
        scale that is far too great has not reached anything.
        """
        for _ in range(WEIGHINGS):
            loose = self.attempts.weigh(solution)
            if loose < LOOSELY:
                break
            words = f"the objective's scale was {loose:.1e} times too great; again"
            self.history.note(solution, None, words)
            better = self.attempts.attempt(solution.mesh, solution)
            if not better.result.usable:
                break
            solution = better
        return solution

    def _unsymmetric(
        self, solution: Solution, guess: Guess | Solution | None
    ) -> Solution:
        """Start again without symmetry where the first search may be caught in one."""
        table = self.attempts.table
        still = unmoved(self.problem, solution, table)
        given = guess or Guess()
        if not still or isinstance(given, Solution):
            return solution
        sign = -1.0 if self.problem.maximises else 1.0
        best, built = solution, self.attempts.latest
        # Controls of few coefficients would smooth most of the unevenness away.
        free = plain_mesh(self.auditors, 10, 4, degree=INNER_DEGREE)
        mesh = self.options.mesh or free
        for share in UNEVENNESS:
            names = ", ".join(repr(name) for name, _ in still)
            words = f"{names} stayed at its guess; a start without symmetry is tried"
            self.history.note(solution, None, words)
            solution = self.attempts.attempt(mesh, uneven(given, still, table, share))
            gain = sign * (best.objective - solution.objective)
            if solution.result.usable and gain > 1e-6 * abs(best.objective):
                best, built = solution, self.attempts.latest
        self.attempts.latest = built
        return best

    def _other_durations(
        self, guess: Guess | Solution | None
    ) -> list[dict[str, float]]:
        """Orders of magnitude for durations of which nothing is known."""
        if guess is not None:
            return []
        known, table = self.attempts.scales, self.attempts.table
        bounds = {p.name: table["duration", p.name] for p in self.problem.phases}
        least = {
            f"{name}.duration": max(low, 1.0)
            for name, (low, high) in bounds.items()
            if not np.isfinite(high) and f"{name}.duration" not in known
        }
        if not least:
            return []
        return [
            {name: low * factor for name, low in least.items()}
            for factor in (1e2, 1e4, 1e-2, 1e6)
        ]

    def start(self, solution: Solution) -> Judgement:
        """Judge the first solution."""
        none: list[Structure | None] = [None] * len(self.problem.phases)
        judgement = self.judge(solution, None, none)
        self.accept(judgement)
        return judgement

    def done(self, best: Judgement) -> bool:
        """Whether all errors are within the tolerance."""
        return best.greatest <= self.options.tolerance

    def better(self, best: Judgement, current: Judgement) -> Judgement:
        """Return what errs less."""
        return min(best, current, key=lambda passed: passed.merit)

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
            program=self.attempts.latest,
            table=self.attempts.table,
            tolerance=self.options.tolerance,
            mended=mended,
        )

    def take(self, proposal: Proposal, current: Judgement) -> Judgement | None:
        """Solve and judge a proposal; ``None`` if it is no step forward."""
        switching, former_before = proposal.places_switches, self.attempts.former
        base = self.options.solver
        unknowns = self.attempts.unknowns(proposal.mesh)
        limit = base.iterations
        if switching:
            limit = min(limit, int(np.clip(TRIAL_EFFORT / unknowns, 60, 150)))
        accuracy = base.tolerance
        error = current.error.objective / self.options.tolerance
        if unknowns > CHEAP and error > 1.0:
            # The program's objective is the problem's over this scale.
            scale = self.attempts.scales.get("objective", 1.0)
            share = min(1.0, abs(current.solution.objective) / scale)
            accuracy = max(accuracy, share * (LOOSE if error > 1e3 else CLOSE))
        self.loose = accuracy > CLOSE
        solution = self.attempts.attempt(
            proposal.mesh,
            current.solution,
            arcs=proposal.arcs,
            structures=proposal.structures,
            solver=replace(
                base,
                iterations=limit,
                tolerance=accuracy,
            ),
        )
        if not solution.result.usable and not switching:
            solution = self._afresh(proposal, current, solution)
        fresh = None
        if solution.result.usable and not is_worse(self.problem, solution, current):
            former = None if switching else current
            fresh = self.judge(
                solution, former, proposal.structures, mended=proposal.complete
            )
            fresh = self._closed(proposal, former, fresh)
            if switching and not self._helps(fresh, current):
                fresh = None
        if fresh is None:
            self.history.note(solution, None, "no better; back to the mesh before")
            # The mesh before is still there to start from, if it is not to blame.
            self.attempts.former = former_before if switching else None
        else:
            self.accept(fresh)
        return fresh

    def _helps(self, fresh: Judgement, current: Judgement) -> bool:
        """Whether arcs found a better optimum, or about the same one as well."""
        if refutes(self.problem, fresh, current):
            return True
        # Wrong arcs are mended by the next meshes, if these cost little.
        costly = fresh.solution.multipliers.unknowns.size > CHEAP
        error = fresh.error.objective
        most = max(2.0 * current.error.objective, self.options.tolerance)
        rough = max(fresh.error.dynamics, fresh.error.path)
        # A mesh of few intervals may miss the dynamics where it bends; that is no
        # fault of its arcs if they tell the objective better.
        better = error <= current.error.objective
        allowed = max(ROUGH if better else 0.0, 3.0 * current.greatest)
        return rough <= allowed and not (costly and error > most)

    def _closed(
        self, proposal: Proposal, former: Judgement | None, fresh: Judgement
    ) -> Judgement:
        """Solve again, tighter, where only what the solver left open errs too much.

        Another mesh would leave as much open.
        """
        share = fresh.solution.slack / objective_size(fresh.solution)
        error = replace(fresh.error, objective=fresh.error.objective - share)
        if self.reached(fresh) or not self.reached(replace(fresh, error=error)):
            return fresh
        words = f"the solver leaves {share:.1e} of the objective open; again, tighter"
        self.history.note(fresh.solution, fresh, words)
        base, self.attempts.former = self.options.solver, self.attempts.latest
        solution = self.attempts.attempt(
            proposal.mesh,
            fresh.solution,
            arcs=proposal.arcs,
            structures=proposal.structures,
            solver=replace(base, tolerance=TIGHTER * base.tolerance),
        )
        if not solution.result.usable or is_worse(self.problem, solution, fresh):
            return fresh
        closer = self.judge(
            solution, former, proposal.structures, mended=proposal.complete
        )
        return closer if closer.error.objective < fresh.error.objective else fresh

    def reached(self, current: Judgement) -> bool:
        """Whether all errors are within the tolerance, the objective's by far."""
        tolerance, error = self.options.tolerance, current.error
        least = max(error.dynamics, error.path) <= tolerance
        return least and error.objective <= CAUTION * tolerance

    def _afresh(
        self, proposal: Proposal, current: Judgement, failed: Solution
    ) -> Solution:
        """Try a mesh on which the solver failed in other ways."""
        base = self.options.solver
        self.attempts.former = None
        if failed.iterations * failed.multipliers.unknowns.size > 0.5 * EFFORT:
            return failed
        starts: tuple[tuple[Guess | Solution | None, dict[str, object]], ...] = (
            (self.guess, {"mu_oracle": "probing"}),
            (current.solution, {"mu_strategy": "monotone"}),
        )
        solution = failed
        for guess, strategy in starts:
            self.history.note(solution, None, "the solver failed; it starts afresh")
            solution = self.attempts.attempt(
                proposal.mesh,
                guess,
                arcs=proposal.arcs,
                structures=proposal.structures,
                solver=replace(base, extra={**strategy, **base.extra}),
            )
            if solution.result.usable:
                break
        return solution

    def step(self, current: Judgement) -> Judgement | None:
        """Solve the next mesh: one whose arcs are new if there are any, or a finer one.

        Returns
        -------
        Judgement or None
            ``None``: nothing better was found.
        """
        proposal = self.arcs(current)
        if proposal is not None:
            number = len(self.history.records)
            self.history.note(current.solution, current, proposal)
            fresh = self.take(proposal, current)
            if fresh is not None:
                return fresh
            self.refused += [s for s in proposal.structures if s is not None]
            if self.attempts.unknowns(proposal.mesh) > CHEAP:
                self.trials = 0
            proposal = self.finer(current)
            if proposal is not None:
                self.history.amend(number, proposal)
        else:
            proposal = self.finer(current)
            if proposal is not None:
                self.history.note(current.solution, current, proposal)
        return None if proposal is None else self.take(proposal, current)

    def arcs(self, current: Judgement) -> Proposal | None:
        """Return a mesh whose arcs are those of a solution, if they are new."""
        if self.trials <= 0 or (self.loose and self._open(current)):
            return None
        table = self.attempts.table
        proposal = place_switches(current, self.auditors, table, self.refused)
        self.trials -= proposal is not None
        return proposal

    @staticmethod
    def _open(current: Judgement) -> bool:
        """Whether the solver left open a good part of what the mesh errs by."""
        share = current.solution.slack / objective_size(current.solution)
        return share > OPEN * current.error.objective

    def finer(self, current: Judgement) -> Proposal | None:
        """Return the next finer mesh; ``None``: there is none, or it is too large."""
        proposal = refined(current, self.options)
        same = with_ends(self.problem, proposal.mesh) == current.solution.mesh
        large = proposal.mesh.point_count > self.options.points
        return None if same or large else proposal

    def accept(self, judgement: Judgement) -> None:
        """Let later meshes start from a solution, if it is worth it."""
        good = judgement.error.dynamics < ROUGH
        self.attempts.former = self.attempts.latest if good else None
        if good and not self.rescaled:
            self.rescaled = True
            self.attempts.rescale(judgement.solution)
