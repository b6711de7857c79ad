"""Starts that share every symmetry of a problem, and how to break it.

A start with every symmetry of the problem leads to an extremum with the same symmetry,
which is often no minimum: the search cannot leave it, as all its steps are symmetric
too. What tells is a bounded control that ends where the guess had put it, in the middle
between its bounds, at every instant.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.scaling import GOLDEN

if TYPE_CHECKING:
    from showc.ocp.guess import Guess
    from showc.ocp.problem import Problem
    from showc.ocp.solution import Solution
    from showc.ocp.transcription.collocation.limits import Table


_STILL = 1e-6
"""Share of its range by which a control has moved that counts as moved."""
_VALUES = 41
"""Values of the curve that breaks a symmetry: as 40 intervals can tell apart."""


def unmoved(
    problem: Problem, solution: Solution, table: Table
) -> list[tuple[str, int]]:
    """Return names of controls that stayed in the middle of their bounds throughout.

    Parameters
    ----------
    problem, solution
        What was solved from a guess that tells nothing of these controls.
    table
        The bounds of the solve.

    Returns
    -------
    list
        ``"phase.control"`` and a number for each, in the problem's order.
    """
    found: list[tuple[str, int]] = []
    for phase, part in zip(problem.phases, solution.phases, strict=True):
        for j, name in enumerate(phase.controls):
            low, high = table["bounds", phase.name, name]
            span = high - low
            if not np.isfinite(span) or span <= 0.0:
                continue
            values = part.controls.coefficients[:, :, j]
            if np.abs(values - 0.5 * (low + high)).max() < _STILL * span:
                found.append((f"{phase.name}.{name}", len(found)))
    return found


def uneven(
    guess: Guess, names: list[tuple[str, int]], table: Table, share: float
) -> Guess:
    """Return a guess in which the controls ``names`` have no symmetry.

    They differ from the middle by up to half of ``share`` of their range, by the
    fractional parts of multiples of the golden ratio: the same in every run.
    """
    curves = dict(guess.curves)
    for name, number in names:
        phase, control = name.split(".", 1)
        low, high = table["bounds", phase, control]
        steps = np.arange(_VALUES) + 1.0 + _VALUES * number
        pattern = (steps * GOLDEN) % 1.0 - 0.5
        offset = share * (high - low) * pattern
        curves[name] = np.asarray(0.5 * (low + high) + offset, dtype=np.float64)
    return replace(guess, curves=curves)
