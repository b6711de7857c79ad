"""What only looks optimal: the minimum principle tells, and the next mesh mends it."""

from __future__ import annotations

from math import e, log, pi, sqrt
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import fsolve

from showc import ocp
from showc.ocp.refinement.judgement import is_worse

DAMPING, FAR = 0.05, 12.0


def least_time_of_a_damped_oscillator() -> float:
    """Add up arcs of half a period, and a shorter one at either end.

    The costates of a linear oscillator change sign every half period; with six
    arcs, the first one down, rest is reached.
    """
    half = pi / sqrt(1.0 - DAMPING**2)
    system = np.array([[0.0, 1.0], [-1.0, -2.0 * DAMPING]])

    def missed(ends):
        x, push = np.array([FAR, 0.0]), -1.0
        for time in (ends[0], half, half, half, half, ends[1]):
            rest = np.array([push, 0.0])
            x, push = rest + expm(system * time) @ (x - rest), -push
        return x

    return float(fsolve(missed, [0.2, 1.0], xtol=1e-13).sum() + 4.0 * half)


def test_a_short_arc_that_a_coarse_mesh_hides_is_found():
    # A first arc of a hundredth of the time, in one that is held at the other bound.
    problem = ocp.Problem("damped oscillator")
    phase = problem.phase(duration=(0.1, 200.0))
    x = phase.state("x", start=FAR, end=0.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, -x - 2.0 * DAMPING * v + u)
    problem.minimise(phase.duration)
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED
    exact = least_time_of_a_damped_oscillator()
    assert solution.objective == pytest.approx(exact, rel=1e-8)
    assert len(solution.history[-1].phases[0].switches) == 5


def test_an_arc_at_the_wrong_bound_is_left_out():
    # Two oscillators with one push; the search puts an arc of no length at the end.
    problem = ocp.Problem("two oscillators")
    phase = problem.phase(duration=(0.1, 60.0))
    unit = 1e4
    x, y = phase.state("x", start=3e4, end=0.0), phase.state("y", start=2e4, end=0.0)
    v, w = phase.state("v", start=0.0, end=0.0), phase.state("w", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, -x + unit * u)
    phase.derivative(y, w)
    phase.derivative(w, -4.0 * y + unit * u)
    problem.minimise(phase.duration)
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED
    # Solved to 1e-9 in the unit in which the push is one.
    assert solution.objective == pytest.approx(8.03524993, rel=1e-8)


def two_valleys() -> ocp.Problem:
    problem = ocp.Problem("two valleys")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0)
    u = phase.control("u", -2.0, 2.0)
    phase.derivative(x, u)
    problem.minimise(phase.integral((u**2 - 1.0) ** 2 + 0.3 * u))
    return problem


def test_controls_start_again_in_the_lowest_valley_of_the_hamiltonian():
    solution = ocp.solve(two_valleys(), guess=ocp.Guess({"u": 1.0}))
    # The guess lies in the other one, from which no search leads here.
    assert solution.result is ocp.Result.SOLVED
    low = min(np.roots([4.0, 0.0, -4.0, 0.3]))
    assert solution.objective == pytest.approx(
        (low**2 - 1.0) ** 2 + 0.3 * low, rel=1e-8
    )


def test_what_stays_in_the_wrong_valley_is_not_called_solved(monkeypatch):
    monkeypatch.setattr("showc.ocp.refinement.hp.LEAPS", 0)
    options = ocp.Options(points=50)
    solution = ocp.solve(two_valleys(), guess=ocp.Guess({"u": 1.0}), options=options)
    assert solution.result is ocp.Result.COARSE
    assert solution.error.objective > 0.1


def test_a_control_in_a_steep_equation_is_compared_with_what_keeps_it():
    # A capacitor behind a diode, charged by the least energy: at an even current.
    problem = ocp.Problem("diode")
    phase = problem.phase(duration=1.0)
    v = phase.state("v", start=0.0, end=1.0)
    source = phase.control("source", 0.0, 3.0)
    drop = phase.control("drop", -1.0, 1.0)
    current = 1e-4 * (ca.exp(drop / 0.05) - 1.0)
    phase.derivative(v, current)
    phase.constrain(source - drop - v - 0.2 * current, 0.0, 0.0, name="loop")
    problem.minimise(phase.integral(source * current))
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED
    exact = 0.05 * log(1e4 + 1.0) + 0.5 + 0.2
    assert solution.objective == pytest.approx(exact, rel=1e-8)


def test_an_objective_that_a_violation_flattered_may_get_worse():
    # The best line to e^t in the greatest distance (Chebyshev): it touches thrice.
    problem = ocp.Problem("line")
    phase = problem.phase(duration=1.0)
    a, b, off = problem.static("a"), problem.static("b"), problem.static("off", 0.0)
    y = phase.state("y", start=1.0)
    phase.derivative(y, y)
    phase.constrain(y - a - b * phase.time - off, None, 0.0, name="not below")
    phase.constrain(y - a - b * phase.time + off, 0.0, None, name="not above")
    problem.minimise(off)
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED, solution.message
    slope = e - 1.0
    exact = 0.5 * (slope * log(slope) - slope + 1.0)
    assert solution.objective == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(
    ("flattery", "quadrature", "worse"),
    [(2e-2, 0.0, False), (22.0, 0.0, True), (22.0, 4.5, False)],
)
def test_multipliers_without_limit_excuse_no_worse_objective(
    flattery, quadrature, worse
):
    # The ends of a turn repeat that a quaternion keeps its norm.
    problem = ocp.Problem("turn")
    before = SimpleNamespace(objective=29.0, phases=(), blur=0.0, slack=0.0)
    after = SimpleNamespace(objective=29.86)
    errors = SimpleNamespace(dynamics=9e-5, path=0.0)
    former = SimpleNamespace(
        solution=before, error=errors, flattery=flattery, quadrature=quadrature
    )
    assert is_worse(problem, after, former) is worse


def test_a_jump_at_the_bound_of_a_state_is_missed_by_what_is_reported():
    # Sell a stock at the best price, as fast as can be, without arcs placed for it.
    problem = ocp.Problem("sale")
    phase = problem.phase(duration=3.0)
    stock = phase.state("stock", 0.0, 1.0, start=1.0)
    trade = phase.control("trade", -1.0, 1.0)
    phase.derivative(stock, trade)
    price = 4.0 - (phase.time - 1.37) ** 2
    problem.maximise(phase.integral(-trade * price))
    solution = ocp.solve(problem, options=ocp.Options(switches=False, meshes=5))
    exact = 4.0 - 1.0 / 12.0
    for record in solution.history:
        missed = abs(record.objective - exact) / exact
        assert missed < 10.0 * record.error.objective
