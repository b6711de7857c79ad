"""Problems with known optima are solved to the tolerance, and errors told rightly."""

from __future__ import annotations

import pytest
from benchmarks.ocp_closed import CLOSED

from showc import ocp


@pytest.mark.parametrize("name", CLOSED)
def test_known_optima_are_reached_by_default(name):
    problem = CLOSED[name]
    solution = ocp.solve(problem.build())
    assert solution.result is ocp.Result.SOLVED, solution.message
    off = abs(solution.objective - problem.optimum)
    assert off <= 1e-6 * (abs(problem.optimum) or 1.0)
