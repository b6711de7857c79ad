"""What a problem is stated in: named scalars with bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Expression = Any
"""A CasADi ``SX`` scalar or a number."""

Bound = Any
"""A number, or an expression in parameters; ``None`` means no bound."""

INFINITY = float("inf")


def interval(value: object) -> tuple[Bound, Bound]:
    """Read ``value`` as (lower, upper): a pair, one fixed value, or nothing."""
    if value is None:
        return -INFINITY, INFINITY
    if isinstance(value, tuple):
        lower, upper = value
        return (
            -INFINITY if lower is None else lower,
            INFINITY if upper is None else upper,
        )
    return value, value


@dataclass(frozen=True, slots=True)
class Quantity:
    """A named scalar with bounds: a state, a control, a static or a constraint."""

    name: str
    symbol: Expression
    lower: Bound
    upper: Bound
    scale: float | None = None
    """Typical magnitude; ``None``: taken from the bounds and the guess."""


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
