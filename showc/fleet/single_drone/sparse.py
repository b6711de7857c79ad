"""Sparse matrices as Clarabel reads them: column by column.

Clarabel takes SciPy's matrices by their attributes. Loading SciPy's sparse matrices
takes each process longer than many a leg takes to solve, and nothing else of them is
wanted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """A sparse matrix in compressed columns; the attributes are SciPy's."""

    data: FloatArray
    """Values, column after column, by rows within each."""
    indices: IntArray
    """Row of each value."""
    indptr: IntArray
    """Where each column begins in these, and their number at the end."""
    shape: tuple[int, int]
    """Rows and columns."""
    has_canonical_format: bool = True
    """Rows increase within a column and none stands twice."""

    @classmethod
    def of(
        cls,
        values: FloatArray,
        places: tuple[IntArray, IntArray],
        shape: tuple[int, int],
    ) -> Columns:
        """Put ``values`` at ``places`` (rows, columns), each of which stands once."""
        rows, columns = places
        order = np.lexsort((rows, columns))
        begins = np.searchsorted(columns[order], np.arange(shape[1] + 1))
        return cls(values[order], rows[order], begins, shape)
