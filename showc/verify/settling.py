"""How vehicles come to rest when the law of their leg is over.

The loops are linear then but for two things: drag that grows with the speed, and lift
that leans. Both are products of small numbers; while they are left out, places are off
by no more than an acceleration as large can push them. The sum of the products over all
steps to come is bounded by sums of squares (Cauchy, Schwarz), which are quadratic forms
of the states.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import GRAVITY
from showc.verify.response import DRAG_GROWS, KINDS, LEAN, PLACE, SPEED

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.response import Axis

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

RESOLUTION = 1e-6
"""How far places may be off by what is not linear [m]."""


class Settling:
    """What is left of vehicles' states, step by step.

    Parameters
    ----------
    axes
        A level axis and the upright one.
    lag
        How late the law's time changes its rate [s].
    """

    def __init__(self, axes: tuple[Axis, Axis], lag: float) -> None:
        self._axes = axes
        self.steps = len(axes[0].powers) - 1
        """Steps that are known."""
        self._places = [axis.powers[1:, PLACE].astype(np.float32) for axis in axes]
        part = axes[0].step / lag
        self._waits = 1.0 - part + 0.5 * part**2
        level, upright = axes
        # Of speed and lean, or lift.
        self._level = np.vstack([level.energy(SPEED), level.energy(LEAN)])
        self._upright = np.vstack([upright.energy(SPEED), upright.energy(LEAN)])

    def linear(self, off: FloatArray) -> NDArray[np.bool_]:
        """Whether all else is within the resolution, shape (m,).

        Parameters
        ----------
        off
            States (7, 3, m) seen from where the vehicles come to rest.
        """
        level, upright = self._axes
        fast, leans = _squares(self._level, off[:, :2])
        climbs, lifts = _squares(self._upright, off[:, 2:])
        drag, tilt = DRAG_GROWS * fast, np.sqrt(leans * lifts) / GRAVITY
        error = np.maximum(
            level.farthest * (drag + tilt), upright.farthest * DRAG_GROWS * climbs
        )
        return np.asarray(error <= RESOLUTION)

    def places(
        self, off: FloatArray, scale: FloatArray, result: NDArray[np.float32]
    ) -> None:
        """Put places (k, 3, m) [m] after 1 to k steps from states in ``result``.

        They are those of states ``off`` (7, 3, m), each axis drawn out by ``scale``
        (3, m); single precision will do for what is small.
        """
        drawn = (off * scale).astype(np.float32)
        level, upright = self._places
        for axis, powers in enumerate((level, level, upright)):
            np.matmul(powers[: len(result)], drawn[:, axis], out=result[:, axis])

    def states(self, off: FloatArray, steps: IntArray) -> FloatArray:
        """States (7, 3, m) after ``steps`` (m,) from ``off`` (7, 3, m)."""
        level, upright = (axis.powers[steps] for axis in self._axes)
        found = np.empty_like(off)
        found[:, :2] = np.einsum("mij,jam->iam", level, off[:, :2])
        found[:, 2] = np.einsum("mij,jm->im", upright, off[:, 2])
        return found

    def rates(self, rate: FloatArray, steps: IntArray) -> FloatArray:
        """Rates (m,) of the law's time after ``steps`` (m,) from ``rate`` (m,)."""
        return np.asarray(1.0 + (rate - 1.0) * self._waits**steps)


def _squares(roots: FloatArray, off: FloatArray) -> FloatArray:
    """Return sums (2, m) over time of squares, of all axes, by two roots (14, 7)."""
    found = np.tensordot(roots, off, axes=1)
    np.square(found, out=found)
    return np.asarray(found.reshape(2, KINDS, *off.shape[1:]).sum(axis=(1, 2)))
