"""Where a solve starts: along the reference, attitude and thrust from flatness."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.single_drone.model import POSITION, in_motion, input_names, state_names
from showc.trajectory import PiecewisePolynomial
from showc.vehicle.flatness import attitude_and_thrust
from showc.vehicle.motion import thrust_direction

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.flight import Trajectory
    from showc.ocp.guess import Guess


INSIDE = 0.9
"""Share of a limit at which the guess is cut off."""


def smooth_fraction(
    fraction: FloatArray, ramp: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rest-to-rest profile with cosine ramps of the speed.

    Parameters
    ----------
    fraction
        Time over the duration, 0 to 1.
    ramp
        Share of the duration spent speeding up, and slowing down; at most 0.5.

    Returns
    -------
    tuple of ndarray
        Fraction of the way, and its first and second derivative by ``fraction``.
    """
    peak = 1.0 / (1.0 - ramp)
    near = np.minimum(fraction, 1.0 - fraction)
    phase = np.pi * np.minimum(near / ramp, 1.0)
    speed = 0.5 * peak * (1.0 - np.cos(phase))
    slope = 0.5 * peak * np.pi / ramp * np.sin(phase)
    slope *= np.where(fraction < 0.5, 1.0, -1.0)
    inside = np.minimum(near, ramp)
    gone = 0.5 * peak * (inside - ramp / np.pi * np.sin(np.pi * inside / ramp))
    gone += peak * (near - inside)
    way = np.where(fraction <= 0.5, gone, 1.0 - gone)
    return way, speed, slope


def ramp_for(aircraft: Aircraft, displacement: FloatArray, duration: float) -> float:
    """Longest ramp of :func:`smooth_fraction` whose speed keeps the limits."""
    limits = aircraft.limits
    bound = np.where(displacement < 0.0, limits.velocity_min, limits.velocity_max)
    needed = float(np.max(np.abs(displacement) / np.abs(bound))) / duration
    return float(np.clip(1.0 - 1.02 * needed, 0.05, 0.5))


