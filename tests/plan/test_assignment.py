"""Places go out with the least cost, and the proof about straight lines holds."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from showc.plan import assignment
from showc.plan.assignment import assign, in_order, line_separation
from showc.vehicle import Separation
from showc.vehicle.metric import measure

SPHERE = Separation(1.0)
DOWNWASH = Separation(1.0, "ellipsoid", 3.0)


def spaced(rng, count, separation, spacing):
    """Random points with at least ``spacing`` in the metric."""
    points = []
    while len(points) < count:
        candidate = rng.uniform(-6.0, 6.0, 3)
        if all(measure(candidate - other, separation) >= spacing for other in points):
            points.append(candidate)
    return np.array(points)


@given(st.integers(0, 2**32 - 1), st.sampled_from([SPHERE, DOWNWASH]))
@settings(deadline=None, max_examples=40)
def test_squared_distance_never_conflicts_when_spacing_is_root_two(seed, separation):
    rng = np.random.default_rng(seed)
    start = spaced(rng, 8, separation, np.sqrt(2.0))
    goal = spaced(rng, 8, separation, np.sqrt(2.0))
    given_out = assign(start, goal, separation)
    assert given_out.line_separation >= 1.0 - 1e-9
    sampled = min(
        float(measure(position[i] - position[j], separation))
        for s in np.linspace(0.0, 1.0, 101)
        for position in [start + s * (goal[given_out.places] - start)]
        for i in range(8)
        for j in range(i)
    )
    assert given_out.line_separation <= sampled + 1e-12


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=25)
def test_no_permutation_is_better(seed):
    rng = np.random.default_rng(seed)
    start, goal = spaced(rng, 5, SPHERE, 1.5), spaced(rng, 5, SPHERE, 1.5)
    given_out = assign(start, goal, SPHERE)
    assert sorted(given_out.places) == list(range(5))

    def cost(places):
        return float(((goal[list(places)] - start) ** 2).sum())

    def longest(places):
        return float(np.linalg.norm(goal[list(places)] - start, axis=1).max())

    best = min(permutations(range(5)), key=cost)
    if cost(given_out.places) > cost(best) + 1e-9:
        # only for a shorter longest move
        assert longest(given_out.places) < longest(best)


def test_required_places_are_all_taken():
    start = np.array([[float(i), 0.0, 0.0] for i in range(5)]) * 2.0
    picture = np.array([[100.0, 0.0, 0.0], [100.0, 2.0, 0.0], [100.0, 4.0, 0.0]])
    parking = start + [0.0, 1.0, 0.0]
    given_out = assign(start, np.concatenate([picture, parking]), SPHERE, required=3)
    assert set(range(3)) <= set(given_out.places.tolist())
    assert len(set(given_out.places.tolist())) == 5


@pytest.mark.parametrize(
    ("shape", "expected"),
    [("sphere", 0.5), ("any-axis", 0.5), ("all-axes", 0.0)],
)
def test_line_separation_of_two_that_pass(shape, expected):
    start = np.array([[0.0, 0.0, 0.0], [4.0, 0.5, 0.0]])
    goal = np.array([[4.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
    assert line_separation(start, goal, Separation(1.0, shape)) == pytest.approx(
        expected
    )


@given(st.integers(0, 2**32 - 1), st.sampled_from(["any-axis", "all-axes"]))
@settings(deadline=None)
def test_axis_forms_are_measured_exactly(seed, shape):
    rng = np.random.default_rng(seed)
    start, goal = rng.normal(size=(4, 3)) * 3.0, rng.normal(size=(4, 3)) * 3.0
    separation = Separation(1.0, shape)
    least = line_separation(start, goal, separation)
    s = np.linspace(0.0, 1.0, 2001)[:, None, None]
    path = start + s * (goal - start)
    i, j = np.triu_indices(4, 1)
    sampled = float(measure(path[:, i] - path[:, j], separation).min())
    assert least <= sampled + 1e-12
    assert least >= sampled - 0.02


def test_fixed_assignment_keeps_the_order():
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    given_out = in_order(points, points[::-1], SPHERE)
    assert given_out.places.tolist() == [0, 1]
    assert given_out.line_separation == pytest.approx(0.0)


@pytest.mark.parametrize("seed", [1, 2])
def test_prices_of_a_sample_change_no_optimum(seed):
    # Enough drones that a sample of them sets the prices first.
    rng = np.random.default_rng(seed)
    start = rng.uniform(-40.0, 40.0, (620, 3))
    goal = rng.uniform(-40.0, 40.0, (620, 3)) * [1.0, 0.2, 1.0] + [90.0, 0.0, 20.0]
    cost = ((start[:, None] - goal[None]) ** 2).sum(axis=2)
    rows, columns = linear_sum_assignment(cost)
    places = assignment._least_sum(cost)
    assert sorted(places) == list(range(620))
    found = cost[np.arange(620), places].sum()
    assert found == pytest.approx(cost[rows, columns].sum(), rel=1e-12)


def test_a_shorter_longest_move_is_found_and_never_missed():
    rng = np.random.default_rng(5)
    for _ in range(20):
        length = rng.uniform(0.0, 10.0, (6, 6))
        least = min(
            max(length[i, j] for i, j in enumerate(order))
            for order in permutations(range(6))
        )
        found = assignment._bottleneck(length, 1.05 * least)
        assert least <= found <= least * (1.0 + assignment.BOTTLENECK_RESOLUTION)
        assert assignment._bottleneck(length, 0.999 * least) is None
