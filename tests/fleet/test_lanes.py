"""Groups with times of their own: apart at every instant, around each other."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.errors import SolveError
from showc.fleet.execution.pool import InProcess
from showc.fleet.itinerary import solve_itinerary
from showc.fleet.lanes import put_together
from showc.fleet.leg import solve_leg
from showc.fleet.options import SolveOptions
from showc.fleet.pace import straight_time
from showc.fleet.timetable import scheduled
from showc.plan import build_itinerary
from showc.progress import Silent
from showc.script import read_show
from showc.script.lanes import chapters
from showc.trajectory import PiecewisePolynomial

SCRIPT = """\
showc: 1
drones: 6
pads:
  type: points
  points: [[-12, -2, 0], [-12, 2, 0], [-2, -12, 0], [2, -12, 0], [9, 20, 0], [22, 9, 0]]
launch: {{altitude: 10, hold: 2}}
groups: {{east: 1-2, north: 3-4}}
formations:
  right: {{type: points, points: [[12, -2, 10], [12, 2, 10]]}}
  top: {{type: points, points: [[-2, 12, 10], [2, 12, 10]]}}
  left: {{type: points, points: [[-12, -2, 10], [-12, 2, 10]]}}
transitions:
  - {{to: right, group: east, at: 20, duration: 8, assignment: fixed}}
  - {{to: top, group: north, at: 21, duration: {time}, assignment: fixed, hold: 3}}
  - {{to: left, group: east, at: 30, duration: 9, assignment: fixed, hold: 2}}
