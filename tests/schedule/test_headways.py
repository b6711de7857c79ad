"""Gaps between releases: pairs that keep them are apart, pairs that do not are not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mission.flights import START, mixed_flight
from synthetic import gliding_flight

from showc.autopilot.parameters import Parameters
from showc.autopilot.s_curve import (
    fitting_speed,
    leg_limits,
    profile,
    ramp_time,
    speed_for,
)
from showc.autopilot.stage import Stage
from showc.autopilot.timing import Timing
from showc.flight import Flight
from showc.geodesy import GlobalPoints
from showc.mission import mission_files
from showc.plan.itinerary import Itinerary
from showc.schedule.headways import Gaps, release_gaps
from showc.schedule.releases import STEP, staggered
from showc.schedule.separation import TOLERANCE, closest_encounter
from showc.schedule.surroundings import stage_motion
from showc.vehicle import Separation

PARAMETERS = Parameters()


def vectors(most):
    return st.tuples(*[st.floats(-most, most)] * 3).map(np.array)


@st.composite
def crossing(draw):
    """Two lines that pass a place together, both at least half a metre long."""
    begin, goal, other = draw(vectors(9.0)), draw(vectors(9.0)), draw(vectors(9.0))
    meeting = begin + draw(st.floats(0.0, 1.0)) * (goal - begin) + draw(vectors(0.7))
    # Beyond the meeting place, or just to it.
    end = other + draw(st.floats(0.9, 3.0)) * (meeting - other)
    points = np.round([begin, other, goal, end], 2)
    assume(np.linalg.norm(points[2:] - points[:2], axis=1).min() > 0.5)
    return points


pairs = crossing()
speeds = st.floats(0.5, 7.0)


def two(points, fast):
    """Return a stage of two drones, each from its first place to its second."""
    begin, end = points[:2], points[2:]
    limits = leg_limits(end - begin, PARAMETERS, np.array(fast))
    nowhere = np.zeros(2, dtype=np.int64)
    return Stage(
        np.arange(2),
        begin,
        end,
        GlobalPoints(nowhere, nowhere, nowhere),
        profile(limits, PARAMETERS),
        limits.level,
        limits.climb,
        limits.level < 0.5,
        limits.speed,
        np.zeros(2),
    )


def nearest(stage, separation, later):
    """Least distance if the second drone leaves ``later`` [s] than the first."""
    waits = np.array([max(-later, 0.0), max(later, 0.0)])
    moved = stage_motion(stage.waiting(waits), stage.begin, Timing())
    return closest_encounter(moved, separation).distance


@settings(max_examples=150, deadline=None)
@given(pairs, speeds, speeds, st.sampled_from(["sphere", "ellipsoid"]))
def test_a_gap_is_just_enough(points, fast, other, shape):
    separation = Separation(1.0, shape, vertical_stretch=2.0)
    stage = two(points, (fast, other))
    gaps = release_gaps(stage, separation, Timing(), 1.0)
    assume(gaps.first.size == 1)
    one_way = np.isposinf([gaps.after[0], gaps.before[0]]).any()
    for gap, sign in ((gaps.after[0], 1.0), (gaps.before[0], -1.0)):
        if np.isposinf(gap):
            continue
        # Places are looked at here and there: nearly enough, and then it is proved.
        assert nearest(stage, separation, sign * (gap + 0.02)) >= 0.93
        if one_way or gaps.after[0] + gaps.before[0] > 0.1:
            assert nearest(stage, separation, sign * (gap - 0.05)) < 1.0


@settings(max_examples=60, deadline=None)
@given(pairs, speeds, speeds)
def test_whoever_can_only_pass_first_cannot_pass_second(points, fast, other):
    separation = Separation(1.0, "sphere")
    stage = two(points, (fast, other))
    gaps = release_gaps(stage, separation, Timing(), 1.0)
    assume(gaps.first.size == 1)
    for gap, sign in ((gaps.after[0], 1.0), (gaps.before[0], -1.0)):
        # After a minute everybody has ended.
        apart = nearest(stage, separation, sign * 120.0) >= 1.0 - TOLERANCE
        assert apart or np.isposinf(gap)


def chain(*gaps, drones=4):
    """Return gaps between drones by (first, second, after, before)."""
    columns = list(zip(*gaps, strict=True))
    return Gaps(
        drones,
        np.array(columns[0]),
        np.array(columns[1]),
        np.array(columns[2], dtype=float),
        np.array(columns[3], dtype=float),
    )


def test_a_chain_is_given_out_from_its_head():
    # 3 before 2 before 1 before 0, by 0.25 s each; nobody the other way round.
    gaps = chain(*((k + 1, k, 0.25, np.inf) for k in range(3)))
    waits = staggered(gaps, np.full(4, 5.0))
    np.testing.assert_allclose(waits, [0.9, 0.6, 0.3, 0.0])


def test_releases_are_as_far_apart_as_their_gaps_say():
    rng = np.random.default_rng(5)
    first, second = np.triu_indices(30, 1)
    some = rng.random(first.size) < 0.2
    first, second = first[some], second[some]
    after, before = rng.uniform(-1.0, 3.0, (2, first.size))
    before = np.maximum(before, 0.1 - after)
    gaps = Gaps(30, first, second, after, before)
    waits = staggered(gaps, rng.uniform(4.0, 9.0, 30))
    later = waits[second] - waits[first]
    assert np.all((later >= after) | (-later >= before))
    assert waits.min() == 0.0
    np.testing.assert_allclose(waits / STEP, np.round(waits / STEP), atol=1e-9)


def test_what_goes_round_in_circles_finds_no_releases():
    circle = chain(*((k, (k + 1) % 3, 0.5, np.inf) for k in range(3)), drones=3)
    assert staggered(circle, np.ones(3)) is None
    either = chain((0, 1, np.inf, np.inf), drones=2)
    assert either.hopeless() == [(0, 1)]
    assert staggered(either, np.ones(2)) is None


steps = st.tuples(*[st.floats(-40.0, 40.0)] * 3).map(np.array)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(steps.filter(lambda step: np.linalg.norm(step) > 0.02), min_size=1),
    st.floats(0.2, 8.0),
    st.floats(1.0, 6.0),
)
def test_speeds_fit_their_legs_and_take_their_time(moves, fast, longer):
    count = len(moves)
    limits = leg_limits(np.array(moves), PARAMETERS, np.full(count, fast))
    fastest = fitting_speed(limits, PARAMETERS)
    covered = fastest * ramp_time(fastest, limits.acceleration, PARAMETERS)
    assert np.all(covered <= limits.length)
    # As fast as may be: a little more does not fit, or is not allowed.
    more = fastest * (1.0 + 1e-9)
    beyond = more * ramp_time(more, limits.acceleration, PARAMETERS) > limits.length
    assert np.all(beyond | (fastest == limits.speed))
    wanted = longer * profile(limits, PARAMETERS).duration
    slowest = np.full(count, 1e-3)
    chosen = speed_for(limits, PARAMETERS, wanted, slowest, fastest)
    free = (chosen > slowest) & (chosen < fastest)
    taken = profile(limits, PARAMETERS, chosen).duration
    np.testing.assert_allclose(taken[free], wanted[free], rtol=1e-9)


def test_who_works_changes_nothing():
    flight = mixed_flight(200, "ball")
    alone, shared = (mission_files(flight, start=START, jobs=jobs) for jobs in (1, 3))
    assert alone.files == shared.files
    assert alone.prediction == shared.prediction


@pytest.mark.parametrize("shape", ["ellipsoid", "any-axis"])
def test_other_separations_are_given_out_and_proved_as_well(shape):
    flight = gliding_flight(24)
    separation = Separation(1.0, shape, vertical_stretch=1.5)
    show = replace(flight.itinerary.show, separation=separation)
    legs = mission_files(
        Flight(Itinerary(show, flight.itinerary.legs), flight.legs, flight.starts),
        start=START,
    ).prediction["legs"]
    assert all(leg["closest"]["distance"] >= 0.978 for leg in legs)
    assert any("staggered" in leg["encoding"] for leg in legs)
