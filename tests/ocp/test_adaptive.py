"""Known optima with default settings, and what the core says of its own errors."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from benchmarks.ocp_collected import (
    dielectrophoretic_particle,
    least_time_van_der_pol,
    robbins,
)
from benchmarks.ocp_further import FURTHER
from benchmarks.ocp_hard import f8, lee_ramirez, slalom, slalom_optimum
from benchmarks.ocp_problems import BENCHMARKS, double_integrator_vmax, robot_arm
from benchmarks.ocp_textbook import TEXTBOOK

from showc import ocp

ALL = {benchmark.name: benchmark for benchmark in (*BENCHMARKS, *FURTHER, *TEXTBOOK)}
HARD = {"hypersensitive_1e6"}
"""Known to end on a mesh that is too coarse, and to say so."""
ANALYTIC = [b.name for b in ALL.values() if b.digits < 1e-9 and b.name not in HARD]
PUBLISHED = [b.name for b in TEXTBOOK if b.digits >= 1e-9 and b.name not in HARD]


@pytest.fixture(scope="module")
def solved():
    """Solutions by name of the benchmark, each solved once."""
    found: dict[str, ocp.Solution] = {}

    def solve(name: str) -> ocp.Solution:
        if name not in found:
            found[name] = ocp.solve(ALL[name].build())
        return found[name]

    return solve


@pytest.mark.parametrize("name", ANALYTIC)
def test_objective_is_right_to_one_millionth(solved, name):
    solution, benchmark = solved(name), ALL[name]
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(benchmark.optimum, rel=1e-6)


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_optima_are_reached_to_their_digits(solved, name):
    solution, benchmark = solved(name), ALL[name]
    assert solution.result is ocp.Result.SOLVED, solution.message
    allowed = max(1e-6, benchmark.digits)
    assert solution.objective == pytest.approx(benchmark.optimum, rel=allowed)


@pytest.mark.parametrize("name", sorted(HARD))
def test_a_mesh_that_stays_too_coarse_is_called_so(solved, name):
    solution = solved(name)
    assert solution.result is ocp.Result.COARSE
    assert "wanted 1e-06" in solution.message
    assert solution.error.objective > 0.1


@pytest.mark.parametrize("name", ANALYTIC)
def test_reported_error_is_within_a_factor_of_ten_of_the_true_one(solved, name):
    solution, benchmark = solved(name), ALL[name]
    true = abs(solution.objective - benchmark.optimum) / abs(benchmark.optimum)
    reported = max(solution.error.objective, solution.error.dynamics)
    # Errors far below the tolerance are those of the nonlinear program.
    assert true <= max(10.0 * reported, 1e-7)


@pytest.mark.parametrize("name", ANALYTIC)
def test_bounds_hold_on_a_fine_grid(solved, name):
    solution = solved(name)
    problem = ALL[name].build()
    for phase, part in zip(problem.phases, solution.phases, strict=True):
        times = np.linspace(part.start, part.end, 20_001)
        for curve, table in (
            (part.states(times), phase.states),
            (part.controls(times), phase.controls),
        ):
            for column, member in zip(curve.T, table.values(), strict=True):
                lower = float(member.quantity.lower)
                upper = float(member.quantity.upper)
                span = upper - lower if np.isfinite(upper - lower) else 1.0
                assert column.min() >= lower - 1e-9 * span
                assert column.max() <= upper + 1e-9 * span


@pytest.mark.parametrize("name", ["robot_arm", "double_integrator_vmax", "goddard"])
def test_clipped_controls_flown_open_loop_reproduce_the_states(solved, name):
    """An integration of this test's own, from the first instant to the last."""
    solution = solved(name)
    problem = ALL[name].build()
    phase, part = problem.phases[0], solution.phases[0]
    x = ca.vertcat(*[s.quantity.symbol for s in phase.states.values()])
    u = ca.vertcat(*[c.quantity.symbol for c in phase.controls.values()])
    f = ca.Function("f", [x, u], [ca.vertcat(*phase.derivatives.values())])
    low = np.array([float(c.quantity.lower) for c in phase.controls.values()])
    high = np.array([float(c.quantity.upper) for c in phase.controls.values()])
    state = part.states.coefficients[0, 0]
    for k in range(part.controls.intervals):
        piece = part.controls.coefficients[k]
        left, right = part.controls.breaks[k : k + 2]
        steps = 200
        h = (right - left) / steps

        def rate(s, at, piece=piece):
            basis = np.array(
                [
                    ca_binomial(piece.shape[0] - 1, j)
                    * s**j
                    * (1 - s) ** (piece.shape[0] - 1 - j)
                    for j in range(piece.shape[0])
                ]
            )
            return np.asarray(f(at, np.clip(basis @ piece, low, high))).ravel()

        for i in range(steps):
            s, d = i / steps, 1.0 / steps
            k1 = rate(s, state)
            k2 = rate(s + d / 2, state + h / 2 * k1)
            k3 = rate(s + d / 2, state + h / 2 * k2)
            k4 = rate(s + d, state + h * k3)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    span = np.ptp(part.states.coefficients, axis=(0, 1))
    assert np.abs(state - part.states.coefficients[-1, -1]) / span == pytest.approx(
        0.0, abs=1e-6
    )


