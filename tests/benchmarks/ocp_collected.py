"""Problems of published collections, with digits of theirs or of exact answers.

COPS 3 (Dolan, Moré, Munson 2004), PSOPT's and Bocop's examples, Betts 2010, Luus 2000.
"""

from __future__ import annotations

from math import cosh, pi, sinh

import casadi as ca
from benchmarks.ocp_problems import Benchmark

from showc import ocp


def least_time_van_der_pol() -> ocp.Problem:
    """A van der Pol oscillator through its cycle: the usual start shrinks the time."""
    problem = ocp.Problem("least_time_van_der_pol")
    phase = problem.phase(duration=(0.01, 30.0))
    x = phase.state("x", start=1.0, end=-1.0)
    y = phase.state("y", start=1.0, end=1.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, y)
    phase.derivative(y, (1.0 - x * x) * y - x + u)
    problem.minimise(phase.duration)
    return problem


def dielectrophoretic_particle() -> ocp.Problem:
    """Chang, Petit, Rouchon 2006: product of state and control, none at the start."""
    problem = ocp.Problem("dielectrophoretic_particle")
    phase = problem.phase(duration=(0.0, None))
    x = phase.state("x", start=1.0, end=2.0)
    y = phase.state("y", start=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, y * u - 0.75 * u * u)
    phase.derivative(y, u - y)
    problem.minimise(phase.duration)
    return problem


def robbins() -> ocp.Problem:
    """Robbins 1980: touch points of a third-order constraint without end."""
    problem = ocp.Problem("robbins")
    phase = problem.phase(duration=10.0)
    x = phase.state("x", 0.0, None, start=1.0, end=0.0)
    y = phase.state("y", start=-2.0, end=0.0)
    z = phase.state("z", start=0.0, end=0.0)
    u = phase.control("u")
    phase.derivative(x, y)
    phase.derivative(y, z)
    phase.derivative(z, u)
    problem.minimise(phase.integral(3.0 * x + 0.5 * u * u))
    return problem


def goddard_with_a_speed_limit() -> ocp.Problem:
    """CTDirect's rocket: the limit comes before the singular arc."""
    problem = ocp.Problem("goddard_with_a_speed_limit")
    phase = problem.phase(duration=(0.01, 1.0))
    r = phase.state("r", 1.0, None, start=1.0)
    v = phase.state("v", 0.0, 0.1, start=0.0)
    m = phase.state("m", 0.6, 1.0, start=1.0, end=0.6)
    u = phase.control("u", 0.0, 1.0)
    drag = 310.0 * v**2 * ca.exp(-500.0 * (r - 1.0))
    phase.derivative(r, v)
    phase.derivative(v, (3.5 * u - drag) / m - 1.0 / r**2)
    phase.derivative(m, -7.0 * u)
    problem.maximise(phase.final(r))
    return problem


_SECONDS = (0, 1230, 3060, 4920, 7800, 10680, 15030, 22620, 36420)
_SHARES = (
    (88.35, 7.3, 2.3, 0.4, 1.75),
    (76.4, 15.6, 4.5, 0.7, 2.8),
    (65.1, 23.1, 5.3, 1.1, 5.8),
    (50.4, 32.9, 6.0, 1.5, 9.3),
    (37.5, 42.7, 6.0, 1.9, 12.0),
    (25.9, 49.1, 5.9, 2.2, 17.0),
    (14.0, 57.4, 5.1, 2.6, 21.0),
    (4.5, 63.1, 3.8, 2.9, 25.7),
)


