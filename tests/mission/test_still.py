"""Legs in which nobody moves, and landings from where the fleet stands already."""

import json

import pytest
from findings import failed
from mission.flights import formula_flight, rows
from mission.planted import Case

from showc.fleet import solve_itinerary
from showc.fleet.options import SolveOptions
from showc.pipeline.compile import CompileOptions, compile_script
from showc.plan import build_itinerary
from showc.progress import Silent
from showc.script import read_show
from showc.verify import verify_log

SCRIPT = """\
showc: 1
drones: 2
mission: {light_servos: [9, 10, 11]}
pads: {type: line, length: 4}
launch: {altitude: 8, hold: 1}
formations:
  pair: {type: line, length: 6, centre: [0, 3, 8], colour: red}
  above: {type: line, length: 4, centre: [0, 0, 8], colour: blue}
transitions:
  - {to: pair, hold: 1}
  - {to: pair, colour: lime, hold: 4, assignment: fixed}
  - {to: above, hold: 7, assignment: fixed}
landing: {altitude: 8, hold: 2}
"""


def flown(folder, script):
    """Missions of a script's show, flown by formula."""
    flight = formula_flight(build_itinerary(read_show(script.encode()).show))
    return Case(folder, flight)


def verified(folder, text):
    """Compile a script, and verify its log with the missions beside it."""
    script, log = folder / "show.yaml", folder / "show.mcap"
    script.write_text(text)
    compile_script(script, log, CompileOptions())
    return verify_log(log)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("still"), SCRIPT)


def test_colours_alone_have_a_slot_and_are_proved(case):
    assert case.failures() == set()
    table = rows(case.files["missions/drone_0001.waypoints"])
    commands = [int(row[3]) for row in table]
    # A slot, its tenths, then green for red, and the next slot.
    green = next(k for k, row in enumerate(table) if row[3:6] == [183, 10, 2000])
    assert commands[green - 3 : green + 2] == [93, 93, 183, 183, 93]
    moved = [leg["name"] for leg in case.missions.prediction["legs"]]
    assert moved == ["launch -> pair", "pair -> pair", "pair -> above"]


def test_a_slot_in_the_second_before_the_next_one_is_caught(case):
    """Both begin in one second, and the vehicle waits an hour for the next one."""

    def later(fields):
        slots = [n for n, row in enumerate(fields) if row[3:5] == ["93", "-1"]]
        lone, following = slots[1:3]
        fields[lone][6:8] = fields[following][6:8]
        fields[lone + 1][4] = "0.9"
        return fields

    assert "VRF410" in case.caught(case.with_row(1, later))


STAYING = {
    "for a colour on a cue": """
  - {to: b, hold: 5}
  - {to: b, at: 60, hold: 5, colour: blue}
  - {to: b, at: 80}""",
    "for as long as it is given": """
  - {to: b, hold: 5}
  - {to: b, hold: 0, duration: 20}
  - {to: b, at: 60, hold: 0}""",
    "before another formation": """
  - {to: b, hold: 0}
  - {to: b, hold: 0}
  - {to: c, hold: 1}
  - {to: c, hold: 0}""",
    "and change their lights at the end": """
  - {to: b, hold: 0, assignment: fixed}
  - {to: c, hold: 2, assignment: fixed}
  - {to: b, hold: 7, assignment: fixed, start: 50, colour: blue}
  - {to: b, hold: 2, assignment: fixed, colour: lime}""",
}


@pytest.mark.parametrize("lights", ["{}", "{light_servos: [1, 2, 3]}"])
@pytest.mark.parametrize("case", STAYING)
def test_drones_that_stay_in_some_moves_are_proved(tmp_path, case, lights):
    text = f"""\
showc: 1
drones: 2
mission: {lights}
pads: {{type: points, points: [[0, 0, 0], [3, 0, 0]]}}
launch: {{altitude: 12, hold: 2}}
formations:
  b: {{type: points, points: [[0, 0, 12], [3, 0, 12]], colour: red}}
  c: {{type: points, points: [[0, 0, 12], [3, 0, 18]], colour: gold}}
transitions:{STAYING[case]}
landing: {{altitude: 12, hold: 0}}
"""
    found = verified(tmp_path, text)
    assert found.proved, found.verdict


