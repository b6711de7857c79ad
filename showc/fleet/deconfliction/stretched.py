"""A crowd's ways flown slowly enough: the flight that exists once ways are found.

Ways that keep apart keep apart at any pace, so the pace can fall until every drone
keeps its limits. No optimal control is involved; what is found bounds the common time
from above, and the search for a shorter one can end at any time.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.conflicts import conflicts
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.deconfliction.ways import find_ways
from showc.fleet.shared_profile.flat import fly, joined, keeps_limits

if TYPE_CHECKING:
    from showc.fleet.deconfliction.crowd import Crossing
    from showc.fleet.deconfliction.ways import Ways
    from showc.fleet.shared_profile.flat import FlatFlights
    from showc.flight import Trajectory

_SLOWEST = 8.0
"""Time over that of the straight lines beyond which no pace is looked for."""

_WIDER = 0.01
"""Share of the separation by which samples keep farther apart where less was not
enough."""

_HALVINGS = 8
"""Halvings of the pace: the time is found to a part in 256 of what is searched."""


@dataclass(frozen=True, slots=True, eq=False)
class StretchedFlights:
    """Flights of all drones that keep apart, and their limits."""

    duration: float
    """[s]."""
    trajectories: tuple[Trajectory, ...]
    """One a drone."""
    ways: Ways
    """What they follow."""
    method: str = "ways round each other, flown slowly enough"
    """How it was found, in words."""
    counts: dict[str, float] = field(default_factory=dict)
    """What it took, for the certificate."""

    @property
    def bent(self) -> dict[int, Trajectory]:
        """Flights that leave their lines, by row."""
        rows = np.nonzero(np.any(self.ways.aside != 0.0, axis=1))[0]
        return {row: self.trajectories[row] for row in rows.tolist()}


def fly_ways_slowly(crossing: Crossing) -> StretchedFlights | None:
    """Fly ways round each other at the fastest pace that all drones can keep.

    Parameters
    ----------
    crossing
        On the fastest profile on which all drones can fly straight.

    Returns
    -------
    StretchedFlights or None
        None if no ways were found, or they keep apart at samples only.
    """
    ways = find_ways(crossing)
    if ways is None or ways.broken:
        return None
    found = _slowly(crossing, ways)
    near = _near(crossing, found)
    if near and found is not None:
        # What came too near between samples keeps farther apart at them.
        wider = replace(crossing, margin=_WIDER)
        ways = find_ways(wider, ways)
        found = None if ways is None else _slowly(crossing, ways)
        near = _near(crossing, found)
    return None if near else found


def _near(crossing: Crossing, found: StretchedFlights | None) -> int:
    """Count pairs that come too near at any instant."""
    if found is None:
        return 0
    separation = crossing.separation
    tracks = tracks_of(found.trajectories, crossing.parked)
    return len(conflicts(tracks, separation, separation.distance))


def _slowly(crossing: Crossing, ways: Ways) -> StretchedFlights | None:
    """Fly ways at the fastest pace that keeps all limits."""
    aircraft, profile = crossing.aircraft, crossing.profile

    def flown(pace: float) -> FlatFlights:
        slower = replace(crossing, profile=profile.stretched(pace))
        return _at(slower, ways)

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
    found = tuple(flights.trajectory(row) for row in range(crossing.start.shape[0]))
    return StretchedFlights(float(duration), found, ways)


def _at(crossing: Crossing, ways: Ways) -> FlatFlights:
    breaks, positions = ways.positions(crossing.start, crossing.goal, crossing.profile)
    aircraft = crossing.aircraft
    return fly(aircraft.vehicle, aircraft.heading, breaks, positions)
