"""How far a solution stays from everything that limits it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit.residuals import PhaseAuditor
from showc.ocp.transcription.collocation.limits import Overrides
from showc.ocp.transcription.collocation.statement import Statement

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.ocp.problem import Problem
    from showc.ocp.solution import Solution


@dataclass(frozen=True, slots=True, eq=False)
class Margin:
    """One limited quantity of one phase, over time."""

    phase: str
    name: str
    kind: str
    """``state``, ``control`` or ``path``."""
    times: FloatArray
    """Shape (n,), increasing; borders of intervals occur twice."""
    values: FloatArray
    """The quantity at those times, shape (n,)."""
    lower: float
    """Least value allowed; minus infinity if there is none."""
    upper: float
    """Greatest value allowed; infinity if there is none."""

    @property
    def room(self) -> FloatArray:
        """Distance to the nearer bound over the range allowed, shape (n,).

        Where only one side is bounded the range is that of the values themselves.
        Negative: the bound is exceeded.
        """
        span = self.upper - self.lower
        if not np.isfinite(span):
            span = max(float(np.ptp(self.values)), 1e-12)
        elif span == 0.0:
            span = max(abs(self.lower), 1e-12)
        near = np.minimum(self.values - self.lower, self.upper - self.values)
        return np.asarray(near / span)


def margins(
    problem: Problem,
    solution: Solution,
    *,
    overrides: Overrides | None = None,
    places: int = 16,
) -> tuple[Margin, ...]:
    """Return values and bounds of every limited state, control and path constraint.

    Parameters
    ----------
    problem, solution
        What was solved, and the answer.
    overrides
        What the solve was given besides the problem; bounds that hold interval by
        interval count as one, the widest.
    places
        Instants on each mesh interval, both borders included.

    Returns
    -------
    tuple of Margin
        Phase by phase: states, controls, path constraints, in the order of their
        statement. Times and values are in the problem's own units.
    """
    statement = Statement(problem)
    given = dict(solution.parameters)
    table = statement.table(statement.parameters(given))
    changed = (overrides or Overrides()).bounds
    share = np.linspace(0.0, 1.0, places)
    found: list[Margin] = []
    for i, (phase, part) in enumerate(
        zip(problem.phases, solution.phases, strict=True)
    ):
        breaks = part.states.breaks
        # Just inside the borders, so that jumps of controls are drawn as jumps.
        inside = 1e-9 + (1.0 - 2e-9) * share
        times = (breaks[:-1, None] + np.diff(breaks)[:, None] * inside).ravel()
        rows = [
            ("state", name, part.state(name)(times)[:, 0]) for name in phase.states
        ] + [
            ("control", name, part.control(name)(times)[:, 0])
            for name in phase.controls
        ]
        for kind, name, values in rows:
            low, high = table["bounds", phase.name, name]
            new = changed.get(f"{phase.name}.{name}", changed.get(name))
            if new is not None:
                low, high = float(np.min(new[0])), float(np.max(new[1]))
            if np.isfinite(low) or np.isfinite(high):
                found.append(Margin(phase.name, name, kind, times, values, low, high))
        if phase.path_constraints:
            auditor = PhaseAuditor(problem, phase, i)
            values = auditor.path_values(solution, times)
            for constraint, row, (low, high) in zip(
                phase.path_constraints, values, auditor.path_bounds(table), strict=True
            ):
                found.append(
                    Margin(
                        phase.name,
                        constraint.name,
                        "path",
                        times,
                        row,
                        float(low),
                        float(high),
                    )
                )
    return tuple(found)
