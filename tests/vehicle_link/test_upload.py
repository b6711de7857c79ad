"""Uploads over real datagrams on the loopback address."""

import json
import socket
from contextlib import ExitStack
from datetime import UTC, datetime
from hashlib import sha256

import pytest
from mission.flights import START, shift_flight
from pymavlink.dialects.v20 import ardupilotmega as dialect
from vehicle_link.vehicle import Faults, Vehicle

from showc.errors import UsageError
from showc.mission import mission_files
from showc.script.show import MissionOptions
from showc.vehicle_link.upload import upload_missions

NOW = datetime(2026, 6, 1, 19, 30, tzinfo=UTC)


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def write_fleet(folder, missions, autopilot="ardupilot"):
    (folder / "missions").mkdir(parents=True, exist_ok=True)
    for name, content in missions.files.items():
        (folder / name).write_bytes(content)
    listed = {name: sha256(data).hexdigest() for name, data in missions.files.items()}
    manifest = {
        "fleet": missions.fleet_token,
        "missions": {"autopilot": autopilot, "files": listed},
    }
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


@pytest.fixture(scope="module")
def flight():
    return shift_flight(3, options=MissionOptions(light_servos=(9, 10, 11)))


@pytest.fixture
def folder(tmp_path, flight):
    return write_fleet(tmp_path / "output", mission_files(flight, start=START))


def upload(folder, port, **options):
    return upload_missions(
        folder,
        connections=[f"udpin:127.0.0.1:{port}"],
        clock=lambda: NOW,
        timeout=options.pop("timeout", 5.0),
        **options,
    )


@pytest.mark.parametrize(
    ("autopilot", "kind"),
    [
        ("ardupilot", dialect.MAV_AUTOPILOT_ARDUPILOTMEGA),
        ("px4", dialect.MAV_AUTOPILOT_PX4),
    ],
)
def test_every_vehicle_holds_its_own_mission(tmp_path, flight, autopilot, kind):
    missions = mission_files(flight, start=START, autopilot=autopilot)
    folder = write_fleet(tmp_path, missions, autopilot)
    port = free_port()
    audit = tmp_path / "audit.json"
    with ExitStack() as stack:
        vehicles = [
            stack.enter_context(Vehicle(port, number, autopilot=kind))
            for number in (1, 2, 3)
        ]
        report = upload(folder, port, audit=audit)
    assert report.complete
    assert [v.drone for v in report.vehicles] == [1, 2, 3]
    for vehicle, record in zip(vehicles, report.vehicles, strict=True):
        content = (folder / record.file).read_bytes()
        assert record.sha256 == sha256(content).hexdigest()
        assert len(vehicle.items) == record.items == len(content.splitlines()) - 1
        places = {(item.x, item.y) for item in vehicle.incoming if item.command == 16}
        for row in content.decode().splitlines()[1:]:
            fields = row.split("\t")
            if fields[3] == "16":
                place = round(float(fields[8]) * 1e7), round(float(fields[9]) * 1e7)
                assert place in places
    trail = json.loads(audit.read_text())["uploads"]
    assert len(trail) == 1
    assert trail[0]["fleet"] == missions.fleet_token
    assert trail[0]["time"] == "2026-06-01T19:30:00+00:00"
    assert [v["holds"] for v in trail[0]["vehicles"]] == [True] * 3


def test_a_link_that_loses_datagrams_is_survived(folder):
    port = free_port()
    with Vehicle(port, 2, faults=Faults(loss=0.05)) as vehicle:
        report = upload(folder, port, drones=[2])
    assert report.complete
    assert len(vehicle.items) == report.vehicles[0].items


def test_mavsdks_vehicle_takes_the_mission_and_reads_back_equal(folder):
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.mission_raw_server import MissionRawServer

    port = free_port()
    configuration = mavsdk.Configuration.create_with_component_type(
        mavsdk.ComponentType.AUTOPILOT
    )
    vehicle = mavsdk.Mavsdk(configuration)
    vehicle.add_any_connection(f"udpout://127.0.0.1:{port}")
    server = MissionRawServer(vehicle.server_component())
    taken = []
    server.subscribe_incoming_mission(lambda *given: taken.append(given[1]))
    report = upload(folder, port, drones=[1])
    vehicle.destroy()
    assert report.complete, report.vehicles[0].reason
    assert len(taken) == 1
    assert len(taken[0].mission_items) == report.vehicles[0].items


