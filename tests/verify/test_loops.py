"""The autopilot's loops, against the same words written out for one vehicle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.verify.autopilot import GRAVITY, Law, profiles
from showc.verify.law_table import LawTable
from showc.verify.loops import RATE, STATES, TIME, Loops
from showc.verify.response import Axis, level_axis, upright_axis
from showc.verify.settling import RESOLUTION, SLOW, Settling

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
            table(np.full(count, float(step)), found)
            wanted = flights.motion(leg, np.full(count, step * STEP))
            np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_between_its_steps_the_table_is_straight():
    table, flights = LawTable(STEP), legs([(30.0, 4.0, 5.0), (2.0, 0.0, 0.0)])
    table.fill(flights)
    below, above, found = (np.empty((3, 2)) for _ in range(3))
    table(np.array([50.0, 20.0]), below)
    table(np.array([51.0, 21.0]), above)
    table(np.array([50.75, 20.25]), found)
    wanted = below + np.array([0.75, 0.25]) * (above - below)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def axes(last=500):
    return Axis(*level_axis(), STEP, last), Axis(*upright_axis(), STEP, last)


def change_of_one(state, aim, led, lag):
    """Change of one vehicle's state, axis by axis."""
    place, speed, missed = state[0:3], state[3:6], state[6:9]
    total, rise, turn = state[9:11], state[11], state[12:14]
    lean, lift, half, rate = state[15:17], state[17], state[18:20], state[22]
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
    result[15:17] = (half - lean) / 0.03
    result[18:20] = (asked - half) / 0.125
    flat = np.hypot(speed[0], speed[1])
    result[3:5] = lean * (1.0 + lift / GRAVITY) - speed[:2] * (0.25 + 0.027 * flat)
    result[5] = lift - speed[2] * (0.25 + 0.027 * abs(speed[2]))
    short = 5.0 * missed[2] + push * aim[2] - result[5]
    result[11] = 0.1 * GRAVITY / 0.39 * short
    result[17] = (0.05 * GRAVITY / 0.39 * short + rise - lift) / 0.075
    wanted = 1.0
    if fast >= 1e-5:
        ahead = (speed - (point * aim - place)) @ aim
        wanted = min(max(0.05 + ahead / fast, 0.0), 1.0)
    result[21] = rate / STEP
    result[22] = (wanted - rate) / lag
    return result


def changes(state, aim, table):
    led = np.empty((3, state.shape[1]))
    table(state[TIME], led)
    return np.stack(
        [change_of_one(*one, LAG) for one in zip(state.T, aim.T, led.T, strict=True)],
        axis=1,
    )


def tried(size):
    """Directions and states of 40 vehicles, and the table of their legs."""
    generator = np.random.default_rng(7)
    flights = legs(generator.normal(scale=20.0, size=(40, 3)))
    table = LawTable(STEP)
    table.fill(flights)
    horizontal = generator.normal(size=(2, 40))
    horizontal /= np.linalg.norm(horizontal, axis=0)
    aim = np.vstack([horizontal * flights.level, flights.climb])
    state = generator.normal(scale=size, size=(STATES, 40))
    # Upright there are neither of these.
    state[[14, 20]] = 0.0
    # Some before their legs, some behind them, most on the way.
    time = generator.uniform(-0.1, 1.1, size=40) * flights.duration / STEP
    state[TIME] = np.maximum(time, 0.0)
    state[RATE] = generator.uniform(0.0, 1.0, size=40)
    return aim, state, table


@pytest.mark.parametrize("size", [0.1, 1.0, 8.0])
def test_each_vehicle_goes_on_as_written_out(size):
    """By the midpoint rule; also when others are no longer followed."""
    aim, state, table = tried(size)
    loops = Loops(table, axes(), aim, LAG, state)
    for count in (40, 40, 23):
        if count < 40:
            loops.keep(count)
        some = slice(count)
        begin = np.vstack([loops.kinds.reshape(TIME, -1), loops.time, loops.rate])
        middle = begin + 0.5 * STEP * changes(begin, aim[:, some], table)
        wanted = changes(middle, aim[:, some], table)
        loops.advance()
        found = np.vstack([loops.kinds.reshape(TIME, -1), loops.time, loops.rate])
        np.testing.assert_array_equal(loops.kinds_before.ravel(), begin[:TIME].ravel())
        np.testing.assert_array_equal(loops.time_before, begin[TIME])
        np.testing.assert_array_equal(loops.rate_before, begin[RATE])
        change = (found - begin) / STEP
        np.testing.assert_allclose(change, wanted, rtol=1e-9, atol=1e-7)


