"""Crowds: a flight for every feasible move, near the least time, in bounded work."""

from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import Listening, make_leg, make_options, make_show
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from showc.fleet import search as module
from showc.fleet import solve_leg
from showc.fleet.deconfliction.conflicts import closest
from showc.fleet.deconfliction.repair import Repair
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.execution.pool import InProcess
from showc.fleet.leg import aircraft_of
from showc.fleet.proof import flaw
from showc.fleet.search import Room, Search
from showc.vehicle import PRESETS

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
    assert down <= any("over the least; trying" in note for note in heard.notes)


def search(leg, options=None):
    show = make_show(leg.drones.size)
    return Search(
        leg,
        "here",
        aircraft_of(show, leg),
        Room(show.separation, None),
        options or make_options(),
        InProcess(),
        Listening(),
    )


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
