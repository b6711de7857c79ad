"""Missions keep volume, fence and time, in the planner and by the proof."""

from dataclasses import replace

import numpy as np
import pytest
from mission.flights import shift_flight
from mission.planted import Case

from showc.autopilot.timing import TUBES, Timing, tube
from showc.errors import ExportError
from showc.flight import Flight
from showc.mission import mission_files
from showc.mission.feasibility import mission_outlook
from showc.plan.itinerary import Itinerary
from showc.verify.missions import law


def at_site(flight, **changes):
    show = flight.itinerary.show
    show = replace(show, site=replace(show.site, **changes))
    return Flight(Itinerary(show, flight.itinerary.legs), flight.legs, flight.starts)


def l_shape(corner):
    """A fence with an inner corner at (6, ``corner``): its notch is up and left."""
    inner = [[6.0, 14.0], [6.0, corner], [-6.0, corner]]
    return np.array([[-6.0, -6.0], [20.0, -6.0], [20.0, 14.0], *inner])


def test_missions_inside_a_concave_fence_are_proved(tmp_path):
    # The shift by (12, 8) m passes the inner corner at 1.66 m.
    fence = l_shape(6.0)
    case = Case(tmp_path, at_site(shift_flight(1), fence=fence, fence_margin=1.0))
    assert case.failures() == set()
    spare = case.checks()["VRF416"].value
    assert spare == pytest.approx(0.66, abs=0.01)
    case.show.rules.site.fence_margin = 1.7
    assert case.failures() == {"VRF416"}
    assert case.checks()["VRF416"].where.drone == 1


@pytest.mark.parametrize(("corner", "margin"), [(3.5, 0.0), (6.0, 1.8)])
def test_missions_that_would_leave_the_fence_are_refused(corner, margin):
    flight = at_site(shift_flight(1), fence=l_shape(corner), fence_margin=margin)
    with pytest.raises(ExportError, match=r"fence \(drone 1"):
        mission_files(flight)
    notes = mission_outlook(flight.itinerary).notes
    assert any("leave the flight volume or the fence" in note for note in notes)


def test_slots_wait_for_drones_that_wind_delays(tmp_path):
    slots = {}
    for wind in (0.0, 3.0, 5.0, 8.0):
        case = Case(tmp_path / f"{wind}", at_site(shift_flight(3), wind=wind))
        assert case.failures() == set()
        slots[wind] = [leg["slot"] for leg in case.missions.prediction["legs"]]
    assert slots[0.0] < slots[3.0] == slots[5.0] < slots[8.0]
    # Less wind than the script states makes a slot that is reached too late.
    calm = Case(tmp_path / "calm", shift_flight(3))
    windy = replace(calm.script, site=replace(calm.script.site, wind=8.0))
    failed = {c for c, check in calm.checks(windy).items() if check.verdict == "fail"}
    assert "VRF408" in failed


def test_more_wind_than_was_measured_is_refused():
    flight = at_site(shift_flight(2), wind=9.0)
    with pytest.raises(ExportError, match="not measured"):
        mission_files(flight)
    assert mission_outlook(flight.itinerary).refused


def test_the_checker_has_the_same_measurements():
    assert law.KNOWN["tubes"] == [
        {
            "wind": row.wind,
            "off": [list(band) for band in row.bands],
            "late": [row.late, row.late_fast],
        }
        for row in TUBES
    ]
    speeds = np.linspace(0.1, 8.5, 200)
    for wind in (0.0, 4.0, 8.0):
        timing = Timing(wind=wind)
        spread, late = law._tubes(speeds, wind)
        np.testing.assert_allclose(spread, timing.spread(speeds))
        np.testing.assert_allclose(late, timing.late(speeds))
        assert np.all(late <= tube(wind).late_fast)


def test_what_missions_cannot_carry_is_known_before_the_solve():
    flight = shift_flight(2)
    assert mission_outlook(flight.itinerary).refused == ()
    show = flight.itinerary.show
    small = replace(show, mission=replace(show.mission, autopilot="px4"))
    notes = mission_outlook(Itinerary(small, flight.itinerary.legs)).notes
    assert any("PX4" in note for note in notes)