LAYERED = """\
showc: 1
separation: 2
drones: 2
pads: {type: circle, radius: 2.04, count: 2}
launch: {altitude: 10, hold: 2}
groups: {left: [1], right: [2]}
formations:
  a: {type: grid, step: 2.03, centre: [0, 0, 16]}
  l0: {type: points, points: [[-24, 18, 20]], colour: red}
  r0: {type: points, points: [[24, -16, 20]], colour: lime}
transitions:
  - {to: a, hold: 5}
  - {to: r0, group: right, at: 57.1, hold: 4, fade: start}
  - {to: l0, group: left, duration: 18, colour: deepskyblue}
prefer: energy
landing: {altitude: 10, assignment: fixed}
mission: {light_servos: [9, 10, 11]}
"""


def test_a_drone_changes_its_lights_on_legs_of_its_own(tmp_path):
    """The other one flies to another layer first: that is no leg of this drone's."""
    found = verified(tmp_path, LAYERED)
    manifest = json.loads((tmp_path / "show/manifest.json").read_bytes())
    encodings = [leg["encoding"] for leg in manifest["missions"]["prediction"]["legs"]]
    assert "2 layers" in encodings
    assert found.proved, found.verdict


NARROW = """\
showc: 1
limits: {acceleration: 2.5}
separation: 0.8
drones: 2
pads: {type: line, length: 0.89, direction: [1, 2, 0], centre: [-1.4, 0.4, 0.5]}
launch: {altitude: 2.5, hold: 0}
formations:
  r0: {type: helix, radius: 1.6, height: 2.08, turns: -0.5, count: 2, spread: true,
    centre: [11.2, 5.75, 16.8]}
transitions:
  - {to: r0}
landing: {altitude: 2.5, hold: 1, assignment: fixed}
"""


TWICE = """\
showc: 1
drones: 4
groups: {pair: 1-2}
pads: {type: grid, columns: 2, rows: 2, step: 3}
launch: {altitude: 6}
formations:
  ahead: {type: line, count: 2, length: 3, centre: [0, 6, 6]}
  behind: {type: line, count: 2, length: 3, centre: [0, -6, 6]}
transitions:
  - {to: ahead, group: pair, hold: 2}
  - {to: behind, group: pair, hold: 2}
landing: {altitude: 6}
"""


def test_drones_that_make_way_in_one_of_several_moves_are_proved(tmp_path):
    """Of several moves that a drone stays out of, its way is of one: by the time."""
    found = verified(tmp_path, TWICE)
    assert failed(found) == set() and found.missions == "proved"
    away = rows((tmp_path / "show/missions/drone_0003.waypoints").read_bytes())
    assert len({tuple(row[8:10]) for row in away if row[3] == 16}) > 1


TURNED = """\
showc: 1
drones: 5
groups: {one: [1], two: [2]}
pads: {type: grid, columns: 5, step: 2.5}
launch: {altitude: 1.2}
formations:
  ahead: {type: points, points: [[0, 7, 1.2]]}
  aside: {type: points, points: [[9, -6, 1.2]]}
transitions:
  - {to: ahead, group: one, at: 38.2, hold: 2}
  - {to: aside, group: two, at: 43.2, hold: 2}
landing: {altitude: 3.2}
"""


def test_groups_that_leave_in_another_order_in_missions_are_proved(tmp_path):
    found = verified(tmp_path, TURNED)
    manifest = json.loads((tmp_path / "show/manifest.json").read_bytes())
    legs = manifest["missions"]["prediction"]["legs"][:2]
    one, two = ((leg["optimal_start"], leg["slot"]) for leg in legs)
    assert one[0] < two[0]
    assert one[1] > two[1]
    assert failed(found) == set() and found.missions == "proved"


