"""When take-offs are over, and how landings sink."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission.flights import hop_flight, shift_flight

from showc.autopilot.parameters import Parameters
from showc.autopilot.takeoff import takeoff_risen, takeoff_times
from showc.autopilot.timing import LIFT_OFF
from showc.mission import mission_files
from showc.mission.predict import descent

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
    parameters = Parameters(climb_speed=speed, acceleration_vertical=acceleration)
    return takeoff_times(heights, parameters)


@pytest.mark.parametrize(("speed", "acceleration", "height", "flown"), FLOWN)
def test_takeoffs_last_as_long_as_they_are_flown(speed, acceleration, height, flown):
    assert times([height], speed, acceleration)[0] == pytest.approx(flown, abs=0.01)


@pytest.mark.parametrize(
    ("speed", "height", "flown", "within"),
    # From AUTO to the next item in simulation: logged, or reported every 0.05 s.
    [
        (4.0, 250, 3.495, 0.01),
        (2.0, 250, 3.775, 0.05),
        (2.0, 150, 3.35, 0.05),
        (0.5, 100, 4.30, 0.05),
    ],
)
def test_the_measured_takeoffs(speed, height, flown, within):
    took = LIFT_OFF + times([height], speed, 2.5)[0]
    assert took == pytest.approx(flown, abs=within)


@pytest.mark.parametrize(
    ("speed", "since", "measured"),
    # At times since AUTO, to 2.5 m in simulation; the height of the vehicle itself.
    [
        (2.0, [1.5, 2.0, 2.5, 3.0, 3.5], [0.17, 0.93, 1.70, 2.26, 2.54]),
        (4.0, [1.5, 2.0, 2.5, 3.0, 3.5], [0.18, 0.95, 1.72, 2.28, 2.56]),
        (0.5, [2.0, 3.0, 4.0, 5.0, 6.0], [0.39, 0.83, 1.29, 1.79, 2.27]),
    ],
)
def test_takeoffs_rise_as_they_were_flown(speed, since, measured):
    parameters = Parameters(climb_speed=speed)
    elapsed = np.array(since)[:, None] - LIFT_OFF
    risen = 2.5 * takeoff_risen([250], parameters, elapsed)[:, 0]
    assert risen == pytest.approx(measured, abs=0.15)


@settings(max_examples=30)
@given(speeds, accelerations, st.lists(st.integers(100, 250), min_size=1, max_size=4))
def test_higher_takes_longer(speed, most, heights):
    assert np.all(np.diff(times(sorted(heights), speed, most)) >= 0.0)


def test_a_landing_gains_speed_as_measured_and_ends_on_the_ground():
    parameters = Parameters(descent_speed=1.0)
    instants = np.arange(0.0, 60.0, 0.01)[:, None]
    sunk = descent(instants, np.array([20.0]), parameters)[:, 0]
    speed = np.gradient(sunk, 0.01)
    # What drones sank that flew no leg to their pads first.
    for moment, measured in ((0.5, 0.11), (1.0, 0.47), (1.5, 0.95), (2.0, 1.45)):
        assert sunk[round(100 * moment)] == pytest.approx(measured, abs=0.08)
    # Slowing down at 4 m cost 0.28 s.
    assert np.interp(16.0, sunk, instants[:, 0]) == pytest.approx(16.55 + 0.28, abs=0.1)
    assert speed[(sunk > 16.1) & (sunk < 19.9)] == pytest.approx(0.5, abs=0.01)
    assert sunk[-1] == 20.0
    assert np.all(np.diff(sunk) >= 0.0)


def test_each_drone_sinks_after_its_own_last_leg():
    missions = mission_files(shift_flight(6))
    predicted, last = missions.predicted, missions.prediction["legs"][-1]
    pause = predicted.timeline.landing_pause
    for drone, ended in zip(last["drones"], last["ended"], strict=True):
        # Its own leg to the pad takes up to 1.15 s.
        hovers, sinks = ended + pause - 0.1, ended + pause + 3.5
        before, after = predicted.position([hovers, sinks])[:, drone - 1, 2]
        assert before == pytest.approx(6.0, abs=0.05)
        assert after < 5.0


@pytest.mark.parametrize(
    ("off", "measured"),
    [(0.0, 0.0), (0.013, 0.83), (0.02, 0.93), (0.03, 1.0), (0.045, 1.1), (0.057, 1.15)],
)
def test_a_landing_first_flies_the_centimetres_to_its_height(off, measured):
    # Landings flown in simulation: what passed more than for drones at their heights.
    predicted = mission_files(hop_flight(1)).predicted
    (took,) = predicted.pad_legs(np.array([off]))
    assert took == pytest.approx(measured, abs=0.08)
