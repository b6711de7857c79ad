"""Groups with times of their own: proved from the script, and lies about them."""

from dataclasses import replace

import numpy as np
import pytest
from verified import loaded, strays

from showc.fleet.pace import straight_time
from showc.light.program import LightProgram
from showc.log import showc_pb2 as pb
from showc.pipeline.compile import CompileOptions, compile_script
from showc.script import load_show, read_show
from showc.verify import verify_log
from showc.verify.kernel.certificates import certified, excess
from showc.verify.specification.demands import hold_against

SCRIPT = """\
showc: 1
name: Lanes
drones: 5
pads: {type: grid, rows: 1, step: 4, count: 5}
launch: {altitude: 10, hold: 2}
groups: {left: 1-2, right: 4-5}
formations:
  up: {type: points, points: [[-8, 0, 16], [-4, 0, 16]], colour: gold}
  far: {type: points, points: [[8, 8, 10], [4, 8, 10]], colour: red, effect: pulse}
  down: {type: points, points: [[-8, 0, 12], [-4, 0, 12]], colour: blue}
transitions:
  - {to: up, group: left, start: 10, at: 20}
  - {to: far, group: right, at: 28, duration: 14, hold: 4}
  - {to: down, group: left, at: 26, hold: 9}
landing: {altitude: 10}
"""
LEG = 2
"""Position of the leg of all three moves."""


def compiled_in(folder, script):
    """Compile a script in a folder, without missions."""
    file = folder / "lanes.yaml"
    file.write_text(script)
    return compile_script(file, folder / "output.mcap", CompileOptions(missions=False))


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    return compiled_in(tmp_path_factory.mktemp("lanes"), SCRIPT)


def judged(compiled, change):
    """What the script has against a log whose leg of groups was changed."""
    _, logged = loaded(compiled.log)
    segments = list(logged.segments)
    leg = segments[LEG]
    message = type(leg.message)()
    message.CopyFrom(leg.message)
    segments[LEG] = change(replace(leg, message=message))
    show = load_show(compiled.log.parent / "lanes.yaml").show
    return hold_against(show, replace(logged, segments=tuple(segments)))


def unproved(compiled, change):
    """Codes that fail for what groups claim of their moves."""
    found, (_, logged) = judged(compiled, change), loaded(compiled.log)
    stated = certified(found.claims, [excess(logged, one) for one in found.claims])
    wrong = {one.code for one in stated if one.holds is False}
    return wrong | {"VRF204"} if found.legs else wrong


def delayed(leg, drones, start, end, delay):
    """Let drones fly later what they fly between two times of the leg."""
    table = leg.table
    begins, ends = table.start.copy(), table.end.copy()
    mine = np.isin(table.owner, drones)
    inside = (table.start >= start - 1e-6) & (table.end <= end + 1e-6) & mine
    begins[inside] += delay
    ends[inside] += delay
    ends[mine & (np.abs(table.end - start) < 1e-6)] += delay
    begins[mine & (np.abs(table.start - end) < 1e-6)] += delay
    return replace(leg, table=replace(table, start=begins, end=ends))


def test_every_group_keeps_its_own_times_and_all_is_proved(compiled):
    report = verify_log(compiled.log)
    assert report.proved, report.to_json()
    leg = compiled.flight.legs[LEG]
    begin = compiled.flight.starts[LEG]
    assert (begin, leg.duration) == (10.0, 18.0)
    left, none, right = (leg.trajectories[row].state for row in (0, 2, 4))

    def where(state, time):
        return state(time - begin)[:3]

    for state, stands, moves in (
        (left, [(10.0, 10.0), (20.0, 21.0)], (10.0, 20.0)),
        (right, [(10.0, 14.0), (28.0, 28.0)], (14.0, 28.0)),
        (none, [(10.0, 28.0)], None),
    ):
        for first, last in stands:
            assert np.array_equal(where(state, first), where(state, last))
        if moves:
            middle = where(state, sum(moves) / 2)
            assert np.linalg.norm(middle - where(state, moves[0])) > 0.5
    assert np.allclose(where(left, 21.0), [-8, 0, 16], atol=1e-6)
    assert np.allclose(where(left, 26.0), [-8, 0, 12], atol=1e-6)
    assert np.allclose(where(right, 28.0), [8, 8, 10], atol=1e-6)


