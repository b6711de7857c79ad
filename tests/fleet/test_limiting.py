"""The slowest drones: the greatest bound of a fleet is never missed."""

import numpy as np
import pytest
from fleet.handmade import LIMITS, VEHICLE
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from showc.fleet.execution.pool import InProcess
from showc.fleet.lower_bound.bound import lower_bound, surplus
from showc.fleet.lower_bound.extremes import extreme_moves
from showc.fleet.lower_bound.limiting import limiting_time
from showc.fleet.lower_bound.relaxation import Relaxation
from showc.fleet.single_drone.model import Aircraft
from showc.progress import Silent


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rank=st.integers(1, 3))
def test_no_direction_has_a_longer_move_than_the_corners(seed, rank):
    rng = np.random.default_rng(seed)
    moves = rng.normal(size=(int(rng.integers(1, 40)), rank)) @ rng.normal(
        size=(rank, 3)
    )
    corners = extreme_moves(moves, np.arange(len(moves)))
    for beta in rng.normal(size=(50, 3)):
        greatest = max(float((moves @ beta).max()), 0.0)
        found = max(float((moves[corners] @ beta).max()), 0.0)
        assert found == pytest.approx(greatest, rel=1e-9, abs=1e-9)


def test_the_corners_of_many_moves_are_those_of_their_hull():
    moves = np.random.default_rng(5).normal(size=(300, 3)) * [8.0, 8.0, 2.0]
    hull = ConvexHull(np.vstack([moves, np.zeros(3)])).vertices
    wanted = np.arange(0, 300, 2)
    found = extreme_moves(moves, wanted)
    assert set(found) <= set(hull)
    assert set(hull) & set(wanted) <= set(found)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_proved_of_a_mixture_is_proved_of_one_of_its_parts(seed):
    rng = np.random.default_rng(seed)
    parts = rng.uniform(-30.0, 30.0, (4, 3))
    mixture = rng.dirichlet(np.ones(4)) @ parts
    relaxation = Relaxation(VEHICLE, LIMITS)
    witness = lower_bound(relaxation, 0, mixture, 5.0)
    proof = (
        witness.time,
        np.array(witness.beta),
        np.array(witness.knots),
        np.array(witness.multipliers),
    )
    own = surplus(relaxation, mixture, *proof)
    assert max(surplus(relaxation, part, *proof) for part in parts) >= own - 1e-9


@pytest.mark.slow
def test_the_greatest_bound_is_that_of_all_moves():
    # Short ways up are slow; a first look by length and by axes would pass them over.
    rng = np.random.default_rng(3)
    moves = rng.uniform(-12.0, 12.0, (24, 3))
    moves[:, 2] *= 0.4
    aircraft = Aircraft(VEHICLE, LIMITS, "held", 0.0)
    start = np.zeros_like(moves)
    found = limiting_time(aircraft, start, moves, InProcess(), Silent())
    relaxation = Relaxation(VEHICLE, LIMITS)
    every = [
        lower_bound(relaxation, row, move, 4.0).time for row, move in enumerate(moves)
    ]
    assert found.witness.time >= max(every) * (1.0 - 1e-3)
    assert found.bounds < len(moves)


@pytest.mark.parametrize("way", [1.1e-7, 1e-6, 1e-4])
def test_the_bound_of_a_move_by_almost_nothing_is_no_more_than_its_time(way):
    start = np.array([[0.0, 0.0, 10.0], [4.0, 0.0, 10.0]])
    goal = start + [[0.0, 0.0, 1e-9], [way, 0.0, 0.0]]
    aircraft = Aircraft(VEHICLE, LIMITS, "held", 0.0)
    found = limiting_time(aircraft, start, goal, InProcess(), Silent())
    assert found.drone == 1
    assert 0.0 <= found.witness.time <= found.time
