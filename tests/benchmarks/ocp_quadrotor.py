"""A quadrotor from hover to hover in least time, as a general problem."""

from __future__ import annotations

from math import pi, radians

import casadi as ca
import numpy as np

from showc import ocp

MASS, GRAVITY = 0.625, 9.80665
INERTIA = 2.3e-3, 2.4e-3, 2.6e-3


def quadrotor(*, yaw_free: bool) -> ocp.Problem:
    """State it with box limits on controls, velocity, tilt and body rates."""
    problem = ocp.Problem("quadrotor")
    phase = problem.phase("flight", duration=(0.5, 60.0))
    tilt = radians(20.0)
    x, y, z = (
        phase.state(name, start=0.0, end=end, scale=10.0)
        for name, end in zip("xyz", (30.0, 20.0, 10.0), strict=True)
    )
    vx, vy, vz = (
        phase.state(name, -5.0, 5.0, start=0.0, end=0.0) for name in ("vx", "vy", "vz")
    )
    roll, pitch = (
        phase.state(name, -tilt, tilt, start=0.0, end=0.0) for name in ("roll", "pitch")
    )
    p, q = (phase.state(name, -1.7, 1.7, start=0.0, end=0.0) for name in "pq")
    thrust = phase.control("thrust", 0.0, 21.03, degree=1)
    torque_x, torque_y = (
        phase.control(name, -0.67, 0.67, degree=1) for name in ("torque_x", "torque_y")
    )
    ix, iy, iz = INERTIA
    yaw, r = 0.0, 0.0
    if yaw_free:
        yaw = phase.state("yaw", -pi, pi, start=0.0)
        r = phase.state("r", -1.7, 1.7, start=0.0, end=0.0)
        torque_z = phase.control("torque_z", -0.105, 0.105, degree=1)
        phase.derivative(yaw, r)
        phase.derivative(r, torque_z / iz + (ix - iy) / iz * p * q)
    for position, velocity in ((x, vx), (y, vy), (z, vz)):
        phase.derivative(position, velocity)
    a = thrust / MASS
    lateral = ca.cos(roll) * ca.sin(pitch)
    phase.derivative(vx, a * (lateral * ca.cos(yaw) + ca.sin(roll) * ca.sin(yaw)))
    phase.derivative(vy, a * (lateral * ca.sin(yaw) - ca.sin(roll) * ca.cos(yaw)))
    phase.derivative(vz, a * ca.cos(roll) * ca.cos(pitch) - GRAVITY)
    phase.derivative(roll, p)
    phase.derivative(pitch, q)
    phase.derivative(p, torque_x / ix + (iy - iz) / ix * q * r)
    phase.derivative(q, torque_y / iy + (iz - ix) / iy * p * r)
    problem.minimise(phase.duration)
    return problem


def solve_quadrotor(*, yaw_free: bool) -> ocp.Solution:
    """Solve once on a mesh that is fine in the first and last 30 % of the time."""
    breaks = np.concatenate(
        [
            np.linspace(0.0, 0.3, 25)[:-1],
            np.linspace(0.3, 0.7, 6)[:-1],
            np.linspace(0.7, 1.0, 25),
        ]
    )
    mesh = ocp.Mesh((ocp.PhaseMesh.from_breaks(breaks, [3] * (breaks.size - 1)),))
    built = ocp.Transcription(
        quadrotor(yaw_free=yaw_free),
        mesh,
        scales={"flight.duration": 7.0},
        options=ocp.SolverOptions(
            tolerance=1e-6,
            extra={"mu_strategy": "monotone", "mu_linear_decrease_factor": 0.1},
        ),
    )
    guess = ocp.Guess(curves={"thrust": MASS * GRAVITY}, durations={"flight": 8.0})
    return built.solve(guess=guess)