def ca_binomial(n: int, k: int) -> float:
    from math import comb

    return float(comb(n, k))


def test_switch_times_of_the_robot_arm_are_placed_to_eight_digits(solved):
    solution = solved("robot_arm")
    t = 9.140911745914961
    borders = np.cumsum(solution.phases[0].arc_durations)[:-1]
    known = [t / 4, 2.7960432, t / 2, t - 2.7960432, 3 * t / 4]
    assert borders == pytest.approx(known, abs=2e-6)
    assert solution.objective == pytest.approx(t, rel=1e-8)
    assert len(solution.history) <= 4


def test_hypersensitive_needs_few_meshes_and_points(solved):
    solution = solved("hypersensitive")
    assert len(solution.history) <= 8
    assert solution.mesh.point_count < 400


@pytest.mark.parametrize(
    ("name", "rel"),
    [
        ("catalyst_mixing", 2e-6),
        ("shuttle_reentry", 1e-6),
        ("van_der_pol", 1e-6),
        ("rayleigh", 1e-6),
        ("tumour", 1e-6),
        ("free_flying_robot", 1e-5),
        ("hang_glider", 1e-6),
    ],
)
def test_published_optima(solved, name, rel):
    """To the digits in print; two of them are known better here than there."""
    solution = solved(name)
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(ALL[name].optimum, rel=rel)


def test_two_linked_phases_each_with_its_switch(solved):
    # Out to 1 and past it: accelerate, turn round, and stop at -1.
    assert solved("waypoint").objective == pytest.approx(2.0 + 2.0 * 2.0**0.5, rel=1e-7)


@pytest.mark.slow
def test_a_launch_in_four_phases_without_a_guess(solved):
    solution = solved("launch")
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(7529.712, rel=1e-6)
    first, second = solution.phases[:2]
    assert second.start == pytest.approx(first.end, abs=1e-6)


def test_path_constraints_hold_between_the_nodes():
    problem = ocp.Problem("two axes past a disc")
    phase = problem.phase(duration=2.0)
    x = phase.state("x", start=-1.0, end=1.0)
    y = phase.state("y", start=0.1, end=0.1)
    u, w = phase.control("u"), phase.control("w")
    phase.derivative(x, u)
    phase.derivative(y, w)
    phase.constrain(x**2 + y**2, 0.25, None, name="disc")
    problem.minimise(phase.integral(u**2 + w**2))
    guess = ocp.Guess(curves={"y": np.array([0.1, 0.8, 0.1])})
    solution = ocp.solve(problem, guess=guess)
    assert solution.result is ocp.Result.SOLVED, solution.message
    part = solution.phases[0]
    position = part.states(np.linspace(0.0, 2.0, 20_001))
    assert (position**2).sum(axis=1).min() >= 0.25 * (1.0 - 2e-6)
    # Shortest way: two tangents and an arc of the circle of radius 1/2.
    r, d = 0.5, np.hypot(1.0, 0.1)
    straight = np.sqrt(d**2 - r**2)
    arc = np.pi - 2.0 * np.arctan(0.1) - 2.0 * np.arccos(r / d)
    length = 2.0 * straight + r * arc
    assert solution.objective == pytest.approx(length**2 / 2.0, rel=1e-5)


