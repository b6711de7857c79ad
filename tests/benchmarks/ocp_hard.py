"""Problems that mislead a solver: small units, stiff dynamics, tables, many optima.

Each has an optimum in closed form, from a computation that shares nothing with the
core, or from the literature. They are stated as a newcomer would: no scales, no mesh,
and a guess only where the source gives one.
"""

from __future__ import annotations

from functools import partial
from math import asin, atan2, cos, hypot, pi, sqrt

import casadi as ca
import numpy as np
from benchmarks.ocp_problems import Benchmark, bryson_denham
from scipy.linalg import expm
from scipy.optimize import minimize

from showc import ocp


def lotka_fishing(factor: float = 1.0) -> ocp.Problem:
    """Sager 2012, mintoc.de: fish until both species are at their equilibrium."""
    problem = ocp.Problem("lotka_fishing")
    phase = problem.phase(duration=12.0)
    prey = phase.state("prey", start=0.5)
    hunter = phase.state("hunter", start=0.7)
    catch = phase.control("catch", 0.0, 1.0)
    phase.derivative(prey, prey - prey * hunter - 0.4 * prey * catch)
    phase.derivative(hunter, -hunter + prey * hunter - 0.2 * hunter * catch)
    off = phase.integral((prey - 1.0) ** 2 + (hunter - 1.0) ** 2)
    problem.minimise(factor * off)
    return problem


