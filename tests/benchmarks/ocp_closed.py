"""Small problems whose optima are known in closed form or from Riccati's equation.

Each has one thing that a statement may have: a free time, a cycle, a least peak, an
equation, several phases, a table, units far from one, unstable or stiff dynamics.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, atan, cos, cosh, exp, log, pi, sin, sinh, sqrt, tanh
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq, fsolve

from showc import ocp

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True)
class Closed:
    """A problem and its optimum."""

    build: Callable[[], ocp.Problem]
    optimum: float


CLOSED: dict[str, Closed] = {}


def add(optimum: float | Callable[[], float]) -> Callable:
    """Keep a problem by its name."""

    def keep(build: Callable[[], ocp.Problem]) -> Callable:
        value = optimum() if callable(optimum) else optimum
        CLOSED[build.__name__] = Closed(build, value)
        return build

    return keep


def riccati(system: list, cost: list, start: list, time: float) -> float:
    """Least integral of x'Qx + u'Ru for x' = Ax + Bu from ``start``.

    ``system`` is [A, B], ``cost`` [Q, R].
    """
    a, b = (np.atleast_2d(np.array(m, float)) for m in system)
    q, r = (np.atleast_2d(np.array(m, float)) for m in cost)
    n, x = len(a), np.array(start, float)

    def rate(_: float, flat: np.ndarray) -> np.ndarray:
        s = flat.reshape(n, n)
        return (a.T @ s + s @ a - s @ b @ np.linalg.solve(r, b.T @ s) + q).ravel()

    found = solve_ivp(
        rate, (0.0, time), np.zeros(n * n), method="Radau", rtol=1e-11, atol=1e-14
    )
    return float(x @ found.y[:, -1].reshape(n, n) @ x)


UNSTABLE = [[[0, 1], [2, 0]], [[0], [1]]]


@add(6.0)
def min_effort():
    problem = ocp.Problem("min_effort")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


@add(lambda: riccati([-1, 1], [1, 1], [1], 1))
def scalar_lq():
    problem = ocp.Problem("scalar_lq")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=1.0)
    u = phase.control("u")
    phase.derivative(x, -x + u)
    problem.minimise(phase.integral(x**2 + u**2))
    return problem


@add(1 / sqrt(0.75))
def zermelo_const():
    problem = ocp.Problem("zermelo_const")
    phase = problem.phase(duration=(0.0, None))
    x = phase.state("x", start=0.0, end=0.0)
    y = phase.state("y", start=0.0, end=1.0)
    a = phase.control("a", -pi, pi)
    phase.derivative(x, ca.cos(a) + 0.5)
    phase.derivative(y, ca.sin(a))
    problem.minimise(phase.duration)
    return problem


@add(-pi / 4)
def periodic():
    problem = ocp.Problem("periodic")
    phase = problem.phase(duration=2 * pi)
    x = phase.state("x")
    u = phase.control("u")
    phase.derivative(x, u)
    problem.constrain_boundary(phase.final(x) - phase.initial(x), 0.0, 0.0)
    problem.minimise(phase.integral(0.5 * u**2 + 0.5 * x**2 - x * ca.cos(phase.time)))
    return problem


@add(4.0)
def minimax_push():
    problem = ocp.Problem("minimax_push")
    phase = problem.phase(duration=1.0)
    z = problem.static("z", 0.0, None)
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    phase.constrain(u - z, None, 0.0)
    phase.constrain(u + z, 0.0, None)
    problem.minimise(z)
    return problem


@add(3 - sqrt(3))
def minimax_speed():
    problem = ocp.Problem("minimax_speed")
    phase = problem.phase(duration=1.0)
    z = problem.static("z", 0.0, None)
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -6.0, 6.0)
    phase.derivative(x, v)
    phase.derivative(v, u)
    phase.constrain(v - z, None, 0.0)
    problem.minimise(z)
    return problem


def _jerk() -> tuple[float, float]:
    """Height of a limit just touched at half the time, and the least effort.

    From (0, 1, 0) to (height, 0, free) by the Gramian of both, twice.
    """
    half = 0.5
    gramian = np.array(
        [[half**5 / 20.0, half**4 / 8.0], [half**4 / 8.0, half**3 / 3.0]]
    )
    free = np.array([half, 1.0])
    height = 0.97 * (half - gramian[0, 1] / gramian[1, 1])
    away = np.array([height, 0.0]) - free
    return height, float(away @ np.linalg.solve(gramian, away))


@add(lambda: _jerk()[1])
def jerk_touch():
    h, _ = _jerk()
    problem = ocp.Problem("jerk_touch")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", None, h, start=0.0, end=0.0)
    v = phase.state("v", start=1.0, end=-1.0)
    a = phase.state("a", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, a)
    phase.derivative(a, u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


@add(lambda: riccati([-1, 1], [1, 1], [1], 5))
def algebraic():
    problem = ocp.Problem("algebraic")
    phase = problem.phase(duration=5.0)
    x = phase.state("x", start=1.0)
    u = phase.control("u")
    y = phase.control("y")
    phase.derivative(x, y)
    phase.constrain(y + x - u, 0.0, 0.0, name="dae")
    problem.minimise(phase.integral(x**2 + u**2))
    return problem


@add(lambda: riccati([-1, 1], [1, 1], [1], 5))
def algebraic_nonlinear():
    problem = ocp.Problem("algebraic_nonlinear")
    phase = problem.phase(duration=5.0)
    x = phase.state("x", start=1.0)
    u = phase.control("u")
    y = phase.control("y")
    phase.derivative(x, y)
    phase.constrain(y**3 + y - ((u - x) ** 3 + (u - x)), 0.0, 0.0, name="dae")
    problem.minimise(phase.integral(x**2 + u**2))
    return problem


@add(2.5)
def two_gears():
    problem = ocp.Problem("two_gears")
    a = problem.phase("first", duration=(0.0, None))
    v = a.state("v", 0.0, 1.0, start=0.0, end=1.0)
    u = a.control("u", -1.0, 1.0)
    a.derivative(v, 2 * u)
    b = problem.phase("second", duration=(0.0, None))
    w = b.state("v", 1.0, 3.0, end=3.0)
    q = b.control("u", -1.0, 1.0)
    b.derivative(w, q)
    problem.link(a, b, ["v"])
    problem.minimise(a.duration + b.duration)
    return problem


@add(log(8) / 2 + 0.5)
def stop_in_time():
    problem = ocp.Problem("stop_in_time")
    phase = problem.phase(duration=(0.0, 10.0))
    x = phase.state("x", start=2.0)
    phase.derivative(x, -x)
    problem.minimise(phase.duration + phase.final(x) ** 2)
    return problem


def _bd(unit):
    problem = ocp.Problem("bd")
    phase = problem.phase(duration=unit)
    x = phase.state("x", None, 1 / 9, start=0.0, end=0.0)
    v = phase.state("v", start=1 / unit, end=-1 / unit)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


@add(4e18)
def bd_micro():
    return _bd(1e-6)


@add(4e-18)
def bd_mega():
    return _bd(1e6)


@add(2.0)
def nano():
    problem = ocp.Problem("nano")
    phase = problem.phase(duration=(0.0, None))
    x = phase.state("x", start=0.0, end=1e9)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, 1e12 * v)
    phase.derivative(v, 1e-3 * u)
    problem.minimise(phase.duration)
    return problem


@add(0.5 / (0.3 + 7 / 300 + 0.69 * 4))
def time_table():
    f = ca.interpolant("f", "linear", [[0, 0.3, 0.31, 1.0]], [1, 1, 2, 2])
    problem = ocp.Problem("time_table")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=1.0)
    u = phase.control("u")
    phase.derivative(x, f(phase.time) * u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


@add(0.5 / (0.3 + 0.7 * 4))
def time_jump():
    problem = ocp.Problem("time_jump")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=1.0)
    u = phase.control("u")
    phase.derivative(x, ca.if_else(phase.time < 0.3, 1.0, 2.0) * u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


@add(
    lambda: riccati(
        [[[0, 1], [0, -1000]], [[0], [1000]]], [[[1, 0], [0, 0]], 0.01], [1, 0], 2
    )
)
def perturbed():
    problem = ocp.Problem("perturbed")
    phase = problem.phase(duration=2.0)
    x = phase.state("x", start=1.0)
    y = phase.state("y", start=0.0)
    u = phase.control("u")
    phase.derivative(x, y)
    phase.derivative(y, 1000 * (u - y))
    problem.minimise(phase.integral(x**2 + 0.01 * u**2))
    return problem


@add(1 / 3)
def singular_stop():
    problem = ocp.Problem("singular_stop")
    phase = problem.phase(duration=2.0)
    x = phase.state("x", start=1.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, u)
    problem.minimise(phase.integral(x**2))
    return problem


@add(2 / 3)
def inventory():
    problem = ocp.Problem("inventory")
    phase = problem.phase(duration=4.0)
    x = phase.state("x", start=0.0)
    u = phase.control("u", 0.0, 1.0)
    phase.derivative(x, u - 0.5)
    problem.minimise(phase.integral((x - 1) ** 2))
    return problem


def _drag():
    t = brentq(lambda t: log(cosh(t)) + 0.5 * log(1 + tanh(t) ** 2) - 2.0, 0.1, 5)
    return t + atan(tanh(t))


@add(_drag)
def drag2():
    problem = ocp.Problem("drag2")
    phase = problem.phase(duration=(0.0, None))
    x = phase.state("x", start=0.0, end=2.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, u - v**2)
    problem.minimise(phase.duration)
    return problem


@add(0.0)
def fit_zero():
    problem = ocp.Problem("fit_zero")
    phase = problem.phase(duration=3.0)
    k = problem.static("k", 0.0, 5.0)
    x = phase.state("x", start=1.0)
    phase.derivative(x, -k * x)
    problem.minimise(phase.integral((x - ca.exp(-0.7 * phase.time)) ** 2))
    return problem


@add(sqrt(12.0))
def root_of_effort():
    problem = ocp.Problem("root_of_effort")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(ca.sqrt(phase.integral(u**2)))
    return problem


@add(pi**2)
def eigenvalue():
    problem = ocp.Problem("eigenvalue")
    phase = problem.phase(duration=1.0)
    y = phase.state("y", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(y, u)
    problem.constrain_boundary(phase.integral(y**2), 1.0, 1.0)
    problem.minimise(phase.integral(u**2))
    return problem


@add(4 - sqrt(12))
def fuel():
    problem = ocp.Problem("fuel")
    phase = problem.phase(duration=4.0)
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    a = phase.control("a", 0.0, 1.0)
    b = phase.control("b", 0.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, a - b)
    problem.minimise(phase.integral(a + b))
    return problem


def _cake():
    rho, r, w, T = 0.1, 0.05, 1e9, 30.0
    c0 = w * rho / (1 - exp(-rho * T))
    return quad(
        lambda t: exp(-rho * t) * (log(c0) + (r - rho) * t),
        0,
        T,
        epsabs=1e-13,
        epsrel=1e-13,
    )[0]


@add(_cake)
def cake():
    problem = ocp.Problem("cake")
    phase = problem.phase(duration=30.0)
    w = phase.state("w", 0.0, None, start=1e9)
    c = phase.control("c", 1.0, None)
    phase.derivative(w, 0.05 * w - c)
    problem.maximise(phase.integral(ca.exp(-0.1 * phase.time) * ca.log(c)))
    return problem


@add(2.0)
def by_vectors():
    problem = ocp.Problem("by_vectors")
    phase = problem.phase(duration=(0.0, None))
    x = phase.state("x", shape=3, start=0.0, end=[1.0, 0.5, -0.25])
    v = phase.state("v", shape=3, start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0, shape=3)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration)
    return problem


@add(6.0 / 27)
def three_phases():
    # rest to rest over 1 m in 3 s by three linked phases of free lengths
    problem = ocp.Problem("three_phases")
    c, phases = 0, []
    for k in range(3):
        q = problem.phase(f"p{k}", duration=(0.1, 3.0))
        x = q.state(
            "x",
            **({"start": 0.0} if k == 0 else {}),
            **({"end": 1.0} if k == 2 else {}),
        )
        v = q.state(
            "v",
            **({"start": 0.0} if k == 0 else {}),
            **({"end": 0.0} if k == 2 else {}),
        )
        u = q.control("u")
        q.derivative(x, v)
        q.derivative(v, u)
        c += q.integral(0.5 * u**2)
        phases.append(q)
    problem.link(phases[0], phases[1])
    problem.link(phases[1], phases[2])
    problem.constrain_boundary(phases[2].final_time, 3.0, 3.0)
    problem.minimise(c)
    return problem


@add(1.0)
def mass_drop():
    # The first phase lasts as long as it may, for its speed doubles at the end.
    problem = ocp.Problem("mass_drop")
    a = problem.phase("a", duration=(0.0, 0.5))
    v = a.state("v", start=0.0)
    u = a.control("u", 0.0, 1.0)
    a.derivative(v, 2 * u)
    b = problem.phase("b", duration=(0.0, 5.0))
    w = b.state("v", end=3.0)
    q = b.control("u", 0.0, 1.0)
    b.derivative(w, 2 * q)
    problem.constrain_boundary(b.initial(w) - 2 * a.final(v), 0.0, 0.0)
    problem.link(a, b, [])
    problem.minimise(b.final_time)
    return problem


def _unstable(name, duration):
    problem = ocp.Problem(name)
    phase = problem.phase(duration=duration)
    x = phase.state("x", start=1.0)
    v = phase.state("v", start=0.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, 2 * x + u)
    problem.minimise(phase.integral(x**2 + v**2 + u**2))
    return problem


@add(lambda: riccati(UNSTABLE, [np.eye(2), 1], [1, 0], 10))
def unstable():
    return _unstable("unstable", 10.0)


@add(lambda: riccati(UNSTABLE, [np.eye(2), 1], [1, 0], 50))
def unstable_long():
    return _unstable("unstable_long", 50.0)


@add(sin(pi / 3) - pi / 6)
def l_inf_cost():
    # Full speed all along lags most where the sine is as fast.
    problem = ocp.Problem("l_inf_cost")
    phase = problem.phase(duration=pi / 2)
    z = problem.static("z", 0.0, None)
    x = phase.state("x", start=0.0)
    u = phase.control("u", -0.5, 0.5)
    phase.derivative(x, u)
    phase.constrain(x - ca.sin(phase.time) - z, None, 0.0)
    phase.constrain(x - ca.sin(phase.time) + z, 0.0, None)
    problem.minimise(z)
    return problem


@add(5.0 / 6.0)
def above_a_hill():
    problem = ocp.Problem("above_a_hill")
    phase = problem.phase(duration=3.0)
    x = phase.state("x", start=1.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, u)
    phase.constrain(x - (0.25 - (phase.time - 2.0) ** 2 / 4.0), 0.0, None)
    problem.minimise(phase.integral(x))
    return problem


def _slide(name: str) -> tuple[ocp.Problem, ocp.Phase]:
    """State the brachistochrone to a vertical line 1 m away, 9.81 m/s²."""
    problem = ocp.Problem(name)
    phase = problem.phase(duration=(0.0, None))
    x = phase.state("x", start=0.0, end=1.0)
    y = phase.state("y", start=0.0)
    v = phase.state("v", start=0.0)
    a = phase.control("a", 0.0, pi)
    phase.derivative(x, v * ca.sin(a))
    phase.derivative(y, v * ca.cos(a))
    phase.derivative(v, 9.81 * ca.cos(a))
    problem.minimise(phase.duration)
    return problem, phase


@add(sqrt(pi / 9.81))
def slide_to_a_line():
    return _slide("slide_to_a_line")[0]


def _above_a_slope() -> float:
    """Cycloid, slope, cycloid; each cycloid starts from a cusp on the same level."""
    slope, height, g = 0.5, 0.1, 9.81
    turn = 2.0 * atan(1.0 / slope)
    rise, along = 1.0 - cos(turn), turn - sin(turn)
    first = height / (rise - along * slope)
    second = (slope + height) / (rise + (pi - along) * slope)
    fast, slow = sqrt(2.0 * g * second * rise), sqrt(2.0 * g * first * rise)
    down = (fast - slow) / (g * slope / sqrt(1.0 + slope**2))
    return sqrt(first / g) * turn + down + sqrt(second / g) * (pi - turn)


@add(_above_a_slope)
def slide_above_a_slope():
    # Bryson and Ho 1975, section 3.11.
    problem, phase = _slide("slide_above_a_slope")
    x, y = (phase.states[name].quantity.symbol for name in "xy")
    phase.constrain(y - 0.5 * x, None, 0.1)
    return problem


def _two_masses() -> float:
    """Symmetric switches at which distance and spring's motion are right."""
    signs, root = (1, -1, 1, -1), sqrt(2.0)

    def missed(times: np.ndarray) -> list[float]:
        a, b = times
        borders = [0.0, a, b, 2.0 * b - a, 2.0 * b]
        pairs = list(zip(signs, borders, borders[1:], strict=False))
        spring = sum(
            s * (cos(root * (q - b)) - cos(root * (p - b))) for s, p, q in pairs
        )
        end = borders[-1]
        way = sum(s * ((end - p) ** 2 - (end - q) ** 2) / 4.0 for s, p, q in pairs)
        return [spring, way - 1.0]

    return 2.0 * float(fsolve(missed, [1.0, 2.1])[1])


