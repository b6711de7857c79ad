"""All missions of all compiled shows, through other people's readers and a real link.

Nothing here asks showc what a file says: the files are read as text and as JSON, every
number as the decimal it is written as, and a reader or a vehicle must give back that
decimal, to its last digit.
"""

import json
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from mission.conftest import free_port
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega as dialect
from repository import WITH_MISSIONS
from vehicle_link.vehicle import Vehicle, World

from showc.script import load_show
from showc.vehicle_link.upload import upload_missions

pytestmark = pytest.mark.slow

KEEPS_EVERYTHING = dialect.MAV_AUTOPILOT_PX4
"""As the tests' own vehicle plays it."""

HEADER = "QGC WPL 110"
FENCE_CORNER, RALLY_POINT = 5001, 5100
DEGREE = Decimal(10_000_000)
"""The protocol's integers in a degree."""


@dataclass(frozen=True)
class Written:
    """An item as its file writes it: place and parameters in decimals."""

    sequence: int
    frame: int
    command: int
    numbers: tuple[Decimal, ...]
    """Four parameters, latitude and longitude [deg], height [m]."""


@dataclass(frozen=True)
class Fleet:
    """The files of one compiled show, by drone."""

    drones: int
    waypoints: tuple[Path, ...]
    plans: tuple[Path, ...]


@pytest.fixture(scope="module", params=WITH_MISSIONS, ids=lambda path: path.stem)
def fleet(request, compiled):
    show = load_show(request.param).show
    assert show is not None
    folder = compiled(request.param.stem).with_suffix("") / "missions"
    files = [sorted(folder.glob(f"*.{kind}")) for kind in ("waypoints", "plan")]
    return Fleet(show.drones, tuple(files[0]), tuple(files[1]))


def written_rows(path):
    lines = path.read_text(encoding="ascii").splitlines()
    assert lines[0] == HEADER
    table = [line.split("\t") for line in lines[1:]]
    assert all(len(row) == 12 and row[11] == "1" for row in table)
    return [
        Written(int(row[0]), int(row[2]), int(row[3]), tuple(map(Decimal, row[4:11])))
        for row in table
    ]


def document(path):
    content = path.read_text(encoding="ascii")
    return json.loads(content, parse_float=Decimal, parse_int=Decimal)


def written_items(path):
    return [
        Written(index, int(item["frame"]), int(item["command"]), tuple(item["params"]))
        for index, item in enumerate(document(path)["mission"]["items"])
    ]


def agrees(value, decimal):
    """Whether a single-precision number is the decimal's, and says all its digits."""
    digits = max(0, -decimal.as_tuple().exponent)
    return value == np.float32(decimal) and round(Decimal(value), digits) == decimal


def check_items(found, wanted):
    """Hold items of the protocol against what stands in the file."""
    assert len(found) == len(wanted)
    for item, row in zip(found, wanted, strict=True):
        assert (item.seq, item.frame, item.command) == (
            row.sequence,
            row.frame,
            row.command,
        )
        assert (item.autocontinue, item.mission_type) == (1, 0)
        assert (item.x, item.y) == tuple(v * DEGREE for v in row.numbers[4:6]), row
        parameters = item.param1, item.param2, item.param3, item.param4
        for value, decimal in zip(parameters, row.numbers[:4], strict=True):
            assert agrees(value, decimal), (item, row)
        assert agrees(item.z, row.numbers[6]), (item, row)


def texts(items):
    return [str(item) for item in items]


def test_every_drone_has_its_files(fleet):
    for files, kind in ((fleet.waypoints, "waypoints"), (fleet.plans, "plan")):
        assert [path.name for path in files] == [
            f"drone_{drone:04d}.{kind}" for drone in range(1, fleet.drones + 1)
        ]
    assert len({path.read_bytes() for path in fleet.waypoints}) == fleet.drones


