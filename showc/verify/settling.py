"""How vehicles come to rest when the law of their leg is over.

The loops are linear then but for two things: drag that grows with the speed, and lift
that leans. Both are products of small numbers, accelerations that push the vehicle
about as it settles. They are followed in strides: within a stride they are worked out
for a vehicle that they do not push, and again for one that these push. When all that
they can still do is below a tenth of a micrometre, the rest is told at once.

What they can do is bounded: places are off by no more than the sum of the
accelerations over all steps to come can push them, and that sum is bounded by sums of
squares (Cauchy, Schwarz), which are quadratic forms of the states.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import GRAVITY
from showc.verify.response import DRAG, DRAG_GROWS, KINDS, LEAN, PLACE, SPEED, asked

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.response import Axis

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

SLOW = 1e-3
"""How far all that is not linear may push a vehicle that is followed in strides [m];
strides tell that to about a two-hundredth."""

RESOLUTION = 1e-7
"""How far it may push who is not followed any more [m]."""

STRIDE = 16
"""Steps."""

_GENTLE = 2.5
"""Greatest acceleration on either level axis that is surely not limited [m/s²]."""


class _Stride:
    """Matrices of one axis for a stride of k steps, k accelerations in each."""

    def __init__(self, axis: Axis) -> None:
        powers, count = axis.powers, STRIDE
        # After i steps, what was pushed in step j has been left for i - 1 - j steps.
        self.forced = np.zeros((count + 1, KINDS, count))
        for step in range(1, count + 1):
            self.forced[step, :, :step] = (powers[:step] @ axis.pushed)[::-1].T
        states = np.concatenate([powers[: count + 1], self.forced], axis=2)
        middle = axis.half @ states[:count]
        each = np.arange(count)
        middle[each, :, KINDS + each] += axis.half_inputs[:, DRAG] / -DRAG_GROWS
        self.predicted = np.concatenate([middle[:, SPEED], middle[:, LEAN]])
        """Speeds and leans in the middles of the steps, from states and accelerations,
        shape (2 k, 7 + k)."""
        self.followed = np.concatenate([states[1:, PLACE], states[count]])
        """Places after each step, and states after the last, from states and
        accelerations, shape (k + 7, 7 + k)."""


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
        self._strides = [_Stride(axis) for axis in axes]
        self._places = [
            axes[number == 2].powers[1:, PLACE].astype(np.float32)
            for number in range(3)
        ]
        self.steps = len(axes[0].powers) - 1
        """Steps that are known."""
        part = axes[0].step / lag
        self._waits = 1.0 - part + 0.5 * part**2
        # Of speed and lean, or lift.
        self._level, self._upright = (
            np.vstack([axis.energy(SPEED), axis.energy(LEAN)]) for axis in axes
        )
        self._asked = np.abs(asked() @ axes[0].powers).max(axis=0)

    def slow(self, off: FloatArray) -> NDArray[np.bool_]:
        """Whether vehicles can be followed in strides, shape (m,).

        Parameters
        ----------
        off
            States (7, 3, m) seen from where the vehicles come to rest.
        """
        gentle = np.tensordot(self._asked, np.abs(off[:, :2]), axes=1) <= _GENTLE
        return (self.pushes(off) <= SLOW) & gentle.all(axis=0)

    def pushes(self, off: FloatArray) -> FloatArray:
        """How far all that is not linear can push, from states (7, 3, m), (m,) [m]."""
        level, upright = self._axes
        fast, leans = _squares(self._level, off[:, :2])
        climbs, lifts = _squares(self._upright, off[:, 2:])
        drag, tilt = DRAG_GROWS * fast, np.sqrt(leans * lifts) / GRAVITY
        return np.asarray(
            np.maximum(
                level.farthest * (drag + tilt), upright.farthest * DRAG_GROWS * climbs
            )
        )

    def follow(
        self,
        off: FloatArray,
        scale: FloatArray,
        wanted: IntArray,
        result: NDArray[np.float32],
    ) -> FloatArray:
        """Put places (k, 3, m) [m] after 1 to k steps from states in ``result``.

        Parameters
        ----------
        off
            States (7, 3, m), of slow vehicles.
        scale
            By which each axis is drawn out, shape (3, m).
        wanted
            After how many steps their states are wanted, shape (m,), 1 or more.
        result
            For no more steps than are known.

        Returns
        -------
        ndarray
            Those states, shape (7, 3, m); zero where more steps are wanted than are
            known.
        """
        states, step = np.zeros_like(off), 0
        while step < len(result) and not bool((self.pushes(off) <= RESOLUTION).all()):
            pushed = self._pushed(off)
            both = np.concatenate([off, pushed])
            both[KINDS:] = pushed = self._pushed(both)
            rows = np.flatnonzero((wanted > step) & (wanted <= step + STRIDE))
            if rows.size:
                states[..., rows] = self._within(
                    off[..., rows], pushed[..., rows], wanted[rows] - step
                )
            places, off = self._follow(both)
            part = result[step : step + STRIDE]
            np.multiply(places[: len(part)], scale, out=part, casting="same_kind")
            step += STRIDE
        rows = np.flatnonzero((wanted > step) & (wanted <= step + self.steps))
        level, upright = (axis.powers[wanted[rows] - step] for axis in self._axes)
        states[:, :2, rows] = np.einsum("mij,jam->iam", level, off[:, :2, rows])
        states[:, 2, rows] = np.einsum("mij,jm->im", upright, off[:, 2, rows])
        # Single precision will do for what is small.
        rest, drawn = result[step:], (off * scale).astype(np.float32)
        for axis, told in enumerate(self._places):
            np.matmul(told[: len(rest)], drawn[:, axis], out=rest[:, axis])
        return states

    def rates(self, rate: FloatArray, steps: IntArray) -> FloatArray:
        """Rates (m,) of the law's time after ``steps`` (m,) from ``rate`` (m,)."""
        return np.asarray(1.0 + (rate - 1.0) * self._waits**steps)

    def _pushed(self, rows: FloatArray) -> FloatArray:
        """Accelerations (k, 3, m) [m/s²] in the steps of a stride.

        By states (7, 3, m), or by states and accelerations (7 + k, 3, m).
        """
        level, upright = (
            np.tensordot(stride.predicted[:, : len(rows)], rows[:, part], axes=1)
            for stride, part in zip(self._strides, _PARTS, strict=True)
        )
        speed, climb, lift = level[:STRIDE], upright[:STRIDE], upright[STRIDE:]
        pushed = np.empty((STRIDE, 3, rows.shape[2]))
        flat = np.square(speed[:, 0])
        flat += np.square(speed[:, 1])
        np.sqrt(flat, out=flat)
        flat *= -DRAG_GROWS
        np.multiply(speed, flat[:, None], out=pushed[:, :2])
        np.multiply(np.abs(climb), climb, out=pushed[:, 2:])
        pushed[:, 2:] *= -DRAG_GROWS
        lift *= 1.0 / GRAVITY
        level[STRIDE:] *= lift
        pushed[:, :2] += level[STRIDE:]
        return pushed

    def _follow(self, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places (k, 3, m) and states (7, 3, m) by states and accelerations."""
        found = np.concatenate(
            [
                np.tensordot(stride.followed, rows[:, part], axes=1)
                for stride, part in zip(self._strides, _PARTS, strict=True)
            ],
            axis=1,
        )
        return found[:STRIDE], found[STRIDE:]

    def _within(
        self, off: FloatArray, pushed: FloatArray, steps: IntArray
    ) -> FloatArray:
        """States (7, 3, m) after ``steps`` (m,) of a stride."""
        found = np.empty_like(off)
        for axis, stride, part in zip(self._axes, self._strides, _PARTS, strict=True):
            found[:, part] = np.einsum(
                "mij,jam->iam", axis.powers[steps], off[:, part]
            ) + np.einsum("mij,jam->iam", stride.forced[steps], pushed[:, part])
        return found


_PARTS = slice(0, 2), slice(2, 3)
"""Level axes and the upright one."""


def _squares(roots: FloatArray, off: FloatArray) -> FloatArray:
    """Return sums (2, m) over time of squares, of all axes, by two roots (14, 7)."""
    found = np.tensordot(roots, off, axes=1)
    np.square(found, out=found)
    return np.asarray(found.reshape(2, KINDS, *off.shape[1:]).sum(axis=(1, 2)))
