"""A fleet whose clock is brought to rest keeps what its accelerations keep."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.log.reader import read_log
from showc.safety.assessment import show_of
from showc.safety.stop import (
    PERIOD,
    Authority,
    Motion,
    SharedClock,
    authority_within,
    stops,
)

ROUNDING = 1e-6


@pytest.fixture(scope="module")
def logged(compiled):
    return read_log(compiled("swap"))


@pytest.fixture(scope="module")
def velocities(logged):
    return [logged.trajectory(k).state.select([3, 4, 5]) for k in range(logged.drones)]


@pytest.fixture(scope="module")
def authority(logged):
    return authority_within(show_of(logged))


def test_accelerations_hold_at_every_instant_of_a_stop(velocities, authority):
    motion = Motion.of(velocities)
    fastest = float(np.linalg.norm(motion.velocity, axis=2).max())
    pushes = [speed.derivative() for speed in velocities]
    for begin in np.arange(0.37, velocities[0].end - 1.0, 2.1):
        clock = SharedClock(motion, authority, float(begin), fastest)
        clock.run()
        clock.stop()
        while not clock.resting:
            time, rate = clock.time, clock.rate
            clock.advance(PERIOD)
            change = (clock.rate - rate) / PERIOD
            for part in np.linspace(0.0, PERIOD, 6):
                now = rate + change * part
                moment = time + 0.5 * (rate + now) * part
                for speed, push in zip(velocities, pushes, strict=True):
                    x, y, z = now**2 * push(moment) + change * speed(moment)
                    assert np.hypot(x, y) <= authority.level + ROUNDING
                    assert -authority.down - ROUNDING <= z <= authority.up + ROUNDING


def room_of_all(motion):
    """Return what :class:`_Course` does, with every drone looked at closely."""

    def room(_course, authority, when, rates, change):
        speed, push = motion.over(*when)
        rooms = [
            authority.room(np.sign(change) * speed, rate**2 * push) for rate in rates
        ]
        return min(abs(change), *(float(one.min()) for one in rooms))

    return room


def test_a_close_look_at_some_drones_finds_the_room_of_all(
    velocities, authority, monkeypatch
):
    motion = Motion.of(velocities)
    quick = stops(motion, authority, 0.7)
    monkeypatch.setattr("showc.safety.stop._Course.room", room_of_all(motion))
    slow = stops(motion, authority, 0.7)
    for one, other in zip(quick.changes, slow.changes, strict=True):
        assert one == pytest.approx(other, abs=1e-9)


def test_every_second_has_a_stop_and_a_short_one(velocities, authority):
    found = stops(Motion.of(velocities), authority, 1.0)
    assert found.times.size == int(np.ceil(velocities[0].end))
    assert (found.rests > found.times).all()
    # A ramp of 1 a second with soft ends takes 1.5 s where there is room.
    assert found.durations.min() <= 1.5
    assert found.longest < found.sure < 6.0


def test_less_authority_never_stops_sooner(velocities, authority):
    weak = Authority(0.5 * authority.level, 0.5 * authority.up, 0.5 * authority.down)
    usual, slow = (stops(Motion.of(velocities), one, 3.0) for one in (authority, weak))
    assert (slow.durations >= usual.durations - PERIOD).all()


@settings(max_examples=30)
@given(st.floats(0.0, 10.0), st.floats(0.0, 1.0))
def test_rows_enclose_the_motion(velocities, first, width):
    motion = Motion.of(velocities)
    speed, push = motion.over(first, first + width)
    for part in np.linspace(first, first + width, 7):
        for path in velocities:
            now = path(part)
            assert (now >= speed.min(axis=0) - 1e-9).all()
            assert (now <= speed.max(axis=0) + 1e-9).all()
            now = path.derivative()(part)
            assert (now >= push.min(axis=0) - 1e-9).all()
            assert (now <= push.max(axis=0) + 1e-9).all()
