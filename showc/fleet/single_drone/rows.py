"""Rows of the convex program behind a spline, kept as small blocks until it is solved.

Every row concerns one mesh interval, and there the six coefficients of each axis that
the B-spline has on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.single_drone.basis import LOCAL
from showc.fleet.single_drone.sparse import Columns

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray


_NOTHING = 1e-9
"""Rows shorter than this have no coefficient that is not given."""
_PASSED = 1e-6
"""How far a row is passed, over its bound or 1, before it counts as passed."""


class Rows:
    """Rows ``a . c <= b`` of a sparse matrix, block by block."""

    def __init__(self) -> None:
        self.values: list[FloatArray] = []
        self.bounds: list[FloatArray] = []
        self.intervals: list[IntArray] = []

    def add(
        self,
        x: FloatArray | float,
        y: FloatArray | float,
        z: FloatArray | float,
        bound: FloatArray,
    ) -> None:
        """Add rows for every interval; x, y, z of shape (K, r, 6), bound (K, r)."""
        shape = (*bound.shape, LOCAL)
        parts = [np.broadcast_to(np.asarray(part), shape) for part in (x, y, z)]
        block = np.stack(parts, axis=2).reshape(-1, 3, LOCAL)
        self.values.append(block)
        self.bounds.append(bound.ravel())
        self.intervals.append(np.repeat(np.arange(shape[0]), shape[1]))

    def add_axis(self, axis: int, values: FloatArray, bound: float) -> None:
        """Add rows on one axis for every interval; values (K, r, 6)."""
        parts: list[FloatArray | float] = [0.0, 0.0, 0.0]
        parts[axis] = values
        self.add(parts[0], parts[1], parts[2], np.full(values.shape[:2], bound))

    def add_at(
        self, intervals: IntArray, values: FloatArray, bound: FloatArray
    ) -> None:
        """Add rows for given intervals; values (m, r, 3, 6), bound (m, r)."""
        self.values.append(values.reshape(-1, 3, LOCAL))
        self.bounds.append(bound.ravel())
        self.intervals.append(np.repeat(intervals, bound.shape[1]))

    @property
    def count(self) -> int:
        """Number of rows so far."""
        return sum(bound.size for bound in self.bounds)


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """All rows of a program, r of them, on the 3 n coefficients of a spline."""

    values: FloatArray
    """Shape (r, 3, 6)."""
    columns: IntArray
    """Coefficient that each value multiplies, shape (r, 3, 6)."""
    bounds: FloatArray
    """Shape (r,)."""
    group: IntArray
    """Wall that a soft row belongs to, shape (r,); -1 for rows that are hard."""
    free: BoolArray
    """Coefficients that are not given, shape (3 n,)."""
    given: FloatArray
    """Values of the others, shape (3 n,)."""

    @classmethod
    def of(
        cls,
        rows: Rows,
        free: BoolArray,
        given: FloatArray,
        hard: int,
        rows_of_a_wall: int,
    ) -> System:
        """Put blocks together; the first ``hard`` rows are hard, walls follow."""
        intervals = np.concatenate(rows.intervals)
        count = free.size // 3
        columns = (
            intervals[:, None, None] + np.arange(LOCAL) + count * np.arange(3)[:, None]
        )
        group = np.arange(intervals.size) - hard
        group = np.where(group < 0, -1, group // rows_of_a_wall)
        return cls(
            np.concatenate(rows.values),
            columns,
            np.concatenate(rows.bounds),
            group,
            free,
            given,
        )

    @property
    def hard(self) -> BoolArray:
        """Rows that must be kept, shape (r,)."""
        return self.group < 0

    def reached(self, coefficients: FloatArray) -> FloatArray:
        """Left-hand sides (r,) for coefficients (3 n,)."""
        return np.asarray(
            np.einsum("rai,rai->r", self.values, coefficients[self.columns])
        )

    def passed(self, coefficients: FloatArray) -> BoolArray:
        """Rows that coefficients (3 n,) do not keep, shape (r,)."""
        room = self.bounds + _PASSED * np.maximum(np.abs(self.bounds), 1.0)
        return self.reached(coefficients) > room

    def matrix(
        self, chosen: BoolArray, slack: int
    ) -> tuple[Columns, FloatArray] | None:
        """Rows ``chosen`` on the free coefficients and ``slack`` more unknowns.

        Soft rows have the slack of their wall, and every slack is positive. None if a
        row without a free coefficient is not kept.
        """
        take = np.flatnonzero(chosen)
        values, columns = self.values[take], self.columns[take]
        right = self.bounds[take] - np.einsum("rai,rai->r", values, self.given[columns])
        values = np.where(self.free[columns], values, 0.0)
        size = np.sqrt(np.einsum("rai,rai->r", values, values))
        busy, hard = size > _NOTHING, self.hard[take]
        if np.any(right[~busy & hard] < -_NOTHING):
            return None
        scale = np.where(hard, size, 1.0)[busy]
        data = values[busy] / scale[:, None, None]
        count = int(busy.sum())
        number = np.cumsum(self.free) - 1
        unknowns = int(self.free.sum())
        used = data != 0.0
        row = np.broadcast_to(np.arange(count)[:, None, None], data.shape)
        soft = np.flatnonzero(~hard[busy])
        wall = self.group[take][busy][soft]
        entries = np.concatenate([data[used], -np.ones(wall.size), -np.ones(slack)])
        rows = np.concatenate([row[used], soft, count + np.arange(slack)])
        places = np.concatenate(
            [number[columns[busy][used]], unknowns + wall, unknowns + np.arange(slack)]
        )
        shape = (count + slack, unknowns + slack)
        bounds = np.concatenate([right[busy] / scale, np.zeros(slack)])
        return Columns.of(entries, (rows, places), shape), bounds