def test_a_drone_does_not_sink_beside_one_that_still_comes_too_near(tmp_path):
    """It would be on the ground seconds before the other is above its pad."""
    found = verified(tmp_path, NARROW)
    assert found.proved, found.verdict


def test_what_stands_above_the_pads_is_held_and_lands_dark(case):
    table = rows(case.files["missions/drone_0001.waypoints"])
    pause, dark, land = table[-3:]
    assert (pause[3], pause[4]) == (93, 9.0)
    assert dark[3:6] == [183, 11, 1000]
    assert land[3] == 21

    def sooner(fields):
        fields[-3][4] = "2"
        return fields

    def lit(fields):
        return [*fields[:-2], fields[-1]]

    assert "VRF405" in case.caught(case.with_row(1, sooner))
    assert "VRF409" in case.caught(case.with_row(1, lit))


def test_drones_that_land_before_the_last_one_is_there_are_caught(case):
    """Nothing but one drone's last slot is later: the others land meanwhile."""

    def later(seconds):
        def change(fields):
            slots = [n for n, row in enumerate(fields) if row[3:5] == ["93", "-1"]]
            fields[slots[-1]][7] = str(int(fields[slots[-1]][7]) + seconds)
            return fields

        return change

    assert case.caught(case.alike(1, later(0))) == set()
    assert "VRF408" in case.caught(case.alike(1, later(12)))


SPREAD = """\
showc: 1
drones: 2
pads: {type: points, points: [[0, 0, 0], [40, 0, 0]]}
launch: {altitude: 8, hold: 1}
formations:
  away: {type: points, points: [[0, 2, 8], [40, 38, 8]]}
  above: {type: points, points: [[0, 0, 8], [40, 0, 8]]}
transitions:
  - {to: away, hold: 1, assignment: fixed}
  - {to: above, hold: 0 s, assignment: fixed}
landing: {altitude: 8, hold: 0 s}
"""


def test_a_drone_that_comes_much_sooner_waits_until_the_last_formation_is_complete(
    tmp_path,
):
    """Its way is too short to be flown as slowly as the other's."""
    case = flown(tmp_path, SPREAD)
    soon, last = case.missions.prediction["legs"][-1]["arrivals"]
    assert soon < last - 3.0
    assert case.failures() == set()
    first, second = (
        rows(case.files[f"missions/drone_000{drone}.waypoints"]) for drone in (1, 2)
    )
    assert [row[3] for row in first[-3:]] == [16, 93, 21]
    assert first[-3][8:10] == first[-1][8:10]
    assert sum(row[3] == 16 for row in first) == 1 + sum(row[3] == 16 for row in second)
    # Without that slot it lands before the other one is there.
    slot = max(n for n, row in enumerate(first) if row[3:5] == [93, -1])
    early = case.alike(1, lambda fields: [*fields[:slot], *fields[-2:]])
    assert "VRF408" in case.caught(early)


def test_a_show_that_never_leaves_its_pads_by_more_than_height_has_missions(tmp_path):
    text = SCRIPT.replace("  - {to: pair, hold: 1}\n", "").replace(
        "  - {to: pair, colour: lime, hold: 4, assignment: fixed}\n", ""
    )
    case = flown(tmp_path, text)
    assert case.missions.prediction["delay"] == pytest.approx(0.085)
    assert case.failures() == set()


def test_a_show_that_ends_in_another_colour_has_missions(tmp_path):
    text = SCRIPT.replace(
        "landing:",
        "  - {to: above, colour: gold, hold: 2, assignment: fixed}\nlanding:",
    )
    case = flown(tmp_path, text)
    assert case.failures() == set()