def test_the_record_keeps_former_uploads(folder, tmp_path):
    port = free_port()
    audit = tmp_path / "audit.json"
    with Vehicle(port, 1):
        upload(folder, port, drones=[1], audit=audit)
        upload(folder, port, drones=[1], audit=audit)
    assert len(json.loads(audit.read_text())["uploads"]) == 2


def test_a_refused_item_is_reported_with_its_name(folder):
    port = free_port()
    with Vehicle(port, 1, faults=Faults(refuse_item=4)):
        report = upload(folder, port, drones=[1])
    assert not report.complete
    assert report.vehicles[0].reason == "refused: MAV_MISSION_UNSUPPORTED at item 4"


def test_an_item_that_reads_back_differently_is_reported(folder):
    port = free_port()
    with Vehicle(port, 1, faults=Faults(change_item=1)):
        report = upload(folder, port, drones=[1])
    assert not report.complete
    assert "item 1 reads back with place" in report.vehicles[0].reason


def test_a_silent_vehicle_fails_alone(folder):
    port = free_port()
    with Vehicle(port, 1), Vehicle(port, 3):
        report = upload(folder, port, timeout=1.5)
    assert [v.holds for v in report.vehicles] == [True, False, True]
    assert "not heard within 1.5 s" in report.vehicles[1].reason


def test_a_calling_connection_reaches_a_waiting_vehicle(folder):
    # The vehicle's own port is what it sends from: bind it, then call it.
    station = free_port()
    with Vehicle(station, 1) as vehicle:
        vehicle.socket.sendto(b"", ("127.0.0.1", station))
        port = vehicle.socket.getsockname()[1]
        sent = vehicle.send

        def answer(message):
            if vehicle.station[1] != station:
                sent(message)

        vehicle.send = answer
        receive = vehicle.socket

        class Answering:
            """Sends to whoever spoke last."""

            def recvfrom(self, size):
                data, origin = receive.recvfrom(size)
                vehicle.station = origin
                return data, origin

            def __getattr__(self, name):
                return getattr(receive, name)

        vehicle.socket = Answering()
        report = upload_missions(
            folder,
            connections=[f"udpout:127.0.0.1:{port}"],
            drones=[1],
            timeout=5.0,
            clock=lambda: NOW,
        )
    assert report.complete


def test_a_changed_file_is_refused_before_anything_is_sent(folder):
    path = folder / "missions/drone_0002.waypoints"
    path.write_bytes(path.read_bytes().replace(b"\t16\t", b"\t82\t", 1))
    with pytest.raises(UsageError, match=r"drone_0002\.waypoints: has hash"):
        upload(folder, free_port())


def test_files_of_two_compiles_are_refused(folder, flight):
    other = mission_files(flight, start=START.replace(hour=21))
    name = "missions/drone_0003.waypoints"
    (folder / name).write_bytes(other.files[name])
    with pytest.raises(UsageError, match="of another compile"):
        upload(folder, free_port())
    # Even when somebody mends the hash in the manifest.
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["missions"]["files"][name] = sha256(other.files[name]).hexdigest()
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(UsageError, match="are not those of compile"):
        upload(folder, free_port())


def test_a_file_too_many_or_too_few_is_refused(folder):
    extra = folder / "missions/drone_0004.waypoints"
    extra.write_bytes((folder / "missions/drone_0001.waypoints").read_bytes())
    with pytest.raises(UsageError, match="is not in the manifest"):
        upload(folder, free_port())
    extra.unlink()
    (folder / "missions/drone_0001.waypoints").unlink()
    with pytest.raises(UsageError, match=r"drone_0001\.waypoints: is in the manifest"):
        upload(folder, free_port())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"connections": []}, "no connection"),
        ({"connections": ["carrier pigeon"]}, "is not understood"),
        ({"connections": ["udpin:127.0.0.1:0"], "drones": [9]}, "drone 9 is not in"),
        (
            {"connections": ["udpin:127.0.0.1:0"], "systems": {1: 2}},
            "same system id",
        ),
        (
            {"connections": ["udpin:127.0.0.1:0"], "systems": {1: 300}},
            "out of range",
        ),
    ],
)
def test_wrong_usage_is_told(folder, options, message):
    with pytest.raises(UsageError, match=message):
        upload_missions(folder, clock=lambda: NOW, **options)


def test_no_manifest_no_upload(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        upload_missions(tmp_path, connections=["udpin:127.0.0.1:0"])
