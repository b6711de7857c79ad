"""What points step over, or begin at, is found: optima known in closed form."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

from showc import ocp

SOLVED = ocp.Result.SOLVED


def pushed(cost, *, start=0.0, end=1.0, duration=1.0, bounds=(None, None)):
    """Return the least integral of a cost of a state, its rate and time."""
    problem = ocp.Problem("push")
    phase = problem.phase(duration=duration)
    x = phase.state("x", *bounds, start=start, end=end)
    u = phase.control("u")
    phase.derivative(x, u)
    problem.minimise(phase.integral(cost(x, u, phase.time)))
    return problem


def over_a_hill(place, width, order):
    """Return how a point gets over a narrow hill with the least effort."""
    problem = ocp.Problem("hill")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=0.0)
    rate = x
    for _ in range(order - 1):
        rate = phase.state("v", start=0.0, end=0.0)
        phase.derivative(x, rate)
    u = phase.control("u")
    phase.derivative(rate, u)
    hill = 0.5 * ca.exp(-(((phase.time - place) / width) ** 2))
    phase.constrain(x - hill, 0.0, None, name="hill")
    problem.minimise(phase.integral(u**2))
    return problem


def hill_height(time, place, width):
    return 0.5 * np.exp(-(((time - place) / width) ** 2))


def least_over_a_hill(place, width, order):
    """Tangents to the hill and the arc between them; or a spline that touches it."""
    if order == 2:
        found = minimize_scalar(
            lambda t: -3.0 * hill_height(t, place, width) ** 2 / (t * (1.0 - t)) ** 3,
            bounds=(place - width, place + width),
            method="bounded",
            options={"xatol": 1e-13},
        )
        return -found.fun

    def slope(t):
        return -2.0 * (t - place) / width**2 * hill_height(t, place, width)

    left = brentq(
        lambda t: hill_height(t, place, width) - slope(t) * t,
        place - 0.7 * width,
        place,
        xtol=1e-15,
    )
    right = brentq(
        lambda t: hill_height(t, place, width) + slope(t) * (1.0 - t),
        place,
        place + 0.7 * width,
        xtol=1e-15,
    )
    arc, _ = quad(lambda t: slope(t) ** 2, left, right, epsabs=0.0, epsrel=1e-13)
    return slope(left) ** 2 * left + arc + slope(right) ** 2 * (1.0 - right)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("place", "width"), [(0.31, 0.012), (0.44, 0.05), (0.6152, 0.02), (0.72, 0.03)]
)
def test_a_path_constraint_that_is_touched_within_an_interval(place, width, order):
    solution = ocp.solve(over_a_hill(place, width, order))
    assert solution.result is SOLVED, solution.message
    least = least_over_a_hill(place, width, order)
    assert solution.objective == pytest.approx(least, rel=1e-6)


def test_an_integrand_that_the_first_points_misjudge():
    tracked = pushed(
        lambda x, u, t: (x - ca.sin(200.0 * t)) ** 2 + 1e-4 * u**2, end=None
    )
    fine = ocp.Options(mesh=ocp.Mesh.uniform(200, 5))
    solution, sure = ocp.solve(tracked), ocp.solve(tracked, options=fine)
    assert solution.result is sure.result is SOLVED
    assert solution.objective == pytest.approx(sure.objective, rel=1e-6)


@pytest.mark.parametrize("duration", [500.0, 10_000.0])
def test_layers_at_both_ends_of_a_long_time(duration):
    problem = pushed(lambda x, u, _: x**2 + u**2, start=1.5, end=1.0, duration=duration)
    solution = ocp.solve(problem)
    assert solution.result is SOLVED, solution.message
    assert solution.objective == pytest.approx(3.25, rel=1e-6)


def test_a_price_between_the_points_is_paid():
    width = 3e-3

    def price(t):
        return 1.0 + 50.0 * np.exp(-(((t - 0.537) / width) ** 2))

    problem = pushed(
        lambda _, u, t: (1.0 + 50.0 * ca.exp(-(((t - 0.537) / width) ** 2))) * u**2
    )
    solution = ocp.solve(problem)
    assert solution.result is SOLVED, solution.message
    # Euler and Lagrange: the price times the rate does not change.
    area, _ = quad(lambda t: 1.0 / price(t), 0.0, 1.0, points=[0.537], limit=200)
    assert solution.objective == pytest.approx(1.0 / area, rel=1e-6)


def test_slow_ground_between_the_points_is_crossed():
    problem = ocp.Problem("mud")
    phase = problem.phase(duration=(0.1, 9.0))
    x = phase.state("x", start=0.0, end=1.0)
    u = phase.control("u", 0.0, 1.0)
    mud = ca.exp(-(((x - 0.3711) / 1e-3) ** 2))
    phase.derivative(x, u * (1.0 - 0.9 * mud))
    problem.minimise(phase.duration)
    solution = ocp.solve(problem)
    assert solution.result is SOLVED, solution.message
    time, _ = quad(
        lambda s: 1.0 / (1.0 - 0.9 * np.exp(-(((s - 0.3711) / 1e-3) ** 2))),
        0.0,
        1.0,
        points=[0.36, 0.3711, 0.382],
        epsabs=1e-13,
    )
    assert solution.objective == pytest.approx(time, rel=1e-6)


@pytest.mark.parametrize("power", [0.5, 0.7])
def test_a_rate_without_limit_is_not_called_solved_before_it_is(power):
    solution = ocp.solve(pushed(lambda _, u, t: t**power * u**2))
    wrong = solution.objective / (1.0 - power) - 1.0
    assert solution.result is not SOLVED or abs(wrong) < 3e-6


def at_a_saddle(name):
    if name == "state in bounds":
        cost = pushed(
            lambda x, u, _: u**2 - x**2, end=0.0, duration=4.0, bounds=(-1.0, 1.0)
        )
        return cost, -(4.0 - np.pi)
    problem = ocp.Problem("saddle")
    static = problem.static("s", -1.0, 1.0) if name == "static" else 0.0
    phase = problem.phase(duration=1.0)
    x = phase.state("x", -1.0, 1.0, start=0.0, end=1.0 if name == "static" else None)
    u = phase.control("u")
    phase.derivative(x, u)
    if name == "static":
        problem.minimise(phase.integral(u**2) - 2.0 * static**2)
        return problem, -1.0
    problem.minimise(0.5 * phase.integral(u**2) - phase.final(x) ** 2)
    return problem, -0.5


@pytest.mark.parametrize("name", ["state in bounds", "static", "end"])
def test_a_search_that_begins_at_a_saddle_leaves_it(name):
    problem, least = at_a_saddle(name)
    solution = ocp.solve(problem)
    assert solution.result is SOLVED, solution.message
    assert solution.objective == pytest.approx(least, rel=1e-6)


def test_a_saddle_of_what_has_no_minimum_is_called_unbounded():
    problem = pushed(lambda x, u, _: u**2 - x**2, end=0.0, duration=4.0)
    assert ocp.solve(problem).result is ocp.Result.UNBOUNDED


def test_arcs_that_were_seen_too_early_are_given_up():
    """A train of the least energy: power, cruise, coast, brake."""
    problem = ocp.Problem("train")
    phase = problem.phase(duration=8.0)
    x = phase.state("x", start=0.0, end=10.0)
    v = phase.state("v", 0.0, 4.0, start=0.0, end=0.0)
    power, brake = phase.control("power", 0.0, 1.0), phase.control("brake", 0.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, power - brake - 0.1 - 0.05 * v**2)
    problem.minimise(phase.integral(power * v))
    solution = ocp.solve(problem)
    assert solution.result is SOLVED, solution.message
    assert any("switch times placed" in record.action for record in solution.history)
    # By quadrature over the speed, the cruise and the speed to brake from found by
    # one-dimensional searches.
    assert solution.objective == pytest.approx(2.65373633303, rel=1e-6)
