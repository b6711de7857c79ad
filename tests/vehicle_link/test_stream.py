"""Shows flown by setpoints over real datagrams, and stopped in order."""

import hashlib
import json
import os
import signal
import subprocess
import sys
from contextlib import ExitStack

import numpy as np
import pytest
from mcap.reader import make_reader
from mission.flights import hop_flight, shift_flight
from vehicle_link.vehicle import (
    Faults,
    Relay,
    Speaker,
    Vehicle,
    World,
    free_port,
    heartbeat_of,
)

from showc.errors import UsageError
from showc.geodesy import SiteFrame
from showc.log.reader import read_log
from showc.log.writer import write_log
from showc.progress import Silent
from showc.vehicle_link.compare import compared
from showc.vehicle_link.conductor import GAINS
from showc.vehicle_link.flown import FlownLog, read_flown
from showc.vehicle_link.overlay import load_flown
from showc.vehicle_link.setpoints import stream_plan
from showc.vehicle_link.stream import StreamOptions, stream_show

ARM, TAKEOFF, LAND, MODE, INTERVAL = 400, 22, 21, 176, 511
GUIDED, LOITER, LANDING, BRAKE = 4, 5, 9, 17

KEY = hashlib.sha256(b"a key of the tests").digest()

ABLE = {
    "WPNAV_SPEED": 1500.0,
    "WPNAV_SPEED_UP": 600.0,
    "WPNAV_SPEED_DN": 600.0,
    "WPNAV_ACCEL": 500.0,
    "WPNAV_ACCEL_Z": 500.0,
    "ANGLE_MAX": 4500.0,
    "PSC_JERK_XY": 20.0,
    "PSC_JERK_Z": 20.0,
}
"""Parameters with which a vehicle follows these shows."""

STOCK = ABLE | {"WPNAV_ACCEL": 250.0, "WPNAV_ACCEL_Z": 100.0, "PSC_JERK_XY": 5.0}
"""Some as ArduCopter comes."""


@pytest.fixture(scope="module")
def flight():
    return shift_flight(3)