def pinene() -> ocp.Problem:
    """COPS 3: five rates of a reaction from its concentrations at eight times."""
    problem = ocp.Problem("pinene")
    k = [problem.static(f"k{i}", 0.0, None, scale=1e-5) for i in range(5)]
    last, miss = None, 0.0
    for i, wanted in enumerate(_SHARES):
        phase = problem.phase(f"part {i}", duration=_SECONDS[i + 1] - _SECONDS[i])
        first = (100.0, 0.0, 0.0, 0.0, 0.0) if i == 0 else (None,) * 5
        y = [phase.state(f"y{j}", 0.0, 100.0, start=s) for j, s in enumerate(first)]
        rates = (
            -(k[0] + k[1]) * y[0],
            k[0] * y[0],
            k[1] * y[0] - (k[2] + k[3]) * y[2] + k[4] * y[4],
            k[2] * y[2],
            k[3] * y[2] - k[4] * y[4],
        )
        for state, rate in zip(y, rates, strict=True):
            phase.derivative(state, rate)
        ends = zip(y, wanted, strict=True)
        miss += sum((phase.final(state) - share) ** 2 for state, share in ends)
        if last is not None:
            problem.link(last, phase)
        last = phase
    problem.minimise(miss)
    return problem


def farthest() -> ocp.Problem:
    """Bryson 1999: greatest range with gravity and thrust, a heading of unit length."""
    problem = ocp.Problem("farthest")
    phase = problem.phase(duration=2.0)
    x = phase.state("x", -10.0, 10.0, start=0.0)
    y = phase.state("y", -10.0, 10.0, start=0.0, end=0.1)
    v = phase.state("v", -10.0, 10.0, start=0.0)
    a, b = phase.control("a", -10.0, 10.0), phase.control("b", -10.0, 10.0)
    phase.derivative(x, v * a)
    phase.derivative(y, v * b)
    phase.derivative(v, 0.5 - b)
    phase.constrain(a**2 + b**2, 1.0, 1.0, name="unit")
    problem.maximise(phase.final(x))
    return problem


def through_a_point() -> ocp.Problem:
    """A value half-way is given: two phases (PSOPT's interior point)."""
    problem = ocp.Problem("through_a_point")
    first = problem.phase("first", duration=0.75)
    second = problem.phase("second", duration=0.25)
    total = 0.0
    for phase, ends in (
        (first, {"start": 1.0, "end": 0.9}),
        (second, {"end": 0.75}),
    ):
        x = phase.state("x", -1.0, 1.0, **ends)
        u = phase.control("u", -1.0, 1.0)
        phase.derivative(x, u)
        total += phase.integral(x * x + u * u)
    problem.link(first, second)
    problem.minimise(total)
    return problem


def _stretch(start: float, end: float, time: float) -> float:
    """Least integral of x² + u² between two values."""
    both = (start**2 + end**2) * cosh(time) - 2.0 * start * end
    return both / sinh(time)