@add(_two_masses)
def two_masses_and_a_spring():
    # Singh, Kabamba, McClamroch 1989; rest to rest of both.
    problem = ocp.Problem("two_masses_and_a_spring")
    phase = problem.phase(duration=(0.0, None))
    a = phase.state("a", start=0.0, end=1.0)
    b = phase.state("b", start=0.0, end=1.0)
    p = phase.state("p", start=0.0, end=0.0)
    q = phase.state("q", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(a, p)
    phase.derivative(b, q)
    phase.derivative(p, b - a + u)
    phase.derivative(q, a - b)
    problem.minimise(phase.duration)
    return problem


@add(2.0 * pi)
def around_an_area():
    # Brockett 1981: every circle through the start is as good as another.
    problem = ocp.Problem("around_an_area")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", start=0.0, end=0.0)
    y = phase.state("y", start=0.0, end=0.0)
    area = phase.state("area", start=0.0, end=1.0)
    u, v = phase.control("u"), phase.control("v")
    phase.derivative(x, u)
    phase.derivative(y, v)
    phase.derivative(area, 0.5 * (x * v - y * u))
    problem.minimise(phase.integral(0.5 * (u**2 + v**2)))
    return problem


@add(lambda: brentq(lambda t: (2 + t) ** 2 + (1 - t / 2) ** 2 - t**4 / 4, 1, 9))
def intercept():
    # A thrust of length 1 in the plane, at any speed.
    problem = ocp.Problem("intercept")
    phase = problem.phase(duration=(0.0, None))
    x = phase.state("x", shape=2, start=0.0, end=[2.0, 1.0])
    v = phase.state("v", shape=2, start=[-1.0, 0.5])
    u = phase.control("u", -1.0, 1.0, shape=2)
    phase.derivative(x, v)
    phase.derivative(v, u)
    phase.constrain(u[0] ** 2 + u[1] ** 2, None, 1.0)
    problem.minimise(phase.duration)
    return problem


def _soap_film() -> float:
    waist = brentq(lambda c: c * cosh(0.5 / c) - 1.0, 0.6, 1.0, xtol=1e-15)
    return waist * (0.5 + 0.5 * waist * sinh(1.0 / waist))


@add(_soap_film)
def soap_film():
    problem = ocp.Problem("soap_film")
    phase = problem.phase(duration=1.0)
    y = phase.state("y", 0.0, None, start=1.0, end=1.0)
    u = phase.control("u")
    phase.derivative(y, u)
    problem.minimise(phase.integral(y * ca.sqrt(1.0 + u**2)))
    return problem


@add(4.0 * sqrt(6.0) / 3.0)
def time_and_effort():
    problem = ocp.Problem("time_and_effort")
    phase = problem.phase(duration=(0.0, None))
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration + phase.integral(u**2))
    return problem


