"""Straight parts and the pairs of them that are near, against looking at them all."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.log import showc_pb2 as pb
from showc.verify.missions.distances import near_pairs, nearest_places, part_distance

SHAPES = pb.Separation.Shape.values()


def rules(shape):
    return pb.Separation(distance=1.0, shape=shape, vertical_stretch=2.5)


def distance(difference, shape):
    x, y, z = np.abs(difference)
    if shape == pb.Separation.ANY_AXIS:
        return max(x, y, z)
    if shape == pb.Separation.ALL_AXES:
        return min(x, y, z)
    stretch = 2.5 if shape == pb.Separation.ELLIPSOID else 1.0
    return float(np.sqrt(x * x + y * y + (z / stretch) ** 2))


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(SHAPES),
    st.integers(2, 300),
    st.sampled_from([0.5, 20.0]),
)
@settings(deadline=None, max_examples=30)
def test_the_nearest_places_are_those_of_all_pairs(seed, shape, count, spread):
    generator = np.random.default_rng(seed)
    # Whole numbers, so that several pairs are equally near.
    places = np.round(
        generator.normal(scale=(spread, 2.0 * spread, 4.0), size=(count, 3))
    )
    moving = generator.random(count) < 0.3
    pairs = [
        (distance(places[a] - places[b], shape), a, b)
        for a, b in combinations(range(count), 2)
        if moving[a] or moving[b]
    ]
    found = nearest_places(places, rules(shape), moving)
    if not pairs:
        assert found is None
        return
    least, a, b = min(pairs)
    assert found is not None
    assert found[2] == pytest.approx(least, abs=1e-12)
    if least > 0.0:
        again = nearest_places(places, rules(shape), moving, found[2] * 1.001)
        assert again == found
        assert nearest_places(places, rules(shape), moving, found[2]) is None
    if shape != pb.Separation.ELLIPSOID:  # its distances are not rounded alike
        assert found[:2] == (a, b)


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(SHAPES),
    st.integers(2, 200),
    st.sampled_from([0.0, 1.0, 6.0, 1e4]),
)
@settings(deadline=None, max_examples=30)
def test_no_pair_of_parts_that_is_near_is_left_out(seed, shape, count, limit):
    generator = np.random.default_rng(seed)
    one = np.round(generator.normal(scale=15.0, size=(count, 3)))
    other = one + np.round(generator.normal(scale=3.0, size=(count, 3)))
    moving = generator.random(count) < 0.5
    found = [
        pair
        for a, b in near_pairs(one, other, rules(shape), limit, moving)
        for pair in zip(a.tolist(), b.tolist(), strict=True)
    ]
    assert len(set(found)) == len(found)
    assert all(a < b and (moving[a] or moving[b]) for a, b in found)
    a, b = np.array(list(combinations(range(count), 2))).T
    wanted = (moving[a] | moving[b]) & (
        part_distance((one[a].T, other[a].T), (one[b].T, other[b].T), rules(shape))
        <= limit
    )
    near = set(zip(a[wanted].tolist(), b[wanted].tolist(), strict=True))
    assert near <= set(found)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=30)
def test_parts_are_as_far_apart_as_their_nearest_points(seed):
    generator = np.random.default_rng(seed)
    a, b, c, d = np.round(generator.normal(scale=3.0, size=(4, 40, 3)))
    least = part_distance((a.T, b.T), (c.T, d.T), rules(pb.Separation.SPHERE))
    share = np.linspace(0.0, 1.0, 41)[:, None, None]
    first, second = a + share * (b - a), c + share * (d - c)
    gaps = np.linalg.norm(first[:, None] - second[None], axis=-1)
    reached = gaps.min(axis=(0, 1))
    length = np.linalg.norm(b - a, axis=1) + np.linalg.norm(d - c, axis=1)
    assert np.all(least <= reached + 1e-9)
    assert np.all(reached <= least + length / 80.0 + 1e-9)
