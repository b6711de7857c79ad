"""The fence in flight, against dense sampling of another geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from verified import with_table

from showc.log import showc_pb2 as pb
from showc.verify.kernel.bernstein import basis
from showc.verify.kernel.dynamics import radius
from showc.verify.kernel.fence import RESOLUTION, _inside, enclosed
from showc.verify.kernel.limits import extremes, kept

ELL = np.array(
    [[-9.0, -9.0], [9.0, -9.0], [9.0, 0.0], [0.0, 0.0], [0.0, 9.0], [-9.0, 9.0]]
)
"""Concave: the quarter x > 0, y > 0 is missing."""


def inside_ell(points):
    within = np.all(np.abs(points) <= 9.0, axis=-1)
    return within & ~np.all(points > 0.0, axis=-1)


def to_ell(points):
    """Distances from the outline, edge by edge."""
    found = []
    for a, b in zip(ELL, np.roll(ELL, -1, axis=0), strict=True):
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        found.append(np.linalg.norm(points - a - share[:, None] * (b - a), axis=-1))
    return np.min(found, axis=0)


@given(st.lists(st.floats(-12, 12), min_size=2, max_size=2))
def test_inside_is_inside(point):
    points = np.array([point])
    if to_ell(points)[0] > 1e-2:
        assert _inside(points, ELL) == inside_ell(points)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.integers(0, 10_000), st.integers(1, 7))
def test_the_least_distance_is_enclosed(seed, degree):
    rng = np.random.default_rng(seed)
    corner = rng.uniform([-9.0, -9.0], [0.0, 9.0])
    path = corner + rng.normal(0.0, 3.0, (1, degree + 1, 2))
    flown = (basis(degree, np.linspace(0.0, 1.0, 800)) @ path)[0]
    lower, row = enclosed(path, ELL)
    assert row == 0
    if inside_ell(flown).all():
        least = to_ell(flown).min()
        assert lower <= least + 1e-9
        assert lower >= least - 0.1
    else:
        # Outside somewhere: no positive distance is claimed.
        assert lower <= RESOLUTION


@pytest.mark.parametrize("height", [-0.5, -1e-3])
def test_flight_along_a_wall_is_settled_exactly(height):
    path = np.array(
        [[[-8.0, -8.0], [-2.0, height - 2.0], [0.5, height], [8.0, height]]]
    )
    straight = np.array([[[-8.0, height], [8.0, height]]])
    lower, _ = enclosed(straight, ELL)
    assert lower == pytest.approx(-height, abs=2 * RESOLUTION)
    lower, _ = enclosed(path, ELL)
    assert lower <= -height


def nearest(segment, rules, fence, margin=0.0):
    """The distance to a fence among the extremes of a segment; None without one."""
    asked = pb.Rules()
    asked.CopyFrom(rules)
    del asked.site.fence[:]
    asked.site.fence.extend(np.ravel(fence).tolist())
    asked.site.fence_margin = margin
    found = [one for one in extremes(segment, asked) if one.bound.family == "fence"]
    return (asked, found[0]) if found else None


def test_a_flight_over_the_missing_quarter_is_found(log_and_show):
    """Ends lie inside, the way between does not."""
    _, show = log_and_show
    state = show.segments[0].table.state.copy()
    state[0, :, :2] = np.linspace([0.0, 8.0], [8.0, 0.0], state.shape[1])
    spoilt = with_table(show, 0, state=state)
    assert nearest(show.segments[0], show.rules, ELL + 2.0)[1].upper < 0.0
    found = nearest(spoilt.segments[0], show.rules, ELL + 2.0)[1]
    assert found.upper >= 0.0
    assert found.drone == 0


@pytest.mark.parametrize(("margin", "holds"), [(1.0, True), (7.6, False)])
def test_the_margin_is_held_in_flight(log_and_show, margin, holds):
    _, show = log_and_show
    square = [-9.0, -9.0, 9.0, -9.0, 9.0, 9.0, -9.0, 9.0]
    found = [nearest(one, show.rules, square, margin) for one in show.segments]
    asked = type(show)(found[0][0], show.segments, show.epoch)
    radii = [radius(one, show.rules.vehicle) for one in show.segments]
    statement = kept(asked, radii, [[one] for _, one in found])[-1]
    assert statement.code == "VRF319"
    assert statement.holds is holds
    # Four drones on a square of 3 m.
    assert statement.value == pytest.approx(7.5, abs=1e-5)


def test_without_a_fence_there_is_nothing_to_prove(log_and_show):
    _, show = log_and_show
    assert nearest(show.segments[0], show.rules, []) is None
    nothing = [[] for _ in show.segments]
    assert kept(show, nothing, nothing)[-1].holds is None
