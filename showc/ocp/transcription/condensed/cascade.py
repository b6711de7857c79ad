"""Cascades: dynamics that can be integrated one state after the other.

Let no state's derivative depend on the state itself, directly or by way of others. Then
the polynomials of one mesh interval follow from the values at its start and from the
controls in closed form. No unknowns are needed inside the interval:

- a derivative linear in polynomials (constant factors) is a polynomial; its integral
  is exact, one degree higher;
- any other derivative is collocated: interpolated at the N Legendre-Gauss points of
  the interval, its integral a polynomial of degree N. As the points' values are known
  this equals N-point Gauss collocation of that state (Hairer, Norsett, Wanner 1993,
  section II.7), its value at the end of the interval correct to order 2N.

All polynomials are in Bernstein form: bounds on coefficients hold at every instant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.nodes import collocation, fitting_points
from showc.trajectory import bernstein_basis, bernstein_basis_inverse

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.ocp.phase import Phase
    from showc.ocp.transcription.condensed.lifting import Lifting

Symbol = Any
"""A CasADi ``SX`` scalar."""

HIGHEST = 4
"""Degree of the expressions whose exact coefficients are worked out: squares of
products."""

Coefficients = list[Symbol]
"""Bernstein coefficients of one scalar polynomial on one interval."""


def elevate(coefficients: Coefficients, degree: int) -> Coefficients:
    """Bernstein coefficients of the same polynomial, written with ``degree``."""
    current = list(coefficients)
    while len(current) <= degree:
        n = len(current)
        current = [
            current[0],
            *(
                (k / n) * current[k - 1] + (1.0 - k / n) * current[k]
                for k in range(1, n)
            ),
            current[-1],
        ]
    return current


def value_at(coefficients: Coefficients, fraction: float) -> Symbol:
    """Value of the polynomial at ``fraction`` of the interval."""
    basis = bernstein_basis(len(coefficients) - 1, fraction)
    return sum(float(b) * c for b, c in zip(basis, coefficients, strict=True))


def depends_on(expression: Symbol, names: Mapping[str, Symbol]) -> list[str]:
    """Return the names whose symbols occur in ``expression``."""
    found = {str(symbol) for symbol in casadi.symvar(expression)}
    return [name for name, symbol in names.items() if str(symbol) in found]


@dataclass(frozen=True, slots=True)
class Composition:
    """How an expression of states and controls is built from their polynomials."""

    expression: Symbol
    members: tuple[str, ...]
    """States and controls it depends on."""
    order: int | None
    """Its degree in the members together, at most :data:`HIGHEST`; ``None``: no
    polynomial, or one of a higher degree."""

    @classmethod
    def of(cls, expression: Symbol, members: Mapping[str, Symbol]) -> Composition:
        """Read an expression; ``members`` are the symbols of states and controls."""
        names = depends_on(expression, members)
        vector = casadi.vertcat(*(members[name] for name in names))
        order: int | None = None
        derivative = casadi.SX(expression)
        for candidate in range(HIGHEST + 1):
            if not depends_on(derivative, {name: members[name] for name in names}):
                order = candidate
                break
            derivative = casadi.simplify(casadi.jacobian(derivative, vector))
        return cls(casadi.SX(expression), tuple(names), order)

    def degree(self, polynomials: Mapping[str, Coefficients]) -> int | None:
        """Degree in time of the expression, ``None`` when it is no polynomial."""
        if self.order is None:
            return None
        highest = max((len(polynomials[name]) - 1 for name in self.members), default=0)
        return self.order * highest

    def at(
        self,
        polynomials: Mapping[str, Coefficients],
        members: Mapping[str, Symbol],
        fractions: Sequence[float],
        lifting: Lifting | None = None,
    ) -> list[Symbol]:
        """Values of the expression at ``fractions`` of the interval.

        Those of its members get names of a ``lifting``, if there is one.
        """
        if not self.members:
            return [self.expression] * len(fractions)
        symbols = casadi.vertcat(*(members[name] for name in self.members))
        rows = []
        for name in self.members:
            values = [value_at(polynomials[name], s) for s in fractions]
            if lifting is not None:
                values = lifting.curve(name, values, fractions)
            rows.append(values)
        return [
            casadi.substitute(self.expression, symbols, casadi.vertcat(*point))
            for point in zip(*rows, strict=True)
        ]

    def coefficients(
        self, polynomials: Mapping[str, Coefficients], members: Mapping[str, Symbol]
    ) -> Coefficients:
        """Exact Bernstein coefficients of an expression that is a polynomial.

        Raises
        ------
        ValueError
            If it is none.
        """
        degree = self.degree(polynomials)
        if degree is None:
            raise ValueError(f"{self.expression} is no polynomial of low degree")
        if self.order == 1:
            return self._combine(polynomials, members, degree)
        nodes = fitting_points(degree)
        return fit(self.at(polynomials, members, nodes), nodes)

    def _combine(
        self,
        polynomials: Mapping[str, Coefficients],
        members: Mapping[str, Symbol],
        degree: int,
    ) -> Coefficients:
        vector = casadi.vertcat(*(members[name] for name in self.members))
        factors = casadi.jacobian(self.expression, vector)
        zero = casadi.SX.zeros(vector.numel())
        rest = casadi.substitute(self.expression, vector, zero)
        total = [rest] * (degree + 1)
        for index, name in enumerate(self.members):
            raised = elevate(polynomials[name], degree)
            total = [t + factors[index] * c for t, c in zip(total, raised, strict=True)]
        return total


def fit(values: list[Symbol], nodes: Sequence[float]) -> Coefficients:
    """Bernstein coefficients of the polynomial through ``values`` at ``nodes``."""
    matrix = bernstein_basis_inverse(len(nodes) - 1, tuple(nodes))
    column = casadi.mtimes(casadi.DM(np.asarray(matrix)), casadi.vertcat(*values))
    return [column[k] for k in range(len(nodes))]


@dataclass(frozen=True, slots=True)
class Cascade:
    """The states of a phase in the order in which they can be integrated."""

    phase: Phase
    order: tuple[str, ...]
    """States, those that others depend on first."""
    members: Mapping[str, Symbol]
    """Symbols of all states and controls."""
    derivatives: Mapping[str, Composition]

    @classmethod
    def of(cls, phase: Phase) -> Cascade:
        """Order the states of ``phase``.

        Raises
        ------
        ValueError
            If states depend on each other in a circle, or a derivative on the time.
        """
        members = {name: state.quantity.symbol for name, state in phase.states.items()}
        members |= {name: item.quantity.symbol for name, item in phase.controls.items()}
        derivatives = {
            name: Composition.of(expression, members)
            for name, expression in phase.derivatives.items()
        }
        for name, expression in phase.derivatives.items():
            if depends_on(expression, {"time": phase.time}):
                raise ValueError(
                    f"the derivative of {name!r} depends on the time; a cascade "
                    "needs dynamics that do not: pass what varies as a signal"
                )
        order: list[str] = []
        waiting = list(phase.states)
        while waiting:
            ready = [
                name
                for name in waiting
                if not set(derivatives[name].members) & set(waiting)
            ]
            if not ready:
                raise ValueError(
                    f"states {', '.join(waiting)} of phase {phase.name!r} depend on "
                    "each other in a circle and form no cascade"
                )
            order += ready
            waiting = [name for name in waiting if name not in ready]
        return cls(phase, tuple(order), members, derivatives)

    def polynomials(
        self,
        starts: Mapping[str, Symbol],
        controls: Mapping[str, Coefficients],
        width: Symbol,
        points: int,
        lifting: Lifting,
    ) -> dict[str, Coefficients]:
        """Bernstein coefficients of all states and controls on one interval.

        Parameters
        ----------
        starts
            Value of each state at the start of the interval.
        controls
            Coefficients of each control.
        width
            Duration of the interval.
        points
            Number N of Gauss points for derivatives that are no polynomials.
        lifting
            Gets what these derivatives are at the points, and what they depend on.
        """
        known: dict[str, Coefficients] = {n: list(c) for n, c in controls.items()}
        nodes = tuple(float(s) for s in collocation("gauss", points)[0])
        for name in self.order:
            derivative = self.derivatives[name]
            if derivative.order is not None and derivative.order <= 1:
                slope = derivative.coefficients(known, self.members)
            else:
                values = derivative.at(known, self.members, nodes, lifting)
                slope = fit(lifting.named(values), nodes)
            step = width / len(slope)
            running = [starts[name]]
            for coefficient in slope:
                running.append(running[-1] + step * coefficient)
            known[name] = running
        return known
