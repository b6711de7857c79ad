"""What the refinement loop asks of a way to find the next mesh."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from showc.ocp.audit.residuals import PhaseAuditor
from showc.ocp.refinement.recorder import Recorder

if TYPE_CHECKING:
    from showc.ocp.guess import Guess
    from showc.ocp.refinement.attempts import Attempts
    from showc.ocp.refinement.judgement import Judgement
    from showc.ocp.solution import Solution


class Strategy(ABC):
    """First mesh, judgement of a solution, and proposal of the next mesh.

    Parameters
    ----------
    attempts
        Solves the problem on any mesh.
    """

    def __init__(self, attempts: Attempts) -> None:
        self.attempts, self.options = attempts, attempts.options
        problem = self.problem = attempts.problem
        self.auditors = [
            PhaseAuditor(problem, phase, i) for i, phase in enumerate(problem.phases)
        ]
        self.history = Recorder(self.options.progress)

    @abstractmethod
    def first(self, guess: Guess | Solution | None) -> Solution:
        """Solve the first mesh, by other ways where the plain one fails."""

    @abstractmethod
    def start(self, solution: Solution) -> Judgement:
        """Judge the first solution."""

    @abstractmethod
    def reached(self, current: Judgement) -> bool:
        """Whether all errors are within what the refinement aims at."""

    @abstractmethod
    def step(self, current: Judgement) -> Judgement | None:
        """Solve and judge the next mesh; ``None``: nothing better was found."""

    def done(self, best: Judgement) -> bool:
        """Whether a solution is within what was asked for."""
        return self.reached(best)

    def better(self, best: Judgement, current: Judgement) -> Judgement:  # noqa: ARG002
        """Return the better of the best so far and the latest."""
        return current
