"""The files as other people's readers see them, and over the real protocol."""

import math

import pytest
from mission.flights import START, rows, shift_flight
from pymavlink import mavparm, mavwp

from showc.mission import mission_files
from showc.script.show import MissionOptions

FIELDS = (
    "seq", "frame", "command", "autocontinue", "param1", "param2", "param3", "param4",
    "x", "y", "z", "mission_type",
)  # fmt: skip


def test_pymavlink_loads_the_parameters(tmp_path):
    missions = mission_files(shift_flight(1), start=START)
    path = tmp_path / "ardupilot.parm"
    path.write_bytes(missions.files["missions/ardupilot.parm"])
    loaded = mavparm.MAVParmDict()
    assert loaded.load(str(path))
    assert len(loaded) == 26
    assert loaded["PSC_VELXY_P"] == 2.0
    assert loaded["WPNAV_ACCEL"] == 350.0
    assert loaded["ATC_INPUT_TC"] == 0.15


@pytest.fixture(scope="module", params=["ardupilot", "px4"])
def missions(request):
    flight = shift_flight(4, options=MissionOptions(light_servos=(9, 10, 11)))
    return mission_files(flight, start=START, autopilot=request.param)


def text(missions, drone, kind="waypoints"):
    return missions.files[f"missions/drone_{drone:04d}.{kind}"].decode()


def test_pymavlink_loads_every_row(missions, tmp_path):
    for drone in range(1, 5):
        path = tmp_path / f"{drone}.waypoints"
        path.write_text(text(missions, drone))
        loader = mavwp.MAVWPLoader()
        table = rows(path.read_bytes())
        assert loader.load(str(path)) == len(table)
        for index, row in enumerate(table):
            item = loader.wp(index)
            assert (item.seq, item.frame, item.command) == (row[0], row[2], row[3])
            values = [item.param1, item.param2, item.param3, item.param4]
            assert values == row[4:8]
            assert (item.x, item.y, item.z) == tuple(row[8:11])


def same(first, second):
    for name in FIELDS:
        one, other = getattr(first, name), getattr(second, name)
        both_nan = all(isinstance(v, float) and math.isnan(v) for v in (one, other))
        assert one == other or both_nan, (name, one, other)


def test_mavsdk_reads_the_waypoints_as_written(missions, link):
    for drone in range(1, 5):
        content = text(missions, drone)
        found = link.import_mission_planner_mission_from_string(content).mission_items
        table = rows(content.encode())
        assert len(found) == len(table)
        for item, row in zip(found, table, strict=True):
            assert (item.seq, item.frame, item.command) == (row[0], row[2], row[3])
            assert item.x == round(row[8] * 1e7) and item.y == round(row[9] * 1e7)
            assert item.z == pytest.approx(row[10], rel=1e-7)


def test_mavsdk_reads_plan_and_waypoints_alike(missions, link):
    content = text(missions, 2)
    from_rows = link.import_mission_planner_mission_from_string(content)
    plan = link.import_qgroundcontrol_mission_from_string(text(missions, 2, "plan"))
    flown = from_rows.mission_items
    if flown[0].command == 16:
        flown = flown[1:]
    assert len(plan.mission_items) == len(flown)
    for one, other in zip(plan.mission_items, flown, strict=True):
        assert (one.command, one.frame, one.x, one.y) == (
            other.command,
            other.frame,
            other.x,
            other.y,
        )
        assert one.z == other.z
    assert len(plan.geofence_items) == 5
    assert all(item.command == 5001 for item in plan.geofence_items)
    assert [item.command for item in plan.rally_items] == [5100]


def test_uploaded_to_mavsdk_and_downloaded_missions_are_equal(missions, link):
    for drone in (1, 4):
        wanted = link.import_mission_planner_mission_from_string(
            text(missions, drone)
        ).mission_items
        link.upload_mission(wanted)
        back = link.download_mission()
        assert len(back) == len(wanted)
        for one, other in zip(back, wanted, strict=True):
            same(one, other)
