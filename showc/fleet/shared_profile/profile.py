"""The shared profile: one fraction of the way s(t) that a whole fleet follows.

The profile has four equal ramps of its second derivative: up and down again while
speeding up, down and up again while slowing down, plateaus between, a coast in the
middle. Each ramp starts and ends with a parabolic blend, so that s'' is once
continuously differentiable: s'' is then a piecewise polynomial of degree 2 and s one
of degree 4, and torques stay bounded (a straight flight needs s up to s'''').
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from showc.arrays import FloatArray


BLEND = 0.15
"""Share of a ramp that each of its two parabolic blends takes."""


@dataclass(frozen=True, slots=True)
class Profile:
    """A rest-to-rest profile s(t) from 0 to 1 over ``duration``.

    With L the ``phase`` and r the ``ramp``: the coasting speed is 1 / (T - L) and the
    greatest acceleration 1 / ((T - L) (L - r)), both per length of the way.
    """

    duration: float
    """T [s]."""
    phase: float
    """Time L of speeding up, and of slowing down, at most T / 2 [s]."""
    ramp: float
    """Time r of one ramp of the acceleration, at most L / 2 [s]."""

    @property
    def speed(self) -> float:
        """Greatest s' [1/s]."""
        return 1.0 / (self.duration - self.phase)

    @property
    def acceleration(self) -> float:
        """Greatest s'' [1/s²]."""
        return self.speed / (self.phase - self.ramp)

    @property
    def jerk(self) -> float:
        """Greatest s''' [1/s³]."""
        return self.acceleration / (self.ramp * (1.0 - BLEND))

    @property
    def snap(self) -> float:
        """Greatest s'''' [1/s⁴]."""
        return self.jerk / (BLEND * self.ramp)

    def stretched(self, duration: float) -> Profile:
        """Return the same shape over another ``duration`` [s]."""
        scale = duration / self.duration
        return Profile(duration, self.phase * scale, self.ramp * scale)

    def derivatives(self) -> tuple[PiecewisePolynomial, ...]:
        """Return s (degree 4), s' (3), s'' (2) as piecewise polynomials, same breaks.

        The middle of each ramp is halved, which keeps the attitude of a straight
        flight, no polynomial, close to one of moderate degree on each interval.
        """
        widths, second = self._acceleration_pieces()
        breaks = np.concatenate([[0.0], np.cumsum(widths)])
        breaks[-1] = self.duration
        first = integral(second, widths)
        zeroth = integral(first, widths)
        # Rounding leaves s(T) within a few ulp of 1 and s'(T) of 0; close both exactly,
        # so that flights end where they should.
        first[-1, -1] = 0.0
        zeroth[-1, -2:] = 1.0
        return tuple(
            PiecewisePolynomial(breaks, part[:, :, None])
            for part in (zeroth, first, second)
        )

    def _acceleration_pieces(self) -> tuple[FloatArray, FloatArray]:
        """Widths (K,) [s] and Bernstein coefficients (K, 3) of s''."""
        blend, line = BLEND * self.ramp, (1.0 - 2.0 * BLEND) * self.ramp / 2.0
        # Height that a blend gains, as a share of the ramp's.
        gain = BLEND / (2.0 * (1.0 - BLEND))
        rising = [
            (blend, (0.0, 0.0, gain)),
            (line, (gain, (gain + 0.5) / 2.0, 0.5)),
            (line, (0.5, (1.5 - gain) / 2.0, 1.0 - gain)),
            (blend, (1.0 - gain, 1.0, 1.0)),
        ]
        falling = [(width, values[::-1]) for width, values in reversed(rising)]
        plateau = [(self.phase - 2.0 * self.ramp, (1.0, 1.0, 1.0))]
        coast = [(self.duration - 2.0 * self.phase, (0.0, 0.0, 0.0))]
        push = rising + plateau + falling
        brake = [(width, tuple(-v for v in values)) for width, values in push]
        pieces = [
            (width, values)
            for width, values in push + coast + brake
            if width > 1e-9 * self.duration
        ]
        widths = np.array([width for width, _ in pieces])
        widths *= self.duration / widths.sum()
        return widths, self.acceleration * np.array([values for _, values in pieces])


def integral(coefficients: FloatArray, widths: FloatArray) -> FloatArray:
    """Bernstein coefficients (K, n + 2) of the integral from 0 of (K, n + 1)."""
    steps = coefficients * widths[:, None] / coefficients.shape[1]
    inner = np.concatenate(
        [np.zeros((steps.shape[0], 1)), np.cumsum(steps, axis=1)], axis=1
    )
    start = np.concatenate([[0.0], np.cumsum(inner[:-1, -1])])
    return np.asarray(inner + start[:, None])
