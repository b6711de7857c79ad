"""Crowds: a flight for every feasible move, near the least time, in bounded work."""

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from fleet.handmade import Listening, make_leg, make_options, make_show
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from showc.errors import SolveError
from showc.fleet import search as module
from showc.fleet import solve_leg
from showc.fleet.deconfliction import layered, repair
from showc.fleet.deconfliction.clock import fly_apart
from showc.fleet.deconfliction.conflicts import closest
from showc.fleet.deconfliction.layered import fly_layered
from showc.fleet.deconfliction.layers import layers
from showc.fleet.deconfliction.repair import Repair
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.deconfliction.untangling import untangle
from showc.fleet.execution.pool import InProcess
from showc.fleet.leg import aircraft_of
from showc.fleet.proof import flaw
from showc.fleet.search import Room, Search
from showc.fleet.single_drone.audit import greatest_excess
from showc.fleet.single_drone.replay import replay
from showc.vehicle import PRESETS, Separation

WIDE = replace(
    PRESETS["formation-625g"].limits,
    position_min=(-200.0, -200.0, -1.0),
    position_max=(200.0, 200.0, 200.0),
)
CUBE = np.array(np.meshgrid(*[np.arange(2) - 0.5] * 3)).reshape(3, -1).T


def fly(start, goal, options=None):
    show = make_show(len(start))
    leg = make_leg(start, goal, limits=WIDE)
    heard = Listening()
    found = solve_leg(leg, show, options or make_options(), InProcess(), heard)
    assert not flaw(found, show)
    nearest = closest(tracks_of(found.trajectories), show.separation)
    assert nearest.distance[0] >= show.separation.distance - 1e-6
    return found, heard


def test_drones_fly_through_a_wall_of_others_that_hover():
    steps = 1.6 * np.arange(3.0)
    wall = np.array([[0.0, y, 20.0 + z] for y in steps for z in steps])
    run = wall[[0, 4, 8]]
    found, _ = fly(
        np.concatenate([wall, run - [12.0, 0.0, 0.0]]),
        np.concatenate([wall, run + [12.0, 0.0, 0.0]]),
    )
    assert found.certificate.gap < 0.003


def test_a_ring_that_turns_by_half_takes_little_longer():
    """Ways that are found in more time are flown in it by flights that are slowed.

    Alone, these drones lift and fall to be sooner there; in more time they fly at other
    heights, and ways of the one are none of the other.
    """
    turn = np.pi * np.arange(16) / 8.0
    ring = 6.0 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1) + [0, 0, 20]
    found, _ = fly(ring, np.roll(ring, 8, axis=0))
    assert found.certificate.gap < 0.04


@pytest.mark.parametrize(("count", "draw"), [(6, 0), (8, 0), (8, 3)])
def test_few_that_exchange_places_across_a_ring_take_no_longer(count, draw):
    turn = 2.0 * np.pi * np.arange(count) / count
    ring = 6.0 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    # As if a processor rounded otherwise.
    ring += 1e-11 * np.random.default_rng(draw).standard_normal(ring.shape)
    height = np.array([0.0, 0.0, 12.0])
    found, _ = fly(ring + height, height - ring)
    # That is the first time that is tried, 0.1 % over the minimum.
    assert found.certificate.gap < 0.0015


def test_two_great_teams_that_change_sides_pass_in_layers():
    rows = np.array(
        [[2.2 * x + 6.0, 2.2 * y, 30.0] for x in range(10) for y in range(10)]
    )
    left = rows * [-1.0, 1.0, 1.0]
    found, _ = fly(np.concatenate([left, rows]), np.concatenate([rows, left]))
    assert found.certificate.gap < 0.003


def test_places_in_a_wall_are_exchanged_within_limits_in_the_least_time():
    wall = 2.0 * np.array([[x, 0.0, 10.0 + z] for x in range(6) for z in range(4)])
    found, _ = fly(wall, wall[np.random.default_rng(0).permutation(24)])
    assert found.certificate.gap < 0.002
    # In the first time that is tried, without a look at longer ones.
    tries = found.certificate.statistics
    assert tries["common_times_tried"] == 1.0
    assert "common_times_passed_over" not in tries


