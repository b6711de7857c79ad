"""Bounds on motion, averages and fences, against dense samples."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.foreign.facts import Asked, each_alone, searches
from showc.foreign.fence import (
    MOST_PAIRS,
    Work,
    along,
    beyond_reach,
    furthest_outside,
    inside_by,
)
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
from showc.foreign.show import Course, FencePolygon, ForeignShow, fleet, polyline
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


@given(
    *[st.tuples(st.floats(-2, 12), st.floats(-2, 12))] * 2,
    st.booleans(),
)
def test_a_way_that_crosses_no_border_keeps_its_distance(begin, end, inclusion):
    polygon = FencePolygon(inclusion, L_SHAPE)
    ends = np.array([begin, end])
    near = along(ends[:1], ends[1:], polygon)[0]
    share = np.linspace(0.0, 1.0, 201)[:, None]
    depth = inside_by((1.0 - share) * ends[0] + share * ends[1], polygon)
    if near > 0.0 and depth[[0, -1]].min() > 0.0:
        assert depth.min() >= min(near, depth[0], depth[-1]) - 1e-9
    if depth.min() < -1e-6 and depth.max() > 1e-6:
        assert near == 0.0


WALLS = FencePolygon(True, 100.0 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]))


def test_flights_along_a_wall_are_not_cut_into_crumbs():
    places = np.zeros((400, 3))
    places[:, 0], places[:, 1] = 90.0 * (np.arange(400) % 2) - 45.0, 99.0
    tracks = fleet([polyline(10.0 * np.arange(400.0), places)])
    work = Work()
    found = furthest_outside(tracks, (WALLS,), work)
    assert (found.lower, found.upper) == pytest.approx((-1.0, -1.0 + 1e-4))
    assert work.left == MOST_PAIRS - 4 * 399


def test_a_search_that_ends_early_still_encloses():
    places = np.array([[0.0, 0, 5], [0, 150, 5], [0, 0, 5]])
    tracks = fleet([polyline(np.array([0.0, 40, 90]), places)])
    far = FencePolygon(True, WALLS.points * [1.0, 0.9])
    found = furthest_outside(tracks, (far, WALLS), Work(1))
    assert found.lower <= 60.0 <= found.upper


def test_memory_does_not_grow_with_the_corners_of_a_fence():
    angle = np.linspace(0.0, 2.0 * np.pi, 1000, endpoint=False)
    ring = FencePolygon(True, 9.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    points = np.zeros((2000, 2))
    tracemalloc.start()
    inside_by(points, ring)
    along(points, points + 1.0, ring)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 20e6
    assert "fewer corners" in beyond_reach(
        SimpleNamespace(starts=np.zeros(200_000)), (ring,)
    )


def test_a_fence_that_is_not_judged_to_the_end_is_no_proof(monkeypatch):
    places = np.array([[0.0, 0, 5], [0, 90, 5], [0, 0, 5]])
    tracks = fleet([polyline(np.array([0.0, 40, 90]), places)])
    show = ForeignShow("x", "x", "x", ("d",), tracks)
    notch = np.array([[-99, -99], [99, -99], [99, 99], [1, 99], [0, 91], [-1, 99.0]])
    rules = [Asked("asked", fence=(FencePolygon(True, notch),))]

    def judged():
        return next(one for one in each_alone(show, rules) if one.code == "VRF508")

    assert judged().verdict == "pass"
    monkeypatch.setattr("showc.foreign.facts.beyond_reach", lambda *_: "too many")
    assert (judged().verdict, judged().notes) == ("fail", ("too many",))
