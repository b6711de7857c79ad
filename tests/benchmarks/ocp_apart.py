"""Textbook problems whose optima come from closed forms or from own shooting.

Nothing of the core is used for the optima: boundary value problems of the minimum
principle by collocation of SciPy, Riccati equations, and geometry.
"""

from __future__ import annotations

from math import exp, log, sqrt

import casadi as ca
import numpy as np
from benchmarks.ocp_problems import Benchmark
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import brentq, minimize_scalar

from showc import ocp

_COOLING_TIME, _COOLING_PRICE = 0.78, 0.1


def cooled_reactor() -> ocp.Problem:
    """Luus 1990: stirred tank reactor with an exothermic reaction, free control."""
    problem = ocp.Problem("cooled_reactor")
    phase = problem.phase(duration=_COOLING_TIME)
    heat = phase.state("heat", start=0.09)
    share = phase.state("share", start=0.09)
    u = phase.control("u")
    rate = (share + 0.5) * ca.exp(25.0 * heat / (heat + 2.0))
    phase.derivative(heat, -2.0 * (heat + 0.25) + rate - (heat + 0.25) * u)
    phase.derivative(share, 0.5 - share - rate)
    problem.minimise(phase.integral(heat**2 + share**2 + _COOLING_PRICE * u**2))
    return problem


def cooled_reactor_optimum() -> float:
    """Solve the boundary value problem of the minimum principle."""

    def rates(_: np.ndarray, z: np.ndarray) -> np.ndarray:
        x, y, a, b, _cost = z
        growth = np.exp(25.0 * x / (x + 2.0))
        rate, by_x = (y + 0.5) * growth, (y + 0.5) * growth * 50.0 / (x + 2.0) ** 2
        u = 0.5 * a * (x + 0.25) / _COOLING_PRICE
        return np.vstack(
            [
                -2.0 * (x + 0.25) + rate - (x + 0.25) * u,
                0.5 - y - rate,
                -(2.0 * x + a * (by_x - 2.0 - u) - b * by_x),
                -(2.0 * y + a * growth - b * (1.0 + growth)),
                x**2 + y**2 + _COOLING_PRICE * u**2,
            ]
        )

    def ends(first: np.ndarray, last: np.ndarray) -> np.ndarray:
        return np.array([first[0] - 0.09, first[1] - 0.09, last[2], last[3], first[4]])

    times = np.linspace(0.0, _COOLING_TIME, 50)
    found = solve_bvp(
        rates, ends, times, np.full((5, 50), 0.05), tol=1e-10, max_nodes=100_000
    )
    return float(found.y[4, -1])


_STOCK, _STILL, _SEASON, _COST = 0.3, 0.6, 10.0, 0.2
"""Fish at first, fish on the singular arc (half of 1 + cost), time, cost of effort."""


def harvest() -> ocp.Problem:
    """Clark 1976: fish a growing stock for profit; wait, hold, then take all."""
    problem = ocp.Problem("harvest")
    phase = problem.phase(duration=_SEASON)
    stock = phase.state("stock", 0.01, None, start=_STOCK)
    effort = phase.control("effort", 0.0, 1.0)
    phase.derivative(stock, stock * (1.0 - stock) - effort * stock)
    problem.maximise(phase.integral((stock - _COST) * effort))
    return problem


