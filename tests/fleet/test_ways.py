"""Ways round each other: crowds that straight lines would run into each other."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.fleet.deconfliction.crowd import Crossing
from showc.fleet.deconfliction.ways import bump_over, find_ways
from showc.fleet.shared_profile.profile import Profile
from showc.fleet.single_drone.single import Aircraft
from showc.vehicle import PRESETS, Separation
from showc.vehicle.metric import measure

PRESET = PRESETS["formation-625g"]
AIRCRAFT = Aircraft(PRESET.vehicle, PRESET.limits, "held", 0.0)
PROFILE = Profile(6.0, 3.0, 0.6)


def ways_of(start, goal, separation=None, parked=None, known=None):
    return find_ways(
        Crossing(
            AIRCRAFT,
            separation or Separation(1.0),
            start,
            goal,
            parked,
            PROFILE,
        ),
        known,
    )


def least(start, goal, ways, separation):
    """Least distance of any pair at 2,000 instants, and the positions there."""
    breaks, coefficients = ways.positions(start, goal, PROFILE)
    from showc.trajectory import PiecewisePolynomial

    times = np.linspace(0.0, PROFILE.duration, 2000)
    places = np.stack([PiecewisePolynomial(breaks, c)(times) for c in coefficients])
    a, b = np.triu_indices(start.shape[0], 1)
    gaps = measure(places[a] - places[b], separation)
    return float(gaps.min(initial=np.inf)), places


@pytest.mark.parametrize("rise", [0.5, 0.35, 0.2])
def test_a_bump_rises_from_rest_and_comes_back_to_rest(rise):
    bump = bump_over(4.0, rise)
    first, second = bump.derivative(), bump.derivative().derivative()
    ends = np.array([0.0, 4.0])
    for curve in (bump, first, second):
        assert np.abs(curve(ends)).max() < 1e-12
    assert bump(np.array([2.0]))[0, 0] == pytest.approx(1.0)
    inner = bump.breaks[1:-1]
    assert np.abs(second(inner - 1e-9) - second(inner + 1e-9)).max() < 1e-5


def test_two_drones_that_swap_places_pass_each_other_on_the_right():
    start = np.array([[-5.0, 0.0, 20.0], [5.0, 0.0, 20.0]])
    ways = ways_of(start, start[::-1])
    assert ways.broken == 0
    assert ways.aside[0, 1] < 0.0 < ways.aside[1, 1]


@pytest.mark.parametrize("shape", ["sphere", "ellipsoid", "any-axis"])
def test_a_dense_grid_that_turns_in_place_keeps_apart(shape):
    separation = Separation(1.0, shape, 1.5)
    x, y = np.meshgrid(np.arange(6) - 2.5, np.arange(6) - 2.5)
    start = np.column_stack([1.6 * x.ravel(), 1.6 * y.ravel(), np.full(36, 20.0)])
    goal = start[:, [1, 0, 2]] * [-1.0, 1.0, 1.0]
    ways = ways_of(start, goal, separation)
    assert ways.broken == 0
    nearest, places = least(start, goal, ways, separation)
    assert nearest >= 1.0
    assert np.array_equal(places[:, -1], goal)


def test_parked_drones_are_flown_around():
    start, goal = np.array([[-6.0, 0.0, 20.0]]), np.array([[6.0, 0.0, 20.0]])
    parked = np.array([[0.0, 0.0, 20.0]])
    ways = ways_of(start, goal, parked=parked)
    _, places = least(start, goal, ways, Separation(1.0))
    assert np.linalg.norm(places[0] - parked[0], axis=-1).min() >= 1.0


def test_where_all_axes_count_there_is_no_way_round():
    start = np.array([[-5.0, 0.0, 20.0], [5.0, 2.0, 22.0]])
    assert ways_of(start, start[::-1], Separation(1.0, "all-axes")) is None


def test_a_drone_that_hovers_in_the_way_moves_aside_where_others_cannot():
    low, top = (-8.0, -0.55, 19.9), (8.0, 0.55, 20.1)
    tube = replace(AIRCRAFT.limits, position_min=low, position_max=top)
    start = np.array([[-6.0, 0.0, 20.0], [0.0, 0.0, 20.0]])
    goal = np.array([[6.0, 0.0, 20.0], [0.0, 0.0, 20.0]])
    aircraft = replace(AIRCRAFT, limits=tube)
    ways = find_ways(Crossing(aircraft, Separation(1.0), start, goal, None, PROFILE))
    assert ways.broken == 0
    assert np.all(np.any(ways.aside != 0.0, axis=1))
    nearest, places = least(start, goal, ways, Separation(1.0))
    assert nearest >= 1.0
    assert np.array_equal(places[1, -1], goal[1])


@pytest.mark.parametrize("angle", [100.0, 180.0])
def test_a_cube_as_dense_as_may_be_turns_about_an_odd_axis(angle):
    steps = np.array(np.meshgrid(*[np.arange(3) - 1.0] * 3)).reshape(3, -1).T
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    a = np.radians(angle)
    turned = (
        np.cos(a) * steps
        + np.sin(a) * np.cross(axis, steps)
        + (1.0 - np.cos(a)) * np.outer(steps @ axis, axis)
    )
    middle = np.array([0.0, 0.0, 20.0])
    start, goal = 1.1 * steps + middle, 1.1 * turned + middle
    ways = ways_of(start, goal)
    assert ways.broken == 0
    assert least(start, goal, ways, Separation(1.0))[0] >= 1.0


def test_known_ways_are_kept_as_they_are():
    start = np.array([[-5.0, 0.0, 20.0], [5.0, 0.0, 20.0]])
    ways = ways_of(start, start[::-1])
    again = ways_of(start, start[::-1], known=ways)
    assert np.array_equal(again.aside, ways.aside)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 14))
def test_what_the_search_calls_apart_is_apart(seed, count):
    rng = np.random.default_rng(seed)
    places = np.argwhere(np.ones((5, 5, 3)))[rng.permutation(75)] * 1.5
    start, goal = places[:count] + [0.0, 0.0, 15.0], places[-count:] + [2.0, 1.0, 15.0]
    ways = ways_of(start, goal)
    nearest, found = least(start, goal, ways, Separation(1.0))
    assert np.array_equal(found[:, -1], goal)
    if ways.broken == 0:
        assert nearest >= 1.0
