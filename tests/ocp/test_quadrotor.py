"""Twelve states in least time: flyable with the controls it prints."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.ocp_quadrotor import quadrotor, solve_quadrotor

from showc import ocp
from showc.ocp.audit.residuals import PhaseAuditor
from showc.ocp.transcription.collocation.statement import Statement


@pytest.mark.parametrize(("yaw_free", "ceiling"), [(True, 6.680), (False, 6.91)])
def test_least_time_is_flyable_to_a_millimetre(yaw_free, ceiling):
    solution = solve_quadrotor(yaw_free=yaw_free)
    assert solution.result is ocp.Result.SOLVED
    assert solution.objective <= ceiling
    problem = quadrotor(yaw_free=yaw_free)
    table = Statement(problem).table(np.zeros(0))
    auditor = PhaseAuditor(problem, problem.phases[0], 0)
    audit = auditor.shot(auditor.audit(solution, table), solution, table)
    states = solution.phases[0].states
    missed = np.abs(audit.shooting_end[:3] - states.coefficients[-1, -1, :3])
    assert missed.max() < 1e-3
    # Hulls inside the limits: kept at every instant, controls included.
    for part, members in (
        (states, problem.phases[0].states),
        (solution.phases[0].controls, problem.phases[0].controls),
    ):
        low, high = part.bounds()
        for i, member in enumerate(members.values()):
            assert low[i] >= float(member.quantity.lower) - 1e-12
            assert high[i] <= float(member.quantity.upper) + 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("yaw_free", "least"), [(True, 6.6117), (False, 6.8590)])
def test_left_to_itself_the_core_is_a_thousandth_from_the_optimum(yaw_free, least):
    """With default settings, in a limited effort, and flyable."""
    solution = ocp.solve(quadrotor(yaw_free=yaw_free))
    assert solution.result.usable
    assert least * (1.0 - 1e-4) < solution.objective < least * (1.0 + 1e-3)
    # Of a range of 30 m.
    assert solution.error.shooting < 1e-3 / 30.0
    assert solution.error.objective < 1e-2
    true = solution.objective / least - 1.0
    assert true < 10.0 * solution.error.objective