@pytest.fixture(scope="module")
def log(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("stream") / "output.mcap"
    write_log(flight, path, manifest=b"{}")
    return path


@pytest.fixture(scope="module")
def plan(log):
    return stream_plan(read_log(log))


@pytest.fixture
def world():
    with World() as made:
        yield made


@pytest.fixture
def port():
    return free_port()


def fleet(flight, port, *, faults=None, moved=None, **given):
    """One vehicle on each pad; ``moved`` puts one beside it (north, metres)."""
    show = flight.itinerary.show
    frame = SiteFrame.of(show.site)
    vehicles = []
    for index, pad in enumerate(show.formations["pads"].points):
        east, north, up = frame.to_enu(pad)
        north += (moved or {}).get(index + 1, 0.0)
        options = {"parameters": ABLE} | given
        vehicles.append(
            Vehicle(
                port,
                index + 1,
                stands=(north, east, -up),
                faults=(faults or {}).get(index + 1),
                **options,
            )
        )
    return vehicles


def stream(world, log, port, **given):
    return stream_show(
        log,
        connections=[f"udpin:127.0.0.1:{port}"],
        clock=world,
        options=StreamOptions(**given.pop("options", {})),
        **given,
    )


def flown_with(world, flight, log, port, *, faults=None, options=None, **given):
    """Vehicles and report of one show."""
    vehicles = [
        world.add(vehicle) for vehicle in fleet(flight, port, faults=faults, **given)
    ]
    return vehicles, stream(world, log, port, options=options or {})


def test_system_ids_for_another_number_of_drones_are_refused(world, log, port):
    systems = {drone: drone + 10 for drone in (1, 2, 3, 4)}
    with pytest.raises(UsageError, match="4 ids for 3 drones"):
        stream(world, log, port, options={"systems": systems})


@pytest.fixture(scope="module")
def flown(log, flight, tmp_path_factory):
    """One whole show on three vehicles: report, vehicles, log of what was flown."""
    path = tmp_path_factory.mktemp("flown") / "flown.mcap"
    port = free_port()
    with World() as world:
        vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
        report = stream(world, log, port, flown=path)
    return report, vehicles, path


BEGUN = 12.0
"""When the shows of these tests are under way, on the vehicles' clocks [s]."""


def test_all_vehicles_fly_to_the_end_and_land(flown, flight):
    report, vehicles, _ = flown
    assert report.complete, report.reason
    assert report.show_time == pytest.approx(flight.duration, abs=1e-3)
    assert [vehicle.phase for vehicle in report.vehicles] == ["landed"] * 3
    for vehicle in vehicles:
        assert not vehicle.armed


def test_every_order_is_given_once(flown):
    for vehicle in flown[1]:
        orders = [c for c in vehicle.flown.commands if c != INTERVAL]
        assert orders == [MODE, ARM, TAKEOFF, LAND]
        assert vehicle.flown.modes == [GUIDED]
        assert vehicle.flown.commands.count(INTERVAL) == 3


def test_the_messages_that_are_needed_are_asked_for(flown):
    for vehicle in flown[1]:
        assert vehicle.intervals[32] <= 0.1
        assert vehicle.intervals[33] <= 0.2


def test_setpoints_come_at_the_rate_with_speed_and_acceleration(flown):
    report, vehicles, _ = flown
    assert report.rate == pytest.approx(20.0, abs=0.05)
    assert report.longest_gap == pytest.approx(0.05, abs=1e-6)
    for vehicle in vehicles:
        assert {mask for _, mask in vehicle.flown.setpoints} == {0x0C00}
        pushes = np.array([push for _, _, push in vehicle.flown.targets])
        assert np.abs(pushes).max() > 1.0


def test_setpoints_lie_on_the_plan_and_lead_their_moment(flown, plan):
    _, vehicles, path = flown
    ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    tracks = read_flown(path)
    for index, vehicle in enumerate(vehicles):
        for stamp, (place, speed, push) in zip(
            vehicle.flown.stamps, vehicle.flown.targets, strict=True
        ):
            instant = plan.at(min(stamp, plan.duration))
            wanted = plan.frame.to_enu(instant.position[index]) @ ned
            assert place == pytest.approx(wanted, abs=0.02)
            if plan.launch_end + 0.2 < stamp < plan.duration - 0.2:
                for found, given in ((speed, instant.velocity), (push, None)):
                    if given is not None:
                        wanted = plan.frame.to_enu(given[index]) @ ned
                        assert found == pytest.approx(wanted, abs=0.02)
        # With the lead a vehicle of this lag is nearly where it is to be.
        track = tracks[index]
        off = np.linalg.norm(
            track.positions - plan.position[index](track.times), axis=1
        )
        assert off.max() < 0.3


def test_what_was_flown_is_the_plan(flown, log, flight):
    report, _, path = flown
    comparison = compared(load_flown(log, [path]))
    assert [drone.drone for drone in comparison.drones] == [1, 2, 3]
    worst = [vehicle.greatest_deviation for vehicle in report.vehicles]
    assert comparison.greatest_error == pytest.approx(max(worst), abs=0.02)
    for drone in comparison.drones:
        assert drone.rms_error < 0.1
        assert abs(drone.lag) < 0.05
        assert drone.end == pytest.approx(flight.duration, abs=0.3)
    assert comparison.kept_separation
    late = [
        one.late
        for leg in comparison.legs
        for one in leg.flights
        if one.late is not None
    ]
    assert len(late) >= 6
    assert np.abs(late).max() < 0.1
    json.dumps(comparison.to_json())


def test_the_flown_log_is_mcap_on_the_plans_time(flown, log):
    _, _, path = flown
    with path.open("rb") as stream, log.open("rb") as planned:
        times = [m.log_time for _, _, m in make_reader(stream).iter_messages()]
        epoch = min(m.log_time for _, _, m in make_reader(planned).iter_messages())
    assert all(epoch <= moment <= epoch + 120e9 for moment in times)


def test_all_vehicles_share_one_clock(flown):
    stamps = [vehicle.flown.stamps for vehicle in flown[1]]
    assert stamps[0] == stamps[1] == stamps[2]


def test_px4_gets_setpoints_before_it_goes_offboard(world, flight, log, port):
    vehicles, report = flown_with(world, flight, log, port, autopilot=12)
    assert report.complete, report.reason
    for vehicle in vehicles:
        assert vehicle.flown.modes == [6 << 16]
        assert TAKEOFF not in vehicle.flown.commands
        assert vehicle.flown.setpoints[0][1] == 0x0DC0


@pytest.mark.slow
def test_mavsdks_vehicle_is_taken_through_the_show(tmp_path):
    pytest.importorskip("mavsdk")
    from vehicle_link.mavsdk_vehicle import MavsdkVehicle

    flight = hop_flight(1)
    show = flight.itinerary.show
    log = tmp_path / "one.mcap"
    write_log(flight, log, manifest=b"{}")
    pad = show.formations["pads"].points[0]
    latitude, longitude, _ = SiteFrame.of(show.site).to_geodetic(pad)
    port = free_port()
    with MavsdkVehicle(port, latitude, longitude) as vehicle:
        # It tells of steps, and a busy machine delays it.
        options = {"corridor": 20.0, "link_timeout": 10.0}
        report = stream(None, log, port, options=options)
    assert report.complete, report.reason
    assert {mode.name for mode in vehicle.modes} == {"OFFBOARD"}
    assert vehicle.armings[0].arm
    assert vehicle.landings
    heights = np.array([-setpoint["z"] for setpoint in vehicle.setpoints])
    top = max(float(points.points[0, 2]) for points in show.formations.values())
    assert heights.max() == pytest.approx(top, abs=0.05)
    assert heights[0] == 0.0 and heights[-1] == pytest.approx(0.0, abs=0.05)


# --- what a vehicle does wrong --------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Faults(silent_at=BEGUN), "no new position for 1."),
        (Faults(positions_stop_at=BEGUN), "no new position for 1."),
        (Faults(positions_freeze_at=BEGUN), "no new position for 1."),
        (Faults(not_a_number_at=BEGUN), "a position that is not a number"),
        (Faults(heartbeats_stop_at=BEGUN), "no heartbeat for 3."),
        (Faults(restart_at=BEGUN), "a clock that went back by 1"),
        (Faults(drift=(1.5, 0.0, 0.0), drift_at=BEGUN), "m from its trajectory"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_a_vehicle_does_wrong_stops_everybody(flight, log, plan, fault, words):
    with World() as world:
        vehicles, report = flown_with(
            world, flight, log, free_port(), faults={2: fault}
        )
    assert not report.complete
    assert report.reason.startswith("drone 2 ")
    assert words in report.reason
    assert plan.launch_end < report.show_time < flight.duration
    assert report.vehicles[1].phase == "failed"
    for vehicle in (vehicles[0], vehicles[2]):
        assert vehicle.flown.modes == [GUIDED, BRAKE]
        assert np.linalg.norm(vehicle.velocity) < 0.01


def test_a_vehicle_taken_over_stops_the_others_and_is_left_alone(
    world, flight, log, port
):
    fault = Faults(taken_over_at=BEGUN)
    vehicles, report = flown_with(world, flight, log, port, faults={2: fault})
    assert report.reason == "drone 2 left its mode or disarmed"
    assert 0.0 < report.show_time < flight.duration
    assert vehicles[0].mode == vehicles[2].mode == BRAKE
    assert vehicles[1].flown.modes == [GUIDED]
    assert vehicles[1].mode == LOITER


def test_a_vehicle_beside_its_pad_is_not_armed(world, flight, log, port):
    vehicles, report = flown_with(world, flight, log, port, moved={2: 8.0})
    assert not report.complete
    assert report.reason.startswith("drone 2 stands 8.0 m from its pad; wanted")
    for vehicle in vehicles:
        assert ARM not in vehicle.flown.commands
        assert vehicle.flown.setpoints == []


def test_vehicles_that_changed_places_are_not_armed(flight, log):
    # Well within the corridor, and nearer the next pad than their own.
    pads = flight.itinerary.show.formations["pads"].points
    frame = SiteFrame.of(flight.itinerary.show.site)
    with World() as world:
        port = free_port()
        vehicles = fleet(flight, port)
        for index, other in ((0, 1), (1, 0)):
            east, north, up = frame.to_enu(pads[other])
            vehicles[index].stands = np.array([north, east, -up])
        for vehicle in vehicles:
            world.add(vehicle)
        report = stream(world, log, port, options={"corridor": 5.0})
    assert "from its pad; wanted at most" in report.reason
    assert not any(ARM in vehicle.flown.commands for vehicle in vehicles)


class At:
    """Does something once, at a time of the world."""

    def __init__(self, when, act):
        self.when, self.act = when, act

    def advance(self, now):
        if self.act is not None and now >= self.when:
            act, self.act = self.act, None
            act()

    def close(self):
        pass


def test_a_vehicle_taken_over_on_its_way_up_is_left_alone(world, flight, log, port):
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    climbing = vehicles[1]

    def take_over():
        climbing.mode, climbing.climb = LOITER, None

    obey = climbing.obey

    def note(message, now):
        if message.command == TAKEOFF:
            world.add(At(now + 3.0, take_over))
        return obey(message, now)

    climbing.obey = note
    report = stream(world, log, port)
    assert report.reason == "drone 2 left its mode or disarmed"
    assert LAND not in climbing.flown.commands
    assert climbing.mode == LOITER
    assert not any(vehicle.armed for vehicle in (vehicles[0], vehicles[2]))


def test_a_vehicle_in_another_mode_is_not_armed(world, flight, log, port):
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    obey = vehicles[1].obey

    def note(message, now):
        result = obey(message, now)
        if message.command == MODE:
            # A pilot's switch moves as soon as it is in the mode.
            world.add(At(now + 0.3, lambda: setattr(vehicles[1], "mode", LOITER)))
        if message.command == ARM:
            vehicles[1].armed = False
            return 5
        return result

    vehicles[1].obey = note
    report = stream(world, log, port)
    assert report.reason == "drone 2 left its mode or disarmed"
    assert not any(vehicle.armed for vehicle in vehicles)


def test_a_vehicle_whose_estimate_jumps_on_its_pad_does_not_rise(
    world, flight, log, port
):
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]

    def jump():
        vehicles[2].position = np.array([9.0, 0.0, 0.0])

    world.add(At(1.2, jump))
    report = stream(world, log, port)
    assert "drone 3" in report.reason
    assert "from its pad" in report.reason
    assert not any(vehicle.armed for vehicle in vehicles)


def test_a_parameter_that_another_station_changes_stops_everybody(
    world, flight, log, port
):
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]

    def change():
        vehicles[0].parameters["WPNAV_ACCEL"] = 100.0
        vehicles[0].tell_parameter("WPNAV_ACCEL")

    world.add(At(BEGUN, change))
    report = stream(world, log, port)
    assert report.reason.startswith("drone 1 was given WPNAV_ACCEL 100 by another")
    assert all(vehicle.mode == BRAKE for vehicle in vehicles)