def test_each_group_fades_over_its_own_move(compiled):
    light = LightProgram.of(compiled.flight)
    gold, red, blue = (
        compiled.flight.itinerary.show.formations[name].colours[0]
        for name in ("up", "far", "down")
    )
    shown = light.linear([15.0, 20.5, 26.0, 34.9])[:, 0]
    assert np.allclose(shown, [gold / 2, gold, blue, blue], atol=1e-9)
    dark, half = light.linear([13.9, 21.0])[:, 3]
    assert np.array_equal(dark, np.zeros(3))
    assert np.allclose(half, red / 2, atol=1e-9)
    # The effect of a picture plays when its group has reached it, on its drones alone.
    during, later = light.linear([29.0, 30.0])[:, 3]
    assert during[0] < 0.1
    assert later[0] > 0.9


def test_a_group_whose_flight_is_shifted_in_time_is_found(compiled):
    late = judged(compiled, lambda leg: delayed(leg, [0, 1], 0.0, 10.0, 0.02))
    assert "is flown from 10.020 s to 20.020 s" in late.times[0]
    both = judged(compiled, lambda leg: claimed(delayed(leg, [0, 1], 0, 10, 0.02)))
    assert both.times == [
        "“launch -> up” starts at 10.020 s, the script asks for 10.000 s",
        "“launch -> up” arrives at 20.020 s, the script asks for 20.000 s",
    ]


def claimed(leg):
    """Let the log say so too."""
    leg.message.moves[0].start += 0.02
    return leg


def test_a_claim_of_other_times_than_are_flown_is_found(compiled):
    def lie(leg):
        leg.message.moves[2].start -= 0.5
        leg.message.moves[2].duration += 0.5
        return leg

    assert "“up -> down” is flown from" in judged(compiled, lie).times[0]


def test_a_drone_of_no_group_that_leaves_its_place_is_found(compiled):
    def lie(leg):
        state = leg.table.state.copy()
        state[leg.table.owner == 2, 1:-1, 2] += 0.01
        return replace(leg, table=replace(leg.table, state=state))

    (found,) = judged(compiled, lie).places
    assert found.endswith("drones of no group do not stay where they are")


@pytest.mark.parametrize("drone", [0, 2])
def test_a_drone_that_turns_where_it_waits_is_found(compiled, drone):
    """Of groups that have flown, and of none: yaw alone, as far as any hover's."""

    def lie(leg):
        state = leg.table.state.copy()
        state[leg.table.first[drone + 1] - 1, 1:-1, [8, 11]] += 0.01
        return replace(leg, table=replace(leg.table, state=state))

    found = judged(compiled, lie)
    assert len([*found.places, *found.times]) == 1


def test_numbers_of_no_vehicle_are_found_without_a_trace(compiled):
    _, logged = loaded(compiled.log)
    logged.rules.vehicle.mass = 0.0
    show = load_show(compiled.log.parent / "lanes.yaml").show
    assert hold_against(show, logged).rules == ["Rules.vehicle.mass is 0.0, not 0.625"]


def test_a_group_sent_elsewhere_on_the_way_is_found(compiled):
    def lie(leg):
        table = leg.table
        state = table.state.copy()
        state[np.isin(table.owner, [0, 1]), :, 1] += 0.5
        return replace(leg, table=replace(table, state=state))

    (found,) = judged(compiled, lie).places
    assert "a goal is no place" in found


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"dual_bound": 9.0}, "VRF341"),
        ({"dual_bound": -1.0}, "VRF342"),
        ({"single_drone_minimum": 0.1}, "VRF342"),
        ({"single_drone_minimum": 9.0}, "VRF342"),
        ({"closest": pb.Encounter(drone_a=0, drone_b=1, distance=7.0)}, "VRF204"),
    ],
)
def test_a_move_that_claims_what_is_not_proved_is_found(compiled, change, code):
    def lie(leg):
        leg.message.moves[2].certificate.MergeFrom(pb.Certificate(**change))
        return leg

    assert code in unproved(compiled, lie)


@pytest.mark.parametrize("start", [19.0, float("nan"), 27.0])
def test_a_move_during_its_groups_hold_is_found(compiled, start):
    def lie(leg):
        leg.message.moves[2].start = start
        return leg

    found = judged(compiled, lie)
    assert found.legs == ["“up -> down” is flown while its group is held"]


def test_a_leg_of_the_whole_fleet_with_moves_of_groups_is_found(compiled):
    _, logged = loaded(compiled.log)
    logged.segments[LEG + 1].message.moves.add(name="up -> down", group="left")
    show = load_show(compiled.log.parent / "lanes.yaml").show
    (found,) = hold_against(show, logged).legs
    assert "moves of groups is 1, not 0" in found


def test_moves_of_other_groups_than_the_script_has_are_found(compiled):
    def lie(leg):
        leg.message.moves[0].group = "right"
        return leg

    assert "are not the script's" in judged(compiled, lie).legs[0]