STAYS = """\
showc: 1
drones: 3
mission: {wanted: true}
pads: {type: points, points: [[0, 0, 0], [-8, 0, 0], [16, 0, 0]]}
launch: {altitude: 10, hold: 2}
formations:
  high: {type: points, points: [[0, 4, 14], [8, 0, 6], [16, 4, 14]]}
  home: {type: points, points: [[0, 0, 10], [4, 0, 3], [16, 4, 14]]}
transitions:
  - {to: high, hold: 2, assignment: fixed}
  - {to: home, hold: 10, assignment: fixed}
landing: {altitude: 10, assignment: fixed}
"""


@pytest.fixture(scope="module")
def stays(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("stays"), STAYS)


def test_a_drone_above_its_pad_lands_with_the_others(stays):
    """Drone 1 has no way in the last leg: it waits for a slot where it stands."""
    assert stays.failures() == set()
    first, second = (
        rows(stays.files[f"missions/drone_000{drone}.waypoints"]) for drone in (1, 2)
    )
    assert [row[3] for row in first[-3:]] == [16, 93, 21]
    assert first[-3][8:10] == first[-1][8:10]

    def last_slot(table):
        found = [row for row in table if row[3] == 93 and row[4] == -1]
        return 60 * found[-1][6] + found[-1][7]

    assert last_slot(first) > last_slot(second)


def test_a_drone_that_lands_while_others_hold_is_caught(stays):
    def early(fields):
        # Its own way to the last formation is its last.
        kept = [number for number, row in enumerate(fields) if row[3] == "16"]
        return [*fields[: kept[-2] + 1], *fields[-2:]]

    assert "VRF408" in stays.caught(stays.alike(1, early))


def test_a_drone_that_leaves_a_formation_before_all_have_come_is_caught(stays):
    def sooner(fields):
        slots = [n for n, row in enumerate(fields) if row[3:5] == ["93", "-1"]]
        fields[slots[1]][7] = str(int(fields[slots[1]][7]) - 3)
        return fields

    found = [stays.caught(stays.alike(drone, sooner)) for drone in (1, 2, 3)]
    assert all("VRF408" in one for one in found)


def test_a_drone_that_lands_on_the_way_of_another_is_caught(stays):
    """Drone 2 passes beneath the place of drone 1, whose slot comes seconds sooner."""

    def sooner(fields):
        at = [n for n, row in enumerate(fields) if row[3:5] == ["93", "-1"]][-1]
        fields[at][7] = str(int(fields[at][7]) - 6)
        return fields

    assert stays.caught(stays.alike(1, sooner)) == {"VRF408", "VRF417"}


HELD = """\
showc: 1
drones: 3
pads: {type: line, length: 12}
launch: {altitude: 8, hold: 40}
formations:
  near: {type: line, length: 12, centre: [0, 4, 8]}
  far: {type: line, length: 12, centre: [0, 9, 8]}
transitions:
  - {to: near, hold: 50, assignment: fixed}
  - {to: far, hold: 1, assignment: fixed}
landing: {altitude: 8, assignment: fixed}
"""


@pytest.fixture(scope="module")
def held(tmp_path_factory):
    case = flown(tmp_path_factory.mktemp("held"), HELD)
    assert case.failures() == set()
    return case


