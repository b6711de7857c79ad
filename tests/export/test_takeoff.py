"""A launch that is slow where show mode takes over: the same ways, by another clock."""

from dataclasses import replace

import numpy as np
import pytest

from showc.export.fit import crossings, tracks_of
from showc.export.stage import ExportOptions, export
from showc.export.takeoff import PASSING, PUSH, slowed
from showc.foreign.motion import derivative, jumps

LEAD = 20.0


@pytest.fixture(scope="module")
def slow(vertical):
    return slowed(vertical, LEAD)


def test_no_drone_passes_the_takeoff_height_fast(vertical, slow):
    exact = tracks_of(slow)
    for flight, time in zip(slow.flights, crossings(exact), strict=True):
        assert flight.derivative()(time)[2] <= PASSING + 1e-9
    fast = zip(vertical.flights, crossings(tracks_of(vertical)), strict=True)
    assert max(one.derivative()(time)[2] for one, time in fast) > PASSING


def test_the_fleet_is_where_it_was_at_one_instant_of_the_solved_launch(vertical, slow):
    end = vertical.launches[0].end
    instants = np.linspace(0.0, end, 4001)
    solved = np.stack([one(instants)[:, :3] for one in vertical.flights])
    for time in np.linspace(0.0, end + slow.early, 60):
        now = np.stack([one(time)[:3] for one in slow.flights])
        off = np.abs(solved - now[:, None]).max(axis=(0, 2))
        assert off.min() < 2e-3


def test_nothing_changes_after_the_launch(vertical, slow):
    end = vertical.launches[0].end
    times = np.linspace(end, vertical.duration, 200)
    for solved, written in zip(vertical.flights, slow.flights, strict=True):
        assert np.allclose(solved(times), written(times + slow.early), atol=1e-9)
    assert round(1000.0 * slow.early) == pytest.approx(1000.0 * slow.early, abs=1e-6)


def test_places_and_velocities_go_on(slow):
    tracks = tracks_of(slow)
    assert np.abs(jumps(tracks)[1]).max() < 1e-9
    assert np.abs(jumps(derivative(tracks))[1]).max() < 1e-6


def test_the_slower_launch_pushes_no_harder_than_solved(vertical, slow):
    def push(show):
        return max(
            one.derivative().derivative()(np.linspace(0.0, one.end, 5001))[:, 2].max()
            for one in show.flights
        )

    assert push(slow) <= max(push(vertical), PUSH) + 1e-6


def test_a_slow_launch_is_left_as_it_is(vertical, slow):
    again = replace(slow, launches=(), early=0.0)
    assert slowed(again, LEAD) is again
    assert slowed(vertical, 0.5 * slow.early) is vertical


def test_a_fast_launch_that_no_time_is_left_for_is_a_finding(vertical, tmp_path):
    source = {"log": "show.mcap", "sha256": "0" * 64}
    written = export(vertical, source, "skyb", tmp_path / "skyb", ExportOptions(1.0))
    assert "VRF548" in {one.code for one in written.checks if one.verdict == "fail"}
