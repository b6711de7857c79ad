"""The dual bound: never above a flight that exists, and near the best ones."""

from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import LIMITS, VEHICLE
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.fleet.lower_bound import bound
from showc.fleet.lower_bound.bound import lower_bound, surplus
from showc.fleet.lower_bound.relaxation import Relaxation
from showc.fleet.lower_bound.relaxed_move import RelaxedMove
from showc.fleet.shared_profile.straight import fly_straight
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.vertical import quickest_ascent
from showc.vehicle.motion import thrust_direction


def relaxation(**changes):
    return Relaxation(VEHICLE, replace(LIMITS, **changes))


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_support_is_the_greatest_over_all_attitudes_and_thrusts(seed):
    rng = np.random.default_rng(seed)
    heading = float(rng.uniform(-4.0, 4.0))
    cap = rng.uniform(0.0, 1.3, 2)
    multiplier = rng.normal(size=3)
    held = Relaxation(VEHICLE, replace(LIMITS, thrust_min=2.0), "held", heading)
    floor = -rng.uniform(0.0, 1.3, 2)
    span = list(zip(floor, cap, strict=True))
    (support,) = held.thrust_supports(multiplier, *span)
    phi, theta = np.meshgrid(*(np.linspace(*side, 81) for side in span))
    body = np.stack(
        [np.cos(phi) * np.sin(theta), -np.sin(phi), np.cos(phi) * np.cos(theta)], -1
    )
    c, s = np.cos(heading), np.sin(heading)
    turned = body @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    least, most = held.specific_thrust
    values = np.stack([most * turned @ multiplier, least * turned @ multiplier])
    assert support >= values.max() - 1e-9
    assert support <= values.max() + 2e-3 * most
    free = Relaxation(VEHICLE, replace(LIMITS, thrust_min=2.0), "free")
    assert free.thrust_supports(multiplier, *span)[0] >= support - 1e-9


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), yaw=st.sampled_from(["held", "free"]))
def test_support_within_an_envelope_is_the_greatest_over_what_keeps_it(seed, yaw):
    rng = np.random.default_rng(seed)
    cap, multiplier = rng.uniform(0.0, 0.8, 2), rng.normal(size=3)
    floor = np.where(rng.random(2) < 0.3, rng.uniform(0.0, cap), -rng.uniform(0.0, 0.8))
    level, up, down = rng.uniform(0.5, 6.0, 3)
    limits = replace(
        LIMITS, acceleration=level, acceleration_up=up, acceleration_down=down
    )
    relaxed = Relaxation(VEHICLE, limits, yaw, 0.4)
    supports = relaxed.thrust_supports(multiplier, *zip(floor, cap, strict=True))
    size = 40_000
    roll, pitch = (rng.uniform(*side, size) for side in zip(floor, cap, strict=True))
    edge = rng.random((2, size))
    pitch = np.where(edge[0] < 0.25, cap[1], np.where(edge[0] < 0.5, floor[1], pitch))
    roll = np.where(edge[1] < 0.25, cap[0], np.where(edge[1] < 0.5, floor[0], roll))
    heading = 0.4 if yaw == "held" else rng.uniform(-np.pi, np.pi, size)
    body = np.stack(thrust_direction(roll, pitch, heading), axis=-1)
    most = relaxed.specific_thrust[1]
    low = (VEHICLE.gravity - down) / body[:, 2]
    high = np.minimum((VEHICLE.gravity + up) / body[:, 2], most)
    high = np.minimum(high, level / np.maximum(np.hypot(body[:, 0], body[:, 1]), 1e-9))
    thrust = np.where(rng.random(size) < 0.5, high, low)[:, None] * body
    thrust = thrust[(low <= high) & (low >= relaxed.specific_thrust[0])]
    reached = (thrust @ multiplier).max(initial=-np.inf)
    assert reached <= min(supports) + 1e-9
    if yaw == "held" and (floor <= 0.0).all():
        # And it is no loose superset.
        assert reached >= min(supports) - 0.15 * np.linalg.norm(multiplier) * level


@settings(max_examples=10, deadline=None)
@given(
    way=st.tuples(*[st.floats(-40.0, 40.0)] * 3).filter(
        lambda d: np.linalg.norm(d) > 1.0
    )
)
def test_the_bound_never_exceeds_a_flight_that_exists(way):
    way = np.array(way)
    # A straight flight proved against all limits takes longer than any true bound.
    flown = shared_profile(VEHICLE, LIMITS, 0.3, np.zeros((1, 3)), way[None])
    found = lower_bound(Relaxation(VEHICLE, LIMITS, "held", 0.3), 0, way, 5.0)
    assert 0.5 * flown.duration < found.time < flown.duration


