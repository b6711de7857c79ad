"""Groups with times of their own: what is flown together, and what cannot be."""

import pytest

from showc.script import read_show
from showc.script.lanes import chapters, ending, own_times, rest

SCRIPT = """\
showc: 1
drones: 5
music: {{bpm: 120, cues: {{drop: 20}}}}
pads: {{type: grid, rows: 1, step: 4, count: 5}}
launch: {{altitude: 10, hold: 2}}
groups: {{a: 1-2, b: 4-5}}
formations:
  up: {{type: points, points: [[-8, 0, 16], [-4, 0, 16]]}}
  far: {{type: points, points: [[8, 30, 10], [4, 30, 10]]}}
  down: {{type: points, points: [[-8, 0, 12], [-4, 0, 12]]}}
  all: {{type: grid, rows: 1, columns: 5, step: 4, centre: [0, 0, 20]}}
transitions:
{transitions}
"""


def read(*transitions):
    lines = "\n".join(f"  - {{{one}}}" for one in transitions)
    return read_show(SCRIPT.format(transitions=lines).encode(), path="show.yaml")


def together(*transitions):
    result = read(*transitions)
    assert result.show is not None, result.errors
    found = chapters(result.show)
    return found, [
        own_times([result.show.transitions[row] for row in one]) for one in found
    ]


A = "to: up, group: a, hold: 1, start: 10, at: 20"
B = "to: far, group: b, hold: 4, at: 28, duration: 14"


@pytest.mark.parametrize(
    ("transitions", "chapter", "own"),
    [
        # In one common time, as long as nothing else is asked for.
        (["to: up, group: a", "to: far, group: b"], [[0, 1]], [False]),
        ([A, "to: far, group: b"], [[0, 1]], [False]),
        ([A, "to: far, group: b, at: 20"], [[0, 1]], [False]),
        # Each in its own.
        ([A, B], [[0, 1]], [True]),
        ([A, B, "to: down, group: a, at: 26, duration: 4"], [[0, 1, 2]], [True]),
        # It arrives while the other still moves: so it moves meanwhile.
        ([A, B, "to: down, group: a, at: 26"], [[0, 1, 2]], [True]),
        # While the other is held.
        ([A, B, "to: down, group: a, start: 31, duration: 4"], [[0, 1, 2]], [True]),
        # After all are held: another chapter.
        ([A, B, "to: down, group: a, start: 33, duration: 4"], [[0, 1], [2]],
         [True, False]),
        ([A, "to: far, group: b, start: 25, duration: 9"], [[0], [1]], [False, False]),
        # Nothing says when: after the others.
        ([A, B, "to: down, group: a"], [[0, 1], [2]], [True, False]),
    ],
)  # fmt: skip
def test_what_is_flown_together_and_in_which_times(transitions, chapter, own):
    assert together(*transitions) == (chapter, own)


def test_moves_may_be_written_one_group_after_the_other():
    later = "to: down, group: a, at: 40, duration: 4"
    show, blocks = read(A, B, later).show, read(A, later, B).show
    assert show is not None and blocks is not None
    plain = [[one.name for one in each.transitions] for each in (show, blocks)]
    assert plain[0] == plain[1] == ["launch -> up", "launch -> far", "up -> down"]
    assert [one.hold for one in show.transitions] == [
        one.hold for one in blocks.transitions
    ]
    # The fleet's own moves stay where they are written.
    last = read(A, "to: all, at: 60", B).show
    assert last is None or [one.to for one in last.transitions] == ["up", "all", "far"]


def test_times_of_one_group_that_run_backwards_are_found():
    result = read("to: up, group: a, at: 40", "to: down, group: a, at: 20", B)
    assert result.errors


def test_every_group_is_held_as_long_as_it_asks_after_the_last_arrival():
    show = read(A, B, "to: down, group: a, at: 26, hold: 9").show
    assert rest(show.transitions) == 7.0


def fault(*transitions):
    (found,) = read(*transitions).errors
    return found


def test_cues_and_beats_are_times_of_groups_too():
    show = read("to: up, group: a, at: bar 10", 'to: far, group: b, at: "@drop"').show
    assert [one.at for one in show.transitions] == [18.0, 20.0]
    assert own_times(show.transitions)


def test_a_move_may_say_only_when_it_leaves():
    result = read(A, "to: far, group: b, start: 12, hold: 4")
    assert result.show is not None, result.errors
    assert own_times(result.show.transitions)
    # Its own arrival comes later; this is a lower bound.
    assert ending(result.show.transitions) == 21.0


def test_a_fleet_that_takes_over_a_group_as_quickly_as_it_can_is_found():
    over = "to: all, start: 50, prefer: time"
    found = fault(MOVING + ", leave: moving", B.replace("14", "12"), over)
    assert found.code == "SHW213"
    assert "`up + far -> all` has no fixed duration" in found.message
    assert not read(MOVING, B.replace("14", "12"), over).errors


def test_a_motion_that_is_left_when_another_flies_at_no_known_time_is_found():
    text = SCRIPT.replace("a: 1-2, b: 4-5", "a: 1-2, b: 4, c: 5")
    text = text.replace(
        "far: {{type: points, points: [[8, 30, 10], ", "far: {{type: points, points: ["
    )
    text = text.replace(
        "formations:", "formations:\n  near: {{type: points, points: [[9, 0, 16]]}}"
    )
    lines = [
        MOVING + ", leave: moving",
        "to: far, group: b",
        "to: near, group: c, at: 30",
    ]
    written = "\n".join(f"  - {{{one}}}" for one in lines)
    (found,) = read_show(text.format(transitions=written).encode()).errors
    assert found.code == "SHW213"
    assert "`launch -> far` has no time, and a group stays in motion" in found.message
    assert found.help == "give it `start` or `at`"
    # That it does not say when it arrives is no fault.
    late = written.replace("group: b", "group: b, start: 12")
    assert not read_show(text.format(transitions=late).encode()).errors