DANCE = """\
showc: 1
name: Dance
drones: 3
pads: {type: grid, rows: 1, step: 4, count: 3}
launch: {altitude: 10, hold: 2}
groups: {left: 1-2, right: 3}
formations:
  up: {type: points, points: [[-8, 0, 14], [-4, 0, 14]], colour: gold}
  far: {type: points, points: [[8, 6, 10]], colour: red}
  out: {type: points, points: [[12, 6, 10]], colour: blue}
transitions:
  - {to: up, group: left, at: 14, duration: 5, hold: 9, motion: [{rotate: 90}],
     arrive: moving}
  - {to: far, group: right, at: 16, duration: 5, hold: 2,
     motion: [{wave: {amplitude: 0.5, period: 8}}], arrive: moving, leave: moving}
  - {to: out, group: right, at: 22, duration: 3, hold: 1}
landing: {altitude: 10}
"""


@pytest.fixture(scope="module")
def dance(tmp_path_factory):
    return compiled_in(tmp_path_factory.mktemp("dance"), DANCE)


def test_groups_that_hold_in_motion_while_others_fly_are_proved(dance):
    report = verify_log(dance.log)
    assert report.proved, report.to_json()
    leg = dance.flight.legs[LEG]
    claims = [
        (one.leg.name, one.leg.depart, one.duration)
        for one in leg.parts
        if one.leg.motion
    ]
    # Until the group leaves, or for as long as the script holds it.
    assert claims == [
        ("hold after launch -> up", 14.0, 9.0),
        ("hold after launch -> far", 16.0, 3.0),
    ]
    assert leg.leg.depart + leg.duration == 23.0
    ends = [leg.trajectories[row].state(leg.duration)[:3] for row in (0, 1)]
    assert np.allclose(sorted(np.array(ends)[:, 1]), [-2, 2], atol=1e-4)


def test_groups_join_and_leave_motions_at_times_of_their_own(dance):
    joined, _, left = dance.flight.legs[LEG].trajectories
    speeds = joined.state(4.999)[3:6], left.state(7.001)[3:6], left.state(9.999)[3:6]
    assert all(np.linalg.norm(speed) > 0.2 for speed in speeds)
    _, logged = loaded(dance.log)
    for end in ("arrive", "leave"):
        script = DANCE.replace(f", {end}: moving", "")
        show = read_show(script.encode()).show
        said = strays(hold_against(show, logged))
        assert any("“launch -> far”" in one for one in said)


LOOSE = """\
showc: 1
drones: 3
pads: {type: grid, rows: 1, step: 4, count: 3}
launch: {altitude: 10, hold: 2}
groups: {a: 1, b: 2, c: 3}
formations:
  left: {type: points, points: [[-8, 0, 14]]}
  middle: {type: points, points: [[0, 4, 14]]}
  right: {type: points, points: [[8, 0, 14]]}
transitions:
  - {to: left, group: a, start: 9, hold: 5, motion: [{orbit: {radius: 0.5, period: 6}}]}
  - {to: middle, group: b, start: 11, prefer: 2, hold: 1}
  - {to: right, group: c, duration: 6, hold: 3}
landing: {altitude: 10}
"""


@pytest.fixture(scope="module")
def loose(tmp_path_factory):
    """Groups that say only when they leave, or how long they take."""
    return compiled_in(tmp_path_factory.mktemp("loose"), LOOSE)


def test_a_group_that_says_only_when_it_leaves_takes_what_it_prefers(loose):
    report = verify_log(loose.log)
    assert report.proved, report.to_json()
    leg = loose.flight.legs[LEG]
    left, held, middle, right = leg.parts
    assert (left.leg.depart, middle.leg.depart) == (9.0, 11.0)
    # Half as long again as its quickest straight flight, and twice as long.
    for part, pace in ((left, 1.5), (middle, 2.0)):
        quickest = straight_time(part.leg, loose.flight.itinerary.show)
        assert part.duration == pytest.approx(pace * quickest, abs=1e-3)
    assert (right.leg.depart, right.duration) == (loose.flight.starts[LEG], 6.0)
    # The fleet flies on when the last group has been held.
    assert held.duration == 5.0
    ends = loose.flight.starts[LEG] + leg.duration
    assert ends == pytest.approx(9.0 + left.duration + 5.0)


def test_a_group_that_takes_another_time_than_the_script_says_is_found(loose):
    _, logged = loaded(loose.log)
    given = read_show(LOOSE.replace("duration: 6", "duration: 5").encode()).show
    assert hold_against(given, logged).legs == ["“launch -> right” takes 6.000 s"]


