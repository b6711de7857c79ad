"""What is relative stays relative: whatever the unit of the objective and of time."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import casadi as ca
import numpy as np
import pytest
from benchmarks.ocp_closed import CLOSED
from benchmarks.ocp_further import orbit_raising, rayleigh, triple_integrator
from benchmarks.ocp_hard import (
    bounce,
    bounce_optimum,
    fuller,
    fuller_optimum,
    heat,
    heat_optimum,
    lotka_fishing,
    scaled_bryson_denham,
    slalom,
    slalom_optimum,
)

from showc import ocp

FACTORS = (1e-8, 1e-4, 1.0, 1e4, 1e8)
KNOWN = {
    "bryson_denham": (scaled_bryson_denham, 4.0),
    "bounce": (bounce, bounce_optimum()),
    "fuller": (fuller, fuller_optimum()),
    "lotka_fishing": (lotka_fishing, 1.34408120),
}
COUNTED_IN_ANOTHER_TIME = {"bd_micro", "bd_mega"}
"""Already stated in another unit."""


def in_other_time(problem: ocp.Problem, unit: float) -> ocp.Problem:
    """State the same problem with a time that counts ``unit`` to one before."""
    for phase in problem.phases:
        phase.duration_bounds = tuple(unit * b for b in phase.duration_bounds)
        phase.start = tuple(unit * b for b in phase.start)

    def slower(expression):
        for phase in problem.phases:
            for time in (phase.time, phase.duration, phase.initial_time):
                expression = ca.substitute(ca.SX(expression), time, time / unit)
        return expression

    for phase in problem.phases:
        for name, rate in phase.derivatives.items():
            phase.derivatives[name] = slower(rate) / unit
        phase.path_constraints[:] = [
            replace(c, symbol=slower(c.symbol)) for c in phase.path_constraints
        ]
        phase.integrals[:] = [(s, slower(e) / unit) for s, e in phase.integrals]
    problem.boundary_constraints[:] = [
        replace(c, symbol=slower(c.symbol)) for c in problem.boundary_constraints
    ]
    problem.objective = slower(problem.objective)
    return problem


def reached(problem: ocp.Problem, optimum: float) -> None:
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(optimum, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("number", range(len(CLOSED)))
def test_closed_forms_are_reached_whatever_the_units(number):
    # One factor of the objective and one unit of time for each problem, in turn.
    name, closed = list(CLOSED.items())[number]
    factor = (1e-8, 1e4, 1e-4, 1e8)[number % 4]
    problem = closed.build()
    problem.objective = factor * ca.SX(problem.objective)
    reached(problem, factor * closed.optimum)
    if name not in COUNTED_IN_ANOTHER_TIME:
        unit = (1e3, 1e-3, 1e6, 1e-6)[number % 4]
        reached(in_other_time(closed.build(), unit), closed.optimum)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("name", KNOWN)
def test_solved_means_the_same_for_an_objective_in_any_unit(name, factor):
    build, optimum = KNOWN[name]
    solution = ocp.solve(build(factor))
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(factor * optimum, rel=1e-6)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("name", KNOWN)
def test_solved_means_the_same_in_any_unit_of_time(name, unit):
    build, optimum = KNOWN[name]
    solution = ocp.solve(in_other_time(build(1.0), unit))
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(optimum, rel=1e-6)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_least_times_are_right_in_any_unit(unit):
    solution = ocp.solve(in_other_time(triple_integrator(), unit))
    assert solution.result is ocp.Result.SOLVED, solution.message
    least = 32.0 ** (1.0 / 3.0)
    assert solution.objective == pytest.approx(least, rel=1e-6)


def test_stiff_dynamics_are_audited_as_they_are():
    solution = ocp.solve(heat())
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(heat_optimum(), rel=1e-6)
    assert solution.error.shooting < 1e-6


def test_what_grows_in_the_dynamics_is_seen_growing():
    # A saddle: errors of a start grow by e^20 on the way, and shooting says so.
    problem = ocp.Problem("saddle")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=1.0, end=1.0)
    u = phase.control("u")
    phase.derivative(x, 20.0 * x + u)
    problem.minimise(phase.integral(x**2 + u**2))
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED
    part = solution.phases[0]
    rate = part.states.derivative()
    times = np.linspace(0.0, 1.0, 1001)
    off = rate(times) - 20.0 * part.states(times) - part.controls(times)
    assert np.abs(off).max() < 1e-3
    assert solution.error.shooting > 10.0 * solution.error.dynamics


def test_ways_round_obstacles_are_arcs_on_which_they_are_touched():
    solution = ocp.solve(slalom())
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(slalom_optimum(), rel=1e-8)
    assert len(solution.history) <= 8
    assert len(solution.history[-1].phases[0].switches) == 6


@pytest.mark.parametrize("factor", [1e-8, 1e8])
def test_a_constraint_in_any_unit_is_kept_as_well(factor):
    problem = rayleigh()
    phase = problem.phases[0]
    mixed = phase.path_constraints[0]
    phase.path_constraints[0] = replace(mixed, symbol=factor * mixed.symbol)
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(44.8044449, rel=1e-6)


@pytest.mark.parametrize("factor", [1e-8, 1e8])
def test_a_boundary_condition_in_any_unit_is_kept_as_well(factor):
    problem = orbit_raising()
    (circular,) = problem.boundary_constraints
    problem.boundary_constraints[0] = replace(circular, symbol=factor * circular.symbol)
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED, solution.message
    # Where the heading is in another valley of the Hamiltonian it is 1.5252589.
    assert solution.objective == pytest.approx(1.5252777006, rel=1e-7)
    end = solution.phases[0].states(solution.duration).ravel()
    names = list(solution.phases[0].state_names)
    off = end[names.index("vt")] - 1.0 / np.sqrt(end[names.index("r")])
    assert abs(off) < 1e-7


def _fall(rate_of_time) -> ocp.Problem:
    problem = ocp.Problem("fall")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=1.0)
    u = phase.control("u")
    phase.derivative(x, rate_of_time(phase.time) * u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


def test_dynamics_that_jump_with_time_are_cut_about_the_jump():
    # The optimum is 1 / 2 over the integral of the squared rate.
    solution = ocp.solve(_fall(lambda t: ca.if_else(t < 0.3, 1.0, 2.0)))
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(0.5 / (0.3 + 0.7 * 4.0), rel=1e-9)
    intervals = solution.history[0].phases[0].intervals
    assert any("the rates jump" in i.decision.reason for i in intervals)
    assert len(solution.history) <= 4


def test_a_ramp_narrower_than_the_points_is_not_stepped_over():
    table = ca.interpolant("f", "linear", [[0.0, 0.3, 0.31, 1.0]], [1.0, 1.0, 2.0, 2.0])
    solution = ocp.solve(_fall(table))
    square = 0.3 + 0.01 * 7.0 / 3.0 + 0.69 * 4.0
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(0.5 / square, rel=1e-6)


def test_a_linear_equation_for_an_unbounded_control_is_kept_between_the_points():
    problem = ocp.Problem("algebraic")
    phase = problem.phase(duration=5.0)
    x = phase.state("x", start=1.0)
    u, y = phase.control("u"), phase.control("y")
    phase.derivative(x, y)
    phase.constrain(y + x - u, 0.0, 0.0, name="balance")
    problem.minimise(phase.integral(x**2 + u**2))
    solution = ocp.solve(problem)
    root = np.sqrt(2.0)
    # Riccati's equation p' = 2 p + p² - 1 from p(5) = 0, in closed form.
    growth = np.exp(10.0 * root)
    optimum = (growth - 1.0) / ((root + 1.0) * growth + root - 1.0)
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(optimum, rel=1e-8)


def test_a_start_at_which_all_slopes_vanish_is_left():
    problem = ocp.Problem("string")
    phase = problem.phase(duration=1.0)
    y = phase.state("y", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(y, u)
    problem.constrain_boundary(phase.integral(y**2), 1.0, 1.0)
    problem.minimise(phase.integral(u**2))
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(np.pi**2, rel=1e-8)


def test_what_has_no_slope_at_the_start_is_named():
    problem = ocp.Problem("length")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=1.0)
    y = phase.state("y", start=0.0, end=1.0)
    a, b = phase.control("a"), phase.control("b")
    phase.derivative(x, a)
    phase.derivative(y, b)
    problem.minimise(phase.integral(ca.sqrt(a**2 + b**2)))
    first = ocp.Transcription(problem, ocp.Mesh.uniform(3, 3)).solve()
    assert first.result is ocp.Result.INVALID_NUMBER
    assert "no curvature with respect to 'a' of phase 'phase'" in first.message
    assert "give a guess elsewhere" in first.message


@pytest.mark.parametrize("unit", [1e-5, 1.0, 1e5])
def test_a_constraint_of_states_without_bounds_is_kept_in_any_unit(unit):
    problem = ocp.Problem("string over a hill")
    phase = problem.phase(duration=3.0)
    height = phase.state("height", start=0.0, end=0.0)
    slope = phase.control("slope")
    phase.derivative(height, slope / unit)
    hill = 1.0 - (phase.time - 1.5) ** 2
    phase.constrain(unit * height - hill, 0.0, None, name="hill")
    problem.minimise(phase.integral(slope**2))
    solution = ocp.solve(problem)
    # Tangents from both ends, and the hill between them.
    leaves = sqrt(1.25)
    exact = 2.0 * (3.0 - 2.0 * leaves) ** 2 * leaves + 8.0 / 3.0 * (1.5 - leaves) ** 3
    assert solution.result is ocp.Result.SOLVED
    assert solution.objective == pytest.approx(exact, rel=1e-6)
