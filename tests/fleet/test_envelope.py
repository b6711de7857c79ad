"""Flights within an autopilot's envelope: kept at every instant, upright at both ends.

What is flown is worked out here from thrust and attitude, not from the polynomials of
the velocity that the planner bounds.
"""

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest
from fleet.handmade import LIMITS, VEHICLE, make_leg, make_options, make_show
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.errors import SolveError
from showc.fleet import solve_leg
from showc.fleet.execution.pool import InProcess
from showc.fleet.lower_bound.bound import lower_bound
from showc.fleet.lower_bound.relaxation import Relaxation
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.fleet.single_drone.audit import greatest_excess
from showc.fleet.single_drone.following import follow
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.shortest import minimum_time
from showc.fleet.single_drone.spline import follow_spline
from showc.fleet.single_drone.vertical import (
    fly_upright,
    quickest_ascent,
    vertical_accelerations,
)
from showc.progress import Silent
from showc.vehicle import PRESETS, Separation
from showc.vehicle.motion import thrust_direction

ENVELOPE = PRESETS["formation-625g"].envelope
HOVER = VEHICLE.hover_thrust
TIGHT = {
    "the preset's": ENVELOPE.within(LIMITS),
    "little tilt, thrust near hover": ENVELOPE.within(
        replace(
            LIMITS,
            tilt=radians(12.0),
            thrust_min=0.8 * HOVER,
            thrust_max=1.2 * HOVER,
        )
    ),
    "level alone": replace(LIMITS, acceleration=2.0, level_speed=4.0),
    "upright alone": replace(LIMITS, acceleration_up=1.0, acceleration_down=0.7),
    "the preset's and jerk": replace(ENVELOPE.within(LIMITS), jerk=15.0),
    "jerk alone": replace(LIMITS, jerk=30.0),
}


def flown(trajectory):
    """Velocity and acceleration that thrust and attitude give, each (m, 3)."""
    times = np.linspace(0.0, trajectory.state.end, 6001)
    state, control = trajectory.state(times), trajectory.control(times)
    direction = np.stack(thrust_direction(*state[:, 6:9].T), axis=-1)
    acceleration = control[:, :1] / VEHICLE.mass * direction
    acceleration[:, 2] -= VEHICLE.gravity
    return state[:, 3:6], acceleration


def assert_within(trajectory, limits):
    velocity, acceleration = flown(trajectory)
    level = np.hypot(acceleration[:, 0], acceleration[:, 1])
    assert level.max() <= (limits.acceleration or np.inf) * (1.0 + 1e-3)
    up, down = limits.acceleration_up, limits.acceleration_down
    assert acceleration[:, 2].max() <= (up or np.inf) * (1.0 + 1e-3)
    assert -acceleration[:, 2].min() <= (down or np.inf) * (1.0 + 1e-3)
    if limits.jerk:
        # Mean jerk from sample to sample: a thrust that jumps has a great one.
        step = trajectory.state.end / (acceleration.shape[0] - 1)
        jerk = np.linalg.norm(np.diff(acceleration, axis=0), axis=1) / step
        assert jerk.max() <= limits.jerk * (1.0 + 1e-6)
        # At rest at both ends, whatever comes before and after.
        assert np.abs(acceleration[[0, -1]]).max() < 1e-9
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    assert speed.max() <= (limits.level_speed or np.inf) + 1e-6


@cache
def free_time(way):
    """Least time of a move without an envelope [s]."""
    start = np.array([0.0, 0.0, 50.0])
    return minimum_time(
        Aircraft(VEHICLE, LIMITS, "held", 0.3), start, start + way
    ).duration


@pytest.mark.parametrize("limits", list(TIGHT.values())[:-1], ids=list(TIGHT)[:-1])
@pytest.mark.parametrize("way", [(12.0, 0.0, 0.0), (7.0, -9.0, 4.0), (3.0, 3.0, -6.0)])
def test_every_kind_of_flight_keeps_the_envelope_and_none_beats_the_bound(limits, way):
    aircraft, way = Aircraft(VEHICLE, limits, "held", 0.3), np.array(way)
    start = np.array([0.0, 0.0, 50.0])
    least = minimum_time(aircraft, start, start + way)
    assert least.solved, least.message
    assert_within(least.trajectory, limits)
    bound = lower_bound(
        Relaxation(VEHICLE, limits, "held", 0.3), 0, way, least.duration
    )
    near = 0.94 if limits.jerk else 0.97
    assert near * least.duration < bound.time <= least.duration
    assert least.duration > free_time(tuple(way))

    shared = shared_profile(VEHICLE, limits, 0.3, start[None], (start + way)[None])
    assert shared.duration >= least.duration
    longer = shared.stretched(1.1 * least.duration)
    spline = follow_spline(
        aircraft, start, start + way, longer.derivatives()[0], intervals=40
    )
    followed = follow(
        aircraft,
        start,
        start + way,
        longer.duration,
        reference=longer.derivatives()[0],
    )
    assert followed.solved
    assert_within(followed.trajectory, limits)
    if spline is not None:
        assert_within(spline.flight.trajectory(0), limits)


