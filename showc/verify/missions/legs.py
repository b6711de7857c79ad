"""The legs that a mission flies, read from its rows, on the WGS 84 ellipsoid."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from showc.verify.missions import law
from showc.verify.missions.language import Item, Mission, MissionFormatError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log.showc_pb2 import Site
    from showc.script.show import Show

DAY, HOUR = 86400.0, 3600.0
"""After these the clock shows the same, with and without the hour named [s]."""

UNTIMED = 3  # legs that wait for no clock: take-off, climb, landing

_RADIUS, _SQUARED = 6378137.0, 0.0066943799901413165
"""Of WGS 84: its semi-major axis [m]; the square of its eccentricity."""


def earth_centred(
    latitude: ArrayLike, longitude: ArrayLike, altitude: ArrayLike
) -> FloatArray:
    """Earth-centred, earth-fixed coordinates (..., 3) [m] of degrees and metres."""
    phi, theta = np.radians(latitude), np.radians(longitude)
    height = np.asarray(altitude, dtype=np.float64)
    normal = _RADIUS / np.sqrt(1.0 - _SQUARED * np.sin(phi) ** 2)
    level = (normal + height) * np.cos(phi)
    up = (normal * (1.0 - _SQUARED) + height) * np.sin(phi)
    return np.stack([level * np.cos(theta), level * np.sin(theta), up], axis=-1)


def to_show_frame(
    site: Site, latitude: ArrayLike, longitude: ArrayLike, altitude: ArrayLike
) -> FloatArray:
    """Show-frame points (..., 3) [m] of latitudes, longitudes [deg] and altitudes [m].

    Geodetic to earth-centred (Hofmann-Wellenhof, Lichtenegger, Wasle 2008, GNSS,
    equation 8.5), to east, north, up of the tangent plane at the site's origin
    (equation 8.10), to the show frame, whose +y points along the site's heading, a
    compass bearing. Exact to rounding, below a micrometre within tens of kilometres.
    """
    origin = earth_centred(site.latitude, site.longitude, site.altitude)
    away = earth_centred(latitude, longitude, altitude) - origin
    phi, theta = np.radians(site.latitude), np.radians(site.longitude)
    sine, cosine = np.sin(phi), np.cos(phi)
    east = np.array([-np.sin(theta), np.cos(theta), 0.0])
    north = np.array([-sine * np.cos(theta), -sine * np.sin(theta), cosine])
    up = np.array([cosine * np.cos(theta), cosine * np.sin(theta), sine])
    bearing = np.radians(site.heading)
    right = np.cos(bearing) * east - np.sin(bearing) * north
    ahead = np.sin(bearing) * east + np.cos(bearing) * north
    return np.asarray(away @ np.stack([right, ahead, up], axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class FleetLegs:
    """What a fleet flies, leg by leg: the legs of a drone follow each other.

    Of each drone the first two legs, take-off and climb, wait for no clock, nor does
    the last one, its landing; all others do. Each begins where the one before it ends.
    """

    first: IntArray
    """First leg of each drone, and the number of legs, shape (drones + 1,)."""
    begin: FloatArray
    """Where each leg begins, the first one on the pad, show frame, (n, 3) [m]."""
    end: FloatArray
    """Where it ends, shape (n, 3) [m]."""
    release: FloatArray
    """When it is released, on the missions' clock, shape (n,) [s]; NaN: when the one
    before it has ended."""
    profiles: law.Profiles
    """How each leg is planned."""
    lines: IntArray
    """Line in the file of each leg's row, shape (n,)."""
    alone: FloatArray
    """Slots at which a drone's lights change, and nothing else: the leg that follows
    each, and its time on the missions' clock, shape (k, 2) [s]."""
    pause: FloatArray
    """For how long each drone hovers before its landing, shape (drones,) [s]."""

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return self.first.size - 1

    @property
    def owner(self) -> IntArray:
        """Drone of each leg, shape (n,)."""
        return np.repeat(np.arange(self.drones), np.diff(self.first))

    @property
    def timed(self) -> BoolArray:
        """Which legs wait for a clock, shape (n,)."""
        return np.isfinite(self.release)

    @property
    def leaves(self) -> FloatArray:
        """When each leg begins at the earliest, a landing too, shape (n,) [s]."""
        found, land, flights = self.release.copy(), self.first[1:] - 1, self.profiles
        early = self.release + flights.followed(-flights.spread)
        found[land] = early[land - 1] + self.pause - law.CONSTANTS["clock_lag"]
        return found

    @property
    def climbs(self) -> FloatArray:
        """Likely time of each drone's take-off and climb, shape (drones,) [s]."""
        likely, first = self.profiles.followed(0.0), self.first[:-1]
        return law.CONSTANTS["lift_off"] + likely[first] + likely[first + 1]

    def filled(self, values: FloatArray, empty: float) -> FloatArray:
        """One row for each drone: ``values`` of its timed legs, then ``empty``."""
        counts = np.diff(self.first) - UNTIMED
        table = np.full((self.drones, max(int(counts.max(initial=0)), 1)), empty)
        table[np.arange(table.shape[1]) < counts[:, None]] = values[self.timed]
        return table


