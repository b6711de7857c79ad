"""Flights held against their plans."""

import json

import numpy as np
import pytest
from mission.flights import START, hop_flight, shift_flight
from vehicle_link.flight_logs import card_log, telemetry_log

from showc.errors import DamagedFileError, UsageError
from showc.geodesy import SiteFrame
from showc.log.reader import read_log
from showc.log.writer import write_log
from showc.mission import mission_files
from showc.vehicle_link.autopilot_log import read_autopilot_log
from showc.vehicle_link.compare import compared
from showc.vehicle_link.comparison_page import render_comparison
from showc.vehicle_link.course import course_of
from showc.vehicle_link.flown import FlownLog
from showc.vehicle_link.overlay import load_flown

UTC_ZERO = START.timestamp()


@pytest.fixture(scope="module")
def flight():
    return hop_flight(3)


@pytest.fixture(scope="module")
def log(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("compare") / "output.mcap"
    write_log(flight, path, manifest=b"{}")
    return path


@pytest.fixture(scope="module")
def missions(tmp_path_factory):
    """A log with missions that begin at a UTC."""
    return with_missions(tmp_path_factory.mktemp("missions") / "output.mcap")


def with_missions(path, **changes):
    flight = shift_flight(3)
    made = mission_files(flight, start=START)
    prediction = made.prediction | changes
    manifest = json.dumps({"missions": {"prediction": prediction}}, default=str)
    write_log(flight, path, manifest=manifest.encode(), predicted=made.predicted)
    return path


def geodetic(show, course, drone, places):
    """Latitude, longitude and height above home of show-frame places (n, 3)."""
    site = show.rules.site
    frame = SiteFrame(site.latitude, site.longitude, site.altitude, site.heading)
    found = frame.to_geodetic(places)
    found[:, 2] = places[:, 2] - course.pads[drone, 2]
    return found


def sampled(course):
    """Times ten a second, every other one at a period of the receiver's."""
    return np.arange(np.ceil(5.0 * course.start) / 5.0, course.end, 0.1)


def fly_missions(
    folder,
    log,
    *,
    late=0.0,
    beside=0.0,
    kind="missions",
    zero=UTC_ZERO,
    held_up=None,
    named=lambda drone: (f"{drone:02d}.BIN", drone + 1),
):
    """Write the cards of a fleet that flew its plan, late and beside it.

    ``named`` gives a card's name, and the system id in it.
    """
    folder.mkdir(exist_ok=True)
    show = read_log(log)
    course = course_of(show, kind)
    times = sampled(course)
    for drone in range(show.drones):
        places = course.at(drone, times - late) + np.array([0.0, beside, 0.0])
        name, system = named(drone)
        card_log(
            folder / name,
            system,
            times + zero,
            zero - 100.0 - drone,
            geodetic(show, course, drone, places),
            mode=3 if kind == "missions" else 4,
            held_up=held_up,
        )
    return folder


def test_cards_of_a_flown_mission_show_its_legs(missions, tmp_path):
    result = compared(load_flown(missions, [fly_missions(tmp_path / "logs", missions)]))
    assert result.against == "missions"
    assert [drone.drone for drone in result.drones] == [1, 2, 3]
    # The log has ten places a second, and straight lines between them.
    assert result.greatest_error < 0.1
    names = [leg.name for leg in result.legs]
    assert names[0] == "climb" and names[-1] == "landing"
    moves = result.legs[1:-1]
    assert len(moves) >= 2
    for leg in moves:
        assert [one.drone for one in leg.flights] == [1, 2, 3]
        early, late = leg.lateness
        assert -0.05 < early <= late < 0.05
        assert leg.greatest("speed") > 1.0
        assert leg.proved <= leg.tightest + 0.05
    assert result.kept_separation


def test_cards_named_as_missions_are_of_their_drones_whatever_their_ids(
    missions, tmp_path
):
    folder = fly_missions(
        tmp_path / "logs",
        missions,
        named=lambda drone: (f"drone_{drone + 1:04d}.BIN", 3 - drone),
    )
    result = compared(load_flown(missions, [folder]))
    assert [drone.drone for drone in result.drones] == [1, 2, 3]
    assert result.greatest_error < 0.1


def test_a_flight_that_was_late_and_beside_its_missions_shows_both(missions, tmp_path):
    folder = fly_missions(tmp_path / "logs", missions, late=0.4, beside=0.2)
    result = compared(load_flown(missions, [folder]))
    for leg in result.legs[1:-1]:
        early, late = leg.lateness
        # A drone that comes in beside its goal crosses the circle round it otherwise.
        assert 0.3 < early <= late < 0.75
        # Beside it by 0.2 m, and by what the plan still creeps in the last 0.4 s.
        assert 0.19 < leg.greatest("settled") < 0.25
    for drone in result.drones:
        assert drone.lag == pytest.approx(0.4, abs=0.03)
        assert drone.lagged_rms_error == pytest.approx(0.2, abs=0.03)


def test_fixes_count_from_their_receipt_however_late_they_are_logged(
    missions, tmp_path
):
    folder = fly_missions(tmp_path / "logs", missions, held_up=0.15)
    result = compared(load_flown(missions, [folder]))
    for drone in result.drones:
        assert drone.lag == pytest.approx(0.0, abs=0.03)
        assert drone.greatest_error < 0.1


def test_two_drones_that_met_are_named_by_leg(missions, tmp_path):
    folder = fly_missions(tmp_path / "logs", missions)
    show = read_log(missions)
    course = course_of(show, "missions")
    times = sampled(course)
    # The second drone flies the first one's way.
    places = course.at(0, times)
    card_log(
        folder / "01.BIN", 2, times + UTC_ZERO, UTC_ZERO - 5.0,
        geodetic(show, course, 1, places),
    )  # fmt: skip
    result = compared(load_flown(missions, [folder]))
    assert not result.kept_separation
    for leg in result.legs:
        assert leg.tightest_drones == (1, 2)
        assert leg.tightest < 0.1 < leg.proved


def test_missions_at_a_minute_of_any_hour_find_their_hour(tmp_path):
    log = with_missions(tmp_path / "any.mcap", start=None, start_minute=0)
    folder = fly_missions(tmp_path / "logs", log, zero=UTC_ZERO + 5 * 3600.0)
    result = compared(load_flown(log, [folder]))
    assert result.greatest_error < 0.1
    late = fly_missions(tmp_path / "late", log, zero=UTC_ZERO + 5 * 3600.0, late=0.3)
    drone = compared(load_flown(log, [late])).drones[0]
    assert drone.lag == pytest.approx(0.3, abs=0.03)


def test_cards_of_a_streamed_show_are_laid_over_its_trajectories(missions, tmp_path):
    folder = fly_missions(
        tmp_path / "logs", missions, kind="trajectories", zero=UTC_ZERO + 777.3
    )
    result = compared(load_flown(missions, [folder]))
    assert result.against == "trajectories"
    assert result.greatest_error < 0.15
    assert all(abs(drone.lag) < 0.03 for drone in result.drones)


def test_a_ground_stations_log_gives_what_the_cards_give(missions, tmp_path):
    show = read_log(missions)
    course = course_of(show, "missions")
    times = sampled(course)
    vehicles = [
        (
            drone + 1,
            times + UTC_ZERO,
            UTC_ZERO - 50.0 * drone,
            geodetic(show, course, drone, course.at(drone, times)),
        )
        for drone in range(show.drones)
    ]
    path = tmp_path / "flight.tlog"
    telemetry_log(path, vehicles)
    result = compared(load_flown(missions, [path]))
    assert [drone.drone for drone in result.drones] == [1, 2, 3]
    assert result.greatest_error < 0.05
    assert result.legs[1].lateness[1] < 0.05


def test_positions_on_the_ground_do_not_count(missions, tmp_path):
    folder = fly_missions(tmp_path / "logs", missions)
    (track,) = read_autopilot_log(folder / "00.BIN")
    assert track.system == 1
    assert track.missions
    # What follows the disarming is 500 m up.
    assert track.geodetic[:, 2].max() < 50.0


def test_the_page_shows_tables_and_pictures(missions, tmp_path):
    beside = load_flown(missions, [fly_missions(tmp_path / "logs", missions)])
    page = render_comparison("show, flown", beside, compared(beside))
    assert page.count("<svg") == 2
    assert "tightest flown / proved m" in page
    assert "climb" in page


def test_the_command_prints_the_legs_and_writes_the_page(missions, tmp_path, run_showc):
    folder = fly_missions(tmp_path / "logs", missions)
    page = tmp_path / "flight.html"
    run = run_showc("compare", missions, folder, "-o", page)
    assert run.code == 0, run.err
    assert "held against the missions" in run.out
    assert "separation kept: drones" in run.out
    assert page.read_text().startswith("<!doctype html>")
    assert run_showc("compare", missions, folder, "--limit", "0.001").code == 1
    report = json.loads(run_showc("compare", missions, folder, "--json").out)
    assert len(report["drones"]) == 3


def test_logs_that_do_not_belong_are_refused(missions, log, tmp_path):
    folder = fly_missions(tmp_path / "logs", missions)
    with pytest.raises(UsageError, match="holds no predicted missions"):
        compared(load_flown(log, [folder]))
    (folder / "09.BIN").write_bytes((folder / "00.BIN").read_bytes())
    with pytest.raises(UsageError, match="two of the logs are of one drone"):
        compared(load_flown(missions, [folder]))
    (folder / "09.BIN").unlink()
    other = fly_missions(tmp_path / "before", missions, zero=UTC_ZERO - 86_400.0)
    with pytest.raises(UsageError, match="before the show's time 0"):
        compared(load_flown(missions, [other]))
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(UsageError, match=r"holds no \.BIN and no \.tlog"):
        compared(load_flown(missions, [empty]))
    with pytest.raises(UsageError, match="cannot be read"):
        compared(load_flown(missions, [tmp_path / "missing.BIN"]))


@pytest.mark.parametrize("name", ["noise.BIN", "noise.tlog"])
@pytest.mark.parametrize("content", [b"", b"\xff" * 999, bytes(range(256)) * 40])
def test_noise_is_refused_as_a_log(missions, tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises((DamagedFileError, UsageError)):
        compared(load_flown(missions, [path]))


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
    drone = compared(load_flown(log, [path])).drones[0]
    assert drone.lag == pytest.approx(0.4, abs=0.011)
    assert drone.lagged_rms_error < 0.02 < drone.rms_error


def test_an_offset_flight_shows_its_error(log, flight, tmp_path):
    path = tmp_path / "beside.mcap"
    write_track(path, (0,), offset=0.7, plan=flight.drone(0).state)
    drone = compared(load_flown(log, [path])).drones[0]
    assert drone.greatest_error == pytest.approx(0.7, abs=1e-3)
    assert drone.rms_error == pytest.approx(0.7, abs=1e-3)


def test_drones_that_came_too_near_are_named(log, flight, tmp_path):
    path = tmp_path / "near.mcap"
    write_track(path, (0, 2), plan=flight.drone(0).state)
    comparison = compared(load_flown(log, [path]))
    assert not comparison.kept_separation
    assert comparison.least_separation == 0.0
    assert comparison.least_separation_drones == (1, 3)


def test_other_files_are_refused(log, flight, tmp_path):
    with pytest.raises(UsageError, match="holds no flown positions"):
        compared(load_flown(log, [log]))
    path = tmp_path / "other.mcap"
    write_track(path, (8,), plan=flight.drone(0).state)
    with pytest.raises(UsageError, match="has drone 9"):
        compared(load_flown(log, [path]))
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(DamagedFileError, match="is not a whole log"):
        compared(load_flown(log, [broken]))
    with pytest.raises(UsageError, match="cannot be read"):
        compared(load_flown(log, [tmp_path / "missing.mcap"]))
