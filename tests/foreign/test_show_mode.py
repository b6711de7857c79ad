"""What show mode was flown with: more than that is not known to be followed."""

import numpy as np
import pytest

from showc.foreign.showmode import what_show_mode_makes
from showc.verify.kernel.slices import Tracks


def climbing(acceleration, grid):
    """Return a climb from rest, in pieces of 0.25 s that are stored on a grid [mm]."""
    starts = 0.25 * np.arange(8)
    begin = 0.5 * acceleration * starts**2
    slope = acceleration * starts * 0.25
    bend = 0.5 * acceleration * 0.25**2
    z = [begin, begin + slope / 3, begin + (2 * slope + bend) / 3, begin + slope + bend]
    position = np.zeros((8, 4, 3))
    position[:, :, 2] = np.rint(np.stack(z, axis=1) * 1e3 / grid) * grid / 1e3
    return Tracks(0.0, 2.0, np.array([0, 8]), starts, starts + 0.25, position)


@pytest.mark.parametrize(
    ("acceleration", "grid", "verdict"),
    [
        (3.0, 1, "pass"),  # as steep as was flown, with what rounding adds
        (3.2, 1, "fail"),
        (3.2, 5, "fail"),  # a coarse grid is no excuse: it was not flown
    ],
)
def test_a_climb_steeper_than_was_flown_is_a_finding(acceleration, grid, verdict):
    checks = what_show_mode_makes(climbing(acceleration, grid), None, None)
    (upward,) = (one for one in checks if one.name.startswith("upward"))
    assert upward.code == "VRF561" and upward.verdict == verdict
    (tube,) = (one for one in checks if one.code == "VRF562")
    assert tube.verdict == verdict


def test_a_single_cubic_hides_no_acceleration_between_its_ends():
    # From rest to rest, 10 m in 2 s: 15 m/s² at both ends, and the same speed there.
    position = np.zeros((1, 4, 3))
    position[0, 2:, 0] = 10.0
    once = Tracks(
        0.0, 2.0, np.array([0, 1]), np.array([0.0]), np.array([2.0]), position
    )
    checks = what_show_mode_makes(once, None, None)
    (sideways,) = (one for one in checks if one.name.startswith("sideways"))
    assert sideways.verdict == "fail"
    # From 15 m/s² evenly down, over the first quarter of a second.
    assert sideways.value == pytest.approx(15.0 * (1.0 - 0.25 / 2.0))
