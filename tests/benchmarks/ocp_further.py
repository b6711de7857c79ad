"""Further well-known problems: badly scaled, singular, bang-off-bang, constrained,
of several phases."""

from __future__ import annotations

from itertools import pairwise
from math import pi, sqrt

import casadi as ca
from benchmarks.ocp_problems import Benchmark

from showc import ocp


def moon_lander() -> ocp.Problem:
    problem = ocp.Problem("moon_lander")
    phase = problem.phase(duration=(0.1, 100.0))
    h = phase.state("h", start=10.0, end=0.0)
    v = phase.state("v", start=-2.0, end=0.0)
    thrust = phase.control("thrust", 0.0, 3.0)
    phase.derivative(h, v)
    phase.derivative(v, thrust - 1.5)
    problem.minimise(phase.integral(thrust))
    return problem


def least_fuel_double_integrator() -> ocp.Problem:
    problem = ocp.Problem("least_fuel")
    phase = problem.phase(duration=3.0)
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    push = phase.control("push", 0.0, 1.0)
    brake = phase.control("brake", 0.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, push - brake)
    problem.minimise(phase.integral(push + brake))
    return problem


def catalyst_mixing() -> ocp.Problem:
    problem = ocp.Problem("catalyst_mixing")
    phase = problem.phase(duration=1.0)
    a = phase.state("a", start=1.0)
    b = phase.state("b", start=0.0)
    u = phase.control("u", 0.0, 1.0)
    phase.derivative(a, u * (10.0 * b - a))
    phase.derivative(b, u * (a - 10.0 * b) - (1.0 - u) * b)
    problem.minimise(phase.final(a) + phase.final(b) - 1.0)
    return problem


def orbit_raising() -> ocp.Problem:
    problem = ocp.Problem("orbit_raising")
    phase = problem.phase(duration=3.32)
    r = phase.state("r", 0.5, 5.0, start=1.0)
    vr = phase.state("vr", -10.0, 10.0, start=0.0, end=0.0)
    vt = phase.state("vt", -10.0, 10.0, start=1.0)
    angle = phase.control("angle", -pi, pi)
    a = 0.1405 / (1.0 - 0.0749 * phase.time)
    phase.derivative(r, vr)
    phase.derivative(vr, vt**2 / r - 1.0 / r**2 + a * ca.sin(angle))
    phase.derivative(vt, -vr * vt / r + a * ca.cos(angle))
    problem.constrain_boundary(
        phase.final(vt) - 1.0 / ca.sqrt(phase.final(r)), 0.0, 0.0, name="circular"
    )
    problem.maximise(phase.final(r))
    return problem


def shuttle_reentry() -> ocp.Problem:
    """Betts 2010, section 6.1, maximum cross range, no heating limit, in feet."""
    problem = ocp.Problem("shuttle_reentry")
    phase = problem.phase(duration=(100.0, 4000.0))
    deg = pi / 180.0
    h = phase.state("h", 0.0, 300_000.0, start=260_000.0, end=80_000.0)
    lon = phase.state("lon", -90.0 * deg, 90.0 * deg, start=0.0)
    lat = phase.state("lat", -89.0 * deg, 89.0 * deg, start=0.0)
    v = phase.state("v", 1.0, 45_000.0, start=25_600.0, end=2_500.0)
    gamma = phase.state(
        "gamma", -89.0 * deg, 89.0 * deg, start=-1.0 * deg, end=-5.0 * deg
    )
    psi = phase.state("psi", -180.0 * deg, 180.0 * deg, start=90.0 * deg)
    alpha = phase.control("alpha", -90.0 * deg, 90.0 * deg)
    beta = phase.control("beta", -89.0 * deg, 1.0 * deg)
    re, mu, area, mass = 20_902_900.0, 0.14076539e17, 2_690.0, 203_000.0 / 32.174
    r = h + re
    rho = 0.002378 * ca.exp(-h / 23_800.0)
    a = alpha / deg
    lift = 0.5 * (-0.20704 + 0.029244 * a) * area * rho * v**2
    drag = 0.5 * (0.07854 - 0.61592e-2 * a + 0.621408e-3 * a**2) * area * rho * v**2
    g = mu / r**2
    phase.derivative(h, v * ca.sin(gamma))
    phase.derivative(lon, v * ca.cos(gamma) * ca.sin(psi) / (r * ca.cos(lat)))
    phase.derivative(lat, v * ca.cos(gamma) * ca.cos(psi) / r)
    phase.derivative(v, -drag / mass - g * ca.sin(gamma))
    phase.derivative(
        gamma, lift * ca.cos(beta) / (mass * v) + ca.cos(gamma) * (v / r - g / v)
    )
    phase.derivative(
        psi,
        lift * ca.sin(beta) / (mass * v * ca.cos(gamma))
        + v * ca.cos(gamma) * ca.sin(psi) * ca.tan(lat) / r,
    )
    problem.maximise(phase.final(lat) / deg)
    return problem


