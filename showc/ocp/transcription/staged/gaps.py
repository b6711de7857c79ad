"""Closing what a solver's tolerance leaves open between mesh intervals.

A gap of 1e-7 rad between two intervals is metres after a minute. Gauss-Newton steps of
least norm on the equations bring it to rounding and move nothing else visibly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray


CLOSED = 1e-11
"""Greatest gap that counts as rounding."""
NEAR = 1e-4
"""Gap beyond which a point is no solution and is left alone."""
STEPS = 2
"""Steps of Newton: from gaps of 1e-4, the second ends in rounding."""


class Gaps:
    """The equations of a program, with their slopes.

    Parameters
    ----------
    slopes
        CasADi function (x, p) -> (g, dg/dx).
    equal
        Which rows of g are equations.
    """

    def __init__(self, slopes: Any, equal: BoolArray) -> None:  # noqa: ANN401
        self._slopes, self._equal = slopes, equal
        rows = np.flatnonzero(equal).tolist()
        self._chosen = casadi.DM.triplet(
            list(range(len(rows))),
            rows,
            casadi.DM.ones(len(rows)),
            len(rows),
            equal.size,
        )

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
            slopes = casadi.mtimes(self._chosen, self._slopes(unknowns, parameters)[1])
            normal = casadi.mtimes(slopes, slopes.T)
            change = casadi.mtimes(slopes.T, casadi.solve(normal, gap, "ldl"))
            unknowns = unknowns - np.array(change).ravel()
            rows = np.array(self._slopes(unknowns, parameters)[0]).ravel()
        return unknowns, rows