@settings(max_examples=50, deadline=None)
@given(st.integers(2, 20), st.data())
def test_no_pair_that_meets_is_in_one_layer(count, data):
    pairs = list(combinations(range(count), 2))
    met = data.draw(st.lists(st.sampled_from(pairs), min_size=1))
    first, second = np.array(met).T
    along = np.arange(float(count))
    found = layers(along, first, second)
    assert np.all(np.abs(found[first] - found[second]) >= 1.0)
    # Two layers are enough where pairs join only even drones with odd ones.
    crossing = (first + second) % 2 == 1
    if crossing.any():
        found = layers(along, first[crossing], second[crossing])
        assert set(found.tolist()) <= {-0.5, 0.5}


QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("size", "turn", "gap", "down"),
    [(9.0, -np.eye(3), 0.12, True), (1.05, QUARTER, 0.1, False)],
)
def test_where_all_are_in_the_way_time_comes_down_and_the_search_ends(
    size, turn, gap, down
):
    middle = np.array([0.0, 0.0, 30.0])
    found, heard = fly(size * CUBE + middle, size * CUBE @ turn.T + middle)
    assert found.certificate.gap < gap
    assert down <= any("over the minimum; trying" in note for note in heard.notes)


def search(leg, options=None, separation=None, workers=None):
    show = make_show(leg.drones.size, separation=separation)
    return Search(
        leg,
        "here",
        aircraft_of(show, leg),
        Room(show.separation, None),
        options or make_options(),
        workers or InProcess(),
        Listening(),
    )


def test_workers_change_the_ways_of_crowds():
    asked = []

    class Recording(InProcess):
        def run(self, function, *task):
            asked.append(getattr(function, "func", function))
            return super().run(function, *task)

    start = np.array([[0.0, 0.0, 20.0], [6.0, -6.0, 20.0]])
    goal = np.array([[12.0, 0.0, 20.0], [6.0, 6.0, 20.0]])
    repair = search(make_leg(start, goal, limits=WIDE), workers=Recording()).at(4.0)
    assert repair.done
    assert untangle in asked


def test_a_time_in_which_nothing_was_found_is_not_called_impossible():
    ends = np.array([[0.0, 0.0, 20.0], [9.0, 0.0, 20.0]])
    leg = make_leg(ends, ends[::-1], limits=WIDE, duration=1.0)
    least = search(leg).limiting(solve=False).time
    leg = replace(leg, duration=1.0005 * least)
    with pytest.raises(SolveError) as caught:
        solve_leg(leg, make_show(2), make_options(), InProcess(), Listening())
    assert "no flight was found in less than" in str(caught.value)
    assert "needs >=" not in str(caught.value)


LINE = np.array([[1.0 * k, 0.0, 20.0] for k in range(4)])
"""Places of drones in a line, as near as the separation allows."""


@pytest.mark.parametrize("tangled", [0.0, 10.0])
def test_after_few_pairs_were_left_the_same_ways_are_tried_in_a_little_more_time(
    tangled, monkeypatch
):
    looking = search(make_leg(LINE, LINE[::-1], limits=WIDE))
    left = looking.at(3.0)
    assert left.crowd is not None
    left.tangled, looked = tangled, []
    found = replace(
        untangle(left.crowd), duration=3.5, coefficients=0.0 * left.crowd.places
    )
    monkeypatch.setattr(module, "quickest", lambda *_: looked.append(1) or found)
    monkeypatch.setattr(left, "led", lambda one: one)
    gap = looking._later(left, 0.001, 2.0)
    if tangled:
        assert gap == pytest.approx(0.75) and looked
        assert looking.ways is found
    else:
        assert gap == pytest.approx(1.001 * (1.0 + module._STEP) - 1.0) and not looked
        assert looking.ways.bent.keys() == left.ways.bent.keys()
    again = looking._later(left, gap, 2.0)
    steps = {0.0: 2.0, 10.0: 1.0}[tangled] * module._STEP
    assert again == pytest.approx((1.0 + gap) * (1.0 + steps) - 1.0)


def test_a_try_ends_where_single_drones_move_in_vain(monkeypatch):
    """Neighbours begin as near as may be; little time is left to turn aside."""
    moved, settle = [], Repair._settle
    monkeypatch.setattr(Repair, "_settle", lambda self: moved.append(1) or settle(self))
    looking = search(make_leg(LINE, LINE[::-1], limits=WIDE))
    least = looking.limiting(solve=True).time
    ways = looking.at(1.2 * least).ways
    counts = []
    for gains in (True, False):
        monkeypatch.setattr(Repair, "_gains", lambda _, gains=gains: gains)
        moved.clear()
        tried = looking.at(1.14 * least, ways)
        counts.append(len(moved))
    assert not tried.done
    assert counts[0] > counts[1] == 1


