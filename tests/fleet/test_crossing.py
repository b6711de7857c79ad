"""A few drones whose ways cross: apart at every instant, all near the least time."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from fleet.handmade import Listening, make_leg, make_options, make_show

from showc.errors import SolveError
from showc.fleet import solve_leg
from showc.fleet.execution.pool import InProcess
from showc.fleet.single_drone.audit import greatest_excess
from showc.fleet.single_drone.model import Aircraft
from showc.fleet.single_drone.replay import replay
from showc.vehicle import PRESETS

WIDE = replace(
    PRESETS["formation-625g"].limits,
    position_min=(-200.0, -200.0, -1.0),
    position_max=(200.0, 200.0, 200.0),
)


def fly(start, goal, *, yaw):
    show = make_show(len(start), yaw=yaw)
    leg = make_leg(start, goal, limits=WIDE)
    found = solve_leg(leg, show, make_options(), InProcess(), Listening())
    return Aircraft(show.vehicle, WIDE, yaw), found


@pytest.mark.parametrize("yaw", ["free", "held"])
def test_crossing_drones_are_apart_at_every_instant_and_soon_there(yaw):
    start = np.array([[0.0, 2.0 * k, 20.0] for k in range(3)])
    goal = start[::-1] + [28.0, 9.0, 5.0]
    aircraft, found = fly(start, goal, yaw=yaw)
    flights = found.trajectories
    assert found.duration <= 1.0045 * found.certificate.single_drone_minimum
    assert replay(aircraft.vehicle, flights).position.max() < 1e-3
    for flight, first, last in zip(flights, start, goal, strict=True):
        assert greatest_excess(aircraft, flight).relative < 1e-9
        assert np.array_equal(flight.state.coefficients[0, 0, :3], first)
        assert np.array_equal(flight.state.coefficients[-1, -1, :3], last)
    times = np.linspace(0.0, found.duration, 20_001)
    ways = [flight.state(times)[:, :3] for flight in flights]
    gaps = [np.linalg.norm(a - b, axis=1).min() for a, b in combinations(ways, 2)]
    assert min(gaps) >= 1.0
    assert found.certificate.closest.distance == pytest.approx(min(gaps), abs=1e-4)


def test_a_goal_outside_the_volume_is_named():
    start = np.array([[0.0, 2.0 * k, 20.0] for k in range(3)])
    with pytest.raises(SolveError, match="drone 1"):
        fly(start, start[::-1] + [528.0, 9.0, 5.0], yaw="free")