def test_a_parameter_that_is_not_a_number_does_not_suffice(flight, log):
    for name in ("WPNAV_SPEED", "PSC_JERK_Z"):
        with World() as world:
            given = {"parameters": ABLE | {name: np.nan}}
            vehicles, report = flown_with(world, flight, log, free_port(), **given)
        assert f"cannot follow the show: {name} nan" in report.reason
        assert not any(ARM in vehicle.flown.commands for vehicle in vehicles)


@pytest.mark.parametrize("after", ["hold", "land", "return"])
def test_a_program_that_stood_still_leaves_each_vehicle_where_it_is(flight, log, after):
    with World() as world:
        port = free_port()
        vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
        world.add(At(BEGUN, lambda: setattr(world, "time", world.time + 5.0)))
        options = {"after_stop": after}
        report = stream(world, log, port, options=options)
    assert "this program stood still for 5" in report.reason
    for vehicle in vehicles:
        assert vehicle.mode == BRAKE
        # No setpoint was sent for a place it had not been near.
        assert vehicle.flown.setpoints[-1][0] < BEGUN + 0.2


def test_a_landing_that_is_promised_and_not_begun_is_ordered_again(
    world, flight, log, port
):
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    obey, orders = vehicles[1].obey, []

    def lie(message, now):
        if message.command == LAND and len(orders) < 2:
            orders.append(now)
            return 0
        return obey(message, now)

    vehicles[1].obey = lie
    report = stream(world, log, port)
    assert report.complete, report.reason
    assert len(orders) == 2
    assert not any(vehicle.armed for vehicle in vehicles)


