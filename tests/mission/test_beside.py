"""Missions of groups that fly beside each other, at times of their own."""

import json
from itertools import pairwise

import numpy as np
import pytest
from mission.flights import formula_flight, rows
from mission.planted import Case

from showc.autopilot.timing import Timing
from showc.fleet import solve_itinerary
from showc.fleet.options import SolveOptions
from showc.log.facts import fleet_token
from showc.log.reader import read_log
from showc.mission import mission_files
from showc.mission.feasibility import mission_outlook
from showc.mission.fleet import builder_of
from showc.plan import build_itinerary
from showc.progress import Silent
from showc.schedule.course import Course
from showc.schedule.layout import build_timeline
from showc.schedule.surroundings import fleet_motions
from showc.script import read_show
from showc.vehicle_link.course import course_of

SCRIPT = """\
showc: 1
drones: 4
mission: {light_servos: [9, 10, 11]}
music: {offset: 4}
pads: {type: grid, rows: 1, step: 4, count: 4}
launch: {altitude: 10, hold: 2}
groups: {left: 1-2, right: 3-4}
formations:
  up: {type: points, points: [[-8, 0, 16], [-4, 0, 16]], colour: gold}
  far: {type: points, points: [[-8, 0, 10], [-4, 0, 10]], colour: red}
  down: {type: points, points: [[8, 0, 10], [4, 0, 10]], colour: blue}
transitions:
  - {to: up, group: left, start: 10, at: 20}
  - {to: far, group: right, at: 38, duration: 12, hold: 4}
  - {to: down, group: left, at: 36, duration: 10, hold: 9}
landing: {altitude: 10}
"""


@pytest.fixture(scope="module")
def flight():
    itinerary = build_itinerary(read_show(SCRIPT.encode()).show)
    return solve_itinerary(itinerary, SolveOptions(), Silent())


@pytest.fixture(scope="module")
def case(flight, tmp_path_factory):
    return Case(tmp_path_factory.mktemp("beside"), flight)


def legs(case):
    return {leg["name"]: leg for leg in case.missions.prediction["legs"]}


def test_groups_fly_at_the_same_time_in_missions_and_all_is_proved(case):
    assert case.failures() == set()
    right, left = legs(case)["launch -> far"], legs(case)["up -> down"]
    assert right["slot"] < left["slot"] + left["duration"]
    assert left["slot"] < right["slots"][-1] + right["durations"][-1]
    # The proof of the bytes and that of the plan find the same pair and distance.
    found = case.checks()["VRF411"]
    nearest = min(
        (leg["closest"] for leg in legs(case).values()), key=lambda one: one["distance"]
    )
    assert list(found.where.pair) == nearest["drones"]
    assert found.value == pytest.approx(nearest["distance"], abs=0.01)


def test_slots_follow_the_cues_by_one_shift_of_the_clock(case):
    said = [line for line in case.missions.warnings if "start the music " in line]
    shift = float(said[0].split("start the music ")[1].split()[0]) - 4.0
    timeline = case.missions.predicted.timeline
    assert shift == pytest.approx(timeline.shift, abs=0.05)
    asked = {"launch -> up": 24.0, "launch -> far": 42.0, "up -> down": 40.0}
    for leg in timeline.legs:
        if leg.leg.name in asked:
            late = leg.arrival - asked[leg.leg.name] - timeline.shift
            assert late == pytest.approx(leg.late, abs=1e-9)
            assert abs(late) <= 0.1


def test_each_drone_waits_for_the_slots_of_its_own_group(case):
    slots = {}
    for drone in (1, 3):
        table = rows(case.files[f"missions/drone_{drone:04d}.waypoints"])
        slots[drone] = [row[6] * 60 + row[7] for row in table if row[3] == 93][:-1]
        assert [int(row[3]) for row in table].count(22) == 1
    assert slots[1] != slots[3]


def test_a_group_that_leaves_into_the_other_is_caught(case):
    """Slots of one group moved by some seconds, with every hash made to fit."""

    def later(seconds):
        def change(table):
            for row in table:
                # Slots of the leg beside the other group.
                if row[3] == "93" and row[4] == "-1" and 25 <= int(row[7]) < 50:
                    row[7] = str(int(row[7]) + seconds)
            return table

        return change

    for drones, seconds in (((1, 2), -2), ((3, 4), 2)):
        moved = {}
        for drone in drones:
            moved |= case.with_row(drone, later(seconds))
        assert "VRF411" in case.caught(moved)


