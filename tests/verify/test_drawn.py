"""The predicted fleet in the log, against the missions' own bytes."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from synthetic import gliding_flight
from verified import loaded

from showc.log.writer import write_log
from showc.mission import mission_files
from showc.verify.drawn import UNCLOCKED, check_drawn
from showc.verify.legs import FleetLegs, fly_rows, read_parameters, read_rows
from showc.verify.mission_flight import check_mission_flight
from showc.verify.tracked import STEP
from showc.verify.waypoints import MissionFormatError, parse

START = datetime(2026, 6, 1, 20, 0, tzinfo=UTC)
BEGIN = 20 * 3600.0


class Shifted:
    """A prediction that is elsewhere, or at another time."""

    def __init__(self, flight, *, drone=0, by=(0.0, 0.0, 0.0), late=0.0):
        self.flight, self.drone, self.by, self.late = flight, drone, by, late
        self.duration = flight.duration

    def position(self, times):
        places = np.array(self.flight.position(np.asarray(times) - self.late))
        places[:, self.drone] += self.by
        return places


class Backwards:
    """A log that is read message by message, the last first."""

    def __init__(self, log):
        self.log, self.channels = log, log.channels

    def read(self, channels):
        for data, messages, offset in reversed(list(self.log.read(channels))):
            for row in reversed(range(messages.log_time.size)):
                names = messages.__dataclass_fields__
                one = {name: getattr(messages, name)[row : row + 1] for name in names}
                yield data, replace(messages, **one), offset


def drawn(flight, missions, begin, tmp_path, *, backwards=False, **shift):
    path = tmp_path / "output.mcap"
    write_log(
        flight, path, manifest=b"{}", predicted=Shifted(missions.predicted, **shift)
    )
    log, show = loaded(path)
    values = read_parameters(missions.files["missions/ardupilot.parm"])
    rows = [
        read_rows(parse(missions.files[name]), show.rules.site, values)
        for name in sorted(missions.files)
        if name.endswith(".waypoints")
    ]
    read = Backwards(log) if backwards else log
    return check_drawn(read, show, fly_rows(rows, values), begin)


@pytest.fixture(scope="module")
def gliding():
    return gliding_flight(4, moves=2)


@pytest.fixture(scope="module")
def missions(gliding):
    return mission_files(gliding, start=START)


def test_a_mission_that_flies_nowhere_is_refused(gliding, missions, tmp_path):
    path = tmp_path / "output.mcap"
    write_log(gliding, path, manifest=b"{}")
    _, show = loaded(path)
    values = read_parameters(missions.files["missions/ardupilot.parm"])
    name = min(name for name in missions.files if name.endswith(".waypoints"))
    home = b"\n".join(missions.files[name].splitlines()[:2])
    with pytest.raises(MissionFormatError, match="nowhere"):
        read_rows(parse(home), show.rules.site, values)
    again = tmp_path / "missions"
    again.mkdir()
    (again / "ardupilot.parm").write_bytes(missions.files["missions/ardupilot.parm"])
    (again / "one.waypoints").write_bytes(home)
    (again / "two.waypoints").write_bytes(missions.files[name])
    paths = {0: "missions/one.waypoints", 1: "missions/two.waypoints"}
    description = {"autopilot": "ardupilot", "start": START.isoformat()}
    (check,) = check_mission_flight(tmp_path, paths, description, show.rules)
    assert check.verdict == "fail"
    assert check.where.drone == 1


def test_the_drawn_fleet_flies_the_missions(gliding, missions, tmp_path):
    check = drawn(gliding, missions, BEGIN, tmp_path)
    assert check.verdict == "pass"
    assert check.value < 0.005
    assert not check.notes[0].startswith("0 places")


@pytest.mark.parametrize("start", [START, None])
def test_messages_may_come_in_any_order(start, gliding, tmp_path):
    files, begin = mission_files(gliding, start=start), BEGIN if start else None
    forth = drawn(gliding, files, begin, tmp_path)
    back = drawn(gliding, files, begin, tmp_path, backwards=True)
    assert back.value == pytest.approx(forth.value, rel=1e-9)
    assert (back.verdict, back.notes) == (forth.verdict, forth.notes)


def test_a_drone_drawn_beside_its_line_is_found(gliding, missions, tmp_path):
    check = drawn(gliding, missions, BEGIN, tmp_path, drone=2, by=(0.0, 0.02, 0.0))
    assert check.verdict == "fail"
    assert check.where.drone == 3
    assert check.value == pytest.approx(0.02, abs=0.005)


def test_a_fleet_drawn_late_is_found(gliding, missions, tmp_path):
    check = drawn(gliding, missions, BEGIN, tmp_path, late=0.05)
    assert check.verdict == "fail"


def test_without_a_clock_releases_are_nominal(gliding, tmp_path):
    relative = mission_files(gliding)
    assert drawn(gliding, relative, None, tmp_path).verdict == "pass"
    late = drawn(gliding, relative, None, tmp_path, late=5.0 * UNCLOCKED)
    assert late.verdict == "fail"


def test_without_a_clock_each_drone_is_followed_until_it_rests(gliding, tmp_path):
    """However long others fly on before they land."""
    relative = mission_files(gliding)
    path = tmp_path / "output.mcap"
    write_log(gliding, path, manifest=b"{}")
    _, show = loaded(path)
    values = read_parameters(relative.files["missions/ardupilot.parm"])
    one = read_rows(
        parse(relative.files["missions/drone_0001.waypoints"]), show.rules.site, values
    )
    pace = np.ones((len(one.limits), 1))
    pace[-2] = 0.25  # the last leg before the landing
    slow = replace(one, limits=pace * one.limits)
    alone, among = (fly_rows(rows, values) for rows in ([one], [one, slow, slow]))
    by_itself, with_others = (
        one.flights[-1].tracked.ways[..., one.flights[-1].tracked.column[0]]
        for one in (alone, among)
    )
    steps = len(by_itself)
    assert len(with_others) > 1.5 * steps
    np.testing.assert_allclose(with_others[:steps], by_itself, atol=1e-5)
    np.testing.assert_allclose(by_itself[-1], alone.flights[-1].along[0], atol=1e-5)
    speeds = np.linalg.norm(np.diff(with_others, axis=0), axis=1) / STEP
    assert np.abs(np.diff(speeds)).max() < 0.2


def test_nothing_drawn_is_left_out(log_path):
    log, show = loaded(log_path)
    assert check_drawn(log, show, FleetLegs([], None), BEGIN).verdict == "skipped"
