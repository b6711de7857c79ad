"""Dryden gusts below 1000 ft, as time series with seeds.

MIL-F-8785C, 3.7.2 and 3.7.3.1, with lengths in feet as printed: longitudinal gusts have
a spectrum of first order, lateral and vertical ones of second. The air passes by with
the mean wind; every drone has gusts of its own, which is hard on distances: gusts are
longer than a show is wide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray

FOOT = 0.3048
"""[m]: the standard's formulas are in feet."""
SEVERITY = {"none": 0.0, "light": 0.5, "moderate": 1.0, "severe": 1.5}
"""Turbulence over that which the standard has at the wind: as its light, moderate and
severe ones (15, 30 and 45 knots at 20 ft) are to each other."""
SLOWEST = 1.0
"""Least speed at which air passes by [m/s]."""
LOWEST = 3.0
"""Least height at which the model holds, 10 ft [m]."""
AHEAD = 32
"""Steps for which numbers are drawn together."""


@dataclass(frozen=True, slots=True, eq=False)
class Scales:
    """Scales of gusts at heights; every array of shape (n,)."""

    length: FloatArray
    """Of level gusts [m]."""
    length_up: FloatArray
    """Of vertical gusts [m]."""
    sigma: FloatArray
    """Standard deviation of level gusts [m/s]."""
    sigma_up: FloatArray
    """Standard deviation of vertical gusts [m/s]."""

    @classmethod
    def at(cls, height: FloatArray, wind: float) -> Scales:
        """Return the scales at heights over the ground, (n,) [m].

        ``wind`` at 20 ft stands for the turbulence [m/s].
        """
        feet = np.maximum(height, LOWEST) / FOOT
        shape = 0.177 + 0.000823 * feet
        up = np.full(feet.shape, 0.1 * wind)
        return cls(
            np.asarray(feet / shape**1.2 * FOOT),
            np.asarray(feet * FOOT),
            np.asarray(up / shape**0.4),
            up,
        )


class Normals:
    """Standard normal numbers of several generators, step by step.

    Each generator gives the numbers that it would give alone, whatever is beside it.

    Parameters
    ----------
    generators
        One of each flight.
    shape
        Of the numbers of one step.
    """

    def __init__(
        self, generators: Sequence[np.random.Generator], shape: tuple[int, ...]
    ) -> None:
        self._generators, self._shape = generators, (AHEAD, *shape)
        self._drawn, self._next = np.empty(0), AHEAD

    def __call__(self) -> FloatArray:
        """Return the next ones, shape (generators, *shape)."""
        if self._next == AHEAD:
            drawn = [one.standard_normal(self._shape) for one in self._generators]
            self._drawn, self._next = np.stack(drawn), 0
        self._next += 1
        return np.asarray(self._drawn[:, self._next - 1])


class Gusts:
    """Gusts along the mean wind, across it and upwards, step by step.

    Parameters
    ----------
    scales
        Of n places.
    wind
        Speed at which air passes by [m/s].
    step
        Time between two values [s].
    seeds
        Of the random numbers of each flight.
    """

    def __init__(
        self, scales: Scales, wind: float, step: float, seeds: Sequence[int]
    ) -> None:
        generators = [np.random.default_rng(seed) for seed in seeds]
        speed = max(wind, SLOWEST)
        self._times = np.stack([scales.length, scales.length, scales.length_up]) / speed
        self._sigma = np.stack([scales.sigma, scales.sigma, scales.sigma_up])
        share = step / self._times
        self._fade = np.exp(-share)
        self._feed = share * self._fade
        # Stationary covariance of both states of a second-order filter whose output
        # sqrt(3) x1 + (1 - sqrt(3)) x2 has twice the variance of x1; noise keeps it.
        own = 0.5 * self._sigma**2
        fade, feed = self._fade, self._feed
        first = own * (1.0 - fade**2)
        cross = 0.5 * own - fade * (feed * own + 0.5 * fade * own)
        second = 0.5 * own - feed**2 * own - feed * fade * own - 0.5 * fade**2 * own
        self._first = np.sqrt(first)
        with np.errstate(invalid="ignore", divide="ignore"):
            self._cross = np.where(first > 0.0, cross / self._first, 0.0)
        self._second = np.sqrt(np.maximum(second - self._cross**2, 0.0))
        self._normals = Normals(generators, (2, *self._times.shape))
        one, other = np.moveaxis(self._normals(), 1, 0)
        root = np.sqrt(own)
        self._states = np.stack([root * one, root * (0.5 * one + 0.5 * other)])

    def __call__(self) -> FloatArray:
        """Return the gusts of the next step: along, across and up.

        Shape (seeds, n, 3) [m/s].
        """
        one, other = np.moveaxis(self._normals(), 1, 0)
        x1, x2 = self._states
        self._states = np.stack(
            [
                self._fade * x1 + self._first * one,
                self._fade * x2
                + self._feed * x1
                + self._cross * one
                + self._second * other,
            ]
        )
        x1, x2 = self._states
        root = np.sqrt(3.0)
        shaped = root * x1 + (1.0 - root) * x2
        # Along the wind the spectrum is of first order: x1, with its full variance.
        along = np.sqrt(2.0) * x1[:, 0]
        return np.stack([along, shaped[:, 1], shaped[:, 2]], axis=-1)