def test_a_vehicle_that_is_armed_already_ends_it(world, flight, log, port):
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    vehicles[1].armed = True
    report = stream(world, log, port)
    assert "drone 2 is armed" in report.reason


@pytest.mark.parametrize(
    ("command", "result", "words"),
    [
        (ARM, 2, "answers MAV_CMD_COMPONENT_ARM_DISARM with MAV_RESULT_DENIED"),
        (ARM, 99, "with unknown MAV_RESULT 99"),
        (MODE, 4, "answers MAV_CMD_DO_SET_MODE with MAV_RESULT_FAILED"),
        (TAKEOFF, 4, "refuses to take off"),
        (TAKEOFF, 99, "refuses to take off"),
    ],
)
def test_an_order_that_is_refused_is_named_and_all_come_down(
    flight, log, command, result, words
):
    fault = Faults(command_result={command: result})
    with World() as world:
        vehicles, report = flown_with(
            world, flight, log, free_port(), faults={1: fault}
        )
    assert not report.complete
    assert words in report.reason
    assert not any(vehicle.armed for vehicle in vehicles[1:])
    assert all(not vehicle.flown.setpoints for vehicle in vehicles)


def test_orders_survive_links_that_lose_and_delay(world, flight, log, port):
    vehicles = []
    for number, vehicle in enumerate(fleet(flight, port), start=1):
        link = world.add(Relay(port, loss=0.1, delay=0.3, seed=number))
        vehicle.station = ("127.0.0.1", link.port)
        vehicles.append(world.add(vehicle))
    report = stream(world, log, port, options={"link_timeout": 2.0})
    # A take-off given twice is answered with a refusal once the vehicle has risen.
    assert report.complete, report.reason
    assert not any(vehicle.armed for vehicle in vehicles)


