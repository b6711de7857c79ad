"""The flights that the autopilot's loops make of legs, against measured flights."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.autopilot import tracking
from showc.autopilot.controller import STEP
from showc.autopilot.following import SETTLING, law_time, leg_overshoot
from showc.autopilot.parameters import Parameters
from showc.autopilot.s_curve import fitting_speed, leg_limits, profile, speed_for
from showc.autopilot.stage import Stage
from showc.autopilot.tracking import TAIL, Tracker

TUNED = Parameters()
STOCK = replace(TUNED, acceleration=2.5, jerk=1.0)


def tracks(flown, drones, parameters, jobs=1):
    return list(Tracker(drones, parameters, jobs).fly(flown))


def stage_of(ways, speeds, parameters=TUNED, drones=None):
    """A stage of legs along ``ways``, north, east, up, from the origin."""
    ways = np.array(ways, dtype=float)
    limits = leg_limits(ways, parameters, np.array(speeds, dtype=float))
    count = len(ways)
    return Stage(
        np.arange(count) if drones is None else np.array(drones),
        np.zeros_like(ways),
        ways,
        None,
        profile(limits, parameters),
        limits.level,
        limits.climb,
        limits.level < 0.5,
        np.zeros(count),
        np.zeros(count),
    )


def flown(displacement, speed=5.0, parameters=TUNED):
    stage = stage_of([displacement], [speed], parameters)
    (track,) = tracks([(0.0, stage)], 1, parameters)
    return stage, stage.profile, track


def along(displacement, track):
    """Ways level and upright [m] over time, and the times [s]."""
    ways = track.ways[:, 0].astype(float)
    flat = np.array(displacement[:2], dtype=float)
    flat /= max(np.linalg.norm(flat), 1e-9)
    return ways[:, :2] @ flat, ways[:, 2], STEP * np.arange(len(ways))


@pytest.mark.parametrize(
    ("parameters", "arrival", "lag"),
    # Measured on 30 m at 5 m/s: within 0.3 m of the end; half way, behind a trapezoid
    # of 3.5 m/s² and 5 m/s. Starts differed by 0.1 s.
    [
        (STOCK, 9.7, 2.2),
        (TUNED, 7.5, 0.6),
        (replace(TUNED, jerk=5.0), 7.8, 0.9),
        (replace(TUNED, acceleration=5.0), 7.3, 0.55),
    ],
)
def test_the_measured_flights_of_thirty_metres(parameters, arrival, lag):
    way = [30.0, 0.0, 0.0]
    _, _, track = flown(way, parameters=parameters)
    place, _, times = along(way, track)
    assert track.near(0.3)[0] == pytest.approx(arrival, abs=0.15)
    trapezoid = 0.5 * (30.0 / 5.0 + 5.0 / 3.5)
    half = np.interp(15.0, place[times < 12.0], times[times < 12.0])
    assert half - trapezoid == pytest.approx(lag, abs=0.12)


@pytest.mark.xfail(
    reason="With the gain of changes that vehicles have, 0.25, this flight is missed "
    "by 0.06 m; whole shows are followed more closely, 0.078 m root mean square."
)
def test_the_measured_overshoot():
    _, _, track = flown([30.0, 0.0, 0.0])
    assert track.ways[..., 0].max() - 30.0 == pytest.approx(0.45, abs=0.05)


def test_delays_are_those_measured():
    # The constant delay that fits best, legs of 4 to 40 m: 0.15 to 0.45 s, mean 0.33 s.
    legs = [
        *([x, 0, 0] for x in (4, 8, 12, 20, 30, 40)),
        *([0, 0, z] for z in (6, 12, -8)),
        *([10, 0, 5], [15, 0, -8], [20, 0, 10]),
    ]
    best = []
    for displacement in legs:
        limits, leg, track = flown(displacement)
        level, upright, times = along(displacement, track)
        place = level * limits.level[0] + upright * limits.climb[0]
        during = times < leg.duration[0] + 1.0
        delays = np.arange(0.0, 0.7, 0.01)
        errors = [
            np.mean((leg.distance(times[:, None] - delay)[:, 0] - place)[during] ** 2)
            for delay in delays
        ]
        best.append(delays[np.argmin(errors)])
    assert min(best) >= 0.15
    assert max(best) <= 0.45
    assert np.mean(best) == pytest.approx(0.33, abs=0.05)


@pytest.mark.parametrize(
    ("displacement", "error"), [([30, 0, 0], 0.6), ([0, 0, 24], 0.71)]
)
def test_one_fixed_delay_is_as_wrong_as_measured(displacement, error):
    # With 0.35 s for all legs: worst places up to 5 m/s, level and upright.
    limits, leg, track = flown(displacement)
    level, upright, times = along(displacement, track)
    place = level * limits.level[0] + upright * limits.climb[0]
    late = leg.distance(times[:, None] - 0.35)[:, 0]
    assert np.abs(place - late).max() == pytest.approx(error, abs=0.13)


@pytest.mark.parametrize(
    ("length", "time", "first", "last"),
    # Measured from the clock slot, which the simulation's clock cuts by 0.17 s, until
    # within 0.3 m: earliest and latest of four drones on legs of 4 to 27 m.
    [(4.0, 8.0, 7.70, 7.92), (27.0, 8.0, 7.70, 7.92), (10.0, 6.0, 5.78, 5.90)],
)
def test_measured_synchronised_arrivals(length, time, first, last):
    way = np.array([[0.8 * length, 0.5 * length, 0.331662 * length]])
    limits = leg_limits(way, TUNED, np.array([np.inf]))
    fastest = fitting_speed(limits, TUNED)
    speed = speed_for(limits, TUNED, np.array([time]), np.array([0.1]), fastest)
    (track,) = tracks([(0.0, stage_of(way, speed))], 1, TUNED)
    assert first - 0.2 <= track.near(0.3)[0] + 0.17 <= last + 0.2


ways = st.tuples(*[st.floats(-30, 30)] * 3).filter(lambda d: np.linalg.norm(d) > 0.3)


@settings(max_examples=25, deadline=None)
@given(ways, st.floats(0.5, 5.0))
def test_drones_fly_near_the_proved_part_of_their_line(displacement, speed):
    # The proof lets each be 0.2 s early or late, on its line, overshoot included.
    limits, leg, track = flown(displacement, speed)
    level, upright, times = along(displacement, track)
    length = leg.length[0]
    upright = np.abs(upright)
    flat, steep = limits.level[0], np.abs(limits.climb[0])
    law = law_time(limits.level, times[:, None])
    rear = leg.distance(law - 0.2)[:, 0]
    beyond = leg_overshoot(limits.level, leg.speed)[0] / length
    front = leg.distance(law + 0.2)[:, 0] * (1.0 + beyond)
    place = np.clip(level * flat + upright * steep, rear, front)
    off = np.hypot(level - flat * place, upright - steep * place)
    settled = times > leg.duration[0] + SETTLING
    assert off[~settled].max() < 0.1 + 0.05 * leg.speed[0]
    # Then they may be anywhere where they were before.
    assert np.hypot(level - flat * length, upright - steep * length)[
        settled
    ].max() < 0.1 + 0.09 * max(leg.speed[0], 1.0)


@settings(max_examples=25, deadline=None)
@given(ways, st.floats(0.3, 8.0))
def test_a_flight_begins_at_rest_and_ends_at_its_goal(displacement, speed):
    _, leg, track = flown(displacement, speed)
    ways = np.array([displacement])
    since = np.array([[-1.0], [0.0], [leg.duration[0] + TAIL], [1e3]])
    places = track.places(since)[:, 0]
    np.testing.assert_allclose(places[:2], 0.0, atol=1e-9)
    np.testing.assert_allclose(places[2:], np.repeat(ways, 2, axis=0), atol=1e-3)
    # The law ends no sooner than it would without waiting, and half way is before.
    assert track.ended[0] >= leg.duration[0] - 1e-6
    assert 0.4 * leg.duration[0] < track.half_way[0] < track.ended[0]


def test_a_drone_takes_along_what_it_is_off():
    # Back at once, while it is still beyond its end: it leaves from there, and later.
    there = stage_of([[30.0, 0.0, 0.0]], [5.0])
    back = replace_ends(there)
    soon = float(np.ceil(there.profile.duration[0] + 1.0))
    first, second = tracks([(0.0, there), (soon, back)], 1, TUNED)
    before = first.places(np.array([[soon - 1e-6]]))[0, 0]
    after = first.places(np.array([[soon]])) + second.places(np.array([[0.0]]))
    assert before[0] > 30.2
    np.testing.assert_allclose(after[0, 0], before, atol=1e-3)
    (alone,) = tracks([(0.0, back)], 1, TUNED)
    assert second.near(0.3)[0] > alone.near(0.3)[0] + 0.05
    # Whoever has settled does not.
    first, late = tracks([(0.0, there), (soon + 60.0, back)], 1, TUNED)
    np.testing.assert_allclose(late.ways, alone.ways, atol=1e-6)


def replace_ends(stage):
    return replace(stage, begin=stage.end, end=stage.begin, profile=stage.profile)


def show_of_many(drones=11, seed=5):
    """Stages of some or all drones, released sooner or later than they have settled."""
    random = np.random.default_rng(seed)
    flown, release = [], 0.0
    for number in range(5):
        some = np.sort(random.permutation(drones)[: drones - number])
        ways = np.round(random.uniform(-20.0, 20.0, (some.size, 3)), 2)
        ways[0] *= number % 2
        stage = stage_of(ways, random.uniform(0.5, 8.0, some.size), drones=some)
        waits = np.round(random.integers(0, 20, some.size) * 0.1, 1)
        flown.append((release, stage.waiting(waits)))
        release = round(release + stage.duration + float(random.uniform(1.0, 9.0)), 1)
    return flown


def as_arrays(found):
    names = ("along", "ways", "until", "half_way", "ended")
    return [getattr(track, name) for track in found for name in names]


def test_who_flies_whom_changes_nothing(monkeypatch):
    flown = show_of_many()
    whole = tracks(flown, 11, TUNED)
    monkeypatch.setattr(tracking, "TOGETHER", 4)
    alone = tracks(flown, 11, TUNED, 1)
    for jobs in (2, 3):
        shared = tracks(flown, 11, TUNED, jobs)
        for one, other in zip(as_arrays(alone), as_arrays(shared), strict=True):
            np.testing.assert_array_equal(one, other)
    for one, other in zip(alone, whole, strict=True):
        same_flights(one, other, np.arange(11)[: one.until.size])


def test_what_is_flown_again_is_what_a_fresh_tracker_flies(monkeypatch):
    random = np.random.default_rng(2)
    stages = [
        stage_of(random.uniform(-20.0, 20.0, (3, 3)), random.uniform(2.0, 8.0, 3))
        for _ in range(4)
    ]
    flown = [(12.0 * number, stage) for number, stage in enumerate(stages)]
    drawn = []
    draw = tracking._Flight.draw
    monkeypatch.setattr(
        tracking._Flight, "draw", lambda *given: drawn.append(0) or draw(*given)
    )
    tracker = Tracker(3, TUNED)
    first = list(tracker.fly(flown))
    again = list(tracker.fly(flown))
    assert len(drawn) == len(flown)
    assert all(one is other for one, other in zip(first, again, strict=True))
    # With another third stage the second ends at another release.
    later = stages[2].waiting(np.full(3, 0.1))
    changed = [*flown[:2], (24.0, later), flown[3]]
    found = list(tracker.fly(changed))
    assert len(drawn) == len(flown) + 3
    assert found[0] is first[0]
    assert not np.array_equal(found[1].until, first[1].until)
    wanted = tracks(changed, 3, TUNED)
    for one, other in zip(as_arrays(found), as_arrays(wanted), strict=True):
        np.testing.assert_array_equal(one, other)


def test_each_drone_flies_as_if_it_were_alone():
    flown = show_of_many()
    together = tracks(flown, 11, TUNED)
    for drone in range(11):
        own, rows = [], []
        for release, stage in flown:
            some = np.flatnonzero(stage.drones == drone)
            if some.size:
                own.append((release, part(stage, some)))
            rows.append(some)
        alone = iter(tracks(own, 1, TUNED))
        for track, some in zip(together, rows, strict=True):
            if not some.size:
                continue
            single = next(alone)
            same_flights(single, track, some)


def same_flights(few, many, some):
    """Hold the flights of ``few`` against those of ``some`` of the ``many``."""
    instants = np.arange(0.0, 40.0, 0.01)[:, None]
    # Vectors of other lengths are rounded otherwise.
    found, wanted = few.places(instants), many.places(instants)[:, some]
    np.testing.assert_allclose(found, wanted, atol=1e-5)
    np.testing.assert_allclose(few.half_way, many.half_way[some], atol=1e-9)
    np.testing.assert_allclose(few.ended, many.ended[some], atol=1e-9)
    np.testing.assert_array_equal(few.until, many.until[some])


def part(stage, some):
    return replace(
        stage,
        drones=np.zeros(1, dtype=int),
        begin=stage.begin[some],
        end=stage.end[some],
        profile=stage.profile.select(some),
        level=stage.level[some],
        climb=stage.climb[some],
        wait=stage.wait[some],
    )