def test_leaning_too_far_is_met_by_the_states_tried():
    """Else the test above would say nothing of the greatest lean."""
    _, state, _ = tried(8.0)
    asked = np.hypot(*(2.0 * state[6:8] + state[9:11] + 0.5 * state[12:14]))
    assert 5 < np.sum(asked > GRAVITY * np.tan(np.pi / 6.0) + 3.0) <= 40


def settling_vehicles(seed, count=12, steps=400):
    """States off their ends, how they settle, step by step, and who is slow."""
    generator = np.random.default_rng(seed)
    flights = legs(generator.normal(scale=9.0, size=(count, 3)))
    table = LawTable(STEP)
    table.fill(flights)
    aim = np.zeros((3, count))
    aim[0], aim[2] = flights.level, flights.climb
    goal = aim * flights.length
    state = generator.normal(scale=0.5, size=(STATES, count))
    state *= 10.0 ** generator.uniform(-4.0, 0.0, size=count)
    state[[14, 20]] = 0.0
    off = state[:TIME].reshape(7, 3, count).copy()
    state[:3] += goal
    state[TIME] = flights.duration / STEP + 1.0
    state[RATE] = generator.uniform(0.5, 1.0, size=count)
    loops = Loops(table, axes(), aim, LAG, state)
    kinds, rates = np.empty((steps, 7, 3, count)), np.empty((steps, count))
    for kind, rate in zip(kinds, rates, strict=True):
        loops.advance()
        kind[:], rate[:] = loops.kinds, loops.rate
        kind[0] -= goal
    slow = Settling(axes(), LAG).slow(off)
    return off[..., slow], state[RATE, slow], kinds[..., slow], rates[:, slow]


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=20)
def test_who_settles_is_told_as_it_is_flown(seed):
    off, rate, kinds, rates = settling_vehicles(seed)
    count, steps = off.shape[2], len(kinds)
    wanted = np.random.default_rng(seed).integers(1, steps, size=count)
    scale = np.linspace(0.9, 1.1, 3 * count).reshape(3, count)
    told = np.empty((steps, 3, count), dtype=np.float32)
    settling = Settling(axes(), LAG)
    states = settling.follow(off, scale, wanted, told)
    # A hundredth of what is not linear, and single precision.
    error = 0.01 * settling.pushes(off) + 1e-6 * np.abs(off).max(axis=(0, 1)) + 1e-7
    assert np.all(np.abs(told - kinds[:, 0] * scale).max(axis=(0, 1)) < error)
    each = np.arange(count)
    at = kinds[wanted - 1, :, :, each].transpose(1, 2, 0)
    assert np.all(np.abs(states - at)[0].max(axis=0) < error)
    assert np.all(np.abs(states - at)[1].max(axis=0) < 5.0 * error)
    found = settling.rates(rate, wanted)
    np.testing.assert_allclose(found, rates[wanted - 1, each], atol=1e-12)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=20)
def test_what_is_not_linear_pushes_no_further_than_is_said(seed):
    off, _, kinds, _ = settling_vehicles(seed)
    level, upright = axes()
    linear = np.stack(
        [
            axis.powers[1:401, 0] @ off[:, number]
            for number, axis in enumerate((level, level, upright))
        ],
        axis=1,
    )
    error = np.abs(kinds[:, 0] - linear).max(axis=(0, 1))
    assert np.all(error <= Settling((level, upright), LAG).pushes(off) + 1e-12)


def test_some_are_slow_and_some_are_not():
    """Else the tests above would say little."""
    found = [settling_vehicles(seed, steps=1)[0].shape[2] for seed in range(20)]
    assert 60 < sum(found) < 220
    off = np.concatenate([settling_vehicles(k, steps=1)[0] for k in range(20)], axis=2)
    pushes = Settling(axes(), LAG).pushes(off)
    assert np.sum(pushes > 0.1 * SLOW) > 5
    assert np.sum(pushes < RESOLUTION) > 5
