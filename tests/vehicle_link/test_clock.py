"""The clock that a fleet shares: to rest and back, within what vehicles follow."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission.flights import swap_flight

from showc.log.reader import read_log
from showc.log.writer import write_log
from showc.safety.stop import Authority
from showc.vehicle_link.clock import History, ShowClock
from showc.vehicle_link.setpoints import stream_plan

PERIOD = 0.05
EDGE = 1e-3
"""What the plan itself may do beyond the greatest values on its grid [m/s²]."""


@cache
def swap_plan():
    with TemporaryDirectory() as folder:
        path = Path(folder) / "swap.mcap"
        write_log(swap_flight(), path, manifest=b"{}")
        return stream_plan(read_log(path))


def outside(authority, instant):
    """How far accelerations lie outside what vehicles follow [m/s²]."""
    push = instant.acceleration
    return max(
        np.linalg.norm(push[:, :2], axis=1).max() - authority.level,
        push[:, 2].max() - authority.up,
        -push[:, 2].min() - authority.down,
    )


def running(plan, authority, since):
    """A clock that runs, ``since`` [s] after the launch."""
    clock = ShowClock(plan, authority, plan.launch_end)
    clock.run()
    while clock.time < plan.launch_end + since:
        clock.advance(PERIOD)
    return clock


@settings(max_examples=20)
@given(since=st.floats(0.1, 25.0), spare=st.floats(1.0, 2.0))
def test_a_fleet_comes_to_rest_within_what_vehicles_follow(since, spare):
    plan = swap_plan()
    own = plan.authority
    authority = Authority(spare * own.level, spare * own.up, spare * own.down)
    clock = running(plan, authority, min(since, plan.duration - plan.launch_end - 1.0))
    clock.stop()
    rates = [clock.rate]
    while not clock.resting:
        before = clock.time
        clock.advance(PERIOD)
        rates.append(clock.rate)
        assert clock.time >= before
        beyond = outside(authority, clock.instant())
        assert beyond < EDGE
        assert clock.time < plan.duration + 0.5
    assert np.all(np.diff(rates) <= 1e-12)
    assert np.abs(clock.instant().velocity).max() == 0.0


@settings(max_examples=20)
@given(since=st.floats(3.0, 20.0))
def test_with_room_a_fleet_rests_within_two_seconds(since):
    plan = swap_plan()
    clock = running(plan, Authority(100.0, 100.0, 100.0), since)
    clock.stop()
    spent = 0.0
    while not clock.resting:
        clock.advance(PERIOD)
        spent += PERIOD
    assert spent < 2.0


@settings(max_examples=8)
@given(since=st.floats(3.0, 20.0))
def test_a_fleet_flies_back_to_where_it_joined(since):
    plan = swap_plan()
    authority = plan.authority
    clock = running(plan, authority, since)
    clock.stop()
    while not clock.resting:
        clock.advance(PERIOD)
    clock.turn_back(plan.return_rate)
    while clock.time > plan.launch_end:
        before = clock.time
        clock.advance(PERIOD)
        assert clock.time <= before
        assert clock.rate >= -0.5
        assert outside(authority, clock.instant()) < EDGE


SPEEDS = st.one_of(st.just(0.0), st.floats(0.01, 8.0), st.floats(-8.0, -0.01))


@given(
    velocity=st.tuples(*[SPEEDS] * 3),
    acceleration=st.tuples(*[st.floats(-2.0, 2.0)] * 3),
)
def test_the_room_is_all_there_is(velocity, acceleration):
    authority = Authority(3.0, 2.5, 2.0)
    speed, push = np.array([velocity]), np.array([acceleration])
    room = float(authority.room(speed, push)[0])

    def fits(factor):
        level = np.linalg.norm((push + factor * speed)[0, :2])
        upright = (push + factor * speed)[0, 2]
        return level <= 3.0 + 1e-6 and -2.0 - 1e-6 <= upright <= 2.5 + 1e-6

    if not np.isfinite(room):
        assert np.abs(speed).max() == 0.0
        return
    assert fits(room)
    assert not fits(1.001 * room + 1e-3)


def test_a_drone_that_hardly_moves_leaves_room():
    authority = Authority(3.0, 2.5, 2.0)
    push = np.array([[3.0, 0.0, -2.0]])
    assert authority.room(np.array([[1e-9, 0.0, -1e-9]]), push) == np.inf


def test_the_past_says_where_the_fleet_was_to_be():
    history = History()
    assert history.show_time(0.0) is None
    for now, show in [(10.0, 3.0), (10.5, 3.5), (11.0, 3.6)]:
        history.note(now, show)
    assert history.show_time(9.9) is None
    assert history.show_time(10.25) == pytest.approx(3.25)
    assert history.show_time(10.75) == pytest.approx(3.55)
    history.note(30.0, 20.0)
    assert history.show_time(10.5) is None
