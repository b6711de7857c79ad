"""The flights that the autopilot's loops make of legs, against measured flights."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.mission.following import SETTLING, law_time, leg_overshoot
from showc.mission.law import leg_limits, profile
from showc.mission.parameters import Parameters
from showc.mission.speeds import fitting_speed, speed_for
from showc.mission.tracking import STEP, TAIL, tracks
from showc.verify.autopilot import Law, profiles
from showc.verify.tracked import tracked

TUNED = Parameters()
STOCK = replace(TUNED, acceleration=2.5, jerk=1.0)


def flown(displacement, speed=5.0, parameters=TUNED):
    limits = leg_limits(
        np.array([displacement], dtype=float), parameters, np.array([speed])
    )
    leg = profile(limits, parameters)
    return limits, leg, tracks(leg, limits.level, limits.climb, parameters)


def along(displacement, track):
    """Ways level and upright [m] over time, and the times [s]."""
    level = np.hypot(*displacement[:2]) * track.level[:, 0]
    upright = displacement[2] * track.upright[:, 0]
    return level, upright, STEP * np.arange(level.size)


@pytest.mark.parametrize(
    ("parameters", "arrival", "lag"),
    # Measured on 30 m at 5 m/s: within 0.3 m of the end; half way, behind a trapezoid
    # of 3.5 m/s² and 5 m/s. Starts differed by 0.1 s.
    [
        (STOCK, 9.7, 2.2),
        (TUNED, 7.5, 0.6),
        (replace(TUNED, jerk=5.0), 7.8, 0.9),
        (replace(TUNED, acceleration=5.0), 7.3, 0.55),
    ],
)
def test_the_measured_flights_of_thirty_metres(parameters, arrival, lag):
    way = [30.0, 0.0, 0.0]
    _, _, track = flown(way, parameters=parameters)
    place, _, times = along(way, track)
    assert track.near(np.array([way]), 0.3)[0] == pytest.approx(arrival, abs=0.15)
    trapezoid = 0.5 * (30.0 / 5.0 + 5.0 / 3.5)
    half = np.interp(15.0, place[times < 12.0], times[times < 12.0])
    assert half - trapezoid == pytest.approx(lag, abs=0.12)


def test_the_measured_overshoot():
    _, _, track = flown([30.0, 0.0, 0.0])
    assert 30.0 * track.level.max() - 30.0 == pytest.approx(0.45, abs=0.05)


def test_delays_are_those_measured():
    # The constant delay that fits best, legs of 4 to 40 m: 0.15 to 0.45 s, mean 0.33 s.
    legs = [
        *([x, 0, 0] for x in (4, 8, 12, 20, 30, 40)),
        *([0, 0, z] for z in (6, 12, -8)),
        *([10, 0, 5], [15, 0, -8], [20, 0, 10]),
    ]
    best = []
    for displacement in legs:
        limits, leg, track = flown(displacement)
        level, upright, times = along(displacement, track)
        place = level * limits.level[0] + upright * limits.climb[0]
        during = times < leg.duration[0] + 1.0
        delays = np.arange(0.0, 0.7, 0.01)
        errors = [
            np.mean((leg.distance(times[:, None] - delay)[:, 0] - place)[during] ** 2)
            for delay in delays
        ]
        best.append(delays[np.argmin(errors)])
    assert min(best) >= 0.15
    assert max(best) <= 0.45
    assert np.mean(best) == pytest.approx(0.33, abs=0.05)


@pytest.mark.parametrize(
    ("displacement", "error"), [([30, 0, 0], 0.6), ([0, 0, 24], 0.71)]
)
def test_one_fixed_delay_is_as_wrong_as_measured(displacement, error):
    # With 0.35 s for all legs: worst places up to 5 m/s, level and upright.
    limits, leg, track = flown(displacement)
    level, upright, times = along(displacement, track)
    place = level * limits.level[0] + upright * limits.climb[0]
    late = leg.distance(times[:, None] - 0.35)[:, 0]
    assert np.abs(place - late).max() == pytest.approx(error, abs=0.13)


@pytest.mark.parametrize(
    ("length", "time", "first", "last"),
    # Measured from the clock slot, which the simulation's clock cuts by 0.17 s, until
    # within 0.3 m: earliest and latest of four drones on legs of 4 to 27 m.
    [(4.0, 8.0, 7.70, 7.92), (27.0, 8.0, 7.70, 7.92), (10.0, 6.0, 5.78, 5.90)],
)
def test_measured_synchronised_arrivals(length, time, first, last):
    way = np.array([[0.8 * length, 0.5 * length, 0.331662 * length]])
    limits = leg_limits(way, TUNED, np.array([np.inf]))
    fastest = fitting_speed(limits, TUNED)
    speed = speed_for(limits, TUNED, np.array([time]), np.array([0.1]), fastest)
    leg = profile(limits, TUNED, speed)
    track = tracks(leg, limits.level, limits.climb, TUNED)
    assert first - 0.2 <= track.near(way, 0.3)[0] + 0.17 <= last + 0.2


ways = st.tuples(*[st.floats(-30, 30)] * 3).filter(lambda d: np.linalg.norm(d) > 0.3)


@settings(max_examples=25, deadline=None)
@given(ways, st.floats(0.5, 5.0))
def test_drones_stay_near_the_proved_part_of_their_line(displacement, speed):
    # The proof lets each be 0.2 s early or late, on its line, overshoot included.
    limits, leg, track = flown(displacement, speed)
    level, upright, times = along(displacement, track)
    length = leg.length[0]
    upright = np.abs(upright)
    flat, steep = limits.level[0], np.abs(limits.climb[0])
    law = law_time(limits.level, times[:, None])
    rear = leg.distance(law - 0.2)[:, 0]
    beyond = leg_overshoot(limits.level, leg.speed)[0] / length
    front = leg.distance(law + 0.2)[:, 0] * (1.0 + beyond)
    place = np.clip(level * flat + upright * steep, rear, front)
    off = np.hypot(level - flat * place, upright - steep * place)
    settled = times > leg.duration[0] + SETTLING
    assert off[~settled].max() < 0.1 + 0.05 * leg.speed[0]
    # Then they may be anywhere where they were before.
    assert np.hypot(level - flat * length, upright - steep * length)[
        settled
    ].max() < 0.1 + 0.09 * max(leg.speed[0], 1.0)


@settings(max_examples=25, deadline=None)
@given(ways, st.floats(0.3, 8.0))
def test_a_flight_begins_at_rest_and_ends_at_its_goal(displacement, speed):
    _, leg, track = flown(displacement, speed)
    ways = np.array([displacement])
    since = np.array([[-1.0], [0.0], [leg.duration[0] + TAIL], [1e3]])
    places = track.places(since, ways)[:, 0]
    np.testing.assert_allclose(places[:2], 0.0, atol=1e-9)
    # To the last step, of which the end of the time may lie a little before.
    np.testing.assert_allclose(places[2:], np.repeat(ways, 2, axis=0), atol=1e-3)
    # The law ends no sooner than it would without waiting, and half way is before.
    assert track.ended[0] >= leg.duration[0] - 1e-6
    assert 0.4 * leg.duration[0] < track.half_way[0] < track.ended[0]


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(ways, st.floats(0.3, 8.0)), min_size=1, max_size=4))
def test_the_checker_works_out_the_same(legs):
    ways = np.array([way for way, _ in legs])
    limits = leg_limits(ways, TUNED, np.array([speed for _, speed in legs]))
    leg = profile(limits, TUNED)
    ours = tracks(leg, limits.level, limits.climb, TUNED)
    law = Law(TUNED.acceleration, TUNED.acceleration_vertical, TUNED.jerk, TUNED.snap)
    level = np.maximum(leg.speed * limits.level, 1e-9)
    upright = np.maximum(leg.speed * np.abs(limits.climb), 1e-9)
    flights = profiles(ways, level, upright, law)
    theirs = tracked(flights, TUNED.acceleration / TUNED.jerk)
    steps = min(len(ours.level), theirs.flat.shape[1])
    scale = np.abs(ways)
    flat = np.abs(ours.level[:steps] - theirs.flat[:, :steps].T)
    assert (flat * np.hypot(scale[:, 0], scale[:, 1])).max() < 1e-3
    steep = np.abs(ours.upright[:steps] - theirs.steep[:, :steps].T)
    assert (steep * scale[:, 2]).max() < 1e-3