@settings(max_examples=10, deadline=None, derandomize=True)
@given(
    way=st.tuples(*[st.floats(-30.0, 30.0)] * 3).filter(
        lambda d: np.linalg.norm(d) > 1.0
    ),
    jerk=st.floats(4.0, 60.0),
)
def test_with_jerk_no_bound_exceeds_a_flight_that_exists_either(way, jerk):
    limits, way = replace(LIMITS, jerk=jerk), np.array(way)
    flown = shared_profile(VEHICLE, limits, 0.3, np.zeros((1, 3)), way[None])
    straight = fly_straight(VEHICLE, 0.3, np.zeros((1, 3)), way[None], flown)
    times = np.linspace(0.0, flown.duration, 4001)
    speed = straight.trajectory(0).state.select([3, 4, 5])
    push = speed.derivative()(times)
    change = np.linalg.norm(np.diff(push, axis=0), axis=1) / (times[1] - times[0])
    assert change.max() <= jerk * (1.0 + 1e-6)
    found = lower_bound(Relaxation(VEHICLE, limits, "held", 0.3), 0, way, 5.0)
    assert 0.5 * flown.duration < found.time < flown.duration


@settings(max_examples=10, deadline=None, derandomize=True)
@given(st.floats(1.0, 30.0), st.floats(4.0, 60.0))
def test_straight_up_with_jerk_is_bound_by_its_closed_form(height, jerk):
    limits = replace(
        LIMITS, jerk=jerk, acceleration_up=3.0, acceleration_down=3.8
    ).upright(4.0)
    way = np.array([0.0, 0.0, height])
    exact = quickest_ascent(Aircraft(VEHICLE, limits), way[2:]).duration
    found = lower_bound(Relaxation(VEHICLE, limits), 0, way, exact)
    assert 0.95 * exact < found.time <= exact
    plain = lower_bound(Relaxation(VEHICLE, replace(limits, jerk=0.0)), 0, way, exact)
    assert plain.time < found.time + 0.01 * exact


@pytest.mark.parametrize(
    ("way", "low", "high"),
    [
        # The independent reference: 6.871 s by optimal control to 0.1 %.
        ((30.0, 20.0, 10.0), 6.83, 6.872),
        # Straight up at 5 m/s: thrust 21.03 N, then free fall.
        ((0.0, 0.0, 10.0), 2.35, 2.37),
    ],
)
def test_known_moves(way, low, high):
    found = lower_bound(relaxation(), 3, np.array(way), 4.0)
    assert low < found.time < high
    assert found.drone == 3


def test_straight_up_is_bound_by_bang_bang():
    # v = 5 m/s is reached after v / a, left before v / g; the rest is cruise.
    most = LIMITS.thrust_max / VEHICLE.mass - VEHICLE.gravity
    exact = 2.0 + 0.5 * 5.0 / most + 0.5 * 5.0 / VEHICLE.gravity
    found = lower_bound(relaxation(), 0, np.array([0.0, 0.0, 10.0]), 4.0)
    assert exact * 0.995 < found.time <= exact


def test_a_witness_proves_its_time_and_all_shorter_ones_but_no_flown_one(monkeypatch):
    model = relaxation()
    way = np.array([30.0, 20.0, 10.0])
    found = lower_bound(model, 0, way, 7.0)
    beta, knots = np.array(found.beta), np.array(found.knots)
    multipliers = np.array(found.multipliers)
    assert surplus(model, way, 6.95, beta, knots, multipliers) < 0.0
    proofs = []
    for subdivisions in (4, 32, 64, 256):
        monkeypatch.setattr(bound, "_SUBDIVISIONS", subdivisions)
        less = found.time * (1 - 1e-4)
        if subdivisions >= 32:
            assert surplus(model, way, less, beta, knots, multipliers) > 0.0
        proofs.append(surplus(model, way, found.time, beta, knots, multipliers))
    # A finer integral is a tighter one: the remainder is directed.
    assert proofs == sorted(proofs)


def test_slower_aircraft_have_longer_bounds():
    way = np.array([12.0, 3.0, -4.0])
    times = [
        lower_bound(relaxation(**changes), 0, way, 4.0).time
        for changes in (
            {},
            {"tilt": 0.2},
            {"tilt": 0.2, "velocity_max": (3.0, 3.0, 3.0)},
        )
    ]
    assert times[0] < times[1] < times[2]


@pytest.mark.parametrize("way", [(30.0, 20.0, 10.0), (12.0, 3.0, -4.0)])
def test_of_a_move_made_in_the_guess_one_program_is_enough_beyond_it(way, monkeypatch):
    model, way = relaxation(), np.array(way)
    least = lower_bound(model, 0, way, 7.0).time
    solve, solved = RelaxedMove.multipliers, []

    def counting(move, time, knots):
        solved.append(time)
        return solve(move, time, knots)

    monkeypatch.setattr(RelaxedMove, "multipliers", counting)

    def bounded(guess, *, beyond):
        solved.clear()
        time = lower_bound(model, 0, way, guess, beyond=beyond).time
        return time, len(solved)

    long = 1.05 * least
    assert bounded(long, beyond=False)[1] > 1
    time, programs = bounded(long, beyond=True)
    assert programs == 1
    # It is a bound all the same, and none beyond the guess.
    assert 0.95 * least < time < long
    # Where the guess is short, nothing is lost.
    for short in (0.9 * least, 0.97 * least):
        whole, programs = bounded(short, beyond=False)
        assert programs > 1
        assert bounded(short, beyond=True)[0] == whole
