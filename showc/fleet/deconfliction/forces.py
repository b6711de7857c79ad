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

    def matrix(self, size: FloatArray, column: IntArray, columns: int) -> csr_matrix:
        """Sparse matrix of the rows times ``size`` (r,), compressed by rows.

        Parts of rows stand in threes of columns, as numbered by ``column``, of the
        shape of ``self.drone``.
        """
        from scipy.sparse import csr_matrix  # noqa: PLC0415 - for crowds alone

        value = self.value * size[:, None, None]
        place = column[..., None] * 3 + np.arange(3)
        head = np.arange(self.count + 1) * value[0].size if self.count else [0]
        shape = (self.count, 3 * columns)
        found = csr_matrix((value.ravel(), place.ravel(), head), shape=shape)
        found.eliminate_zeros()
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """What unit coefficients change of a drone's way."""

    values: FloatArray
    """Places at m samples, perhaps speeds and accelerations below, shape (3 m, k)."""
    samples: int
    """m."""


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


def scales(rows: Rows, reach: Reach) -> FloatArray:
    """Return scales of rows (r,): each then gives as much as any other."""
    give, values = np.zeros(rows.count), reach.values
    for one in range(rows.drone.shape[1]):
        for other in range(rows.drone.shape[1]):
            same = rows.drone[:, one] == rows.drone[:, other]
            mutual = np.einsum(
                "rk,rk->r", values[rows.sample[:, one]], values[rows.sample[:, other]]
            )
            both = np.einsum("ra,ra->r", rows.value[:, one], rows.value[:, other])
            give += np.where(same, mutual * both, 0.0)
    block = rows.sample[:, 0] // reach.samples
    floor = np.ones(rows.count)
    for number in range(3):
        mine = block == number
        floor[mine] = _FLOOR * give[mine].max(initial=0.0)
    return np.asarray(1.0 / np.sqrt(np.maximum(np.maximum(give, floor), 1e-30)))


def raised(  # noqa: PLR0917 - a program, and when it is solved
    rows: Rows,
    reach: Reach,
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
    samples, (moments, count) = reach.samples, reach.values.shape
    drones, column, few = _columns(rows, samples)
    split, cut = samples * drones.size * 3, 3 * few
    columns = samples * drones.size + (moments - samples) * few
    forward = rows.matrix(size, column, columns)
    back = forward.T.tocsr()
    places, rates = np.split(reach.values, [samples])
    to_places, to_rates = (np.ascontiguousarray(one.T) for one in (places, rates))

    def moved(push: FloatArray) -> FloatArray:
        pushed = back @ push
        inner = to_places @ pushed[:split].reshape(samples, -1)
        inner[:, :cut] += to_rates @ pushed[split:].reshape(moments - samples, cut)
        return np.asarray(inner)

    def reached(inner: FloatArray) -> FloatArray:
        parts = places @ inner, rates @ inner[:, :cut]
        return np.asarray(forward @ np.concatenate([part.ravel() for part in parts]))

    # Power iteration, from a vector that no symmetry of the crowd makes blind.
    trial = np.random.default_rng(0).standard_normal(goal.size)
    length = 1.0
    for _ in range(_POWERS):
        answer = reached(moved(trial))
        length = float(np.linalg.norm(answer))
        trial = answer / max(length, 1e-30)
    length *= _SURELY
    ahead, pace, begun = force, 1.0, force
    step = 2.0 * (forward.nnz + columns * 3.0 * count)
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


def _columns(rows: Rows, samples: int) -> tuple[IntArray, IntArray, int]:
    """Give numbers to places, speeds and accelerations that rows ask for.

    Few drones come near a limit of speed or acceleration: of the others only places
    are worked out.

    Returns
    -------
    tuple
        The drones (p,) that rows can move, those first that are near such a limit; the
        number of each part of a row, of the shape of ``rows.drone``: places at each of
        the samples, all drones in each, then speeds and accelerations of the first
        ones; and how many these are.
    """
    counts = np.any(rows.value != 0.0, axis=2)
    fast = counts & (rows.sample >= samples)
    first = distinct(rows.drone[fast])
    drones = np.append(first, np.setdiff1d(rows.drone[counts], first))
    local = np.zeros(int(rows.drone.max(initial=0)) + 1, dtype=np.int64)
    local[drones] = np.arange(drones.size)
    beyond = samples * (drones.size - first.size)
    column = rows.sample * np.where(fast, first.size, drones.size) + local[rows.drone]
    return drones, np.where(fast, column + beyond, column) * counts, first.size


def distinct(keys: IntArray) -> IntArray:
    """Return the different keys in order.

    NumPy 2.3 and later finds them with a table of hashes, which takes 25 times as long
    as sorting them (57,000 keys: 6.5 ms for 0.25 ms).
    """
    ordered = np.sort(keys)
    return np.asarray(ordered[np.diff(ordered, prepend=-1) > 0])
