"""A few drones planned together: apart at every instant, flyable, where it pays."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from solve.handmade import Listening, make_leg, make_options, make_show

from showc.solve import solve_leg
from showc.solve.audit import greatest_excess
from showc.solve.joint import FEW, fly_jointly, suits
from showc.solve.pool import InProcess
from showc.solve.replay import replay
from showc.solve.single import Aircraft
from showc.vehicle import PRESETS, Separation

PRESET = PRESETS["formation-625g"]
WIDE = replace(
    PRESET.limits,
    position_min=(-200.0, -200.0, -1.0),
    position_max=(200.0, 200.0, 200.0),
)
HELD = Aircraft(PRESET.vehicle, WIDE)
FREE = replace(HELD, yaw="free")
SPHERE = Separation(1.0)


def crossing(count=3):
    """Drones side by side that arrive in the opposite order."""
    start = np.array([[0.0, 2.0 * k, 20.0] for k in range(count)])
    return start, start[::-1] + [28.0, 9.0, 5.0]


def nearest(flights, scale=1.0):
    times = np.linspace(0.0, flights[0].state.end, 20_001)
    ways = [flight.state(times)[:, :3] * scale for flight in flights]
    return min(np.linalg.norm(a - b, axis=1).min() for a, b in combinations(ways, 2))


def check(aircraft, flights, start, goal):
    assert replay(aircraft.vehicle, flights).position.max() < 1e-3
    for flight, first, last in zip(flights, start, goal, strict=True):
        assert greatest_excess(aircraft, flight).relative < 1e-9
        assert np.array_equal(flight.state.coefficients[0, 0, :3], first)
        assert np.array_equal(flight.state.coefficients[-1, -1, :3], last)


@pytest.mark.parametrize(
    "separation", [SPHERE, Separation(1.0, "ellipsoid", 2.0)], ids=lambda s: s.shape
)
def test_crossing_drones_keep_apart(separation):
    start, goal = crossing()
    found = fly_jointly(HELD, start, goal, separation)
    assert found.solved, found.message
    assert found.duration == pytest.approx(1.003 * found.least, abs=1e-3)
    assert found.duration * 1000.0 == pytest.approx(round(found.duration * 1000.0))
    check(HELD, found.trajectories, start, goal)
    assert nearest(found.trajectories, np.array(separation.metric_scale)) >= 1.0


def test_a_leg_says_that_its_drones_were_planned_together():
    start, goal = crossing()
    leg = make_leg(start, goal, limits=WIDE)
    listening = Listening()
    show = make_show(3, yaw="free")
    flight = solve_leg(leg, show, make_options(), InProcess(), listening)
    assert "planned together" in flight.certificate.method
    assert flight.certificate.statistics["joint_solves"] > 0
    assert any("planned together" in title for title, _ in listening.stages)
    assert flight.duration < 1.0045 * flight.certificate.single_drone_minimum
    check(Aircraft(show.vehicle, WIDE, "free"), flight.trajectories, start, goal)
    assert nearest(flight.trajectories) >= 1.0


def test_a_parked_drone_is_not_planned_around():
    """A flight that comes too near one is no result."""
    start, goal = crossing(2)
    free = fly_jointly(HELD, start, goal, SPHERE)
    assert free.solved and nearest(free.trajectories) >= 1.0
    parked = free.trajectories[0].state(0.4 * free.duration)[None, :3]
    found = fly_jointly(HELD, start, goal, SPHERE, parked)
    assert not found.solved and "parked" in found.message


def test_where_it_suits():
    start, goal = crossing()
    assert suits(FREE, SPHERE, start, goal, 7.0)
    assert not suits(HELD, SPHERE, start, goal, 7.0)
    assert not suits(FREE, SPHERE, start, goal, 4.0)
    assert not suits(FREE, SPHERE, start, start + [28.0, 9.0, 5.0], 7.0)
    assert not suits(FREE, Separation(1.0, "any-axis"), start, goal, 7.0)
    assert not suits(FREE, SPHERE, *crossing(FEW + 1), 7.0)
    still = goal.copy()
    still[1] = start[1]
    assert not suits(FREE, SPHERE, start, still, 7.0)


def test_a_goal_outside_the_volume_is_named():
    start, goal = crossing()
    found = fly_jointly(HELD, start, goal + [500.0, 0.0, 0.0], SPHERE)
    assert not found.solved and "drone 1" in found.message