def fuller(factor: float = 1.0) -> ocp.Problem:
    """Fuller 1963: infinitely many switches before the origin is reached."""
    problem = ocp.Problem("fuller")
    phase = problem.phase(duration=5.0)
    x = phase.state("x", start=1.0)
    v = phase.state("v", start=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(factor * phase.integral(x**2))
    return problem


def fuller_optimum() -> float:
    """Cost from (1, 0), by self-similarity along the switching curve x = C v |v|.

    With C = sqrt((sqrt(33) - 1) / 24) (Fuller 1963), each arc between two switches is
    the one before with its speed times -k and its cost times k to the power 5.
    """
    c = sqrt((sqrt(33.0) - 1.0) / 24.0)
    k = sqrt((0.5 - c) / (0.5 + c))

    def cost(x: float, v: float, u: float, time: float) -> float:
        at = np.polynomial.Polynomial([x, v, 0.5 * u])
        return float((at * at).integ()(time))

    v1 = sqrt(1.0 / (c + 0.5))
    first = cost(1.0, 0.0, -1.0, v1)
    # From (C v1², -v1) with u = 1 to (-C (k v1)², k v1).
    arc = cost(c * v1**2, -v1, 1.0, v1 * (1.0 + k))
    return first + arc / (1.0 - k**5)


def scaled_bryson_denham(factor: float) -> ocp.Problem:
    problem = bryson_denham()
    problem.minimise(factor * problem.objective)
    return problem


_DROP, _RESTITUTION, _BOUNCE_TIME = 1.0, 0.8, 1.0
_GRAVITY = 9.81


def bounce(factor: float = 1.0) -> ocp.Problem:
    """A ball with a weak engine must bounce once and be back at rest: a jump."""
    problem = ocp.Problem("bounce")
    down = problem.phase("down", duration=(0.05, 2.0))
    up = problem.phase("up", duration=(0.05, 2.0))
    ends = ((down, {"start": _DROP, "end": 0.0}), (up, {"start": 0.0, "end": _DROP}))
    effort = 0.0
    for phase, height in ends:
        h = phase.state("h", 0.0, None, **height)
        v = phase.state("v", **{"start" if phase is down else "end": 0.0})
        u = phase.control("u")
        phase.derivative(h, v)
        phase.derivative(v, u - _GRAVITY)
        effort += phase.integral(0.5 * u**2)
    problem.link(down, up, ["h"])
    before, after = down.states["v"].final, up.states["v"].initial
    problem.constrain_boundary(after + _RESTITUTION * before, 0.0, 0.0, name="jump")
    total = down.duration + up.duration
    problem.constrain_boundary(total, _BOUNCE_TIME, _BOUNCE_TIME, name="time")
    problem.minimise(factor * effort)
    return problem


def bounce_optimum() -> float:
    """Least of the closed-form efforts over the time and speed of the impact."""

    def effort(ends: tuple[float, float, float, float], time: float) -> float:
        # Least integral of a²/2 with a = v' - (-g): a is linear in time.
        x0, v0, x1, v1 = ends
        d = x1 - x0 - v0 * time + 0.5 * _GRAVITY * time**2
        w = v1 - v0 + _GRAVITY * time
        return 6.0 * d**2 / time**3 - 6.0 * d * w / time**2 + 2.0 * w**2 / time

    def total(z: np.ndarray) -> float:
        time, speed = float(z[0]), float(z[1])
        down = effort((_DROP, 0.0, 0.0, -speed), time)
        up = effort((0.0, _RESTITUTION * speed, _DROP, 0.0), _BOUNCE_TIME - time)
        return down + up

    found = minimize(
        total,
        np.array([0.45, 4.4]),
        method="Nelder-Mead",
        options={"xatol": 1e-12, "fatol": 1e-15, "maxiter": 4000},
    )
    return float(found.fun)


_CELLS, _PRICE = 20, 1e-3


def _heat_matrices() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heat equation on [0, 1] in cells: insulated on the left, heated on the right."""
    h = 1.0 / _CELLS
    a = np.diag(np.full(_CELLS, -2.0)) + np.diag(np.ones(_CELLS - 1), 1)
    a += np.diag(np.ones(_CELLS - 1), -1)
    a[0, 0] = a[-1, -1] = -1.0
    b = np.zeros(_CELLS)
    b[-1] = 1.0 / h
    wanted = 0.5 * (1.0 - ((np.arange(_CELLS) + 0.5) * h) ** 2)
    return a / h**2, b, wanted


def heat() -> ocp.Problem:
    """Heat a rod to a given profile (Troltzsch 2010): time constants 1/1600 to 1."""
    problem = ocp.Problem("heat")
    phase = problem.phase(duration=1.0)
    a, b, wanted = _heat_matrices()
    y = [phase.state(f"y{i}", start=0.0) for i in range(_CELLS)]
    u = phase.control("u")
    for i in range(_CELLS):
        rate = sum(a[i, j] * y[j] for j in range(_CELLS) if a[i, j])
        phase.derivative(y[i], rate + b[i] * u)
    miss = sum((phase.final(y[i]) - wanted[i]) ** 2 for i in range(_CELLS)) / _CELLS
    problem.minimise(0.5 * miss + phase.integral(0.5 * _PRICE * u**2))
    return problem


def heat_optimum() -> float:
    """Least squares over the terminal states that can be reached.

    With the Gramian W of the pair (A, b) over the time, the least integral of u² that
    reaches z is z' W^-1 z; minimised together with the mean square distance of z to
    the wanted w, this gives price / 2 w' (n price I + W)^-1 w.
    """
    a, b, wanted = _heat_matrices()
    n = _CELLS
    # Van Loan 1978: the Gramian from one matrix exponential, by doubling.
    block = np.block([[-a, np.outer(b, b)], [np.zeros((n, n)), a.T]])
    parts = 2**12
    step = expm(block / parts)
    forward = step[n:, n:].T
    gramian = forward @ step[:n, n:]
    for _ in range(12):
        gramian = gramian + forward @ gramian @ forward.T
        forward = forward @ forward
    core = n * _PRICE * np.eye(n) + gramian
    return float(0.5 * _PRICE * wanted @ np.linalg.solve(core, wanted))


def penicillin() -> ocp.Problem:
    """Banga et al. 1997, fed-batch fermentation; the time is free."""
    problem = ocp.Problem("penicillin")
    phase = problem.phase(duration=(10.0, 200.0))
    biomass = phase.state("biomass", 0.0, 40.0, start=1.5)
    product = phase.state("product", 0.0, 50.0, start=0.0)
    substrate = phase.state("substrate", 0.0, 25.0, start=0.0)
    volume = phase.state("volume", 0.0, 10.0, start=7.0)
    feed = phase.control("feed", 0.0, 50.0)
    growth = 0.11 * substrate / (0.006 * biomass + substrate)
    making = 0.0055 * substrate / (0.0001 + substrate * (1.0 + 10.0 * substrate))
    keeping = 0.029 * substrate / (0.0001 + substrate)
    thinning = feed / (500.0 * volume)
    phase.derivative(biomass, growth * biomass - thinning * biomass)
    phase.derivative(product, making * biomass - 0.01 * product - thinning * product)
    phase.derivative(
        substrate,
        -(growth / 0.47 + making / 1.2 + keeping) * biomass
        + feed / volume * (1.0 - substrate / 500.0),
    )
    phase.derivative(volume, feed / 500.0)
    problem.maximise(phase.final(product) * phase.final(volume))
    return problem


def _climb_tables() -> tuple[list[float], ...]:
    """Thrust [N] over Mach number and height [m] (Bryson, Desai, Hoffman 1969)."""
    mach = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8]
    height = [304.8 * k for k in (0, 5, 10, 15, 20, 25, 30, 40, 50, 70)]
    thrust = [
        [24.2, 24.0, 20.3, 17.3, 14.5, 12.2, 10.2, 5.7, 3.4, 0.1],
        [28.0, 24.6, 21.1, 18.1, 15.2, 12.8, 10.7, 6.5, 3.9, 0.2],
        [28.3, 25.2, 21.9, 18.7, 15.9, 13.4, 11.2, 7.3, 4.4, 0.4],
        [30.8, 27.2, 23.8, 20.5, 17.3, 14.7, 12.3, 8.1, 4.9, 0.8],
        [34.5, 30.3, 26.6, 23.2, 19.8, 16.8, 14.1, 9.4, 5.6, 1.1],
        [37.9, 34.3, 30.4, 26.8, 23.3, 19.8, 16.8, 11.2, 6.8, 1.4],
        [36.1, 38.0, 34.9, 31.3, 27.3, 23.6, 20.1, 13.4, 8.3, 1.7],
        [36.1, 36.6, 38.5, 36.1, 31.6, 28.1, 24.2, 16.2, 10.0, 2.2],
        [36.1, 35.2, 42.1, 38.7, 35.7, 32.0, 28.1, 19.3, 11.9, 2.9],
        [36.1, 33.8, 45.7, 41.3, 39.8, 34.6, 31.1, 21.7, 13.3, 3.1],
    ]
    force = (4448.222 * np.array(thrust)).ravel(order="F").tolist()
    return mach, height, force


def climb() -> ocp.Problem:
    """Least time to climb to 20 km at Mach 1; thrust and drag from tables."""
    problem = ocp.Problem("climb")
    phase = problem.phase(duration=(100.0, 800.0))
    h = phase.state("h", 0.0, 21_000.0, start=0.0, end=19_994.88)
    v = phase.state("v", 50.0, 530.0, start=129.314, end=295.092)
    gamma = phase.state("gamma", -pi / 4.0, pi / 4.0, start=0.0, end=0.0)
    m = phase.state("m", 15_000.0, 20_000.0, start=19_050.864)
    alpha = phase.control("alpha", -pi / 4.0, pi / 4.0)
    mach, height, force = _climb_tables()
    thrust_of = ca.interpolant("thrust", "bspline", [mach, height], force)
    knots = [0.0, 0.4, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 1.8]

    def table(name: str, values: list[float]) -> ca.Function:
        return ca.interpolant(name, "bspline", [knots], values)

    lift_of = table("lift", [3.44, 3.44, 3.44, 3.58, 4.44, 3.44, 3.01, 2.86, 2.44])
    drag_of = table(
        "drag", [0.013, 0.013, 0.013, 0.014, 0.031, 0.041, 0.039, 0.036, 0.035]
    )
    share_of = table("share", [0.54, 0.54, 0.54, 0.75, 0.79, 0.78, 0.89, 0.93, 0.93])
    density = 1.225 * ca.exp(-h / 8_000.0)
    sound = 340.3 - 45.2 / (1.0 + ca.exp(-(h - 6_500.0) / 1_800.0))
    number = v / sound
    slope = lift_of(number)
    pressure = 0.5 * density * v**2 * 49.2386
    drag = pressure * (drag_of(number) + share_of(number) * slope * alpha**2)
    lift = pressure * slope * alpha
    thrust = thrust_of(ca.vertcat(number, h))
    r = 6_378_145.0 + h
    gravity = 3.986e14 / r**2
    phase.derivative(h, v * ca.sin(gamma))
    phase.derivative(v, (thrust * ca.cos(alpha) - drag) / m - gravity * ca.sin(gamma))
    phase.derivative(
        gamma,
        (thrust * ca.sin(alpha) + lift) / (m * v)
        + (v / r - gravity / v) * ca.cos(gamma),
    )
    phase.derivative(m, -thrust / (9.80665 * 1_600.0))
    problem.minimise(phase.duration)
    return problem


def lee_ramirez() -> ocp.Problem:
    """Lee, Ramirez 1994, in the form of Tholudur, Ramirez 1997, inducer for nothing."""
    problem = ocp.Problem("lee_ramirez")
    phase = problem.phase(duration=10.0)
    starts = (1.0, 0.1, 40.0, 0.0, 0.0, 1.0, 0.0)
    x = [phase.state(f"x{i + 1}", 0.0, None, start=s) for i, s in enumerate(starts)]
    u1 = phase.control("u1", 0.0, 1.0)
    u2 = phase.control("u2", 0.0, 1.0)
    x1, x2, x3, x4, x5, x6, x7 = x
    uptake = x3 / (14.35 + x3 + x3**2 / 111.5)
    growth = uptake * (x6 + 0.22 * x7 / (0.22 + x5))
    making = 0.233 * uptake * (0.0005 + x5) / (0.022 + x5)
    shock = 0.09 * x5 / (0.034 + x5)
    thinning = (u1 + u2) / x1
    phase.derivative(x1, u1 + u2)
    phase.derivative(x2, growth * x2 - thinning * x2)
    phase.derivative(x3, 100.0 * u1 / x1 - thinning * x3 - growth * x2 / 0.51)
    phase.derivative(x4, making * x2 - thinning * x4)
    phase.derivative(x5, 4.0 * u2 / x1 - thinning * x5)
    phase.derivative(x6, -shock * x6)
    phase.derivative(x7, shock * (1.0 - x7))
    problem.maximise(phase.final(x1) * phase.final(x4))
    return problem


_GATES = ((2.5, 0.3), (5.0, -0.3), (7.5, 0.3))
"""Middles of the discs of radius 1 of the slalom [m]."""


def slalom() -> ocp.Problem:
    """The shortest way past three discs; there are eight ways to pass them."""
    problem = ocp.Problem("slalom")
    phase = problem.phase(duration=(8.0, 30.0))
    x = phase.state("x", start=0.0, end=10.0)
    y = phase.state("y", start=0.0, end=0.0)
    heading = phase.control("heading", -pi / 2.0, pi / 2.0)
    phase.derivative(x, ca.cos(heading))
    phase.derivative(y, ca.sin(heading))
    for k, (a, b) in enumerate(_GATES):
        away = (x - a) ** 2 + (y - b) ** 2
        phase.constrain(away, 1.0, None, name=f"disc {k + 1}")
    problem.minimise(phase.duration)
    return problem


def slalom_optimum() -> float:
    """Length of a taut string that passes each disc on its nearer side.

    Below the first, above the second and below the third: four tangents, three arcs.
    """
    # Sides: a disc above the way is touched by its lower side, turned about to the
    # left (+1); the middle one is passed above, turned about to the right (-1).
    turns = (1.0, -1.0, 1.0)
    points = [(0.0, 0.0), *_GATES, (10.0, 0.0)]
    signs = (0.0, *turns, 0.0)
    length, headings = 0.0, []
    for k in range(4):
        (ax, ay), (bx, by) = points[k], points[k + 1]
        apart, direct = hypot(bx - ax, by - ay), atan2(by - ay, bx - ax)
        # A directed tangent has its discs' middles at signed distances to its left.
        lean = asin((signs[k] - signs[k + 1]) / apart)
        headings.append(direct + lean)
        length += apart * cos(lean)
    for k in range(3):
        length += abs(headings[k + 1] - headings[k])
    return length


def soaring() -> ocp.Problem:
    """Zhao 2004: the least wind gradient in which a glider soars in a loop, in feet."""
    problem = ocp.Problem("soaring")
    phase = problem.phase(duration=(10.0, 30.0))
    slope = problem.static("slope", 0.005, 0.15)
    x = phase.state("x", -1_000.0, 1_000.0, start=0.0, end=0.0)
    y = phase.state("y", -1_000.0, 1_000.0, start=0.0, end=0.0)
    z = phase.state("z", 0.0, 1_000.0, start=0.0, end=0.0)
    v = phase.state("v", 10.0, 350.0)
    gamma = phase.state("gamma", -1.3, 1.3)
    psi = phase.state("psi", -500.0 * pi / 180.0, 500.0 * pi / 180.0)
    lift_of = phase.control("lift_of", 0.0, 1.5)
    bank = phase.control("bank", -1.3, 1.3)
    mass, area, density, g = 5.6, 45.09703, 0.002378, 32.2
    wind_rate = slope * v * ca.sin(gamma)
    pressure = 0.5 * density * v**2 * area
    lift = pressure * lift_of
    drag = pressure * (0.00873 + 0.045 * lift_of**2)
    phase.derivative(x, v * ca.cos(gamma) * ca.sin(psi) + slope * z)
    phase.derivative(y, v * ca.cos(gamma) * ca.cos(psi))
    phase.derivative(z, v * ca.sin(gamma))
    phase.derivative(
        v, -drag / mass - g * ca.sin(gamma) - wind_rate * ca.cos(gamma) * ca.sin(psi)
    )
    phase.derivative(
        gamma,
        (
            lift * ca.cos(bank)
            - mass * g * ca.cos(gamma)
            + mass * wind_rate * ca.sin(gamma) * ca.sin(psi)
        )
        / (mass * v),
    )
    phase.derivative(
        psi,
        (lift * ca.sin(bank) - mass * wind_rate * ca.cos(psi))
        / (mass * v * ca.cos(gamma)),
    )
    phase.constrain(lift / (mass * g), -2.0, 5.0, name="load")
    turns = (("v", v, 0.0), ("gamma", gamma, 0.0), ("psi", psi, 2.0 * pi))
    for name, state, more in turns:
        end = phase.final(state) - phase.initial(state)
        problem.constrain_boundary(end, more, more, name=f"loop of {name}")
    problem.minimise(slope)
    return problem


def f8() -> ocp.Problem:
    """Garrard, Jordan 1977: bring an F-8 aircraft to level flight in least time."""
    problem = ocp.Problem("f8")
    phase = problem.phase(duration=(0.1, 20.0))
    a = phase.state("attack", start=0.4655, end=0.0)
    th = phase.state("pitch", start=0.0, end=0.0)
    q = phase.state("rate", start=0.0, end=0.0)
    w = phase.control("tail", -0.05236, 0.05236)
    phase.derivative(
        a,
        -0.877 * a
        + q
        - 0.088 * a * q
        + 0.47 * a**2
        - 0.019 * th**2
        - a**2 * q
        + 3.846 * a**3
        - 0.215 * w
        + 0.28 * a**2 * w
        + 0.47 * a * w**2
        + 0.63 * w**3,
    )
    phase.derivative(th, q)
    phase.derivative(
        q,
        -4.208 * a
        - 0.396 * q
        - 0.47 * a**2
        - 3.564 * a**3
        - 20.967 * w
        + 6.265 * a**2 * w
        + 46.0 * a * w**2
        + 61.4 * w**3,
    )
    problem.minimise(phase.duration)
    return problem


HARD = (
    Benchmark("lotka_fishing", lotka_fishing, 1.34408, 1e-5, "Sager 2012"),
    Benchmark(
        "lotka_fishing x 1e-8",
        partial(lotka_fishing, 1e-8),
        1.34408e-8,
        1e-5,
        "Sager 2012",
    ),
    Benchmark("fuller", fuller, fuller_optimum(), 0.0, "closed form"),
    Benchmark(
        "fuller x 1e-4",
        partial(fuller, 1e-4),
        1e-4 * fuller_optimum(),
        0.0,
        "closed form",
    ),
    Benchmark(
        "bryson_denham x 1e-8",
        partial(scaled_bryson_denham, 1e-8),
        4e-8,
        0.0,
        "closed form",
    ),
    Benchmark("bounce", bounce, bounce_optimum(), 1e-10, "closed form"),
    Benchmark(
        "bounce x 1e-8",
        partial(bounce, 1e-8),
        1e-8 * bounce_optimum(),
        1e-10,
        "closed form",
    ),
    Benchmark("heat", heat, heat_optimum(), 1e-10, "least squares"),
    Benchmark("penicillin", penicillin, 87.99, 1e-2, "Banga et al. 1997"),
    Benchmark("climb", climb, 0.0, 1.0, ""),
    Benchmark("lee_ramirez", lee_ramirez, 6.1516, 1e-4, "Tholudur, Ramirez 1997"),
    Benchmark("slalom", slalom, slalom_optimum(), 0.0, "taut string"),
    Benchmark("soaring", soaring, 0.0, 1.0, ""),
    Benchmark("f8", f8, 3.78086, 1e-5, "Sager 2012; the best of several optima"),
)
"""The last one and climb are known to end in a worse optimum, or after long."""
