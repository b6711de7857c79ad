"""Slices of time: flights stay near their chords, and no near pair is left out."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.verify.kernel.bernstein import basis
from showc.verify.kernel.slices import Measure, Tracks, edges, near_pairs, take

MEASURES = [
    Measure((0, 1, 2), (1.0, 1.0, 1.0), largest=False),
    Measure((0, 1, 2), (1.0, 1.0, 1.0), largest=True),
]


def random_tracks(random, drones, most_rows):
    """Continuous flights of 6 s, each on a mesh of its own."""
    counts = random.integers(1, most_rows + 1, size=drones)
    starts, ends, positions = [], [], []
    for count in counts:
        breaks = np.concatenate(
            [[2.0], np.sort(random.uniform(2.1, 7.9, count - 1)), [8.0]]
        )
        corners = np.cumsum(random.normal(size=(count + 1, 3)), axis=0)
        inner = corners[:-1, None] + random.normal(size=(count, 4, 3))
        starts.append(breaks[:-1])
        ends.append(breaks[1:])
        positions.append(
            np.concatenate([corners[:-1, None], inner, corners[1:, None]], axis=1)
        )
    return Tracks(
        2.0,
        8.0,
        np.concatenate([[0], np.cumsum(counts)]),
        np.concatenate(starts),
        np.concatenate(ends),
        np.concatenate(positions),
    )


def places(tracks, times):
    """Positions (drones, times, 3), looked up one by one."""
    found = np.empty((tracks.drones, times.size, 3))
    for drone in range(tracks.drones):
        rows = np.arange(tracks.first[drone], tracks.first[drone + 1])
        chosen = rows[np.searchsorted(tracks.starts[rows], times, side="right") - 1]
        share = (times - tracks.starts[chosen]) / (tracks.ends - tracks.starts)[chosen]
        weights = basis(tracks.position.shape[1] - 1, share)
        found[drone] = np.einsum("nj,njk->nk", weights, tracks.position[chosen])
    return found


@settings(deadline=None, max_examples=60, derandomize=True)
@given(
    st.integers(0, 10_000),
    st.integers(1, 6),
    st.floats(2.0, 7.9),
    st.floats(0.01, 6.0),
    st.sampled_from(MEASURES),
)
def test_flights_fly_near_their_chords(seed, most_rows, low, width, measure):
    tracks = random_tracks(np.random.default_rng(seed), 5, most_rows)
    high = min(low + width, 8.0)
    piece = take(tracks, low, high, measure)
    share = np.linspace(0.0, 1.0, 200)
    flown = places(tracks, np.minimum(low + share * (high - low), 8.0))
    chord = (1 - share[:, None]) * piece.begin[:, None]
    chord = chord + share[:, None] * piece.end[:, None]
    off = measure(flown - chord).max(axis=1)
    assert np.all(off <= piece.away + 1e-9)
    far = measure(flown - 0.5 * (piece.begin + piece.end)[:, None]).max(axis=1)
    assert np.all(far <= piece.radius + 1e-9)
    assert measure(flown[:, 0] - piece.begin).max() < 1e-9
    assert measure(flown[:, -1] - piece.end).max() < 1e-9


@settings(deadline=None, max_examples=60, derandomize=True)
@given(
    st.integers(0, 10_000),
    st.integers(1, 5),
    st.floats(0.05, 3.0),
    st.floats(0.1, 5.0),
    st.sampled_from(MEASURES),
)
def test_no_near_pair_is_left_out(seed, most_rows, distance, width, measure):
    tracks = random_tracks(np.random.default_rng(seed), 9, most_rows)
    piece = take(tracks, 2.5, 2.5 + width, measure)
    flown = places(tracks, np.linspace(2.5, 2.5 + width, 300))
    found = {tuple(pair) for pair in piece.near(measure, distance).tolist()}
    for first in range(9):
        for second in range(first + 1, 9):
            gap = measure(flown[first] - flown[second]).min()
            assert gap >= distance - 1e-9 or (first, second) in found


@settings(deadline=None, max_examples=80, derandomize=True)
@given(
    st.integers(0, 10_000), st.integers(0, 60), st.floats(1e-3, 30.0), st.integers(1, 3)
)
def test_the_lattice_leaves_no_near_pair_out(seed, count, reach, axes):
    points = np.random.default_rng(seed).normal(0.0, 4.0, (count, axes))
    found = [tuple(pair) for pair in near_pairs(points, reach).tolist()]
    assert len(set(found)) == len(found)
    assert all(first < second for first, second in found)
    for first in range(count):
        for second in range(first + 1, count):
            near = np.abs(points[first] - points[second]).max() <= reach
            assert not near or (first, second) in set(found)


@given(st.lists(st.floats(-3, 3), min_size=6, max_size=6), st.sampled_from(MEASURES))
def test_chords_come_no_nearer_than_said(numbers, measure):
    begin, end = np.array(numbers).reshape(2, 1, 3)
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    least = measure((1 - share) * begin + share * end).min()
    said = float(measure.of_chords(begin, end)[0])
    assert said <= least + 1e-12
    if not measure.largest:
        assert said == pytest.approx(least, abs=5e-3)


def test_slices_follow_each_other_and_cover_the_stretch():
    tracks = random_tracks(np.random.default_rng(3), 4, 5)
    cuts = list(edges(tracks.begin, tracks.end, tracks.speed, 0.5))
    assert all(
        take(tracks, *cut, MEASURES[0]).radius.max() <= 0.5 * 1.001 for cut in cuts
    )
    assert cuts[0][0] == tracks.begin
    assert cuts[-1][1] == tracks.end
    assert all(one[1] == other[0] for one, other in pairwise(cuts))


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.integers(0, 10_000), st.integers(1, 6), st.floats(2.0, 7.0))
def test_even_flight_is_its_chord(seed, most_rows, low):
    """However many polynomials it is cut into."""
    random = np.random.default_rng(seed)
    tracks = random_tracks(random, 4, most_rows)
    speed = random.normal(size=(4, 3))[np.repeat(np.arange(4), np.diff(tracks.first))]
    steps = np.linspace(0.0, 1.0, 6)
    times = tracks.starts[:, None] + steps * (tracks.ends - tracks.starts)[:, None]
    even = replace(tracks, position=times[:, :, None] * speed[:, None])
    piece = take(even, low, 7.5, MEASURES[0])
    assert piece.away.max() < 1e-12
    way = MEASURES[0](piece.end - piece.begin)
    np.testing.assert_allclose(piece.radius, 0.5 * way, atol=1e-12)


def test_a_distance_of_nothing_does_not_cut_for_ever():
    assert len(list(edges(0.0, 10.0, 1.0, 1e-9))) <= 1_000