def harvest_optimum() -> float:
    """Logistic growth, singular arc, hyperbolic decay: the last's length is best."""
    odds = (_STILL / (1.0 - _STILL)) / (_STOCK / (1.0 - _STOCK))

    def profit(last: float) -> float:
        held = (_SEASON - log(odds) - last) * (_STILL - _COST) * (1.0 - _STILL)
        return held + log(1.0 + _STILL * last) - _COST * last

    found = minimize_scalar(
        lambda last: -profit(last),
        bounds=(0.0, 8.0),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return float(-found.fun)


def arched_roof() -> ocp.Problem:
    """A taut string over a parabola: a state constraint that depends on time."""
    problem = ocp.Problem("arched_roof")
    phase = problem.phase(duration=1.0)
    t = phase.time
    x = phase.state("x", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, u)
    phase.constrain(x - (-1.0 + 8.0 * t - 8.0 * t**2), 0.0, None, name="roof")
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


def arched_roof_optimum() -> float:
    """Tangent from the end to the parabola, then along it."""
    leaves = sqrt(1.0 / 8.0)
    slope = 8.0 - 16.0 * leaves
    # The integral of (8 - 16 t)^2 / 2 from where the string touches to the middle.
    return 2.0 * (0.5 * slope**2 * leaves + slope**3 / 96.0)


def tuberculosis() -> ocp.Problem:
    """Jung, Lenhart, Feng 2002: two strains of tuberculosis, as Betts 2010 has it."""
    problem = ocp.Problem("tuberculosis")
    people, death, resistant = 30_000.0, 0.0143, 0.029
    phase = problem.phase(duration=5.0)
    shares = {"s": 76.0, "t": 1.0, "l1": 36.0, "l2": 2.0, "i1": 4.0, "i2": 1.0}
    s, t, l1, l2, i1, i2 = (
        phase.state(name, 0.0, people, start=people * share / 120.0)
        for name, share in shares.items()
    )
    find, treat = (phase.control(name, 0.05, 0.95) for name in ("find", "treat"))
    failed = (1.0 - treat) * i1
    caught, caught_again = 13.0 * s * i1 / people, 13.0 * t * i1 / people
    cured = 2.0 * find * l1
    phase.derivative(
        s, death * people - caught - resistant * s * i2 / people - death * s
    )
    phase.derivative(
        t,
        cured
        + i1
        - 0.5 * failed
        - caught_again
        - (death + resistant * i2 / people) * t,
    )
    phase.derivative(
        l1,
        caught
        + caught_again
        + 0.4 * failed
        - cured
        - (death + 0.5 + resistant * i2 / people) * l1,
    )
    phase.derivative(
        l2,
        0.1 * failed - (death + 1.0) * l2 + resistant * (s + l1 + t) * i2 / people,
    )
    phase.derivative(i1, 0.5 * l1 - (death + 1.0) * i1)
    phase.derivative(i2, l2 - death * i2)
    problem.minimise(phase.integral(l2 + i2 + 25.0 * find**2 + 250.0 * treat**2))
    return problem


_FAST, _EFFORT = 1000.0, 0.01


def stiff_regulator() -> ocp.Problem:
    """A state that follows another within a thousandth of the time."""
    problem = ocp.Problem("stiff_regulator")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=1.0)
    y = phase.state("y", start=0.0)
    u = phase.control("u")
    phase.derivative(x, _FAST * (y - x))
    phase.derivative(y, u - y)
    problem.minimise(phase.integral(x**2 + _EFFORT * u**2))
    return problem


def stiff_regulator_optimum() -> float:
    """Riccati's differential equation, backwards."""
    a = np.array([[-_FAST, _FAST], [0.0, -1.0]])
    b = np.array([[0.0], [1.0]])

    def rates(_: float, flat: np.ndarray) -> np.ndarray:
        p = flat.reshape(2, 2)
        rate = a.T @ p + p @ a - p @ b @ b.T @ p / _EFFORT + np.diag([1.0, 0.0])
        return np.asarray(rate).ravel()

    found = solve_ivp(
        rates, (0.0, 1.0), np.zeros(4), method="Radau", rtol=1e-10, atol=1e-13
    )
    return float(found.y[0, -1])


_DISTANCE = 3.0


def car_with_drag(unit: float = 1.0) -> ocp.Problem:
    """Least time from rest to rest with linear drag, in any unit of time."""
    problem = ocp.Problem("car_with_drag")
    phase = problem.phase(duration=(0.01 * unit, 100.0 * unit))
    x = phase.state("x", start=0.0, end=_DISTANCE)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v / unit)
    phase.derivative(v, (u - v) / unit)
    problem.minimise(phase.duration)
    return problem


def car_with_drag_optimum() -> float:
    """Push for the distance longer than brake; the speed ends at zero."""

    def speed(brake: float) -> float:
        return (1.0 - exp(-(brake + _DISTANCE))) * exp(-brake) - (1.0 - exp(-brake))

    return float(2.0 * brentq(speed, 0.0, 5.0, xtol=1e-14) + _DISTANCE)


APART = (
    Benchmark(
        "cooled_reactor", cooled_reactor, cooled_reactor_optimum(), 1e-8, "shooting"
    ),
    Benchmark("harvest", harvest, harvest_optimum(), 0.0, "closed form"),
    Benchmark("arched_roof", arched_roof, arched_roof_optimum(), 0.0, "closed form"),
    Benchmark("tuberculosis", tuberculosis, 5152.07310, 2e-7, "Betts 2010"),
    Benchmark(
        "stiff_regulator", stiff_regulator, stiff_regulator_optimum(), 1e-9, "Riccati"
    ),
    Benchmark(
        "car_with_drag", car_with_drag, car_with_drag_optimum(), 0.0, "closed form"
    ),
    Benchmark(
        "car_with_drag, time x 1e-3",
        lambda: car_with_drag(1e-3),
        1e-3 * car_with_drag_optimum(),
        0.0,
        "closed form",
    ),
)