def test_a_take_off_refused_after_it_left_the_ground_is_not_final(
    world, flight, log, port
):
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    late = vehicles[1]
    obey = late.obey

    def rise_and_refuse(message, now):
        result = obey(message, now)
        return 4 if message.command == TAKEOFF else result

    late.obey = rise_and_refuse
    report = stream(world, log, port)
    assert report.complete, report.reason
    assert late.flown.commands.count(TAKEOFF) == 1


def test_nobody_there_ends_in_time(world, log, port):
    report = stream(world, log, port, options={"ready_timeout": 5.0})
    assert report.reason == "drone 1 is not ready after 5 s: not heard"


# --- parameters -----------------------------------------------------------------------


def test_a_stock_vehicle_is_refused_before_it_is_armed(world, flight, log, port):
    vehicles, report = flown_with(world, flight, log, port, parameters=STOCK)
    assert "cannot follow the show" in report.reason
    assert "WPNAV_ACCEL_Z 100 (wanted " in report.reason
    assert "PSC_JERK_XY 5 (wanted 15)" in report.reason
    assert all(ARM not in vehicle.flown.commands for vehicle in vehicles)
    assert all(vehicle.parameters == STOCK for vehicle in vehicles)


def test_parameters_are_raised_for_the_show_and_given_back(world, flight, log, port):
    vehicles = [world.add(v) for v in fleet(flight, port, parameters=STOCK)]
    during = []
    step = vehicles[0].on_set_position_target_local_ned

    def note(message, now):
        during.append(dict(vehicles[0].parameters))
        step(message, now)

    vehicles[0].on_set_position_target_local_ned = note
    report = stream(world, log, port, options={"set_parameters": True})
    assert report.complete, report.reason
    assert during[-1]["PSC_JERK_XY"] == 15.0
    assert during[-1]["WPNAV_ACCEL_Z"] > 100.0
    assert all(vehicle.parameters == STOCK for vehicle in vehicles)


def test_gains_are_set_for_the_show_and_given_back(world, flight, log, port):
    tuned = ABLE | {name: 1.0 for name in GAINS if name not in ABLE}
    vehicles = [world.add(v) for v in fleet(flight, port, parameters=tuned)]
    during = []
    step = vehicles[0].on_set_position_target_local_ned

    def note(message, now):
        during.append(dict(vehicles[0].parameters))
        step(message, now)

    vehicles[0].on_set_position_target_local_ned = note
    # They are wanted whatever a vehicle has; its limits suffice as they are.
    report = stream(world, log, port, options={"set_gains": True})
    assert report.complete, report.reason
    single = {name: np.float32(value) for name, value in GAINS.items()}
    assert {name: during[-1][name] for name in GAINS} == pytest.approx(single)
    assert during[-1]["WPNAV_ACCEL"] == ABLE["WPNAV_ACCEL"]
    assert all(vehicle.parameters == tuned for vehicle in vehicles)


def test_a_parameter_that_is_not_there_is_named(world, flight, log, port):
    fault = Faults(lacks="PSC_JERK_Z")
    _, report = flown_with(
        world, flight, log, port, faults={1: fault}, options={"ready_timeout": 90.0}
    )
    assert "drone 1 does not answer for parameter PSC_JERK_Z" in report.reason


