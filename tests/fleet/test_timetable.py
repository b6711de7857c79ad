"""Holds and durations follow from the times that the script asks for."""

import numpy as np
import pytest

from showc.errors import SolveError
from showc.fleet.pace import straight_time
from showc.fleet.timetable import scheduled, settled
from showc.plan import build_itinerary
from showc.script import read_show

SCRIPT = """\
showc: 1
drones: 2
launch: {hold: 1}
formations:
  row: {type: line, length: 6, centre: [0, 0, 20]}
  up: {type: line, length: 6, centre: [0, 20, 30]}
transitions:
%s
"""


def legs(*transitions):
    show = read_show((SCRIPT % "\n".join(f"  - {one}" for one in transitions)).encode())
    assert show.show is not None, show.diagnostics
    planned = build_itinerary(show.show)
    times = {
        leg.index: straight_time(leg, show.show) for leg in planned.legs if leg.open
    }
    found, clock = [], 0.0
    for leg in scheduled(planned, times).legs:
        time = leg.duration
        if leg.open:
            time = straight_time(leg, show.show)
        found.append((leg.kind, round(clock, 3), round(clock + time, 3)))
        clock += time
    return found


def moves(*transitions):
    return [one for one in legs(*transitions) if one[0] == "transition"]


def test_a_move_takes_the_time_it_prefers_and_the_hold_before_it_the_rest():
    fast, calm = (
        moves("{to: row, at: 40, hold: 2}", f"{{to: up, at: 60, prefer: {pace}}}")
        for pace in (1, 3)
    )
    assert [end for _, _, end in fast] == [end for _, _, end in calm] == [40.0, 60.0]
    least = 60.0 - fast[1][1]
    assert 60.0 - calm[1][1] == pytest.approx(3.0 * least, abs=0.003)


def test_a_move_with_less_room_takes_what_there_is():
    found = moves("{to: row, at: 40, hold: 2}", "{to: up, at: 48, prefer: 5}")
    assert found[1] == ("transition", 42.0, 48.0)


def test_a_hold_that_is_not_written_may_vanish():
    found = legs("{to: row, at: 40}", "{to: up, at: 46, prefer: 10}")
    assert ("transition", 40.0, 46.0) in found
    assert ("hold", 40.0, 40.0) not in found


def test_start_and_duration_are_kept():
    found = moves("{to: row, start: 30, duration: 6}", "{to: up, at: 60, duration: 9}")
    assert found == [("transition", 30.0, 36.0), ("transition", 51.0, 60.0)]


def test_a_move_without_a_time_follows_at_once():
    found = legs("{to: row, at: 40, hold: 3}", "{to: up, hold: 2}")
    assert found[3:5][0] == ("hold", 40.0, 43.0)
    assert found[4][:2] == ("transition", 43.0)


def test_what_cannot_be_met_is_said_with_the_earliest_time():
    with pytest.raises(SolveError) as refused:
        legs("{to: row, at: 40}", "{to: up, hold: 4}", "{to: row, start: 54.3}")
    said = str(refused.value)
    assert "up -> row" in said and "cannot start at 54.300 s" in said
    assert "hold after row -> up" in said and "the earliest time is" in said


def test_a_move_that_prefers_time_is_as_short_as_can_be_and_late():
    found = moves("{to: row, at: 40, hold: 2}", "{to: up, at: 60, prefer: time}")
    calm = moves("{to: row, at: 40, hold: 2}", "{to: up, at: 60, prefer: 1}")
    assert found[1][1:] == pytest.approx(calm[1][1:], abs=0.002)
    # A straight flight is too long an estimate where there is no time for it.
    tight = moves("{to: row, at: 40, hold: 2}", "{to: up, at: 47.6, prefer: time}")
    assert tight[1][1] == 42.0


def test_what_the_show_prefers_holds_where_a_move_says_nothing():
    text = SCRIPT % "  - {to: row}\n  - {to: up, at: 60, prefer: 2}"
    show = read_show(text.replace("drones: 2", "drones: 2\nprefer: energy").encode())
    assert [one.prefer for one in show.show.transitions] == ["energy", 2.0]


