"""Flights that swing beside their lines are slowed until the proof has room."""

from dataclasses import replace

import numpy as np
from mission.flights import shift_flight

from showc.autopilot.parameters import Parameters
from showc.autopilot.stage import StageBuilder
from showc.autopilot.timing import Timing
from showc.geodesy import SiteFrame
from showc.progress import Silent
from showc.schedule import layout
from showc.schedule.course import Course
from showc.schedule.tubes import BESIDE, off_end, room_used
from showc.script.show import MissionOptions


def timeline(shift, options=None):
    """Two drones fly along ``shift`` [m] and come back, at up to 8 m/s."""
    flight = shift_flight(2, shift, options=options)
    fast = {"velocity_min": (-8.0, -8.0, -8.0), "velocity_max": (8.0, 8.0, 8.0)}
    # The autopilot's own time counts, not that of a slower solved flight.
    legs = tuple(
        replace(
            item,
            duration=1.0,
            leg=replace(item.leg, limits=replace(item.leg.limits, **fast)),
        )
        if item.leg.kind in {"transition", "approach"}
        else item
        for item in flight.legs
    )
    builder = StageBuilder(
        SiteFrame(47.0, 8.0, 400.0, 0.0), np.full(2, 400.0), Parameters()
    )
    show = flight.itinerary.show
    if options:
        legs = tuple(item for item in legs if item.leg.kind != "hold")
    course = Course.of(show, [item.leg for item in legs], replace(flight, legs=legs))
    return layout.build_timeline(show, course, builder, Silent(), jobs=1)


STEEP = (40.0, 2.0, 28.0)
"""35 degrees upwards along 49 m [m]."""


def most_used(found):
    return max(
        float(room_used(stage, track, Timing()).max())
        for leg in found.legs
        for _, stage, track in leg.tracked
    )


def top_speed(found):
    return max(
        stage.profile.speed.max() for leg in found.legs for _, stage in leg.flown
    )


def test_fast_climbs_are_slowed_until_their_swing_is_within_the_proof(monkeypatch):
    slowed = timeline(STEEP)
    assert most_used(slowed) <= layout.FULL
    monkeypatch.setattr(layout, "FULL", np.inf)
    fast = timeline(STEEP)
    assert most_used(fast) > 1.0
    # No slower than they must be.
    assert 0.8 * top_speed(fast) < top_speed(slowed) < top_speed(fast)


def test_drones_settle_before_they_fly_on_however_little_slack_there_is():
    # As far off as a leg begins, it is left however slowly it is flown: these were
    # slowed twelve times, and refused.
    settled = timeline((24.0, 0.0, 8.0), MissionOptions(slack=0.0))
    off = [off_end(track).max() for leg in settled.legs for track in leg.tracks]
    assert 0.5 * BESIDE < max(off) <= BESIDE
    assert top_speed(settled) > 7.0
