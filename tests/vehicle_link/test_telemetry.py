"""What a vehicle tells of itself, by its own clock."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as m

from showc.geodesy import SiteFrame
from showc.vehicle_link.telemetry import Telemetry

SITE = SiteFrame(48.1374, 11.5755, 520.0, 30.0)
PAD = np.array([4.0, -3.0, 0.5])


def position(boot, *place):
    return m.MAVLink_local_position_ned_message(
        round(boot * 1e3), *place, 0.0, 0.0, 0.0
    )


def standing():
    """A vehicle on its pad, whose own frame begins 7 m north, 2 m above it."""
    tells = Telemetry(SITE)
    tells.handle(m.MAVLink_heartbeat_message(2, 3, 1, 0, 4, 3), 0.0)
    tells.handle(position(100.0, -7.0, 0.0, 2.0), 0.0)
    latitude, longitude, _ = SITE.to_geodetic(PAD)
    place = round(latitude * 1e7), round(longitude * 1e7), 0, 0, 0, 0, 0, 0
    tells.handle(m.MAVLink_global_position_int_message(100_000, *place), 0.0)
    tells.anchor(PAD)
    return tells


def test_positions_are_in_the_show_frame_at_the_time_they_are_for():
    tells = standing()
    # Three metres north, five up; a tenth of a second later than the quickest.
    tells.handle(position(101.0, -7.0, 0.0, 2.0), 1.0)
    tells.handle(position(102.0, -4.0, 0.0, -3.0), 2.1)
    step = tells.place.position - PAD
    assert step == pytest.approx([*SITE.from_enu([0.0, 3.0, 0.0])[:2], 5.0], abs=0.02)
    assert tells.place.moment == pytest.approx(2.0, abs=1e-3)
    assert tells.local(tells.place.position) == pytest.approx([-4.0, 0.0, -3.0])


def test_old_news_are_no_news():
    tells = standing()
    tells.handle(m.MAVLink_heartbeat_message(2, 3, 1, 0, 4, 3), 1.0)
    tells.handle(position(101.0, 0.0, 0.0, 0.0), 1.0)
    place = tells.place
    for late in (1.1, 1.5, 2.4):
        tells.handle(position(101.0, 9.0, 9.0, 9.0), late)
    assert tells.place is place
    assert tells.trouble(1.9, 1.0) == ""
    assert "no new position for 1.4 s" in tells.trouble(2.4, 1.0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_number_is_no_place(value):
    tells = standing()
    tells.handle(position(101.0, 0.0, value, 0.0), 1.0)
    assert "not a number" in tells.trouble(1.0, 1.0)


def test_a_clock_that_jumps_is_noticed():
    back = standing()
    back.handle(position(3.0, 0.0, 0.0, 0.0), 1.0)
    assert "went back by 97.0 s" in back.trouble(1.0, 1.0)
    ahead = standing()
    for second in range(1, 15):
        ahead.handle(position(100.0 + second, 0.0, 0.0, 0.0), float(second))
    ahead.handle(position(117.0, 0.0, 0.0, 0.0), 15.0)
    assert "ran ahead by 2.0 s" in ahead.trouble(15.0, 1.0)


def test_a_link_that_was_slow_at_first_is_no_jump():
    tells = standing()
    tells.handle(position(103.0, 0.0, 0.0, 0.0), 1.0)
    assert tells.fault == ""
    tells.handle(position(104.0, 0.0, 0.0, 0.0), 2.0)
    assert tells.place.moment == pytest.approx(2.0, abs=1e-3)


def test_no_fix_is_no_place_on_the_globe():
    tells = Telemetry(SITE)
    tells.handle(m.MAVLink_global_position_int_message(1, 0, 0, 0, 0, 0, 0, 0, 0), 0.0)
    assert not tells.locatable
