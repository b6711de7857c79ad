"""The fence: distances, ways round corners, corridors; and what check says of it."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.script import read_show
from showc.script.fence import LEAST, Fence, crossed_edges

L = np.array([(-30, -30), (30, -30), (30, 0), (0, 0), (0, 30), (-30, 30)], float)
U = np.array(
    [(-30, -30), (30, -30), (30, 30), (8, 30), (8, -8), (-8, -8), (-8, 30), (-30, 30)],
    float,
)
SHAPES = {"L": L, "L clockwise": L[::-1], "U": U, "U clockwise": U[::-1]}


def along(way, steps=400):
    share = np.linspace(0.0, len(way) - 1.0, steps * (len(way) - 1) + 1)
    return np.column_stack(
        [np.interp(share, np.arange(len(way)), way[:, axis]) for axis in (0, 1)]
    )


@pytest.mark.parametrize("corners", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("margin", [0.0, 1.0, 4.0])
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_ways_keep_the_margin_and_are_straight_only_where_that_keeps_it(
    corners, margin, seed
):
    fence = Fence(corners, margin)
    points = np.random.default_rng(seed).uniform(-30.0, 30.0, (40, 2))
    points = points[fence.clearance(points) > margin + 0.05]
    for start, goal in pairwise(points):
        way = fence.way(start, goal)
        assert way is not None
        assert np.array_equal(way[[0, -1]], [start, goal])
        assert fence.clearance(along(way)).min() >= margin - 1e-6
        direct = fence.clearance(along(np.stack([start, goal]))).min()
        assert (len(way) == 2) == (direct >= margin - 1e-9) or abs(
            direct - margin
        ) < 0.1


def test_a_fence_without_a_margin_is_left_and_not_neared():
    assert Fence(L, 3.0).breach == "comes nearer than 3.00 m to the fence"
    assert Fence(L, LEAST).breach == "leaves the fence"


def test_no_way_leads_through_a_passage_narrower_than_twice_the_margin():
    corners = np.array(
        [(0, 0), (9, 0), (9, 4), (11, 4), (11, 0), (20, 0), (20, 9), (11, 9)]
        + [(11, 5), (9, 5), (9, 9), (0, 9)],
        float,
    )
    start, goal = np.array([4.0, 4.5]), np.array([16.0, 4.5])
    assert Fence(corners, 0.4).way(start, goal) is not None
    assert Fence(corners, 0.6).way(start, goal) is None


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), margin=st.sampled_from([0.0, 1.5]))
def test_a_breach_is_found_where_a_curve_comes_too_near_and_nowhere_else(seed, margin):
    rng = np.random.default_rng(seed)
    fence = Fence(L, margin)
    curve = rng.uniform(-28.0, 10.0, (1, 4, 2))
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    basis = np.hstack(
        [
            (1 - share) ** 3,
            3 * share * (1 - share) ** 2,
            3 * share**2 * (1 - share),
            share**3,
        ]
    )
    least = fence.clearance(basis @ curve[0]).min()
    found = fence.first_breach(curve, np.array([0.0, 2.0]))
    if abs(least - margin) > 0.02:
        assert (found is not None) == (least < margin)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_corridor_holds_its_way_and_nothing_nearer_to_the_fence_than_asked(seed):
    rng = np.random.default_rng(seed)
    fence = Fence(U, 1.0)
    start = rng.uniform(-28.0, 28.0, 2)
    end = start + rng.uniform(-2.0, 2.0, 2)
    piece = along(np.stack([start, end]))
    if fence.clearance(piece).min() < 1.0:
        return
    planes = fence.corridor(start, end, 6.0, 1.0)
    near = start + rng.uniform(-4.0, 4.0, (2000, 2))
    inside = np.ones(len(near), dtype=bool)
    for plane in planes:
        normal = np.array(plane.normal)
        assert (piece @ normal).min() >= plane.offset - 1e-6
        inside &= near @ normal >= plane.offset
    near = near[inside & (np.linalg.norm(near - start, axis=1) < 3.0)]
    assert fence.clearance(near).min(initial=1.0) >= 1.0 - 1e-6


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_corridor_ends_and_leads_a_way_outside_the_fence_back(seed):
    rng = np.random.default_rng(seed)
    fence = Fence(list(SHAPES.values())[seed % 4], 1.0)
    start = rng.uniform(-31.0, 31.0, 2)
    end = start + rng.uniform(-4.0, 4.0, 2)
    planes = fence.corridor(start, end, 6.0, 1.0)
    assert len(planes) <= len(fence.corners)
    piece = along(np.stack([start, end]))
    clearance = fence.clearance(piece)
    if -5.0 < clearance.max() < -0.1:
        nearest = piece[clearance.argmax()]
        back = nearest + 0.1 * np.array(planes[0].normal)
        assert fence.clearance(back[None]) > clearance.max() + 0.09


@pytest.mark.parametrize("corners", SHAPES.values(), ids=SHAPES)
def test_a_corridor_holds_a_way_across_an_edge_on_the_inner_side(corners):
    start, end = np.array([-27.0, 0.0]), np.array([-30.4, 0.0])
    outer = Fence(corners, 1.0).corridor(start, end, 2.0, 1.0)
    assert [(plane.normal, plane.offset) for plane in outer] == [((1.0, 0.0), -29.0)]


@pytest.mark.parametrize("corners", SHAPES.values(), ids=SHAPES)
def test_whole_outlines_cross_themselves_nowhere(corners):
    assert crossed_edges(corners) is None


def test_outlines_that_cross_themselves_are_named():
    bow = np.array([(0.0, 0.0), (4.0, 2.0), (4.0, 0.0), (0.0, 2.0)])
    assert crossed_edges(bow) == (0, 2)
    angle = np.arange(5) * 4.0 * np.pi / 5.0
    assert crossed_edges(np.column_stack([np.cos(angle), np.sin(angle)])) == (0, 2)


@pytest.mark.parametrize("place", [(5, 0), (-5, 0), (0, 5), (0, -5), (5, 5), (-5, -5)])
def test_a_place_on_a_fence_without_a_margin_is_refused(place):
    script = """\
showc: 1
drones: 1
site: {fence: [[-5, -5], [5, -5], [5, 5], [-5, 5]]}
pads: {type: points, points: [[%g, %g, 0]]}
formations: {a: {type: points, points: [[4.99, 0, 12]]}}
transitions: [a]
"""
    (found,) = (
        one
        for one in read_show((script % place).encode()).diagnostics
        if one.code == "SHW204"
    )
    assert "place 1 of `pads` is on the fence" in found.message
    inward = tuple(0.999 * part for part in place)
    codes = {one.code for one in read_show((script % inward).encode()).diagnostics}
    assert "SHW204" not in codes
