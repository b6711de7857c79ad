"""Straight flights and splines: they obey the equations of motion and every limit."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from fleet.handmade import LIMITS, VEHICLE
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from showc.fleet.shared_profile.flat import keeps_limits, use_of_limits
from showc.fleet.shared_profile.profile import Profile
from showc.fleet.shared_profile.straight import fly_straight
from showc.fleet.shared_profile.synchronise import best_profile, shared_profile
from showc.fleet.single_drone.convex_program import Walls
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.spline import follow_spline

SHAPES = st.tuples(st.floats(0.02, 0.5), st.floats(0.05, 0.5), st.floats(1.0, 60.0))


def fly_open_loop(trajectory, vehicle):
    """Integrate the controls from hover with a method and equations of its own."""
    ix, iy, iz = vehicle.inertia
    arm = vehicle.torque_factor

    def motion(time, x, control):
        thrust, roll, pitch, yaw = control(time)
        (phi, theta, psi), (p, q, r) = x[6:9], x[9:12]
        a = thrust / vehicle.mass
        return np.array(
            [
                *x[3:6],
                a
                * (
                    np.cos(phi) * np.sin(theta) * np.cos(psi)
                    + np.sin(phi) * np.sin(psi)
                ),
                a
                * (
                    np.cos(phi) * np.sin(theta) * np.sin(psi)
                    - np.sin(phi) * np.cos(psi)
                ),
                a * np.cos(phi) * np.cos(theta) - vehicle.gravity,
                p,
                q,
                r,
                arm * roll / ix + (iy - iz) / ix * q * r,
                arm * pitch / iy + (iz - ix) / iy * p * r,
                yaw / iz + (ix - iy) / iz * p * q,
            ]
        )

    state = trajectory.state(0.0)
    breaks = trajectory.state.breaks
    worst = 0.0
    for k, (left, right) in enumerate(pairwise(breaks)):
        piece = type(trajectory.control)(
            breaks[k : k + 2], trajectory.control.coefficients[k : k + 1]
        )
        answer = solve_ivp(
            lambda t, x, piece=piece: motion(t, x, piece),
            (left, right),
            state,
            rtol=1e-10,
            atol=1e-11,
        )
        state = answer.y[:, -1]
        worst = max(worst, float(np.abs(state - trajectory.state(right))[:3].max()))
    return worst, state


@settings(max_examples=60, deadline=None)
@given(shape=SHAPES)
def test_a_profile_runs_from_rest_to_rest_within_its_own_bounds(shape):
    phase, ramp, duration = shape
    profile = Profile(duration, phase * duration, phase * ramp * duration)
    way, speed, second = profile.derivatives()
    assert way(0.0)[0] == 0.0 and way(duration)[0] == 1.0
    assert speed(0.0)[0] == 0.0 and speed(duration)[0] == 0.0
    assert way.breaks[-1] == duration
    times = np.linspace(0.0, duration, 2001)
    assert np.all(np.diff(way(times)[:, 0]) >= -1e-12)
    assert speed(times).max() == pytest.approx(profile.speed, rel=1e-3)
    assert np.abs(second(times)).max() == pytest.approx(profile.acceleration, rel=1e-2)
    jerk, snap = second.derivative(), second.derivative().derivative()
    assert np.abs(jerk.coefficients).max() == pytest.approx(profile.jerk)
    assert np.abs(snap.coefficients).max() == pytest.approx(profile.snap, rel=1e-6)
    # Continuous up to s''', and each the derivative of the one before.
    for curve in (way, speed, second, jerk):
        ends, starts = curve.coefficients[:-1, -1], curve.coefficients[1:, 0]
        size = np.abs(curve.coefficients).max()
        assert np.abs(ends - starts).max() < 1e-9 * size
    assert np.allclose(way.derivative()(times), speed(times), atol=1e-9 * profile.speed)


@pytest.mark.parametrize("heading", [0.0, 2.2])
def test_the_shared_profile_is_flown_to_a_tenth_of_a_millimetre(heading):
    start = np.array([[0.0, 0.0, 5.0], [3.0, 0.0, 5.0]])
    goal = np.array([[20.0, 14.0, 15.0], [1.0, 9.0, 4.0]])
    profile = shared_profile(VEHICLE, LIMITS, heading, start, goal)
    flights = fly_straight(VEHICLE, heading, start, goal, profile)
    assert keeps_limits(VEHICLE, LIMITS, flights).all()
    for row in range(2):
        trajectory = flights.trajectory(row)
        worst, final = fly_open_loop(trajectory, VEHICLE)
        assert worst < 1e-4
        assert np.abs(final[:3] - goal[row]).max() < 1e-4
        assert final[8] == pytest.approx(heading, abs=1e-6)


def test_rates_do_not_jump_on_ramps_of_milliseconds():
    """Rounding of third differences would turn a long leg off its way."""
    start, goal = np.array([[40.0, -30.0, 5.0]]), np.array([[-25.0, 37.0, 66.0]])
    profile = Profile(duration=20.0, phase=2.0, ramp=0.02)
    flights = fly_straight(VEHICLE, 0.0, start, goal, profile)
    jumps = np.abs(flights.state[:, 1:, 0] - flights.state[:, :-1, -1])
    assert jumps[..., 6:].max() < 1e-11


def test_the_shared_profile_cannot_be_much_faster():
    start, goal = np.zeros((1, 3)), np.array([[20.0, 14.0, 10.0]])
    profile = shared_profile(VEHICLE, LIMITS, 0.0, start, goal)
    faster = fly_straight(
        VEHICLE, 0.0, start, goal, profile.stretched(0.98 * profile.duration)
    )
    assert not keeps_limits(VEHICLE, LIMITS, faster).any()


def test_the_best_profile_serves_most_drones():
    rng = np.random.default_rng(4)
    way = rng.uniform(-20.0, 20.0, (60, 3))
    shared = shared_profile(VEHICLE, LIMITS, 0.0, np.zeros((60, 3)), way)
    profile, fits = best_profile(VEHICLE, LIMITS, 0.0, way, 0.95 * shared.duration)
    high = np.full((60, 3), 50.0)
    flights = fly_straight(VEHICLE, 0.0, high, high + way, profile)
    assert 40 < fits.sum() < 60
    assert np.array_equal(fits, keeps_limits(VEHICLE, LIMITS, flights))


@pytest.mark.parametrize("broken", ["tilt", "velocity", "rate", "thrust", "volume"])
def test_every_limit_is_noticed(broken):
    start, goal = np.zeros((1, 3)), np.array([[20.0, 14.0, 10.0]])
    profile = shared_profile(VEHICLE, LIMITS, 0.0, start, goal).stretched(9.0)
    flights = fly_straight(VEHICLE, 0.0, start, goal, profile)
    assert keeps_limits(VEHICLE, LIMITS, flights).all()
    tight = {
        "tilt": {"tilt": 0.1},
        "velocity": {"velocity_max": (5.0, 1.0, 5.0)},
        "rate": {"body_rate": (1.7, 0.05, 1.7)},
        "thrust": {"thrust_min": 6.1},
        "volume": {"position_max": (200.0, 13.9, 200.0)},
    }[broken]
    limits = replace(LIMITS, **tight)
    assert not keeps_limits(VEHICLE, limits, flights).any()
    assert use_of_limits(VEHICLE, limits, flights).greatest[0] > 1.0


def test_a_spline_is_flown_to_a_tenth_of_a_millimetre_faster_than_straight():
    aircraft = Aircraft(VEHICLE, LIMITS, "held", 0.7)
    start, goal = np.array([0.0, 0.0, 10.0]), np.array([30.0, 20.0, 20.0])
    straight = shared_profile(VEHICLE, LIMITS, 0.7, start[None], goal[None])
    profile = straight.stretched(0.95 * straight.duration)
    found = follow_spline(aircraft, start, goal, profile.derivatives()[0], 32)
    assert found is not None
    assert keeps_limits(VEHICLE, LIMITS, found.flight).all()
    worst, final = fly_open_loop(found.flight.trajectory(0), VEHICLE)
    assert worst < 1e-4
    assert np.abs(final[:3] - goal).max() < 1e-4


def test_a_spline_keeps_its_walls_at_every_instant():
    aircraft = Aircraft(VEHICLE, LIMITS)
    start, goal = np.array([0.0, 0.0, 10.0]), np.array([20.0, 0.0, 10.0])
    profile = shared_profile(VEHICLE, LIMITS, 0.0, start[None], goal[None])
    reference = profile.stretched(7.0).derivatives()[0]
    interval = np.array([11, 12])
    turning = np.array([[0.0, 0.8, 0.6], [0.0, 1.0, 0.0], [0.0, 0.8, -0.6]])
    walls = Walls(
        interval,
        np.stack([turning[:-1], turning[1:]], axis=1),
        np.tile([7.0, 6.0, 3.0, 1.5, 3.0, 1.0, 1.0], (2, 1)),
    )
    found = follow_spline(aircraft, start, goal, reference, 24, walls)
    assert found is not None
    for row, k in enumerate(interval):
        s = np.linspace(0.0, 1.0, 200)
        times = found.breaks[k] + s * (found.breaks[k + 1] - found.breaks[k])
        position = found.flight.trajectory(0).state(times)[:, :3]
        normal = (1 - s)[:, None] * turning[row] + s[:, None] * turning[row + 1]
        basis = np.stack(
            [
                c * s**j * (1 - s) ** (6 - j)
                for j, c in enumerate([1, 6, 15, 20, 15, 6, 1])
            ],
            axis=1,
        )
        offset = basis @ walls.offset[row]
        assert np.min(np.einsum("ij,ij->i", normal, position) - offset) > -1e-3


def test_no_time_no_spline():
    aircraft = Aircraft(VEHICLE, LIMITS)
    start, goal = np.zeros(3), np.array([20.0, 0.0, 0.0])
    profile = shared_profile(VEHICLE, LIMITS, 0.0, start[None], goal[None])
    short = profile.stretched(3.9).derivatives()[0]
    assert follow_spline(aircraft, start, goal, short, 24) is None