def test_pymavlink_loads_all_of_them(fleet):
    for path in fleet.waypoints:
        loader = mavwp.MAVWPLoader()
        wanted = written_rows(path)
        assert loader.load(str(path)) == len(wanted)
        for index, row in enumerate(wanted):
            item = loader.wp(index)
            assert (item.seq, item.frame, item.command, item.autocontinue) == (
                row.sequence,
                row.frame,
                row.command,
                1,
            )
            held = item.param1, item.param2, item.param3, item.param4
            assert (*held, item.x, item.y, item.z) == tuple(map(float, row.numbers))


def test_all_waypoints_come_back_from_mavsdks_vehicle(fleet, link):
    for path in fleet.waypoints:
        text = path.read_text(encoding="ascii")
        sent = link.import_mission_planner_mission_from_string(text).mission_items
        link.upload_mission(sent)
        held = link.download_mission()
        check_items(held, written_rows(path))
        assert texts(held) == texts(sent)


def test_all_plans_come_back_from_mavsdks_vehicle(fleet, link):
    for path in fleet.plans:
        text = path.read_text(encoding="ascii")
        sent = link.import_qgroundcontrol_mission_from_string(text)
        link.upload_mission(sent.mission_items)
        held = link.download_mission()
        check_items(held, written_items(path))
        assert texts(held) == texts(sent.mission_items)


def test_fences_and_rally_points_come_back_from_mavsdks_vehicle(fleet, link):
    for path in fleet.plans:
        text = path.read_text(encoding="ascii")
        sent = link.import_qgroundcontrol_mission_from_string(text)
        link.upload_geofence(sent.geofence_items)
        link.upload_rally_points(sent.rally_items)
        fence, rally = link.download_geofence(), link.download_rallypoints()
        assert texts(fence) == texts(sent.geofence_items)
        assert texts(rally) == texts(sent.rally_items)
        plan = document(path)
        (polygon,), (point,) = (
            plan["geoFence"]["polygons"],
            plan["rallyPoints"]["points"],
        )
        corners = [tuple(v * DEGREE for v in corner) for corner in polygon["polygon"]]
        assert [(item.x, item.y) for item in fence] == corners
        assert {item.command for item in fence} == {FENCE_CORNER}
        assert {item.param1 for item in fence} == {float(len(corners))}
        (kept,) = rally
        assert kept.command == RALLY_POINT
        assert (kept.x, kept.y) == tuple(v * DEGREE for v in point[:2])
        assert agrees(kept.z, point[2])


def test_all_missions_go_to_a_whole_fleet_at_once(fleet):
    """Our own uploader, to as many vehicles as there are drones."""
    port = free_port()
    with World() as world:
        vehicles = [
            world.add(Vehicle(port, drone, autopilot=KEEPS_EVERYTHING))
            for drone in range(1, fleet.drones + 1)
        ]
        report = upload_missions(
            fleet.waypoints[0].parents[1],
            connections=[f"udpin:127.0.0.1:{port}"],
            clock=world,
        )
    assert report.complete, [vehicle.reason for vehicle in report.vehicles]
    for vehicle, path in zip(vehicles, fleet.waypoints, strict=True):
        check_items(vehicle.incoming, written_rows(path))


def test_a_plan_and_its_waypoints_are_the_same_mission(fleet):
    for waypoints, plan in zip(fleet.waypoints, fleet.plans, strict=True):
        home, *flown = written_rows(waypoints)
        planned = written_items(plan)
        assert [(row.frame, row.command, row.numbers) for row in flown] == [
            (item.frame, item.command, item.numbers) for item in planned
        ]
        place = document(plan)["mission"]["plannedHomePosition"]
        assert tuple(place) == home.numbers[4:]


@pytest.mark.parametrize("changed", range(7))
def test_one_unit_in_the_last_digit_is_noticed(fleet, link, changed):
    path = fleet.waypoints[0]
    text = path.read_text(encoding="ascii")
    sent = link.import_mission_planner_mission_from_string(text).mission_items
    wanted = written_rows(path)
    check_items(sent, wanted)
    numbers = list(wanted[3].numbers)
    last = Decimal(1).scaleb(-7) if changed in {4, 5} else Decimal("0.001")
    numbers[changed] += last
    wanted[3] = replace(wanted[3], numbers=tuple(numbers))
    with pytest.raises(AssertionError):
        check_items(sent, wanted)