def test_single_drones_are_solved_again_only_among_other_flights(monkeypatch):
    met = SimpleNamespace(
        first=np.array([0, 1, 2]),
        second=np.array([1, 2, 3]),
        distance=np.array([0.9, 0.7, 0.8]),
    )
    asked = []
    bending = search(make_leg(LINE, LINE + 9.0, limits=WIDE)).at(9.0)._bending
    monkeypatch.setattr(bending, "_around_others", lambda row, _: asked.append(row))
    assert not bending.one_by_one(met, 1)
    assert asked == [1, 2, 3, 0]
    # Where one finds a way, others may find theirs now.
    gains = iter([False, False, False, True])
    monkeypatch.setattr(
        bending, "_around_others", lambda row, _: asked.append(row) or next(gains, 0)
    )
    asked.clear()
    assert bending.one_by_one(met, 1)
    assert asked == [1, 2, 3, 0]
    gains = iter([False, False, True])
    asked.clear()
    assert bending.one_by_one(met, 1)
    assert asked == [1, 2, 3, 0, 1]


def test_single_drones_gain_where_a_fifth_less_is_lacking_than_ever_before(monkeypatch):
    left = search(make_leg(LINE, LINE[::-1], limits=WIDE)).at(3.0)
    lacks = iter([0.10, 0.07, 0.06, 0.09, 0.04])
    monkeypatch.setattr(left.flights, "lacking", lambda _: next(lacks))
    left._settled = np.inf
    gains = [left._gains() for _ in range(5)]
    assert gains == [True, True, False, False, True]


@pytest.mark.parametrize("seed", [1, 3, 13, 15])
def test_neighbours_at_the_separation_leave_and_arrive_in_little_more_time(seed):
    """Lacks of micrometres in their first and last instants are conflicts as well."""
    draw = np.random.default_rng(seed)
    count = int(draw.integers(6, 13))
    plane = np.array([(i, j, 0) for i in range(4) for j in range(4)], dtype=float)
    row = np.array([(k - (count - 1) / 2, 0, 0) for k in range(count)])
    block = np.array(list(np.ndindex(3, 3, 3)), dtype=float)

    def places(of):
        return of[draw.permutation(len(of))[:count]]

    ends = ((plane, row), (block, plane))[seed % 3 == 0]
    start, goal = (places(of) + [0.0, 0.0, 20.0] for of in ends)
    goal += draw.uniform(-5.0, 5.0, 3) + [0.0, 0.0, 4.0]
    cost = ((start[:, None] - goal) ** 2).sum(axis=2)
    goal = goal[linear_sum_assignment(cost)[1]]
    looking = search(make_leg(start, goal, limits=WIDE))
    assert looking.at(1.03 * looking.limiting(solve=True).time).done


@pytest.fixture
def hasty(monkeypatch):
    """Let a search that looks for the time in which a crowd parts soonest fail."""

    def longer(*_):
        pytest.fail("ways in more time are looked for")

    for place in (repair, module):
        monkeypatch.setattr(place, "quickest", longer)


MIXED = np.array(list(np.ndindex(3, 3, 3))) * 1.6 + [0.0, 0.0, 20.0]
MIXED = MIXED, MIXED[np.random.default_rng(2).permutation(27)]
"""Places of drones that change them all, in a block."""


@pytest.mark.usefixtures("hasty")
def test_a_draft_leaves_a_crowd_that_hardly_parts_to_the_closed_form(monkeypatch):
    monkeypatch.setattr(module, "_DRAFT_GAPS", (0.01, 0.02))
    found, heard = fly(*MIXED, make_options(effort=0))
    tries = found.certificate.statistics
    assert "common_times_tried" not in tries
    assert tries["common_times_passed_over"] == 3.0
    assert "layers" in found.certificate.method
    # A bound by pairs would take longer than all the rest.
    assert "passing_bound" not in tries
    assert not any("pairs can pass" in note for note in heard.notes)


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("crowd", ["a block", "a line"])
def test_a_draft_of_a_crowd_takes_a_little_more_than_the_least_time(crowd):
    """In closed form these drones would take more than twice the least time."""
    start, goal = MIXED
    if crowd == "a line":
        start = np.array([[1.5 * k - 12.0, 0.0, 20.0] for k in range(16)])
        goal = start[::-1]
    found, _ = fly(start, goal, make_options(effort=0))
    number = 0 if crowd == "a line" else -1
    assert found.certificate.gap < 1.01 * module._DRAFT_GAPS[number]


