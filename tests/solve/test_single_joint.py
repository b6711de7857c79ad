"""A few drones together: apart at every instant, flyable, lazily constrained."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from showc.solve.audit import greatest_excess
from showc.solve.joint import joint, pair_distance_bound
from showc.solve.replay import replay
from showc.solve.single import Aircraft
from showc.vehicle import PRESETS, Separation

PRESET = PRESETS["formation-625g"]
HELD = Aircraft(PRESET.vehicle, PRESET.limits)
SPHERE = Separation(1.0)
LEFT, RIGHT = np.array([-5.0, 0.0, 20.0]), np.array([5.0, 0.0, 20.0])


def sampled(flights, scale, times):
    ways = [flight.state(times)[:, :3] * scale for flight in flights]
    return np.linalg.norm(ways[0] - ways[1], axis=1)


def test_two_drones_that_change_places_pass_each_other():
    start, goal = np.stack([LEFT, RIGHT]), np.stack([RIGHT, LEFT])
    result = joint(HELD, start, goal, SPHERE, 3.4)
    assert result.solved and result.pairs == ((0, 1),)
    errors = replay(HELD.vehicle, result.trajectories)
    assert errors.position.max() < 1e-3
    distance = sampled(result.trajectories, 1.0, np.linspace(0.0, 3.4, 5001))
    bound = pair_distance_bound(*result.trajectories, SPHERE)
    assert 1.0 - 1e-9 <= bound <= distance.min()
    assert distance.min() < 2.5
    for flight, first, last in zip(result.trajectories, start, goal, strict=True):
        assert greatest_excess(HELD, flight).relative < 1e-9
        assert np.array_equal(flight.state.coefficients[0, 0, :3], first)
        assert np.array_equal(flight.state.coefficients[-1, -1, :3], last)


def test_idle_pairs_are_not_constrained():
    start = np.stack([LEFT, LEFT + [0.0, 3.0, 0.0]])
    result = joint(HELD, start, start + [6.0, 0.0, 0.0], SPHERE, 4.0)
    assert result.solved and result.pairs == () and result.solves == 1


def test_downwash_is_kept_in_the_metric_of_the_ellipsoid():
    tall = Separation(1.0, "ellipsoid", 2.0)
    start, goal = np.stack([LEFT, RIGHT]), np.stack([RIGHT, LEFT])
    result = joint(HELD, start, goal, tall, 4.0)
    assert result.solved
    scale = np.array([1.0, 1.0, 0.5])
    distance = sampled(result.trajectories, scale, np.linspace(0.0, 4.0, 5001))
    assert distance.min() > 1.0 - 1e-9


@pytest.mark.parametrize("shape", ["any-axis", "all-axes"])
def test_other_forms_are_refused(shape):
    result = joint(HELD, LEFT[None], RIGHT[None], replace(SPHERE, shape=shape), 4.0)
    assert result.status == "limit" and shape in result.message