def alp_rider() -> ocp.Problem:
    """Betts 2010, section 4.11.7: a path that must pass four narrow peaks."""
    problem = ocp.Problem("alp_rider")
    phase = problem.phase(duration=20.0)
    y1 = phase.state("y1", start=2.0, end=2.0)
    y2 = phase.state("y2", start=1.0, end=3.0)
    y3 = phase.state("y3", start=2.0, end=1.0)
    y4 = phase.state("y4", start=1.0, end=-2.0)
    u1, u2 = phase.control("u1"), phase.control("u2")
    phase.derivative(y1, -10.0 * y1 + u1 + u2)
    phase.derivative(y2, -2.0 * y2 + u1 + 2.0 * u2)
    phase.derivative(y3, -3.0 * y3 + 5.0 * y4 + u1 - u2)
    phase.derivative(y4, 5.0 * y3 - 3.0 * y4 + u1 + 3.0 * u2)
    t = phase.time

    def peak(a: float, b: float) -> object:
        return ca.exp(-b * (t - a) ** 2)

    hills = (
        3.0 * peak(3.0, 12.0)
        + 3.0 * peak(6.0, 10.0)
        + 3.0 * peak(10.0, 6.0)
        + 8.0 * peak(15.0, 4.0)
        + 0.01
    )
    energy = y1**2 + y2**2 + y3**2 + y4**2
    phase.constrain(energy - hills, 0.0, None, name="terrain")
    problem.minimise(phase.integral(100.0 * energy + 0.01 * (u1**2 + u2**2)))
    return problem


def rayleigh() -> ocp.Problem:
    """Maurer, Augustin 2000: Rayleigh with a mixed control-state constraint."""
    problem = ocp.Problem("rayleigh")
    phase = problem.phase(duration=4.5)
    x = phase.state("x", start=-5.0)
    y = phase.state("y", start=-5.0)
    u = phase.control("u")
    phase.derivative(x, y)
    phase.derivative(y, -x + y * (1.4 - 0.14 * y**2) + 4.0 * u)
    phase.constrain(u + x / 6.0, None, 0.0, name="mixed")
    problem.minimise(phase.integral(u**2 + x**2))
    return problem


def van_der_pol() -> ocp.Problem:
    problem = ocp.Problem("van_der_pol")
    phase = problem.phase(duration=5.0)
    x = phase.state("x", start=1.0)
    y = phase.state("y", -0.4, None, start=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, y)
    phase.derivative(y, -x + y * (1.0 - x**2) + u)
    problem.minimise(phase.integral(x**2 + y**2 + u**2))
    return problem


def singular_regulator() -> ocp.Problem:
    problem = ocp.Problem("singular_regulator")
    phase = problem.phase(duration=5.0)
    x = phase.state("x", start=0.0)
    v = phase.state("v", start=1.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.integral(0.5 * (x**2 + v**2)))
    return problem


