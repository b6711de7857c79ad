"""Uploads over real datagrams on the loopback address."""

import hashlib
import json
import threading
from hashlib import sha256

import pytest
from mission.flights import START, shift_flight
from pymavlink.dialects.v20 import ardupilotmega as dialect
from vehicle_link.vehicle import (
    Faults,
    Relay,
    Speaker,
    Vehicle,
    World,
    forged,
    free_port,
    heartbeat_of,
)

from showc.cli.options import numbers, system_ids
from showc.errors import UsageError
from showc.mission import mission_files
from showc.script.show import MissionOptions
from showc.vehicle_link.frames import read_key
from showc.vehicle_link.upload import UploadOptions, upload_missions

KEY = hashlib.sha256(b"a key of the tests").digest()


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


@pytest.fixture(scope="module")
def missions(flight):
    return mission_files(flight, start=START)


@pytest.fixture
def folder(tmp_path, missions):
    return write_fleet(tmp_path / "output", missions)


@pytest.fixture
def world():
    with World() as made:
        yield made


@pytest.fixture
def port():
    return free_port()


def upload(world, folder, port, *, drones=None, audit=None, **options):
    return upload_missions(
        folder,
        connections=[f"udpin:127.0.0.1:{port}"],
        drones=drones,
        audit=audit,
        options=UploadOptions(**options),
        clock=world,
    )


def reason(report):
    assert not report.complete
    (vehicle,) = report.vehicles
    assert not vehicle.holds
    return vehicle.reason


def parameters_in(folder):
    lines = (folder / "missions/ardupilot.parm").read_text().splitlines()
    rows = [line.split(",") for line in lines if not line.startswith("#")]
    return {name: float(value) for name, value in rows}


@pytest.mark.parametrize(
    ("autopilot", "kind"),
    [
        ("ardupilot", dialect.MAV_AUTOPILOT_ARDUPILOTMEGA),
        ("px4", dialect.MAV_AUTOPILOT_PX4),
    ],
)
def test_every_vehicle_holds_its_own_mission(world, tmp_path, flight, autopilot, kind):
    port = free_port()
    missions = mission_files(flight, start=START, autopilot=autopilot)
    folder = write_fleet(tmp_path, missions, autopilot)
    audit = tmp_path / "audit.json"
    vehicles = [world.add(Vehicle(port, n, autopilot=kind)) for n in (1, 2, 3)]
    report = upload(world, folder, port, audit=audit)
    assert report.complete
    # How late a vehicle lifts off that was armed too late is known of one of them.
    assert ("2.33 s before its mission" in report.advice) == (autopilot == "ardupilot")
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
    assert [v["holds"] for v in trail[0]["vehicles"]] == [True] * 3


def test_the_parameters_are_written_and_read_back_before_the_mission(
    world, folder, port
):
    vehicle = world.add(Vehicle(port, 1))
    report = upload(world, folder, port, drones=[1])
    wanted = parameters_in(folder)
    assert report.complete
    assert report.vehicles[0].parameters == len(wanted) > 10
    assert vehicle.parameters == pytest.approx(wanted, rel=1e-6)


def test_drones_beyond_one_network_have_ids_of_their_own_on_it(world, folder, port):
    vehicle = world.add(Vehicle(port, 1))
    report = upload(world, folder, port, drones=[3], systems={3: 1})
    assert report.complete and [one.drone for one in report.vehicles] == [3]
    content = (folder / "missions/drone_0003.waypoints").read_text()
    assert len(vehicle.items) == len(content.splitlines()) - 1


def test_system_ids_are_paired_with_drones_in_order():
    assert system_ids(numbers("251-253"), numbers("1-3")) == {251: 1, 252: 2, 253: 3}
    assert system_ids([1, 2], None) is None
    with pytest.raises(UsageError, match="the same number of both"):
        system_ids([251], [1, 2])


def test_system_ids_without_drones_are_those_of_the_whole_fleet(world, folder, port):
    systems = system_ids(None, numbers("11-13"))
    assert systems == {1: 11, 2: 12, 3: 13}
    for system in systems.values():
        world.add(Vehicle(port, system))
    report = upload(world, folder, port, systems=systems)
    assert report.complete and [one.drone for one in report.vehicles] == [1, 2, 3]


