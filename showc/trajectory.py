"""Piecewise polynomials in the Bernstein basis: the one shape every flight has.

The Bernstein coefficients of a polynomial enclose its values (Farouki 2012, The
Bernstein polynomial basis: a centennial retrospective, section 4): a limit that
the coefficients keep is kept at every instant of the interval.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import comb, prod
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from showc.arrays import FloatArray


@lru_cache(maxsize=64)
def elevation_matrix(degree: int, target: int) -> FloatArray:
    """Matrix from Bernstein coefficients of ``degree`` to those of ``target``."""
    raised = target - degree
    matrix = np.zeros((target + 1, degree + 1))
    for row in range(target + 1):
        for column in range(max(0, row - raised), min(degree, row) + 1):
            matrix[row, column] = (
                comb(degree, column) * comb(raised, row - column) / comb(target, row)
            )
    matrix.setflags(write=False)
    return matrix


@lru_cache(maxsize=64)
def bernstein_basis_inverse(degree: int, nodes: tuple[float, ...]) -> FloatArray:
    """Matrix from values at ``nodes`` in [0, 1] to Bernstein coefficients.

    Parameters
    ----------
    degree
        Degree of the polynomial; ``len(nodes) == degree + 1``.
    nodes
        Distinct abscissae in [0, 1].

    Returns
    -------
    ndarray, shape (degree + 1, degree + 1)
        Read-only.
    """
    basis = bernstein_basis(degree, np.asarray(nodes))
    inverse = np.asarray(np.linalg.inv(basis), dtype=np.float64)
    inverse.setflags(write=False)
    return inverse


def bernstein_basis(degree: int, fraction: ArrayLike) -> FloatArray:
    """Bernstein polynomials B_k(s) = C(n, k) s^k (1 - s)^(n - k), shape (..., n + 1).

    ``fraction`` is the position inside the interval, from 0 to 1.
    """
    s = np.asarray(fraction, dtype=np.float64)[..., None]
    k = np.arange(degree + 1)
    binomial = np.array([comb(degree, int(i)) for i in k], dtype=np.float64)
    return np.asarray(binomial * s**k * (1.0 - s) ** (degree - k))


def piece_values(coefficients: FloatArray, fractions: FloatArray) -> FloatArray:
    """Values (K, m, components) of coefficients (K, n + 1, components) at m places."""
    return combined(bernstein_basis(coefficients.shape[1] - 1, fractions), coefficients)


def combined(matrix: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Combine the coefficients of each interval in the same ways.

    Parameters
    ----------
    matrix
        A row for each combination, shape (m, degree + 1).
    coefficients
        Shape (..., degree + 1, components).

    Returns
    -------
    ndarray, shape (..., m, components)
    """
    *many, size, components = coefficients.shape
    # There may be no components: a problem without controls has none.
    each = coefficients.reshape(prod(many), size, components)
    # Intervals last: they are many, and lie next to each other then.
    columns = each.transpose(1, 2, 0).reshape(size, components * len(each))
    found = np.einsum("rk,kx->rx", matrix, columns)
    parted = found.reshape(len(matrix), components, len(each)).transpose(2, 0, 1)
    return np.asarray(parted.copy().reshape(*many, len(matrix), components))


