"""Typical magnitudes, from bounds, end values and hints; never from derivatives.

Every unknown is divided by the scale of its quantity, every row by the scale of the
quantity it speaks of (Betts 2010, Practical methods, section 4.8). A scale taken
from the Jacobian at the guess is useless where the guess happens to be flat.
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray

GOLDEN = 0.5 * (5.0**0.5 - 1.0)
"""The golden ratio, whose multiples spread evenly: places to look at, in any number."""
_PLACES = 5
"""Places at which slopes are looked at for a scale: the middle one of five is not moved
by two that happen to be flat, or steep."""


def places(size: int) -> Iterator[FloatArray]:
    """Yield places to look at: each unknown aside by -0.5 to 0.5 of its scale."""
    pattern = np.arange(1, size + 1) * GOLDEN
    for number in range(_PLACES):
        yield np.asarray((pattern * (2 * number + 1)) % 1.0 - 0.5)


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