@dataclass(frozen=True, slots=True)
class Clock:
    """What the slots of missions count from."""

    begin: float
    """Mission time 0, of the day, or of the hour if that is open [s]."""
    period: float
    """``DAY`` or ``HOUR``."""

    @classmethod
    def of(cls, described: Mapping[str, Any]) -> Clock:
        """Return what slots count from, by what the manifest says of the missions.

        MissionFormatError if it names neither a start of whole seconds nor a minute.
        """
        start, said = described.get("start"), described.get("prediction")
        minute = said.get("start_minute") if isinstance(said, dict) else None
        if start is None and type(minute) is int and 0 <= minute < 60:
            return cls(60.0 * minute, HOUR)
        with suppress(ValueError, OverflowError):
            now = datetime.fromisoformat(str(start)).astimezone(UTC)
            if now.isoformat() == start and not now.microsecond:
                return cls(3600.0 * now.hour + 60.0 * now.minute + now.second, DAY)
        raise MissionFormatError("the manifest names no start, in UTC as compile does")

    def time(self, slot: Item) -> float:
        """Mission time of a slot [s]: the first after the missions begin.

        MissionFormatError if it names an hour and that is open, or the other way round.
        """
        _, hour, minute, second = slot.parameters
        if (hour < 0.0) != (self.period == HOUR):
            raise MissionFormatError("a slot names an hour, or none, unlike the start")
        moment = 3600.0 * max(hour, 0.0) + 60.0 * minute + second
        return (moment - self.begin) % self.period


def standing(mission: Mission, site: Site, height: float) -> Mission:
    """Return a mission without a home with that of a pad of a ``height`` [m]."""
    first = mission.items[0]
    place = 1e-7 * first.latitude, 1e-7 * first.longitude
    altitude = height - float(to_show_frame(site, *place, 0.0)[2])
    return replace(mission, home=first._replace(word="H", height=round(altitude, 2)))