def shifted(case, seconds):
    """All missions, each drone's slots from one of them on at other seconds.

    ``seconds`` are pairs by drone: the first slot that is shifted, and by how much.
    """

    def change(fields, first, by):
        slots = [n for n, row in enumerate(fields) if row[3:5] == ["93", "-1"]]
        for at in slots[first:]:
            time = 60 * int(fields[at][6]) + int(fields[at][7]) + by
            fields[at][6:8] = [str(time // 60), str(time % 60)]
        return fields

    found = {}
    for drone, (first, by) in enumerate(seconds, 1):
        found |= case.with_row(
            drone, lambda rows, first=first, by=by: change(rows, first, by)
        )
    return found


def test_a_hold_is_waited_for_once_and_not_by_each_drone_anew(held):
    """One drone leaves on time, the next 50 s later, the last 100 s later."""
    late = [(1, 0), (1, 50), (1, 100)]
    assert "VRF408" in held.caught(shifted(held, late))


def test_a_launch_has_no_leg_but_a_climb(held):
    """What waits for a slot is not held against others that still climb."""

    def further(fields):
        at = next(n for n, row in enumerate(fields) if row[3] == "16" and n)
        slot = list(next(row for row in fields if row[3:5] == ["93", "-1"]))
        slot[7] = str(int(slot[7]) - 5)
        elsewhere = list(fields[at])
        elsewhere[10] = "6.002"
        return [*fields[:at], elsewhere, slot, *fields[at:]]

    assert "VRF404" in held.caught(held.alike(1, further))


def test_the_hold_after_the_launch_is_kept_by_missions(held):
    assert "VRF408" in held.caught(shifted(held, [(0, -30)] * 3))


HARDLY = """\
showc: 1
drones: 8
mission: {light_servos: [9, 10, 11]}
pads: {type: line, length: 21}
launch: {altitude: 8, hold: 1}
formations:
  row: {type: line, length: 23, direction: [1, 0.1234, 0], centre: [0, 3, 8]}
  next: {like: row, transform: [{shift: [0, 0.003, 0]}], colour: blue}
transitions:
  - {to: row, hold: 4, assignment: fixed}
  - {to: next, hold: 4, assignment: fixed}
landing: {altitude: 8, hold: 2}
"""


def test_legs_shorter_than_what_missions_store_end_their_own_moves(tmp_path):
    """Some drones stay, others fly the centimetre that they are rounded to."""
    assert flown(tmp_path, HARDLY).failures() == set()


GROUPS = """\
showc: 1
drones: 3
groups: {left: [1], right: [2]}
pads: {type: grid, columns: 3, rows: 1, step: 6}
launch: {altitude: 12}
formations:
  a: {type: points, points: [[-6, 8, 12]], colour: gold}
  b: {type: points, points: [[0, 8, 12]], colour: red}
  all: {type: points, points: [[-6, 4, 16], [0, 4, 16], [6, 4, 16]], colour: blue}
  above: {type: points, points: [[-6, 0, 12], [0, 0, 12], [6, 0, 12]], colour: blue}
  a0: {type: points, points: [[-6, 0, 12]], colour: gold}
transitions:
  - {to: a, group: left, start: 20, at: 69, hold: 1}
  - {to: b, group: right, start: 22, at: 30, hold: 40}
  - {to: all, at: 90, hold: 4, assignment: fixed}
  - {to: above, at: 110, hold: 4, assignment: fixed}
  - {to: a, group: left, at: 130, hold: 2}
  - {to: b, group: right, at: 131, hold: 2}
  - {to: a0, group: left, at: 150, hold: 2}
landing: {altitude: 12, assignment: fixed}
"""


@pytest.fixture(scope="module")
def grouped(tmp_path_factory):
    itinerary = build_itinerary(read_show(GROUPS.encode()).show)
    flight = solve_itinerary(itinerary, SolveOptions(), Silent())
    case = Case(tmp_path_factory.mktemp("grouped"), flight)
    assert case.failures() == set()
    return case


@pytest.mark.parametrize(
    ("drone", "slot", "by"),
    [(3, 0, -40), (2, 1, -30)],
    ids=["of no group", "whose group is to hold for longer"],
)
def test_no_drone_leaves_for_the_next_formation_of_all_before_groups_have_flown(
    grouped, drone, slot, by
):
    seconds = [(9, 0)] * 3
    seconds[drone - 1] = (slot, by)
    assert "VRF408" in grouped.caught(shifted(grouped, seconds))


def test_a_drone_of_no_group_lands_with_the_others(grouped):
    table = rows(grouped.files["missions/drone_0003.waypoints"])
    slots = sum(row[3:5] == [93, -1] for row in table)
    early = shifted(grouped, [(9, 0), (9, 0), (slots - 1, -30)])
    assert "VRF408" in grouped.caught(early)


GIVING_WAY = """\
showc: 1
drones: 4
groups: {left: [1, 2]}
pads: {type: grid, columns: 2, rows: 2, step: 3}
launch: {altitude: 6}
formations:
  up: {type: line, count: 2, length: 3, centre: [0, 6, 6]}
transitions:
  - {to: up, group: left, hold: 2}
landing: {altitude: 6}
"""


def test_drones_of_no_group_may_make_way_and_come_back(tmp_path):
    found = verified(tmp_path, GIVING_WAY)
    table = rows((tmp_path / "show/missions/drone_0003.waypoints").read_bytes())
    assert sum(row[3] == 16 for row in table) > 3
    assert found.proved, found.verdict


ONE_BY_ONE = """\
showc: 1
drones: 3
mission: {slack: 5}
groups: {left: [1], right: [2]}
pads: {type: grid, columns: 3, rows: 1, step: 5}
launch: {altitude: 5}
formations:
  b: {type: points, points: [[-5, 6, 5]]}
  a: {type: points, points: [[-5, 0, 5]]}
  c: {type: points, points: [[0, 0, 5]]}
  c2: {type: points, points: [[0, 0, 5.1]]}
transitions:
  - {to: b, group: left, at: 40, hold: 1}
  - {to: c2, group: right, at: 41, hold: 1}
  - {to: a, group: left, at: 60, hold: 1}
  - {to: c, group: right, at: 61, hold: 1}
landing: {altitude: 5}
"""


def test_groups_that_end_above_their_pads_keep_their_slack(tmp_path):
    found = verified(tmp_path, ONE_BY_ONE)
    assert found.proved, found.verdict


FASTER = """\
showc: 1
drones: 6
mission: {slack: 0}
pads: {type: grid, columns: 2, step: 3}
launch: {altitude: 3, hold: 0}
formations:
  row: {type: grid, columns: 6, step: 3, centre: [-15, 9, 6]}
  column: {type: grid, columns: 1, step: 3, centre: [-15, 0, 12]}
  away: {type: grid, columns: 1, step: 3, centre: [60, 9, 6]}
transitions:
  - {to: row, at: 43, duration: 8, hold: 1}
  - {to: column, at: 80, duration: 8, hold: 5}
  - {to: away, at: 110, assignment: fixed}
landing: {altitude: 3, hold: 3}
"""


def test_a_move_that_missions_fly_faster_leaves_later_and_is_proved(tmp_path):
    """In the log it takes the whole time up to when it has to arrive."""
    found = verified(tmp_path, FASTER)
    manifest = json.loads((tmp_path / "show/manifest.json").read_text())
    last = manifest["missions"]["prediction"]["legs"][2]
    assert last["slot"] - last["optimal_start"] > 3.25
    assert failed(found) == set() and found.missions == "proved"


GENTLE = """\
showc: 1
drones: 3
mission: {slack: 1}
groups: {right: [2], left: [1]}
pads: {type: grid, columns: 3, step: 2.5}
launch: {altitude: 10, hold: 1}
formations:
  row: {type: grid, columns: 1, step: 2.5, centre: [0, 3, 13]}
  ahead: {type: points, points: [[0, 7, 10]]}
  aside: {type: points, points: [[12, 14, 13]]}
transitions:
  - {to: row, hold: 2, assignment: fixed}
  - {to: ahead, group: left, at: 50, duration: 10, hold: 1}
  - {to: aside, group: right, at: 55, duration: 10, hold: 2}
landing: {altitude: 10}
"""


def test_a_group_that_missions_fly_faster_leaves_later_and_is_proved(tmp_path):
    found = verified(tmp_path, GENTLE)
    manifest = json.loads((tmp_path / "show/manifest.json").read_text())
    legs = manifest["missions"]["prediction"]["legs"]
    # Each arrives on time, and one of them leaves later than in the log.
    assert max(leg["slot"] - leg["optimal_start"] for leg in legs[1:3]) > 1.0
    assert failed(found) == set() and found.missions == "proved"
