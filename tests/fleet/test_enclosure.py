"""Flights within a concave fence: round its corners, with the margin, at all times."""

from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import LIMITS, Listening, make_leg, make_options, make_show
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.errors import SolveError
from showc.fleet import solve_leg
from showc.fleet.deconfliction import bending
from showc.fleet.deconfliction.enclosure import (
    detour,
    detours,
    displacement,
    fence_walls,
)
from showc.fleet.deconfliction.walls import NODES, gathered
from showc.fleet.execution.pool import InProcess
from showc.fleet.proof import flaw
from showc.fleet.shared_profile.flat import use_of_limits
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.spline import follow_spline
from showc.progress import Silent
from showc.script.fence import Fence
from showc.vehicle import PRESETS, Separation
from showc.vehicle.metric import measure

L = np.array([(-40, -40), (40, -40), (40, 0), (0, 0), (0, 40), (-40, 40)], float)
U = np.array(
    [(-40, -30), (40, -30), (40, 40), (12, 40)]
    + [(12, -5), (-12, -5), (-12, 40), (-40, 40)],
    float,
)
GENTLE = PRESETS["formation-625g"].envelope.within(LIMITS)


def solve(leg, fence, margin):
    show = make_show(
        leg.drones.size,
        separation=Separation(1.5),
        fence=fence,
        fence_margin=margin,
    )
    return solve_leg(leg, show, make_options(), InProcess(), Silent())


def assert_encloses(flight, fence, margin):
    times = np.linspace(0.0, flight.duration, 4001)
    places = [t.state(times)[:, :3] for t in flight.trajectories]
    for place in places:
        assert Fence(fence).clearance(place[:, :2]).min() >= margin - 1e-5
    for i, one in enumerate(places):
        for other in places[:i]:
            assert measure(one - other, Separation(1.5)).min() >= 1.5 - 1e-6


@pytest.mark.parametrize("limits", [LIMITS, GENTLE], ids=["airframe", "autopilot"])
def test_a_fleet_goes_round_a_corner_and_keeps_apart(limits):
    start = np.array([(x, y, 20.0) for x in (-15.0, -12.0) for y in (20.0, 23.0)])
    goal = np.array([(x, y, 22.0) for x in (20.0, 23.0) for y in (-15.0, -12.0)])
    flight = solve(make_leg(start, goal, limits=limits), L, 3.0)
    assert_encloses(flight, L, 3.0)
    # A straight way would take less and leave the fence.
    assert not Fence(L, 3.0).straight(start[0, :2], goal[:1, :2])[0]


def test_two_that_pass_each_other_at_a_corner_keep_apart_within_the_fence():
    start = np.array([(-6.0, 8.0, 20.0), (8.0, -6.0, 20.0)])
    flight = solve(make_leg(start, start[::-1], limits=GENTLE), L, 2.0)
    assert_encloses(flight, L, 2.0)


def test_a_drone_with_a_stop_at_each_corner_is_a_flight_for_any_longer_time():
    fence = Fence(L, 2.0)
    way = detour(fence, np.array([-6.0, 30.0, 10.0]), np.array([30.0, -6.0, 14.0]))
    aircraft = Aircraft(make_show(1).vehicle, GENTLE)
    least = sum(profile.duration for profile in way.profiles(aircraft))
    assert way.halting(aircraft, 0.99 * least) is None
    flight = way.halting(aircraft, 1.3 * least)
    assert flight.state.end == pytest.approx(1.3 * least)
    times = np.linspace(0.0, flight.state.end, 3001)
    assert fence.clearance(flight.state(times)[:, :2]).min() >= 2.0 - 1e-6


def test_a_passage_that_is_too_narrow_is_named_with_drone_and_margin():
    walls = np.array(
        [(-20, -9), (-1, -9), (-1, -1), (1, -1), (1, -9), (20, -9), (20, 9)]
        + [(1, 9), (1, 1), (-1, 1), (-1, 9), (-20, 9)],
        float,
    )
    leg = make_leg([(-10.0, 0.0, 9.0)], [(10.0, 0.0, 9.0)], limits=GENTLE)
    with pytest.raises(SolveError, match=r"drone 1 has no way .* stays 1\.50 m within"):
        solve(leg, walls, 1.5)


def test_a_place_too_near_the_fence_is_refused_with_both_distances():
    leg = make_leg([(-10.0, 39.0, 9.0)], [(-10.0, 0.0, 9.0)], limits=GENTLE)
    with pytest.raises(SolveError, match=r"1\.00 m within the fence; the margin is 3"):
        solve(leg, L, 3.0)


def block(columns, rows, x, y):
    """Places 2.5 m apart about a middle."""
    return np.array(
        [
            (x + 2.5 * (i - (columns - 1) / 2), y + 2.5 * (j - (rows - 1) / 2), 20.0)
            for j in range(rows)
            for i in range(columns)
        ]
    )


def test_a_fleet_passes_a_corner_as_near_as_its_width_allows():
    """A long column passes it no farther than a single drone, and nearly as soon."""
    flight = solve(
        make_leg(block(2, 4, -25.0, 25.0), block(4, 2, 25.0, -25.0), limits=GENTLE),
        L,
        1.0,
    )
    assert_encloses(flight, L, 1.0)
    assert flight.certificate.gap < 0.05


def test_two_flocks_exchange_the_arms_of_a_fence():
    """Each flock keeps its order; both are done near the slowest drone's bound."""
    left = block(2, 2, -26.0, 25.0)
    right = left * [-1.0, 1.0, 1.0]
    start, goal = np.concatenate([left, right]), np.concatenate([right, left])
    flight = solve(make_leg(start, goal, limits=GENTLE), U, 1.0)
    assert_encloses(flight, U, 1.0)
    assert flight.certificate.gap < 0.06