def test_what_one_group_shows_in_anothers_place_is_caught(case):
    def dark(table):
        for row in table:
            if row[3] == "183" and row[5] == "2000":
                row[5] = "1000"
        return table

    assert "VRF409" in case.caught(case.with_row(3, dark))


def test_a_move_that_cannot_be_apart_waits_for_the_other_and_is_late():
    """Without a solved flight there is no bend, under a ceiling no way above."""
    low = "site: {volume: {min: [-100, -100, 0], max: [100, 100, 17]}}\n"
    itinerary = build_itinerary(read_show((SCRIPT + low).encode()).show)
    show, course = itinerary.show, Course.planned(itinerary)
    timeline = build_timeline(show, course, builder_of(show)[0], Silent())
    right, left = timeline.legs[1:3]
    assert (right.leg.name, left.leg.name) == ("launch -> far", "up -> down")
    assert left.arrival < right.releases[0] or right.arrival < left.releases[0]
    assert max(right.late, left.late) > 1.0
    (late,) = [one for one in mission_outlook(itinerary).notes if " late: " in one]
    assert "`showc stream` keeps all times" in late


def test_missions_do_not_depend_on_processes(flight, case):
    again = mission_files(flight, jobs=2)
    assert again.files == case.missions.files


def test_motions_of_the_fleet_are_cut_where_a_stage_begins(case):
    timeline = case.missions.predicted.timeline
    beside = [part for leg in timeline.legs[:3] for part in leg.flown]
    start = timeline.staging.end
    found = list(fleet_motions(beside, start, Timing(), (0.0, float("inf"))))
    # Two stages begin at one instant.
    assert len(found) == len(beside) - 1
    for before, after in pairwise(found):
        assert before.window[1] <= after.window[0]
    for motion in found:
        assert motion.begin.shape == (4, 3)
    # At the end all stand where the last of their legs ends.
    for _, stage in beside:
        last = next(one for _, one in reversed(beside) if stage.drones[0] in one.drones)
        assert (found[-1].end[last.drones] == last.end).all()


@pytest.mark.parametrize("kind", ["missions", "trajectories"])
def test_each_move_of_a_group_is_compared_by_itself(case, kind):
    show = read_log(case.path)
    course = course_of(show, kind)
    found = {leg.name: leg for leg in course.legs}
    for name, drones, to in (
        ("launch -> far", (2, 3), "far"),
        ("up -> down", (0, 1), "down"),
    ):
        leg = found[name]
        assert leg.drones == drones
        places = np.array(case.script.formations[to].points)
        gaps = np.linalg.norm(leg.goals[:, None] - places, axis=2)
        # Missions have whole centimetres and 1e-7 degrees.
        assert gaps.min(axis=1).max() < 0.02
        assert leg.start < leg.arrivals.min() <= leg.arrivals.max() <= leg.until
        # A move is looked at until its own drones fly on, whatever the others do.
        assert leg.until >= found["approach to the pads"].start - 1e-9


CROWDED = """\
showc: 1
drones: 6
site: {wind: 6}
pads: {type: grid, rows: 1, step: 3.5, count: 6}
groups: {a: 1-3, b: 4-6}
formations:
  f0: {type: points, points: [[-6.28, 0.4, 16.6], [-2.33, 1.2, 13.1], [1.1, -2.2, 17.3]]}
  f1: {type: points, points: [[-5.91, -5.1, 13.4], [-2.49, 4.2, 12.8], [1.11, 3, 12.5]]}
  f2: {type: points, points: [[-6.18, 1.2, 12.5], [-3.12, 4.7, 14.2], [1.16, -5.4, 13]]}
  f3: {type: points, points: [[-6.25, -0.5, 16.8], [-2.42, 7.1, 12.3], [1.42, -0.1, 17.6]]}
  f4: {type: points, points: [[-5.87, -4.3, 12.3], [-2.13, 2, 13.1], [1.39, 2.3, 12.3]]}
  f5: {type: points, points: [[-5.91, -4.8, 16.7], [-2.17, -5.9, 16.8], [1.06, 6, 13.9]]}
  f6: {type: points, points: [[-6.27, -1.5, 14.3], [-2.99, 0.5, 14], [-0.26, 6.2, 14.8]]}
transitions:
  - {to: f0, group: a, start: 16, duration: 9.1, hold: 1}
  - {to: f1, group: b, start: 15.8, duration: 6.3, hold: 2.4}
  - {to: f2, group: a, start: 27.4, duration: 10, hold: 0.7}
  - {to: f3, group: a, start: 40.3, duration: 5.8, hold: 1.9}
  - {to: f4, group: b, start: 42.1, duration: 4.3, hold: 1.4}
  - {to: f5, group: a, start: 49.3, duration: 9.4, hold: 2}
  - {to: f6, group: b, start: 50, duration: 8.9, hold: 2.3}
"""  # noqa: E501 - places as they were found


