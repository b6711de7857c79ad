"""Collocation points of one mesh interval: Gauss, Radau and Lobatto.

All abscissae are fractions s in [0, 1] of the interval, all weights integrate over
s. With N points the quadrature is exact up to degree 2N - 1 (Gauss), 2N - 2
(Radau, end included) and 2N - 3 (Lobatto, both ends included).

The state is a polynomial of degree N in Bernstein form that satisfies the
differential equation at the N points: the collocation form of the Gauss, Radau IIA
and Lobatto IIIA methods (Hairer, Norsett, Wanner 1993, section II.7).
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.polynomial import legendre

from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.arrays import FloatArray


Scheme = Literal["gauss", "radau", "lobatto"]


def _locked(array: NDArray[np.floating]) -> FloatArray:
    fixed = np.array(array, dtype=np.float64)
    fixed.setflags(write=False)
    return fixed


@lru_cache(maxsize=256)
def collocation(scheme: Scheme, points: int) -> tuple[FloatArray, FloatArray]:
    """Abscissae and weights on [0, 1].

    Parameters
    ----------
    scheme
        ``gauss`` (Legendre-Gauss), ``radau`` (Legendre-Gauss-Radau with the end
        point) or ``lobatto`` (Legendre-Gauss-Lobatto with both end points).
    points
        Number of points N; at least 1, for Lobatto at least 2.

    Returns
    -------
    tuple of ndarray
        ``(abscissae, weights)``, each of shape (N,), read-only.

    Raises
    ------
    ValueError
        If the scheme is unknown or has too few points.
    """
    least = 2 if scheme == "lobatto" else 1
    if points < least:
        raise ValueError(f"{scheme} collocation has {points} points; wanted {least}")
    if scheme == "gauss":
        gauss, share = legendre.leggauss(points)
        return _locked(0.5 * (gauss + 1.0)), _locked(0.5 * share)
    unit = np.zeros(points + 1)
    if scheme == "radau":
        # The points -t of the left rule are the roots of P_N-1 + P_N.
        unit[points - 1 :] = 1.0
        roots = np.sort(-legendre.legroots(unit).real)
        roots[-1] = 1.0
    elif scheme == "lobatto":
        inner = legendre.legroots(legendre.legder(np.eye(points)[points - 1]))
        roots = np.concatenate([[-1.0], np.sort(inner.real), [1.0]])
    else:
        raise ValueError(
            f"unknown collocation {scheme!r}; wanted 'gauss', 'radau' or 'lobatto'"
        )
    vandermonde = legendre.legvander(roots, points - 1)
    moments = np.zeros(points)
    moments[0] = 2.0
    weights = np.linalg.solve(vandermonde.T, moments)
    return _locked(0.5 * (roots + 1.0)), _locked(0.5 * weights)


@lru_cache(maxsize=256)
def bernstein_derivative(degree: int, abscissae: tuple[float, ...]) -> FloatArray:
    """Matrix from Bernstein coefficients to d/ds at ``abscissae``.

    Shape (len(abscissae), degree + 1); s is the fraction of the interval.
    """
    s = np.asarray(abscissae)
    matrix = np.zeros((s.size, degree + 1))
    if degree > 0:
        lower = degree * bernstein_basis(degree - 1, s)
        matrix[:, 1:] += lower
        matrix[:, :-1] -= lower
    return _locked(matrix)


@lru_cache(maxsize=256)
def bernstein_values(degree: int, abscissae: tuple[float, ...]) -> FloatArray:
    """Matrix from Bernstein coefficients to values at ``abscissae``."""
    return _locked(bernstein_basis(degree, np.asarray(abscissae)))


@lru_cache(maxsize=256)
def fitting_points(degree: int) -> tuple[float, ...]:
    """Points on [0, 1], ends included, at which a polynomial is well determined."""
    if degree == 0:
        return (0.5,)
    angle = np.pi * np.arange(degree + 1) / degree
    return tuple(float(s) for s in 0.5 * (1.0 - np.cos(angle)))
