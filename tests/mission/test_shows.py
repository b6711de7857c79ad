"""The missions of every show that comes with showc, through other people's readers."""

from pathlib import Path

import pytest
from mission.flights import START, formula_flight, rows
from pymavlink import mavwp
from repository import WITH_MISSIONS

from showc.mission import mission_files
from showc.plan import build_itinerary
from showc.script import load_show


@pytest.fixture(scope="module", params=WITH_MISSIONS, ids=lambda path: path.stem)
def missions(request):
    """Missions along straight lines: the readers do not care who solved the legs."""
    show = load_show(request.param).show
    assert show is not None
    return mission_files(formula_flight(build_itinerary(show)), start=START)


def of_kind(missions, kind):
    found = {n: c for n, c in missions.files.items() if n.endswith(kind)}
    assert found
    return found


def test_pymavlink_loads_them(missions, tmp_path):
    for name, content in of_kind(missions, ".waypoints").items():
        path = tmp_path / Path(name).name
        path.write_bytes(content)
        loader = mavwp.MAVWPLoader()
        table = rows(content)
        assert loader.load(str(path)) == len(table)
        for index, row in enumerate(table):
            item = loader.wp(index)
            assert [item.frame, item.command] == row[2:4]
            assert [item.param1, item.param2, item.param3, item.param4] == row[4:8]
            assert [item.x, item.y, item.z] == row[8:11]


def test_mavsdk_reads_waypoints_and_plans_alike(missions, link):
    plans = of_kind(missions, ".plan")
    for name, content in of_kind(missions, ".waypoints").items():
        flown = link.import_mission_planner_mission_from_string(content.decode())
        plan = link.import_qgroundcontrol_mission_from_string(
            plans[name.replace(".waypoints", ".plan")].decode()
        )
        table = rows(content)
        assert len(flown.mission_items) == len(table)
        assert len(plan.mission_items) == len(table) - 1
        pairs = zip(flown.mission_items[1:], plan.mission_items, strict=True)
        for one, other in pairs:
            assert (one.command, one.frame) == (other.command, other.frame)
            assert (one.x, one.y, one.z) == (other.x, other.y, other.z)
            assert (one.param1, one.param2) == (other.param1, other.param2)
        for item, row in zip(flown.mission_items, table, strict=True):
            assert (item.x, item.y) == (round(row[8] * 1e7), round(row[9] * 1e7))


def test_uploaded_and_downloaded_they_are_equal(missions, link):
    names = sorted(of_kind(missions, ".waypoints"))
    for name in (names[0], names[-1]):
        text = missions.files[name].decode()
        wanted = link.import_mission_planner_mission_from_string(text).mission_items
        link.upload_mission(wanted)
        back = link.download_mission()
        assert [str(item) for item in back] == [str(item) for item in wanted]