@dataclass(frozen=True, slots=True, eq=False)
class PiecewisePolynomial:
    """A vector-valued polynomial on each of K intervals.

    Attributes
    ----------
    breaks
        Interval borders, strictly increasing, shape (K + 1,) [s].
    coefficients
        Bernstein coefficients, shape (K, degree + 1, components), in the units of
        the components.
    """

    breaks: FloatArray
    coefficients: FloatArray

    def __post_init__(self) -> None:
        breaks = np.array(self.breaks, dtype=np.float64)
        coefficients = np.array(self.coefficients, dtype=np.float64)
        if coefficients.ndim != 3 or breaks.shape != (coefficients.shape[0] + 1,):
            msg = (
                f"breaks {breaks.shape} do not fit coefficients {coefficients.shape}; "
                "wanted (K + 1,) and (K, degree + 1, components)"
            )
            raise ValueError(msg)
        if not np.all(np.diff(breaks) > 0.0):
            raise ValueError("breaks must increase strictly")
        breaks.setflags(write=False)
        coefficients.setflags(write=False)
        object.__setattr__(self, "breaks", breaks)
        object.__setattr__(self, "coefficients", coefficients)

    @property
    def intervals(self) -> int:
        """Number of intervals K."""
        return int(self.coefficients.shape[0])

    @property
    def degree(self) -> int:
        """Degree of the polynomial on every interval."""
        return int(self.coefficients.shape[1]) - 1

    @property
    def components(self) -> int:
        """Number of components of the vector."""
        return int(self.coefficients.shape[2])

    @property
    def start(self) -> float:
        """First instant [s]."""
        return float(self.breaks[0])

    @property
    def end(self) -> float:
        """Last instant [s]."""
        return float(self.breaks[-1])

    @classmethod
    def constant(
        cls, value: ArrayLike, start: float, end: float
    ) -> PiecewisePolynomial:
        """Hold ``value`` (components,) from ``start`` to ``end`` [s]."""
        vector = np.asarray(value, dtype=np.float64)
        return cls(np.array([start, end]), vector[None, None, :])

    def __call__(self, time: ArrayLike) -> FloatArray:
        """Evaluate at ``time`` [s], clamped to the ends; shape (..., components).

        At an inner break the later interval counts.
        """
        t = np.clip(np.asarray(time, dtype=np.float64), self.start, self.end)
        index = np.clip(
            np.searchsorted(self.breaks, t, side="right") - 1, 0, self.intervals - 1
        )
        width = self.breaks[index + 1] - self.breaks[index]
        basis = bernstein_basis(self.degree, (t - self.breaks[index]) / width)
        return np.asarray(
            np.einsum("...k,...kc->...c", basis, self.coefficients[index])
        )

    def derivative(self) -> PiecewisePolynomial:
        """Return the derivative with respect to time, one degree lower."""
        if self.degree == 0:
            return PiecewisePolynomial(self.breaks, np.zeros_like(self.coefficients))
        width = np.diff(self.breaks)[:, None, None]
        return PiecewisePolynomial(
            self.breaks, self.degree * np.diff(self.coefficients, axis=1) / width
        )

    def elevated(self, degree: int) -> PiecewisePolynomial:
        """Return the same polynomial written with a higher ``degree``."""
        if degree == self.degree:
            return self
        if degree < self.degree:
            raise ValueError(f"degree {self.degree} cannot be lowered to {degree}")
        matrix = elevation_matrix(self.degree, degree)
        return PiecewisePolynomial(self.breaks, combined(matrix, self.coefficients))

    def shifted(self, offset: float) -> PiecewisePolynomial:
        """Return the same flight ``offset`` [s] later."""
        return PiecewisePolynomial(self.breaks + offset, self.coefficients)

    def select(self, components: slice | list[int]) -> PiecewisePolynomial:
        """Return only the named components."""
        return PiecewisePolynomial(self.breaks, self.coefficients[:, :, components])

    def split(self, times: ArrayLike) -> PiecewisePolynomial:
        """Return the same flight with further breaks at ``times`` [s].

        De Casteljau subdivision: exact up to rounding, and the coefficients of a
        part lie in the hull of those of the whole.
        """
        wanted = np.asarray(times, dtype=np.float64).ravel()
        inside = wanted[(wanted > self.start) & (wanted < self.end)]
        breaks = np.union1d(self.breaks, inside)
        if breaks.size == self.breaks.size:
            return self
        left, right = breaks[:-1], breaks[1:]
        index = np.searchsorted(self.breaks, left, side="right") - 1
        width = self.breaks[index + 1] - self.breaks[index]
        lower = ((left - self.breaks[index]) / width)[:, None, None]
        upper = ((right - self.breaks[index]) / width)[:, None, None]
        return PiecewisePolynomial(
            breaks, restrict(self.coefficients[index], lower, upper)
        )

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Enclosure of all values: (lower, upper), each of shape (components,)."""
        flat = self.coefficients.reshape(-1, self.components)
        return flat.min(axis=0), flat.max(axis=0)


def evaluated(paths: Sequence[PiecewisePolynomial], times: FloatArray) -> FloatArray:
    """Evaluate many polynomials at the same times, those of equal borders at once.

    Parameters
    ----------
    paths
        Of equally many components.
    times
        Shape (...) [s].

    Returns
    -------
    ndarray, shape (n, ..., components)
    """
    alike: dict[tuple[bytes, int], list[int]] = {}
    for row, path in enumerate(paths):
        alike.setdefault((path.breaks.tobytes(), path.degree), []).append(row)
    components = paths[0].components
    values = np.empty((len(paths), *times.shape, components))
    for rows in alike.values():
        whole = np.concatenate([paths[row].coefficients for row in rows], axis=2)
        found = PiecewisePolynomial(paths[rows[0]].breaks, whole)(times)
        each = found.reshape(*times.shape, len(rows), components)
        values[rows] = np.moveaxis(each, -2, 0)
    return values


def restrict(
    coefficients: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Bernstein coefficients of the same polynomials on a part of [0, 1].

    Parameters
    ----------
    coefficients
        Shape (n, degree + 1, components).
    lower, upper
        Ends of the part as fractions of the interval, shape (n, 1, 1).

    Returns
    -------
    ndarray, shape (n, degree + 1, components)
        Two de Casteljau passes: the right part from ``lower``, of which the left
        part up to ``upper``.
    """
    degree = coefficients.shape[1] - 1
    # Intervals last: they are many, and lie next to each other then.
    part = coefficients.transpose(1, 2, 0).copy()
    low, high = lower[:, 0, 0], upper[:, 0, 0]
    rest = 1.0 - low
    for last in range(degree, 0, -1):
        part[:last] = rest * part[:last] + low * part[1 : last + 1]
    inner = (high - low) / np.where(low < 1.0, rest, 1.0)
    rest = 1.0 - inner
    for first in range(1, degree + 1):
        part[first:] = rest * part[first - 1 : -1] + inner * part[first:]
    return np.ascontiguousarray(part.transpose(2, 0, 1))


