"""Polynomials in the Bernstein basis, many at once: all that proofs need of them.

A polynomial of degree n on an interval is the sum of its coefficients c_0 ... c_n times
C(n, j) s^j (1 - s)^(n - j), s in [0, 1] being the fraction of the interval. Its values
lie between the least and the greatest coefficient, and c_0 and c_n are its values at
the ends (Farouki 2012, The Bernstein polynomial basis: a centennial retrospective,
sections 3 and 4). Halving an interval makes the enclosure about four times as tight.
So :func:`least` encloses the least value of anything that coefficients bound from
below: intervals that could hold less than what is reached at an end are halved.

Arrays of coefficients have the shape (pieces, degree + 1, ...) throughout.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial.polynomial import polyvander

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from showc.arrays import FloatArray

MOST = 500_000
"""Intervals open at once at which a search gives up: what it looks for is undecided."""

_ROUNDS = 80  # halvings of an interval after which it does: float64 has no more


def binomials(degree: int) -> FloatArray:
    """Return C(degree, 0) ... C(degree, degree)."""
    return np.array([comb(degree, j) for j in range(degree + 1)], dtype=np.float64)


def basis(degree: int, fraction: ArrayLike) -> FloatArray:
    """Values of the basis polynomials at ``fraction``, shape (..., degree + 1)."""
    s = np.asarray(fraction, dtype=np.float64)
    powers = polyvander(s, degree) * polyvander(1.0 - s, degree)[..., ::-1]
    return (powers * binomials(degree)).reshape(*s.shape, degree + 1)


def elevate(coefficients: FloatArray, target: int) -> FloatArray:
    """Coefficients of the same polynomials in the degree ``target``.

    One degree after the other; Farouki 2012, section 4.
    """
    for degree in range(coefficients.shape[1], target + 1):
        share = np.arange(1, degree)[:, None] / degree
        # As wide as what it is multiplied with: each step then runs along memory.
        share = share.repeat(coefficients.shape[2], axis=1)
        inside = share * coefficients[:, :-1] + (1.0 - share) * coefficients[:, 1:]
        ends = coefficients[:, :1], coefficients[:, -1:]
        coefficients = np.concatenate([ends[0], inside, ends[1]], axis=1)
    return coefficients


def halves(coefficients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients of the same polynomials on the first and the second half."""
    left, right = coefficients.copy(), coefficients.copy()
    for step in range(1, coefficients.shape[1]):
        # De Casteljau's triangle: the ends of its rows are what the halves have.
        coefficients = 0.5 * (coefficients[:, :-1] + coefficients[:, 1:])
        left[:, step], right[:, -1 - step] = coefficients[:, 0], coefficients[:, -1]
    return left, right


def rows_last(coefficients: FloatArray) -> FloatArray:
    """Coefficients as (degree + 1, ..., pieces): steps then run along memory."""
    return np.ascontiguousarray(np.moveaxis(coefficients, 0, -1))


def part(coefficients: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Coefficients of the same polynomials between two fractions of the interval.

    These are 0 <= lower <= upper <= 1, shape (pieces,).
    """
    degree = coefficients.shape[1] - 1
    # Pieces last: each step then runs along memory, three times as fast.
    result = np.moveaxis(coefficients, 0, -1).copy(order="C")
    rest = np.where(lower < 1.0, 1.0 - lower, 1.0)
    beyond = 1.0 - np.clip((upper - lower) / rest, 0.0, 1.0)
    # Most intervals are cut at one end, or at none.
    late, early = np.flatnonzero(lower != 0.0), np.flatnonzero(beyond != 0.0)
    some, share = result.take(late, axis=-1), lower[late]
    for last in range(degree, 0, -1):
        some[:last] += share * (some[1 : last + 1] - some[:last])
    result[..., late] = some
    some, share = result.take(early, axis=-1), beyond[early]
    for first in range(degree):
        some[first + 1 :] += share * (some[first:-1] - some[first + 1 :])
    result[..., early] = some
    return np.moveaxis(result, -1, 0)


def square_sum(coefficients: FloatArray) -> FloatArray:
    """Coefficients of the sum of the squared components, (pieces, 2 degree + 1)."""
    return product(coefficients, coefficients)


def product(one: FloatArray, other: FloatArray) -> FloatArray:
    """Coefficients of scalar products, (pieces, sum of degrees + 1).

    Takes shapes (pieces, degree + 1, components); Farouki 2012, equation 44.
    """
    m, n = one.shape[1] - 1, other.shape[1] - 1
    first, second = rows_last(one), rows_last(other)
    second = second * binomials(n)[:, None, None]
    result = np.zeros((m + n + 1, one.shape[0]))
    for i, share in enumerate(binomials(m)):
        result[i : i + n + 1] += np.einsum("kr,jkr->jr", share * first[i], second)
    return np.asarray(result.T / binomials(m + n))


@dataclass(frozen=True, slots=True)
class Least:
    """The least value over some intervals, enclosed."""

    lower: float  # no value is less; minus infinity if that is undecided
    upper: float  # value that is reached
    row: int  # on which of the intervals; 0 if the value was known before
    fraction: float  # where on it, from 0 to 1


def least(
    work: FloatArray,
    bounded: Callable[[FloatArray], FloatArray],
    reached: Callable[[FloatArray], FloatArray],
    resolution: float,
    best: float = np.inf,
) -> Least:
    """Enclose the least value over all intervals, or of ``best`` if that is less.

    From coefficients (n, degree + 1, ...), as ``work`` holds them, ``bounded`` makes
    lower bounds (n,) of the value; from values (n, ...) of the polynomials ``reached``
    makes values (n,) of what is sought. The enclosure is as wide as ``resolution``, and
    ``best`` is a value that is reached elsewhere.
    """
    row, lower = np.arange(work.shape[0]), np.inf
    begin, length = np.zeros(row.size), np.ones(row.size)
    where, fraction = 0, 0.0
    for _ in range(_ROUNDS):
        bound = bounded(work)
        # Numbers that are undefined stay open, and nothing is proved.
        rows = np.flatnonzero(~(bound >= best - resolution))
        for end in (0, -1):
            value = reached(work[rows, end])
            index = int(value.argmin()) if value.size else 0
            if value.size and value[index] < best:
                at = rows[index]
                best, where = float(value[index]), int(row[at])
                fraction = float(begin[at] - end * length[at])
        undecided = ~(bound >= best - resolution)
        lower = min(lower, float(bound[~undecided].min(initial=np.inf)))
        if not undecided.any():
            return Least(min(lower, best), best, where, fraction)
        if np.count_nonzero(undecided) > MOST:
            break
        work = np.concatenate(halves(work[undecided]))
        same, half, begin = row[undecided], 0.5 * length[undecided], begin[undecided]
        row, length = np.concatenate([same, same]), np.concatenate([half, half])
        begin = np.concatenate([begin, begin + half])
    return Least(-np.inf, best, where, fraction)
