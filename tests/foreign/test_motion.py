"""Bounds on motion, averages and fences, against dense samples."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.foreign.facts import Asked, searches
from showc.foreign.fence import furthest_outside, inside_by
from showc.foreign.motion import (
    derivative,
    difference,
    during,
    greatest,
    jumps,
    length,
    place_at,
    portions,
)
from showc.foreign.show import Course, FencePolygon, fleet, polyline
from showc.foreign.smoothing import (
    Agility,
    average,
    demand_of,
    least_smoothing,
    smoothed,
    widened,
)
from showc.log.showc_pb2 import Separation
from showc.verify.kernel.separation import closest_of

SEEDS = st.integers(0, 2**31)


def random_fleet(seed, drones=3, pieces=6, degree=3):
    """Continuous courses through random control points."""
    rng = np.random.default_rng(seed)
    courses = []
    for _ in range(drones):
        times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 2.0, pieces))])
        body = rng.uniform(-5.0, 5.0, (pieces, degree + 1, 3))
        body[1:, 0] = body[:-1, -1]
        courses.append(Course(times, body))
    return fleet(courses)


def corners(seed, drones=2, points=8):
    rng = np.random.default_rng(seed)
    courses = []
    for _ in range(drones):
        times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.2, 2.0, points - 1))])
        courses.append(polyline(times, rng.uniform(-5.0, 5.0, (points, 3))))
    return fleet(courses)


def sampled(tracks, begin, end, count=301):
    times = np.linspace(begin, end, count)
    return times, np.array([place_at(tracks, time) for time in times])


@settings(max_examples=12)
@given(SEEDS)
def test_the_greatest_length_is_enclosed(seed):
    tracks = random_fleet(seed)
    found = greatest(tracks, length((0, 1, 2)), 1e-6)
    _, places = sampled(tracks, tracks.begin, tracks.end, 101)
    size = np.sqrt((places**2).sum(axis=2))
    assert size.max() <= found.upper
    assert np.linalg.norm(place_at(tracks, found.time)[found.drone]) == pytest.approx(
        found.lower, abs=1e-9
    )
    assert found.upper - found.lower <= 1e-6 + 1e-12


@settings(max_examples=12)
@given(SEEDS)
def test_the_difference_of_two_fleets_is_exact(seed):
    first, second = random_fleet(seed), random_fleet(seed + 1)
    apart = difference(first, second)
    for time in np.linspace(0.0, min(first.end, second.end), 31):
        wanted = place_at(first, time) - place_at(second, time)
        assert place_at(apart, time) == pytest.approx(wanted, abs=1e-9)


def test_portions_are_the_fleet():
    tracks = random_fleet(1, drones=11)
    parts = list(portions(tracks, rows=20))
    assert [first for first, _ in parts] == list(
        np.cumsum([0, *(part.drones for _, part in parts)])[:-1]
    )
    assert sum(part.drones for _, part in parts) == 11
    assert all(part.starts.size <= 20 for _, part in parts)
    for first, part in parts:
        wanted = place_at(tracks, 1.0)[first : first + part.drones]
        assert place_at(part, 1.0) == pytest.approx(wanted)


def test_the_closest_encounter_is_that_of_the_parts_of_the_time():
    tracks = random_fleet(11, drones=6)
    rules = [Asked("", Separation(distance=0.5, vertical_stretch=1.0))]
    whole, parts = (
        closest_of(
            [one() for one in next(iter(searches(tracks, rules, spans).values()))]
        )
        for spans in (1, 4)
    )
    assert parts.upper == pytest.approx(whole.upper, abs=1e-6)
    assert parts.time == pytest.approx(whole.time, abs=1e-3)
    for time in np.linspace(tracks.begin, tracks.end, 50)[1:-1]:
        part = during(tracks, time - 0.01, time + 0.01)
        assert place_at(part, time) == pytest.approx(place_at(tracks, time))


@settings(max_examples=12)
@given(SEEDS, st.floats(0.05, 2.0))
def test_an_average_over_a_box_is_the_integral_of_the_flight(seed, width):
    tracks = widened(random_fleet(seed, drones=1), 2.0 * width)
    averaged = average(tracks, width)
    for time in np.linspace(averaged.begin, averaged.end, 5):
        grid = np.linspace(time - width / 2, time + width / 2, 401)
        values = np.array([place_at(tracks, moment)[0] for moment in grid])
        wanted = np.trapezoid(values, grid, axis=0) / width
        assert place_at(averaged, time)[0] == pytest.approx(wanted, abs=3e-3)


@settings(max_examples=12)
@given(SEEDS)
def test_smoothing_is_never_faster_and_has_no_corners(seed):
    tracks = corners(seed)
    soft = smoothed(tracks, 0.8)
    before = greatest(derivative(tracks), length((0, 1, 2)), 1e-6)
    after = greatest(derivative(soft), length((0, 1, 2)), 1e-6)
    assert after.lower <= before.upper + 1e-6
    _, off = jumps(derivative(soft))
    assert np.abs(off).max() < 1e-6


@settings(max_examples=12)
@given(SEEDS)
def test_demand_is_that_of_the_smoothed_flight(seed):
    tracks = corners(seed)
    found = demand_of(tracks, 1.0)
    force = derivative(derivative(smoothed(tracks, 1.0)))
    _, pull = sampled(force, force.begin + 1e-6, force.end - 1e-6)
    pull = pull / 9.80665 + np.array([0.0, 0.0, 1.0])
    size = np.sqrt((pull**2).sum(axis=2))
    assert size.max() <= found.thrust.upper + 1e-6


def test_the_least_smoothing_is_least():
    tracks = corners(3)
    agility = Agility(np.radians(30.0), 0.5, 1.5)
    found = least_smoothing(tracks, agility)
    assert found.width > 0.1
    assert demand_of(tracks, found.width).within(agility)
    assert not demand_of(tracks, found.width - 0.05).within(agility)
    soft = smoothed(tracks, found.width)
    for time in [*np.linspace(tracks.begin, tracks.end, 201), found.tube.time]:
        gap = place_at(tracks, time) - place_at(soft, time)
        off = np.sqrt((gap**2).sum(axis=1)).max()
        assert off <= found.tube.upper
    assert off == pytest.approx(found.tube.lower, abs=1e-6)


def test_a_smooth_flight_needs_no_smoothing():
    # Rest to rest in minimum jerk over ten seconds.
    course = Course(
        np.array([0.0, 10.0]),
        np.repeat([[0.0], [5.0]], 3, axis=0)[None] * np.array([1.0, 1.0, 1.0]),
    )
    found = least_smoothing(fleet([course]), Agility(np.radians(30.0), 0.5, 1.5))
    assert found.width == 0.0 and found.tube.upper == 0.0


L_SHAPE = np.array([[0, 0], [10, 0], [10, 4], [4, 4], [4, 10], [0, 10]], dtype=float)


@given(st.tuples(st.floats(-2, 12), st.floats(-2, 12)))
def test_signed_distance_to_a_fence_that_is_not_convex(point):
    found = inside_by(np.array([point]), FencePolygon(True, L_SHAPE))[0]
    x, y = point
    inside = (0 <= x <= 10 and 0 <= y <= 4) or (0 <= x <= 4 and 0 <= y <= 10)
    edges = np.concatenate(
        [
            np.linspace(a, b, 1001)
            for a, b in zip(L_SHAPE, np.roll(L_SHAPE, -1, axis=0), strict=True)
        ]
    )
    near = np.sqrt(((edges - np.array(point)) ** 2).sum(axis=1)).min()
    assert abs(found) == pytest.approx(near, abs=0.01)
    if near > 0.01:
        assert (found > 0) == inside
    other = inside_by(np.array([point]), FencePolygon(False, L_SHAPE))[0]
    assert other == -found


@settings(max_examples=12)
@given(SEEDS)
def test_the_way_outside_a_fence_is_enclosed(seed):
    tracks = random_fleet(seed, drones=2)
    fence = (FencePolygon(True, 0.6 * (L_SHAPE - 4.0)),)
    found = furthest_outside(tracks, fence)
    _, places = sampled(tracks, tracks.begin, tracks.end, 101)
    outside = -inside_by(places[:, :, :2].reshape(-1, 2), fence[0])
    assert outside.max() <= found.upper
    reached = place_at(tracks, found.time)[found.drone, :2]
    assert -inside_by(reached[None], fence[0])[0] == pytest.approx(found.lower)