def saturation() -> ocp.Problem:
    """A spin is brought to rest in least time (Bonnard et al. 2012): singular arcs."""
    problem = ocp.Problem("saturation")
    phase = problem.phase(duration=(0.05, 50.0))
    y = phase.state("y", -1.0, 1.0, start=0.0, end=0.0)
    z = phase.state("z", -1.0, 1.0, start=1.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(y, -0.1 * y - u * z)
    phase.derivative(z, 0.03 * (1.0 - z) + u * y)
    problem.minimise(phase.duration)
    return problem


def oil_shale() -> ocp.Problem:
    """Pyrolysis (Luus 2000): the temperature for the most bitumen, in a free time."""
    problem = ocp.Problem("oil_shale")
    phase = problem.phase(duration=(1.0, 100.0))
    x = phase.state("x", 0.0, 1.0, start=1.0)
    y = phase.state("y", 0.0, 1.0, start=0.0)
    heat = phase.control("heat", 698.15, 748.15)
    k = [
        ca.exp(a - b / (1.9872e-3 * heat))
        for a, b in zip(
            (8.86, 24.25, 23.67, 18.75, 20.70),
            (20.3, 37.4, 33.8, 28.2, 31.0),
            strict=True,
        )
    ]
    phase.derivative(x, -k[0] * x - (k[2] + k[3] + k[4]) * x * y)
    phase.derivative(y, k[0] * x - k[1] * y + k[2] * x * y)
    problem.maximise(phase.final(y))
    return problem


def friction() -> ocp.Problem:
    """Two masses with Coulomb friction smoothed to a hundredth, in least time."""
    problem = ocp.Problem("friction")
    phase = problem.phase(duration=(1.8, 4.0))
    p = phase.state("p", -2.0, 2.0, start=0.0, end=1.0)
    v = phase.state("v", -20.0, 20.0, start=-1.0, end=0.0)
    q = phase.state("q", -2.0, 2.0, start=0.0, end=2.0)
    w = phase.state("w", -20.0, 20.0, start=-2.0, end=0.0)
    a, b = phase.control("a", -4.0, 4.0), phase.control("b", -4.0, 4.0)

    def sign(speed: ca.SX) -> ca.SX:
        return speed / ca.sqrt(speed**2 + 1e-4)

    phase.derivative(p, v)
    phase.derivative(v, (-1.8 * p + 0.85 * q - sign(v) + a) / 1.1)
    phase.derivative(q, w)
    phase.derivative(w, (0.85 * p - 0.85 * q - sign(w) + b) / 1.2)
    problem.minimise(phase.duration)
    return problem


def dive() -> ocp.Problem:
    """PSOPT's missile: dive onto a place, least time, under limits of load."""
    problem = ocp.Problem("dive")
    phase = problem.phase(duration=(10.0, 100.0))
    slope = phase.state("slope", -pi / 2.0, pi / 2.0, start=0.0, end=-pi / 2.0)
    speed = phase.state("speed", 200.0, 310.0, start=272.0, end=310.0)
    x = phase.state("x", 0.0, 10_000.0, start=0.0, end=10_000.0)
    h = phase.state("h", 0.0, 1900.0, start=30.0, end=0.0)
    thrust = phase.control("thrust", 1000.0, 6000.0)
    angle = phase.control("angle", -0.3, 0.3)
    mass, weight = 1005.0, 1005.0 * 9.81
    press = 0.5 * 0.3376 * speed**2 * (3.312e-9 * h * h - 1.142e-4 * h + 1.224)
    drag = press * (-1.9431 * angle**2 - 0.1499 * angle + 0.2359)
    lift = press * 21.9 * angle
    s, c = ca.sin(angle), ca.cos(angle)
    across = (thrust - drag) * s + lift * c - weight * ca.cos(slope)
    phase.derivative(slope, across / (mass * speed))
    along = (thrust - drag) * c - lift * s - weight * ca.sin(slope)
    phase.derivative(speed, along / mass)
    phase.derivative(x, speed * ca.cos(slope))
    phase.derivative(h, speed * ca.sin(slope))
    phase.constrain(lift / weight, -4.0, 4.0, name="load")
    near = 0.5 * (1.0 + ca.tanh((7500.0 - x) / 10.0))
    phase.constrain(h - 30.0 * near, 0.0, 1900.0, name="ground")
    problem.minimise(phase.duration)
    return problem


COLLECTED = (
    Benchmark("least_time_van_der_pol", least_time_van_der_pol, 0.0, 1.0, ""),
    Benchmark(
        "dielectrophoretic_particle",
        dielectrophoretic_particle,
        7.8110,
        1e-4,
        "Chang, Petit, Rouchon 2006",
    ),
    Benchmark("robbins", robbins, 19.4317814, 5e-8, "own solve to 1e-9"),
    Benchmark(
        "goddard_with_a_speed_limit",
        goddard_with_a_speed_limit,
        1.01257,
        1e-5,
        "CTDirect",
    ),
    Benchmark("pinene", pinene, 19.8721669, 5e-9, "COPS 3"),
    Benchmark("farthest", farthest, 1.712313, 2e-6, "PSOPT"),
    Benchmark(
        "through_a_point",
        through_a_point,
        _stretch(1.0, 0.9, 0.75) + _stretch(0.9, 0.75, 0.25),
        0.0,
        "closed form",
    ),
    Benchmark("saturation", saturation, 0.0, 1.0, ""),
    Benchmark("oil_shale", oil_shale, 0.35382, 1e-5, "Luus 2000"),
    Benchmark("friction", friction, 0.0, 1.0, ""),
    Benchmark("dive", dive, 40.91862, 2e-4, "PSOPT"),
)