def test_a_draft_flies_what_hardly_meets_in_the_least_time():
    ends = np.array([[0.0, 0.0, 20.0], [9.0, 0.0, 20.0], [4.5, 9.0, 20.0]])
    found, _ = fly(ends, ends[[1, 0, 2]], make_options(effort=0))
    assert found.certificate.gap < 0.0015


def test_a_time_that_the_script_gives_is_no_matter_of_effort():
    leg = make_leg(CUBE, CUBE + 5.0)
    assert search(leg, make_options(effort=0)).spent
    given = replace(leg, duration=30.0)
    assert not search(given, make_options(effort=0)).spent


@pytest.mark.parametrize("effort", [1, 3])
def test_more_effort_allows_more_work(effort):
    found = search(make_leg(CUBE, CUBE + 5.0), make_options(effort=effort))
    found.work = 2.0 * (module._WORK + module._WORK_EACH * len(CUBE))
    assert found.spent is (effort == 1)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 40))
def test_the_best_assignment_always_has_a_flight_in_closed_form(seed, count):
    """Places as near as may be, above each other and not: the guarantee."""
    draw = np.random.default_rng(seed)
    lattice = np.array(list(np.ndindex(4, 4, 4)), dtype=float)

    def places():
        chosen = lattice[draw.permutation(64)[:count]]
        return chosen + draw.uniform(-9.0, 9.0, 3) + [0.0, 0.0, 40.0]

    start, goal = places(), places()
    cost = ((start[:, None] - goal) ** 2).sum(axis=2)
    goal = goal[linear_sum_assignment(cost)[1]]
    known = search(make_leg(start, goal, limits=WIDE)).surely()
    assert known is not None and known.widening <= 1.0
    nearest = closest(tracks_of(known.trajectories), make_show(2).separation)
    assert nearest.distance[0] >= 1.0 - 1e-6


@pytest.mark.parametrize("shape", ["sphere", "ellipsoid", "any-axis"])
@pytest.mark.parametrize(("seed", "count"), [(1, 2), (2, 9), (3, 16)])
def test_every_assignment_has_a_flight_in_layers_where_there_is_room(
    seed, count, shape
):
    draw = np.random.default_rng(seed)
    separation = Separation(1.0, shape)
    # In the ellipsoid's metric heights count less.
    lattice = np.array(list(np.ndindex(4, 4, 4))) / separation.metric_scale
    start, goal = (
        lattice[draw.permutation(64)[:count]] + [0.0, 0.0, 40.0] for _ in range(2)
    )
    leg = make_leg(start, goal, limits=WIDE)
    known = fly_layered(search(leg, separation=separation).crossing())
    assert known is not None and known.layers <= count
    nearest = closest(tracks_of(known.trajectories), separation)
    assert nearest.distance[0] >= 1.0 - 1e-6
    first = [one.state.coefficients[0, 0, :3] for one in known.trajectories]
    assert np.array_equal(first, start)


@pytest.mark.parametrize(
    ("half", "top", "flown"),
    [(3.1, 37.0, True), (30.0, 0.2, True), (3.1, 0.2, False)],
)
def test_layers_lie_wherever_the_volume_has_the_room(half, top, flown):
    limits = replace(
        WIDE, position_min=(-half, -half, 2.8), position_max=(half, half, 3.0 + top)
    )
    ring = 3.0 * np.exp(1j * np.arange(9.0) * 2.0 * np.pi / 9.0)
    start = np.stack([ring.real, ring.imag, np.full(9, 3.0)], axis=1)
    leg = make_leg(start, start[::-1] * [-1.0, 1.0, 1.0], limits=limits)
    found = fly_layered(search(leg).crossing())
    assert (found is not None) is flown


