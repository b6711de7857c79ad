"""Closing what a solver's tolerance leaves open between mesh intervals.

A gap of 1e-7 rad between two intervals is metres after a minute. Gauss-Newton steps of
least norm on the equations bring it to rounding and move nothing else visibly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import linalg

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

CLOSED = 1e-11
"""Greatest gap that counts as rounding."""
NEAR = 1e-4
"""Gap beyond which a point is no solution and is left alone."""
STEPS = 2


class Gaps:
    """The equations of a program, with their slopes.

    Parameters
    ----------
    slopes
        CasADi function (x, p) -> (g, dg/dx).
    equal
        Which rows of g are equations.
    """

    def __init__(self, slopes: Any, equal: NDArray[np.bool_]) -> None:  # noqa: ANN401
        self._slopes, self._equal = slopes, equal

    def closed(
        self,
        unknowns: FloatArray,
        rows: FloatArray,
        parameters: FloatArray,
        wanted: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return unknowns and rows after the least change that closes the equations.

        Parameters
        ----------
        unknowns, rows
            The solver's answer.
        parameters
            Values of p.
        wanted
            Right-hand side of the equations.
        """
        for _ in range(STEPS):
            gap = rows[self._equal] - wanted
            if not CLOSED < np.abs(gap).max() < NEAR:
                break
            matrix = self._slopes(unknowns, parameters)[1]
            slopes = matrix.sparse().tocsr()[self._equal].tocsc()
            multipliers = linalg.spsolve((slopes @ slopes.T).tocsc(), gap)
            unknowns = unknowns - slopes.T @ multipliers
            rows = np.array(self._slopes(unknowns, parameters)[0]).ravel()
        return unknowns, rows
