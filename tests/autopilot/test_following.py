"""How late and how far ArduCopter follows its leg, against measured flights."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from showc.autopilot.following import (
    SLOWEST,
    law_time,
    leg_overshoot,
    time_followed,
)
from showc.autopilot.parameters import Parameters
from showc.autopilot.s_curve import leg_limits, profile
from showc.verify.missions.law import Law, profiles

PARAMETERS = Parameters()
LAW = Law(
    PARAMETERS.acceleration,
    PARAMETERS.acceleration_vertical,
    PARAMETERS.jerk,
    PARAMETERS.snap,
)
MEASURED = [
    *([x, 0, 0] for x in (4, 8, 12, 20, 30, 40)),
    *([0, 0, z] for z in (6, 12, -8)),
    *([10, 0, 5], [15, 0, -8], [20, 0, 10]),
]
"""Legs like those measured: 4 to 40 m, level, upright, slanted [m]."""


def flown(displacement, speed=5.0):
    limits = leg_limits(
        np.array([displacement], dtype=float), PARAMETERS, np.array([speed])
    )
    return limits, profile(limits, PARAMETERS)


@pytest.mark.parametrize("displacement", MEASURED)
def test_delays_are_those_measured(displacement):
    # The one constant delay that fits best, over whole legs: 0.15 to 0.45 s.
    limits, leg = flown(displacement)
    times = np.arange(0.0, leg.duration[0] + 1.0, 0.01)[:, None]
    places = leg.distance(law_time(limits.level, times))[:, 0]
    delays = np.arange(0.0, 0.7, 0.01)
    errors = [
        np.sqrt(np.mean((leg.distance(times - delay)[:, 0] - places) ** 2))
        for delay in delays
    ]
    assert 0.13 <= delays[np.argmin(errors)] <= 0.47


def test_the_measured_flight_of_thirty_metres():
    # Within 0.3 m of the end after 7.5 s, 0.45 m beyond it.
    limits, leg = flown([30, 0, 0])
    assert leg_overshoot(limits.level, leg.speed)[0] == pytest.approx(0.45, abs=0.01)
    times = np.arange(0.0, 9.0, 1e-3)[:, None]
    near = leg.distance(law_time(limits.level, times))[:, 0] > 29.7
    # One drone, a few runs: starts differ by 0.1 s, and speed carries it in earlier.
    assert times[np.argmax(near), 0] == pytest.approx(7.5, abs=0.25)


@given(st.floats(0.0, 1.0), st.floats(0.0, 60.0))
def test_the_time_followed_is_the_inverse(level, duration):
    level, duration = np.array([level]), np.array([duration])
    since = time_followed(level, duration)
    assert law_time(level, since)[0] == pytest.approx(duration[0], abs=1e-9)


@given(st.floats(0.0, 1.0), st.floats(-1.0, 60.0), st.floats(1e-6, 1.0))
def test_the_laws_time_never_stops_nor_hurries(level, since, step):
    level = np.array([level])
    gone = law_time(level, np.array([since + step])) - law_time(
        level, np.array([since])
    )
    assert SLOWEST * step - 1e-9 <= gone[0] <= step + 1e-9


@given(
    st.tuples(*[st.floats(-60, 60)] * 3).filter(lambda d: np.linalg.norm(d) > 0.02),
    st.floats(0.2, 8.0),
    st.floats(-1.0, 30.0),
)
def test_the_checker_works_out_the_same(displacement, speed, since):
    limits, leg = flown(displacement, speed)
    rise = PARAMETERS.speed_up if displacement[2] > 0 else PARAMETERS.speed_down
    # The speed along the leg, as horizontal and vertical limits of a mission give it.
    level = np.maximum(speed * limits.level, 1e-9)
    vertical = np.minimum(rise, np.maximum(speed * np.abs(limits.climb), 1e-9))
    theirs = profiles(np.array([displacement]), level, vertical, LAW)
    row = np.array([0])
    assert theirs.duration[0] == pytest.approx(leg.duration[0], rel=1e-6)
    assert theirs.law_time(row, [since])[0] == pytest.approx(
        law_time(limits.level, np.array([since]))[0], abs=1e-9
    )
    assert theirs.followed(0.2)[0] == pytest.approx(
        time_followed(limits.level, leg.duration + 0.2)[0], rel=1e-6
    )
    assert theirs.overshoot[0] == pytest.approx(
        leg_overshoot(limits.level, leg.speed)[0], abs=1e-6
    )