def test_parameters_can_be_left_alone(world, folder, port):
    vehicle = world.add(Vehicle(port, 1))
    assert upload(world, folder, port, drones=[1], parameters=False).complete
    assert vehicle.parameters == {}


def test_a_parameter_that_does_not_take_its_value_is_named(world, folder, port):
    vehicle = world.add(Vehicle(port, 1, faults=Faults(forget="WPNAV_JERK")))
    report = upload(world, folder, port, drones=[1])
    assert reason(report) == "holds parameter WPNAV_JERK = 0 instead of 20"
    assert vehicle.items == []


def test_a_parameter_that_the_vehicle_has_not_is_named(world, folder, port):
    world.add(Vehicle(port, 1, faults=Faults(lacks="WPNAV_ACCEL")))
    report = upload(world, folder, port, drones=[1])
    assert "parameter WPNAV_ACCEL: silent, or it has none" in reason(report)


@pytest.mark.parametrize(("loss", "delay"), [(0.03, 0.0), (0.0, 0.45), (0.10, 0.5)])
def test_eight_vehicles_are_loaded_over_links_that_lose_and_delay(
    world, tmp_path, port, loss, delay
):
    folder = write_fleet(tmp_path, mission_files(shift_flight(8), start=START))
    vehicles = []
    for number in range(1, 9):
        link = world.add(Relay(port, loss=loss, delay=delay, seed=number))
        vehicles.append(world.add(Vehicle(link.port, number)))
    report = upload(world, folder, port)
    assert [vehicle.reason for vehicle in report.vehicles] == [""] * 8
    assert report.complete
    wanted = parameters_in(folder)
    for vehicle, record in zip(vehicles, report.vehicles, strict=True):
        assert len(vehicle.items) == record.items
        assert vehicle.parameters == pytest.approx(wanted, rel=1e-6)


def test_second_copies_of_every_item_do_no_harm(world, folder, port):
    # The way there and back is longer than the second after which it asks again.
    relay = world.add(Relay(port, loss=0.0, delay=0.6, seed=1))
    vehicle = world.add(Vehicle(relay.port, 1))
    begin, begun = vehicle.on_mission_count, []

    def note(message, now):
        begun.append(now)
        begin(message, now)

    vehicle.on_mission_count = note
    report = upload(world, folder, port, drones=[1])
    assert report.complete, report.vehicles[0].reason
    assert len(begun) == 1


def test_a_link_worse_than_any_ends_with_a_reason(world, folder, port):
    link = world.add(Relay(port, loss=0.9, delay=0.5, seed=1))
    world.add(Vehicle(link.port, 1))
    report = upload(world, folder, port, drones=[1])
    assert not report.complete
    assert report.vehicles[0].reason


def test_one_vehicle_is_tried_again_by_the_record(world, folder, port, tmp_path):
    audit = tmp_path / "audit.json"
    for number in (1, 2, 3):
        world.add(
            Vehicle(port, number, faults=Faults(refuse_item=4 if number == 2 else None))
        )
    assert not upload(world, folder, port, audit=audit).complete
    world.actors[1].faults.refuse_item = None
    again = upload(world, folder, port, audit=audit, missing=True)
    assert again.complete
    assert [vehicle.drone for vehicle in again.vehicles] == [2]
    assert upload(world, folder, port, audit=audit, missing=True).vehicles == ()
    assert len(json.loads(audit.read_text())["uploads"]) == 3


def test_an_upload_of_another_compile_does_not_count(
    world, folder, port, tmp_path, flight
):
    audit = tmp_path / "audit.json"
    world.add(Vehicle(port, 1))
    assert upload(world, folder, port, drones=[1], audit=audit).complete
    later = mission_files(flight, start=START.replace(hour=21))
    other = write_fleet(tmp_path / "later", later)
    again = upload(world, other, port, drones=[1], audit=audit, missing=True)
    assert [vehicle.drone for vehicle in again.vehicles] == [1]


