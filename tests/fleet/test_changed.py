"""Changed flights in closed form: exactly the sum, or none."""

from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import LIMITS, VEHICLE

from showc.fleet.deconfliction.changed import fly_changed
from showc.fleet.shared_profile.flat import JOINT
from showc.fleet.shared_profile.profile import Profile
from showc.fleet.shared_profile.straight import fly_straight
from showc.fleet.single_drone.audit import greatest_excess
from showc.fleet.single_drone.basis import DEGREE, LOCAL, spline_basis
from showc.fleet.single_drone.judgement import KEPT
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.replay import replay
from showc.fleet.single_drone.spline import follow_spline
from showc.trajectory import PiecewisePolynomial

INTERVALS, DURATION = 20, 6.0


def bump(size):
    """Return a hump in y that begins and ends at rest, its jerk too: (1, K, 6, 3)."""
    whole = np.zeros(INTERVALS + DEGREE)
    whole[8:-8] = size
    local = whole[np.arange(INTERVALS)[:, None] + np.arange(LOCAL)]
    change = np.zeros((1, INTERVALS, LOCAL, 3))
    basis = spline_basis(INTERVALS, DURATION)
    change[0, :, :, 1] = np.einsum("kij,kj->ki", basis.position, local)
    return change


@pytest.fixture(scope="module")
def aircraft():
    return Aircraft(VEHICLE, LIMITS, "held", 0.0)


@pytest.fixture(scope="module")
def straight(aircraft):
    ends = np.array([[0.0, 0.0, 20.0]]), np.array([[10.0, 3.0, 21.0]])
    profile = Profile(DURATION, 2.7, 1.1)
    flights = fly_straight(aircraft.vehicle, aircraft.heading, *ends, profile)
    return flights.trajectory(0)


def test_a_changed_flight_is_the_sum_and_keeps_what_a_flight_must(aircraft, straight):
    change = bump(0.3)
    (found,) = fly_changed(aircraft, [straight.state], change)
    assert found is not None
    at = np.linspace(0.0, DURATION, 501)
    even = PiecewisePolynomial(np.linspace(0.0, DURATION, INTERVALS + 1), change[0])
    np.testing.assert_allclose(
        found.state(at)[:, :3], straight.state(at)[:, :3] + even(at), atol=1e-11
    )
    assert greatest_excess(aircraft, found).relative <= KEPT
    assert replay(aircraft.vehicle, (found,)).position.max() < 5e-4
    again = fly_changed(aircraft, [found.state], -change)[0]
    np.testing.assert_allclose(
        again.state(at)[:, :3], straight.state(at)[:, :3], atol=1e-10
    )


def test_a_change_beyond_the_limits_is_not_flown(aircraft, straight):
    assert fly_changed(aircraft, [straight.state], bump(30.0)) == [None]


@pytest.mark.parametrize("last", [0.02, 0.004])
def test_a_changed_flight_hovers_at_its_ends(aircraft, straight, last):
    far = np.array([70.0, -50.0, 90.0])
    split = straight.state.split([last, DURATION - last])
    moved = split.coefficients + np.append(far, np.zeros(9))
    flight = replace(straight, state=PiecewisePolynomial(split.breaks, moved))
    (found,) = fly_changed(aircraft, [flight.state], bump(0.3))
    assert found is not None
    ends = found.state.coefficients[[0, -1], [0, -1]]
    assert np.abs(ends[:, 3:]).max() < JOINT


def test_a_spline_that_leaps_off_is_changed_as_accurately(aircraft):
    start, goal = np.array([0.0, 0.0, 20.0]), np.array([6.0, 0.0, 26.0])
    even = np.linspace(0.0, DURATION, 7)
    late = np.clip(even / DURATION - 0.1, 0.0, 0.8)[:, None] * (goal - start) + start
    reference = PiecewisePolynomial(even, np.stack([late[:-1], late[1:]], axis=1))
    spline = follow_spline(aircraft, start, goal, reference, INTERVALS)
    flight = spline.flight.trajectory(0)
    leap = flight.state.select(slice(3, 6)).derivative()(0.0)
    assert abs(leap[2]) > 1e-2
    (found,) = fly_changed(aircraft, [flight.state], bump(0.3))
    assert found is not None
    assert replay(aircraft.vehicle, (found,)).position.max() < 1e-6
