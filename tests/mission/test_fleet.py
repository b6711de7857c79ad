"""What stands in the files of a whole fleet, checked from their bytes."""

import itertools
import json
from dataclasses import replace
from datetime import datetime, timedelta, timezone

import numpy as np
import pytest
from mission.flights import START, hop_flight, rows, shift_flight, swap_flight
from synthetic import gliding_flight

from showc.errors import ExportError, UsageError
from showc.flight import Flight
from showc.geodesy import SiteFrame
from showc.log.facts import fleet_token
from showc.mission import mission_files
from showc.plan.itinerary import Itinerary
from showc.script.show import Effect, MissionOptions

WAYPOINT, LAND, TAKEOFF, DELAY = 16, 21, 22, 93
CONDITION_DELAY, SPEED, SERVO = 112, 178, 183
LIGHTS = MissionOptions(light_servos=(9, 10, 11))


@pytest.fixture(scope="module")
def flight():
    return shift_flight(6, options=LIGHTS)


@pytest.fixture(scope="module")
def missions(flight):
    return mission_files(flight, start=START)


def commands(table):
    return [int(row[3]) for row in table]


def text(missions, drone=1, kind="waypoints"):
    return missions.files[f"missions/drone_{drone:04d}.{kind}"]


def with_options(flight, options):
    show = replace(flight.itinerary.show, mission=options)
    return Flight(Itinerary(show, flight.itinerary.legs), flight.legs, flight.starts)


def test_every_drone_has_both_files_and_the_parameters_are_there(missions):
    names = set(missions.files)
    assert names == {"missions/ardupilot.parm"} | {
        f"missions/drone_{n:04d}.{kind}"
        for n in range(1, 7)
        for kind in ("waypoints", "plan")
    }


def test_a_mission_starts_at_home_and_lands_at_named_coordinates(missions, flight):
    frame = SiteFrame.of(flight.itinerary.show.site)
    pads = flight.itinerary.show.formations["pads"].points
    for drone in range(6):
        table = rows(text(missions, drone + 1))
        assert [row[0] for row in table] == list(range(len(table)))
        assert [row[1] for row in table] == [1] + [0] * (len(table) - 1)
        assert commands(table)[:2] == [WAYPOINT, TAKEOFF]
        assert commands(table)[-1] == LAND
        assert table[0][2] == 0
        assert table[0][10] == pytest.approx(520.0, abs=0.01)
        for row in (table[0], table[1], table[-1]):
            place = frame.from_geodetic([row[8], row[9], 520.0])
            np.testing.assert_allclose(place[:2], pads[drone][:2], atol=0.012)


def test_frames_tell_positions_from_the_rest(missions):
    for row in rows(text(missions))[1:]:
        positional = row[3] in {WAYPOINT, LAND, TAKEOFF}
        assert row[2] == (3 if positional else 2)
        if not positional:
            assert row[8:11] == [0, 0, 0]


def test_every_leg_waits_for_its_clock_slot_with_its_speed_already_set(missions):
    table = rows(text(missions, 3))
    order = commands(table)
    slots = [i for i, row in enumerate(table) if row[3] == DELAY and row[4] < 0]
    assert len(slots) == 3
    for slot in slots:
        assert order[slot - 1] == SPEED
        between = {SERVO, CONDITION_DELAY, DELAY}
        after = [c for c in order[slot + 1 :] if c not in between]
        assert after[0] == WAYPOINT
    assert missions.prediction["start"] == START.isoformat()
    assert released(table) == [leg["slots"][0] for leg in missions.prediction["legs"]]


def released(table):
    """Mission times at which the timed legs of a file begin [s]."""
    found = []
    for number, row in enumerate(table):
        if row[3] == DELAY and row[4] < 0:
            clock = [int(value) for value in row[5:8]]
            moment = START.replace(hour=clock[0], minute=clock[1], second=clock[2])
            later = table[number + 1]
            # The clock counts whole seconds; what is missing is waited for after it.
            part = later[4] if later[3] == DELAY else 0.0
            assert 0.0 <= part < 1.0
            found.append((moment - START).total_seconds() + part)
    return found


