"""The distances that a separation is measured in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Measure:
    """How a difference of positions becomes a distance."""

    axes: tuple[int, ...]
    """Axes that count."""
    scale: tuple[float, ...]
    """Factor on each of them."""
    largest: bool
    """Whether the distance is the largest component (else the Euclidean length)."""

    def __call__(self, difference: FloatArray) -> FloatArray:
        """Distances (n,) of differences (n, axes), scaled already."""
        if self.largest:
            return np.asarray(np.abs(difference).max(axis=-1))
        return np.asarray(np.sqrt(np.einsum("...k,...k", difference, difference)))

    def lengths(self, difference: FloatArray) -> FloatArray:
        """Distances (..., n) of differences (..., axes, n), scaled already."""
        if self.largest:
            return np.asarray(np.abs(difference).max(axis=-2))
        return np.asarray(
            np.sqrt(np.einsum("...kn,...kn->...n", difference, difference))
        )

    def of_chords(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Lower bounds (n,) of the distances on the way from ``begin`` to ``end``.

        Both have the shape (n, axes). Of the Euclidean length it is the least itself.
        """
        if self.largest:
            # The greatest of the components' least values.
            least = np.minimum(np.abs(begin), np.abs(end))
            return np.asarray(np.where(begin * end < 0.0, 0.0, least).max(axis=-1))
        way = end - begin
        square = np.einsum("nk,nk->n", way, way)
        along = -np.einsum("nk,nk->n", begin, way)
        share = np.clip(along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        return self(begin + share[:, None] * way)

    @property
    def order(self) -> float:
        """Order of the norm."""
        return np.inf if self.largest else 2.0


def measures(separation: pb.Separation) -> tuple[Measure, ...]:
    """Return the distances of which each must be at least the separation's.

    ``all-axes`` asks for three of them, the other forms for one.
    """
    shape = separation.shape
    if shape == pb.Separation.ALL_AXES:
        return tuple(Measure((axis,), (1.0,), largest=True) for axis in range(3))
    if shape == pb.Separation.ANY_AXIS:
        return (Measure((0, 1, 2), (1.0, 1.0, 1.0), largest=True),)
    stretch = separation.vertical_stretch if shape == pb.Separation.ELLIPSOID else 1.0
    return (Measure((0, 1, 2), (1.0, 1.0, 1.0 / stretch), largest=False),)
