"""The legs that a mission flies, read from its rows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import METRES_PER_DEGREE, Law, Profiles, profiles
from showc.verify.geodesy import east_north_up
from showc.verify.takeoff import SOONER, takeoff_time
from showc.verify.tracked import Fleet
from showc.verify.waypoints import LAND, TAKEOFF, WAYPOINT, MissionFormatError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from showc.log.showc_pb2 import Site
    from showc.verify.tracked import Tracked
    from showc.verify.waypoints import Item

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

DELAY, SPEED = 93, 178
"""MAV_CMD of the items that hold, and that set a speed."""

SPIN_UP = 2.25
"""Time on the ground between the start of a mission and lift-off [s]."""

DAY = 86400.0

LEVEL, CLIMB, DESCENT = 1, 2, 3
"""First parameter of a speed item."""


@dataclass(frozen=True, slots=True, eq=False)
class MissionLegs:
    """What one drone flies."""

    places: FloatArray
    """Pad, and every place flown to, show frame, shape (n + 1, 3) [m]."""
    release: FloatArray
    """When each leg is released, shape (n,) [s]; NaN: not timed. Of the UTC day if the
    mission goes by the clock, else of the mission."""
    profiles: Profiles
    """How each leg is planned."""
    lag: float
    """How late the law's time changes its rate: acceleration over jerk [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class TimedLegs:
    """The next timed leg of some drones, flown."""

    drones: IntArray
    """Which drones, shape (n,)."""
    release: FloatArray
    """When each is released, since the missions began, shape (n,) [s]."""
    along: FloatArray
    """From the legs' begins to their ends, show frame, shape (n, 3) [m]."""
    tracked: Tracked
    """How they are flown."""


@dataclass(frozen=True, slots=True, eq=False)
class FleetLegs:
    """What all drones fly."""

    missions: list[MissionLegs]
    """Drone by drone."""
    flights: tuple[TimedLegs, ...] | None
    """All timed legs flown, if their releases had to be found so; else None."""


@dataclass(frozen=True, slots=True, eq=False)
class MissionRows:
    """What the rows of one mission say, before anything is flown."""

    places: FloatArray
    """Pad, and every place flown to, show frame, shape (n + 1, 3) [m]."""
    steps: FloatArray
    """Straight ways in the autopilot's metric, shape (n, 3) [m]."""
    limits: FloatArray
    """Speeds in force, level and vertical, shape (n, 2) [m/s]."""
    waits: tuple[tuple[str, float], ...]
    """What each leg waits for, and how long [s]."""