# --- numbers, strangers, keys, noise --------------------------------------------------


def test_two_vehicles_with_one_number_do_not_fly(world, flight, log, port):
    world.add(Vehicle(port, 2, parameters=ABLE))
    vehicles, report = flown_with(world, flight, log, port)
    assert "drone 2 two vehicles speak as system 2" in report.reason
    assert all(ARM not in vehicle.flown.commands for vehicle in vehicles)


def test_two_vehicles_with_one_number_behind_one_address_do_not_fly(
    world, flight, log, port
):
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    # A second one that was switched on later speaks through the first one's radio.
    twin = world.add(Vehicle(port, 2, tells=True, parameters=ABLE))
    twin.boot, twin.socket = -40.0, vehicles[1].socket
    report = stream(world, log, port)
    assert not report.complete
    assert "two vehicles have its number" in report.reason
    assert all(not vehicle.flown.setpoints for vehicle in vehicles)


def test_a_stranger_that_comes_in_flight_changes_nothing(world, flight, log, port):
    beats = [heartbeat_of(1), heartbeat_of(2, armed=False), heartbeat_of(3)]
    stranger = world.add(Speaker(port, beats, period=0.1, start=BEGUN))
    _, report = flown_with(world, flight, log, port)
    assert report.complete, report.reason
    assert stranger.heard == []


def test_signed_vehicles_fly_and_strangers_are_not_heeded(world, flight, log, port):
    world.add(Speaker(port, [heartbeat_of(1)], period=0.1))
    _, report = flown_with(world, flight, log, port, key=KEY, options={"key": KEY})
    assert report.complete, report.reason


def test_vehicles_without_the_key_do_not_fly(world, flight, log, port):
    vehicles, report = flown_with(
        world, flight, log, port, options={"key": KEY, "ready_timeout": 5.0}
    )
    assert "sends no right signature for this key" in report.reason
    assert all(vehicle.flown.commands == [] for vehicle in vehicles)


def test_floods_of_junk_and_half_frames_cost_no_setpoint(world, flight, log, port):
    half = heartbeat_of(1)[:11]
    junk = [b"\xfd" * 2000, b"\xfe\xff\x00" * 600, half, bytes(range(256)) * 4]
    world.add(Speaker(port, junk * 20, period=0.05))
    _, report = flown_with(world, flight, log, port)
    assert report.complete, report.reason
    assert report.rate == pytest.approx(20.0, abs=0.05)
    assert report.longest_gap == pytest.approx(0.05, abs=1e-6)


# --- stopping -------------------------------------------------------------------------


class Watching(Silent):
    """Acts in the middle of the show."""

    def __init__(self, act, second=3):
        self.act, self.second, self.told, self.title = act, second, 0, ""

    def stage(self, title, total=None):  # noqa: ARG002 - the protocol names it
        self.title, self.told = title, 0

    def advance(self, steps=1):
        before, self.told = self.told, self.told + steps
        if self.title == "show" and before < self.second <= self.told:
            self.act()


def stopped(world, flight, log, port, act, **options):
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    report = stream(world, log, port, progress=Watching(act), options=options)
    return vehicles, report


def raise_fault():
    raise RuntimeError("a fault of our own")


def interrupt():
    signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_stops_everybody(world, flight, log, port, number):
    before = signal.getsignal(signal.Signals[number])
    vehicles, report = stopped(
        world, flight, log, port, lambda: signal.raise_signal(signal.Signals[number])
    )
    assert report.reason == f"stopped by {number}"
    assert all(vehicle.flown.modes == [GUIDED, BRAKE] for vehicle in vehicles)
    assert signal.getsignal(signal.Signals[number]) is before


def test_a_fault_of_the_program_stops_everybody(world, flight, log, port):
    vehicles, report = stopped(world, flight, log, port, raise_fault)
    assert report.reason == "this program failed: RuntimeError: a fault of our own"
    assert all(vehicle.flown.modes == [GUIDED, BRAKE] for vehicle in vehicles)


def test_a_record_that_cannot_be_written_stops_nobody(
    world, flight, log, tmp_path, monkeypatch
):
    port = free_port()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(FlownLog, "add", full)
    for vehicle in fleet(flight, port):
        world.add(vehicle)
    report = stream(world, log, port, flown=tmp_path / "flown.mcap")
    assert report.complete, report.reason
    assert "No space left on device" in report.unrecorded
    assert list(tmp_path.iterdir()) == []


