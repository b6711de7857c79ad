"""What refinement of a collocated problem needs whatever its next mesh."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING

from showc.ocp.audit.residuals import PhaseAuditor
from showc.ocp.refinement.judgement import Judgement
from showc.ocp.refinement.recorder import Recorder
from showc.ocp.refinement.strategy import Strategy

if TYPE_CHECKING:
    from showc.ocp.guess import Guess
    from showc.ocp.refinement.attempts import Attempts
    from showc.ocp.solution import Solution


class Collocated(Strategy[Judgement]):
    """Refinement of a collocated problem.

    Parameters
    ----------
    attempts
        Solves the problem on any mesh.
    guess
        Where the search starts.
    """

    latest: Judgement

    def __init__(self, attempts: Attempts, guess: Guess | Solution | None) -> None:
        self.attempts, self.options, self.guess = attempts, attempts.options, guess
        problem = self.problem = attempts.problem
        self.auditors = [
            PhaseAuditor(problem, phase, i) for i, phase in enumerate(problem.phases)
        ]
        self.history = Recorder(self.options.progress)
        self._unusable: Solution
        self._tried = 0

    @abstractmethod
    def first(self) -> Solution:
        """Solve the first mesh, by other ways where the plain one fails."""

    @abstractmethod
    def start(self, solution: Solution) -> Judgement:
        """Judge the first solution."""

    def begin(self) -> Judgement | None:
        """Solve and judge a first mesh."""
        solution = self.first()
        if not solution.result.usable:
            self._unusable = solution
            return None
        self.attempts.effort, self._tried = 0.0, len(self.history.records)
        self.latest = self.start(solution)
        return self.latest

    def goes_on(self) -> bool:
        """Whether meshes and effort are left, tries of a first solution aside."""
        few = len(self.history.records) - self._tried < self.options.meshes - 1
        return few and self.attempts.effort < self.options.effort

    def better(self, best: Judgement, current: Judgement) -> Judgement:
        """Return what is to be kept, and remember the latest."""
        self.latest = current
        return self.keep(best, current)

    def keep(self, best: Judgement, current: Judgement) -> Judgement:  # noqa: ARG002
        """Return the better of the two."""
        return current

    def done(self, best: Judgement) -> bool:
        """Whether a solution is within what was asked for."""
        return self.reached(best)

    def failed(self, words: str) -> Solution:
        """Return the first solution that was none, with all that was tried."""
        self.history.note(self._unusable, None, words)
        message = self._unusable.message
        if kinks := self.problem.kinks:
            message += (
                f" The statement uses {', '.join(kinks)}, whose slope jumps: the "
                "search does not end at such a place. State |u| as the sum of two "
                "controls that are not negative, u as their difference."
            )
        return replace(
            self._unusable,
            message=message,
            iterations=self.attempts.iterations,
            history=tuple(self.history.records),
        )