def test_a_move_that_prefers_energy_takes_its_time_and_keeps_written_holds():
    found = legs(
        "{to: row, at: 40, hold: 3}", "{to: up, at: 70, prefer: energy, hold: 1}"
    )
    (start, end) = next(one[1:] for one in found if one[:2] == ("transition", 43.0))
    assert (start, end) == (43.0, 70.0)


def test_the_old_name_is_mended():
    text = SCRIPT % "  - {to: row}\n  - {to: up, at: 60, pace: 2}"
    (found,) = read_show(text.encode()).errors
    assert "`prefer`" in f"{found.message} {found.help}"
    assert found.fix == "prefer"


@pytest.mark.parametrize("more", ["", ", prefer: energy"])
def test_drones_that_stay_where_they_are_arrive_on_time_too(more):
    same = f"{{to: row, assignment: keep, at: 60{more}}}"
    (_, stayed) = moves("{to: row, at: 40, hold: 2}", same)
    assert stayed[2] == 60.0
    assert stayed[1] > 59.9


JOINED = """\
showc: 1
drones: 4
separation: 2
formations:
  ring: {type: circle, radius: 6, centre: [0, 0, 18]}
  row: {type: line, length: 15, centre: [0, -14, 12]}
transitions:
  - {to: ring, hold: 6, motion: [{rotate: 100}], arrive: moving}
  - {to: row, at: 60}
"""


def joined(script=JOINED):
    itinerary = settled(
        build_itinerary(read_show(script.encode(), path="s.yaml").draft)
    )
    times = {leg.index: 5.0 for leg in itinerary.legs if leg.open}
    return scheduled(itinerary, times)


@pytest.mark.parametrize(
    ("joins", "message"),
    [
        ("prefer: time, arrive: moving", "say when they meet it, by `at`"),
        ("leave: moving", "leave `prefer` out of what follows"),
    ],
)
def test_how_a_motion_is_joined_as_soon_as_can_be_is_not_known(joins, message):
    """How fast a rotation turns, and so how it is met, depends on the hold."""
    script = JOINED.replace("arrive: moving", joins)
    if joins == "leave: moving":
        script = script.replace("at: 60", "at: 60, prefer: time")
    with pytest.raises(SolveError, match=message):
        joined(script)
    (found,) = read_show(f"{script}mission: {{wanted: false}}\n".encode()).errors
    assert found.code == "SHW213"
    assert "has no fixed duration, and the motion that it" in found.message
    # At rest at both ends it may last as long as it likes.
    assert joined(JOINED.replace(", arrive: moving", ""))


@pytest.mark.parametrize(
    ("joins", "after"),
    [
        ("at: 30, arrive: moving", "at: 60"),
        # It takes the time that it prefers, for the hold after it varies.
        ("arrive: moving", "at: 60"),
        ("duration: 8, arrive: moving, leave: moving", "at: 60"),
        ("leave: moving", "at: 60, duration: 7"),
        ("at: 30, arrive: moving, leave: moving", "start: 50"),
    ],
)
def test_a_motion_that_is_joined_is_held_until_what_follows(joins, after):
    text = JOINED.replace("arrive: moving", joins).replace("at: 60", after)
    text = text.replace("{rotate: 100}", "{rotate: 100}, {orbit: {radius: 1}}")
    show = joined(text)
    at = next(index for index, leg in enumerate(show.legs) if leg.kind == "motion")
    before, motion, leg = show.legs[at - 1 : at + 2]
    assert motion.duration > 6.0
    (moving,) = motion.motion
    for side, other in ((0, before.goal_state), (1, leg.start_state)):
        own = (motion.start_state, motion.goal_state)[side]
        assert (own is None) == (other is None) == (not moving.under_way[side])
        place, speed, _, _ = moving.ends(motion.duration)[side]
        if own is not None:
            assert np.array_equal(own, other)
            assert np.allclose(own[:, 3:6], speed)
            assert np.linalg.norm(speed, axis=1).min() > 0.1
        assert np.allclose((motion.start, motion.goal)[side], place)
    assert np.array_equal(motion.goal, leg.start)
    made = show.show.formations[motion.to_formation].points
    assert np.allclose(made[motion.places], motion.goal)
    clock = sum(one.duration or 5.0 for one in show.legs[: at + 1])
    if "start" in after:
        assert clock == pytest.approx(50.0, abs=1e-6)
    else:
        assert clock + leg.duration == pytest.approx(60.0, abs=1e-6)