def test_slots_leave_the_slack_after_the_latest_arrival(missions, flight):
    legs = missions.prediction["legs"]
    slack = flight.itinerary.show.mission.slack
    for before, after in itertools.pairwise(legs):
        latest = before["slot"] + before["duration"] + 0.55
        assert after["slot"] >= latest + slack - 1e-6
    # The script holds the last formation for five seconds.
    assert legs[2]["slot"] - legs[1]["slot"] - legs[1]["duration"] >= 5.0


def straight_leg_times(missions, drone):
    """Times of the timed legs from one file's numbers and the law's closed form."""
    table = rows(text(missions, drone))
    degree = 111318.845
    times, place, limits = [], None, {1: 10.0, 2: 4.0, 3: 3.0}
    timed = False
    for row in table[1:]:
        if row[3] == SPEED:
            limits[int(row[4])] = row[5]
        if row[3] == DELAY:
            timed = timed or row[4] < 0
        if row[3] in {TAKEOFF, WAYPOINT}:
            here = np.array(
                [
                    row[8] * degree,
                    row[9] * degree * np.cos(np.radians(48.1374)),
                    np.trunc(np.float32(row[10]) * np.float32(100)) / 100,
                ]
            )
            if timed and row[3] == WAYPOINT:
                times.append(closed_form(here - place, limits))
            place, timed = here, False
    return times


def closed_form(step, limits):
    """T = L / V + V / a + 2 sqrt(pi a / (2 S)): all legs here reach their speed."""
    length = np.linalg.norm(step)
    level, climb = np.hypot(step[0], step[1]) / length, step[2] / length
    rise = limits[2] if climb > 0 else limits[3]
    with np.errstate(divide="ignore"):
        speed = min(np.divide(limits[1], level), np.divide(rise, abs(climb)), key=float)
        push = min(np.divide(3.5, level), np.divide(2.5, abs(climb)), key=float)
    snap = 0.5 * min(np.pi * 20 / 0.3, np.radians(1100) * 9.80665)
    ramp = speed / push + 2.0 * np.sqrt(np.pi * push / (2.0 * snap))
    assert speed * ramp <= length
    assert push < 20.0 * np.pi * 20.0 / (2.0 * snap)
    return length / speed + ramp


def test_all_drones_of_a_leg_need_the_same_time(missions):
    times = np.array([straight_leg_times(missions, drone) for drone in range(1, 7)])
    assert times.shape == (6, 3)
    # Speeds are given to a tenth of a millimetre a second.
    assert np.ptp(times, axis=0).max() < 0.002
    wanted = [leg["duration"] for leg in missions.prediction["legs"]]
    np.testing.assert_allclose(times.max(axis=0), wanted, atol=0.01)


def test_lights_change_when_the_formation_does(missions):
    table = rows(text(missions))
    order = commands(table)
    servos = [(i, int(r[4]), int(r[5])) for i, r in enumerate(table) if r[3] == SERVO]
    # Dark after take-off, red with the first leg, green with the second, then dark.
    assert [(output, pwm) for _, output, pwm in servos] == [
        (9, 1000),
        (10, 1000),
        (11, 1000),
        (9, 2000),
        (9, 1000),
        (10, 2000),
        (10, 1000),
    ]
    for index, _, _ in servos[3:]:
        back = next(c for c in reversed(order[:index]) if c != SERVO)
        ahead = next(c for c in order[index:] if c != SERVO)
        assert (back, ahead) == (DELAY, WAYPOINT)