@pytest.fixture(scope="module")
def taken_over(tmp_path_factory):
    """What the whole fleet flies next takes over a group that is left in motion."""
    circle = "  wheel: {type: circle, radius: 7, centre: [0, 0, 20]}\ntransitions:"
    later = "  - {to: wheel, at: 34, hold: 1}\nlanding:"
    script = (
        DANCE.replace("transitions:", circle)
        .replace("landing:", later)
        .replace("     arrive: moving}\n", "     arrive: moving, leave: moving}\n")
    )
    return compiled_in(tmp_path_factory.mktemp("over"), script)


def test_a_group_is_left_in_motion_by_what_the_whole_fleet_flies_next(taken_over):
    report = verify_log(taken_over.log)
    assert report.proved, report.to_json()
    leg, after = taken_over.flight.legs[LEG : LEG + 2]
    assert after.leg.name == "up + out -> wheel"
    # There is no hold between: the motion lasts until the fleet leaves.
    start = leg.leg.depart + leg.duration
    assert start == pytest.approx(34.0 - after.duration)
    speeds = [np.linalg.norm(one.state(0.0)[3:6]) for one in after.trajectories]
    assert min(speeds[:2]) > 0.1
    assert speeds[2] == 0.0


def test_a_leg_in_lanes_that_lasts_longer_than_the_script_says_is_found(taken_over):
    script = (taken_over.log.parent / "lanes.yaml").read_text()
    _, logged = loaded(taken_over.log)
    given = read_show(script.replace("wheel, at: 34, ", "wheel, ").encode()).show
    assert any("s too long" in one for one in hold_against(given, logged).legs)


def test_a_drone_that_is_not_left_in_motion_rests_before_the_fleet_flies(taken_over):
    def lie(leg):
        table = leg.table
        state = table.state.copy()
        state[table.first[1:][table.drones == 2] - 1, -1, 3] += 0.01
        return replace(leg, table=replace(table, state=state))

    (found,) = judged(taken_over, lie).places
    assert "drones that are not left in motion do not rest" in found


def still(leg, drone, start, end):
    """Let a drone stand where it is between two times of the leg."""
    table = leg.table
    state = table.state.copy()
    rows = (table.start >= start - 1e-6) & (table.end <= end + 1e-6)
    rows &= table.owner == drone
    state[rows] = state[rows][:1, :1]
    return replace(leg, table=replace(table, state=state))


def test_a_group_that_stands_where_it_is_to_move_is_found(dance):
    found = judged(dance, lambda leg: still(leg, 2, 7.0, 10.0))
    (wrong,) = strays(found)
    assert "drone 3 may be 0." in wrong
    assert "“launch -> far”" in wrong


def test_a_motion_that_is_flown_at_another_time_is_found(dance):
    late = judged(dance, lambda leg: delayed(leg, [0, 1], 5.0, 14.0, 0.02))
    assert "a polynomial runs across an end of its motion" in strays(late)[0]


@pytest.mark.parametrize("change", [{"start": 14.5}, {"duration": 8.9}])
def test_a_claim_of_another_time_of_a_motion_is_found(dance, change):
    def lie(leg):
        leg.message.moves[1].MergeFrom(pb.Move(**change))
        return leg

    found = judged(dance, lie)
    assert found.legs == ["“hold after launch -> up” is not as long as its hold"]


@pytest.mark.parametrize(("move", "kind"), [(0, "MOTION"), (1, "TRANSITION")])
def test_a_motion_that_is_called_a_move_is_found(dance, move, kind):
    def lie(leg):
        leg.message.moves[move].kind = kind
        return leg

    (wrong,) = judged(dance, lie).legs
    assert wrong.startswith("moves of") and wrong.endswith("are not the script's")


def test_a_goal_that_is_not_where_the_motion_ends_is_found(dance):
    def lie(leg):
        goals = leg.goals.copy()
        goals[0, 0] += 0.01
        return replace(leg, goals=goals)

    assert "goals are not where a motion ends" in judged(dance, lie).places[0]


@pytest.mark.parametrize(
    "claim",
    [
        {"dual_bound": 9.0},
        {"witness": pb.Witness(drone=0, time=1.0)},
        {"witness": pb.Witness(drone=2**31, knots=[0.0, 1.0])},
        {"closest": pb.Encounter(drone_b=1)},
    ],
)
def test_a_motion_that_claims_a_bound_is_found(dance, claim):
    def lie(leg):
        leg.message.moves[1].certificate.MergeFrom(pb.Certificate(**claim))
        return leg

    assert unproved(dance, lie) & {"VRF204", "VRF341"}


@pytest.mark.parametrize("place", [-2, -1, 7, 2**31 - 1])
def test_a_place_that_is_none_before_a_motion_is_found(dance, place):
    def lie(leg):
        leg.message.places[0] = place
        return leg

    assert any("places that are theirs" in text for text in judged(dance, lie).places)
