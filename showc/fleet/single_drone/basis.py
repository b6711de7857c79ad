"""The B-splines of the convex program: even knots, clamped ends, hover at both.

On each interval only six coefficients of an axis count; matrices to Bernstein
coefficients are kept in that local form.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray

    Entries = tuple[FloatArray, tuple[IntArray, IntArray]]

DEGREE = 5
"""Of the splines of positions: torque, the fourth derivative, is continuous."""
LOCAL = DEGREE + 1
"""Coefficients that count on an interval."""
_CALM = 1e-4
"""Price of squared jerk beside squared distance: without it, coefficients that no place
determines would be free."""


@dataclass(frozen=True, slots=True, eq=False)
class Basis:
    """From the local B-spline coefficients to Bernstein ones, shapes (K, ., 6)."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    """Elevated to the degree of the acceleration."""
    gram: FloatArray
    """Mean of squared values and a little of squared jerk, (n, n)."""
    weights: FloatArray
    """From values wanted at ``NODES`` of every interval to the linear term, (n, .)."""


NODES: FloatArray = (np.arange(4) + 0.5) / 4
"""Where values are wanted on an interval, as fractions: the middles of its quarters."""


@lru_cache(maxsize=16)
def spline_basis(intervals: int, duration: float) -> Basis:
    """Return the matrices of a spline of ``intervals`` over ``duration`` [s]."""
    count = intervals + DEGREE
    position = _bernstein(intervals)
    width = duration / intervals
    velocity = DEGREE * np.diff(position, axis=1) / width
    acceleration = (DEGREE - 1) * np.diff(velocity, axis=1) / width
    jerk = (DEGREE - 2) * np.diff(acceleration, axis=1) / width
    elevation = np.array([[1, 0, 0], [1 / 3, 2 / 3, 0], [0, 2 / 3, 1 / 3], [0, 0, 1]])
    jerk = np.einsum("ij,kjn->kin", elevation, jerk)

    def spread(local: FloatArray) -> FloatArray:
        result = np.zeros((*local.shape[:2], count))
        for k in range(intervals):
            result[k, :, k : k + LOCAL] = local[k]
        return result.reshape(-1, count)

    sampled = spread(np.einsum("jk,ikn->ijn", bernstein_basis(DEGREE, NODES), position))
    rough = spread(jerk)
    gram = sampled.T @ sampled / sampled.shape[0]
    # A little weight on jerk keeps the program strictly convex and the flight calm.
    gram += _CALM * rough.T @ rough / rough.shape[0]
    return Basis(
        position, velocity, acceleration, jerk, gram, -sampled.T / sampled.shape[0]
    )


def _bernstein(intervals: int) -> FloatArray:
    """Matrices from the local coefficients to Bernstein ones, shape (K, 6, 6).

    Bernstein coefficient j on [a, b] is the blossom at (a, ..., a, b, ..., b) with b
    standing j times, by the algorithm of de Boor with an argument of its own in each
    step (Ramshaw 1989, Blossoms are polar forms, section 6).
    """
    knots = np.concatenate(
        [np.zeros(DEGREE), np.linspace(0.0, 1.0, intervals + 1), np.ones(DEGREE)]
    )
    first = np.arange(intervals)
    result = np.empty((intervals, LOCAL, LOCAL))
    for j in range(LOCAL):
        value = np.broadcast_to(np.eye(LOCAL), (intervals, LOCAL, LOCAL))
        for step in range(1, LOCAL):
            at = knots[first + DEGREE + (step <= j)][:, None]
            number = first[:, None] + np.arange(step, LOCAL)
            left, right = knots[number], knots[number + LOCAL - step]
            share = ((at - left) / (right - left))[..., None]
            value = (1.0 - share) * value[:, :-1] + share * value[:, 1:]
        result[:, j] = value[:, 0]
    return result


def free_coefficients(count: int, *, leaps: bool) -> BoolArray:
    """Which of the coefficients x, y, z after each other are not given, (3 n,).

    ``leaps`` tells whether thrust may jump.
    """
    # Hover at both ends: tilt and body rates vanish, so horizontally velocity,
    # acceleration and jerk do; vertically the velocity, and the acceleration unless
    # thrust may jump.
    free = np.ones((3, count), dtype=bool)
    free[:2, :4] = free[:2, -4:] = False
    given = 2 if leaps else 3
    free[2, :given] = free[2, -given:] = False
    return free.ravel()


@lru_cache(maxsize=16)
def quadratic_upper(intervals: int, duration: float, *, leaps: bool) -> Entries:
    """Upper triangle of the quadratic term: values, (rows, columns)."""
    gram = spline_basis(intervals, duration).gram
    free = free_coefficients(gram.shape[0], leaps=leaps)
    full = np.triu(np.kron(np.eye(3), gram)[np.ix_(free, free)])
    rows, columns = np.nonzero(full)
    return full[rows, columns], (rows, columns)


@lru_cache(maxsize=16)
def nearest_coefficients(intervals: int, duration: float, *, leaps: bool) -> FloatArray:
    """Inverse of the quadratic term: from its gradient to the free coefficients."""
    gram = spline_basis(intervals, duration).gram
    free = free_coefficients(gram.shape[0], leaps=leaps).reshape(3, -1)
    inverse = np.zeros((int(free.sum()),) * 2)
    first = 0
    for axis in free:
        part = slice(first, first + int(axis.sum()))
        inverse[part, part] = np.linalg.inv(gram[np.ix_(axis, axis)])
        first = part.stop
    return inverse