@pytest.mark.parametrize(
    ("fade", "neighbours"),
    [("linear", (CONDITION_DELAY, WAYPOINT)), ("end", (WAYPOINT, SPEED))],
)
def test_fades_place_the_servo_items(fade, neighbours):
    missions = mission_files(
        shift_flight(4, options=LIGHTS, fades=(fade,)), start=START
    )
    table = rows(text(missions))
    order = commands(table)
    red = next(i for i, row in enumerate(table) if row[3] == SERVO and row[5] == 2000)
    back = next(c for c in reversed(order[:red]) if c != SERVO)
    ahead = next(c for c in order[red:] if c != SERVO)
    assert (back, ahead) == neighbours
    if fade == "linear":
        pause = next(row[4] for row in table if row[3] == CONDITION_DELAY)
        leg = missions.prediction["legs"][0]
        lag = missions.prediction["clock_lag"] / 2
        place = missions.predicted.position([leg["slot"] + lag + pause])[0, 0]
        # Straight up from 6 to 8 m.
        assert place[2] == pytest.approx(7.0, abs=0.03)


def test_without_a_start_slots_are_minutes_and_seconds_of_any_hour(flight, missions):
    open_hour = mission_files(flight)
    for drone in range(1, 7):
        named, left_open = (
            [row[4:8] for row in rows(text(one, drone)) if row[3] == DELAY]
            for one in (missions, open_hour)
        )
        # The start is a full hour: but for the hour, the same slots.
        assert left_open == [[a, -1 if a < 0 else b, c, d] for a, b, c, d in named]
    assert open_hour.prediction["start"] is None
    assert open_hour.prediction["clock"] == "hour"
    assert any("past the hour" in line for line in open_hour.warnings)


def test_the_minute_comes_from_the_caller_or_the_script(flight):
    options = replace(LIGHTS, start_minute=30)
    for missions, minute in (
        (mission_files(with_options(flight, options)), 30),
        (mission_files(with_options(flight, options), start_minute=59), 59),
    ):
        slots = [r[6:8] for r in rows(text(missions)) if r[3] == DELAY and r[4] < 0]
        assert missions.prediction["start_minute"] == minute
        assert slots[0][0] == minute
        assert slots[-1][0] in {minute, (minute + 1) % 60}


def test_a_show_longer_than_an_hour_needs_a_date(flight):
    legs = [
        replace(part, duration=4000.0) if part.leg.kind == "hold" else part
        for part in flight.legs
    ]
    long = Flight(flight.itinerary, tuple(legs), 5000.0 * np.arange(len(legs)))
    with pytest.raises(ExportError, match="--start"):
        mission_files(long)
    assert mission_files(long, start=START).prediction["duration"] > 3600.0


def test_px4_waits_for_what_is_left_of_the_time(flight):
    missions = mission_files(flight, autopilot="px4")
    delays = [row[4:8] for row in rows(text(missions)) if row[3] == DELAY]
    assert all(delay[0] > 0 for delay in delays)


def test_the_predicted_flight_goes_from_pad_to_pad(missions, flight):
    predicted = missions.predicted
    assert predicted is not None
    places = predicted.position([-5.0, 0.0, predicted.duration, 1e4])
    pads = flight.itinerary.show.formations["pads"].points
    np.testing.assert_allclose(places, np.broadcast_to(pads, (4, 6, 3)), atol=0.02)
    legs = missions.prediction["legs"]
    reached = predicted.position([leg["slot"] + leg["duration"] + 0.55 for leg in legs])
    for leg, place in zip(legs, reached, strict=True):
        goal = flight.legs[leg["leg"]].leg.goal
        # Drones have arrived; they fly a little beyond their goals, and come back.
        assert np.linalg.norm(place - goal, axis=1).max() < 0.3
    # No jump anywhere.
    steps = np.diff(predicted.position(np.arange(0, predicted.duration, 0.05)), axis=0)
    assert np.linalg.norm(steps, axis=2).max() < 0.05 * 8.0


