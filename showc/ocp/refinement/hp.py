"""hp-refinement: intervals cut or raised one by one, switch times as unknowns."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit.optimality import objective_size
from showc.ocp.history import Decision
from showc.ocp.refinement.collocated import Collocated
from showc.ocp.refinement.first_mesh import FirstMesh
from showc.ocp.refinement.judgement import Judgement, is_worse, judge, refutes
from showc.ocp.refinement.options import (
    CAUTION,
    CHEAP,
    CLOSE,
    EFFORT,
    EVEN,
    INNER_DEGREE,
    LEAPS,
    LOOSE,
    OPEN,
    ROUGH,
    SWITCH_TRIALS,
    TIGHTER,
    TRIAL_EFFORT,
    VAGUE,
)
from showc.ocp.refinement.proposal import (
    Proposal,
    better_guess,
    halved,
    place_switches,
    plain_mesh,
    refined,
    with_ends,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.ocp.guess import Guess
    from showc.ocp.mesh import Mesh
    from showc.ocp.refinement.attempts import Attempts
    from showc.ocp.refinement.switches import Structure
    from showc.ocp.solution import Solution
    from showc.ocp.transcription.solver import SolverOptions


class Hp(Collocated):
    """Refinement by intervals and arcs."""

    def __init__(self, attempts: Attempts, guess: Guess | Solution | None) -> None:
        super().__init__(attempts, guess)
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
        self.leaps = LEAPS
        """How often controls may still be put into other valleys."""
        self.even: tuple[int, ...] = EVEN
        """Even meshes that may still be tried."""

    def first(self) -> Solution:
        """Solve the first mesh, by other ways where the plain one fails."""
        return FirstMesh(self.attempts, self.auditors, self.history).solve(self.guess)

    def start(self, solution: Solution) -> Judgement:
        """Judge the first solution."""
        none: list[Structure | None] = [None] * len(self.problem.phases)
        judgement = self.judge(solution, None, none)
        self.accept(judgement)
        return judgement

    def done(self, best: Judgement) -> bool:
        """Whether all errors are within the tolerance."""
        return best.greatest <= self.options.tolerance

    def keep(self, best: Judgement, current: Judgement) -> Judgement:
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
            self.attempts, self.auditors, solution, former, structures, mended=mended
        )

    def take(self, proposal: Proposal, current: Judgement) -> Judgement | None:
        """Solve and judge a proposal; ``None`` if it is no step forward."""
        switching, former_before = proposal.places_switches, self.attempts.former
        base = self.options.solver
        unknowns = self.attempts.unknowns(proposal.mesh)
        if switching:
            base = self._trial(proposal.mesh)
        accuracy = base.tolerance
        # What the solver left open is no fault of the mesh.
        error = current.error.objective - self._left_open(current)
        error /= self.options.tolerance
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
            solver=replace(base, tolerance=accuracy),
        )
        if not switching and not self._forward(solution, current):
            proposal, solution = self._afresh(proposal, current, solution)
        fresh = None
        if self._forward(solution, current):
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

    def _trial(self, mesh: Mesh) -> SolverOptions:
        """Options of a solve that is given up soon: arcs, say, that may be wrong."""
        base = self.options.solver
        most = int(np.clip(TRIAL_EFFORT / self.attempts.unknowns(mesh), 60, 200))
        return replace(base, iterations=min(base.iterations, most))

    def _forward(self, solution: Solution, current: Judgement) -> bool:
        """Whether the solver found a solution, and none that is clearly worse."""
        usable = solution.result.usable
        return usable and not is_worse(self.problem, solution, current)

    def _helps(self, fresh: Judgement, current: Judgement) -> bool:
        """Whether arcs found a better optimum, or about the same one as well."""
        if refutes(self.problem, fresh, current):
            return True
        sign = -1.0 if self.problem.maximises else 1.0
        loss = sign * (fresh.solution.objective - current.solution.objective)
        size = objective_size(current.solution)
        if loss / size > current.error.objective + current.flattery + ROUGH:
            return False
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
        share = self._left_open(fresh)
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
    ) -> tuple[Proposal, Solution]:
        """Try a mesh that was no step forward in other ways, or an even one.

        An even one is tried where the solution before tells too little to start from.
        """
        base = self.options.solver
        self.attempts.former = None
        if failed.iterations * failed.multipliers.unknowns.size > 0.5 * EFFORT:
            return proposal, failed
        ways: list[tuple[Proposal, Guess | Solution | None, dict[str, object]]] = [
            (proposal, self.guess, {"mu_oracle": "probing"}),
            (proposal, current.solution, {"mu_strategy": "monotone"}),
        ]
        if current.error.objective > VAGUE:
            ways = [(self._even(count), self.guess, {}) for count in self.even]
            self.even = ()
        solution = failed
        for other, guess, strategy in ways:
            found = "worse" if solution.result.usable else "the solver failed"
            self.history.note(solution, None, f"{found}; it starts afresh")
            solution = self.attempts.attempt(
                other.mesh,
                guess,
                arcs=other.arcs,
                structures=other.structures,
                solver=replace(base, extra={**strategy, **base.extra}),
            )
            if self._forward(solution, current):
                return other, solution
        return proposal, solution

    def _even(self, count: int) -> Proposal:
        """Mesh of equal intervals, whatever was found before."""
        mesh = plain_mesh(self.auditors, count, 4, degree=INNER_DEGREE)
        return Proposal(
            mesh,
            None,
            (None,) * len(mesh.phases),
            tuple((Decision(),) * part.intervals for part in mesh.phases),
            f"{count} equal intervals",
            complete=False,
        )

    def step(self, current: Judgement) -> Judgement | None:
        """Solve the next mesh: one whose arcs are new if there are any, or a finer one.

        Returns
        -------
        Judgement or None
            ``None``: nothing better was found.
        """
        if (elsewhere := self._in_other_valleys(current)) is not None:
            return elsewhere
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
        if proposal is None:
            return None
        fresh = self.take(proposal, current)
        # A mesh that was no better tells little of what would be.
        return fresh or self._halved(current)

    def _in_other_valleys(self, current: Judgement) -> Judgement | None:
        """Start again where controls are in the lowest valleys of the Hamiltonian.

        No search leads there from the others; ``None`` if that gave nothing better.
        """
        size, solution = objective_size(current.solution), current.solution
        missed = sum(float(audit.by_control[-1].sum()) for audit in current.audits)
        if self.leaps <= 0 or missed <= self.options.tolerance * size:
            return None
        self.leaps -= 1
        words = "controls start again where the Hamiltonian is least"
        self.history.note(solution, current, words)
        former, self.attempts.former = self.attempts.former, None
        fresh = self.attempts.attempt(
            solution.mesh,
            better_guess(solution, current.audits),
            arcs=tuple(part.arc_durations for part in solution.phases),
            structures=current.structures,
            solver=self._trial(solution.mesh),
        )
        sign = -1.0 if self.problem.maximises else 1.0
        gain = sign * (solution.objective - fresh.objective)
        if fresh.result.usable and gain > self.options.tolerance * size:
            judgement = self.judge(fresh, None, current.structures)
            self.accept(judgement)
            return judgement
        self.history.note(fresh, None, "no better; back to the mesh before")
        self.attempts.former = former
        return None

    def _halved(self, current: Judgement) -> Judgement | None:
        """Solve a mesh with every interval halved, if programs of it are cheap."""
        proposal = halved(current)
        if self.attempts.unknowns(proposal.mesh) > CHEAP or not self.goes_on():
            return None
        self.history.note(current.solution, current, proposal)
        return self.take(proposal, current)

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
        return Hp._left_open(current) > OPEN * current.error.objective

    @staticmethod
    def _left_open(current: Judgement) -> float:
        """Return what the solver left open, relative to the objective."""
        return current.solution.slack / objective_size(current.solution)

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
