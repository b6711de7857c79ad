"""Short second derivatives of long compositions, by values that are given names.

A stage is a long composition of few steps: angles at the Gauss points are linear in the
unknowns, accelerations are functions of three angles and thrusts, all else is nearly
linear in these. Derived as one expression, each second derivative runs through all of
it. Here values on the way are symbols s_1, ..., s_L, each defined by those before it:

    f(z, s_1, ..., s_L),    s_l = e_l(z, s_1, ..., s_{l-1}).

Eliminated from the last to the first, with J = de_l/d(z, s_1, ..., s_{l-1}), g and H
the gradient and Hessian so far, their parts k (kept) and s (of s_l),

    g <- g_k + J' g_s,
    H <- H_kk + H_ks J + (H_ks J)' + J' H_ss J + sum_i (g_s)_i d²(e_l)_i,

the chain rule by blocks (Griewank and Walther 2008, chapter 10, has the general form).
The Hessian of a drone's stage takes 3,800 operations so, 9,000 as one expression.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi

if TYPE_CHECKING:
    from collections.abc import Sequence

Symbol = Any
"""A CasADi ``SX`` expression."""


class Lifting:
    """Names for values within expressions, in the order in which they are defined."""

    def __init__(self) -> None:
        self._levels: list[tuple[Symbol, Symbol]] = []
        self._curves: dict[tuple[str, tuple[float, ...]], list[Symbol]] = {}

    def named(self, values: Sequence[Symbol]) -> list[Symbol]:
        """Return a symbol for each of some values; they may hold earlier symbols."""
        symbols = casadi.SX.sym(f"s_{len(self._levels)}", len(values))
        self._levels.append((symbols, casadi.vertcat(*values)))
        return casadi.vertsplit(symbols)

    def curve(
        self, name: str, values: Sequence[Symbol], fractions: Sequence[float]
    ) -> list[Symbol]:
        """Return symbols for values of one curve, the same when asked again."""
        key = name, tuple(fractions)
        if key not in self._curves:
            self._curves[key] = self.named(values)
        return self._curves[key]

    def restored(self, *expressions: Symbol) -> list[Symbol]:
        """Return expressions with what their symbols stand for."""
        found = [casadi.SX(one) for one in expressions]
        for symbols, meaning in reversed(self._levels):
            found = casadi.substitute(found, [symbols], [meaning])
        return list(found)

    def curvature(self, value: Symbol, z: Symbol) -> tuple[Symbol, Symbol]:
        """Return Hessian (n, n) and gradient (n,) of a ``value`` in ``z`` (n,)."""
        kept = self._variables(z)
        bend: Symbol
        slope: Symbol
        bend, slope = casadi.hessian(value, kept)
        for symbols, meaning in reversed(self._levels):
            count = kept.numel() - symbols.numel()
            kept = kept[:count]
            weights = casadi.SX.sym("weights", symbols.numel())
            own, _ = casadi.hessian(casadi.dot(weights, meaning), kept)
            inner = casadi.jacobian(meaning, kept)
            crossed = casadi.mtimes(bend[:count, count:], inner)
            within = casadi.mtimes(bend[count:, count:], inner)
            own = casadi.substitute(own, weights, slope[count:])
            within = casadi.mtimes(inner.T, within)
            bend = bend[:count, :count] + crossed + crossed.T + within + own
            slope = slope[:count] + casadi.mtimes(inner.T, slope[count:])
        return bend, slope

    def _variables(self, z: Symbol) -> Symbol:
        """Return all that an expression may depend on, in one column."""
        return casadi.vertcat(z, *(symbols for symbols, _ in self._levels))
