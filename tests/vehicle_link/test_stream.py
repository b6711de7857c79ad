"""Shows flown by setpoints over real datagrams, and compared with their plans."""

import json
import socket
import time
from contextlib import ExitStack

import numpy as np
import pytest
from mcap.reader import make_reader
from mission.flights import hop_flight
from vehicle_link.threaded_vehicle import Faults, Vehicle

from showc.errors import DamagedFileError, UsageError
from showc.log.writer import write_log
from showc.mission.geodesy import SiteFrame
from showc.progress import Silent
from showc.vehicle_link.compare import compare_flown
from showc.vehicle_link.flown import FlownLog, read_flown
from showc.vehicle_link.stream import Clock, StreamOptions, stream_show

SPEED = 2.0
"""How much faster than the wall's clock these shows run."""

ARM, TAKEOFF, LAND, MODE = 400, 22, 21, 176


@pytest.fixture(scope="module")
def flight():
    return hop_flight(3)


@pytest.fixture(scope="module")
def log(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("stream") / "output.mcap"
    write_log(flight, path, manifest=b"{}")
    return path


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def fleet(stack, flight, port, *, autopilot=3, faults=None, moved=None, speed=SPEED):
    """One vehicle on each pad; ``moved`` puts one beside it (north, metres)."""
    show = flight.itinerary.show
    frame = SiteFrame.of(show.site)
    vehicles = []
    for index, pad in enumerate(show.formations["pads"].points):
        east, north, up = frame.to_enu(pad)
        north += (moved or {}).get(index + 1, 0.0)
        vehicle = Vehicle(
            port,
            index + 1,
            autopilot=autopilot,
            stands=(north, east, -up),
            rate=speed,
            faults=(faults or {}).get(index + 1),
        )
        vehicles.append(stack.enter_context(vehicle))
    return vehicles


def stream(log, port, *, speed=SPEED, **given):
    options = StreamOptions(**{"ready_timeout": 20.0, **given.pop("options", {})})
    return stream_show(
        log,
        connections=[f"udpin:127.0.0.1:{port}"],
        clock=Clock(speed),
        options=options,
        **given,
    )


@pytest.fixture(scope="module")
def flown(log, flight, tmp_path_factory):
    """One whole show on three vehicles: report, vehicles, log of what was flown."""
    path = tmp_path_factory.mktemp("flown") / "flown.mcap"
    port = free_port()
    with ExitStack() as stack:
        vehicles = fleet(stack, flight, port)
        report = stream(log, port, flown=path)
    return report, vehicles, path


def test_all_vehicles_fly_to_the_end_and_land(flown, flight):
    report, vehicles, _ = flown
    assert report.complete, report.reason
    assert report.show_time == pytest.approx(flight.duration, abs=1e-3)
    assert [vehicle.phase for vehicle in report.vehicles] == ["landed"] * 3
    for vehicle in vehicles:
        assert not vehicle.armed
        assert vehicle.flown.modes == [4]
        order = [c for c in vehicle.flown.commands if c in {ARM, TAKEOFF, LAND}]
        assert order[:2] == [ARM, TAKEOFF] and order[-1] == LAND


def test_setpoints_come_at_the_rate_with_speed_and_acceleration(flown):
    _, vehicles, _ = flown
    for vehicle in vehicles:
        times = np.array([moment for moment, _ in vehicle.flown.setpoints])
        assert {mask for _, mask in vehicle.flown.setpoints} == {0x0C00}
        # 20 Hz were asked for, 10 Hz are the least; a busy machine delays single ones.
        assert len(times) / np.ptp(times) > 10.0
        assert np.median(np.diff(times)) < 0.1


def test_what_was_flown_is_the_plan(flown, log, flight):
    report, _, path = flown
    comparison = compare_flown(log, path)
    assert [drone.drone for drone in comparison.drones] == [1, 2, 3]
    # The vehicle follows within centimetres; the rest is the datagrams' time, which a
    # busy machine stretches for single ones, and hurried time multiplies.
    worst = [vehicle.greatest_deviation for vehicle in report.vehicles]
    assert comparison.greatest_error == pytest.approx(max(worst), abs=0.02)
    for drone in comparison.drones:
        assert drone.rms_error < 0.25
        assert drone.end == pytest.approx(flight.duration, abs=0.3)
    assert comparison.kept_separation
    assert comparison.least_separation == pytest.approx(3.0, abs=0.05)
    transitions = [a for a in comparison.arrivals if a.difference is not None]
    assert len(transitions) >= 3
    assert np.median([abs(arrival.difference) for arrival in transitions]) < 0.2
    json.dumps(comparison.to_json())


def test_the_flown_log_is_mcap_on_the_plans_time(flown, log):
    _, _, path = flown
    with path.open("rb") as stream, log.open("rb") as planned:
        times = [m.log_time for _, _, m in make_reader(stream).iter_messages()]
        epoch = min(m.log_time for _, _, m in make_reader(planned).iter_messages())
    assert all(epoch <= moment <= epoch + 120e9 for moment in times)


def test_all_vehicles_share_one_clock(flown):
    tracks = read_flown(flown[2])
    first = [track.times[0] for track in tracks.values()]
    assert np.ptp(first) < 0.5


@pytest.mark.slow
def test_in_real_time_setpoints_keep_their_rate_and_their_times(log, flight, tmp_path):
    port = free_port()
    with ExitStack() as stack:
        vehicles = fleet(stack, flight, port, speed=1.0)
        report = stream(log, port, speed=1.0, flown=tmp_path / "flown.mcap")
    assert report.complete, report.reason
    assert 10.0 < report.rate < 20.5
    assert report.longest_gap >= 1.0 / report.rate
    lags = []
    for vehicle in vehicles:
        times = np.array([moment for moment, _ in vehicle.flown.setpoints])
        stamps = np.array(vehicle.flown.stamps)
        # During the countdown, and when the show is over, the stamp stands still.
        moving = np.concatenate([[False], np.diff(stamps) > 0.0])
        times, stamps = times[moving], stamps[moving]
        # At least ten in every second of the show.
        counts = np.searchsorted(times, times + 1.0) - np.arange(times.size)
        assert counts[times < times[-1] - 1.0].min() >= 10
        late = times - stamps
        late -= late.min()
        assert np.median(late) < 0.02
        assert np.quantile(late, 0.99) < 0.1
        lags.append(times[0] - stamps[0] + vehicle.begun)
    # One clock: the same stamp comes to all at the same time.
    assert np.ptp(lags) < 0.1
    comparison = compare_flown(log, tmp_path / "flown.mcap")
    assert comparison.greatest_error < 0.5
    assert all(drone.rms_error < 0.1 for drone in comparison.drones)


@pytest.mark.slow
def test_px4_gets_setpoints_before_it_goes_offboard(log, flight):
    port = free_port()
    with ExitStack() as stack:
        vehicles = fleet(stack, flight, port, autopilot=12)
        report = stream(log, port)
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
        report = stream(log, port, options={"corridor": 5.0})
    assert report.complete, report.reason
    assert {mode.name for mode in vehicle.modes} == {"OFFBOARD"}
    assert vehicle.armings[0].arm
    assert vehicle.landings
    heights = np.array([-setpoint["z"] for setpoint in vehicle.setpoints])
    top = max(float(points.points[0, 2]) for points in show.formations.values())
    assert heights.max() == pytest.approx(top, abs=0.05)
    assert heights[0] == 0.0 and heights[-1] == pytest.approx(0.0, abs=0.05)


def test_a_lost_link_stops_everybody(log, flight):
    port = free_port()
    with ExitStack() as stack:
        vehicles = fleet(stack, flight, port, faults={2: Faults(silent_at=5.5)})
        report = stream(log, port)
    assert not report.complete
    assert "drone 2 was not heard" in report.reason
    assert report.show_time < flight.duration
    assert vehicles[0].flown.modes[-1] == 17
    assert vehicles[2].flown.modes[-1] == 17


def test_leaving_the_corridor_stops_everybody(log, flight):
    port = free_port()
    drift = Faults(drift=(1.5, 0.0, 0.0), drift_at=5.0)
    with ExitStack() as stack:
        vehicles = fleet(stack, flight, port, faults={3: drift})
        report = stream(log, port, options={"corridor": 2.0})
    assert not report.complete
    assert "drone 3 is 2." in report.reason
    assert "from its trajectory" in report.reason
    assert all(vehicle.flown.modes[-1] == 17 for vehicle in vehicles)


def test_a_vehicle_taken_over_stops_the_others_and_is_left_alone(log, flight):
    port = free_port()
    with ExitStack() as stack:
        vehicles = fleet(stack, flight, port, faults={2: Faults(taken_over_at=5.5)})
        report = stream(log, port)
    assert report.reason == "drone 2 left its mode or disarmed"
    assert 0.0 < report.show_time < flight.duration
    assert vehicles[0].flown.modes[-1] == vehicles[2].flown.modes[-1] == 17
    assert vehicles[1].flown.modes == [4]
    assert vehicles[1].mode == 5


def test_a_vehicle_beside_its_pad_is_not_armed(log, flight):
    port = free_port()
    with ExitStack() as stack:
        vehicles = fleet(stack, flight, port, moved={2: 8.0})
        report = stream(log, port)
    assert not report.complete
    assert report.reason == "drone 2 stands 8.0 m from its pad"
    assert not any(vehicle.armed for vehicle in vehicles[1:2])
    assert all(not vehicle.flown.setpoints for vehicle in vehicles)


def test_a_vehicle_that_does_not_arm_is_named(log, flight):
    port = free_port()
    with ExitStack() as stack:
        vehicles = fleet(stack, flight, port, faults={1: Faults(refuse_arming=True)})
        report = stream(log, port)
        time.sleep(0.3)
    assert not report.complete
    assert not any(vehicle.armed for vehicle in vehicles)
    assert report.reason == (
        "drone 1 answers MAV_CMD_COMPONENT_ARM_DISARM with MAV_RESULT_DENIED"
    )


def test_an_operator_who_interrupts_stops_everybody(log, flight):
    class Interrupting(Silent):
        """Interrupts in the second second of the show."""

        def stage(self, title, total=None):  # noqa: ARG002 - the protocol names it
            self.title, self.told = title, 0

        def advance(self, steps=1):
            self.told += steps
            if self.title == "show" and self.told >= 2:
                raise KeyboardInterrupt

    port = free_port()
    with ExitStack() as stack:
        vehicles = fleet(stack, flight, port)
        report = stream(log, port, progress=Interrupting())
    assert report.reason == "stopped by the operator"
    assert all(vehicle.flown.modes[-1] == 17 for vehicle in vehicles)


def test_nobody_there_ends_in_time(log):
    report = stream(log, free_port(), options={"ready_timeout": 2.0})
    assert not report.complete
    assert "is not ready after 2 s: not heard" in report.reason


def test_some_drones_of_the_show_fly_alone(log, flight, tmp_path):
    port = free_port()
    path = tmp_path / "flown.mcap"
    with ExitStack() as stack:
        fleet(stack, flight, port)
        report = stream(log, port, drones=[2], flown=path)
    assert report.complete, report.reason
    comparison = compare_flown(log, path)
    assert [drone.drone for drone in comparison.drones] == [2]
    assert comparison.least_separation is None


def test_wrong_usage_is_told(log, tmp_path):
    with pytest.raises(UsageError, match="rate 5 Hz is too low"):
        stream(log, free_port(), options={"rate": 5.0})
    with pytest.raises(UsageError, match="drone 7 is not in the show of 3"):
        stream(log, free_port(), drones=[7])
    with pytest.raises(UsageError, match="cannot be written"):
        stream(log, free_port(), flown=tmp_path / "no/such/place.mcap")


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
