"""Built once, solved many times: overrides, guesses, half-spaces, failures."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc import ocp


def rest_to_rest(*, degree: int | None = None) -> ocp.Problem:
    problem = ocp.Problem("rest to rest")
    push = problem.parameter("push", default=1.0)
    phase = problem.phase("flight", duration=(0.1, 50.0))
    x = phase.state("x", -100.0, 100.0, start=0.0, end=1.0)
    v = phase.state("v", -100.0, 100.0, start=0.0, end=0.0)
    u = phase.control("u", -push, push, degree=degree)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration)
    return problem


@pytest.fixture(scope="module")
def built() -> ocp.Transcription:
    return ocp.Transcription(rest_to_rest(degree=1), ocp.Mesh.uniform(8, 3))


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.2, 5.0),
    st.floats(-40.0, 40.0).filter(lambda x: abs(x) > 0.1),
    st.floats(-10.0, 10.0),
)
def test_parameters_and_ends_change_without_building_anew(built, push, way, start):
    solution = built.solve(
        parameters={"push": push},
        overrides=ocp.Overrides(starts={"x": start}, ends={"x": start + way}),
    )
    assert solution.result is ocp.Result.SOLVED
    assert solution.objective == pytest.approx(2.0 * np.sqrt(abs(way) / push), rel=1e-6)
    assert solution.parameters == {"push": push}


@pytest.mark.parametrize("scheme", ["gauss", "radau", "lobatto"])
@pytest.mark.parametrize("degree", [0, 1, None])
def test_every_scheme_and_degree_solves_and_keeps_bounds_everywhere(scheme, degree):
    solution = ocp.Transcription(
        rest_to_rest(degree=degree), ocp.Mesh.uniform(6, 3), scheme=scheme
    ).solve()
    assert solution.objective == pytest.approx(2.0, rel=1e-6)
    # The hull of the coefficients holds all values, so no sampling is needed.
    assert np.abs(solution.phases[0].control("u").coefficients).max() <= 1.0


def test_costate_is_the_derivative_of_the_optimum():
    # Least energy from x0 to 0 in T = 1 with x' = u: J = x0^2 / 2, l(0) = x0.
    problem = ocp.Problem("energy")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.6, end=0.0)
    u = phase.control("u")
    phase.derivative(x, u)
    problem.minimise(phase.integral(0.5 * u**2))
    solution = ocp.Transcription(problem, ocp.Mesh.uniform(3, 3)).solve()
    assert solution.phases[0].costates == pytest.approx(0.6, abs=1e-7)


def test_state_bound_by_interval_and_duration_override(built):
    upper = np.full(8, 100.0)
    upper[3:5] = 0.3
    solution = built.solve(
        overrides=ocp.Overrides(
            bounds={"v": (-100.0, upper)}, durations={"flight": 5.0}
        )
    )
    assert solution.duration == pytest.approx(5.0)
    times = np.linspace(15.0 / 8.0, 25.0 / 8.0, 500)
    assert solution.phases[0].state("v")(times).max() <= 0.3


def test_half_spaces_hold_at_every_instant_and_only_where_given():
    problem = ocp.Problem("two axes")
    phase = problem.phase("flight", duration=4.0)
    axes = [
        phase.state(n, -9.0, 9.0, start=0.0, end=e) for n, e in (("x", 2.0), ("y", 0.0))
    ]
    for name, axis in zip("uw", axes, strict=True):
        control = phase.control(name, -4.0, 4.0, degree=1)
        speed = phase.state(f"speed {name}", -9.0, 9.0, start=0.0, end=0.0)
        phase.derivative(axis, speed)
        phase.derivative(speed, control)
    phase.half_space("wall", axes, rows=2)
    u, w = (phase.controls[n].quantity.symbol for n in "uw")
    problem.minimise(phase.integral(u**2 + w**2))
    built = ocp.Transcription(problem, ocp.Mesh.uniform(8, 4))
    free = built.solve()
    normals = np.zeros((8, 2, 2))
    lower = np.full((8, 2), -np.inf)
    normals[3:5, 0] = [0.6, 0.8]
    lower[3:5, 0] = 1.5
    upper = np.full((8, 2), np.inf)
    walled = built.solve(
        overrides=ocp.Overrides(half_spaces={"wall": (normals, lower, upper)})
    )
    assert free.result.usable and walled.result.usable
    states = walled.phases[0].states
    times = np.linspace(1.5, 2.5, 1000)
    assert (states(times)[:, :2] @ [0.6, 0.8]).min() >= 1.5 - 1e-7
    assert (free.phases[0].states(times)[:, :2] @ [0.6, 0.8]).min() < 1.4
    assert walled.objective > free.objective
    assert built.solve().objective == pytest.approx(free.objective, rel=1e-8)


def test_a_warm_start_from_its_own_answer_takes_few_iterations(built):
    cold = built.solve()
    warm = built.solve(warm=cold.multipliers)
    assert warm.objective == pytest.approx(cold.objective, rel=1e-8)
    assert warm.iterations < cold.iterations


def test_multipliers_carry_over_to_another_mesh():
    problem = rest_to_rest(degree=1)
    coarse = ocp.Transcription(problem, ocp.Mesh.uniform(9, 3))
    fine = ocp.Transcription(problem, ocp.Mesh.uniform(18, 3))
    former = coarse.solve()
    fresh = fine.solve()
    carried = fine.solve(guess=former, former=coarse)
    assert carried.objective == pytest.approx(fresh.objective, rel=1e-6)


def test_an_impossible_problem_names_the_constraint_and_the_place():
    built = ocp.Transcription(rest_to_rest(), ocp.Mesh.uniform(5, 3))
    solution = built.solve(overrides=ocp.Overrides(durations={"flight": 1.0}))
    assert solution.result is ocp.Result.INFEASIBLE
    assert not solution.result.usable
    assert re.search(
        r"dynamics of '[xv]' in phase 'flight' at t = 0\.\d+, by 0\.\d+",
        solution.message,
    )


def test_contradicting_bounds_are_named_before_any_search(built):
    solution = built.solve(overrides=ocp.Overrides(ends={"x": 200.0}))
    assert solution.result is ocp.Result.CONTRADICTION
    assert solution.iterations == 0
    assert "'x' at the end of phase 'flight' is to be at least 200" in solution.message


def test_wrong_names_and_missing_parameters_are_refused():
    problem = rest_to_rest()
    problem.parameter("load")
    built = ocp.Transcription(problem, ocp.Mesh.uniform(2, 3))
    with pytest.raises(ValueError, match="'load' has no value and no default"):
        built.solve()
    with pytest.raises(ValueError, match="of a parameter names 'wind'; there is"):
        built.solve(parameters={"wind": 1.0})
    with pytest.raises(ValueError, match="names 'z'; there is"):
        built.solve(
            parameters={"load": 1.0}, overrides=ocp.Overrides(starts={"z": 1.0})
        )


def test_an_incomplete_problem_is_refused():
    problem = ocp.Problem("half")
    problem.minimise(0.0)
    with pytest.raises(ValueError, match="has no phase"):
        ocp.Transcription(problem, ocp.Mesh(()))
    phase = problem.phase("flight", duration=1.0)
    x = phase.state("x")
    with pytest.raises(ValueError, match="no derivative for state x"):
        ocp.Transcription(problem, ocp.Mesh.uniform(2, 2))
    with pytest.raises(ValueError, match="two quantities named 'x'"):
        phase.control("x")
    with pytest.raises(ValueError, match="is no state or control"):
        phase.derivative(ca.SX.sym("x"), 1.0)
    phase.derivative(x, 1.0)
    with pytest.raises(ValueError, match="mesh for 2 phases"):
        ocp.Transcription(problem, ocp.Mesh.uniform(2, 2, phases=2))


def test_snopt_is_an_option_with_a_clear_message_where_it_is_missing():
    if ca.has_nlpsol("snopt"):
        pytest.skip("a SNOPT library is installed here")
    built = ocp.Transcription(
        rest_to_rest(),
        ocp.Mesh.uniform(2, 2),
        options=ocp.SolverOptions(solver="snopt"),
    )
    with pytest.raises(ocp.SolverMissingError, match="use solver='ipopt'"):
        built.solve()


def test_arcs_place_a_switch_exactly():
    mesh = ocp.PhaseMesh((1.0, 1.0), (3, 3), (0, 1), {"u": (0, 0)})
    solution = ocp.Transcription(rest_to_rest(), ocp.Mesh((mesh,))).solve(
        overrides=ocp.Overrides(ends={"x": 3.0})
    )
    assert solution.phases[0].arc_durations == pytest.approx(np.sqrt(3.0), rel=1e-7)


def test_a_constraint_is_never_tightened_beyond_half_of_its_range():
    """However far a flight was beyond it: else nothing is left between its bounds."""
    problem = ocp.Problem("push")
    phase = problem.phase(duration=(0.1, 10.0))
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -2.0, 2.0)
    phase.derivative(x, v)
    phase.derivative(v, u)
    phase.constrain(1.0 * u, -1.0, 1.0, name="push")
    problem.minimise(phase.duration)
    mesh = ocp.PhaseMesh((0.5, 0.5), (4, 4), path_margins=(7.0, 7.0))
    solution = ocp.Transcription(problem, ocp.Mesh((mesh,))).solve()
    # Half of the push is left: from rest to rest over 1 m in 2 sqrt(1 / 0.5).
    assert solution.phases[0].duration == pytest.approx(2.0 * np.sqrt(2.0), rel=1e-3)


def test_static_unknowns_and_several_phases_linked_by_continuity():
    # Fall from rest through a static depth in two phases; v^2 = 2 g s at the end.
    problem = ocp.Problem("fall")
    s = problem.static("s", 0.1, 10.0)
    phases = [problem.phase(n, duration=(0.1, 5.0)) for n in ("upper", "lower")]
    for phase in phases:
        first = 0.0 if phase is phases[0] else None
        x = phase.state("x", 0.0, 50.0, start=first)
        v = phase.state("v", 0.0, 50.0, start=first)
        phase.derivative(x, v)
        phase.derivative(v, 9.81)
    problem.link(*phases)
    last = phases[1].states
    problem.constrain_boundary(last["x"].final - s, 0.0, 0.0, name="depth")
    problem.constrain_boundary(last["v"].final, 8.0, None, name="fast")
    problem.minimise(s)
    solution = ocp.Transcription(problem, ocp.Mesh.uniform(2, 3, phases=2)).solve()
    assert solution.statics["s"] == pytest.approx(64.0 / 19.62, rel=1e-6)
    upper, lower = solution.phases
    assert lower.start == pytest.approx(upper.end)
    assert lower.states(lower.start) == pytest.approx(upper.states(upper.end), abs=1e-7)
    with pytest.raises(KeyError, match="there is upper, lower"):
        solution.phase("middle")


def test_the_search_does_not_leave_the_domain_of_a_table():
    """Beyond its grid a spline of CasADi is zero: the bound is its end."""
    problem = ocp.Problem("push at the end of a table")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", 0.0, 2.0, start=0.0)
    v = phase.state("v", start=0.0)
    u = phase.control("u", -1.0, 1.0)
    knots = [0.0, 0.5, 1.0, 1.5, 2.0]
    push = ca.interpolant("push", "bspline", [knots], [5.0, 4.0, 3.0, 2.0, 1.0])
    phase.derivative(x, u)
    phase.derivative(v, push(x))
    problem.maximise(phase.final(v))
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED
    assert solution.objective == pytest.approx(5.0, rel=1e-6)
    assert solution.iterations < 40
