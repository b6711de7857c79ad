"""Conditions at the ends of a phase."""

from __future__ import annotations

from typing import Any

import casadi


def is_fixed(pair: tuple[Any, Any]) -> bool:
    """Tell whether lower and upper bound are one value."""
    return bool(casadi.is_equal(casadi.SX(pair[0]), casadi.SX(pair[1])))


def within(pair: tuple[Any, Any], quantity: Any) -> tuple[Any, Any]:  # noqa: ANN401
    """Narrow end conditions by the bounds that hold at every instant."""
    if is_fixed(pair):
        return pair
    return (
        casadi.fmax(casadi.SX(pair[0]), casadi.SX(quantity.lower)),
        casadi.fmin(casadi.SX(pair[1]), casadi.SX(quantity.upper)),
    )
