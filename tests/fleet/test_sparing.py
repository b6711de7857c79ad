"""Moves that prefer energy cost less, keep all limits, and say what they save."""

from dataclasses import replace

import numpy as np
import pytest

from showc.fleet.execution.pool import InProcess
from showc.fleet.leg import aircraft_of, fleet_of, solve_leg
from showc.fleet.options import SolveOptions
from showc.fleet.shared_profile.flat import keeps_limits
from showc.fleet.shared_profile.sparing import (
    flown_energy,
    sparing_profile,
    sparing_time,
)
from showc.fleet.shared_profile.straight import fly_straight
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.plan import build_itinerary
from showc.progress import Silent
from showc.script import read_show

SCRIPT = b"""\
showc: 1
drones: 3
prefer: energy
formations:
  row: {type: line, length: 8, centre: [0, 0, 12]}
  up: {type: line, length: 8, centre: [20, 10, 40]}
transitions:
  - {to: row}
  - {to: up, duration: 25}
"""


@pytest.fixture(scope="module")
def show():
    return read_show(SCRIPT).show


@pytest.fixture(scope="module")
def leg(show):
    return next(one for one in build_itinerary(show).legs if one.to_formation == "up")


@pytest.fixture(scope="module")
def quickest(show, leg):
    return shared_profile(show.vehicle, leg.limits, show.heading, leg.start, leg.goal)


def fly(show, leg, profile):
    return fly_straight(show.vehicle, show.heading, leg.start, leg.goal, profile)


def test_the_model_of_straight_flights_is_that_of_what_is_flown(show, leg, quickest):
    # But for the torques that turn the drones.
    fleet = fleet_of(show, leg)
    for profile in (quickest, quickest.stretched(25.0)):
        flights = fly(show, leg, profile)
        rows = [flights.trajectory(row) for row in range(3)]
        assert fleet.energy(profile) == pytest.approx(
            flown_energy(fleet, rows), rel=5e-4
        )


def test_hovering_costs_the_hover_power(show, leg, quickest):
    fleet = fleet_of(show, replace(leg, goal=leg.start))
    power = 3 * show.battery.hover_power
    # Default sites lie at 488 m: thin air takes a little more.
    assert power < fleet.hover < 1.03 * power
    assert fleet.energy(quickest) == pytest.approx(fleet.hover * quickest.duration)


def test_the_sparing_profile_costs_less_and_keeps_all_limits(show, leg, quickest):
    fleet = fleet_of(show, leg)
    found = sparing_profile(fleet, quickest, 25.0)
    assert found.duration == pytest.approx(25.0)
    assert fleet.energy(found) < fleet.energy(quickest.stretched(25.0))
    at_once = fleet.energy(quickest) + fleet.hover * (25.0 - quickest.duration)
    assert fleet.energy(found) < 0.995 * at_once
    assert keeps_limits(show.vehicle, leg.limits, fly(show, leg, found)).all()


def test_no_time_that_was_tried_costs_less(show, leg, quickest):
    fleet = fleet_of(show, leg)
    room = 40.0
    time = sparing_time(fleet, quickest, room)

    def cost(duration):
        profile = sparing_profile(fleet, quickest, duration)
        return fleet.energy(profile) + fleet.hover * (room - duration)

    others = np.linspace(quickest.duration, room, 7)
    assert cost(time) <= min(cost(one) for one in others) * (1.0 + 1e-4)
    # Without slack there is nothing to choose.
    assert sparing_time(fleet, quickest, 1.0) == 1.0
    assert sparing_profile(fleet, quickest, 1.0) is quickest


def test_a_solved_leg_says_what_it_saved(show, leg):
    flight = solve_leg(leg, show, SolveOptions(), InProcess(), Silent())
    said = flight.certificate.statistics
    assert flight.duration == 25.0
    assert said["energy"] == pytest.approx(
        flown_energy(fleet_of(show, leg), flight.trajectories), abs=0.1
    )
    assert said["energy"] < said["energy_at_once"]
    assert aircraft_of(show, leg).limits == leg.limits


def test_plan_and_page_say_what_is_saved_and_verify_proves_it(tmp_path, run_showc):
    script, log = tmp_path / "spare.yaml", tmp_path / "spare.mcap"
    script.write_bytes(SCRIPT + b"mission: {wanted: false}\n")
    assert "saves about" in run_showc("plan", script).out
    assert run_showc("compile", "-q", script, "-o", log).code == 0
    assert run_showc("verify", log).code == 0
    run_showc("safety", log)
    page = log.with_name("spare-safety.html").read_text(encoding="utf-8")
    assert "Move that saves energy" in page
