"""Typical magnitudes, from bounds, end values and hints; never from derivatives.

Every unknown is divided by the scale of its quantity, every row by the scale of the
quantity it speaks of (Betts 2010, Practical methods, section 4.8). A scale taken
from the Jacobian at the guess is useless where the guess happens to be flat.
"""

from __future__ import annotations

from math import isfinite

GOLDEN = 0.5 * (5.0**0.5 - 1.0)
"""The golden ratio, whose multiples spread evenly: places to look at, in any number."""


def from_bounds(lower: float, upper: float, *ends: float) -> float:
    """Return the scale of a quantity with these bounds and end values."""
    if isfinite(lower) and isfinite(upper) and upper > lower:
        return float(0.5 * (upper - lower))
    known = [abs(value) for value in (lower, upper, *ends) if isfinite(value)]
    largest = max(known, default=0.0)
    return largest if largest > 0.0 else 1.0


def middle(lower: float, upper: float) -> float:
    """Middle of an interval; the point nearest to zero where it is unbounded."""
    if isfinite(lower) and isfinite(upper):
        return 0.5 * (lower + upper)
    return min(max(0.0, lower), upper)


def of_duration(lower: float, upper: float) -> float:
    """Return the scale of a duration between these bounds."""
    if isfinite(upper) and lower > 0.0:
        return float((lower * upper) ** 0.5)
    if isfinite(upper):
        return upper
    return lower if lower > 0.0 else 1.0


def of_path(lower: float, upper: float, otherwise: float = 1.0) -> float:
    """Return the scale in which a violation of a path constraint is measured.

    ``otherwise`` is that of a constraint whose bounds do not tell it.
    """
    finite = [abs(b) for b in (lower, upper) if isfinite(b) and b != 0.0]
    if isfinite(lower) and isfinite(upper) and upper > lower:
        return upper - lower
    return max(finite, default=otherwise)
