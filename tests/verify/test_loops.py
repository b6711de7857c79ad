"""The autopilot's loops, against the same words written out for one vehicle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.verify.autopilot import GRAVITY, Law, profiles
from showc.verify.loops import RATE, STATES, TIME, LawTable, Loops

LAW = Law(2.5, 1.2, 5.0, 14.0)
STEP = 0.02
LAG = 0.5

vectors = st.lists(
    st.tuples(*(st.floats(-60.0, 60.0, allow_nan=False) for _ in range(3))),
    min_size=1,
    max_size=6,
)


def legs(displacements):
    way = np.array(displacements)
    return profiles(way, np.full(len(way), 6.0), np.full(len(way), 2.0), LAW)


@given(vectors, vectors)
@settings(deadline=None, max_examples=40)
def test_the_table_holds_the_law_also_when_it_is_filled_again(first, second):
    table = LawTable(STEP)
    for displacements in (first, second):
        flights = legs(displacements)
        table.fill(flights)
        count = flights.length.size
        found, leg = np.empty((3, count)), np.arange(count)
        for step in range(0, int(flights.duration.max() / STEP) + 3, 7):
            table(np.full(count, step * STEP), found)
            wanted = flights.motion(leg, np.full(count, step * STEP))
            np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_between_its_steps_the_table_is_straight():
    table, flights = LawTable(STEP), legs([(30.0, 4.0, 5.0), (2.0, 0.0, 0.0)])
    table.fill(flights)
    below, above, found = (np.empty((3, 2)) for _ in range(3))
    table(np.array([1.00, 0.40]), below)
    table(np.array([1.02, 0.42]), above)
    table(np.array([1.015, 0.405]), found)
    wanted = below + np.array([0.75, 0.25]) * (above - below)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def change_of_one(state, aim, led, lag):
    """Change of one vehicle's state, axis by axis."""
    place, speed, missed = state[0:3], state[3:6], state[6:9]
    total, rise, turn = state[9:11], state[11], state[12:14]
    lean, half, lift, rate = state[14:16], state[16:18], state[18], state[20]
    point, fast, push = led
    result = np.zeros(STATES)
    result[0:3] = speed
    wrong = (point * aim - place + fast * aim - speed - missed) * 10.0 * np.pi
    result[6:9] = wrong
    asked = 2.0 * missed[:2] + total + 0.5 * turn + push * aim[:2]
    most = GRAVITY * np.tan(np.pi / 6.0)
    size = np.hypot(*asked)
    result[9:11] = missed[:2]
    if size > most:
        if missed[:2] @ asked > 0.0:
            result[9:11] = 0.0
        asked = asked * most / size
    result[12:14] = (wrong[:2] - turn) * 10.0 * np.pi
    result[14:16] = (half - lean) / 0.03
    result[16:18] = (asked - half) / 0.125
    flat = np.hypot(speed[0], speed[1])
    result[3:5] = lean * (1.0 + lift / GRAVITY) - speed[:2] * (0.25 + 0.027 * flat)
    result[5] = lift - speed[2] * (0.25 + 0.027 * abs(speed[2]))
    short = 5.0 * missed[2] + push * aim[2] - result[5]
    result[11] = 0.1 * GRAVITY / 0.39 * short
    result[18] = (0.05 * GRAVITY / 0.39 * short + rise - lift) / 0.075
    wanted = 1.0
    if fast >= 1e-5:
        ahead = (speed - (point * aim - place)) @ aim
        wanted = min(max(0.05 + ahead / fast, 0.0), 1.0)
    result[19] = rate
    result[20] = (wanted - rate) / lag
    return result


@pytest.mark.parametrize("size", [0.1, 1.0, 8.0])
def test_each_vehicle_changes_as_written_out(size):
    generator = np.random.default_rng(7)
    flights = legs(generator.normal(scale=20.0, size=(40, 3)))
    table, leg = LawTable(STEP), np.arange(40)
    table.fill(flights)
    horizontal = generator.normal(size=(2, 40))
    horizontal /= np.linalg.norm(horizontal, axis=0)
    aim = np.vstack([horizontal * flights.level, flights.climb])
    state = generator.normal(scale=size, size=(STATES, 40))
    # Some before their legs, some behind them, most on the way.
    state[TIME] = generator.uniform(-0.1, 1.1, size=40) * flights.duration
    state[TIME] = STEP * np.round(np.maximum(state[TIME], 0.0) / STEP)
    state[RATE] = generator.uniform(0.0, 1.0, size=40)
    led = flights.motion(leg, state[TIME])
    loops, found = Loops(table, aim, LAG), np.empty_like(state)
    before = state.copy()
    loops.change(state, found)
    np.testing.assert_array_equal(state, before)
    for drone in range(40):
        wanted = change_of_one(state[:, drone], aim[:, drone], led[:, drone], LAG)
        np.testing.assert_allclose(found[:, drone], wanted, rtol=1e-9, atol=1e-7)


def test_leaning_too_far_is_met_by_the_states_tried():
    """Else the test above would say nothing of the greatest lean."""
    generator = np.random.default_rng(7)
    generator.normal(scale=20.0, size=(40, 3))
    generator.normal(size=(2, 40))
    state = generator.normal(scale=8.0, size=(STATES, 40))
    asked = np.hypot(*(2.0 * state[6:8] + state[9:11] + 0.5 * state[12:14]))
    assert 5 < np.sum(asked > GRAVITY * np.tan(np.pi / 6.0) + 3.0) <= 40