def test_a_log_of_a_flight_takes_its_name_when_it_is_whole(tmp_path, monkeypatch):
    path = tmp_path / "flown.mcap"
    path.write_bytes(b"former")
    with FlownLog(path, (0,), 0) as record:
        record.add(0, 1.0, np.ones(3), np.zeros(3))
        assert path.read_bytes() == b"former"
    assert read_flown(path)[0].positions.tolist() == [[1.0, 1.0, 1.0]]
    whole = path.read_bytes()
    with FlownLog(path, (0,), 0) as record:
        pass
    assert "nothing was flown; a former one is whole" in record.fault
    assert path.read_bytes() == whole
    record = FlownLog(path, (1,), 0)
    record.add(1, 1.0, np.ones(3), np.zeros(3))
    with pytest.raises(AttributeError), record:
        record.add(1, 1.0, np.ones(3), None)
    assert path.read_bytes() != whole

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    path.write_bytes(whole)
    with FlownLog(path, (0,), 0) as record:
        record.add(0, 1.0, np.ones(3), np.zeros(3))
    assert "No space left on device; former files are whole" in record.fault
    assert path.read_bytes() == whole
    assert list(tmp_path.iterdir()) == [path]


def test_a_stopped_fleet_stays_on_the_plan_and_within_its_limits(
    world, flight, log, port, plan
):
    vehicles, report = stopped(world, flight, log, port, interrupt)
    ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    stamps = np.array(vehicles[0].flown.stamps)
    assert stamps[-1] == pytest.approx(report.show_time, abs=1e-3)
    assert np.all(np.diff(stamps) >= -1e-9)
    for index, vehicle in enumerate(vehicles):
        # The same show time for all: the distances are those of the plan.
        assert vehicle.flown.stamps == vehicles[0].flown.stamps
        places = np.array([place for place, _, _ in vehicle.flown.targets])
        wanted = plan.frame.to_enu(plan.position[index](stamps)) @ ned
        assert np.abs(places - wanted).max() < 0.01
        pushes = np.array([push for _, _, push in vehicle.flown.targets])
        assert np.linalg.norm(pushes[:, :2], axis=1).max() <= 5.0 + 1e-6
        assert np.abs(pushes[:, 2]).max() <= 5.0 + 1e-6
        # Speed and acceleration are those of the places, to the period's square.
        speeds = np.array([speed for _, speed, _ in vehicle.flown.targets])
        steps = np.diff(places, axis=0) / 0.05
        means = 0.5 * (speeds[1:] + speeds[:-1])
        begun = stamps[1:] > plan.launch_end + 0.1
        assert np.abs(steps - means)[begun].max() < 0.06
        assert speeds[-1] == pytest.approx([0.0, 0.0, 0.0])


def test_a_stopped_fleet_lands_where_no_drone_is_above_another(
    world, flight, log, port
):
    vehicles, report = stopped(world, flight, log, port, interrupt, after_stop="land")
    assert report.reason == "stopped by SIGTERM"
    assert not any(vehicle.armed for vehicle in vehicles)
    assert [vehicle.phase for vehicle in report.vehicles] == ["landed"] * 3
    for vehicle in vehicles:
        before = vehicle.flown.targets[-1][0]
        assert (vehicle.position + vehicle.stands)[:2] == pytest.approx(
            before[:2], abs=0.1
        )


def test_a_fleet_above_each_other_returns_instead_of_landing(world, tmp_path, port):
    flight = hop_flight(3)
    log = tmp_path / "hop.mcap"
    write_log(flight, log, manifest=b"{}")
    content = read_log(log)
    plan = stream_plan(content)
    # Nothing of this small show is wider than five metres.
    wide = type(plan)(**{**vars(plan), "separation": 50.0})
    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("showc.vehicle_link.stream.stream_plan", lambda *_: wide)
        report = stream(
            world,
            log,
            port,
            progress=Watching(interrupt, 1),
            options={"after_stop": "land"},
        )
    assert report.reason == "stopped by SIGTERM"
    assert not any(vehicle.armed for vehicle in vehicles)
    stamps = np.array(vehicles[0].flown.stamps)
    assert stamps[-1] == pytest.approx(plan.launch_end, abs=0.01)
    assert stamps.max() > plan.launch_end + 0.5