def read_parameters(content: bytes) -> dict[str, float]:
    """Return the values of a parameter file by name.

    Raises
    ------
    MissionFormatError
        If a line is not a name and a number.
    """
    values = {}
    for number, line in enumerate(content.decode("ascii", "replace").splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        name, _, text = line.partition(",")
        try:
            values[name.strip()] = float(text)
        except ValueError:
            raise MissionFormatError(f"line {number} is no parameter") from None
    return values


def read_rows(
    items: Sequence[Item], site: Site, values: Mapping[str, float]
) -> MissionRows:
    """Return what a mission for ArduPilot flies, its home row first.

    Raises
    ------
    MissionFormatError
        If a parameter is missing, or nothing is flown.
    """
    home = items[0]
    try:
        speeds = {
            LEVEL: values["WPNAV_SPEED"] / 100.0,
            CLIMB: values["WPNAV_SPEED_UP"] / 100.0,
            DESCENT: values["WPNAV_SPEED_DN"] / 100.0,
        }
    except KeyError as error:
        raise MissionFormatError(f"parameter {error} is missing") from None
    flown, waits, in_force = [home], [], []
    hold: tuple[str, float] = ("start", SPIN_UP)
    for item in items[1:]:
        if item.command == SPEED:
            speeds[int(item.parameters[0])] = item.parameters[1]
        elif item.command == DELAY:
            hold = _hold(item, hold)
        elif item.command in {WAYPOINT, LAND, TAKEOFF}:
            in_force.append([speeds[LEVEL], speeds[CLIMB], speeds[DESCENT]])
            # A landing is no leg of the law, and not timed.
            waits.append(("land", 0.0) if item.command == LAND else hold)
            flown.append(item)
            hold = ("through", 0.0)
    if not waits:
        raise MissionFormatError("flies nowhere")
    latitude = np.array([item.latitude for item in flown])
    longitude = np.array([item.longitude for item in flown])
    heights = _stored([0.0, *(item.height for item in flown[1:])])
    places = east_north_up(site, latitude, longitude, heights + home.height)
    steps = _steps(latitude, longitude, heights, site)
    # Take-offs go straight up.
    steps[[item.command == TAKEOFF for item in flown[1:]], :2] = 0.0
    level, climb, descent = np.array(in_force).T
    limits = np.stack([level, np.where(steps[:, 2] > 0.0, climb, descent)], axis=1)
    return MissionRows(_show_frame(site, places), steps, limits, tuple(waits))


def fly_rows(missions: Sequence[MissionRows], values: Mapping[str, float]) -> FleetLegs:
    """Return the legs of a fleet's missions under one set of parameters.

    A leg that follows a hold is timed: by the clock if the hold waits for one, else by
    what was flown and held before, take-off from its nominal time on.

    Raises
    ------
    MissionFormatError
        If a parameter is missing.
    """
    try:
        law = Law.of(values)
    except KeyError as error:
        raise MissionFormatError(f"parameter {error} is missing") from None
    if not missions:
        return FleetLegs([], None)
    limits = np.concatenate([mission.limits for mission in missions])
    step = np.concatenate([mission.steps for mission in missions])
    # All legs of the fleet at once: a call for each drone would take far longer.
    flights = profiles(step, limits[:, 0], limits[:, 1], law)
    edges = np.cumsum([0, *(len(mission.steps) for mission in missions)]).tolist()
    lag = law.acceleration / law.jerk
    nominal = flights.followed(0.0)
    fleet = []
    for mission, (begin, end) in zip(missions, pairwise(edges), strict=True):
        own = flights.part(begin, end)
        releases = _releases(mission.waits, nominal[begin:end])
        fleet.append(MissionLegs(mission.places, releases, own, lag))
    if any(kind == "pause" for mission in missions for kind, _ in mission.waits):
        return _without_clock(missions, fleet, law)
    return FleetLegs(fleet, None)


def _without_clock(
    missions: Sequence[MissionRows],
    fleet: list[MissionLegs],
    law: Law,
) -> FleetLegs:
    """Return the legs of ``fleet``, released when those before have ended and held.

    An autopilot takes the next item when the law's own time for a leg has ended.
    """
    lag = fleet[0].lag
    flying = Fleet(len(fleet), lag)
    table, first = joined(fleet)
    releases = [one.release.copy() for one in fleet]
    clocks = np.zeros(len(fleet))
    flights = []
    for leg in range(max(one.release.size for one in fleet)):
        timed, through = [], []
        for drone, mission in enumerate(missions):
            if leg >= len(mission.waits):
                continue
            kind, amount = mission.waits[leg]
            clocks[drone] += amount
            if kind == "pause":
                releases[drone][leg] = clocks[drone]
                timed.append(drone)
            elif leg == 0:
                # Take-off follows no law of legs, and what follows it does not rest.
                height, up = float(mission.steps[0, 2]), float(mission.limits[0, 1])
                took = takeoff_time(height, up, law.vertical_acceleration)
                clocks[drone] += took - SOONER
            elif leg + 1 < len(mission.waits):
                # What comes last, the landing, times nothing.
                through.append(drone)
        for some, flight in ((timed, flying), (through, Fleet(len(fleet), lag))):
            if some:
                drones = np.array(some)
                places = np.stack([fleet[k].places[leg : leg + 2] for k in some])
                along = places[:, 1] - places[:, 0]
                rests = [missions[drone].waits[leg + 1 : leg + 2] for drone in some]
                # Where a drone is on its landing, no leg tells.
                holds = np.array(
                    [
                        rest[0][1] if rest and rest[0][0] != "land" else np.inf
                        for rest in rests
                    ]
                )
                legs = table.chosen(first[drones] + leg)
                tracked = flight.fly(drones, legs, along, holds=holds)
                if flight is flying:
                    release = clocks[drones].copy()
                    flights.append(TimedLegs(drones, release, along, tracked))
                clocks[drones] += tracked.ended
    own = [
        replace(one, release=release)
        for one, release in zip(fleet, releases, strict=True)
    ]
    return FleetLegs(own, _until_the_next(flights, len(fleet)))


def _until_the_next(flights: Sequence[TimedLegs], drones: int) -> tuple[TimedLegs, ...]:
    """Let each leg count until the next timed one of its drone is released."""
    soonest = np.full(drones, np.inf)
    found = []
    for one in reversed(flights):
        until = soonest[one.drones] - one.release
        soonest[one.drones] = one.release
        found.append(replace(one, tracked=replace(one.tracked, until=until)))
    return tuple(reversed(found))


def joined(missions: Sequence[MissionLegs]) -> tuple[Profiles, IntArray]:
    """All legs of all drones in one table, and where each drone's begin."""
    counts = [mission.release.size for mission in missions]
    parts = [mission.profiles for mission in missions]
    table = Profiles(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in Profiles.__dataclass_fields__
        )
    )
    return table, np.concatenate([[0], np.cumsum(counts)])[:-1]