def test_a_group_cannot_leave_while_it_is_held():
    found = fault(A, B, "to: down, group: a, start: 20.5, duration: 4")
    assert "`up -> down` cannot start at 20.5 s of the music: 0.5 s" in found.message
    assert "`a` reaches `up` at 20 s" in found.notes[0]


def test_a_move_that_no_drone_can_make_in_its_time_is_found():
    quick = fault(A, "to: far, group: b, at: 23.5, duration: 3")
    assert quick.code == "SHW209"
    late = fault(A, "to: far, group: b, at: 10.5")
    assert late.code == "SHW213"
    assert "cannot arrive at 10.5 s of the music" in late.message


MOVING = A.replace("hold: 1", "hold: 5") + ", motion: [{rotate: 90}]"


def test_a_motion_beside_groups_of_other_times_ends_before_the_fleet_stands():
    result = read(MOVING, B.replace("28", "24").replace("14", "12"))
    assert result.show is not None, result.errors
    assert (ending(result.show.transitions), rest(result.show.transitions)) == (25, 3)


def test_a_motion_that_is_left_under_way_lasts_until_all_groups_are_held():
    result = read(MOVING + ", leave: moving", B.replace("14", "12"))
    assert result.show is not None, result.errors
    assert (ending(result.show.transitions), rest(result.show.transitions)) == (32, 0)


def test_a_motion_of_no_time_beside_others_is_found():
    found = fault(MOVING.replace("hold: 5", "hold: 0"), B)
    assert "is held for only 0 s" in found.message
    assert "0.5 s or more" in found.help


def test_a_motion_among_groups_is_as_quick_as_its_own_time_asks():
    quick = A + ", motion: [{wave: {amplitude: 2, period: 2}}]"
    found = fault(quick.replace("hold: 1", "hold: 6"), B)
    assert found.code == "SHW217"
    assert "of `up` needs" in found.message


MEETS = "motion: [{travel: [[16, 30, -6], [0, 0, 0]]}]"


@pytest.mark.parametrize(
    "transitions",
    [
        # Beside a group that has arrived; that comes later; with one common time.
        (B, f"to: up, group: a, at: 30, duration: 9, hold: 60, {MEETS}"),
        (f"to: up, group: a, at: 20, duration: 9, hold: 60, {MEETS}", B),
        (f"to: up, group: a, hold: 40, {MEETS}", "to: far, group: b"),
    ],
)  # fmt: skip
def test_a_motion_into_what_another_group_holds_is_found(transitions):
    found = fault(*transitions)
    assert found.code == "SHW208"
    assert "(group `a`)" in found.message
    assert "(group `b`)" in found.message
    assert "comes within 0" in found.message
    assert "into this motion" in found.notes[0]


def test_a_motion_through_places_that_another_group_has_left_is_none():
    left = "to: down, group: b, at: 45, duration: 8"
    gone = "to: up, group: a, at: 48, duration: 5, hold: 30"
    far = "to: far, group: b, at: 30, duration: 14, hold: 1"
    stay = "to: up, group: a, at: 31, duration: 9, hold: 1"
    result = read(far, stay, left, f"{gone}, {MEETS}")
    assert not [one for one in result.errors if "into this motion" in str(one.notes)]


LEAVES = "at: 20, hold: 5, motion: [{rotate: 90}], leave: moving"
LATER = "to: far, group: b, at: 60, duration: 14"


def test_groups_with_own_times_fly_with_one_that_is_left_in_motion():
    leaves = f"to: up, group: a, {LEAVES}, start: 12"
    away = "to: down, group: a, start: 40, at: 52"
    assert together(leaves, away, LATER) == ([[0, 1, 2]], [True])
    # When one arrives may be open.
    later = LATER.replace("at: 60, duration: 14", "start: 46")
    assert together(leaves, away, later) == ([[0, 1, 2]], [True])
    # Without times of its own it stays a chapter by itself.
    assert together(leaves, away) == ([[0], [1]], [False, False])


def test_groups_with_own_times_after_a_fleet_that_is_left_in_motion_are_found():
    found = fault(f"to: all, {LEAVES}", "to: down, group: a, start: 40, at: 52", LATER)
    assert found.code == "SHW213"
    assert "`launch -> all` stays in motion" in found.message
    assert found.span.line == 13


def test_groups_that_swap_their_places_at_once_are_right():
    swap = ("to: up, group: a", "to: far, group: b", "to: far, group: a")
    result = read(*swap, "to: up, group: b")
    assert "SHW208" not in {one.code for one in result.diagnostics}
    # One that comes where the other stays is wrong.
    assert "SHW208" in {one.code for one in read(*swap).diagnostics}


def test_groups_in_one_time_cannot_take_different_times():
    both = "to: up, group: a, duration: {}", "to: far, group: b, duration: 14"
    found = fault(both[0].format(4), both[1])
    assert found.code == "SHW213"
    assert "takes 4 s, the groups that fly with it 14 s" in found.message
    assert not read(both[0].format(14), both[1]).errors
    assert not read("to: up, group: a", both[1]).errors