@pytest.mark.parametrize("jerk", [0.0, 15.0])
def test_a_yaw_that_is_free_keeps_the_envelope_too(jerk):
    limits = replace(TIGHT["the preset's"], jerk=jerk)
    aircraft = Aircraft(VEHICLE, limits, "free")
    start, goal = np.array([0.0, 0.0, 50.0]), np.array([6.0, 8.0, 53.0])
    least = minimum_time(aircraft, start, goal)
    assert least.solved, least.message
    assert_within(least.trajectory, limits)


@pytest.mark.parametrize("stretch", [1.0, 1.03])
def test_a_flight_whose_yaw_stands_still_keeps_the_jerk_of_one_that_may_turn(stretch):
    limits = replace(LIMITS, jerk=12.0, tilt=0.3)
    aircraft = Aircraft(VEHICLE, limits, "free", 0.5 * np.pi)
    start, goal = np.array([0.0, 0.0, 18.0]), np.array([-15.0, 13.0, 8.0])
    shared = shared_profile(VEHICLE, limits, aircraft.heading, start[None], goal[None])
    profile = shared.stretched(stretch * shared.duration).derivatives()[0]
    spline = follow_spline(aircraft, start, goal, profile, intervals=40)
    trajectory = spline.flight.trajectory(0)
    assert_within(trajectory, limits)
    assert greatest_excess(aircraft, trajectory).relative <= 1e-6


def solve(leg, **show):
    show = make_show(leg.drones.size, **show)
    return solve_leg(leg, show, make_options(), InProcess(), Silent())


PADS = np.array([(3.0 * x, 3.0 * y, 0.0) for x in range(3) for y in range(2)])


@pytest.mark.parametrize("kind", ["launch", "land"])
@pytest.mark.parametrize("limits", TIGHT.values(), ids=TIGHT)
def test_launch_and_landing_hold_x_and_y_under_any_limits(kind, limits):
    limits = limits.upright(2.0)
    high = PADS + [0.0, 0.0, 12.0]
    ends = (PADS, high) if kind == "launch" else (high, PADS)
    flight = solve(make_leg(*ends, kind=kind, limits=limits))
    for row, trajectory in enumerate(flight.trajectories):
        state = trajectory.state.coefficients
        assert np.all(state[..., :2] == ends[0][row, :2])
        assert np.all(state[..., [3, 4, 6, 7, 9, 10, 11]] == 0.0)
        assert np.all(trajectory.control.coefficients[..., 1:] == 0.0)
        _, acceleration = flown(trajectory)
        derived = trajectory.state.select([5]).derivative()
        times = np.linspace(0.0, flight.duration, 6001)
        assert np.median(np.abs(acceleration[:, 2] - derived(times)[:, 0])) < 1e-9
        assert_within(trajectory, limits)
    certificate = flight.certificate
    assert certificate.dual_bound <= certificate.single_drone_minimum
    near = 0.965 if limits.jerk else 0.995
    assert certificate.dual_bound > near * certificate.single_drone_minimum
    assert flight.duration < certificate.single_drone_minimum + 1e-3


@pytest.mark.parametrize("kind", ["launch", "land"])
@pytest.mark.parametrize("speed", [0.1, 0.3, 2.0])
def test_a_bound_that_is_not_found_is_not_claimed(kind, speed):
    high = PADS + [0.0, 0.0, 10.0]
    ends = (PADS, high) if kind == "launch" else (high, PADS)
    leg = make_leg(*ends, kind=kind, limits=LIMITS.upright(speed))
    certificate = solve(leg).certificate
    assert (certificate.witness is None) == (certificate.dual_bound == 0.0)
    assert speed < 1.0 or certificate.dual_bound > 0.0


