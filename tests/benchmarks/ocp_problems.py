"""Classic optimal control problems with known optima, stated through showc.ocp."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

import casadi as ca

from showc import ocp

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class Benchmark:
    """A problem and what is known about its answer."""

    name: str
    build: Callable[[], ocp.Problem]
    optimum: float
    digits: float
    """Relative error to which the optimum itself is known."""
    source: str


def bryson_denham() -> ocp.Problem:
    problem = ocp.Problem("bryson_denham")
    phase = problem.phase(duration=1.0)
    x = phase.state("x", None, 1.0 / 9.0, start=0.0, end=0.0)
    v = phase.state("v", start=1.0, end=-1.0)
    u = phase.control("u")
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.integral(0.5 * u**2))
    return problem


def double_integrator() -> ocp.Problem:
    problem = ocp.Problem("double_integrator")
    phase = problem.phase(duration=(0.01, 100.0))
    x = phase.state("x", start=0.0, end=1.0)
    v = phase.state("v", start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration)
    return problem


def double_integrator_vmax() -> ocp.Problem:
    problem = ocp.Problem("double_integrator_vmax")
    phase = problem.phase(duration=(0.01, 100.0))
    x = phase.state("x", start=0.0, end=10.0)
    v = phase.state("v", None, 2.0, start=0.0, end=0.0)
    u = phase.control("u", -1.0, 1.0)
    phase.derivative(x, v)
    phase.derivative(v, u)
    problem.minimise(phase.duration)
    return problem


def brachistochrone() -> ocp.Problem:
    problem = ocp.Problem("brachistochrone")
    phase = problem.phase(duration=(0.01, 100.0))
    x = phase.state("x", start=0.0, end=10.0)
    y = phase.state("y", start=0.0, end=5.0)
    v = phase.state("v", start=0.0)
    theta = phase.control("theta", 0.0, pi)
    phase.derivative(x, v * ca.sin(theta))
    phase.derivative(y, v * ca.cos(theta))
    phase.derivative(v, 9.80665 * ca.cos(theta))
    problem.minimise(phase.duration)
    return problem


def goddard() -> ocp.Problem:
    problem = ocp.Problem("goddard")
    phase = problem.phase(duration=(0.01, 10.0))
    h = phase.state("h", 1.0, None, start=1.0)
    v = phase.state("v", 0.0, None, start=0.0)
    m = phase.state("m", 0.6, 1.0, start=1.0, end=0.6)
    thrust = phase.control("T", 0.0, 3.5)
    drag = 310.0 * v**2 * ca.exp(-500.0 * (h - 1.0))
    phase.derivative(h, v)
    phase.derivative(v, (thrust - drag) / m - 1.0 / h**2)
    phase.derivative(m, -2.0 * thrust)
    problem.maximise(phase.final(h))
    return problem


def hypersensitive(start: float = 1.5, end: float = 1.0) -> ocp.Problem:
    problem = ocp.Problem("hypersensitive")
    phase = problem.phase(duration=10_000.0)
    x = phase.state("x", start=start, end=end)
    u = phase.control("u")
    phase.derivative(x, -(x**3) + u)
    problem.minimise(phase.integral(0.5 * (x**2 + u**2)))
    return problem


def robot_arm() -> ocp.Problem:
    problem = ocp.Problem("robot_arm")
    phase = problem.phase(duration=(0.1, 100.0))
    rho = phase.state("rho", start=4.5, end=4.5)
    rho_rate = phase.state("rho_rate", start=0.0, end=0.0)
    theta = phase.state("theta", start=0.0, end=2.0 * pi / 3.0)
    theta_rate = phase.state("theta_rate", start=0.0, end=0.0)
    phi = phase.state("phi", start=pi / 4.0, end=pi / 4.0)
    phi_rate = phase.state("phi_rate", start=0.0, end=0.0)
    u1, u2, u3 = (phase.control(name, -1.0, 1.0) for name in ("u1", "u2", "u3"))
    inertia = ((5.0 - rho) ** 3 + rho**3) / 3.0
    phase.derivative(rho, rho_rate)
    phase.derivative(rho_rate, u1 / 5.0)
    phase.derivative(theta, theta_rate)
    phase.derivative(theta_rate, u2 / (inertia * ca.sin(phi) ** 2))
    phase.derivative(phi, phi_rate)
    phase.derivative(phi_rate, u3 / inertia)
    problem.minimise(phase.duration)
    return problem


BENCHMARKS = (
    Benchmark("bryson_denham", bryson_denham, 4.0, 0.0, "Bryson, Ho 1975, 3.11"),
    Benchmark("double_integrator", double_integrator, 2.0, 0.0, "closed form"),
    Benchmark(
        "double_integrator_vmax", double_integrator_vmax, 7.0, 0.0, "closed form"
    ),
    Benchmark("brachistochrone", brachistochrone, 1.801603122453081, 1e-15, "cycloid"),
    Benchmark(
        "goddard",
        goddard,
        1.0128369183,
        1e-10,
        "closed-form singular feedback, integrated at 3e-14",
    ),
    Benchmark(
        "hypersensitive",
        hypersensitive,
        1.330806904943002,
        1e-15,
        "Hamilton-Jacobi-Bellman quadrature",
    ),
    Benchmark(
        "hypersensitive_reversed",
        lambda: hypersensitive(1.0, 1.5),
        3.362056904943002,
        1e-15,
        "Hamilton-Jacobi-Bellman quadrature",
    ),
    Benchmark(
        "robot_arm",
        robot_arm,
        9.140911745914961,
        1e-12,
        "symmetric bang-bang reduced to one unknown",
    ),
)
