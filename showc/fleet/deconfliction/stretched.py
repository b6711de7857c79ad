"""A crowd's ways flown slowly enough: the flight that exists once ways are found.

Ways that keep apart keep apart at any pace, so the pace can fall until every drone
keeps its limits. No optimal control is involved; what is found bounds the common time
from above, and the search for a shorter one can end at any time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.conflicts import conflicts
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.deconfliction.ways import find_ways
from showc.fleet.shared_profile.flat import fly, joined, keeps_limits

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.deconfliction.ways import Ways
    from showc.fleet.shared_profile.flat import FlatFlights
    from showc.fleet.shared_profile.profile import Profile
    from showc.fleet.single_drone.single import Aircraft
    from showc.flight import Trajectory
    from showc.vehicle import Separation


_SLOWEST = 8.0
"""Time over that of the straight lines beyond which no pace is looked for."""

_HALVINGS = 8
"""Halvings of the pace: the time is found to a part in 256 of what is searched."""


@dataclass(frozen=True, slots=True, eq=False)
class StretchedFlights:
    """Flights of all drones that keep apart, and their limits."""

    duration: float
    """[s]."""
    trajectories: tuple[Trajectory, ...]
    """One a drone."""
    method: str = "ways round each other, flown slowly enough"
    """How it was found, in words."""
    counts: dict[str, float] = field(default_factory=dict)
    """What it took, for the certificate."""


def fly_ways_slowly(  # noqa: PLR0917 - geometry of one leg
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    parked: FloatArray | None,
    profile: Profile,
    separation: Separation,
) -> StretchedFlights | None:
    """Fly ways round each other at the fastest pace that all drones can keep.

    Parameters
    ----------
    start, goal
        Shape (n, 3), show frame [m].
    parked
        Positions of drones that stand still, shape (m, 3) [m].
    profile
        The fastest one on which all drones can fly straight.

    Returns
    -------
    StretchedFlights or None
        None if no ways were found, or they keep apart at samples only.
    """
    unhurried = np.zeros(start.shape[0], dtype=bool)
    ways = find_ways(
        start, goal, parked, profile, separation, aircraft.limits, unhurried
    )
    if ways is None or ways.broken:
        return None

    def flown(pace: float) -> FlatFlights:
        return _at(aircraft, start, goal, profile.stretched(pace), ways)

    def kept(pace: float) -> bool:
        flights = flown(pace)
        return bool(np.all(keeps_limits(aircraft.vehicle, aircraft.limits, flights)))

    low, high = profile.duration, 1.5 * profile.duration
    while not kept(high):
        low, high = high, 1.5 * high
        if high > _SLOWEST * profile.duration:
            return None
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if kept(middle) else (middle, high)
    duration = np.ceil(1000.0 * high) / 1000.0
    if not kept(duration):
        return None
    flights = flown(duration)
    if not joined(flights).all():
        return None
    found = tuple(flights.trajectory(row) for row in range(start.shape[0]))
    near = conflicts(tracks_of(found, parked), separation, separation.distance)
    return None if len(near) else StretchedFlights(float(duration), found)


def _at(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    profile: Profile,
    ways: Ways,
) -> FlatFlights:
    breaks, positions = ways.positions(start, goal, profile)
    return fly(aircraft.vehicle, aircraft.heading, breaks, positions)