def test_without_switch_times_the_mesh_closes_in_on_the_switch():
    options = ocp.Options(switches=False, tolerance=1e-4)
    solution = ocp.solve(double_integrator_vmax(), options=options)
    assert solution.objective == pytest.approx(7.0, rel=1e-4)
    assert solution.mesh.phases[0].arc_count == 1
    widths = np.diff(solution.phases[0].states.breaks)
    assert widths.min() < 0.5 * widths.max()


def test_too_few_meshes_is_told_with_the_error_reached():
    solution = ocp.solve(robot_arm(), options=ocp.Options(meshes=1))
    assert solution.result is ocp.Result.COARSE
    assert "wanted 1e-06" in solution.message
    assert solution.error.objective > 1e-4


def test_an_infeasible_problem_says_which_constraint_and_where():
    problem = ocp.Problem("too far")
    phase = problem.phase("flight", duration=1.0)
    x = phase.state("x", start=0.0, end=10.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, u)
    problem.minimise(phase.integral(u**2))
    solution = ocp.solve(problem)
    assert not solution.result.usable
    assert "'x' in phase 'flight' at t = " in solution.message


def test_the_same_problem_gives_the_same_bits():
    first, second = (ocp.solve(ALL["goddard"].build()) for _ in range(2))
    assert first.objective == second.objective
    a, b = first.phases[0], second.phases[0]
    assert np.array_equal(a.states.coefficients, b.states.coefficients)
    assert np.array_equal(a.controls.breaks, b.controls.breaks)


def test_history_tells_every_mesh_and_reports_progress():
    seen = []
    solution = ocp.solve(
        ALL["goddard"].build(), options=ocp.Options(progress=seen.append)
    )
    assert tuple(seen) == solution.history
    assert any("switch times placed" in record.action for record in seen)
    assert seen[-1].action == "tolerance reached"
    assert seen[-1].error.dynamics <= 1e-6


def test_unknown_constants_without_any_control():
    problem = ocp.Problem("growth")
    k = problem.static("k", 0.0, 5.0)
    phase = problem.phase(duration=2.0)
    x = phase.state("x", start=1.0, end=2.0)
    phase.derivative(x, k * x)
    problem.minimise(k**2)
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.statics["k"] == pytest.approx(np.log(2.0) / 2.0, rel=1e-7)


def test_integrals_inside_functions_and_constraints():
    problem = ocp.Problem("root of an integral")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=1.0)
    u = phase.control("u")
    phase.derivative(x, u)
    problem.minimise(ca.sqrt(phase.integral(u**2)))
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(1.0, rel=1e-6)


def test_greatest_area_under_a_rope_of_given_length():
    problem = ocp.Problem("Dido")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, u)
    length = phase.integral(ca.sqrt(1.0 + u**2))
    problem.constrain_boundary(length, 1.2, 1.2, name="length")
    problem.maximise(phase.integral(x))
    solution = ocp.solve(problem)
    # A circular arc of angle 2a over the chord 1: a / sin a = 1.2.
    a = 1.0
    for _ in range(50):
        a -= (a - 1.2 * np.sin(a)) / (1.0 - 1.2 * np.cos(a))
    r = 0.6 / a
    assert solution.objective == pytest.approx(
        r**2 * (a - np.sin(a) * np.cos(a)), rel=1e-6
    )


@pytest.mark.parametrize("scheme", ["radau", "lobatto"])
def test_the_other_points_give_the_same_answer(scheme):
    options = ocp.Options(scheme=scheme)
    solution = ocp.solve(ALL["robot_arm"].build(), options=options)
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(9.140911745914961, rel=1e-6)


@pytest.mark.parametrize(("way", "push"), [(3e-7, 1e-3), (300.0, 1.0), (4e8, 10.0)])
def test_units_do_not_matter_and_durations_need_no_bounds(way, push):
    problem = ocp.Problem("scales")
    phase = problem.phase()
    x = phase.state("x", start=0.0, end=way)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -push, push)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration)
    solution = ocp.solve(problem)
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(2.0 * (way / push) ** 0.5, rel=1e-6)


def test_error_on_a_state_limit_is_not_that_of_oscillating_costates(solved):
    """Costates between a limit's border and its end are not determined one by one."""
    solution = solved("double_integrator_vmax")
    true = abs(solution.objective - 7.0) / 7.0
    assert solution.error.objective < 10.0 * max(true, 1e-9)
    assert len(solution.history) <= 3


