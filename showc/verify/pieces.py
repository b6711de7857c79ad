"""Polynomials of drones with meshes of about one size, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.verify.kernel.show import PieceTable

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

_BATCH = 2_000
"""Mesh intervals taken at once: few enough to stay in the processor's cache."""


def batches(table: PieceTable) -> Iterator[IntArray]:
    """Group drones with meshes of about one size, bounded in memory."""
    counts = np.diff(table.first)
    order = np.argsort(counts, kind="stable")
    begin = 0
    while begin < order.size:
        end = begin + 1
        least = counts[order[begin]]
        while (
            end < order.size
            and counts[order[end]] <= least + least // 4 + 2
            and (end - begin + 1) * counts[order[end]] <= _BATCH
        ):
            end += 1
        yield order[begin:end]
        begin = end


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Polynomials of some drones, in the order in which they are evaluated.

    Drones with fewer mesh intervals than others repeat their last one.
    """

    table: PieceTable
    drones: IntArray
    """Counting from 0, shape (drones,)."""
    piece: IntArray
    """Rows of the table, shape (drones, intervals)."""
    valid: NDArray[np.bool_]
    """Which of them are flown, and do not only fill up, shape (drones, intervals)."""
    first: FloatArray
    """First state of each drone, shape (12, drones)."""
    state: FloatArray
    """Bernstein coefficients, shape (degree + 1, 12, drones, intervals)."""
    control: FloatArray
    """Bernstein coefficients, shape (degree + 1, 4, drones, intervals)."""
    cut: bool
    """Whether a control may ask the rotors for more than they give."""

    @classmethod
    def of(cls, table: PieceTable, rows: IntArray, cut: NDArray[np.bool_]) -> Pieces:
        """Gather the drones that are ``rows`` of the table's."""
        counts = np.diff(table.first)[rows]
        index = np.arange(counts.max())
        piece = table.first[rows][:, None] + np.minimum(index, counts[:, None] - 1)

        def gathered(coefficients: FloatArray) -> FloatArray:
            return np.ascontiguousarray(coefficients[piece].transpose(2, 3, 0, 1))

        return cls(
            table,
            table.drones[rows],
            piece,
            index < counts[:, None],
            table.state[table.first[rows], 0].T,
            gathered(table.state),
            gathered(table.control),
            bool(cut[piece].any()),
        )