def _with_friction() -> float:
    k, top, way = 0.2, 2.0, 10.0
    faster, slower = -log(1.0 - k * top) / k, log(1.0 + k * top) / k
    way -= (faster - (1.0 - exp(-k * faster)) / k) / k
    way -= (top + 1.0 / k) / k * (1.0 - exp(-k * slower)) - slower / k
    return faster + slower + way / top


@add(_with_friction)
def friction_and_a_speed_limit():
    problem = ocp.Problem("friction_and_a_speed_limit")
    phase = problem.phase(duration=(0.0, None))
    x = phase.state("x", start=0.0, end=10.0)
    v = phase.state("v", None, 2.0, start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, u - 0.2 * v)
    problem.minimise(phase.duration)
    return problem


@add(acos(sin(0.3) * sin(-0.8) + cos(0.3) * cos(0.8) * cos(1.7)))
def great_circle():
    problem = ocp.Problem("great_circle")
    phase = problem.phase(duration=(0.0, None))
    longitude = phase.state("longitude", start=0.2, end=1.9)
    latitude = phase.state("latitude", -1.5, 1.5, start=0.3, end=-0.8)
    course = phase.control("course", -pi, pi)
    phase.derivative(longitude, ca.cos(course) / ca.cos(latitude))
    phase.derivative(latitude, ca.sin(course))
    problem.minimise(phase.duration)
    return problem


@add(2.0 * (0.4 * log(0.4) + 0.6) - 0.18 + (2.0 * log(2.5) - 0.6) ** 2 / 2.0)
def sounding_rocket():
    # Without air all fuel burns at once: exhaust 2, flow 1, mass 1 to 0.4, gravity 1.
    problem = ocp.Problem("sounding_rocket")
    phase = problem.phase(duration=(0.0, None))
    h = phase.state("h", start=0.0)
    v = phase.state("v", start=0.0, end=0.0)
    m = phase.state("m", 0.4, 1.0, start=1.0)
    flow = phase.control("flow", 0.0, 1.0)
    phase.derivative(h, v)
    phase.derivative(v, 2.0 * flow / m - 1.0)
    phase.derivative(m, -flow)
    problem.maximise(phase.final(h))
    return problem
