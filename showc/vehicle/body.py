"""The aircraft as a thing that falls: its size and its drag without thrust."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Body:
    """What a fall depends on besides the mass."""

    size: float
    """Greatest size, from propeller tip to propeller tip [m]."""
    drag_area: tuple[float, float]
    """Least and greatest drag coefficient times area, however it tumbles [m²]."""