def test_ways_above_others_are_flown_as_they_were_proved(tmp_path):
    """Lines pass drones that rest, and stages without a drone take no time."""
    flight = formula_flight(build_itinerary(read_show(CROWDED.encode()).show))
    case = Case(tmp_path, flight)
    assert case.failures() == set()
    encodings = {leg["encoding"] for leg in case.missions.prediction["legs"]}
    assert any("above the others" in encoding for encoding in encodings)


CUES = """\
showc: 1
drones: 2
pads: {type: line, length: 4}
launch: {altitude: 8, hold: 1}
formations:
  ahead: {type: line, length: 6, centre: [0, 30, 8]}
  above: {type: line, length: 4, centre: [0, 0, 14]}
transitions:
  - {to: ahead, at: 40, hold: 2}
  - {to: above, start: 60, hold: 2}
  - {to: ahead, at: 100, hold: 2}
  - {to: above, hold: 2}
landing: {altitude: 8}
"""


@pytest.fixture(scope="module")
def cued(tmp_path_factory):
    show = read_show(CUES.encode()).show
    flight = formula_flight(build_itinerary(show))
    return Case(tmp_path_factory.mktemp("cued"), flight)


def moved(case, moves):
    """Missions of all drones with slots so many seconds later, by their numbers."""

    def change(table):
        slots = [row for row in table if row[3:5] == ["93", "-1"]]
        for number, seconds in moves.items():
            row = slots[number]
            minute, second = divmod(60 * int(row[6]) + int(row[7]) + seconds, 60)
            row[6:8] = str(minute), str(second)
        return table

    files = {}
    for drone in range(1, case.script.drones + 1):
        files |= case.alike(drone, change)
    token = fleet_token({**case.files, **files})
    for name in (name for name in files if name.endswith(".plan")):
        plan = {**json.loads(files[name]), "fleetToken": token}
        files[name] = json.dumps(plan).encode()
    return files


def test_moves_on_their_cues_are_proved(cued):
    found = cued.checks()["VRF418"]
    assert cued.failures() == set()
    assert found.verdict == "pass" and found.value < 0.1
    assert "3 moves; show time 0 is 0.0 s" in found.notes[0]


@pytest.mark.parametrize(
    "moves",
    [{0: 2}, {0: -2}, {1: 1}, {1: -1}, {2: -2}],
)
def test_slots_off_their_cues_are_caught_where_all_else_is_kept(cued, moves):
    """The fleet waits there in the log too, and holds what it holds."""
    assert cued.caught(moved(cued, moves)) == {"VRF418"}


FADES = """\
showc: 1
drones: 3
mission: {light_servos: [9, 10, 11]}
pads: {type: line, length: 8}
launch: {altitude: 8, hold: 1}
groups: {first: [1], second: [2]}
formations:
  all: {type: line, length: 8, centre: [0, 3, 10], colour: white}
  left: {type: points, points: [[-4, 9, 10]], colour: red}
  middle: {type: points, points: [[0, 9, 10]], colour: blue}
transitions:
  - {to: all, assignment: fixed, hold: 2}
  - {to: left, group: first, fade: end, hold: 2}
  - {to: middle, group: second, fade: start, hold: 2}
landing: {altitude: 8}
"""


def test_groups_in_one_time_change_their_colours_each_at_its_moment(tmp_path):
    show = read_show(FADES.encode()).show
    case = Case(tmp_path, formula_flight(build_itinerary(show)))
    assert case.failures() == set()
    changes = []
    for drone in (1, 2, 3):
        table = rows(case.files[f"missions/drone_{drone:04d}.waypoints"])
        commands = [int(row[3]) for row in table]
        lit = [k for k, command in enumerate(commands) if command == 183]
        # All three outputs when it is armed, and again for white.
        changes.append([commands[k - 1] for k in lit[6:] if commands[k - 1] != 183])
    # Red comes behind the waypoint, blue behind the slot; the third stays white.
    assert [own[:1] for own in changes[:2]] == [[16], [93]]
    assert len(changes[2]) < len(changes[0])
