"""Where the mesh intervals of a leg lie: denser at the ends, where attitude moves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray


END_TIME = 1.6
"""Length of the stretch at either end that gets most intervals [s]: about the time of
speeding up."""
END_GRADING = 0.85
"""Share of the mesh's density at the ends where time is least or nearly so."""
LONGEST = 1.5
"""Interval beyond which more are taken, for accuracy [s]."""
COUNTS = (12, 16, 24, 32, 40, 56, 80, 120, 160, 240)
"""Numbers of intervals used: few, as each is a program to build."""


def graded_widths(duration: float, count: int, grading: float = 0.7) -> FloatArray:
    """Widths of ``count`` intervals over ``duration`` [s], shape (count,).

    Chebyshev-like towards both ends; on long legs the dense stretches keep their
    length. ``grading`` is the share of the density that goes to the ends.
    """
    fraction = np.linspace(0.0, 1.0, count + 1)
    cosine = 0.5 * (1.0 - np.cos(np.pi * fraction))
    warped = (1.0 - grading) * fraction + grading * cosine
    widths = np.diff(warped) * duration
    if duration <= 5.0 * END_TIME:
        return np.asarray(widths)
    # A density of intervals: even, plus two decaying from the ends.
    grid = np.linspace(0.0, duration, 40 * count + 1)
    near = np.minimum(grid, duration - grid)
    density = (1.0 - grading) / duration + grading * np.exp(-near / END_TIME) / (
        2.0 * END_TIME
    )
    density = np.maximum(density, 1.1 / (count * LONGEST))
    area = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    breaks = np.interp(fraction * area[-1], area, grid)
    return np.asarray(np.diff(breaks))


def interval_count(duration: float, least: int) -> int:
    """Return the number of intervals for a leg: ``least``, or more if it is long."""
    wanted = least + int(np.ceil(max(0.0, duration - 5.0 * END_TIME) / LONGEST))
    return next((count for count in COUNTS if count >= wanted), COUNTS[-1])


def finer(count: int) -> int | None:
    """Return the next greater number of intervals, ``None`` after the last."""
    return next((c for c in COUNTS if c > count), None)
