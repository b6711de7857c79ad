"""Conflicts: continuous time against dense sampling, all four forms of separation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.fleet.deconfliction.conflicts import (
    RESOLUTION,
    closest,
    conflicts,
    standing,
)
from showc.fleet.deconfliction.tracks import tracks_of
from showc.flight import Trajectory
from showc.trajectory import PiecewisePolynomial
from showc.vehicle import Separation
from showc.vehicle.metric import measure

SHAPES = [
    Separation(1.0),
    Separation(1.0, "ellipsoid", 2.5),
    Separation(1.0, "any-axis"),
    Separation(1.0, "all-axes"),
]


def track(breaks, coefficients):
    coefficients = np.asarray(coefficients, dtype=float)
    state = np.zeros((*coefficients.shape[:2], 12))
    state[..., :3] = coefficients
    control = np.zeros((coefficients.shape[0], 1, 4))
    return Trajectory(
        PiecewisePolynomial(breaks, state), PiecewisePolynomial(breaks, control)
    )


def fleet(rng, drones, span):
    """Random continuous cubics, every drone with a mesh of its own."""
    flights = []
    for _ in range(drones):
        pieces = int(rng.integers(1, 6))
        breaks = np.linspace(0.0, 10.0, pieces + 1)
        breaks[1:-1] += rng.uniform(-0.4, 0.4, pieces - 1)
        coefficients = rng.uniform(-span, span, (pieces, 4, 3))
        coefficients[1:, 0] = coefficients[:-1, -1]
        flights.append(track(breaks, coefficients))
    return flights


def sampled(flights, separation, parked=None):
    times = np.linspace(0.0, 10.0, 4001)
    points = [flight.state.select(slice(0, 3))(times) for flight in flights]
    for place in () if parked is None else parked:
        points.append(np.broadcast_to(place, points[0].shape))
    least = {}
    for i in range(len(flights)):
        for j in range(i + 1, len(points)):
            least[i, j] = float(measure(points[i] - points[j], separation).min())
    return least


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.sampled_from(SHAPES),
    parked=st.integers(0, 2),
)
def test_every_pair_that_sampling_finds_is_found_and_none_invented(seed, shape, parked):
    rng = np.random.default_rng(seed)
    flights = fleet(rng, 6, 4.0)
    places = rng.uniform(-4.0, 4.0, (parked, 3))
    found = conflicts(tracks_of(flights, places), shape, shape.distance)
    least = sampled(flights, shape, places)
    named = dict(
        zip(
            zip(found.first.tolist(), found.second.tolist(), strict=True),
            found.distance.tolist(),
            strict=True,
        )
    )
    for pair, distance in least.items():
        if distance < shape.distance - 1e-4:
            assert pair in named
            assert named[pair] <= distance + 2.0 * RESOLUTION
        if distance > shape.distance + 0.05:
            assert pair not in named
    best = closest(tracks_of(flights, places), shape)
    least_of_all = min(least.values())
    assert best.distance[0] <= least_of_all + 2.0 * RESOLUTION
    assert best.distance[0] >= least_of_all - 0.05


def test_an_encounter_shorter_than_any_sampling_step_is_found():
    # Two drones at 200 m/s through one point, 0.2 ms from each other at 5 s.
    ends = np.array([[-1000.0, 0.0, 0.0], [1000.0, 0.0, 0.0]])
    one = track(np.array([0.0, 10.0]), ends[None])
    other = track(np.array([0.0, 10.0]), (ends[::-1] + [0.0, 0.25, 0.0])[None])
    found = conflicts(tracks_of([one, other]), Separation(1.0), 1.0)
    assert len(found) == 1
    assert found.distance[0] == pytest.approx(0.25, abs=2e-6)
    assert found.time[0] == pytest.approx(5.0, abs=1e-6)
    times = np.arange(0.013, 10.0, 0.05)
    gap = one.state(times)[:, :3] - other.state(times)[:, :3]
    assert np.linalg.norm(gap, axis=1).min() > 1.0


def test_a_pair_exactly_at_the_separation_is_no_conflict():
    ends = np.array([[0.0, 0.0, 0.0], [30.0, 20.0, 10.0]])
    one = track(np.array([0.0, 10.0]), ends[None])
    other = track(np.array([0.0, 10.0]), (ends + [0.0, 1.0, 0.0])[None])
    tracks = tracks_of([one, other])
    assert len(conflicts(tracks, Separation(1.0), 1.0 - 1e-7)) == 0
    assert closest(tracks, Separation(1.0)).distance[0] == pytest.approx(1.0, abs=1e-9)


def test_downwash_counts_vertical_distance_less():
    ends = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0]])
    one = track(np.array([0.0, 10.0]), ends[None])
    above = track(np.array([0.0, 10.0]), (ends + [0.0, 0.0, 2.0])[None])
    tracks = tracks_of([one, above])
    assert len(conflicts(tracks, Separation(1.0), 1.0)) == 0
    tall = Separation(1.0, "ellipsoid", 2.5)
    found = conflicts(tracks, tall, 1.0)
    assert found.distance[0] == pytest.approx(0.8, abs=1e-6)


def test_one_drone_alone_has_no_encounter():
    one = track(np.array([0.0, 10.0]), np.zeros((1, 2, 3)))
    assert len(closest(tracks_of([one]), Separation(1.0))) == 0


@pytest.mark.slow
def test_nearest_approaches_of_a_thousand_drones_are_exact():
    rng = np.random.default_rng(5)
    places = np.stack(np.meshgrid(range(32), range(32)), -1).reshape(-1, 2)[:1000]
    start = np.column_stack([2.0 * places, np.full(1000, 10.0)])
    goal = rng.permutation(start) + np.array([0.0, 0.0, 30.0])
    smooth = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    breaks = np.array([0.0, 20.0])
    flights = [
        track(breaks, (a + smooth[:, None] * (b - a))[None])
        for a, b in zip(start, goal, strict=True)
    ]
    tracks = tracks_of(flights)
    found = conflicts(tracks, Separation(1.0), 1.0)
    # Straight ways on one profile: the exact answer is a quadratic for each pair.
    origin, change = start[:, None] - start, (goal - start)[:, None] - (goal - start)
    square = np.einsum("ijc,ijc->ij", change, change)
    along = -np.einsum("ijc,ijc->ij", origin, change)
    nearest = (
        origin + np.clip(along / np.where(square, square, 1), 0, 1)[..., None] * change
    )
    exact = np.linalg.norm(nearest, axis=2)[np.triu_indices(1000, 1)]
    assert len(found) == int((exact < 1.0 - 1e-6).sum())


@pytest.mark.parametrize("separation", SHAPES, ids=lambda s: s.shape)
def test_drones_that_stand_are_as_near_as_flights_that_stay(separation):
    places = np.random.default_rng(3).uniform(0.0, 20.0, (40, 3))
    moving, parked = places[:25], places[25:]
    still = [track([0.0, 1.0], [[place]]) for place in moving]
    flown = closest(tracks_of(still, parked), separation)
    found = standing(places, len(moving), separation, flown.distance[0] + 1e-9)
    assert (found.first[0], found.second[0]) == (flown.first[0], flown.second[0])
    assert found.distance[0] == pytest.approx(flown.distance[0], abs=RESOLUTION)
    assert not len(standing(places, len(moving), separation, flown.distance[0] - 1e-6))
