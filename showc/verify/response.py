"""What is linear in an autopilot's loops, as matrices, and how it comes to rest.

Each axis of a vehicle has seven states and four inputs; those of both level axes obey
the same matrices, those upright others. A step of the midpoint rule is linear in them
as well, so what follows it, and what is left many steps later, are products of
matrices. Nothing here is taken from the code that drew the flights.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import GRAVITY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

PLACE, SPEED, MISSED, SUM, CHANGE, LEAN, HALF_LEAN = range(7)
"""States of a level axis: place, speed, speed missed, the sum of it and its change,
acceleration by the lean, and half way to it."""

RISE, LIFT = SUM, LEAN
"""States upright in their stead: part of the lift that is summed up, and the lift; the
change and what is half way are none."""

KINDS = 7
"""States of an axis."""

DRAG, TILT, POINT, PUSH = range(4)
"""Inputs: speed times its size, lean times lift, place and speed of the law, and its
acceleration."""

_FILTER = 10.0 * np.pi
"""Of the speed missed, and of its change [1/s]."""

_HOVER = 0.39
"""Thrust in hover, as a fraction of the greatest."""

_SUMMED, _AT_ONCE = 0.1 * GRAVITY / _HOVER, 0.05 * GRAVITY / _HOVER
"""Lift for the acceleration that is short, per second and at once."""

_DRAG, DRAG_GROWS = 0.25, 0.027
"""Drag over speed, at rest [1/s] and how it grows with the speed [1/m]."""


def _common() -> tuple[FloatArray, FloatArray]:
    """Return changes of place, speed, speed missed, as the others below do."""
    states, inputs = np.zeros((KINDS, KINDS)), np.zeros((KINDS, 4))
    states[PLACE, SPEED] = 1.0
    states[SPEED, [SPEED, LEAN]] = -_DRAG, 1.0
    inputs[SPEED, DRAG] = -DRAG_GROWS
    states[MISSED, [PLACE, SPEED, MISSED]] = -_FILTER
    inputs[MISSED, POINT] = _FILTER
    return states, inputs


def level_axis() -> tuple[FloatArray, FloatArray]:
    """Return changes of a level axis by its states (7, 7) and inputs (7, 4) [1/s].

    2/s of the speed missed, 1/s² of its sum and half its change are asked for, and the
    acceleration of the law; the lean follows by way of what is half way.
    """
    states, inputs = _common()
    inputs[SPEED, TILT] = 1.0 / GRAVITY
    states[SUM, MISSED] = 1.0
    states[CHANGE], inputs[CHANGE] = _FILTER * states[MISSED], _FILTER * inputs[MISSED]
    states[CHANGE, CHANGE] -= _FILTER
    states[LEAN, [LEAN, HALF_LEAN]] = -1.0 / 0.03, 1.0 / 0.03
    states[HALF_LEAN] = 8.0 * asked()
    states[HALF_LEAN, HALF_LEAN] = -8.0
    inputs[HALF_LEAN, PUSH] = 8.0
    return states, inputs


def upright_axis() -> tuple[FloatArray, FloatArray]:
    """Return changes of the upright axis by its states (7, 7) and inputs (7, 4) [1/s].

    5/s of the speed missed and the law's acceleration are asked for; what is short of
    them is made up by a lift that comes late.
    """
    states, inputs = _common()
    short, pushed = -states[SPEED], -inputs[SPEED]
    short[MISSED], pushed[PUSH] = 5.0, 1.0
    states[RISE], inputs[RISE] = _SUMMED * short, _SUMMED * pushed
    states[LIFT], inputs[LIFT] = _AT_ONCE * short, _AT_ONCE * pushed
    states[LIFT, [RISE, LIFT]] += 1.0, -1.0
    states[LIFT] /= 0.075
    inputs[LIFT] /= 0.075
    return states, inputs


def asked() -> FloatArray:
    """How much level acceleration each state asks for, shape (7,)."""
    row = np.zeros(KINDS)
    row[[MISSED, SUM, CHANGE]] = 2.0, 1.0, 0.5
    return row


class Axis:
    """One axis in steps of the midpoint rule.

    Parameters
    ----------
    states, inputs
        Changes by the states (7, 7) and inputs (7, 4) [1/s].
    step
        Length of a step [s].
    last
        Steps for which :attr:`powers` and all that is made of them are worked out.
    """

    def __init__(
        self, states: FloatArray, inputs: FloatArray, step: float, last: int
    ) -> None:
        unit = np.eye(KINDS)
        self.step, self._last = step, last
        self.states = states
        self.half = unit + 0.5 * step * states
        """Half a step, by the states (7, 7)."""
        self.half_inputs = 0.5 * step * inputs
        """Half a step, by the inputs at its begin (7, 4)."""
        self.whole = unit + step * states @ self.half
        """A step, by the states (7, 7)."""
        self.begun = step * states @ self.half_inputs
        """A step, by the inputs at its begin (7, 4)."""
        self.middle = step * inputs
        """A step, by the inputs in its middle (7, 4)."""

    @cached_property
    def powers(self) -> FloatArray:
        """What is left after 0 to ``last`` steps without inputs, (last + 1, 7, 7)."""
        found = np.empty((self._last + 1, KINDS, KINDS))
        found[0] = np.eye(KINDS)
        for step in range(self._last):
            np.matmul(self.whole, found[step], out=found[step + 1])
        return found

    @cached_property
    def pushed(self) -> FloatArray:
        """States (7,) after a step at 1 m/s², from rest."""
        return (self.begun[:, DRAG] + self.middle[:, DRAG]) / -DRAG_GROWS

    @cached_property
    def farthest(self) -> float:
        """How far 1 m/s² for 1 s, one step or spread, can ever push the place [m]."""
        return float(np.abs(self.powers[:, PLACE] @ self.pushed).max()) / self.step

    def energy(self, kind: int) -> FloatArray:
        """Root (7, 7) of the sum of one state's squares while all come to rest.

        The squared norm of its product with states (7,) is that sum over all steps,
        times the length of a step [s].
        """
        rows = np.sqrt(self.step) * self.powers[:, kind]
        return np.asarray(np.linalg.qr(rows, mode="r"))