def test_arrivals_are_where_the_predicted_flight_comes_near(missions, flight):
    clock_lag = missions.prediction["clock_lag"]
    for leg in missions.prediction["legs"]:
        goal = flight.legs[leg["leg"]].leg.goal
        for drone, moment, late in zip(
            leg["drones"], leg["arrivals"], leg["delays"], strict=True
        ):
            before, after = missions.predicted.position([moment - 0.01, moment + 0.01])
            assert np.linalg.norm(before[drone - 1] - goal[drone - 1]) > 0.28
            assert np.linalg.norm(after[drone - 1] - goal[drone - 1]) < 0.32
            end = leg["slot"] + leg["duration"] + late + 0.5 * clock_lag
            assert end - 0.8 < moment < end


def test_little_slack_is_warned_of(flight):
    hasty = MissionOptions(slack=1.0)
    missions = mission_files(with_options(flight, hasty), start=START)
    assert any("slack is 1 s" in line for line in missions.warnings)


def test_predicted_positions_keep_the_proved_separation(missions):
    predicted, required = missions.predicted, 1.0
    times = np.arange(0.0, predicted.duration, 0.02)
    places = predicted.position(times)
    least = min(
        np.linalg.norm(places[:, a] - places[:, b], axis=1).min()
        for a in range(6)
        for b in range(a)
    )
    proved = min(leg["closest"]["distance"] for leg in missions.prediction["legs"])
    assert required - 0.022 <= proved <= least


def test_drones_that_would_meet_in_the_middle_get_another_encoding():
    missions = mission_files(swap_flight(6), start=START)
    leg = missions.prediction["legs"][1]
    assert leg["encoding"] != "straight"
    assert 1 < len(leg["slots"]) <= 3
    assert leg["closest"]["distance"] >= 0.978
    assert any(leg["name"] in line for line in missions.warnings)


def test_crossing_lines_are_flown_one_after_the_other():
    missions = mission_files(gliding_flight(16), start=START)
    legs = missions.prediction["legs"]
    staggered = [leg for leg in legs if "staggered" in leg["encoding"]]
    assert staggered
    for leg in legs:
        assert leg["closest"]["distance"] >= 0.978
    # The slots in the files are as far apart as the prediction says.
    first = staggered[0]
    number = legs.index(first)
    slots = {released(rows(text(missions, drone)))[number] for drone in first["drones"]}
    longest = float(first["encoding"].split()[-2])
    assert min(slots) == pytest.approx(first["slot"])
    assert max(slots) == pytest.approx(first["slot"] + longest)
    places = missions.predicted.position(
        np.arange(0.0, missions.predicted.duration, 0.05)
    )
    nearest = min(
        np.linalg.norm(places[:, a] - places[:, :a].swapaxes(0, 1), axis=2).min()
        for a in range(1, 16)
    )
    # The proof is about straight parts; predicted flights leave them by centimetres.
    assert nearest >= min(leg["closest"]["distance"] for leg in legs) - 0.05


@pytest.mark.slow
def test_a_thousand_drones_have_a_mission_each():
    flight = shift_flight(1000, options=LIGHTS)
    missions = mission_files(flight, start=START)
    assert len(missions.files) == 2001


def test_a_fleet_that_cannot_be_kept_apart_is_refused():
    flight = swap_flight(6)
    show = flight.itinerary.show
    low = replace(show.limits, position_min=(-9, -9, 5.9), position_max=(9, 9, 8.1))
    legs = tuple(replace(leg, limits=low) for leg in flight.itinerary.legs)
    parts = tuple(
        replace(part, leg=leg) for part, leg in zip(flight.legs, legs, strict=True)
    )
    caged = Flight(Itinerary(show, legs), parts, flight.starts)
    with pytest.raises(ExportError, match=r"drones \d+ and \d+ come as near as .* at"):
        mission_files(caged, start=START)


def test_more_items_than_the_board_holds_are_refused():
    flight = shift_flight(1, options=LIGHTS)
    legs, parts, starts = [], [], []
    repeated = [flight.legs[0], *flight.legs[1:-2] * 12, *flight.legs[-2:]]
    for index, part in enumerate(repeated):
        leg = replace(part.leg, index=index)
        legs.append(leg)
        parts.append(replace(part, leg=leg))
        starts.append(10.0 * index)
    small = MissionOptions(light_servos=(9, 10, 11), board="4k")
    show = replace(flight.itinerary.show, mission=small)
    long = Flight(Itinerary(show, tuple(legs)), tuple(parts), np.array(starts))
    with pytest.raises(
        ExportError, match=r"drone 1 has \d+ items, board '4k' holds 161"
    ):
        mission_files(long, start=START)


