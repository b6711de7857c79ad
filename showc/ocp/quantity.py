"""What a problem is stated in: named scalars with bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi

from showc.ocp.fault import StatementError, scalar

if TYPE_CHECKING:
    from collections.abc import Iterable

Expression = Any
"""A CasADi ``SX`` scalar or a number."""

Bound = Any
"""A number, or an expression in parameters; ``None`` means no bound."""

INFINITY = float("inf")
"""What stands for no bound."""


def column(expressions: Iterable[Expression]) -> Expression:
    """Put expressions below each other, none of them included."""
    return casadi.vertcat(casadi.SX(0, 1), *expressions)


def interval(value: object, what: str) -> tuple[Bound, Bound]:
    """Read ``value`` as (lower, upper): a pair, one fixed value, or nothing.

    ``what`` is bounded, for messages.

    Raises
    ------
    StatementError
        If it is none of these, or its lower bound lies above its upper one.
    """
    if value is None:
        return -INFINITY, INFINITY
    pair = value if isinstance(value, (tuple, list)) else (value, value)
    if len(pair) != 2:
        raise StatementError(f"{what} has {len(pair)} bounds; wanted lower and upper")
    low = _bound(pair[0], -INFINITY, what)
    high = _bound(pair[1], INFINITY, what)
    if isinstance(low, float) and isinstance(high, float) and low > high:
        raise StatementError(f"{what} is to be at least {low:g} and at most {high:g}")
    numbers = [bound for bound in (low, high) if isinstance(bound, float)]
    if numbers in ([INFINITY, INFINITY], [-INFINITY, -INFINITY]):
        raise StatementError(f"{what} is to be {low:g}; wanted a finite number")
    return low, high


def limits(lower: object, upper: object, what: str) -> tuple[Bound, Bound]:
    """Read the bounds of a constraint, of which there must be one.

    Raises
    ------
    StatementError
        If both are ``None``, or :func:`interval` finds a fault.
    """
    if lower is None and upper is None:
        raise StatementError(
            f"{what} has no bounds; give lower, upper, or both (a comparison such as "
            "x <= 1 is no constraint)"
        )
    return interval((lower, upper), what)


def _bound(value: object, nothing: float, what: str) -> Bound:
    if value is None:
        return nothing
    expression = scalar(value, f"a bound of {what}")
    return float(expression) if expression.is_constant() else expression


@dataclass(frozen=True, slots=True)
class Quantity:
    """A named scalar with bounds: a state, a control, a static or a constraint."""

    name: str
    symbol: Expression
    lower: Bound
    upper: Bound
    scale: float | None = None
    """Typical magnitude; ``None``: taken from the bounds and the guess."""
    line: str = ""
    """File and line where it is stated."""


@dataclass(frozen=True, slots=True)
class State:
    """A state: a quantity with values at the ends of its phase."""

    quantity: Quantity
    start: tuple[Bound, Bound]
    end: tuple[Bound, Bound]
    initial: Expression
    """Symbol of the value at the start of the phase."""
    final: Expression
    """Symbol of the value at the end of the phase."""


@dataclass(frozen=True, slots=True)
class Control:
    """A control: a quantity with a degree on each mesh interval."""

    quantity: Quantity
    degree: int | None
    """Degree of the polynomial on each interval; ``None``: chosen by the solver."""
    continuous: bool
    """Whether neighbouring intervals share the value at their border."""
    initial: Expression
    final: Expression


@dataclass(frozen=True, slots=True)
class HalfSpaces:
    """Linear constraints on the Bernstein coefficients of named states.

    On each mesh interval, for each of ``rows`` rows and every Bernstein coefficient
    c_j of the vector of ``states``: lower <= normal . c_j <= upper. By the hull
    property the polynomial itself then keeps the constraint at every instant of
    the interval. Normals and bounds are given per solve.
    """

    name: str
    states: tuple[str, ...]
    rows: int