def fleet_legs(
    missions: Sequence[Mission], site: Site, script: Show, clock: Clock | None
) -> FleetLegs:
    """Return what a fleet of ArduPilot's flies, under the script's parameters.

    Without a ``clock`` no leg is released at a time. MissionFormatError if slots do not
    follow each other, naming the drone; or if legs are faster than any measured.
    """
    values = law.parameters(script)
    rows, homes = list[_Row](), [0]
    for drone, mission in enumerate(missions):
        try:
            rows += _rows(mission, values, clock)
        except MissionFormatError as error:
            raise MissionFormatError(f"drone {drone + 1}: {error}") from None
        homes.append(len(rows))
    degrees = [(row.item.latitude, row.item.longitude) for row in rows]
    latitude, longitude = 1e-7 * np.array(degrees).T
    ends = np.setdiff1d(np.arange(len(rows)), homes)
    heights = np.array([row.item.height for row in rows])
    base = np.repeat(heights[homes[:-1]], np.diff(homes))
    heights[homes[:-1]] = 0.0
    # As they are stored: whole centimetres, truncated.
    centimetres = np.trunc(heights.astype(np.float32) * np.float32(100.0))
    heights = centimetres.astype(np.float64) / 100.0
    places = to_show_frame(site, latitude, longitude, heights + base)
    east = longitude * np.cos(np.radians(site.latitude))
    level = law.CONSTANTS["metres_per_degree"] * np.stack([latitude, east])
    step = np.diff(np.stack([*level, heights], axis=1), axis=0)[ends - 1]
    flights = [rows[end] for end in ends.tolist()]
    level, climb, descent = np.array([row.speeds for row in flights]).T
    vertical = np.where(step[:, 2] > 0.0, climb, descent)
    flown = law.profiles(step, level, vertical, law.Law.of(values), script.site.wind)
    most = 100.0 * script.limits.velocity_max[2]
    up = min(law.KNOWN["parameters"]["WPNAV_SPEED_UP"], most)
    rise = 0.01 * np.where(step[:, 2] > 0.0, up, values["WPNAV_SPEED_DN"])
    speed = np.where(flown.length > 0.0, flown.speed, 0.0)
    upright = speed * np.sqrt(1.0 - np.minimum(flown.level, 1.0) ** 2)
    share = np.maximum(speed * flown.level / law.fastest_level(script), upright / rise)
    if not share.max() <= 1.001:
        text = f"how a leg of {speed[share.argmax()]:g} m/s is flown was not measured: "
        raise MissionFormatError(f"{text}{share.max():.3g} times the greatest speed")
    late = np.array([row.dark for row in flights]) > flown.duration
    if late.any():
        line = flights[int(late.argmax())].line
        raise MissionFormatError(f"line {line}: lights change when their leg has ended")
    alone = [(leg, time) for leg, row in enumerate(flights) for time in row.alone]
    return FleetLegs(
        np.array(homes) - np.arange(len(homes)),
        places[ends - 1],
        places[ends],
        np.array([row.release for row in flights]),
        flown,
        np.array([row.line for row in flights]),
        np.array(alone).reshape(-1, 2),
        np.array([row.pause for row in flights if row.pause]),
    )


class _Row(NamedTuple):
    """What a row with a place says, before anything is flown."""

    item: Item
    line: int
    release: float = np.nan
    """Of the leg to the place, on the missions' clock [s]."""
    speeds: tuple[float, ...] = ()
    """In force on it: level, up, down [m/s]."""
    alone: tuple[float, ...] = ()
    """Slots before it at which lights change alone [s]."""
    dark: float = 0.0
    """For how long on the leg lights wait to change [s]."""
    pause: float = 0.0
    """For how long a drone hovers before it [s]."""


def _rows(
    mission: Mission, values: Mapping[str, float], clock: Clock | None
) -> Iterator[_Row]:
    """Go through the places of a mission, its home first."""
    assert mission.home is not None  # noqa: S101 - ArduPilot's grammar has one
    yield _Row(mission.home, 2)
    # By the first parameter of a speed item: level, up, down.
    names = "WPNAV_SPEED", "WPNAV_SPEED_UP", "WPNAV_SPEED_DN"
    speeds = {kind: values[name] / 100.0 for kind, name in enumerate(names, 1)}
    slots, waits, before = list[float](), {"D": 0.0, "P": 0.0}, -DAY
    for line, item in enumerate(mission.items, start=3):
        if item.word == "S":
            speeds[int(item.parameters[0])] = item.parameters[1]
        elif item.word == "C" and clock is not None:
            slots.append(clock.time(item))
            # A vehicle that comes a moment later waits for the next hour.
            if slots[-1] < before + law.CONSTANTS["clock_lag"]:
                raise MissionFormatError(f"line {line}: this slot comes too early")
            before = slots[-1]
        elif item.word == "F" and slots:
            before = slots[-1] = slots[-1] + item.parameters[0]
        elif item.word in waits:
            waits[item.word] = item.parameters[0]
        elif item.word in "TWL":
            # A landing waits for none: those before it are of lights alone.
            release = slots.pop() if slots and item.word == "W" else np.nan
            own = tuple(speeds.values()), tuple(slots)
            yield _Row(item, line, release, *own, waits["D"], waits["P"])
            slots, waits["D"] = [], 0.0