def test_a_start_without_a_zone_or_with_a_fraction_is_refused(flight):
    with pytest.raises(UsageError, match="no time zone"):
        mission_files(flight, start=START.replace(tzinfo=None))
    with pytest.raises(UsageError, match="whole second"):
        mission_files(flight, start=START + timedelta(milliseconds=3))


def test_a_start_in_another_zone_is_the_same_instant(missions, flight):
    there = datetime(2026, 6, 1, 22, tzinfo=timezone(timedelta(hours=2)))
    assert mission_files(flight, start=there).files == missions.files


def test_slots_go_over_midnight(flight):
    late = START.replace(hour=23, minute=59, second=45)
    table = rows(text(mission_files(flight, start=late)))
    clock = [row[5:8] for row in table if row[3] == DELAY and row[4] < 0]
    assert clock[0][0] == 23 and clock[-1][0] == 0


def test_same_input_same_bytes(missions, flight):
    again = mission_files(flight, start=START)
    assert again.files == missions.files
    assert json.dumps(again.prediction) == json.dumps(missions.prediction)
    assert again.fleet_token == missions.fleet_token == fleet_token(missions.files)


def test_the_token_tells_compiles_apart(missions, flight):
    later = mission_files(flight, start=START + timedelta(seconds=1))
    assert later.fleet_token != missions.fleet_token
    assert len(missions.fleet_token) == 64


def test_px4_speaks_its_own_dialect(flight):
    missions = mission_files(flight, start=START, autopilot="px4")
    table = rows(text(missions))
    assert commands(table)[0] == TAKEOFF
    assert all(row[4] >= 0 for row in table if row[3] == DELAY)
    assert CONDITION_DELAY not in commands(table)
    assert missions.predicted is None
    assert "missions/ardupilot.parm" not in missions.files
    assert any("not predicted" in line for line in missions.warnings)
    plan = json.loads(text(missions, kind="plan"))
    assert plan["mission"]["firmwareType"] == 12
    # Drones look along the show's +x, a quarter turn right of the site's heading.
    yaw = {row[7] for row in table if row[3] in {TAKEOFF, WAYPOINT, LAND}}
    assert yaw == {120.0}


def test_the_parameter_file_names_its_firmware(missions):
    content = missions.files["missions/ardupilot.parm"].decode()
    assert "ArduCopter 4.6" in content.splitlines()[0]
    values = dict(
        line.split(",") for line in content.splitlines() if not line.startswith("#")
    )
    assert values["WPNAV_ACCEL"] == "350" and values["WPNAV_JERK"] == "20"
    # The first is the launch's, at 3 m/s; legs say theirs.
    assert values["WPNAV_SPEED_UP"] == "300" and values["WPNAV_SPEED_DN"] == "300"
    assert values["WPNAV_ACCEL_Z"] == "250" and values["PSC_JERK_XY"] == "20"


def test_a_strict_tilt_limit_lowers_the_acceleration(flight):
    show = flight.itinerary.show
    gentle = replace(show, limits=replace(show.limits, tilt=0.2))
    other = Flight(Itinerary(gentle, flight.itinerary.legs), flight.legs, flight.starts)
    content = mission_files(other).files["missions/ardupilot.parm"].decode()
    assert "WPNAV_ACCEL,198" in content.splitlines()


