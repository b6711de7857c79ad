"""Holds and durations follow from the times that the script asks for."""

import pytest

from showc.errors import SolveError
from showc.fleet.timetable import scheduled, straight_time
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


def test_a_hold_is_not_lengthened_whose_motion_is_joined_at_its_rate():
    """How fast a rotation turns, and so how it is met, depends on the hold."""
    text = """\
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

    def planned(script):
        itinerary = build_itinerary(read_show(script.encode(), path="s.yaml").show)
        times = {leg.index: 5.0 for leg in itinerary.legs if leg.open}
        return scheduled(itinerary, times)

    with pytest.raises(SolveError, match="must know for how long: write 'hold: ") as no:
        planned(text)
    wanted = str(no.value).rsplit("'hold: ", 1)[1].rstrip("'")
    held = planned(text.replace("hold: 6", f"hold: {wanted}"))
    assert any(leg.kind == "motion" and leg.in_motion for leg in held.legs)
    # At rest at both ends it may last as long as it likes.
    assert planned(text.replace(", arrive: moving", ""))
