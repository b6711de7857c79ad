"""What show mode was flown with, and what a file's grid adds to it."""

import numpy as np
import pytest

from showc.foreign.firmware import grid_of
from showc.foreign.show import ForeignShow
from showc.foreign.showmode import what_show_mode_makes
from showc.verify.kernel.slices import Tracks


def climbing(acceleration, grid, height=0.0):
    """Return a climb from rest, in pieces of 0.25 s that are stored on a grid [mm]."""
    starts = 0.25 * np.arange(8)
    begin = height + 0.5 * acceleration * starts**2
    slope = acceleration * starts * 0.25
    bend = 0.5 * acceleration * 0.25**2
    z = [begin, begin + slope / 3, begin + (2 * slope + bend) / 3, begin + slope + bend]
    position = np.zeros((8, 4, 3))
    position[:, :, 2] = np.rint(np.stack(z, axis=1) * 1e3 / grid) * grid / 1e3
    return Tracks(0.0, 2.0, np.array([0, 8]), starts, starts + 0.25, position)


def upward(tracks, grid):
    checks = what_show_mode_makes(tracks, None, None, grid)
    return next(check for check in checks if check.name.startswith("upward"))


@pytest.mark.parametrize("grid", [1, 4, 12])
def test_what_rounding_adds_to_an_acceleration_is_no_breach(grid):
    found = upward(climbing(3.0, grid), grid)
    assert found.verdict == "pass", found


@pytest.mark.parametrize("grid", [1, 4, 12])
def test_an_acceleration_that_rounding_does_not_explain_is_one(grid):
    assert upward(climbing(3.2 + 0.1 * grid, grid), grid).verdict == "fail"


@pytest.mark.parametrize(("height", "grid"), [(20.0, 1), (60.0, 2), (120.0, 4)])
def test_the_grid_of_a_file_follows_from_how_far_it_reaches(height, grid):
    show = ForeignShow("far", "a table", "far", ("one",), climbing(1.0, 1, height))
    assert grid_of(show) == grid
