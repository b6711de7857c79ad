"""Whole crowds changed at once: apart at samples, within limits, on any symmetry."""

import numpy as np
import pytest
from fleet.handmade import LIMITS, VEHICLE

from showc.fleet.deconfliction import untangling
from showc.fleet.deconfliction.changes import Untangled
from showc.fleet.deconfliction.crowd import Allowed, Crowd, Planes, sampled
from showc.fleet.deconfliction.elastic import Elastic
from showc.fleet.deconfliction.untangling import quickest, untangle
from showc.fleet.execution.pool import InProcess
from showc.fleet.single_drone.model import Aircraft
from showc.vehicle import Separation
from showc.vehicle.metric import measure

DURATION, INTERVALS = 6.0, 20
NONE = np.zeros(0, dtype=np.int64)
FAR = Allowed.of(Aircraft(VEHICLE, LIMITS))
NO_PLANES = Planes(NONE, NONE, np.zeros((0, 3)), np.zeros(0))


def crowd_of(start, goal, separation, planes=NO_PLANES, duration=DURATION):
    times = sampled(duration, INTERVALS)
    share = times / duration
    along = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    way = (goal - start)[:, None]
    places = start[:, None] + along[None, :, None] * way
    speeds = np.gradient(places, times, axis=1)
    give = np.repeat(np.eye(3)[None], len(start), axis=0)
    hovers = np.linalg.norm(goal - start, axis=1) < 1e-9
    pulls = np.gradient(speeds, times, axis=1)
    return Crowd(
        times,
        places,
        speeds,
        pulls,
        np.gradient(pulls, times, axis=1),
        duration,
        INTERVALS,
        separation,
        give,
        hovers,
        ~hovers,
        planes,
        {},
        FAR,
    )


def flown(crowd, found):
    times = sampled(DURATION, INTERVALS)
    return crowd.places + found.aside(np.arange(len(crowd.places)), times)


@pytest.mark.parametrize("shape", ["sphere", "any-axis"])
def test_a_ring_of_drones_that_swap_is_parted(shape):
    angle = 2.0 * np.pi * np.arange(8) / 8 + 0.1
    start = 6.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    separation = Separation(1.0, shape)
    crowd = crowd_of(start, -start, separation)
    found = untangle(crowd)
    assert found.broken == 0
    places = flown(crowd, found)
    first, second = np.triu_indices(8, 1)
    assert measure(places[first] - places[second], separation).min() >= 1.0
    np.testing.assert_allclose(places[:, [0, -1]], crowd.places[:, [0, -1]], atol=1e-9)


class Recording(InProcess):
    """Hears which beginnings are followed at once, and what comes out."""

    def __init__(self):
        super().__init__()
        self.begun, self.found = [], []

    def run(self, function, tasks, *heard):
        found = super().run(function, tasks, *heard)
        self.begun.append([beginning for _, beginning in tasks])
        self.found += found
        return found


def test_beginnings_are_followed_two_at_once_until_both_are_in_vain():
    start = np.array([[-4.5, 0.0, 0.0], [4.5, 0.3, 0.0], [0.0, -4.0, 0.2]])
    # Their time is too short to go round each other.
    crowd, workers = crowd_of(start, -start, Separation(1.0), duration=1.8), Recording()
    found = quickest(crowd, workers)
    seeds = [seed for pair in workers.begun for seed in pair]
    assert seeds == list(range(2 * len(workers.begun)))
    assert len(workers.begun) > 1
    times = [one.duration for one in workers.found]
    least = np.minimum.accumulate(times)[1::2]
    assert np.all(least[1:-1] < 0.997 * least[:-2])
    assert least[-1] > 0.997 * least[-2]
    assert found.duration == least[-1] > 1.003 * crowd.duration
    assert found.work == sum(one.work for one in workers.found)


def test_where_a_beginning_needs_no_more_time_no_other_is_followed():
    start = np.array([[-4.5, 0.0, 0.0], [4.5, 0.3, 0.0], [0.0, -4.0, 0.2]])
    crowd, workers = crowd_of(start, -start, Separation(1.0)), Recording()
    found = quickest(crowd, workers)
    assert workers.begun == [[0, 1]]
    assert found.wrong == 0.0
    assert crowd.duration <= found.duration < 1.003 * crowd.duration


