"""When take-offs are over, and the climb after them, for who goes by sums of times."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission.flights import START, rows, shift_flight
from mission.test_tracking import TUNED

from showc.mission import mission_files
from showc.mission.parameters import Parameters
from showc.mission.takeoff import RISING, takeoff_times
from showc.mission.timing import SPIN_UP
from showc.mission.tracking import law_ends
from showc.verify.takeoff import SOONER, takeoff_time
from showc.verify.waypoints import MissionFormatError

FLOWN = [
    (5.0, 2.5, 250, 2.547),
    (4.0, 2.5, 250, 2.592),
    (4.0, 2.5, 150, 2.355),
    (4.0, 1.5, 100, 1.712),
    (2.0, 2.5, 250, 2.895),
    (1.5, 1.5, 250, 3.005),
    (1.0, 2.5, 150, 2.977),
    (0.6, 2.5, 100, 3.100),
]
"""WPNAV_SPEED_UP [m/s], WPNAV_ACCEL_Z [m/s²], height [cm], and how long a transcription
of the autopilot's controllers takes off, from the ground on [s]."""

speeds = st.floats(0.3, 5.0)
accelerations = st.floats(0.8, 3.0)


def times(heights, speed, acceleration):
    parameters = Parameters(speed_up=speed, acceleration_vertical=acceleration)
    return takeoff_times(heights, parameters)


@pytest.mark.parametrize(("speed", "acceleration", "height", "flown"), FLOWN)
def test_takeoffs_last_as_long_as_they_are_flown(speed, acceleration, height, flown):
    assert times([height], speed, acceleration)[0] == pytest.approx(flown, abs=0.01)


@settings(max_examples=30)
@given(speeds, accelerations, st.lists(st.integers(100, 250), min_size=1, max_size=4))
def test_higher_takes_longer_and_the_checker_says_the_same(speed, most, heights):
    heights = sorted(heights)
    found = times(heights, speed, most)
    assert np.all(np.diff(found) >= 0.0)
    theirs = [takeoff_time(0.01 * height, speed, most) for height in heights]
    # A loop more or less where rounding decides.
    np.testing.assert_allclose(found, theirs, atol=0.0026)
    assert RISING == SOONER


def test_the_first_slot_is_the_sum_of_what_comes_before_it():
    missions = mission_files(shift_flight(6))
    timeline = missions.predicted.timeline
    table = rows(missions.files["missions/drone_0001.waypoints"])
    pause = next(row[4] for row in table if row[3] == 93)
    climbed = takeoff_times([int(timeline.takeoff.stored.height[0])], TUNED)[0]
    over = SPIN_UP + climbed + law_ends(timeline.staging, TUNED)[0] - RISING
    assert over + pause == pytest.approx(timeline.legs[0].releases[0], abs=0.001)


def test_a_clock_heeds_nothing_of_this():
    missions = mission_files(shift_flight(6), start=START)
    table = rows(missions.files["missions/drone_0001.waypoints"])
    first = next(row for row in table if row[3] == 93)
    assert first[4] == -1


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_with_damaged_parameters_nobody_takes_off(bad):
    for pair in ((bad, 2.5), (4.0, bad)):
        with pytest.raises(MissionFormatError, match="takes off"):
            takeoff_time(2.5, *pair)
    # And who asks for a height that is never reached, is not waited for.
    assert takeoff_time(1e6, 1.0, 2.5) < 300.0
    assert takeoff_time(-3.0, 1.0, 2.5) < 300.0
