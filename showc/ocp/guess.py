"""First guesses: from functions, from numbers, from an earlier solution."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from showc.ocp.solution import PhaseSolution

FloatArray = NDArray[np.float64]

Curve = float | FloatArray | Callable[[FloatArray], FloatArray]
"""A number, values at equal steps over the phase, or a function of the fraction of
the phase (an array in [0, 1])."""


@dataclass(frozen=True, slots=True)
class Guess:
    """Where the search starts; what is not given is filled in from the bounds.

    Names of states and controls are ``"x"``, or ``"phase.x"`` where several phases
    have an ``x``.
    """

    curves: Mapping[str, Curve] = field(default_factory=dict)
    durations: Mapping[str, float] = field(default_factory=dict)
    """Duration by phase name."""
    starts: Mapping[str, float] = field(default_factory=dict)
    """Start time by phase name."""
    statics: Mapping[str, float] = field(default_factory=dict)


def sample(curve: Curve, fraction: FloatArray) -> FloatArray:
    """Values of ``curve`` at ``fraction`` of the phase."""
    if callable(curve):
        return np.broadcast_to(np.asarray(curve(fraction), dtype=float), fraction.shape)
    values = np.atleast_1d(np.asarray(curve, dtype=np.float64))
    if values.size == 1:
        return np.full(fraction.shape, values[0])
    return np.asarray(np.interp(fraction, np.linspace(0.0, 1.0, values.size), values))


def curves_of(phase: PhaseSolution) -> dict[str, Curve]:
    """Curves of an earlier solution's phase, by the fraction of its duration."""

    def state(index: int) -> Curve:
        return lambda s: phase.states(phase.start + s * phase.duration)[..., index]

    def control(index: int) -> Curve:
        return lambda s: phase.controls(phase.start + s * phase.duration)[..., index]

    curves = {name: state(i) for i, name in enumerate(phase.state_names)}
    curves |= {name: control(i) for i, name in enumerate(phase.control_names)}
    return curves