def product(one: FloatArray, other: FloatArray) -> FloatArray:
    """Bernstein coefficients of products of polynomials on the same intervals.

    Farouki 2012, equation 44.

    Parameters
    ----------
    one, other
        Coefficients along the last axis: (..., m + 1) and (..., n + 1).

    Returns
    -------
    ndarray, shape (..., m + n + 1)
    """
    m, n = one.shape[-1] - 1, other.shape[-1] - 1
    rows = np.array([comb(m, i) for i in range(m + 1)], dtype=np.float64) * one
    columns = np.array([comb(n, j) for j in range(n + 1)], dtype=np.float64) * other
    shape = (*np.broadcast_shapes(one.shape[:-1], other.shape[:-1]), m + n + 1)
    result = np.zeros(shape)
    for i in range(m + 1):
        result[..., i : i + n + 1] += rows[..., i : i + 1] * columns
    both = np.array([comb(m + n, k) for k in range(m + n + 1)], dtype=np.float64)
    return np.asarray(result / both)


def concatenate(parts: list[PiecewisePolynomial]) -> PiecewisePolynomial:
    """Join flights that follow each other without a gap, elevating as needed.

    Raises
    ------
    ValueError
        If a part does not start where the one before ends (to 1 ns).
    """
    degree = max(part.degree for part in parts)
    breaks = [parts[0].breaks]
    for before, after in pairwise(parts):
        if abs(after.start - before.end) > 1e-9:
            raise ValueError(f"gap between {before.end} s and {after.start} s")
        breaks.append(after.breaks[1:])
    return PiecewisePolynomial(
        np.concatenate(breaks),
        np.concatenate([part.elevated(degree).coefficients for part in parts]),
    )