def free_flying_robot() -> ocp.Problem:
    """Sakawa 1999: two thrusters of either sign, least fuel, T = 12."""
    problem = ocp.Problem("free_flying_robot")
    phase = problem.phase(duration=12.0)
    x = phase.state("x", start=-10.0, end=0.0)
    y = phase.state("y", start=-10.0, end=0.0)
    th = phase.state("th", start=pi / 2.0, end=0.0)
    vx = phase.state("vx", start=0.0, end=0.0)
    vy = phase.state("vy", start=0.0, end=0.0)
    w = phase.state("w", start=0.0, end=0.0)
    u = [phase.control(f"u{i}", 0.0, 1.0) for i in range(1, 5)]
    t1, t2 = u[0] - u[1], u[2] - u[3]
    phase.derivative(x, vx)
    phase.derivative(y, vy)
    phase.derivative(th, w)
    phase.derivative(vx, (t1 + t2) * ca.cos(th))
    phase.derivative(vy, (t1 + t2) * ca.sin(th))
    phase.derivative(w, 0.2 * t1 - 0.2 * t2)
    phase.constrain(u[0] + u[1], None, 1.0, name="first thruster")
    phase.constrain(u[2] + u[3], None, 1.0, name="second thruster")
    problem.minimise(phase.integral(u[0] + u[1] + u[2] + u[3]))
    return problem


def tumour() -> ocp.Problem:
    """Ledzewicz, Schaettler 2008: antiangiogenic treatment, singular arc."""
    problem = ocp.Problem("tumour")
    phase = problem.phase(duration=(0.1, 10.0))
    p_max = ((5.85 - 0.02) / 0.00873) ** 1.5
    p = phase.state("p", 0.1, p_max, start=p_max / 2.0)
    q = phase.state("q", 0.1, p_max, start=p_max / 4.0)
    dose = phase.state("dose", 0.0, 15.0, start=0.0)
    u = phase.control("u", 0.0, 75.0)
    phase.derivative(p, -0.084 * p * ca.log(p / q))
    phase.derivative(q, q * (5.85 - (0.02 + 0.00873 * p ** (2.0 / 3.0) + 0.15 * u)))
    phase.derivative(dose, u)
    problem.minimise(phase.final(p))
    return problem


def two_phase_waypoint() -> ocp.Problem:
    """Least time 0 to 1 to -1 and stop: bang-bang in two linked phases."""
    problem = ocp.Problem("waypoint")
    first = problem.phase("out", duration=(0.01, 20.0))
    second = problem.phase("back", duration=(0.01, 20.0))
    for phase, start, end in ((first, 0.0, 1.0), (second, None, -1.0)):
        x = phase.state("x", start=start, end=end)
        v = phase.state(
            "v",
            start=0.0 if start is not None else None,
            end=0.0 if start is None else None,
        )
        u = phase.control("u", -1.0, 1.0)
        phase.derivative(x, v)
        phase.derivative(v, u)
    problem.link(first, second)
    problem.minimise(second.final_time)
    return problem


def zermelo() -> ocp.Problem:
    problem = ocp.Problem("zermelo")
    phase = problem.phase(duration=(0.1, 50.0))
    x = phase.state("x", start=3.5, end=0.0)
    y = phase.state("y", start=-1.8, end=0.0)
    angle = phase.control("angle", -pi, 2.0 * pi)
    phase.derivative(x, ca.cos(angle) - y)
    phase.derivative(y, ca.sin(angle))
    problem.minimise(phase.duration)
    return problem