def test_drones_of_one_flock_stay_to_each_other_as_on_straight_ways():
    left = block(2, 2, -26.0, 25.0)
    right = block(2, 2, 26.0, 25.0)
    start, goal = np.concatenate([left, right]), np.concatenate([right, left])
    ways = detours(Fence(U, 1.0), Aircraft(make_show(1).vehicle, GENTLE), start, goal)
    for flock in (range(4), range(4, 8)):
        middle = np.mean([ways[row].places for row in flock], axis=0)
        for row in flock:
            offset = ways[row].places - middle
            assert np.allclose(offset, offset[0])


@pytest.mark.parametrize("duration", [19.2, 19.3])
@pytest.mark.parametrize("row", [3, 6])
def test_a_spline_as_fast_as_it_may_be_is_not_lost_to_rounding(row, duration):
    """Its solver keeps rows to a tolerance: a limit used in full is passed by that."""
    aircraft, fence = Aircraft(make_show(1).vehicle, GENTLE), Fence(U, 1.0)
    left = block(2, 2, -26.0, 25.0)
    right = block(2, 2, 26.0, 25.0)
    start, goal = np.concatenate([left, right]), np.concatenate([right, left])
    ways = detours(fence, aircraft, start, goal)
    cruises = displacement(aircraft, start, goal, ways)
    ends = np.zeros_like(start), cruises
    profile = shared_profile(aircraft.vehicle, GENTLE, aircraft.heading, *ends)
    way = ways[row].reference(aircraft, profile.stretched(duration), 72)
    nodes = duration / 72 * (np.arange(72)[:, None] + NODES)
    places = way(nodes.ravel()).reshape(72, -1, 3)
    walls = gathered([fence_walls(fence, places, 0.0)])
    found = follow_spline(aircraft, start[row], goal[row], way, 72, walls)
    assert found is not None
    fastest = use_of_limits(aircraft.vehicle, GENTLE, found.flight).velocity
    assert 0.9999 < fastest <= 1.0


@pytest.mark.parametrize("fence", [L, U], ids=["L", "U"])
def test_what_a_lone_drone_needs_within_a_fence_is_bounded_closely(fence):
    ends = {0: ((-20.0, 38.0), (38.0, -20.0)), 1: ((-28.0, 28.0), (24.0, 28.0))}
    start, goal = (np.array([(*end, 20.0)]) for end in ends[int(fence is U)])
    flight = solve(make_leg(start, goal, limits=GENTLE), fence, 1.0)
    assert_encloses(flight, fence, 1.0)
    assert 0.0 <= flight.certificate.gap < 0.04


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_no_way_within_the_fence_is_shorter_than_the_least_length(seed):
    fence, draw = Fence(L, 2.0), np.random.default_rng(seed)
    places = draw.uniform(-38.0, 38.0, (40, 2))
    start, goal = places[fence.keeps(places)][:2]
    way = fence.way(start, goal)
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    least = fence.least_length(start, goal)
    assert np.linalg.norm(goal - start) - 1e-9 <= least <= length + 1e-9

    def greater(ways):
        return np.abs(ways).max(axis=1)

    least = fence.least_length(start, goal, greater)
    length = greater(np.diff(way, axis=0)).sum()
    assert np.abs(goal - start).max() - 1e-9 <= least <= length + 1e-9


def test_one_drone_that_must_goes_round_alone_and_its_least_time_knows_the_fence():
    start = np.array([(-30.0, y, 20.0) for y in (-30.0, -26.0, -22.0, -18.0)])
    goal = start + [50.0, 0.0, 0.0]
    start[3], goal[3] = (-4.0, 36.0, 20.0), (36.0, -4.0, 20.0)
    flight = solve(make_leg(start, goal, limits=GENTLE), L, 2.0)
    assert_encloses(flight, L, 2.0)
    statistics = flight.certificate.statistics
    assert statistics["fence_bound"] <= flight.duration
    for row in range(3):
        places = flight.trajectories[row].state(np.linspace(0, flight.duration, 50))
        assert np.ptp(places[:, 1]) < 1e-6


def test_where_no_flight_behind_walls_is_found_drones_stop_at_corners(monkeypatch):
    """Straight ways of those that go round count for nothing, whatever the walls do."""
    monkeypatch.setattr(bending, "fly_behind", lambda *_: (bending.OPTIMAL, None, ""))
    start, goal = np.array([[-4.0, 36.0, 20.0]]), np.array([[36.0, -4.0, 20.0]])
    leg = make_leg(start, goal, limits=GENTLE)
    assert_encloses(solve(leg, L, 2.0), L, 2.0)
    assert not flaw(solve(leg, L, 2.0), make_show(1, separation=Separation(1.5)))
    with pytest.raises(SolveError, match="no flight was found in less"):
        solve(replace(leg, duration=10.0), L, 2.0)


def test_shorter_times_are_tried_down_to_the_bound_about_ways_that_kept_apart():
    """What is found first is no floor; and no shorter time begins anew."""
    start, goal = block(3, 2, -25.0, 25.0), block(3, 2, 25.0, -25.0)
    show = make_show(6, separation=Separation(1.5), fence=L, fence_margin=1.0)
    heard = Listening()
    leg = make_leg(start, goal[::-1], limits=GENTLE)
    flight = solve_leg(leg, show, make_options(), InProcess(), heard)
    assert_encloses(flight, L, 1.0)
    assert flight.certificate.gap < 0.05
    found = [note.split() for note in heard.notes if "over the minimum" in note]
    tried = [float(words[-2]) for words in found]
    first = float(found[0][found[0].index("found") + 1])
    assert min(tried) < 0.95 * first
    assert flight.certificate.statistics["common_times_tried"] <= 8.0
