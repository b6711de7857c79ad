"""Mirror images: they obey the equations of motion, and moves know their kind."""

from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import LIMITS, VEHICLE
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from showc.fleet.single_drone.audit import greatest_excess
from showc.fleet.single_drone.following import follow
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.replay import replay
from showc.fleet.single_drone.symmetry import image, images, kinds

CRAFT = Aircraft(VEHICLE, LIMITS)
ABOVE = np.array([3.0, -2.0, 20.0])


def test_only_what_the_limits_and_the_heading_allow_is_an_image():
    def signs(**changes):
        return {tuple(row) for row in images(replace(CRAFT, **changes))[:, :2].tolist()}

    whole = {(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)}
    assert signs() == whole
    assert signs(heading=np.pi / 2) == whole
    # Turned by half a right angle, the planes of the airframe are not those of the box.
    assert signs(heading=np.pi / 4) == {(1.0, 1.0), (-1.0, -1.0)}
    assert signs(yaw="free") == {(1.0, 1.0)}
    slower = replace(LIMITS, velocity_min=(-3.0, -5.0, -5.0))
    assert signs(limits=slower) == {(1.0, 1.0), (1.0, -1.0)}


@given(
    arrays(np.float64, (5, 3), elements=st.floats(-50.0, 50.0, allow_subnormal=False))
)
def test_images_are_of_one_kind_and_come_back_from_it(way):
    stands, signs = kinds(CRAFT, way)
    assert np.abs(stands * signs - way).max() < 1e-8
    for turn in images(CRAFT):
        again, _ = kinds(CRAFT, way * turn)
        assert np.array_equal(again, stands)
    # Up and down, and other lengths, are other kinds.
    assert np.array_equal(np.abs(stands), np.abs(np.round(way, 9)))
    assert np.array_equal(stands[:, 2], np.round(way[:, 2], 9) + 0.0)


@pytest.mark.parametrize("heading", [0.0, np.pi / 2, np.pi])
def test_the_image_of_a_flight_is_a_flight(heading):
    craft = replace(CRAFT, heading=heading)
    way = np.array([9.0, 4.0, 3.0])
    result = follow(craft, ABOVE, ABOVE + way, 4.5)
    assert result.solved
    place = np.array([-20.0, 11.0, 8.0])
    for turn in images(craft):
        flown = image(craft, result.trajectory, turn, place, place + turn * way)
        errors = replay(VEHICLE, [flown])
        assert errors.position.max() < 1e-3
        assert greatest_excess(craft, flown).relative < 1e-9
        assert np.array_equal(flown.state(0.0)[:3], place)
        assert np.array_equal(flown.state(4.5)[:3], place + turn * way)
        middle = flown.state(2.0)[:3] - place
        here = result.trajectory.state(2.0)[:3] - ABOVE
        assert middle == pytest.approx(turn * here, abs=1e-9)
