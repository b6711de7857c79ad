"""Sparse matrices under construction, entry by entry."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray


@dataclass(slots=True)
class Triplets:
    """Triplets of a sparse matrix under construction."""

    rows: list[IntArray] = field(default_factory=list)
    columns: list[IntArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)

    def add(self, rows: object, columns: object, values: object) -> None:
        """Add entries; the three arguments are broadcast against each other."""
        r, c, v = np.broadcast_arrays(rows, columns, values)  # type: ignore[arg-type]
        self.rows.append(r.ravel().astype(np.int64))
        self.columns.append(c.ravel().astype(np.int64))
        self.values.append(v.ravel().astype(np.float64))

    def csr(self, height: int, width: int) -> sparse.csr_matrix:
        """Sum of all entries as a matrix of that shape."""
        if not self.rows:
            return sparse.csr_matrix((height, width))
        return sparse.csr_matrix(
            (
                np.concatenate(self.values),
                (np.concatenate(self.rows), np.concatenate(self.columns)),
            ),
            shape=(height, width),
        )