def test_the_plan_carries_fence_rally_and_token(missions):
    plan = json.loads(text(missions, kind="plan"))
    assert plan["fileType"] == "Plan" and plan["fleetToken"] == missions.fleet_token
    assert plan["mission"]["firmwareType"] == 3
    items = plan["mission"]["items"]
    assert [item["doJumpId"] for item in items] == list(range(1, len(items) + 1))
    table = rows(text(missions))[1:]
    assert len(items) == len(table)
    for item, row in zip(items, table, strict=True):
        assert (item["command"], item["frame"]) == (row[3], row[2])
        assert item["params"] == row[4:11]
    corners = np.array(plan["geoFence"]["polygons"][0]["polygon"])
    assert corners.shape == (5, 2)
    north, east = corners[:, 0], corners[:, 1]
    turned = np.roll(corners, -1, axis=0)
    # Clockwise from above: the area in (east, north) is negative.
    assert np.sum(east * turned[:, 0] - turned[:, 1] * north) < 0.0
    rally = plan["rallyPoints"]["points"][0]
    assert rally[:2] == plan["mission"]["plannedHomePosition"][:2]


def test_what_the_missions_leave_out_of_the_lights_is_said_by_group():
    flight = shift_flight(2, options=LIGHTS, fades=("start", "linear"))
    show = flight.itinerary.show
    red = replace(show.formations["red"], effect=Effect("pulse", 2.0))
    moves = tuple(
        replace(move, group="left", effect=Effect("rainbow", 3.0))
        if move.to == "green"
        else move
        for move in show.transitions
    )
    formations, groups = {**show.formations, "red": red}, {"left": (0, 1)}
    lit = replace(show, formations=formations, groups=groups, transitions=moves)
    for autopilot in ("ardupilot", "px4"):
        missions = mission_files(
            Flight(Itinerary(lit, flight.itinerary.legs), flight.legs, flight.starts),
            start=START,
            autopilot=autopilot,
        )
        said = [line for line in missions.warnings if "colour effects" in line]
        assert len(said) == 1
        assert said[0].endswith("pulse over red, rainbow over green (group left)")
        fades = [line for line in missions.warnings if "linear fade" in line]
        assert len(fades) == 1
        assert "(group left)" in fades[0]


def test_missions_without_lights_say_so(missions):
    assert not any("no lights" in line for line in missions.warnings)
    dark = mission_files(shift_flight(2), start=START)
    assert any("no lights" in line for line in dark.warnings)


def test_take_off_and_climb_are_as_slow_as_the_launch_asks():
    # A speed said before the climb comes when that has begun: slow ones were lost.
    flight = shift_flight(2)
    show = flight.itinerary.show
    slow = replace(show, launch=replace(show.launch, climb_speed=0.5))
    slow_flight = replace(flight, itinerary=replace(flight.itinerary, show=slow))
    found = mission_files(slow_flight, start=START)
    assert b"\nWPNAV_SPEED_UP,50\n" in found.files["missions/ardupilot.parm"]
    table = rows(text(found))
    climb = commands(table).index(WAYPOINT, 1)
    assert SPEED not in commands(table)[:climb]
    rising = [float(row[5]) for row in table if row[3] == SPEED and row[4] == 2]
    assert max(rising) > 0.5


@pytest.mark.parametrize(("altitude", "height"), [(1.4, 1.002), (3.0, 1.502)])
def test_takeoffs_go_to_a_metre_at_least(altitude, height):
    # ArduCopter raises what is lower: to 0.4 m it rose to 1.03 m.
    found = mission_files(hop_flight(1, altitude), start=START)
    assert rows(text(found))[1][10] == height


def test_a_launch_below_a_metre_has_no_missions():
    with pytest.raises(ExportError, match=r"the launch ends 0\.8 m above a pad"):
        mission_files(hop_flight(1, 0.8), start=START)


def test_every_speed_is_said_again_before_the_first_timed_leg(missions):
    # The first waypoint takes the vertical speeds from the parameters once more.
    table = rows(text(missions))
    staged = commands(table).index(WAYPOINT, 1)
    slot = commands(table).index(DELAY)
    said = {int(row[4]): row[5] for row in table[staged:slot] if row[3] == SPEED}
    assert 1 in said and said.keys() & {2, 3}
