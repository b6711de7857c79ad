"""Flights held against their plans."""

import numpy as np
import pytest
from mission.flights import hop_flight

from showc.errors import DamagedFileError, UsageError
from showc.log.writer import write_log
from showc.vehicle_link.compare import compare_flown
from showc.vehicle_link.flown import FlownLog


@pytest.fixture(scope="module")
def flight():
    return hop_flight(3)


@pytest.fixture(scope="module")
def log(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("compare") / "output.mcap"
    write_log(flight, path, manifest=b"{}")
    return path


def write_track(path, drones, offset=0.0, late=0.0, plan=None):
    times = np.arange(plan.start, plan.end, 0.05)
    with FlownLog(path, drones, 0) as record:
        for drone in drones:
            for time in times:
                place = plan(time - late)[:3] + np.array([offset, 0.0, 0.0])
                record.add(drone, float(time), place, np.zeros(3))


def test_a_late_flight_shows_its_lag(log, flight, tmp_path):
    path = tmp_path / "late.mcap"
    write_track(path, (1,), late=0.4, plan=flight.drone(1).state)
    drone = compare_flown(log, path).drones[0]
    assert drone.lag == pytest.approx(0.4, abs=0.011)
    assert drone.lagged_rms_error < 0.02 < drone.rms_error


def test_an_offset_flight_shows_its_error(log, flight, tmp_path):
    path = tmp_path / "beside.mcap"
    write_track(path, (0,), offset=0.7, plan=flight.drone(0).state)
    drone = compare_flown(log, path).drones[0]
    assert drone.greatest_error == pytest.approx(0.7, abs=1e-3)
    assert drone.rms_error == pytest.approx(0.7, abs=1e-3)


def test_drones_that_came_too_near_are_named(log, flight, tmp_path):
    path = tmp_path / "near.mcap"
    write_track(path, (0, 2), plan=flight.drone(0).state)
    comparison = compare_flown(log, path)
    assert not comparison.kept_separation
    assert comparison.least_separation == 0.0
    assert comparison.least_separation_drones == (1, 3)


def test_other_files_are_refused(log, flight, tmp_path):
    with pytest.raises(UsageError, match="holds no flown positions"):
        compare_flown(log, log)
    path = tmp_path / "other.mcap"
    write_track(path, (8,), plan=flight.drone(0).state)
    with pytest.raises(UsageError, match="has drone 9"):
        compare_flown(log, path)
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(DamagedFileError, match="is not a whole log"):
        compare_flown(log, broken)
    with pytest.raises(UsageError, match="cannot be read"):
        compare_flown(log, tmp_path / "missing.mcap")
