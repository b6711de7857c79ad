"""Graded meshes with linear controls: near the optimum, flyable, and quick."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest
from benchmarks import quadrotor
from benchmarks.audit import report
from benchmarks.ocp_further import FURTHER
from benchmarks.peers.showc import answer, build

from showc import ocp
from showc.ocp.refinement.graded import enough_points, graded_breaks, variation

FLYABLE = ocp.Options.graded()


def double_integrator(top: float | None = None) -> ocp.Problem:
    """Ten metres rest to rest with |u| <= 1: 2 sqrt(10) s, or 10 / top + top."""
    problem = ocp.Problem("double integrator")
    phase = problem.phase(duration=(0.1, 50.0))
    x = phase.state("x", start=0.0, end=10.0)
    v = phase.state("v", None, top, start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration)
    return problem


def on_one_mesh(intervals: int) -> ocp.PhaseSolution:
    grading = ocp.Grading(intervals=(intervals,))
    options = ocp.Options.graded(grading=grading)
    return ocp.solve(double_integrator(), options=options).phases[0]


@pytest.mark.parametrize(("top", "least"), [(None, 2.0 * sqrt(10.0)), (2.0, 7.0)])
def test_bang_bang_and_state_constrained_are_near_the_closed_form(top, least):
    solution = ocp.solve(double_integrator(top), options=FLYABLE)
    assert solution.result is ocp.Result.SOLVED
    assert 1.0 - 1e-6 < solution.objective / least < 1.0 + 3e-4
    low, high = solution.phases[0].controls.bounds()
    assert low[0] >= -1.0 and high[0] <= 1.0
    if top is not None:
        assert solution.phases[0].states.bounds()[1][1] <= top


def test_quadrotor_as_printed_in_least_time():
    # Fine meshes of several solvers agree on 6.6665 s +- 0.001 s, with controls that
    # leave their bounds between the nodes; these do not.
    problem = quadrotor.one()
    solution = ocp.solve(build(problem), options=FLYABLE)
    assert solution.result is ocp.Result.SOLVED
    assert 6.6655 < solution.objective < 6.670
    figures = report(problem, answer(solution))
    assert figures["bound_violation"] == 0.0
    assert figures["position_error"] < 1e-3
    assert solution.error.shooting < 2e-5
    counts = [record.intervals for record in solution.history]
    assert counts == sorted(counts) and counts[0] < counts[-1]


def test_path_constraints_hold_between_the_points():
    problem = double_integrator()
    phase = problem.phases[0]
    speed = phase.states["v"].quantity.symbol
    place = phase.states["x"].quantity.symbol
    # A speed limit that falls and rises again on the way.
    limit = 1.5 + 0.02 * (place - 5.0) ** 2
    phase.constrain(speed - limit, None, 0.0, name="limit", scale=1.0)
    solution = ocp.solve(problem, options=FLYABLE)
    assert solution.result is ocp.Result.SOLVED
    part = solution.phases[0]
    times = np.linspace(part.start, part.end, 20_001)
    x, v = part.states(times).T
    assert np.max(v - 1.5 - 0.02 * (x - 5.0) ** 2) < 2e-5
    assert v.max() > 1.5


def test_equations_on_the_way_are_not_tightened():
    problem = double_integrator()
    phase = problem.phases[0]
    push = phase.control("push", -0.5, 0.5)
    phase.constrain(
        phase.controls["u"].quantity.symbol - push, 0.0, 0.0, name="same", scale=1.0
    )
    solution = ocp.solve(problem, options=FLYABLE)
    assert solution.result is ocp.Result.SOLVED
    assert solution.objective == pytest.approx(2.0 * sqrt(20.0), rel=3e-4)
    u, push = solution.phases[0].controls.coefficients.transpose(2, 0, 1)
    assert np.abs(u - push).max() < 1e-6


def test_another_first_mesh_is_tried_where_the_solver_fails():
    oscillator = next(b for b in FURTHER if b.name == "oscillator")
    solution = ocp.solve(oscillator.build(), options=FLYABLE)
    assert solution.result is ocp.Result.SOLVED
    assert not solution.history[0].result.usable
    assert solution.objective == pytest.approx(oscillator.optimum, rel=2e-3)


def test_contradicting_bounds_are_said_before_any_search():
    problem = double_integrator()
    solution = ocp.solve(
        problem, overrides=ocp.Overrides(bounds={"u": (1, -1)}), options=FLYABLE
    )
    assert solution.result is ocp.Result.CONTRADICTION


def test_several_phases_share_the_intervals():
    problem = ocp.Problem("two legs")
    legs = []
    for name, start, end in (("out", 0.0, 4.0), ("back", 4.0, 0.0)):
        phase = problem.phase(name, duration=(0.1, 50.0))
        x = phase.state("x", start=start, end=end)
        v = phase.state("v", start=0.0, end=0.0)
        u = phase.control("u", -1.0, 1.0)
        phase.derivative(x, v)
        phase.derivative(v, u)
        legs.append(phase)
    problem.link(*legs)
    problem.minimise(legs[0].duration + legs[1].duration)
    solution = ocp.solve(problem, options=FLYABLE)
    assert solution.objective == pytest.approx(8.0, rel=1e-3)
    assert solution.phases[0].mesh.intervals == solution.phases[1].mesh.intervals


def test_borders_gather_where_the_gap_is_and_ends_stay():
    part = ocp.solve(
        double_integrator(),
        options=ocp.Options.graded(grading=ocp.Grading(intervals=(10,))),
    ).phases[0]
    gap = np.zeros(10)
    gap[4] = 1.0
    breaks = graded_breaks(part, gap, np.array([2.0]), 30)
    assert breaks[0] == part.start and breaks[-1] == part.end
    widths = np.diff(breaks)
    assert widths.min() > 0.0
    left, right = part.states.breaks[4:6]
    assert 0.5 * (left + right) == pytest.approx(breaks[np.argmin(widths)], abs=1.0)
    assert widths.max() / widths.min() > 3.0
    even = graded_breaks(part, np.full(10, np.nan), np.array([2.0]), 30)
    assert np.all(np.isfinite(even))


def test_variation_counts_jumps_and_ramps_once():
    part = ocp.solve(
        double_integrator(),
        options=ocp.Options.graded(grading=ocp.Grading(intervals=(11,))),
    ).phases[0]
    total = variation(part, np.array([2.0])).sum()
    assert total == pytest.approx(1.0, abs=0.05)  # from one bound to the other


def test_wider_intervals_get_more_points():
    part = ocp.solve(
        double_integrator(),
        options=ocp.Options.graded(grading=ocp.Grading(intervals=(10,))),
    ).phases[0]
    breaks = np.concatenate([[part.start], np.linspace(0.5 * part.end, part.end, 20)])
    points = enough_points(part, np.full(10, 1e-5), breaks, accuracy=2e-5, least=3)
    assert points[0] == 4 and np.all(points[1:] == 3)
