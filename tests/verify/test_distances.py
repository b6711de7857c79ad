"""Straight parts and the pairs of them that are near, against looking at them all."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.log import showc_pb2 as pb
from showc.verify.kernel.slices import measures
from showc.verify.missions.law import Profiles
from showc.verify.missions.legs import FleetLegs
from showc.verify.missions.separation import (
    _near,
    nearest_untimed,
    part_distance,
)

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


def standing(places):
    """Fleet whose drones rise and sink by nothing where they stand."""
    legs = np.repeat(places, 3, axis=0)
    none = np.zeros(len(legs))
    flights = Profiles(*[none] * len(Profiles.__dataclass_fields__))
    first, alone = np.arange(0, len(legs) + 1, 3), np.empty((0, 2))
    never = np.full(len(legs), np.nan)
    return FleetLegs(
        first, legs, legs, never, flights, none, alone, none[: len(places)]
    )


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(SHAPES),
    st.integers(1, 200),
    st.sampled_from([0.5, 20.0]),
    st.booleans(),
)
@settings(deadline=None, max_examples=30)
def test_the_nearest_places_are_those_of_all_pairs(seed, shape, count, spread, landing):
    generator = np.random.default_rng(seed)
    places = generator.normal(scale=(spread, 2.0 * spread, 4.0), size=(count, 3))
    found = nearest_untimed(standing(places), rules(shape), landing=landing)
    pairs = [
        (distance(places[a] - places[b], shape), a, b)
        for a, b in combinations(range(count), 2)
    ]
    if not pairs:
        assert found.upper == np.inf
        return
    least, a, b = min(pairs)
    assert found.upper == pytest.approx(least, abs=1e-12)
    assert found.pair == (a, b)


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
    a, b = np.array(list(combinations(range(count), 2))).T
    for measure in measures(rules(shape)):
        begin, end = measure.space(one), measure.space(other)
        found = [tuple(pair) for pair in _near(begin, end, measure, limit)[0].tolist()]
        assert len(set(found)) == len(found)
        assert all(first < second for first, second in found)
        gap = part_distance((begin[a], end[a]), (begin[b], end[b]), measure)
        near = gap < limit
        assert set(zip(a[near].tolist(), b[near].tolist(), strict=True)) == set(found)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=30)
def test_parts_are_as_far_apart_as_their_nearest_points(seed):
    generator = np.random.default_rng(seed)
    a, b, c, d = np.round(generator.normal(scale=3.0, size=(4, 40, 3)))
    (measure,) = measures(rules(pb.Separation.SPHERE))
    least = part_distance((a, b), (c, d), measure)
    share = np.linspace(0.0, 1.0, 41)[:, None, None]
    first, second = a + share * (b - a), c + share * (d - c)
    gaps = np.linalg.norm(first[:, None] - second[None], axis=-1)
    reached = gaps.min(axis=(0, 1))
    length = np.linalg.norm(b - a, axis=1) + np.linalg.norm(d - c, axis=1)
    assert np.all(least <= reached + 1e-9)
    assert np.all(reached <= least + length / 80.0 + 1e-9)
