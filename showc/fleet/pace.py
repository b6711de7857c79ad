"""Pace: how long a move takes where the script leaves its time open."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.leg import aircraft_of, fleet_of
from showc.fleet.shared_profile.sparing import sparing_time
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.fleet.single_drone.vertical import quickest_ascent
from showc.script.lanes import whole_milliseconds

if TYPE_CHECKING:
    from showc.fleet.shared_profile.profile import Profile
    from showc.plan.itinerary import Leg
    from showc.script.show import Show

_INSTANT = 1e-3
"""Time of a move in which every drone stays [s]."""
_TILTING = 1.0
"""Time to tilt to and fro, at about 0.25 s for each of four quarters [s]."""


def straight_time(leg: Leg, show: Show) -> float:
    """Time of the quickest flight of all drones side by side on straight lines [s].

    It keeps every limit; whether drones keep apart on it is another question.
    """
    if not np.any(leg.goal != leg.start):
        return _INSTANT
    if leg.kind in {"launch", "land"}:
        heights = (leg.goal - leg.start)[:, 2]
        return quickest_ascent(aircraft_of(show, leg), heights).duration
    return _quickest(leg, show).duration


def _quickest(leg: Leg, show: Show) -> Profile:
    return shared_profile(show.vehicle, leg.limits, show.heading, leg.start, leg.goal)


def preferred_time(leg: Leg, show: Show, room: float) -> float:
    """Whole milliseconds that a move is to take where there is ``room`` [s]."""
    return whole_milliseconds(_preferred(leg, show, room))


def _preferred(leg: Leg, show: Show, room: float) -> float:
    if not (np.any(leg.goal != leg.start) or leg.in_motion):
        return _INSTANT
    if leg.prefer == "energy" and math.isfinite(room):
        return sparing_time(fleet_of(show, leg), _quickest(leg, show), room)
    # A group beside others takes straight ways: as short as can be is theirs. So it is
    # for energy where nothing says when the move ends: to stay in the air costs most.
    pace = 1.0 if isinstance(leg.prefer, str) else leg.prefer
    return pace * (straight_time(leg, show) + _turning_time(leg, show))


def _turning_time(leg: Leg, show: Show) -> float:
    """Time that velocities at the ends of a leg need beyond a straight flight [s].

    A point that stops from a speed v and returns to where it was needs (1 + sqrt 2)
    v / a; the drone tilts to and fro meanwhile.
    """
    states = [one for one in (leg.start_state, leg.goal_state) if one is not None]
    if not states:
        return 0.0
    speeds = np.sum([np.linalg.norm(one[:, 3:6], axis=1) for one in states], axis=0)
    gain = leg.limits.acceleration or show.vehicle.gravity * math.tan(leg.limits.tilt)
    return _TILTING + (1.0 + math.sqrt(2.0)) * float(speeds.max()) / gain
