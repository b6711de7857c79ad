"""Whether couplings hold at every instant, from Bernstein coefficients.

States are polynomials on each mesh interval, so a coupling of degree d in the states
is a polynomial of degree d N there. Its Bernstein coefficients enclose it (Farouki
2012); where they do not decide, the interval is halved. No instant is missed, however
short.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp import scaling
from showc.ocp.coupling import merged, polynomial_degree
from showc.ocp.nodes import fitting_points
from showc.trajectory import bernstein_basis, bernstein_basis_inverse, restrict

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.solution import PhaseSolution, Solution
    from showc.ocp.transcription.collocation.statement import Table


KEPT = 1e-9
"""Violation over the scale of a coupling that counts as rounding."""
_HALVINGS = 20
"""Halvings of a piece after which the rest, a millionth, is taken at its bound."""


@dataclass(frozen=True, slots=True)
class Violation:
    """Where a coupling is violated, and by how much."""

    phase: int
    name: str
    amount: float
    """Greatest violation, in the unit of the coupling; never too small."""
    place: float
    """Where that is, as a fraction of the phase."""
    time: float
    stretches: tuple[tuple[float, float], ...]
    """Mesh intervals with violations, as fractions of the phase."""


class CouplingAuditor:
    """The couplings of one phase, ready to be evaluated; made once per problem."""

    def __init__(self, problem: Problem, phase: Phase, index: int) -> None:
        self.phase, self.index = phase, index
        (x, _), p = phase.members, problem.given
        self._degrees = [polynomial_degree(c.symbol, x) or 0 for c in phase.couplings]
        self._functions: list[Any] = [
            casadi.Function(f"coupling{i}", [x, p], [c.symbol])
            for i, c in enumerate(phase.couplings)
        ]

    def violations(self, solution: Solution, table: Table) -> list[Violation]:
        """Couplings that ``solution`` violates somewhere, in the order stated."""
        part = solution.phases[self.index]
        values = [*solution.parameters.values(), *solution.statics.values()]
        p = np.array(values, dtype=np.float64)
        found = []
        for number, coupling in enumerate(self.phase.couplings):
            low, high = table["coupling", self.phase.name, coupling.name]
            rounding = KEPT * scaling.of_path(low, high)
            coefficients, noise = self._coefficients(part, number, p)
            sides = []
            if np.isfinite(low):
                sides.append(low - noise - coefficients)
            if np.isfinite(high):
                sides.append(coefficients - high - noise)
            for excess in sides:
                violation = self._violation(part, coupling.name, excess, rounding)
                if violation is not None:
                    found.append(violation)
        return found

    def _coefficients(
        self, part: PhaseSolution, number: int, p: FloatArray
    ) -> tuple[FloatArray, float]:
        """Bernstein coefficients (K, degree + 1) of a coupling, and their rounding."""
        states = part.states
        degree = self._degrees[number] * states.degree
        nodes = fitting_points(degree)
        basis = bernstein_basis(states.degree, np.array(nodes))
        x = np.einsum("sj,kjc->ksc", basis, states.coefficients)
        flat = x.reshape(-1, states.components).T
        function = self._functions[number].map(flat.shape[1])
        value = np.asarray(function(flat, np.repeat(p[:, None], flat.shape[1], axis=1)))
        value = value.reshape(states.intervals, len(nodes))
        inverse = bernstein_basis_inverse(degree, nodes)
        growth = float(np.abs(inverse).sum(axis=1).max())
        noise = 4.0 * np.finfo(np.float64).eps * growth * float(np.abs(value).max())
        return value @ inverse.T, noise

    def _violation(
        self, part: PhaseSolution, name: str, excess: FloatArray, rounding: float
    ) -> Violation | None:
        """Greatest value above 0 of the polynomials ``excess`` (K, degree + 1)."""
        found = greatest(excess, rounding)
        if found is None:
            return None
        fractions = (part.states.breaks - part.start) / part.duration
        low, high = fractions[found.interval], fractions[found.interval + 1]
        place = float(low + found.place * (high - low))
        return Violation(
            self.index,
            name,
            found.value,
            place,
            part.start + place * part.duration,
            merged(
                [
                    (float(fractions[k]), float(fractions[k + 1]))
                    for k in found.intervals
                ]
            ),
        )


@dataclass(frozen=True, slots=True)
class Greatest:
    """The greatest value of a piecewise polynomial, where it exceeds a threshold."""

    value: float
    """Never too small; by how much too great is at most some 1e-3 of it."""
    interval: int
    place: float
    """Fraction of that interval."""
    intervals: tuple[int, ...]
    """All intervals in which the threshold is exceeded."""


def greatest(polynomials: FloatArray, threshold: float) -> Greatest | None:
    """Find the greatest value of polynomials, ``None`` if none exceeds ``threshold``.

    Halves what is not decided: a piece whose greatest coefficient is below the
    threshold keeps it throughout, one with an end above it does not.

    Parameters
    ----------
    polynomials
        Bernstein coefficients on each interval, shape (K, degree + 1).
    threshold
        Not negative.
    """
    pieces = np.nonzero(polynomials.max(axis=1) > threshold)[0]
    if not pieces.size:
        return None
    work = polynomials[pieces]
    left, width = np.zeros(pieces.size), 1.0
    best, where = -np.inf, (0, 0.0)
    broken = np.zeros(polynomials.shape[0], dtype=np.bool_)
    for step in range(_HALVINGS + 1):
        ends = np.maximum(work[:, 0], work[:, -1])
        if step == _HALVINGS:
            # What is still open is taken at its bound: too much, never too little.
            ends = work.max(axis=1)
        broken[pieces[ends > threshold]] = True
        top = int(np.argmax(ends))
        if ends[top] > best:
            best = float(ends[top])
            late = work[top, -1] >= work[top, 0]
            where = int(pieces[top]), float(left[top] + (width if late else 0.0))
        # Only where something greater may hide, or something is undecided.
        bound = work.max(axis=1)
        enough = max(threshold, best + 1e-3 * abs(best))
        keep = (bound > threshold) & ~(broken[pieces] & (bound <= enough))
        if not keep.any() or step == _HALVINGS:
            break
        work, pieces, left = work[keep], pieces[keep], left[keep]
        half = np.full((work.shape[0], 1, 1), 0.5)
        zero, one = np.zeros_like(half), np.ones_like(half)
        columns = work[:, :, None]
        work = np.concatenate(
            [restrict(columns, zero, half), restrict(columns, half, one)]
        )[:, :, 0]
        width *= 0.5
        pieces = np.concatenate([pieces, pieces])
        left = np.concatenate([left, left + width])
    if not broken.any():
        return None
    intervals = tuple(np.nonzero(broken)[0].tolist())
    return Greatest(best * (1.0 + 1e-3), where[0], where[1], intervals)