def _show_frame(site: Site, places: FloatArray) -> FloatArray:
    """Turn east, north, up (n, 3) by the site's heading."""
    bearing = np.radians(site.heading)
    cosine, sine = np.cos(bearing), np.sin(bearing)
    east, north, up = places.T
    return np.stack([east * cosine - north * sine, east * sine + north * cosine, up], 1)


def _stored(heights: Sequence[float]) -> FloatArray:
    """Heights as they are stored: whole centimetres, truncated, shape (n,) [m]."""
    centimetres = np.trunc(np.array(heights, dtype=np.float32) * np.float32(100.0))
    return np.asarray(centimetres.astype(np.float64) / 100.0)


def _hold(item: Item, before: tuple[str, float]) -> tuple[str, float]:
    """Join a hold to what was held before it."""
    first, hour, minute, second = item.parameters
    if first <= 0.0:
        return "clock", 3600.0 * hour + 60.0 * minute + second
    kind, amount = before
    if kind == "through":
        return "pause", first
    return kind, amount + first


def _steps(
    latitude: FloatArray, longitude: FloatArray, heights: FloatArray, site: Site
) -> FloatArray:
    """Straight ways between places (n + 1,) in the autopilot's metric, (n, 3) [m]."""
    scale = METRES_PER_DEGREE
    shrink = np.cos(np.radians(site.latitude))
    return np.stack(
        [
            np.diff(latitude) * scale,
            np.diff(longitude) * scale * shrink,
            np.diff(heights),
        ],
        axis=1,
    )


def _releases(waits: Sequence[tuple[str, float]], ended: FloatArray) -> FloatArray:
    """When each leg is released; NaN for those that follow another at once."""
    clock, day = 0.0, 0.0
    releases = np.full(ended.size, np.nan)
    for leg, (kind, amount) in enumerate(waits):
        if kind == "clock":
            moment = amount + day
            if leg and moment < clock - DAY / 2.0:
                day += DAY
                moment += DAY
            clock = moment
            releases[leg] = clock
        else:
            clock += amount
            if kind == "pause":
                releases[leg] = clock
        # A leg is over, for the autopilot, when its own time for it has ended.
        clock += float(ended[leg])
    return releases
