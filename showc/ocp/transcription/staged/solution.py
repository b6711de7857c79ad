"""What a staged solve starts from, how it is done, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from showc.ocp.outcome import Result

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray


StagedSolver = Literal["fatrop", "ipopt"]


@dataclass(frozen=True, slots=True, eq=False)
class StagedGuess:
    """Where a solve starts."""

    states: FloatArray
    """Values at the K + 1 borders, shape (K + 1, states), problem's order and units."""
    controls: FloatArray
    """Coefficients of all controls, shape (K, inputs): control by control."""


@dataclass(frozen=True, slots=True, eq=False)
class StagedSolution:
    """What a staged solve gives."""

    result: Result
    message: str
    """The constraint that is broken most, and where; empty when none is."""
    widths: FloatArray
    """Widths of the intervals, shape (K,)."""
    nodes: FloatArray
    """States at the borders, shape (K + 1, states)."""
    inputs: FloatArray
    """Coefficients of the controls, shape (K, inputs)."""
    coefficients: Mapping[str, FloatArray]
    """Bernstein coefficients (K, degree + 1) of every state and control."""
    objective: float
    iterations: int
    violation: float
    """Greatest scaled violation of a row, dynamics included."""

    @property
    def duration(self) -> float:
        """Duration of the phase."""
        return float(self.widths.sum())

    @property
    def guess(self) -> StagedGuess:
        """The solution as a start for another solve on the same number of intervals."""
        return StagedGuess(self.nodes, self.inputs)


@dataclass(frozen=True, slots=True)
class StagedOptions:
    """How a staged program is built and solved."""

    solver: StagedSolver = "fatrop"
    tolerance: float = 1e-6
    iterations: int = 200
    seconds: float = 20.0
    """Greatest CPU time of one solve by IPOPT [s]; a guard, not a means of control."""
    barrier: float = 1e-2
    """First barrier parameter."""
    points: int = 4
    """Gauss points of derivatives that are no polynomials."""
    cost_points: int = 2
    """Gauss points of running costs."""
    inset: float = 1e-6
    """How far inside their bounds rows are kept, scaled, so that what the solver's
    tolerance leaves stays within."""
    width_range: tuple[float, float] = (0.1, 3.0)
    """Least and greatest ratio of a movable width to the one it starts from."""
    width_weight: float = 1e-4
    """Weight that keeps movable widths near those they start from."""
    extra: Mapping[str, object] = field(default_factory=dict)
    """Further options handed to the solver."""


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What the solver gave: a point of the scaled program."""

    unknowns: FloatArray
    rows: FloatArray
    """Values of the constraint rows at that point."""
    objective: float
    statistics: Mapping[str, Any]
    """``success`` and ``iter_count`` at least."""


def result_of(*, success: bool, violation: float) -> Result:
    """Translate how a staged solve ended; ``violation`` is that of its worst row."""
    if not np.isfinite(violation):
        return Result.INVALID_NUMBER
    if success:
        return Result.SOLVED
    if violation < 1e-6:
        return Result.ACCEPTABLE
    return Result.INFEASIBLE
