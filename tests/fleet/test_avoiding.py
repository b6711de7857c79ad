"""Optimal control behind soft walls: sides are kept, limits hold, time is used."""

import numpy as np
import pytest
from fleet.handmade import LIMITS, VEHICLE

from showc.fleet.shared_profile.synchronise import best_profile
from showc.fleet.single_drone import avoiding, common_time
from showc.fleet.single_drone.audit import greatest_excess
from showc.fleet.single_drone.avoiding import SLOTS, Passage, avoid
from showc.fleet.single_drone.common_time import OPTIMAL, Known, fly_near
from showc.fleet.single_drone.convex_program import WALL_DEGREE, Walls
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.replay import replay
from showc.fleet.single_drone.shortest import minimum_time
from showc.trajectory import PiecewisePolynomial

CRAFT = Aircraft(VEHICLE, LIMITS)
START, GOAL = np.array([0.0, 0.0, 20.0]), np.array([12.0, 0.0, 20.0])
INTERVALS = 24


def profile(duration):
    found, _ = best_profile(VEHICLE, LIMITS, 0.0, (GOAL - START)[None], duration)
    return found.derivatives()[0]


def straight(reference):
    breaks = np.linspace(0.0, reference.end, INTERVALS + 1)
    ends = START + reference(breaks) * (GOAL - START)
    return PiecewisePolynomial(breaks, np.stack([ends[:-1], ends[1:]], axis=1))


def wall(offset, copies=1):
    """Keep y above ``offset`` in the middle of the way."""
    interval = np.repeat(np.arange(10, 14), copies)
    normal = np.tile([0.0, 1.0, 0.0], (interval.size, 2, 1))
    return Walls(interval, normal, np.full((interval.size, WALL_DEGREE + 1), offset))


def assert_flies(flight, duration):
    assert replay(VEHICLE, [flight]).position.max() < 1e-3
    assert greatest_excess(CRAFT, flight).relative < 1e-9
    assert flight.state.end == duration
    assert np.array_equal(flight.state(0.0)[:3], START)
    assert np.array_equal(flight.state(duration)[:3], GOAL)


def test_the_slowest_drone_is_flown_a_little_above_its_least_time():
    least = minimum_time(CRAFT, START, GOAL)
    duration = 1.008 * least.duration
    flight = avoid(
        CRAFT,
        START,
        GOAL,
        profile(duration),
        shortest=least.trajectory,
    )
    assert_flies(flight, duration)
    assert np.abs(flight.state(np.linspace(0.0, duration, 200))[:, 1]).max() < 1e-6


def test_walls_are_kept_to_the_clearance_and_only_where_they_stand():
    reference = profile(4.0)
    way = straight(reference)
    free = avoid(CRAFT, START, GOAL, reference)
    bent = avoid(CRAFT, START, GOAL, reference, Passage(wall(0.5), way, 0.04))
    assert_flies(bent, 4.0)
    behind = np.linspace(10 / 24 * 4.0, 14 / 24 * 4.0, 200)
    aside = bent.state(behind)[:, 1]
    # Soft walls give way a little, most where they begin and end.
    assert 0.5 - 0.02 < aside.min() < 0.6
    assert aside[20:-20].min() > 0.5
    assert np.abs(free.state(behind)[:, 1]).max() < 1e-6
    # From its own flight the next round starts, on the same intervals.
    again = avoid(CRAFT, START, GOAL, reference, Passage(wall(0.5), way, 0.04), bent)
    assert np.array_equal(again.state.breaks, bent.state.breaks)
    apart = again.state(behind)[:, :3] - bent.state(behind)[:, :3]
    assert np.linalg.norm(apart, axis=1).max() < 0.05


def test_next_to_the_ends_walls_ask_for_less_and_count_more():
    whole = Walls(
        np.arange(INTERVALS),
        np.tile([0.0, 1.0, 0.0], (INTERVALS, 2, 1)),
        np.full((INTERVALS, WALL_DEGREE + 1), 0.5),
    )
    passage = Passage(whole, straight(profile(4.0)), 0.04)
    times = np.array([0.0, 0.125, 0.25, 2.0, 3.75, 3.875, 4.0])
    weight, offset = avoiding._laid(passage, times)[:, 0, [1, 3]].T
    assert weight == pytest.approx([300.0, 8.0, 1.0, 1.0, 1.0, 8.0, 300.0])
    eased = np.array([0.0, 0.125, 1.0, 1.0, 1.0, 0.125, 0.0])
    assert offset / weight == pytest.approx(0.5 + 0.04 * eased)


def test_of_more_walls_than_count_the_farthest_ones_are_left_out():
    reference = profile(4.0)
    way = straight(reference)
    low, high = wall(-3.0, copies=SLOTS), wall(0.5)
    both = Walls(
        np.concatenate([low.interval, high.interval]),
        np.concatenate([low.normal, high.normal]),
        np.concatenate([low.offset, high.offset]),
    )
    bent = avoid(CRAFT, START, GOAL, reference, Passage(both, way, 0.04))
    assert bent.state(2.0)[1] > 0.5


def test_a_moment_too_much_is_hovered_away():
    least = minimum_time(CRAFT, START, GOAL)
    duration = np.ceil(1000.0 * least.duration) / 1000.0
    known = Known(least.trajectory)
    kind, flight, _ = fly_near(CRAFT, START, GOAL, profile(duration), INTERVALS, known)
    assert kind == OPTIMAL
    assert_flies(flight, duration)
    assert flight.state.intervals == least.trajectory.state.intervals + 1
    at = 0.5 * (least.duration + duration)
    # Every coefficient of the last interval, so that it hovers at all its instants.
    assert np.all(flight.state.coefficients[-1, :, :3] == GOAL)
    assert flight.control(at) == pytest.approx(VEHICLE.hover_control(), abs=1e-12)


@pytest.mark.parametrize(
    ("way", "more", "splines"),
    [
        ((20.0, 5.0, 0.0), 1.005, 0),
        ((20.0, 5.0, 0.0), 1.08, 1),
        # What leans little may be quick, so that a climb is always tried.
        ((3.0, 2.0, 15.0), 1.005, 1),
    ],
)
def test_splines_are_left_out_of_level_moves_that_leave_no_time_for_them(
    monkeypatch, way, more, splines
):
    way = np.array(way)
    goal = START + way
    like = minimum_time(CRAFT, np.zeros(3), way + [0.2, 0.0, 0.0]).trajectory
    duration = more * minimum_time(CRAFT, START, goal).duration
    shared, _ = best_profile(VEHICLE, LIMITS, 0.0, way[None], duration)
    follow, tried = common_time.follow_spline, []

    def counting(*task):
        tried.append(task)
        return follow(*task)

    monkeypatch.setattr(common_time, "follow_spline", counting)
    task = CRAFT, START, goal, shared.derivatives()[0], INTERVALS, Known(like=like)
    _, flight, _ = fly_near(*task)
    assert len(tried) == splines
    assert flight.state.end == duration
    assert np.array_equal(flight.state(duration)[:3], goal)
