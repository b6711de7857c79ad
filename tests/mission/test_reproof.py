"""The missions' flights proved again from bytes, by code that shares nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mission.flights import START, shift_flight, swap_flight
from synthetic import gliding_flight

from showc.log import showc_pb2 as pb
from showc.mission import law as ours
from showc.mission import mission_files
from showc.mission.parameters import Parameters, parameter_file
from showc.verify.autopilot import Law, profiles
from showc.verify.legs import read_parameters
from showc.verify.mission_flight import check_mission_flight
from showc.verify.waypoints import MissionFormatError

FLIGHTS = {"shift": shift_flight, "swap": swap_flight, "crossing": gliding_flight}


def rules_of(flight, distance=None):
    show = flight.itinerary.show
    site = show.site
    return pb.Rules(
        drones=show.drones,
        site=pb.Site(
            latitude=site.latitude,
            longitude=site.longitude,
            altitude=site.altitude,
            heading=site.heading,
        ),
        separation=pb.Separation(
            distance=distance or show.separation.distance, vertical_stretch=1.0
        ),
    )


class Case:
    """Missions on disk, and what is needed to check them."""

    def __init__(self, folder, flight, start):
        self.folder, self.flight = folder, flight
        self.missions = mission_files(flight, start=start)
        self.start = start
        (folder / "missions").mkdir(parents=True)
        for name, content in self.missions.files.items():
            (folder / name).write_bytes(content)

    def check(self, distance=None):
        count = self.flight.itinerary.show.drones
        described = {
            "autopilot": "ardupilot",
            "start": None if self.start is None else self.start.isoformat(),
            "prediction": self.missions.prediction,
        }
        paths = {n: f"missions/drone_{n + 1:04d}.waypoints" for n in range(count)}
        rules = rules_of(self.flight, distance)
        return check_mission_flight(self.folder, paths, described, rules)

    def edit(self, drone, old, new):
        path = self.folder / f"missions/drone_{drone:04d}.waypoints"
        content = path.read_text()
        assert old in content
        path.write_text(content.replace(old, new, 1))


@pytest.fixture
def shift(tmp_path):
    return Case(tmp_path / "output", shift_flight(6), START)


@pytest.mark.parametrize("start", [START, None])
@pytest.mark.parametrize(
    ("name", "drones"), [("shift", 6), ("swap", 6), ("crossing", 24)]
)
def test_both_proofs_agree(tmp_path, name, drones, start):
    case = Case(tmp_path / "output", FLIGHTS[name](drones), start)
    checks = case.check()
    assert [check.verdict for check in checks] == ["pass"] * 4
    claimed = [
        leg["closest"]
        for leg in case.missions.prediction["legs"]
        if leg["closest"] is not None
    ]
    nearest = min(claimed, key=lambda item: item["distance"])
    timed = checks[0]
    assert timed.value == pytest.approx(nearest["distance"], abs=0.01)
    assert timed.limit == pytest.approx(0.974)
    assert 0.0 <= timed.where.time <= case.missions.prediction["duration"]
    assert any("wait for no clock" in note for note in timed.notes) == (start is None)


def test_midnight_makes_no_difference(tmp_path):
    late = START.replace(hour=23, minute=59, second=47)
    case = Case(tmp_path / "output", gliding_flight(16), late)
    assert [check.verdict for check in case.check()] == ["pass"] * 4


def test_a_wider_separation_fails_with_pair_and_time(shift):
    timed = shift.check(distance=1.5)[0]
    assert timed.verdict == "fail"
    assert timed.where.pair is not None
    assert 20.0 < timed.where.time < 40.0


def test_another_speed_is_noticed(shift):
    line = next(
        row
        for row in (shift.folder / "missions/drone_0005.waypoints")
        .read_text()
        .splitlines()
        # Of a leg that this speed steers: others only lift it out of their way.
        if "\t178\t1\t" in row and "\t178\t1\t10\t" not in row
    )
    fields = line.split("\t")
    slower = [*fields[:5], f"{float(fields[5]) * 0.7:.3f}", *fields[6:]]
    shift.edit(5, line, "\t".join(slower))
    verdicts = {check.code: check.verdict for check in shift.check()}
    assert verdicts["VRF414"] == "fail"


def test_another_slot_is_noticed(shift):
    slot = shift.missions.prediction["legs"][1]["slots_utc"][0]
    second = int(slot[17:19])
    shift.edit(5, f"\t20\t0\t{second}\t", f"\t20\t0\t{second + 2}\t")
    assert shift.check()[0].verdict == "fail"


def test_a_slot_inside_the_leg_before_is_noticed(shift):
    legs = shift.missions.prediction["legs"]
    old, new = int(legs[1]["slot"]), int(legs[0]["slot"]) + 2
    shift.edit(2, f"\t20\t0\t{old}\t", f"\t20\t0\t{new}\t")
    check = shift.check()[0]
    assert check.verdict == "fail"
    assert "drone 2" in check.notes[0] and "before" in check.notes[0]


def test_another_parameter_is_noticed(tmp_path):
    crossing = Case(tmp_path / "output", gliding_flight(16), START)
    path = crossing.folder / "missions/ardupilot.parm"
    content = path.read_text()
    path.write_text(content.replace("WPNAV_ACCEL,350", "WPNAV_ACCEL,120"))
    assert crossing.check()[-1].verdict == "fail"
    path.write_text(content.replace("WPNAV_JERK,20\n", ""))
    assert "WPNAV_JERK" in crossing.check()[0].notes[0]
    path.write_text("WPNAV_JERK=20\n")
    with pytest.raises(MissionFormatError, match="line 1"):
        read_parameters(path.read_bytes())
    path.unlink()
    assert crossing.check()[0].verdict == "fail"


def test_px4_is_not_claimed(tmp_path):
    flight = shift_flight(2)
    rules = rules_of(flight)
    checks = check_mission_flight(tmp_path, {}, {"autopilot": "px4"}, rules)
    assert [check.verdict for check in checks] == ["skipped"]


STOCK = Parameters(acceleration=2.5, acceleration_vertical=1.0, jerk=1.0)
centimetres = st.integers(-4000, 4000).map(lambda value: value / 100.0)


@settings(max_examples=80, deadline=None)
@given(
    st.tuples(centimetres, centimetres, centimetres).filter(any),
    st.floats(0.2, 8.0),
    st.sampled_from([Parameters(), STOCK]),
)
def test_both_laws_fly_alike(vector, speed, parameters):
    values = read_parameters(parameter_file(parameters))
    step = np.array([vector])
    vertical = parameters.speed_up if vector[2] > 0.0 else parameters.speed_down
    theirs = profiles(step, np.array([speed]), np.array([vertical]), Law.of(values))
    limits = ours.leg_limits(step, replace(parameters, speed=speed), np.array([np.inf]))
    mine = ours.profile(limits, parameters)
    assert theirs.duration[0] == pytest.approx(mine.duration[0], abs=1e-6)
    times = np.linspace(-0.5, mine.duration[0] + 0.5, 101)
    part, _ = theirs.fraction(np.zeros(101, dtype=np.int64), times)
    np.testing.assert_allclose(part, mine.fraction(times[:, None])[:, 0], atol=1e-6)