def test_drones_of_no_group_stand_where_a_longer_motion_has_left_them():
    """They leave it in motion too, and its end is elsewhere than planned."""
    orbit = "motion: [{orbit: {radius: 1, period: 7}}], leave: moving"
    text = JOINED.replace("motion: [{rotate: 100}], arrive: moving", orbit)
    text = text.replace("formations:", "groups: {a: 1-2}\nformations:")
    up = "{to: up, group: a, at: 60, hold: 3}\n  - {to: row, at: 90}"
    text = text.replace("{to: row, at: 60}", up)
    pair = "up: {type: points, points: [[20, 0, 14], [24, 0, 14]]}"
    made = joined(text.replace("transitions:", f"  {pair}\ntransitions:"))
    at = next(index for index, leg in enumerate(made.legs) if leg.kind == "motion")
    motion, leg, hold, last = made.legs[at : at + 4]
    place = motion.motion[0].ends(motion.duration)[1][0]
    assert motion.duration > 7.0
    assert np.abs(place - motion.motion[0].ends(6.0)[1][0]).max() > 0.1
    for standing in (leg.start, leg.goal, hold.start, hold.goal, last.start):
        assert np.allclose(standing[2:], place[2:])
    assert np.array_equal(leg.goal[:2], hold.start[:2])
    points = made.show.formations[leg.to_formation].points
    assert np.array_equal(points[leg.places], leg.goal)
    assert np.array_equal(np.sort(last.goal[:, 0]), [-7.5, -2.5, 2.5, 7.5])


@pytest.mark.parametrize(
    "after", ["", "{to: row}", "{to: row, duration: 9}", "{to: row, at: 60}"]
)
def test_groups_are_left_in_motion_as_they_are_when_the_last_has_arrived(after):
    """When that is, is known with the time that its move prefers."""
    made = joined(
        f"""\
showc: 1
drones: 4
pads: {{type: line, spacing: 5}}
groups: {{a: 1-2, b: 3-4}}
formations:
  pair: {{type: points, points: [[-12, 0, 14], [-8, 0, 14]]}}
  other: {{type: points, points: [[8, 0, 14], [12, 0, 14]]}}
  row: {{type: line, length: 15, centre: [0, 9, 14]}}
transitions:
  - {{to: pair, group: a, start: 10, hold: 6, motion: [{{rotate: 270}}], leave: moving}}
  - {{to: other, group: b, start: 12, hold: 9}}
{f"  - {after}" * bool(after)}
"""
    )
    at = next(index for index, leg in enumerate(made.legs) if leg.parts)
    groups, leg = made.legs[at : at + 2]
    held, other = groups.parts[1], groups.parts[2]
    arrives = round(other.depart + other.duration, 3)
    leaves = held.depart + held.duration
    if "at:" in after:
        assert leaves == pytest.approx(60.0 - leg.duration)
    else:
        assert leaves == pytest.approx(arrives + 9.0)
    place, speed, _, _ = held.motion[0].ends(held.duration)[1]
    assert np.linalg.norm(speed, axis=1).min() > 0.1
    assert np.allclose(groups.goal[:2], place)
    assert np.array_equal(leg.start, groups.goal)
    assert np.array_equal(leg.start_state, groups.goal_state)
    assert np.allclose(leg.start_state[:2, 3:6], speed)