"""


def solved(time=8, script=SCRIPT):
    result = read_show(script.format(time=time).encode(), path="lanes.yaml")
    assert result.show is not None, result.diagnostics
    return solve_itinerary(
        build_itinerary(result.show), SolveOptions(use_cache=False, jobs=1), Silent()
    )


@pytest.fixture(scope="module")
def crossing():
    return solved()


def test_groups_that_cross_fly_around_each_other(crossing):
    (leg,) = (flown for flown in crossing.legs if flown.parts)
    assert leg.certificate.statistics["flown_again"] > 0
    times = np.linspace(0.0, leg.duration, 2001)
    places = [one.state(times)[:, :3] for one in leg.trajectories]
    separation = crossing.itinerary.show.separation
    gaps = [
        np.linalg.norm((one - other) / [1, 1, separation.vertical_stretch], axis=1)
        for one, other in combinations(places, 2)
    ]
    assert min(gap.min() for gap in gaps) >= separation.distance - 1e-6


def test_every_move_begins_and_ends_when_it_is_asked_to(crossing):
    (leg,) = (flown for flown in crossing.legs if flown.parts)
    assert [(part.leg.depart, part.duration) for part in leg.parts] == [
        (12.0, 8.0),
        (13.0, 8.0),
        (21.0, 9.0),
    ]
    begin = leg.leg.depart
    for row, still in ((0, (20.0, 21.0)), (2, (21.0, 30.0)), (4, (12.0, 30.0))):
        state = leg.trajectories[row].state
        first, last = (state(time - begin)[:3] for time in still)
        assert np.abs(first - last).max() < 1e-9


def test_a_group_flies_around_one_that_holds_in_motion():
    # The east travels where the north has to pass, and back.
    turning = SCRIPT.replace("assignment: fixed}}", "hold: 9, motion: [{{travel: "
        "[[-9, 0, 0], [0, 0, 0]]}}], assignment: fixed}}", 1)  # fmt: skip
    turning = turning.replace("at: 21", "at: 28")
    lines = [line for line in turning.splitlines() if "to: left" not in line]
    flight = solved(script="\n".join(lines))
    (leg,) = (flown for flown in flight.legs if flown.parts)
    assert leg.certificate.statistics["flown_again"] > 0
    _, motion, other = leg.parts
    assert motion.leg.kind == "motion"
    assert (motion.leg.depart, motion.duration) == (20.0, 9.0)
    assert other.leg.depart == 20.0
    times = np.linspace(0.0, leg.duration, 2001)
    places = [one.state(times)[:, :3] for one in leg.trajectories]
    separation = flight.itinerary.show.separation
    gaps = [
        np.linalg.norm((one - other) / [1, 1, separation.vertical_stretch], axis=1)
        for one, other in combinations(places, 2)
    ]
    assert min(gap.min() for gap in gaps) >= separation.distance - 1e-6
    # The formation moves as the script has it, whatever flies around it.
    asked = motion.leg.motion[0].derivatives(9.0, np.array([4.5]))[0, 0]
    state = leg.trajectories[0].state
    assert np.allclose(state(24.5 - leg.leg.depart)[:3], asked[0], atol=1e-4)


def test_a_move_too_quick_for_its_time_says_how_long_it_needs():
    with pytest.raises(SolveError, match=r"cannot arrive at 21.000 s .* needs >= 6"):
        solved(time=6.1)


def test_groups_that_cannot_be_kept_apart_are_refused_with_pair_and_time(crossing):
    (flown,) = (flown for flown in crossing.legs if flown.parts)
    leg, show = flown.leg, crossing.itinerary.show
    asked = []

    def never(part):
        asked.append(part)
        raise SolveError("no way")

    options = SolveOptions(use_cache=False)
    alone = [
        solve_leg(part, show, options, InProcess(), Silent()) for part in leg.parts
    ]
    with pytest.raises(SolveError, match=r"drone \d and drone \d come within"):
        put_together(leg, alone, show, never)
    # Both moves that meet were to give way, the later one first.
    assert {part.name for part in asked} == {"launch -> right", "launch -> top"}
    assert asked[0].name == "launch -> top"
    assert len(asked[0].others) == 4


def test_a_move_that_cannot_be_flown_around_others_is_refused(crossing):
    (flown,) = (flown for flown in crossing.legs if flown.parts)
    part, show = flown.leg.parts[1], crossing.itinerary.show
    # One stands where the group is to go, as long as it flies.
    place = part.goal[0] + [0.3, 0.0, 0.0]
    stays = PiecewisePolynomial.constant(place, 0.0, part.duration)
    blocked = replace(part, others=(stays,), others_parked=None)
    with pytest.raises(SolveError, match=r"launch -> top: drone 3 and another drone"):
        solve_leg(blocked, show, SolveOptions(use_cache=False), InProcess(), Silent())


VALUES = {"start": (18, 22), "at": (26, 30), "duration": (4, 9), "hold": (0, 6)}
KEYS = ["", "start", "at", "duration", "start at", "start duration", "at duration"]
TIMES = st.sampled_from([f"{one}{hold}" for one in KEYS for hold in ("", " hold")])
TIMES = TIMES.flatmap(
    lambda keys: st.fixed_dictionaries(
        {key: st.integers(*VALUES[key]) for key in keys.split()}
    )
)


@settings(max_examples=60, deadline=None)
@given(st.lists(TIMES, min_size=2, max_size=4))
def test_every_time_that_neighbours_ask_for_is_kept_or_refused(asked):
    # Groups in turn, each between two places of its own, the second later.
    asked = [
        {
            key: value + 12 * (k // 2) * (key in {"start", "at"})
            for key, value in one.items()
        }
        for k, one in enumerate(asked)
    ]
    flown = [
        f"  - {{{{to: {'ab'[k % 2]}{k // 2}, group: {'ab'[k % 2]}, assignment: fixed"
        + "".join(f", {key}: {value}" for key, value in one.items())
        + "}}\n"
        for k, one in enumerate(asked)
    ]
    script = NEIGHBOURS + "".join(flown).replace("{{", "{").replace("}}", "}")
    result = read_show(script.encode(), path="lanes.yaml")
    if result.show is None:
        assert all(one.help for one in result.errors)
        return
    planned = build_itinerary(result.show)
    times = {
        leg.index: round(straight_time(leg, planned.show), 3)
        for leg in planned.legs
        if leg.open
    }
    try:
        legs = scheduled(planned, times, estimated=False).legs
    except SolveError:
        return  # it says the earliest time
    clock, found = 0.0, {}
    opened = iter(times.values())
    for leg in legs:
        time = leg.duration if leg.duration is not None else next(opened)
        for part in leg.parts:
            if not part.motion:
                begin = part.depart or 0.0
                found[part.transition] = begin, begin + (part.duration or 0.0)
        if leg.kind == "transition" and not leg.parts:
            flown = next(one for one in chapters(result.show) if leg.transition in one)
            found |= dict.fromkeys(flown, (clock, clock + time))
        clock = round(clock + time, 3)
    rows = {one.to: row for row, one in enumerate(result.show.transitions)}
    for k, one in enumerate(asked):
        begin, end = found[rows[f"{'ab'[k % 2]}{k // 2}"]]
        assert "start" not in one or abs(begin - one["start"]) < 2e-3
        assert "at" not in one or abs(end - one["at"]) < 2e-3
        alone = len(one.keys() & {"start", "at", "duration"}) > 1 and "duration" in one
        assert not alone or abs(end - begin - one["duration"]) < 2e-3
        assert end - begin > one.get("duration", 0.0) - 2e-3


def test_least_energy_with_no_end_in_sight_is_soon_there():
    script = NEIGHBOURS.replace("showc: 1", "showc: 1\nprefer: energy")
    script += "  - {to: a0, group: a, start: 18}\n"
    script += "  - {to: b0, group: b, at: 29, duration: 9}\n"
    result = read_show(script.encode(), path="lanes.yaml")
    assert result.show is not None, result.errors
    planned = build_itinerary(result.show)
    times = {
        leg.index: round(straight_time(leg, planned.show), 3)
        for leg in planned.legs
        if leg.open
    }
    (leg,) = (one for one in scheduled(planned, times).legs if one.parts)
    assert leg.parts[0].duration < 12.0


NEIGHBOURS = """\
showc: 1
drones: 2
mission: {wanted: false}
pads: {type: points, points: [[-12, 0, 0], [12, 0, 0]]}
launch: {altitude: 10, hold: 2}
groups: {a: 1, b: 2}
formations:
  a0: {type: points, points: [[-12, 0, 14]]}
  a1: {type: points, points: [[-12, 4, 12]]}
  b0: {type: points, points: [[12, 0, 14]]}
  b1: {type: points, points: [[12, 4, 12]]}
transitions:
"""