def hang_glider() -> ocp.Problem:
    """COPS 3: the widest reach through a thermal."""
    problem = ocp.Problem("hang_glider")
    phase = problem.phase(duration=(1.0, 200.0))
    x = phase.state("x", 0.0, None, start=0.0)
    y = phase.state("y", start=1000.0, end=900.0)
    vx = phase.state("vx", 0.0, None, start=13.2275675, end=13.2275675)
    vy = phase.state("vy", start=-1.28750052, end=-1.28750052)
    lift = phase.control("lift", 0.0, 1.4)
    r = (x / 100.0 - 2.5) ** 2
    sink = vy - 2.5 * (1.0 - r) * ca.exp(-r)
    speed = ca.sqrt(vx**2 + sink**2)
    push = 0.5 * 1.13 * 14.0 / 100.0 * speed
    drag = 0.034 + 0.069662 * lift**2
    phase.derivative(x, vx)
    phase.derivative(y, vy)
    phase.derivative(vx, push * (-lift * sink - drag * vx))
    phase.derivative(vy, push * (lift * vx - drag * sink) - 9.80665)
    problem.maximise(phase.final(x))
    return problem


def triple_integrator() -> ocp.Problem:
    problem = ocp.Problem("triple_integrator")
    phase = problem.phase(duration=(0.1, 20.0))
    a = phase.state("a", start=1.0, end=0.0)
    b = phase.state("b", start=0.0, end=0.0)
    c = phase.state("c", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(a, b)
    phase.derivative(b, c)
    phase.derivative(c, u)
    problem.minimise(phase.final_time)
    return problem


def oscillator() -> ocp.Problem:
    """Least time to rest from 8 half units: four half circles, three switches."""
    problem = ocp.Problem("oscillator")
    phase = problem.phase(duration=(0.1, 30.0))
    x = phase.state("x", start=8.0, end=0.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, u - x)
    problem.minimise(phase.duration)
    return problem


def touch_point() -> ocp.Problem:
    """Bryson and Denham's problem with l = 1/5: the bound is touched once."""
    problem = ocp.Problem("touch_point")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", None, 0.2, start=0.0, end=0.0)
    v = phase.state("v", start=1.0, end=-1.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


def launch() -> ocp.Problem:
    """Benson 2005: a Delta III to a transfer orbit, four phases with staging, SI."""
    problem = ocp.Problem("launch")
    mu, radius, spin = 3.986012e14, 6_378_145.0, 7.29211585e-5
    latitude = 28.5 * pi / 180.0
    r0 = (radius * ca.cos(latitude), 0.0, radius * ca.sin(latitude))
    v0 = (0.0, spin * r0[0], 0.0)
    solid, first, second = 628_500.0, 1_083_100.0, 110_094.0
    d_solid, d_first, d_second = 17_010.0 / 75.2, 95_550.0 / 261.0, 16_820.0 / 700.0
    mass = 9.0 * 19_290.0 + 104_380.0 + 19_300.0 + 4_164.0
    stages = (
        (6.0 * solid + first, 6.0 * d_solid + d_first, 75.2, 6.0 * 2_280.0),
        (3.0 * solid + first, 3.0 * d_solid + d_first, 75.2, 3.0 * 2_280.0),
        (first, d_first, 110.6, 8_830.0),
        (second, d_second, 700.0, 0.0),
    )
    phases = []
    heaviest = mass
    for i, (thrust, flow, duration, dropped) in enumerate(stages):
        limits = (1.0, duration) if i == len(stages) - 1 else duration
        phase = problem.phase(f"stage {i + 1}", duration=limits)
        phases.append(phase)
        r = [
            phase.state(
                f"r{k}",
                -2.0 * radius,
                2.0 * radius,
                scale=radius,
                start=float(r0[k]) if i == 0 else None,
            )
            for k in range(3)
        ]
        v = [
            phase.state(f"v{k}", -1e4, 1e4, start=float(v0[k]) if i == 0 else None)
            for k in range(3)
        ]
        m = phase.state("m", 100.0, heaviest, start=mass)
        u = [phase.control(f"u{k}", -1.0, 1.0) for k in range(3)]
        height = ca.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2)
        wind = (v[0] + spin * r[1], v[1] - spin * r[0], v[2])
        speed = ca.sqrt(wind[0] ** 2 + wind[1] ** 2 + wind[2] ** 2 + 1e-8)
        density = 1.225 * ca.exp(-(height - radius) / 7_200.0)
        drag = 0.5 * density * 4.0 * pi * 0.5 * speed
        for k in range(3):
            phase.derivative(r[k], v[k])
            phase.derivative(
                v[k], -mu * r[k] / height**3 + (thrust * u[k] - drag * wind[k]) / m
            )
        phase.derivative(m, -flow)
        phase.constrain(u[0] ** 2 + u[1] ** 2 + u[2] ** 2, 1.0, 1.0, name="unit")
        phase.constrain(height / radius, 1.0, None, name="ground")
        mass -= flow * duration + dropped
    continuous = [f"{q}{k}" for q in "rv" for k in range(3)]
    for before, after in pairwise(phases):
        problem.link(before, after, continuous)
    last = phases[-1]
    r = ca.vertcat(*[last.states[f"r{k}"].final for k in range(3)])
    v = ca.vertcat(*[last.states[f"v{k}"].final for k in range(3)])
    h = ca.cross(r, v)
    node = ca.vertcat(-h[1], h[0], 0.0)
    e = ca.cross(v, h) / mu - r / ca.norm_2(r)
    axis = -0.5 * mu / (0.5 * ca.dot(v, v) - mu / ca.norm_2(r))
    deg = pi / 180.0
    ascending = (269.8 - 360.0) * deg
    swing = ca.dot(node, e) / ca.norm_2(node) / ca.norm_2(e)
    for name, value, wanted in (
        ("semi-major axis", axis / 24_361_140.0, 1.0),
        ("eccentricity", ca.norm_2(e), 0.7308),
        ("inclination", h[2] / ca.norm_2(h), ca.cos(latitude)),
        ("ascending node", ca.atan2(node[1], node[0]), ascending),
        ("argument of perigee", swing, ca.cos(130.5 * deg)),
    ):
        problem.constrain_boundary(value, float(wanted), float(wanted), name=name)
    problem.constrain_boundary(e[2], 0.0, None, name="perigee in the north")
    problem.maximise(last.states["m"].final)
    return problem


FURTHER = (
    Benchmark("moon_lander", moon_lander, sqrt(68.0), 0.0, "closed form"),
    Benchmark(
        "least_fuel", least_fuel_double_integrator, 3.0 - sqrt(5.0), 0.0, "closed form"
    ),
    Benchmark("catalyst_mixing", catalyst_mixing, -0.0480556, 1e-5, "COPS 3"),
    Benchmark(
        "orbit_raising",
        orbit_raising,
        1.5252777006,
        1e-9,
        "Bryson, Ho 1975; digits of own solves to 1e-9",
    ),
    Benchmark("shuttle_reentry", shuttle_reentry, 34.1412, 1e-5, "Betts 2010"),
    Benchmark("alp_rider", alp_rider, 2030.85609, 1e-5, "Betts 2010"),
    Benchmark("rayleigh", rayleigh, 44.8044433, 1e-6, "Betts 2010"),
    Benchmark("van_der_pol", van_der_pol, 2.95370118, 1e-6, "Betts 2010"),
    Benchmark("singular_regulator", singular_regulator, 0.0, 1.0, ""),
    Benchmark("free_flying_robot", free_flying_robot, 7.9101, 1e-5, "Betts 2010"),
    Benchmark("tumour", tumour, 7571.67158, 1e-6, "Betts 2010"),
    Benchmark("waypoint", two_phase_waypoint, 0.0, 1.0, ""),
    Benchmark("hang_glider", hang_glider, 1248.031, 1e-5, "COPS 3"),
    Benchmark(
        "triple_integrator",
        triple_integrator,
        32.0 ** (1.0 / 3.0),
        0.0,
        "closed form",
    ),
    Benchmark("oscillator", oscillator, 4.0 * pi, 0.0, "closed form"),
    Benchmark("touch_point", touch_point, 2.24, 0.0, "Bryson, Ho 1975, 3.11"),
    Benchmark("launch", launch, 7529.712, 1e-6, "Benson 2005; Betts 2010"),
    Benchmark("zermelo", zermelo, 0.0, 1.0, ""),
)
