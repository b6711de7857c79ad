"""Proved distances against brute force over time and delays."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from showc.autopilot.following import law_time, time_followed
from showc.autopilot.parameters import Parameters
from showc.autopilot.s_curve import leg_limits, profile
from showc.schedule.distances import near_pairs, nearest_pair, segment_distance
from showc.schedule.separation import (
    TOLERANCE,
    Motion,
    closest_encounter,
)
from showc.vehicle import Separation

PARAMETERS = Parameters()


def motion(begin, end, *, spread=0.2, speed=5.0, overshoot=0.0):
    begin, end = np.asarray(begin, dtype=float), np.asarray(end, dtype=float)
    count = len(begin)
    limits = leg_limits(end - begin, PARAMETERS, np.full(count, speed))
    leg = profile(limits, PARAMETERS)
    return Motion(
        begin,
        end,
        leg,
        np.zeros(count),
        limits.level,
        np.full(count, spread),
        np.full(count, overshoot),
        (-spread, float(leg.duration.max()) + spread + 0.6),
    )


def sampled(moved, metric, delays=9, instants=400):
    """Least distance over a grid of times and delays of both."""
    times = np.linspace(*moved.window, instants)
    late = np.linspace(-moved.spread[0], moved.spread[0], delays)
    followed = law_time(moved.level, times[:, None, None] - moved.start)
    part = moved.profile.fraction(followed + late[:, None])
    # Each one anywhere between the law and the law carried on by the overshoot.
    beyond = np.stack([np.ones_like(moved.stretch), moved.stretch])
    part = (part[:, :, None] * beyond).reshape(times.size, -1, beyond.shape[1])
    along = moved.end - moved.begin
    place = moved.begin + part[..., None] * along
    best = np.inf
    count = place.shape[2]
    moves = np.any(moved.begin != moved.end, axis=1)
    for a in range(count):
        for b in range(a + 1, count):
            if not (moves[a] or moves[b]):
                continue
            gap = place[:, :, None, a] - place[:, None, :, b]
            best = min(best, metric(gap).min())
    return best


METRICS = {
    "sphere": lambda gap: np.linalg.norm(gap, axis=-1),
    "ellipsoid": lambda gap: np.linalg.norm(gap / [1.0, 1.0, 2.0], axis=-1),
    "any-axis": lambda gap: np.abs(gap).max(axis=-1),
    "all-axes": lambda gap: np.abs(gap).min(axis=-1),
}

# Whole centimetres, as missions store them.
places = st.lists(
    st.tuples(*[st.integers(-900, 900).map(lambda cm: cm / 100)] * 3),
    min_size=4,
    max_size=4,
)


@settings(max_examples=40, deadline=None)
@given(
    places,
    places,
    st.sampled_from(["sphere", "ellipsoid"]),
    st.sampled_from([0.0, 0.45]),
)
def test_the_proved_distance_is_the_true_one(begin, end, shape, overshoot):
    assume(begin != end)
    moved = motion(begin, end, overshoot=overshoot)
    separation = Separation(1.0, shape, 2.0 if shape == "ellipsoid" else 1.0)
    found = closest_encounter(moved, separation)
    brute = sampled(moved, METRICS[shape])
    assert found is not None
    assert found.distance <= brute + 1e-9
    # Brute force misses at most what half a step in time and delay can hide.
    assert found.distance >= brute - TOLERANCE - 0.4


@settings(max_examples=25, deadline=None)
@given(places, places, st.sampled_from(["any-axis", "all-axes"]))
def test_distances_per_axis_are_never_overstated(begin, end, shape):
    assume(begin != end)
    moved = motion(begin, end)
    found = closest_encounter(moved, Separation(1.0, shape))
    assert found is not None
    assert found.distance <= sampled(moved, METRICS[shape]) + 1e-9


def test_two_drones_behind_each_other_lose_the_spread_of_their_delays():
    # Along a line at 5 m/s, 0.4 s of difference in delay is 2 m.
    moved = motion([[0, 0, 9], [3, 0, 9]], [[30, 0, 9], [33, 0, 9]])
    found = closest_encounter(moved, Separation(1.0))
    assert found is not None
    assert found.distance == pytest.approx(1.0, abs=TOLERANCE + 1e-6)
    exact = closest_encounter(
        motion([[0, 0, 9], [3, 0, 9]], [[30, 0, 9], [33, 0, 9]], spread=0.0),
        Separation(1.0),
    )
    assert exact is not None
    assert exact.distance == pytest.approx(3.0, abs=TOLERANCE + 1e-6)


def test_a_planted_encounter_between_coarse_samples_is_found():
    # Head on at 8 m/s each: sampled at 20 Hz the pair seems 0.4 m apart or more.
    moved = motion(
        [[-40, 0, 9], [40, 0.02, 9]],
        [[40, 0, 9], [-40, 0.02, 9]],
        spread=0.0,
        speed=8.0,
    )
    found = closest_encounter(moved, Separation(1.0))
    assert found is not None
    assert found.distance <= 0.02
    # Both are half way when the law is.
    half = time_followed(moved.level, 0.5 * moved.profile.duration)
    assert found.time == pytest.approx(half[0], abs=0.01)


def test_drones_that_end_towards_each_other_may_both_go_too_far():
    begin, end = [[-9, 0, 9], [9, 0, 9]], [[-1, 0, 9], [1, 0, 9]]
    still = closest_encounter(motion(begin, end), Separation(1.0))
    far = closest_encounter(motion(begin, end, overshoot=0.3), Separation(1.0))
    assert still is not None
    assert far is not None
    assert still.distance == pytest.approx(2.0, abs=TOLERANCE + 1e-6)
    assert far.distance == pytest.approx(1.4, abs=TOLERANCE + 1e-6)


def test_drones_that_have_settled_are_at_their_ends():
    # The first one has long been at its end when the second one passes beyond it.
    moved = motion([[0, 0, 9], [-40, 1.2, 9]], [[3, 0, 9], [40, 1.2, 9]], overshoot=0.5)
    beside = replace(moved, end=moved.end + [[0, 0.5, 0], [0, 0, 0]])
    found = closest_encounter(moved, Separation(1.0))
    assert found is not None
    assert found.distance == pytest.approx(1.2, abs=TOLERANCE + 1e-6)
    nearer = closest_encounter(beside, Separation(1.0))
    assert nearer is not None
    assert nearer.distance == pytest.approx(0.7, abs=TOLERANCE + 1e-3)


def test_unknown_timing_means_the_whole_lines():
    moved = motion([[0, 0, 0], [2, -5, 3]], [[0, 0, 9], [2, 5, 3]])
    moved = Motion(
        moved.begin,
        moved.end,
        moved.profile,
        moved.start,
        moved.level,
        np.full(2, np.inf),
        np.zeros(2),
        (0.0, 1.0),
    )
    found = closest_encounter(moved, Separation(1.0))
    assert found is not None
    assert found.distance == pytest.approx(2.0, abs=TOLERANCE + 1e-9)


def test_resting_drones_count_for_moving_ones():
    moved = motion([[-9, 0, 5], [0, 0.7, 5]], [[9, 0, 5], [0, 0.7, 5]])
    found = closest_encounter(moved, Separation(1.0))
    assert found is not None
    assert (found.drone_a, found.drone_b) == (0, 1)
    assert found.distance == pytest.approx(0.7, abs=TOLERANCE + 1e-9)


@settings(max_examples=40, deadline=None)
@given(places, places, st.floats(0.0, 12.0))
def test_no_more_is_proved_than_plenty(begin, end, plenty):
    assume(begin != end)
    moved = motion(begin, end)
    true = closest_encounter(moved, Separation(1.0))
    found = closest_encounter(moved, Separation(1.0), plenty=plenty)
    assert true is not None and found is not None
    # Both are proved, to the tolerance.
    assert found.distance == pytest.approx(min(true.distance, plenty), abs=TOLERANCE)
    assert found.distance <= sampled(moved, METRICS["sphere"]) + 1e-9


def test_nobody_moves_nobody_meets():
    rest = [[0, 0, 5], [1, 0, 5]]
    assert closest_encounter(motion(rest, rest), Separation(1.0)) is None


numbers = st.tuples(*[st.floats(-5, 5)] * 12)


@given(numbers)
def test_segment_distance_is_below_every_sample_and_reached(values):
    p, u, q, v = np.array(values).reshape(4, 1, 3)
    least = segment_distance(p, u, q, v)[0]
    grid = np.linspace(0.0, 1.0, 41)
    first = p[0] + grid[:, None, None] * u[0]
    second = q[0] + grid[None, :, None] * v[0]
    gap = np.linalg.norm(first - second, axis=-1).min()
    assert least <= gap + 1e-9
    step = (np.linalg.norm(u) + np.linalg.norm(v)) / 80.0
    assert least >= gap - step - 1e-9


@given(numbers, st.floats(-2, 2), st.floats(-1e-6, 1e-6))
def test_segments_that_are_nearly_parallel(values, factor, skew):
    p, u, q, aside = np.array(values).reshape(4, 1, 3)
    v = factor * u + skew * aside
    least = segment_distance(p, u, q, v)[0]
    # The distance from a place on one segment to the other one is convex.
    along = np.linspace(0.0, 1.0, 2001)[:, None]
    places = np.array(q + along * v)
    share = np.sum((places - p) * u, axis=1) / max(float(np.sum(u * u)), 1e-300)
    feet = p + np.clip(share, 0.0, 1.0)[:, None] * u
    gap = np.linalg.norm(places - feet, axis=1).min()
    assert least <= gap + 1e-9
    # Places are so far apart.
    assert least >= gap - np.linalg.norm(v) / 4000.0 - 1e-9


shapes = st.sampled_from(
    [
        Separation(1.0),
        Separation(1.0, "ellipsoid", 2.0),
        Separation(1.0, "any-axis"),
        Separation(1.0, "all-axes"),
    ]
)


@settings(max_examples=60, deadline=None)
@given(shapes, st.integers(2, 40), st.integers(0, 99), st.floats(0.0, 6.0))
def test_pairs_are_found_as_by_looking_at_all(separation, count, seed, limit):
    random = np.random.default_rng(seed)
    # On a grid: many are equally far apart.
    one = random.integers(0, 8, (count, 3)).astype(float)
    other = one + random.integers(-3, 4, (count, 3))
    moving = random.random(count) < 0.6
    scale = np.array(separation.metric_scale)

    def gap_of(a, b, ends):
        low, high = np.minimum(*ends) * scale, np.maximum(*ends) * scale
        gap = np.maximum(np.maximum(low[a] - high[b], low[b] - high[a]), 0.0)
        if separation.shape == "any-axis":
            return gap.max()
        return gap.min() if separation.shape == "all-axes" else np.linalg.norm(gap)

    pairs = [
        (a, b)
        for a in range(count)
        for b in range(a + 1, count)
        if moving[a] or moving[b]
    ]
    wanted = [
        pair for pair in pairs if gap_of(*pair, (one, other)) <= limit * (1 + 1e-9)
    ]
    a, b = near_pairs((one, other), separation, limit, moving)
    assert list(zip(a.tolist(), b.tolist(), strict=True)) == wanted
    near = nearest_pair(one, separation, moving)
    if not pairs:
        assert near[2] == np.inf
        return
    best = min(pairs, key=lambda pair: (gap_of(*pair, (one, one)), pair))
    assert near == (*best, pytest.approx(gap_of(*best, (one, one)), abs=1e-12))