def test_layers_above_each_other_take_a_level_way_little_more_time():
    # Thrust that jumps as drones rise would turn those that lean under way at once.
    row = np.stack([np.arange(12.0), np.zeros(12), np.full(12, 30.0)], axis=1)
    crossing = search(make_leg(row, np.roll(row, -1, axis=0), limits=WIDE)).crossing()
    known = fly_layered(crossing)
    assert known is not None
    assert known.duration < 2.0 * crossing.profile.duration


def test_layers_beside_each_other_take_a_way_up_little_more_time():
    stack = np.stack([np.zeros(8), np.zeros(8), 20.0 + 1.2 * np.arange(8.0)], axis=1)
    crossing = search(make_leg(stack, stack[::-1], limits=WIDE)).crossing()
    known = fly_layered(crossing)
    assert known is not None
    assert known.duration < 2.6 * crossing.profile.duration


def test_what_no_widening_parts_is_flown_in_layers():
    cube = 1.05 * CUBE + [0.0, 0.0, 30.0]
    found = search(make_leg(cube, cube[::-1], limits=WIDE))
    known = found.surely()
    assert known is not None and "layers" in known.method and len(known.ways.bent) == 8
    for flight in known.trajectories:
        assert greatest_excess(found.aircraft, flight).relative < 1e-9
    assert replay(found.aircraft.vehicle, known.trajectories).position.max() < 1e-3


def test_layers_that_drones_reach_slowly_are_flown_only_at_last(monkeypatch):
    """Where climbs are slow they take far longer than any time that is tried."""
    monkeypatch.setattr(Repair, "run", lambda _: False)
    flown = []

    def flying(*task):
        flown.append(task)
        return fly_apart(*task)

    monkeypatch.setattr(layered, "fly_apart", flying)
    cube = 1.05 * CUBE + [0.0, 0.0, 30.0]
    low, high = WIDE.velocity_min[:2], WIDE.velocity_max[:2]
    slow = replace(WIDE, velocity_min=(*low, -0.2), velocity_max=(*high, 0.2))
    found = search(make_leg(cube, cube @ np.diag([-1.0, -1.0, 1.0]), limits=slow))
    tried = 5.0 * found.limiting(solve=True).time
    assert found.surely(tried) is None
    assert not flown
    best, _ = found.least()
    assert best.layers
    assert best.duration > tried
    assert found.surely(tried) is best


def test_a_flight_in_closed_form_is_proved_like_any_other(monkeypatch):
    monkeypatch.setattr(Repair, "run", lambda _: False)
    middle = np.array([0.0, 0.0, 30.0])
    found, _ = fly(1.05 * CUBE + middle, 1.05 * CUBE @ QUARTER.T + middle)
    assert "quarter circle" in found.certificate.method


def test_where_the_script_gives_more_time_than_the_search_needs_drones_wait(
    monkeypatch,
):
    monkeypatch.setattr(Repair, "run", lambda _: False)
    show, goal = make_show(len(CUBE)), 1.05 * CUBE @ QUARTER.T
    leg = make_leg(1.05 * CUBE, goal, limits=WIDE, duration=20.0)
    found = solve_leg(leg, show, make_options(), InProcess(), Listening())
    assert found.duration == 20.0
    assert not flaw(found, show)
    assert "wait for" in found.certificate.method


def test_flights_in_closed_form_wait_for_a_try_with_time_enough(monkeypatch):
    """Little is expected of the tries of great crowds that are near the least time."""
    monkeypatch.setattr(module, "_GREAT", len(CUBE))
    monkeypatch.setattr(Repair, "run", lambda _: False)
    at, surely, events = Search.at, Search.surely, []

    def trying(self, time, *task, most=np.inf):
        events.append("try" if most == np.inf else "hasty try")
        return at(self, time, *task, most=most)

    def looking(self, most):
        events.append("closed form")
        return surely(self, most)

    monkeypatch.setattr(Search, "at", trying)
    monkeypatch.setattr(Search, "surely", looking)
    middle = np.array([0.0, 0.0, 30.0])
    start, goal = (1.05 * CUBE @ turn.T + middle for turn in (np.eye(3), QUARTER))
    found, _ = search(make_leg(start, goal, limits=WIDE)).least()
    assert "quarter circle" in found.method
    looked = events.index("closed form")
    assert "hasty try" in events[: looked - 1]
    assert events[:looked].index("try") == looked - 1
