"""Crowds: a flight for every feasible move, near the least time, in bounded work."""

from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import Listening, make_leg, make_options, make_show

from showc.fleet import leg as module
from showc.fleet import solve_leg
from showc.fleet.deconfliction.conflicts import closest
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.execution.pool import InProcess
from showc.fleet.proof import flaw
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
    size, turn, gap, down, monkeypatch
):
    monkeypatch.setattr(module, "_TRIES", 5)
    middle = np.array([0.0, 0.0, 30.0])
    found, heard = fly(size * CUBE + middle, size * CUBE @ turn.T + middle)
    assert found.certificate.statistics["common_times_tried"] <= 5
    assert found.certificate.gap < gap
    assert down <= any("over the least; trying" in note for note in heard.notes)


@pytest.mark.parametrize("effort", [1, 3])
def test_more_effort_allows_more_tries(effort):
    solver = module._Solver(
        make_leg(CUBE, CUBE + 5.0),
        make_show(len(CUBE)),
        make_options(effort=effort),
        InProcess(),
        Listening(),
    )
    solver.tried.add("common_times_tried", 2 * module._TRIES)
    assert solver._may_try() is (effort == 3)
