"""The refinement loop: solve, judge, propose the next mesh, repeat.

It serves both forms of the transcription. Collocation proposes meshes by what an audit
finds (:mod:`showc.ocp.refinement.hp`, :mod:`showc.ocp.refinement.graded`). Condensed
programs, which are built before a problem is known, go through meshes of few sizes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

Judged = TypeVar("Judged")
"""A solved mesh with what it is worth."""


class Strategy(ABC, Generic[Judged]):
    """First mesh, judgement of a solution, and proposal of the next mesh."""

    @abstractmethod
    def begin(self) -> Judged | None:
        """Solve and judge a first mesh; ``None``: there is no solution."""

    @abstractmethod
    def reached(self, current: Judged) -> bool:
        """Whether a solution is what the refinement aims at."""

    @abstractmethod
    def step(self, current: Judged) -> Judged | None:
        """Solve and judge the next mesh; ``None``: nothing better was found."""

    def goes_on(self) -> bool:
        """Whether meshes and effort are left."""
        return True

    def better(self, best: Judged, current: Judged) -> Judged:  # noqa: ARG002
        """Return the better of the best so far and the latest."""
        return current


def refine(work: Strategy[Judged]) -> Judged | None:
    """Refine until the aim is reached, or nothing better is found.

    Returns
    -------
    The best; ``None`` where there was no first one.
    """
    best = current = work.begin()
    while current is not None and work.goes_on() and not work.reached(current):
        current = work.step(current)
        if best is not None and current is not None:
            best = work.better(best, current)
    return best
