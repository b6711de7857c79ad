"""What two drones need to pass each other: never more than a flight that exists."""

from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import Listening, make_leg, make_options, make_show

from showc.fleet import solve_leg
from showc.fleet.execution.pool import InProcess
from showc.fleet.lower_bound import passing
from showc.fleet.lower_bound.passing import passing_bound
from showc.fleet.search import Room, Search
from showc.fleet.single_drone.model import Aircraft
from showc.script.lanes import whole_milliseconds
from showc.vehicle import PRESETS, Separation

LIMITS = replace(
    PRESETS["formation-625g"].limits,
    position_min=(-200.0, -200.0, -200.0),
    position_max=(200.0, 200.0, 200.0),
)


def searching(start, goal, separation):
    show = make_show(2, separation=separation)
    aircraft = Aircraft(show.vehicle, LIMITS, show.yaw)
    leg, room = make_leg(start, goal, limits=LIMITS), Room(separation, None)
    means = make_options(), InProcess(), Listening()
    return aircraft, Search(leg, "pair", aircraft, room, *means)


@pytest.mark.parametrize(
    ("seed", "separation"),
    [
        (0, Separation(1.0)),
        (1, Separation(1.0, "any-axis")),
        (2, Separation(1.0, "ellipsoid", 2.0)),
    ],
)
def test_no_pair_passes_sooner_than_its_bound(seed, separation):
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(2, 3))
    ways[1] += -2.0 * (ways[0] @ ways[1]) / (ways[0] @ ways[0]) * ways[0]
    ways *= 2.1 / np.linalg.norm(ways, axis=1, keepdims=True)
    middle = np.array([0.0, 0.0, 20.0])
    first, second = 0.5 * ways
    start = np.stack([middle + first, middle - first])
    goal = np.stack([middle + second, middle - second])
    if first @ second > 0.0:
        goal = goal[::-1]
    aircraft, search = searching(start, goal, separation)
    found = search.at(whole_milliseconds(1.1 * search.shared.duration))
    assert found.done
    bound = passing_bound(aircraft, separation, start, goal, 1.3 * found.duration)
    assert bound is not None
    assert 0.5 * found.duration < bound.time <= found.duration


def test_an_exchange_at_the_separation_needs_more_than_one_drone_alone():
    start = np.array([[-0.5, 0.0, 10.0], [0.5, 0.0, 10.0], [5.0, 0.0, 10.0]])
    goal = start[[1, 0, 2]]
    aircraft, search = searching(start, goal, Separation(1.0))
    alone = search.limiting(solve=False).time
    bound = passing_bound(aircraft, Separation(1.0), start, goal, 1.3 * alone)
    assert (bound.first, bound.second) == (0, 1)
    assert bound.time > 1.02 * alone


def test_drones_that_meet_nowhere_have_no_bound_of_pairs():
    start = np.array([[0.0, 0.0, 10.0], [3.0, 0.0, 10.0]])
    aircraft = Aircraft(make_show(2).vehicle, LIMITS)
    assert passing_bound(aircraft, Separation(1.0), start, start + 9.0, 9.0) is None


def test_where_the_script_gives_the_time_no_pair_is_bounded(monkeypatch):
    asked = []
    monkeypatch.setattr(passing, "passing_bound", lambda *given: asked.append(given))
    start = np.array([[-4.0, 0.0, 20.0], [4.0, 0.0, 20.0]])
    leg = make_leg(start, start[::-1], duration=9.0)
    found = solve_leg(leg, make_show(2), make_options(), InProcess(), Listening())
    assert found.duration == 9.0
    assert not asked