def test_mavsdks_vehicle_takes_the_mission_and_reads_back_equal(folder, port):
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.mission_raw_server import MissionRawServer

    configuration = mavsdk.Configuration.create_with_component_type(
        mavsdk.ComponentType.AUTOPILOT
    )
    vehicle = mavsdk.Mavsdk(configuration)
    vehicle.add_any_connection(f"udpout://127.0.0.1:{port}")
    server = MissionRawServer(vehicle.server_component())
    taken, heard = [], threading.Event()

    def take(*given):
        taken.append(given[1])
        heard.set()

    server.subscribe_incoming_mission(take)
    report = upload(None, folder, port, drones=[1], parameters=False)
    # Its own thread tells of the mission, when it comes to it.
    heard.wait(60.0)
    vehicle.destroy()
    assert report.complete, report.vehicles[0].reason
    assert len(taken) == 1
    assert len(taken[0].mission_items) == report.vehicles[0].items


def test_a_refused_item_is_reported_with_its_name(world, folder, port):
    world.add(Vehicle(port, 1, faults=Faults(refuse_item=4)))
    report = upload(world, folder, port, drones=[1])
    assert reason(report) == "refused: MAV_MISSION_UNSUPPORTED at item 4"


def test_an_answer_that_no_standard_names_is_reported_by_number(world, folder, port):
    world.add(Vehicle(port, 1, faults=Faults(acknowledge_with=77)))
    report = upload(world, folder, port, drones=[1])
    assert "refused: unknown MAV_MISSION_RESULT 77 at item" in reason(report)


def test_an_item_that_reads_back_differently_is_reported(world, folder, port):
    world.add(Vehicle(port, 1, faults=Faults(change_item=1)))
    report = upload(world, folder, port, drones=[1])
    assert "item 1 reads back with place" in reason(report)


def test_a_vehicle_that_asks_for_one_item_for_ever_is_given_up(world, folder, port):
    vehicle = world.add(Vehicle(port))
    vehicle.on_mission_item_int = lambda _, now: vehicle.ask(now)
    words = reason(upload(world, folder, port, drones=[1]))
    assert words == "asks for item 0 over and over"


def test_a_vehicle_that_starts_again_in_the_middle_is_loaded(world, folder, port):
    vehicle = world.add(Vehicle(port))
    store, starts = vehicle.on_mission_item_int, []

    def break_off(message, now):
        if message.seq == 4 and not starts:
            starts.append(now)
            vehicle.receiving, vehicle.incoming, vehicle.items = False, [], []
            vehicle.on_mission_count = lambda *_: vehicle.acknowledge(4)
        elif (starts and now - starts[0] > 15.0) or not starts:
            store(message, now)

    begin = vehicle.on_mission_count
    vehicle.on_mission_item_int = break_off
    step = vehicle.step

    def wake(dt, now):
        if starts and now - starts[0] > 6.0:
            vehicle.on_mission_count = begin
            vehicle.on_mission_item_int = store
        step(dt, now)

    vehicle.step = wake
    report = upload(world, folder, port, drones=[1])
    assert report.complete, report.vehicles[0].reason
    assert starts


def test_a_silent_vehicle_fails_alone(world, folder, port):
    world.add(Vehicle(port, 1))
    world.add(Vehicle(port, 3))
    report = upload(world, folder, port, timeout=2.5)
    assert [v.holds for v in report.vehicles] == [True, False, True]
    assert report.vehicles[1].reason == "not heard within 2.5 s"


def test_an_armed_vehicle_gets_nothing(world, folder, port):
    vehicle = world.add(Vehicle(port, 1))
    vehicle.armed = True
    report = upload(world, folder, port, drones=[1])
    assert "is armed" in reason(report)
    assert vehicle.items == []


def test_two_vehicles_with_one_number_get_nothing(world, folder, port):
    vehicles = [world.add(Vehicle(port, 1)), world.add(Vehicle(port, 1))]
    report = upload(world, folder, port, drones=[1])
    assert "two vehicles speak as system 1, 127.0.0.1:" in reason(report)
    assert [vehicle.items for vehicle in vehicles] == [[], []]
    assert [vehicle.parameters for vehicle in vehicles] == [{}, {}]


def test_a_stranger_under_a_vehicles_number_is_not_sent_the_mission(
    world, folder, port
):
    stranger = world.add(Speaker(port, [heartbeat_of(1)], period=0.5))
    world.add(Vehicle(port, 1))
    world.add(Vehicle(port, 2))
    report = upload(world, folder, port, drones=[1, 2])
    assert [vehicle.holds for vehicle in report.vehicles] == [False, True]
    assert "two vehicles speak as system 1" in report.vehicles[0].reason
    sent = {name for data in stranger.heard for name in names(data)}
    assert sent <= {"HEARTBEAT"}


