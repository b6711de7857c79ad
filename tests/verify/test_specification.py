"""Choices that the script leaves are checked: groups, parking, assignment, times."""

from dataclasses import replace

import numpy as np
import pytest
from findings import failed
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from verified import loaded

from showc.pipeline.compile import CompileOptions, compile_script
from showc.script import load_show
from showc.verify import verify_log
from showc.verify.specification.demands import _one_to_one, hold_against

SCRIPT = """\
showc: 1
name: Groups
drones: 6
separation: 1.5
vehicle: formation-625g
pads: {type: grid, rows: 2, columns: 3, step: 4}
launch: {altitude: 6, hold: 1}
groups: {left: [1, 2, 3], right: [4, 5, 6]}
formations:
  near: {type: circle, count: 3, radius: 4, centre: [-15, 0, 12], colour: red}
  far: {type: circle, count: 3, radius: 4, centre: [15, 0, 14], colour: blue}
  four: {type: circle, count: 4, radius: 6, centre: [0, 0, 20], colour: gold}
  wait: {type: line, count: 3, length: 8, centre: [0, -15, 8]}
parking: wait
transitions:
  - {to: near, group: left, hold: 1, assignment: fixed}
  - {to: far, group: right, hold: 2}
  - {to: four, hold: 1, duration: 12}
  - {to: four, hold: 1, assignment: fixed, colour: blue, fade: start, at: 70.125}
landing: {altitude: 6}
"""
LEGS = {"launch": 0, "groups": 2, "four": 4, "fixed": 6, "approach": 8, "land": 9}
"""Position of some legs in the show."""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("groups")
    script = folder / "groups.yaml"
    script.write_text(SCRIPT)
    compile_script(script, folder / "output.mcap", CompileOptions(missions=False))
    return folder


def found(compiled, number, change):
    """Findings on places if the goals and places of one leg are others."""
    _, logged = loaded(compiled / "output.mcap")
    segments = list(logged.segments)
    goals = segments[number].goals.copy()
    message = type(segments[number].message)()
    message.CopyFrom(segments[number].message)
    change(goals, message)
    segments[number] = replace(segments[number], goals=goals, message=message)
    show = load_show(compiled / "groups.yaml").show
    return hold_against(show, replace(logged, segments=tuple(segments)))


def swap(goals, message, first, second):
    places = list(message.places)
    goals[[first, second]] = goals[[second, first]]
    places[first], places[second] = places[second], places[first]
    message.places[:] = places


def test_groups_parking_and_times_are_those_of_the_script(compiled):
    verification = verify_log(compiled / "output.mcap", script=compiled / "groups.yaml")
    assert failed(verification) == set()
    assert verification.missions == "none"


def test_drones_of_a_fixed_assignment_may_not_change_places(compiled):
    wrong = found(compiled, LEGS["fixed"], lambda g, m: swap(g, m, 0, 1))
    assert any("numbers" in text for text in wrong.places)


def test_drones_of_an_optimal_assignment_may(compiled):
    number = LEGS["four"]
    _, logged = loaded(compiled / "output.mcap")
    message = logged.segments[number].message
    first, second = np.flatnonzero(np.array(message.places) >= 0)[:2]
    wrong = found(compiled, number, lambda g, m: swap(g, m, first, second))
    # What comes after it no longer fits: the hold is in the former places.
    assert not any(text.startswith(f"“{message.name}”") for text in wrong.places)


def test_a_place_taken_twice_is_found(compiled):
    def change(goals, _):
        goals[0] = goals[1]

    wrong = found(compiled, LEGS["four"], change)
    assert any("twice" in text for text in wrong.places)


def test_a_group_may_not_take_the_others_places(compiled):
    wrong = found(compiled, LEGS["groups"], lambda g, m: swap(g, m, 0, 3))
    assert wrong.places


@pytest.mark.parametrize("number", LEGS.values())
def test_a_goal_off_its_place_by_a_micrometre_is_found(compiled, number):
    def change(goals, _):
        goals[2, 1] += 1e-6

    wrong = found(compiled, number, change)
    assert wrong.places or wrong.rules


