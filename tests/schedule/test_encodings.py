"""Drones in any order of places: some order of releases, or ways above, is found."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mission.flights import START, mixed_flight
from mission.planted import Case
from synthetic import LIMITS

from showc.autopilot.parameters import Parameters
from showc.autopilot.stage import StageBuilder, flown
from showc.errors import ExportError
from showc.geodesy import SiteFrame
from showc.mission import mission_files
from showc.schedule.releases import LONGEST_WAIT, ordered

pairs = st.integers(1, 12).flatmap(
    lambda count: st.tuples(
        st.just(count),
        st.lists(
            st.tuples(st.integers(0, count - 1), st.integers(0, count - 1)), max_size=30
        ),
    )
)


@given(pairs)
def test_an_order_respects_all_that_can_be_respected(case):
    count, before = case
    order, circles = ordered(count, before, range(count))
    assert sorted([*order, *circles]) == list(range(count))
    place = {item: index for index, item in enumerate(order)}
    for one, other in before:
        if other in place:
            assert place[one] < place[other]
    # Whoever is left out waits for another one who is.
    for item in circles:
        assert any(other == item and one in circles for one, other in before)


@given(pairs)
def test_without_circles_everything_is_in_order(case):
    count, before = case
    forward = [(one, other) for one, other in before if one < other]
    assert ordered(count, forward, range(count)) == (list(range(count)), [])


@pytest.mark.parametrize(("target", "drones"), [("ball", 60), ("cube", 50)])
def test_random_places_are_flown_and_proved_twice(tmp_path, target, drones):
    case = Case(tmp_path, mixed_flight(drones, target), START)
    assert case.failures() == set()
    assert any(
        "staggered" in leg["encoding"] or "above" in leg["encoding"]
        for leg in case.missions.prediction["legs"]
    )


def test_who_goes_round_in_circles_goes_above_the_others():
    # Two lines pass other drones' places, in both orders.
    flight = mixed_flight(50, "cube")
    legs = mission_files(flight, start=START).prediction["legs"]
    leg = next(leg for leg in legs if "above" in leg["encoding"])
    assert leg["encoding"].startswith("2 of 50 drones above the others")
    assert len(leg["slots"]) == 3
    assert leg["closest"]["distance"] >= 0.978


def test_nobody_waits_longer_than_the_longest_wait():
    flight = mixed_flight(60, "ball")
    predicted = mission_files(flight, start=START).predicted
    waits = [
        stage.wait
        for scheduled in predicted.timeline.legs
        for stage in scheduled.encoding.stages
    ]
    assert all(np.all(wait == np.round(wait, 1)) for wait in waits)
    assert 0.0 < max(wait.max() for wait in waits) <= LONGEST_WAIT


def test_a_ceiling_keeps_drones_down():
    # With no room above, drones in one plane are refused rather than sent there.
    flight = mixed_flight(50, "plane")
    legs = tuple(
        replace(
            item,
            leg=replace(
                item.leg,
                limits=replace(
                    item.leg.limits,
                    position_max=(200.0, 200.0, float(item.leg.goal[:, 2].max()) + 0.5),
                ),
            ),
        )
        if item.leg.kind in {"transition", "approach"}
        else item
        for item in flight.legs
    )
    with pytest.raises(ExportError, match="come as near as"):
        mission_files(replace(flight, legs=legs), start=START)


def test_many_ways_at_once_are_those_one_by_one():
    random = np.random.default_rng(3)
    builder = StageBuilder(
        SiteFrame(47.0, 8.0, 400.0, 30.0), np.full(9, 400.0), Parameters()
    )

    drones = np.array([0, 2, 3, 7, 8])
    # Who stays where he is has no leg there.
    stops = [
        [np.round(random.uniform(0.0, 40.0, (5, 3)), 2) for _ in range(count)]
        for count in (2, 3, 4)
    ]
    stops[1][1][2] = stops[1][0][2]
    found = builder.ways(drones, stops, LIMITS)
    assert [len(way) for way in found] == [1, 2, 3]
    every = [lines for way in found for lines in way]
    legs = [(begin, end) for way in stops for begin, end in pairwise(way)]
    times = [
        lines.together * (1.0 + 0.1 * number) for number, lines in enumerate(every)
    ]
    for lines, (begin, end), time, stage in zip(
        every, legs, times, flown(every, times), strict=True
    ):
        alone = builder.lines(drones, begin, end, LIMITS)
        np.testing.assert_array_equal(lines.drones, alone.drones)
        np.testing.assert_array_equal(lines.end, alone.end)
        np.testing.assert_array_equal(lines.stored.height, alone.stored.height)
        np.testing.assert_allclose(lines.shortest, alone.shortest, rtol=1e-12)
        single = alone.lasting(time)
        np.testing.assert_allclose(stage.command, single.command, atol=1e-9)
        np.testing.assert_allclose(
            stage.profile.duration, single.profile.duration, rtol=1e-9
        )
        assert stage.duration == pytest.approx(max(time, lines.together), abs=0.1)
    assert every[1].drones.tolist() == [0, 2, 7, 8]