def test_a_stranger_alone_does_not_hold_the_mission(world, folder, port):
    world.add(Speaker(port, [heartbeat_of(1)], period=0.5))
    report = upload(world, folder, port, drones=[1], parameters=False)
    assert "no answer while sending the mission" in reason(report)


def names(data):
    codec = dialect.MAVLink(None, 1, 1)
    codec.robust_parsing = True
    return [message.get_type() for message in codec.parse_buffer(data) or []]


def test_a_stranger_that_speaks_later_is_not_heeded_but_named(world, folder, port):
    link = world.add(Relay(port, loss=0.0, delay=0.1, seed=1))
    world.add(Vehicle(link.port, 1))
    beat = heartbeat_of(1, armed=True)
    stranger = world.add(Speaker(port, [beat], period=0.5, start=4.0))
    report = upload(world, folder, port, drones=[1])
    assert "two vehicles speak as system 1" in reason(report)
    assert stranger.heard == []


def test_signed_vehicles_are_loaded_and_strangers_are_not_heeded(world, folder, port):
    stranger = world.add(Speaker(port, [heartbeat_of(1)], period=0.5))
    vehicle = world.add(Vehicle(port, 1, key=KEY))
    report = upload(world, folder, port, drones=[1], key=KEY)
    assert report.complete, report.vehicles[0].reason
    assert len(vehicle.items) == report.vehicles[0].items
    assert stranger.heard == []


def test_a_vehicle_does_not_heed_a_ground_station_without_its_key(world, folder, port):
    vehicle = world.add(Vehicle(port, 1, key=KEY))
    report = upload(world, folder, port, drones=[1])
    assert not report.complete
    assert vehicle.items == []


@pytest.mark.parametrize("key", [None, bytes(32)])
def test_a_vehicle_without_the_right_signature_is_refused(world, folder, port, key):
    vehicle = world.add(Vehicle(port, 1, key=key))
    report = upload(world, folder, port, drones=[1], key=KEY, timeout=3.0)
    assert "sends no right signature for this key" in reason(report)
    assert vehicle.items == []


def test_a_forged_signature_of_the_future_does_not_lock_the_vehicle_out(
    world, folder, port
):
    beat = dialect.MAVLink_heartbeat_message(2, 3, 1, 0, 4, 3)
    world.add(Speaker(port, [forged(1, beat, 1 << 47)], period=0.2))
    world.add(Vehicle(port, 1, key=KEY))
    assert upload(world, folder, port, drones=[1], key=KEY).complete


def test_a_repeated_datagram_of_a_signed_vehicle_is_not_heeded(world, folder, port):
    link = world.add(Relay(port, loss=0.0, delay=0.0, seed=1))
    world.add(Vehicle(link.port, 1, key=KEY))
    recorded = []
    forward = link.outer.sendto
    link.outer = Recording(link.outer, recorded, forward)
    world.add(Speaker(port, recorded, period=0.5, start=1.0))
    report = upload(world, folder, port, drones=[1], key=KEY)
    assert recorded
    assert report.complete, report.vehicles[0].reason


class Recording:
    """A socket that keeps what it sends."""

    def __init__(self, inner, kept, forward):
        self.inner, self.kept, self.forward = inner, kept, forward

    def sendto(self, data, target):
        self.kept.append(data)
        return self.forward(data, target)

    def __getattr__(self, name):
        return getattr(self.inner, name)


def test_junk_and_half_frames_are_survived(world, folder, port):
    whole = heartbeat_of(1)
    junk = [b"\xfd" * 1400, b"\xfe\xff" * 700, bytes(range(256)) * 5, whole[:9], b""]
    world.add(Speaker(port, junk * 4, period=0.02))
    vehicle = world.add(Vehicle(port, 1))
    report = upload(world, folder, port, drones=[1])
    assert report.complete, report.vehicles[0].reason
    assert len(vehicle.items) == report.vehicles[0].items