def test_multipliers_of_held_controls_do_not_count_as_errors(solved):
    solution = solved("free_flying_robot")
    assert solution.result is ocp.Result.SOLVED
    assert len(solution.history) <= 6
    # What the solver leaves open counts as error, and is mended on the same mesh.
    assert solution.slack < 1e-7 * abs(solution.objective)


def test_a_symmetric_start_does_not_end_in_a_symmetric_trap(solved):
    solution = solved("reorientation")
    assert "stayed at its guess" in solution.history[0].action
    assert solution.history[0].objective > 34.0
    assert solution.objective == pytest.approx(28.6304077, rel=1e-6)


def test_effort_ends_the_refinement():
    problem = robot_arm()
    solution = ocp.solve(problem, options=ocp.Options(effort=0.0))
    assert solution.result is ocp.Result.COARSE
    assert len(solution.history) == 1
    assert solution.history[0].action == "stopped"
    with pytest.raises(StopIteration):
        ocp.solve(problem, options=ocp.Options(progress=_stop))


def _stop(_: ocp.MeshRecord) -> None:
    raise StopIteration


def test_several_starts_find_and_report_several_optima():
    # Two valleys: past the obstacle on the near side, or on the far one.
    problem = ocp.Problem("two ways")
    phase = problem.phase(duration=1.0)
    y = phase.state("y", -3.0, 3.0, start=0.0, end=0.0)
    u = phase.control("u", -20.0, 20.0)
    phase.derivative(y, u)
    wall = ca.exp(-((phase.time - 0.5) ** 2) / 0.02)
    phase.constrain((y - 0.3) ** 2 - wall, 0.0, None, name="wall")
    problem.minimise(phase.integral(u**2))
    one = ocp.solve(problem, options=ocp.Options(tolerance=1e-4))
    many = ocp.solve(problem, options=ocp.Options(tolerance=1e-4, starts=5, jobs=2))
    again = ocp.solve(problem, options=ocp.Options(tolerance=1e-4, starts=5))
    assert len(many.optima) >= 2
    objectives = [found.objective for found in many.optima]
    assert objectives == sorted(objectives)
    assert many.objective == objectives[0] <= one.objective * (1.0 + 1e-4)
    assert sorted(k for found in many.optima for k in found.starts) == list(range(5))
    assert many.optima == again.optima


def test_starts_that_can_be_flown_find_an_optimum_that_others_miss():
    """Garrard, Jordan 1977; Sager 2012 has 3.78086 as the best of several optima."""
    solution = ocp.solve(f8(), options=ocp.Options(starts=10))
    assert solution.result is ocp.Result.SOLVED
    assert solution.objective == pytest.approx(3.78086, rel=1e-5)
    found = [optimum.objective for optimum in solution.optima]
    assert found == pytest.approx([3.78086, 5.72865], rel=1e-5)


def test_the_better_way_between_discs_is_found_by_several_starts():
    solution = ocp.solve(slalom(), options=ocp.Options(starts=5))
    assert solution.result is ocp.Result.SOLVED
    assert solution.objective == pytest.approx(10.341634, rel=1e-6)
    assert solution.optima[-1].objective == pytest.approx(slalom_optimum(), rel=1e-6)


def test_singular_controls_of_little_effect_do_not_oscillate():
    """Tholudur, Ramirez 1997; both controls are singular for half of the time."""
    solution = ocp.solve(lee_ramirez())
    assert solution.result is ocp.Result.SOLVED, solution.message
    assert solution.objective == pytest.approx(6.151601, rel=1e-6)
    controls = solution.phases[0].controls
    settled = controls(np.linspace(5.5, 8.0, 400))
    assert np.abs(np.diff(settled, n=2, axis=0)).max() < 2e-3


def test_an_optimum_that_hangs_on_exact_ends_reports_its_error(solved):
    # Its costates grow without end: they are no measure of what the objective is worth.
    solution = solved("oscillator")
    off = abs(solution.objective / ALL["oscillator"].optimum - 1.0)
    assert 10.0 * solution.error.objective >= off
    assert off < 1e-6


