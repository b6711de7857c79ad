"""Forces between drones: the dual of a program for a whole crowd.

A row asks for a value of up to four places, speeds or accelerations; the force on it is
its multiplier. Forces are raised by an accelerated gradient (Beck, Teboulle 2009;
restarts by O'Donoghue, Candès 2015): a step costs a few products of matrices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

    from showc.arrays import FloatArray, IntArray


_POWERS, _SURELY = 16, 1.15
"""Steps by which the greatest eigenvalue of a program is found, and what is added to
it: too low a value would let forces grow without bound."""
_FLOOR = 1e-5
"""Least part of the greatest give of a row by which it is scaled."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Rows on values of drones at samples, up to four of them in each row."""

    drone: IntArray
    """Shape (r, parts)."""
    sample: IntArray
    """Shape (r, parts)."""
    value: FloatArray
    """Shape (r, parts, 3)."""

    @property
    def count(self) -> int:
        """How many rows there are."""
        return int(self.drone.shape[0])

    @classmethod
    def joined(cls, pairs: Rows, single: Rows) -> Rows:
        """Put rows of limits below rows of pairs."""
        empty = ((0, 0), (0, 3))
        return cls(
            np.concatenate([pairs.drone, np.pad(single.drone, empty)]),
            np.concatenate([pairs.sample, np.pad(single.sample, empty, mode="edge")]),
            np.concatenate([pairs.value, np.pad(single.value, (*empty, (0, 0)))]),
        )

    def on(self, values: FloatArray) -> FloatArray:
        """Left-hand sides for values (n, 3 m, 3), shape (r,)."""
        return np.asarray(
            np.einsum("rpa,rpa->r", self.value, values[self.drone, self.sample])
        )

    def matrix(
        self, size: FloatArray, drone: IntArray, samples: int, drones: int
    ) -> csr_matrix:
        """Sparse matrix of the rows times ``size`` (r,), compressed by rows.

        Its columns are samples, in each the drones (as numbered by ``drone``, of the
        shape of ``self.drone``), of each the axes.
        """
        from scipy.sparse import csr_matrix  # noqa: PLC0415 - for crowds alone

        value = self.value * size[:, None, None]
        column = (self.sample * drones + drone)[..., None] * 3 + np.arange(3)
        head = np.arange(self.count + 1) * value[0].size if self.count else [0]
        shape = (self.count, drones * samples * 3)
        return csr_matrix((value.ravel(), column.ravel(), head), shape=shape)


@dataclass(frozen=True, slots=True, eq=False)
class Forces:
    """What forces a program has, and where they push."""

    force: FloatArray
    """Of each row, shape (r,)."""
    drones: IntArray
    """That are pushed, shape (p,)."""
    push: FloatArray
    """Coefficients that follow, of these drones, shape (p, k, 3)."""
    work: float
    """Products of numbers that it took."""


def scales(rows: Rows, reach: FloatArray, samples: int) -> FloatArray:
    """Return scales of rows (r,): each then gives as much as any other.

    Parameters
    ----------
    reach
        Values, speeds and accelerations at samples by unit coefficients, (3 m, k).
    samples
        m: how many there are of each.
    """
    give = np.zeros(rows.count)
    for one in range(rows.drone.shape[1]):
        for other in range(rows.drone.shape[1]):
            same = rows.drone[:, one] == rows.drone[:, other]
            mutual = np.einsum(
                "rk,rk->r", reach[rows.sample[:, one]], reach[rows.sample[:, other]]
            )
            both = np.einsum("ra,ra->r", rows.value[:, one], rows.value[:, other])
            give += np.where(same, mutual * both, 0.0)
    block = rows.sample[:, 0] // samples
    floor = np.ones(rows.count)
    for number in range(3):
        mine = block == number
        floor[mine] = _FLOOR * give[mine].max(initial=0.0)
    return np.asarray(1.0 / np.sqrt(np.maximum(np.maximum(give, floor), 1e-30)))


def raised(  # noqa: PLR0917 - a program, and when it is solved
    rows: Rows,
    reach: FloatArray,
    goal: FloatArray,
    size: FloatArray,
    force: FloatArray,
    close: float,
    steps: int,
) -> Forces:
    """Raise forces where values lack.

    Parameters
    ----------
    rows
        Their values are those that meet unit forces.
    reach
        As of :func:`scales`, shape (3 m, k).
    goal
        What rows lack without forces, times their scales, shape (r,).
    size
        Scales of the rows, shape (r,).
    force
        To begin with, shape (r,).
    close
        Lack at which the program counts as solved, before scaling.
    steps
        At most.
    """
    drones, local = np.unique(rows.drone, return_inverse=True)
    local = local.reshape(rows.drone.shape)
    moments, count = reach.shape
    forward = rows.matrix(size, local, moments, drones.size)
    back = forward.T.tocsr()
    there = np.ascontiguousarray(reach.T)

    def moved(push: FloatArray) -> FloatArray:
        return np.asarray(there @ (back @ push).reshape(moments, -1))

    def reached(inner: FloatArray) -> FloatArray:
        return np.asarray(forward @ (reach @ inner).ravel())

    # Power iteration, from a vector that no symmetry of the crowd makes blind.
    trial = np.random.default_rng(0).standard_normal(goal.size)
    length = 1.0
    for _ in range(_POWERS):
        answer = reached(moved(trial))
        length = float(np.linalg.norm(answer))
        trial = answer / max(length, 1e-30)
    length *= _SURELY
    ahead, pace, begun = force, 1.0, force
    step = 2.0 * (forward.nnz + 3.0 * there.size * drones.size)
    work = _POWERS * step
    for _ in range(steps):
        lack = goal - reached(moved(ahead))
        work += step
        if float((lack / size).max(initial=0.0)) < close and ahead is not begun:
            break
        higher = np.maximum(0.0, ahead + lack / max(length, 1e-30))
        if float((ahead - higher) @ (higher - force)) > 0.0:
            pace = 1.0
        faster = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * pace * pace))
        ahead = higher + (pace - 1.0) / faster * (higher - force)
        force, pace = higher, faster
    push = np.moveaxis(moved(force).reshape(count, drones.size, 3), 1, 0)
    return Forces(force, drones, push, work)


def distinct(keys: IntArray) -> IntArray:
    """Return the different keys in order.

    NumPy 2.3 and later finds them with a table of hashes, which takes 25 times as long
    as sorting them (57,000 keys: 6.5 ms for 0.25 ms).
    """
    ordered = np.sort(keys)
    return np.asarray(ordered[np.diff(ordered, prepend=-1) > 0])
