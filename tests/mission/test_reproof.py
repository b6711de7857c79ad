"""The missions' flights proved again from bytes, by code that shares nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission.flights import START, shift_flight, swap_flight
from mission.planted import Case
from synthetic import gliding_flight

from showc.autopilot import s_curve as ours
from showc.autopilot.parameters import Parameters
from showc.verify.missions.law import Law, profiles

FLIGHTS = {"shift": shift_flight, "swap": swap_flight, "crossing": gliding_flight}


@pytest.mark.parametrize("start", [START, None])
@pytest.mark.parametrize(
    ("name", "drones"), [("shift", 6), ("swap", 6), ("crossing", 24)]
)
def test_both_proofs_agree(tmp_path, name, drones, start):
    case = Case(tmp_path, FLIGHTS[name](drones), start)
    checks = case.checks()
    assert case.failures() == set()
    claimed = [
        leg["closest"]
        for leg in case.missions.prediction["legs"]
        if leg["closest"] is not None
    ]
    nearest = min(claimed, key=lambda item: item["distance"])
    timed = checks["VRF411"]
    assert timed.value == pytest.approx(nearest["distance"], abs=0.01)
    assert timed.limit == pytest.approx(0.974)
    assert 0.0 <= timed.where.time <= case.missions.prediction["duration"]


@pytest.mark.parametrize(
    ("start", "minute"),
    [(START.replace(hour=23, minute=59, second=47), None), (None, 59), (None, 17)],
)
def test_midnight_and_full_hours_make_no_difference(tmp_path, start, minute):
    case = Case(tmp_path, gliding_flight(16), start, start_minute=minute)
    assert case.failures() == set()


def test_a_wider_separation_fails_with_pair_and_time(tmp_path):
    case = Case(tmp_path, shift_flight(6), START)
    case.show.rules.separation.distance = 1.5
    timed = case.checks()["VRF411"]
    assert timed.verdict == "fail"
    assert timed.where.pair is not None
    assert 20.0 < timed.where.time < 40.0


STOCK = Parameters(acceleration=2.5, acceleration_vertical=1.0, jerk=1.0)
centimetres = st.integers(-4000, 4000).map(lambda value: value / 100.0)


@settings(max_examples=80, deadline=None)
@given(
    st.tuples(centimetres, centimetres, centimetres).filter(any),
    st.floats(0.2, 8.0),
    st.sampled_from([Parameters(), STOCK]),
)
def test_both_laws_fly_alike(vector, speed, parameters):
    law = Law(
        parameters.acceleration,
        parameters.acceleration_vertical,
        parameters.jerk,
        parameters.snap,
    )
    step = np.array([vector])
    vertical = parameters.speed_up if vector[2] > 0.0 else parameters.speed_down
    theirs = profiles(step, np.array([speed]), np.array([vertical]), law)
    limits = ours.leg_limits(step, replace(parameters, speed=speed), np.array([np.inf]))
    mine = ours.profile(limits, parameters)
    assert theirs.duration[0] == pytest.approx(mine.duration[0], abs=1e-6)
    times = np.linspace(-0.5, mine.duration[0] + 0.5, 101)
    part = theirs.share(np.zeros(101, dtype=np.int64), times)[0]
    np.testing.assert_allclose(part, mine.fraction(times[:, None])[:, 0], atol=1e-6)