def test_sensitivities_are_the_slopes_of_the_optimum():
    """A cart over a distance d with push up to p takes 2 sqrt(d / p)."""
    problem = ocp.Problem("cart")
    distance = problem.parameter("distance", 2.0)
    push = problem.parameter("push", 0.5)
    phase = problem.phase(duration=(0.1, 50.0))
    x = phase.state("x", start=0.0, end=distance)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -push, push)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration)
    least = ocp.solve(problem)
    assert least.objective == pytest.approx(4.0, rel=1e-6)
    assert least.sensitivities["distance"] == pytest.approx(1.0, rel=1e-5)
    assert least.sensitivities["push"] == pytest.approx(-4.0, rel=1e-5)


def test_sensitivities_count_limits_on_states_and_the_sense_of_the_objective():
    """Bryson, Denham 1963: the least effort is 4 / (9 l) while l <= 1 / 6."""
    problem = ocp.Problem("wall")
    limit = problem.parameter("limit", 1.0 / 9.0)
    price = problem.parameter("price", 1.0)
    phase = problem.phase(duration=1.0)
    x = phase.state("x", None, limit, start=0.0, end=0.0)
    v = phase.state("v", start=1.0, end=-1.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.maximise(-price * phase.integral(0.5 * u**2))
    most = ocp.solve(problem)
    assert most.objective == pytest.approx(-4.0, rel=1e-6)
    assert most.sensitivities["limit"] == pytest.approx(36.0, rel=1e-4)
    assert most.sensitivities["price"] == pytest.approx(-4.0, rel=1e-6)


@pytest.mark.parametrize(
    ("build", "least"),
    [(least_time_van_der_pol, 3.3472551), (dielectrophoretic_particle, 7.8113113)],
)
def test_a_duration_that_shrinks_to_nothing_is_started_from_little_effort(build, least):
    solution = ocp.solve(build())
    assert solution.result is ocp.Result.SOLVED
    assert solution.objective == pytest.approx(least, rel=1e-6)
    assert "least effort" in solution.history[0].action


def test_layers_at_the_start_are_found_by_flying_the_guess():
    """Robertson's kinetics with a controlled temperature: stiff, rates 1e7 apart."""
    problem = ocp.Problem("kinetics")
    phase = problem.phase(duration=1.0)
    a = phase.state("a", 0.0, None, start=1.0)
    b = phase.state("b", 0.0, None, start=0.0, scale=1e-4)
    c = phase.state("c", 0.0, None, start=0.0)
    heat = phase.control("heat", 0.5, 2.0)
    burn, back, use = 0.04 * heat * a, 1e4 * b * c, 3e7 * b * b
    phase.derivative(a, back - burn)
    phase.derivative(b, burn - back - use)
    phase.derivative(c, use)
    problem.minimise(phase.integral(0.01 * (heat - 1.0) ** 2) - phase.final(c))
    solution = ocp.solve(problem, options=ocp.Options(meshes=1))
    assert solution.result.usable
    assert any("controls fly" in record.action for record in solution.history)


def test_what_was_not_refined_is_not_taken_for_settled():
    # The optimum is that of a solve to 1e-9, of which two ways agree to 1e-8.
    solution = ocp.solve(robbins())
    off = abs(solution.objective / 19.4317814 - 1.0)
    assert off < 1e-6
    assert 0.1 * off < solution.error.objective


def test_a_tank_that_half_the_feed_overfills_is_started_from_the_least_feed():
    problem = ocp.Problem("fed batch")
    phase = problem.phase(duration=20.0)
    cells = phase.state("cells", 0.0, None, start=1.0)
    sugar = phase.state("sugar", 0.0, None, start=10.0)
    volume = phase.state("volume", 1.0, 5.0, start=1.0)
    feed = phase.control("feed", 0.0, 1.0)
    growth = 0.4 * sugar / (0.1 + sugar + sugar**2 / 20.0) * cells
    phase.derivative(cells, growth - feed / volume * cells)
    phase.derivative(sugar, -2.0 * growth + feed / volume * (20.0 - sugar))
    phase.derivative(volume, feed)
    problem.maximise(phase.final(cells) * phase.final(volume))
    solution = ocp.solve(problem, options=ocp.Options(meshes=2))
    assert solution.result.usable
    # All sugar that there is and that the tank has room for becomes cells.
    assert solution.objective == pytest.approx(
        1.0 + 0.5 * (10.0 + 4.0 * 20.0), rel=1e-5
    )
