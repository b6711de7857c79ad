"""Legs that end when they are expected to, for missions that go by sums of times."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission.flights import START, shift_flight, swap_flight
from mission.test_tracking import TUNED
from synthetic import LIMITS

from showc.mission import law, mission_files
from showc.mission.calm import HELD, SLOWEST, calmed, held_back
from showc.mission.geodesy import SiteFrame
from showc.mission.stage import StageBuilder
from showc.mission.tracking import law_ends

LATE = TUNED.acceleration / TUNED.jerk
SITE = shift_flight(3).itinerary.show.site


def stage_of(ways, speed=8.0, parameters=TUNED):
    """Legs along ``ways`` (n, 3) [m], up to ``speed`` [m/s], each as fast as it may."""
    ways = np.asarray(ways, dtype=float)
    count = len(ways)
    begin = np.zeros((count, 3))
    begin[:, 0] = 30.0 * np.arange(count)
    begin[:, 2] = 40.0
    builder = StageBuilder(SiteFrame.of(SITE), np.zeros(count), parameters)
    lines = builder.lines(np.arange(count), begin, begin + ways, LIMITS, speed=speed)
    return lines.lasting(lines.shortest)


def held(stage, late=LATE):
    return held_back(stage.profile, stage.level, stage.climb, late)


way = st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-12, 12)).filter(
    lambda place: np.linalg.norm(place) > 0.5
)


@settings(max_examples=15)
@given(st.lists(way, min_size=1, max_size=8), st.floats(0.5, 6.0))
def test_legs_are_calm_afterwards_and_no_quicker_than_before(ways, speed):
    stage = stage_of(ways, speed)
    (calm,) = calmed([stage], TUNED)
    slowest = calm.profile.speed <= 1.001 * SLOWEST * stage.profile.speed
    assert np.all((held(calm) <= HELD) | slowest)
    assert np.all(calm.profile.speed <= stage.profile.speed + 1e-12)
    assert np.all(calm.profile.duration >= stage.profile.duration - 1e-12)
    # Who was calm flies as before.
    same = held(stage) <= HELD
    np.testing.assert_array_equal(calm.command[same], stage.command[same])
    np.testing.assert_array_equal(
        calm.profile.ramp_time[same], stage.profile.ramp_time[same]
    )
    assert (calm is stage) == same.all()


def test_a_calm_leg_is_flown_as_its_command_says():
    (calm,) = calmed(
        [stage_of([[5.0, 0.0, 0.0], [3.0, 0.0, -3.0], [0, 0, 12.0]])], TUNED
    )
    steering = np.where(calm.by_climb, np.abs(calm.climb), calm.level)
    displacement = calm.profile.length[:, None] * np.stack(
        [calm.level, np.zeros(3), calm.climb], axis=1
    )
    limits = law.leg_limits(displacement, TUNED, calm.command / steering)
    again = law.profile(limits, TUNED)
    np.testing.assert_allclose(again.duration, calm.profile.duration, atol=1e-9)
    np.testing.assert_allclose(calm.command, np.round(calm.command, 4), atol=1e-12)


def test_ends_of_calm_legs_do_not_hang_on_a_twentieth_of_a_lag():
    # Eight metres level, ever quicker: somewhere the law waits till drones come back.
    speeds = np.linspace(2.0, 4.5, 26)
    stage = stage_of([[8.0, 0.0, 0.0]] * 26).at_speeds(speeds, TUNED)
    (calm,) = calmed([stage], TUNED)
    other = replace(TUNED, acceleration=1.05 * TUNED.acceleration)

    def off(legs):
        # Only how late the law's time changes its rate is another.
        return np.abs(law_ends(legs, other) - law_ends(legs, TUNED)).max()

    assert held(stage).max() > 2.0 * HELD
    assert off(calm) < 0.05 < off(stage)


def test_the_last_bit_is_held_back_as_the_whole_flight_says():
    stage = stage_of([[8.0, 0.0, 0.0], [3.0, 0.0, 0.0], [40.0, 0.0, 0.0]], 4.0)
    late = law_ends(stage, TUNED) - stage.profile.duration
    back = held(stage)
    # What is held back at the end is held back, and something before it too.
    assert np.all(back < late)
    assert np.all(late < back + 0.5)
    assert back[1] > 1.0 and back[2] < 0.02


def test_nobody_moves():
    (still,) = calmed([stage_of([[5.0, 0.0, 0.0]]).part(np.arange(0))], TUNED)
    assert still.drones.size == 0
    assert calmed([], TUNED) == []


def short_shift():
    return shift_flight(6, shift=(5.0, 2.0, -1.0))


@pytest.mark.parametrize(("make", "rash"), [(swap_flight, False), (short_shift, True)])
def test_legs_are_calm_without_a_clock_and_as_quick_as_ever_with_one(make, rash):
    flight = make()
    loose, clocked = mission_files(flight), mission_files(flight, start=START)

    def longest(missions):
        legs = missions.predicted.timeline.legs
        stages = [stage for leg in legs for stage in leg.encoding.stages]
        return max(held(stage).max() for stage in stages)

    assert longest(loose) <= HELD
    assert (longest(clocked) > HELD) == rash
    for one, other in zip(
        loose.prediction["legs"], clocked.prediction["legs"], strict=True
    ):
        assert one["duration"] >= other["duration"]
        assert (one["duration"] > other["duration"]) <= rash
        assert one["closest"]["distance"] >= 0.974
