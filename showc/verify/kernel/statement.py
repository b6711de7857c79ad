"""What a proof hands over: one statement about the flight, and whether it holds."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Statement:
    """A theorem about one show."""

    code: str
    """``VRF3`` and two digits; ``showc explain`` says what it means."""
    title: str
    """What is proved, in words."""
    holds: bool | None
    """Whether it is proved; None: there is nothing to prove, ``notes`` say why."""
    value: float | None = None
    """The worst that is possible, error bound included, in ``unit``."""
    limit: float | None = None
    """What was allowed, in ``unit``."""
    unit: str = ""
    drones: tuple[int, ...] = ()
    """Drone or pair of the value, counting from 0."""
    segment: str | None = None
    """Name of what is under way then."""
    time: float | None = None
    """Show time of the value [s]."""
    notes: tuple[str, ...] = ()
    """Tolerances, error bounds, further findings."""