@pytest.mark.parametrize(("duration", "others"), [(1.8, [[0, 1]]), (DURATION, [])])
def test_what_was_tried_in_the_crowds_own_time_is_the_first_beginning(duration, others):
    level = np.mgrid[-2:3, -1:3].reshape(2, -1).T * 1.4
    start = np.column_stack([level, np.zeros(20)])
    crowd = crowd_of(start, -start, Separation(1.0), duration=duration)
    tried, workers = untangle(crowd, free=True, onward=True), Recording()
    # What little time allows is not flown, but its limits are nearly kept.
    assert (tried.wrong > 3.0) == bool(others)
    found = quickest(crowd, workers, tried)
    assert workers.begun[: 1 + len(others)] == [[tried], *others]
    assert len(workers.begun) == 1 or others
    assert not untangling.hopeless(found)
    assert found.work == sum(one.work for one in workers.found)


@pytest.mark.parametrize(
    ("drones", "onward", "broken"),
    [
        (13, True, 20.0),
        (13, False, 9.0),
        (12, True, 9.0),
    ],
)
def test_many_that_nothing_parts_go_on_in_more_time_from_changes_nearest_to_limits(
    drones, onward, broken, monkeypatch
):
    searches = Changed(9.0, 0.3), Changed(20.0, 0.1)
    monkeypatch.setattr(untangling, "_searches", lambda *_, **__: iter(searches))
    start = np.zeros((drones, 3))
    start[:, 0] = 2.0 * np.arange(drones)
    crowd = crowd_of(start, -start, Separation(1.0))
    assert untangle(crowd, free=True, onward=onward).broken == broken


def test_few_begin_with_random_ways_in_more_time():
    start = 4.0 * np.array([[-1.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.0, -1.0, 0.1]])
    crowd, workers = crowd_of(start, -start, Separation(1.0)), Recording()
    quickest(crowd, workers, untangle(crowd, free=True, onward=True))
    assert workers.begun[0] == [0, 1]


def test_ways_of_a_beginning_are_flown_sooner_and_keep_apart():
    level = np.mgrid[-2:3, -1:3].reshape(2, -1).T * 1.4
    start = np.column_stack([level, np.zeros(20)])
    # Its time is too short to go round each other.
    crowd = crowd_of(start, -start, Separation(1.0), duration=1.8)
    workers = Recording()
    found = quickest(crowd, workers)
    assert found.wrong == 0.0
    first = [Elastic(crowd, k).run((1.1, 1.3)[k % 2]).duration for k in range(2)]
    assert found.duration < 0.985 * min(first)


class Changed:
    """A search that ends with changes in which two drones lack and pass so much."""

    def __init__(self, broken, excess):
        self.found = Untangled(
            1.0, np.zeros((2, 3, 3)), (NONE, NONE), broken, np.full(2, excess), 1.0
        )
        self.runs = 0

    def run(self):
        self.runs += 1
        return self.found


@pytest.mark.parametrize(
    ("anew", "broken", "excess", "runs"),
    [
        # About others that fly, limits that are passed a little lack nothing.
        (False, 0.0, 0.1, [1, 0]),
        (False, 0.0, 0.2, [1, 1]),
        (False, 1.0, 0.0, [1, 1]),
        (True, 0.0, 0.0, [1, 0]),
        (True, 2.0, 0.1, [1, 1]),
    ],
)
def test_no_other_changes_are_sought_where_none_lack_less(
    monkeypatch, anew, broken, excess, runs
):
    searches = Changed(broken, excess), Changed(0.0, 0.0)
    monkeypatch.setattr(untangling, "_searches", lambda *_, **__: iter(searches))
    start = np.array([[-4.5, 0.0, 0.0], [4.5, 0.3, 0.0]])
    found = untangle(crowd_of(start, -start, Separation(1.0)), anew=anew)
    assert [search.runs for search in searches] == runs
    assert found.work == sum(runs)
    assert np.all(found.excess == searches[sum(runs) - 1].found.excess)


def test_a_line_that_swaps_about_one_that_hovers_leaves_it_in_place():
    start = np.array([[-4.5, 0.0, 0.0], [4.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    crowd = crowd_of(start, start * [-1.0, 1.0, 1.0], Separation(1.0))
    found = untangle(crowd)
    assert found.broken == 0
    assert np.abs(found.coefficients[2]).max() == 0.0
    assert np.abs(found.coefficients).max() < 3.0


def test_planes_hold_a_drone_that_makes_way():
    start = np.array([[-4.5, 0.0, 0.0], [4.5, 0.0, 0.0]])
    count = sampled(DURATION, INTERVALS).size
    planes = Planes(
        np.zeros(count, dtype=np.int64),
        np.arange(count),
        np.repeat([[0.0, 1.0, 0.0]], count, axis=0),
        np.full(count, -0.2),
    )
    crowd = crowd_of(start, start[::-1], Separation(1.0), planes)
    found = untangle(crowd)
    assert found.broken == 0
    assert flown(crowd, found)[0, :, 1].min() > -0.23