def test_arrivals_are_held_to_ten_milliseconds(compiled):
    _, logged = loaded(compiled / "output.mcap")
    show = load_show(compiled / "groups.yaml").show
    move = logged.segments[LEGS["fixed"]]
    assert abs(move.end - 70.125) < 1e-9

    def times(asked):
        changed = (*show.transitions[:-1], replace(show.transitions[-1], at=asked))
        return hold_against(replace(show, transitions=changed), logged).times

    assert times(70.134) == []
    assert len(times(70.137)) == 1
    assert len(times(70.11)) == 1


def standing(compiled, leg, *, late, **asked):
    """Times that are wrong if all stand at one end of a leg while they should fly.

    ``asked`` is what the script says otherwise of the last transition.
    """
    _, logged = loaded(compiled / "output.mcap")
    show = load_show(compiled / "groups.yaml").show
    changed = (*show.transitions[:-1], replace(show.transitions[-1], **asked))
    show, segments = replace(show, transitions=changed), list(logged.segments)
    assert hold_against(show, logged).times == []
    move = segments[LEGS[leg]]
    table = move.table
    state = table.state.copy()
    rows = table.first[1:] - 1 if late else table.first[:-1]
    state[rows] = move.ends()[int(late)][:, None]
    segments[LEGS[leg]] = replace(move, table=replace(table, state=state))
    return hold_against(show, replace(logged, segments=tuple(segments))).times


def test_a_move_in_a_given_time_is_flown_until_it_is_over(compiled):
    """All hover where they are to be before the time has come."""
    (wrong,) = standing(compiled, "four", late=True)
    assert "no drone flies" in wrong


def test_a_move_in_a_given_time_may_begin_with_a_wait(compiled):
    """As where nothing is found in the time that the script gives."""
    assert standing(compiled, "four", late=False) == []


def test_a_move_that_is_to_leave_at_a_time_does_not_wait(compiled):
    _, logged = loaded(compiled / "output.mcap")
    start = logged.segments[LEGS["fixed"]].start
    asked = {"at": None, "start": start, "prefer": "time"}
    (wrong,) = standing(compiled, "fixed", late=False, **asked)
    assert "no drone flies" in wrong


def test_a_hold_before_a_given_time_may_grow_but_not_shrink(compiled):
    _, logged = loaded(compiled / "output.mcap")
    show = load_show(compiled / "groups.yaml").show
    grown = logged.segments[LEGS["fixed"] - 1].duration
    assert grown > 5.0

    def legs(hold):
        changed = list(show.transitions)
        changed[-2] = replace(changed[-2], hold=hold)
        return hold_against(replace(show, transitions=tuple(changed)), logged).legs

    assert legs(grown) == []
    assert any("or more" in text for text in legs(grown + 0.01))


GRID = st.sampled_from([-1.0, 0.0, 1.0, 2.0])
FEW = st.integers(1, 4)


@given(
    FEW.flatmap(lambda n: arrays(np.float64, (n, 3), elements=GRID)),
    FEW.flatmap(lambda n: arrays(np.float64, (n, 3), elements=GRID)),
    st.floats(-2e-9, 2e-9),
)
def test_places_are_given_out_one_to_one(goals, allowed, off):
    """As a comparison of every goal with every place says."""
    error = 1e-9
    goals = goals + off
    near = (np.abs(goals[:, None] - allowed) <= error).all(axis=2)
    alone = (near.sum(axis=1) == 1).all() and (near.sum(axis=0) <= 1).all()
    places = _one_to_one(goals, allowed, error)
    assert (places is not None) == alone
    assert places is None or places.tolist() == near.argmax(axis=1).tolist()


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf])
def test_a_goal_that_is_nowhere_has_no_place(odd):
    allowed = np.arange(30.0).reshape(10, 3)
    for goals in (np.where(allowed == 7.0, odd, allowed), np.full((10, 3), odd)):
        assert _one_to_one(goals, allowed) is None
    assert _one_to_one(np.zeros((10, 3)), np.zeros((10, 3))) is None
    assert _one_to_one(allowed[::-1], allowed).tolist() == list(range(10))[::-1]
