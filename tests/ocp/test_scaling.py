"""What is relative stays relative: whatever the unit of the objective and of time."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
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


def in_other_time(problem: ocp.Problem, unit: float) -> ocp.Problem:
    """State the same problem with a time that counts ``unit`` to one before."""
    integrals = []
    for phase in problem.phases:
        phase.duration_bounds = tuple(unit * b for b in phase.duration_bounds)
        phase.start = tuple(unit * b for b in phase.start)
        for name, rate in phase.derivatives.items():
            slower = ca.substitute(rate, phase.time, phase.time / unit)
            phase.derivatives[name] = slower / unit
        integrals += [symbol for symbol, _ in phase.integrals]
        for k, constraint in enumerate(problem.boundary_constraints):
            shorter = phase.duration / unit
            symbol = ca.substitute(constraint.symbol, phase.duration, shorter)
            problem.boundary_constraints[k] = replace(constraint, symbol=symbol)
    for symbol in integrals:
        problem.objective = ca.substitute(problem.objective, symbol, symbol / unit)
    return problem


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
    least = unit * 32.0 ** (1.0 / 3.0)
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
    end = solution.phases[0].states(solution.duration).ravel()
    names = list(solution.phases[0].state_names)
    off = end[names.index("vt")] - 1.0 / np.sqrt(end[names.index("r")])
    assert abs(off) < 1e-7