def test_a_stopped_fleet_returns_the_way_it_came(world, flight, log, port, plan):
    vehicles, _ = stopped(world, flight, log, port, interrupt, after_stop="return")
    ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    for index, vehicle in enumerate(vehicles):
        assert not vehicle.armed
        assert np.linalg.norm(vehicle.position[:2]) < 0.1
        stamps = np.array(vehicle.flown.stamps)
        assert vehicle.flown.stamps == vehicles[0].flown.stamps
        places = np.array([place for place, _, _ in vehicle.flown.targets])
        wanted = plan.frame.to_enu(plan.position[index](stamps)) @ ned
        assert np.abs(places - wanted).max() < 0.01
        assert stamps[-1] == pytest.approx(plan.launch_end, abs=1e-3)
        pushes = np.array([push for _, _, push in vehicle.flown.targets])
        assert np.linalg.norm(pushes, axis=1).max() <= 5.0 * np.sqrt(2.0)


def test_a_second_signal_ends_the_return(world, flight, log, port, plan):
    class Twice(Watching):
        def __init__(self):
            super().__init__(interrupt)

    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    seen = []
    step = vehicles[0].on_set_position_target_local_ned

    def watch(message, now):
        seen.append(message.time_boot_ms / 1000.0)
        if len(seen) > 30 and seen[-1] < max(seen) - 0.5 and not fired:
            fired.append(now)
            signal.raise_signal(signal.SIGINT)
        step(message, now)

    fired = []
    vehicles[0].on_set_position_target_local_ned = watch
    report = stream(
        world, log, port, progress=Twice(), options={"after_stop": "return"}
    )
    assert fired
    assert report.reason == "stopped by SIGTERM"
    assert all(vehicle.mode == BRAKE for vehicle in vehicles)
    assert seen[-1] > plan.launch_end + 0.5


def test_a_signal_before_the_show_brings_all_down(world, flight, log, port):
    class Early(Silent):
        def advance(self, steps=1):  # noqa: ARG002 - the protocol names it
            signal.raise_signal(signal.SIGHUP)

    vehicles = [world.add(vehicle) for vehicle in fleet(flight, port)]
    report = stream(world, log, port, progress=Early())
    assert report.reason == "stopped by SIGHUP"
    assert not any(vehicle.armed for vehicle in vehicles)
    assert all(vehicle.flown.setpoints == [] for vehicle in vehicles)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_the_command_stops_real_vehicles(log, flight, port, number):
    with ExitStack() as stack:
        vehicles = fleet(flight, port)
        command = [sys.executable, "-m", "showc", "stream", str(log), "--json"]
        link = ["--connect", f"udpin:127.0.0.1:{port}", "--link-timeout", "20"]
        run = stack.enter_context(
            subprocess.Popen(
                command + link,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        for vehicle in vehicles:
            stack.enter_context(vehicle)
        while vehicles[0].flown.setpoints[60:] == [] and run.poll() is None:
            vehicles[0].ending.wait(0.05)
        os.kill(run.pid, number)
        output, errors = run.communicate(timeout=120)
        modes = [vehicle.flown.modes for vehicle in vehicles]
    report = json.loads(output)
    assert run.returncode == 1, errors
    assert report["reason"] == f"stopped by {number.name}"
    assert modes == [[GUIDED, BRAKE]] * 3


# --- usage ----------------------------------------------------------------------------


def test_some_drones_of_the_show_fly_alone(world, flight, log, port, tmp_path):
    path = tmp_path / "flown.mcap"
    for vehicle in fleet(flight, port):
        world.add(vehicle)
    report = stream(world, log, port, drones=[2], flown=path)
    assert report.complete, report.reason
    comparison = compared(load_flown(log, [path]))
    assert [drone.drone for drone in comparison.drones] == [2]
    assert comparison.least_separation is None


def test_wrong_usage_is_refused(world, log, port, tmp_path):
    with pytest.raises(UsageError, match="rate 5 Hz is too low"):
        stream(world, log, port, options={"rate": 5.0})
    with pytest.raises(UsageError, match="drone 7 is not in the show of 3"):
        stream(world, log, port, drones=[7])
    with pytest.raises(UsageError, match="there is no such folder"):
        stream(world, log, port, flown=tmp_path / "no/such/place.mcap")
