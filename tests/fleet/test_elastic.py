"""Ways through a fourth dimension: slopes, limits, planes, and what is lacking."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.optimize
from fleet.handmade import LIMITS, VEHICLE
from fleet.test_untangling import INTERVALS, crowd_of, flown

from showc.fleet.deconfliction import elastic
from showc.fleet.deconfliction.crowd import Allowed, Planes, sampled
from showc.fleet.deconfliction.elastic import Elastic
from showc.fleet.single_drone.model import Aircraft
from showc.vehicle import Separation
from showc.vehicle.metric import measure

CUBE = np.array(np.meshgrid(*[np.arange(2) - 0.5] * 3)).reshape(3, -1).T
SHAPES = [
    Separation(1.0),
    Separation(1.0, "ellipsoid", 2.0),
    Separation(1.0, "any-axis"),
]


def quicker(crowd, pace):
    """Return the same flights in less time."""
    return replace(
        crowd,
        times=crowd.times / pace,
        speeds=crowd.speeds * pace,
        pulls=crowd.pulls * pace**2,
        jerks=crowd.jerks * pace**3,
        duration=crowd.duration / pace,
    )


@pytest.mark.parametrize("separation", SHAPES, ids=lambda one: one.shape)
@pytest.mark.parametrize(("axes", "pace"), [(3, 1.0), (4, 1.0), (3, 2.5)])
def test_the_slope_of_the_price_is_that_of_differences(separation, axes, pace):
    count = sampled(6.0, INTERVALS).size
    planes = Planes(
        np.zeros(count, dtype=np.int64),
        np.arange(count),
        np.repeat([[0.0, 1.0, 0.0]], count, axis=0),
        np.full(count, 0.1),
    )
    crowd = crowd_of(12.0 * CUBE, -12.0 * CUBE, separation, planes)
    level = replace(crowd.allowed, level=(np.inf, 6.0, 8.0, 60.0))
    # In less time drones use more than limits when they fly alone.
    ways = Elastic(quicker(replace(crowd, allowed=level), pace))
    shape = (ways.factor.shape[1], 8, axes)
    draw = np.random.default_rng(1)
    inner, step = draw.standard_normal((2, math.prod(shape) + 1))
    price, lift = 300.0, 0.1

    def cost(share):
        # Pairs that are looked at stay the same.
        there = inner + share * step
        return ways._cost(there, shape, price, lift, 100.0)

    slope = float(cost(0.0)[1] @ step)
    small = 1e-6
    rise = (cost(small)[0] - cost(-small)[0]) / (2.0 * small)
    assert rise == pytest.approx(slope, rel=2e-3)


@pytest.mark.parametrize("separation", SHAPES[:2], ids=lambda one: one.shape)
def test_drones_that_all_meet_in_one_point_are_parted(separation):
    crowd = crowd_of(9.0 * CUBE, -9.0 * CUBE, separation)
    found = Elastic(crowd).run()
    assert found.broken == 0
    places = flown(crowd, found)
    first, second = np.triu_indices(8, 1)
    assert measure(places[first] - places[second], separation).min() >= 1.0
    np.testing.assert_allclose(places[:, [0, -1]], crowd.places[:, [0, -1]], atol=1e-9)
    assert found.excess.max() < 0.02


def test_what_is_lacking_says_by_how_much_there_is_too_little_room():
    gaps = []
    for size in (0.55, 0.7, 1.0):
        # A drone passes between two that cannot move.
        start = np.array([[-4.0, 0.0, 0.0], [0.0, size, 0.0], [0.0, -size, 0.0]])
        crowd = crowd_of(start, start * [-1.0, 1.0, 1.0], Separation(1.0))
        crowd.give[1:] = 0.0
        # Nor may it go above or below.
        crowd.give[0] = np.diag([1.0, 0.0, 0.0])
        gaps.append(Elastic(crowd).run().broken)
    assert gaps[0] >= gaps[1] > 0.0 == gaps[2]


def test_where_the_time_is_free_limits_and_distances_say_how_long_it_is():
    times = []
    for pace in (3.0, 3.4):
        crowd = crowd_of(3.0 * CUBE, -3.0 * CUBE, Separation(1.0))
        quick = quicker(crowd, pace)
        found = Elastic(quick, 1).run(1.3)
        assert found.broken == 0
        assert found.excess.max() < 0.02
        assert found.duration >= quick.duration
        times.append(found.duration)
    # Whatever it begins from, the time is that of the drones.
    assert times[1] == pytest.approx(times[0], rel=0.05)


@pytest.fixture
def steps(monkeypatch):
    """Collect how many steps each stage may take, of which it takes three."""
    minimize, asked = scipy.optimize.minimize, []

    def counting(*task, options, **means):
        asked.append(options["maxiter"])
        return minimize(*task, options=options | {"maxiter": 3}, **means)

    monkeypatch.setattr(scipy.optimize, "minimize", counting)
    return asked


@pytest.mark.parametrize(
    ("slower", "wrong", "stages"), [(1.1, 0.0, 5), (1.1, 0.3, 6), (None, 0.0, 6)]
)
def test_where_the_time_is_free_the_last_stage_only_mends(
    monkeypatch, steps, slower, wrong, stages
):
    monkeypatch.setattr(Elastic, "_judged", lambda *_: SimpleNamespace(wrong=wrong))
    start = np.array([[-6.0, 0.3, 0.0], [6.0, -0.3, 0.0]])
    ways = Elastic(crowd_of(start, start * [-1.0, 1.0, 1.0], Separation(1.0)))
    assert ways.run(slower).wrong == wrong
    assert len(steps) == stages


@pytest.mark.parametrize(
    ("drones", "slower", "share"),
    [(2, 1.1, 1 / 3), (24, 1.1, 2 / 3), (40, 1.1, 1.0), (2, None, 1.0)],
)
def test_few_drones_take_fewer_steps_where_the_time_is_free(
    monkeypatch, steps, drones, slower, share
):
    monkeypatch.setattr(Elastic, "_judged", lambda *_: SimpleNamespace(wrong=1.0))
    start = np.column_stack([9.0 * np.arange(drones), *np.zeros((2, drones))])
    Elastic(crowd_of(start, start + [0.0, 9.0, 0.0], Separation(1.0))).run(slower)
    most = [stage[-1] for stage in elastic._STAGES]
    assert steps == [round(share * one) for one in most]


def test_what_drones_use_when_they_fly_alone_slows_nothing():
    start = np.array([[-6.0, 0.3, 0.0], [6.0, -0.3, 0.0]])
    goal = start * [-1.0, 1.0, 1.0]
    crowd = quicker(crowd_of(start, goal, Separation(1.0)), 1.5)
    # As of drones that lift before and fall then, to be sooner there.
    crowd.pulls[:, 8:20, 2] -= 9.0
    found = Elastic(crowd, 1).run(1.1)
    assert found.wrong == 0.0
    assert found.duration < 1.005 * crowd.duration


def test_a_drone_that_may_not_move_stays():
    crowd = crowd_of(9.0 * CUBE, -9.0 * CUBE, Separation(1.0))
    crowd.give[3] = 0.0
    found = Elastic(crowd).run()
    assert np.abs(found.coefficients[3]).max() == 0.0
    assert found.broken == 0


def test_ways_that_are_known_are_kept_to():
    crowd = crowd_of(9.0 * CUBE, -9.0 * CUBE, Separation(1.0))
    before = flown(crowd, Elastic(crowd, 1).run())
    after = flown(crowd, Elastic(crowd, known=before - crowd.places).run())
    first, second = np.triu_indices(8, 1)
    gaps = [places[first] - places[second] for places in (before, after)]
    # Every pair passes on the side that it did.
    assert np.einsum("pma,pma->pm", *gaps).min() > 0.0


def test_no_rate_passes_its_share_of_accelerations_and_jerks():
    draw = np.random.default_rng(5)
    pulls = draw.normal(0.0, 4.0, (500, 40, 3))
    jerks = draw.normal(0.0, 20.0, (500, 40, 3))
    for heading in (0.0, 0.7):
        allowed = Allowed.of(Aircraft(VEHICLE, LIMITS, heading=heading))
        most = allowed.turning(pulls, jerks)
        shares = [np.abs(share) for share, _, _ in allowed.turned(pulls, jerks)]
        assert np.all(np.max(shares, axis=0) <= most * (1.0 + 1e-12))
        assert np.max(shares[1] / most) > 0.99