def along(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    times: FloatArray,
    reference: PiecewisePolynomial | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position [m], velocity and acceleration of the reference at ``times`` [s].

    Each of shape (times, 3). The reference is a shared profile (one component), a
    path (three), or ``None``: a smooth straight flight, with a swing from the motion
    that it leaves and into the one that it joins.
    """
    displacement = (goal - start)[:3]
    duration = float(times[-1])
    if reference is None:
        ramp = ramp_for(aircraft, displacement, duration)
        way, speed, slope = smooth_fraction(times / duration, ramp)
        values = (way, speed / duration, slope / duration**2)
    else:
        first = reference.derivative()
        values = (reference(times), first(times), first.derivative()(times))
        if reference.components == 3:
            return values
        values = tuple(value[:, 0] for value in values)  # type: ignore[assignment]
    found = np.stack([np.outer(value, displacement) for value in values])
    found[0] += start[:3]
    # At the goal time runs backwards, and velocities with it.
    found += _swing(aircraft, start, times)
    found += _swing(aircraft, goal, times - duration)
    return found[0], found[1], found[2]


_SWING = 2.0
"""Time in which a guess gains the velocity of a motion [s]: about that of speeding up.
"""


def _swing(aircraft: Aircraft, end: FloatArray, since: FloatArray) -> FloatArray:
    """Offset from a straight flight near an end (13,), and its derivatives, (3, n, 3).

    It has the end's velocity and acceleration there, and none a while away. Times
    ``since`` the end are negative where it is a goal [s].
    """
    if not in_motion(end):
        return np.zeros((3, since.size, 3))
    vehicle, time = aircraft.vehicle, min(_SWING, float(np.abs(since).max()))
    direction = np.array(thrust_direction(*end[6:9]))
    pull = end[-1] / vehicle.mass * direction - [0.0, 0.0, vehicle.gravity]
    sign = 1.0 if since[0] == 0.0 else -1.0
    way = np.zeros((1, 6, 3))
    way[0, 1] = sign * end[3:6] * time / 5.0
    way[0, 2] = 2.0 * way[0, 1] + pull * time**2 / 20.0
    offset = PiecewisePolynomial(np.array([0.0, time]), way)
    speed, at = offset.derivative(), np.minimum(np.abs(since), time)
    return np.stack([offset(at), sign * speed(at), speed.derivative()(at)])


def flat_guess(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    widths: FloatArray,
    reference: PiecewisePolynomial | None = None,
) -> Guess:
    """States and inputs of flying along the reference, cut off inside the limits."""
    times = np.concatenate([[0.0], np.cumsum(widths)])
    start, goal = aircraft.end(start), aircraft.end(goal)
    ends = np.stack([start, goal])
    position, velocity, acceleration = along(aircraft, start, goal, times, reference)
    roll, pitch, thrust = attitude_and_thrust(
        aircraft.vehicle, acceleration, aircraft.heading
    )
    limits = aircraft.limits
    tilt = INSIDE * limits.tilt
    angles = np.clip(np.stack([roll, pitch], axis=1), -tilt, tilt)
    angles[[0, -1]] = ends[:, 6:8]
    rates = np.gradient(angles, times, axis=0)
    bound = INSIDE * np.array(limits.body_rate[:2])
    rates = np.clip(rates, -bound, bound)
    rates[[0, -1]] = ends[:, 9:11]
    velocity = np.clip(
        velocity,
        INSIDE * np.array(limits.velocity_min),
        INSIDE * np.array(limits.velocity_max),
    )
    velocity[[0, -1]] = ends[:, 3:6]
    position[[0, -1]] = ends[:, :3]
    span = limits.thrust_max - limits.thrust_min
    room = 0.5 * (1.0 - INSIDE) * span
    thrust = np.clip(thrust, limits.thrust_min + room, limits.thrust_max - room)
    thrust[[0, -1]] = np.where(ends[:, -1] > 0.0, ends[:, -1], thrust[[0, -1]])
    states = [position, velocity, angles]
    if aircraft.yaw == "free":
        states.append(np.full((times.size, 1), aircraft.heading))
    states.append(rates)
    if aircraft.yaw == "free":
        states.append(np.zeros((times.size, 1)))
    turning = np.zeros((widths.size, len(input_names(aircraft)) - 1))
    return _guess(aircraft, times, np.hstack(states), thrust, turning)


def flown_guess(
    aircraft: Aircraft, trajectory: Trajectory, widths: FloatArray
) -> Guess:
    """States and inputs of an earlier flight, on other intervals.

    The flight is stretched to the duration of the intervals.
    """
    names = state_names(aircraft)
    order = {
        name: index
        for index, name in enumerate(
            (*POSITION, "vx", "vy", "vz", "roll", "pitch", "yaw", "p", "q", "r")
        )
    }
    stretch = trajectory.state.end / float(widths.sum())
    borders = np.concatenate([[0.0], np.cumsum(widths)])
    times = borders * stretch
    columns = [order[name] for name in names if name in order]
    states = trajectory.state(times)[:, columns]
    for index, name in enumerate(names):
        if name.startswith("v") or name in {"p", "q", "r"}:
            states[:, index] *= stretch
    rates = [names.index(rate) for rate in ("p", "q", "r") if rate in names]
    thrust = trajectory.control(times)[:, 0]
    turning = np.diff(states[:, rates], axis=0) / widths[:, None]
    return _guess(aircraft, borders, states, thrust, turning)


def _guess(
    aircraft: Aircraft,
    borders: FloatArray,
    states: FloatArray,
    thrust: FloatArray,
    turning: FloatArray,
) -> Guess:
    """States and thrust at the borders (K + 1), accelerations on the intervals (K)."""
    from showc.ocp.guess import Curve, Data, Guess  # noqa: PLC0415 - loads casadi

    inputs = [np.stack([thrust[:-1], thrust[1:]], axis=1)]
    if aircraft.limits.jerk:
        states = np.column_stack([states, thrust])
        inputs = [(np.diff(thrust) / np.diff(borders))[:, None]]
    curves: dict[str, Curve] = {
        name: Data(borders, states[:, k])
        for k, name in enumerate(state_names(aircraft))
    }
    inputs += [np.stack([column, column], axis=1) for column in turning.T]
    for name, table in zip(input_names(aircraft), inputs, strict=True):
        curves[name] = PiecewisePolynomial(borders, table[:, :, None])
    return Guess(curves, {"leg": float(borders[-1])})