def test_pads_at_different_heights_launch_on_one_profile():
    limits = TIGHT["the preset's"].upright(3.0)
    start = PADS + np.array([[0, 0, h] for h in (0.0, 1.0, 2.0, 0.5, 0.0, 3.0)])
    goal = np.array([*PADS.T[:2], np.full(6, 10.0)]).T
    flight = solve(make_leg(start, goal, kind="launch", limits=limits))
    for trajectory in flight.trajectories:
        assert_within(trajectory, limits)
        velocity, _ = flown(trajectory)
        assert velocity[:, 2].max() <= 3.0 + 1e-9


def test_the_quickest_ascent_is_bang_and_brake():
    aircraft = Aircraft(VEHICLE, replace(LIMITS, thrust_min=0.8 * HOVER).upright(50.0))
    up, down = vertical_accelerations(aircraft)
    assert down == pytest.approx(0.2 * VEHICLE.gravity)
    height = 1.0
    ascent = quickest_ascent(aircraft, np.array([height]))
    assert ascent.cruise == 0.0
    push, brake = ascent.push.duration, ascent.brake.duration
    assert up * push == pytest.approx(down * brake)
    risen = 0.5 * up * push**2 + 0.5 * down * brake**2
    assert risen == pytest.approx(height)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(st.floats(-30.0, 30.0), min_size=1, max_size=4).filter(
        lambda ways: max(map(abs, ways)) > 0.5
    ),
    *(st.floats(*ends) for ends in ((2.0, 200.0), (0.5, 6.0), (0.5, 6.0), (0.5, 8.0))),
)
def test_an_ascent_keeps_jerk_and_no_limit_is_left_unused(ways, jerk, up, down, speed):
    limits = replace(
        LIMITS, jerk=jerk, acceleration_up=up, acceleration_down=down
    ).upright(speed)
    aircraft, ways = Aircraft(VEHICLE, limits), np.array(ways)
    ascent = quickest_ascent(aircraft, ways)
    start = np.tile([0.0, 0.0, 50.0], (ways.size, 1))
    goal = start + ways[:, None] * [0.0, 0.0, 1.0]
    flights = fly_upright(aircraft, start, goal, ascent)
    for flight in flights:
        assert_within(flight, limits)
        assert greatest_excess(aircraft, flight).relative <= 1e-9
    # A little sooner, and some drone breaks a limit.
    sooner = ascent.stretched(0.999 * ascent.duration)
    flights = fly_upright(aircraft, start, goal, sooner)
    assert max(greatest_excess(aircraft, one).relative for one in flights) > 1e-4
    free = quickest_ascent(replace(aircraft, limits=replace(limits, jerk=0.0)), ways)
    assert free.duration < ascent.duration


def test_a_short_ascent_is_the_triple_integrator():
    aircraft = Aircraft(VEHICLE, replace(LIMITS, jerk=4.0).upright(50.0))
    ascent = quickest_ascent(aircraft, np.array([0.5]))
    # Rest to rest of the acceleration too: least time (32 d / j)^(1/3).
    assert ascent.duration == pytest.approx((32.0 * 0.5 / 4.0) ** (1.0 / 3.0))


def test_pads_above_each_other_are_refused_with_the_pair():
    start = np.array([(0.0, 0.0, 0.0), (0.4, 0.0, 3.0)])
    goal = np.array([(0.0, 0.0, 12.0), (0.4, 0.0, 8.0)])
    leg = make_leg(start, goal, kind="launch", limits=LIMITS.upright(2.0))
    with pytest.raises(SolveError, match=r"drone 1 and drone 2 come within 0\.4"):
        solve(leg, separation=Separation(1.0))


def test_a_leg_says_what_the_airframe_alone_would_need():
    limits = TIGHT["the preset's"]
    start = PADS + [0.0, 0.0, 10.0]
    leg = make_leg(start, start + [20.0, 5.0, 3.0], limits=limits)
    show = make_show(6)
    show.airframe_limits = LIMITS
    flight = solve_leg(leg, show, make_options(), InProcess(), Silent())
    alone = flight.certificate.statistics["airframe_bound"]
    free = minimum_time(Aircraft(VEHICLE, LIMITS), start[0], leg.goal[0])
    assert 0.98 * free.duration < alone <= free.duration < flight.duration


def test_a_leg_says_what_its_limit_of_jerk_may_cost():
    limits = replace(LIMITS, jerk=10.0).upright(3.0)
    flight = solve(make_leg(PADS, PADS + [0.0, 0.0, 9.0], kind="launch", limits=limits))
    alone = flight.certificate.statistics["airframe_bound"]
    free = quickest_ascent(
        Aircraft(VEHICLE, replace(limits, jerk=0.0)), np.array([9.0])
    ).duration
    assert 0.99 * free < alone <= free < flight.certificate.dual_bound
