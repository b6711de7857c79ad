"""Problems with known optima are solved to the tolerance, and errors told rightly."""

from __future__ import annotations

import pytest
from benchmarks.ocp_closed import CLOSED

from showc import ocp

ROUNDING = 1e-11
"""Relative error of an optimum that is rounding: of a thousand additions, and of the
closed forms by quadrature and roots."""


@pytest.mark.parametrize("name", CLOSED)
def test_known_optima_are_reached_by_default(name):
    problem = CLOSED[name]
    solution = ocp.solve(problem.build())
    assert solution.result is ocp.Result.SOLVED, solution.message
    size = abs(problem.optimum) or 1.0
    off = abs(solution.objective - problem.optimum) / size
    assert off <= 1e-6
    # What is reported is never below a tenth of the truth, rounding aside.
    assert off <= 10.0 * solution.error.objective + ROUNDING
