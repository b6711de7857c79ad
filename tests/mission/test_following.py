"""How late and how far ArduCopter follows its leg, against measured flights."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from showc.mission.following import leg_delay, leg_overshoot
from showc.mission.law import leg_limits, profile
from showc.mission.parameters import Parameters
from showc.verify.autopilot import Law, profiles

PARAMETERS = Parameters()


def followed(displacement, speed=5.0):
    """Delay, overshoot and duration of one leg."""
    leg = leg_limits(
        np.array([displacement], dtype=float), PARAMETERS, np.array([speed])
    )
    flown = profile(leg, PARAMETERS)
    delay = leg_delay(leg.level, flown.duration)
    return delay[0], leg_overshoot(leg.level, flown.speed)[0], flown.duration[0]


def test_the_delays_span_what_was_measured_on_twelve_legs():
    # 4 to 40 m, level, upright and slanted: 0.15 to 0.45 s, 0.33 s in the mean.
    legs = [[x, 0, 0] for x in (4, 8, 12, 20, 30, 40)]
    legs += [[0, 0, 6], [0, 0, 12], [0, 0, -8], [10, 0, 5], [15, 0, -8], [20, 0, 10]]
    delays = np.array([followed(leg)[0] for leg in legs])
    assert delays.min() == pytest.approx(0.15, abs=0.02)
    assert delays.max() == pytest.approx(0.45, abs=0.03)
    assert delays.mean() == pytest.approx(0.33, abs=0.03)


def test_the_measured_flight_of_thirty_metres():
    # Within 0.3 m of the end after 7.5 s, 0.45 m beyond it.
    delay, overshoot, duration = followed([30, 0, 0])
    assert overshoot == pytest.approx(0.45, abs=0.02)
    leg = profile(
        leg_limits(np.array([[30.0, 0, 0]]), PARAMETERS, np.array([5.0])), PARAMETERS
    )
    times = np.arange(0.0, duration, 1e-3)
    near = times[np.argmax(leg.distance(times[:, None])[:, 0] > 29.7)]
    # One drone, one run: 0.1 s of jitter at the start.
    assert near + delay == pytest.approx(7.5, abs=0.35)


@given(
    st.tuples(*[st.floats(-60, 60)] * 3).filter(lambda d: np.linalg.norm(d) > 0.02),
    st.floats(0.2, 8.0),
)
def test_the_checker_works_out_the_same(displacement, speed):
    delay, overshoot, duration = followed(displacement, speed)
    rise = PARAMETERS.speed_up if displacement[2] > 0 else PARAMETERS.speed_down
    # The speed along the leg, as the missions' horizontal and vertical limits give it.
    unit = np.array(displacement) / np.linalg.norm(displacement)
    flat = np.hypot(unit[0], unit[1])
    level = max(speed * flat, 1e-9)
    vertical = min(rise, max(speed * abs(unit[2]), 1e-9))
    law = Law(
        PARAMETERS.acceleration,
        PARAMETERS.acceleration_vertical,
        PARAMETERS.jerk,
        PARAMETERS.snap,
    )
    theirs = profiles(
        np.array([displacement]), np.array([level]), np.array([vertical]), law
    )
    assert theirs.duration[0] == pytest.approx(duration, rel=1e-6)
    assert theirs.delay[0] == pytest.approx(delay, abs=1e-6)
    assert theirs.overshoot[0] == pytest.approx(overshoot, abs=1e-6)