def test_frames_cut_in_two_by_a_bridge_are_whole_again(world, folder, port):
    vehicle = world.add(Vehicle(port, 1))
    packed = vehicle.packed

    def send(message):
        data = packed(message)
        vehicle.socket.sendto(data[:7], vehicle.station)
        vehicle.socket.sendto(data[7:], vehicle.station)

    vehicle.send = send
    assert upload(world, folder, port, drones=[1]).complete


def test_a_calling_connection_reaches_a_waiting_vehicle(world, folder):
    vehicle = world.add(Vehicle(0, 1))
    host, number = vehicle.socket.getsockname()
    say, take = vehicle.send, vehicle.socket.recvfrom
    vehicle.send = lambda message: vehicle.station[1] and say(message)

    class Answering:
        """Sends to the address it was called from."""

        def recvfrom(self, size):
            data, vehicle.station = take(size)
            return data, vehicle.station

        def __getattr__(self, name):
            return getattr(inner, name)

    inner, vehicle.socket = vehicle.socket, Answering()
    report = upload_missions(
        folder, connections=[f"udpout:{host}:{number}"], drones=[1], clock=world
    )
    assert report.complete


def test_a_changed_file_is_refused_before_anything_is_sent(world, folder, port):
    path = folder / "missions/drone_0002.waypoints"
    path.write_bytes(path.read_bytes().replace(b"\t16\t", b"\t82\t", 1))
    with pytest.raises(UsageError, match=r"drone_0002\.waypoints: has hash"):
        upload(world, folder, port)


def test_a_changed_parameter_file_is_refused(world, folder, port):
    path = folder / "missions/ardupilot.parm"
    path.write_bytes(path.read_bytes() + b"WPNAV_ACCEL,900\n")
    with pytest.raises(UsageError, match=r"ardupilot\.parm: has hash"):
        upload(world, folder, port)


def test_files_of_two_compiles_are_refused(world, folder, port, flight):
    other = mission_files(flight, start=START.replace(hour=21))
    name = "missions/drone_0003.waypoints"
    (folder / name).write_bytes(other.files[name])
    with pytest.raises(UsageError, match="of another compile"):
        upload(world, folder, port)
    # Even when somebody mends the hash in the manifest.
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["missions"]["files"][name] = sha256(other.files[name]).hexdigest()
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(UsageError, match="are not those of compile"):
        upload(world, folder, port)


def test_a_file_too_many_or_too_few_is_refused(world, folder, port):
    extra = folder / "missions/drone_0004.waypoints"
    extra.write_bytes((folder / "missions/drone_0001.waypoints").read_bytes())
    with pytest.raises(UsageError, match="is not in the manifest"):
        upload(world, folder, port)
    extra.unlink()
    (folder / "missions/drone_0001.waypoints").unlink()
    with pytest.raises(UsageError, match=r"drone_0001\.waypoints: is in the manifest"):
        upload(world, folder, port)


@pytest.mark.parametrize(
    ("connections", "drones", "systems", "message"),
    [
        ([], None, None, "no connection"),
        (["carrier pigeon"], None, None, "is not understood"),
        (["udpin:127.0.0.1:0"], [9], None, "drone 9 is not in"),
        (["udpin:127.0.0.1:0"], [1, 2], {1: 2, 2: 2}, "same system id"),
        (["udpin:127.0.0.1:0"], [1], {1: 300}, "out of range"),
        (["udpin:127.0.0.1:0"], None, {1: 1, 2: 2}, "2 ids for 3 drones"),
    ],
)
def test_wrong_usage_is_refused(folder, connections, drones, systems, message):
    with pytest.raises(UsageError, match=message):
        upload_missions(
            folder,
            connections=connections,
            drones=drones,
            options=UploadOptions(systems=systems),
        )


def test_no_manifest_no_upload(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        upload_missions(tmp_path, connections=["udpin:127.0.0.1:0"])


def test_a_key_is_hexadecimal_or_a_passphrase(tmp_path):
    path = tmp_path / "key"
    path.write_text(KEY.hex() + "\n")
    assert read_key(path) == KEY
    path.write_text("a key of the tests\n")
    assert read_key(path) == KEY
    path.write_text("\n")
    with pytest.raises(UsageError, match="is empty"):
        read_key(path)
    with pytest.raises(UsageError, match="cannot be read"):
        read_key(tmp_path / "missing")
