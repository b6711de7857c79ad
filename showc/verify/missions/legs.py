"""The legs that a mission flies, read from its rows, on the WGS 84 ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.missions.language import MissionFormatError
from showc.verify.missions.law import (
    METRES_PER_DEGREE,
    Law,
    Profiles,
    fastest_level,
    parameters,
    profiles,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log.showc_pb2 import Site
    from showc.script.show import Show
    from showc.verify.missions.language import Item, Mission


DAY, HOUR = 86400.0, 3600.0
"""After these the clock shows the same, with and without the hour named [s]."""

UNTIMED = 3
"""Legs of a mission that wait for no clock: take-off, climb, landing."""

LEVEL, CLIMB, DESCENT = 1, 2, 3
"""First parameter of a speed item."""

EQUATORIAL_RADIUS = 6378137.0
"""Semi-major axis of WGS 84 [m]."""

FLATTENING = 1.0 / 298.257223563
"""Flattening of WGS 84."""

_ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)  # of WGS 84


def earth_centred(
    latitude: ArrayLike, longitude: ArrayLike, altitude: ArrayLike
) -> FloatArray:
    """Earth-centred, earth-fixed coordinates (..., 3) [m] of degrees and metres."""
    phi, theta = np.radians(latitude), np.radians(longitude)
    height = np.asarray(altitude, dtype=np.float64)
    normal = EQUATORIAL_RADIUS / np.sqrt(1.0 - _ECCENTRICITY_SQUARED * np.sin(phi) ** 2)
    return np.stack(
        [
            (normal + height) * np.cos(phi) * np.cos(theta),
            (normal + height) * np.cos(phi) * np.sin(theta),
            (normal * (1.0 - _ECCENTRICITY_SQUARED) + height) * np.sin(phi),
        ],
        axis=-1,
    )


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
    profiles: Profiles
    """How each leg is planned."""
    lines: IntArray
    """Line in the file of each leg's row, shape (n,)."""

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

    def time(self, slot: Item) -> float:
        """Mission time of a slot [s]: the first after the missions begin.

        Raises
        ------
        MissionFormatError
            If it names an hour and the hour is open, or the other way round.
        """
        _, hour, minute, second = slot.parameters
        if (hour < 0.0) != (self.period == HOUR):
            raise MissionFormatError("a slot names an hour, or none, unlike the start")
        moment = 3600.0 * max(hour, 0.0) + 60.0 * minute + second
        return (moment - self.begin) % self.period


def fleet_legs(
    missions: Sequence[Mission], site: Site, script: Show, clock: Clock
) -> FleetLegs:
    """Return what a fleet of ArduPilot's flies, under the script's parameters.

    Raises
    ------
    MissionFormatError
        If slots do not follow each other, naming the drone; or if legs are faster than
        any that were measured.
    """
    values = {name: float(text) for name, text in parameters(script).items()}
    read = []
    for drone, mission in enumerate(missions):
        try:
            read.append(_Flown.of(mission, site, values, clock))
        except MissionFormatError as error:
            raise MissionFormatError(f"drone {drone + 1}: {error}") from None
    step = np.concatenate([one.steps for one in read])
    limits = np.concatenate([one.limits for one in read])
    law, wind = Law.of(values), script.site.wind
    flown = profiles(step, limits[:, 0], limits[:, 1], law, wind)
    vertical = np.where(step[:, 2] > 0.0, "WPNAV_SPEED_UP", "WPNAV_SPEED_DN")
    rise = np.array([values[name] / 100.0 for name in vertical.tolist()])
    speed = np.where(flown.length > 0.0, flown.speed, 0.0)
    upright = speed * np.sqrt(1.0 - np.minimum(flown.level, 1.0) ** 2)
    share = np.maximum(speed * flown.level / fastest_level(script), upright / rise)
    if not share.max() <= 1.001:
        leg = int(share.argmax())
        raise MissionFormatError(
            f"how a leg of {speed[leg]:g} m/s is flown was not measured: that is "
            f"{share[leg]:.3g} times the greatest level or vertical speed of a mission"
        )
    return FleetLegs(
        np.cumsum([0, *(len(one.steps) for one in read)]),
        np.concatenate([one.places[:-1] for one in read]),
        np.concatenate([one.places[1:] for one in read]),
        np.concatenate([one.release for one in read]),
        flown,
        np.concatenate([one.lines for one in read]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Flown:
    """What the rows of one mission say, before anything is flown."""

    places: FloatArray
    release: FloatArray
    steps: FloatArray
    """Straight ways in the autopilot's metric, shape (n, 3) [m]."""
    limits: FloatArray
    """Speeds in force, level and vertical, shape (n, 2) [m/s]."""
    lines: IntArray

    @classmethod
    def of(
        cls, mission: Mission, site: Site, values: Mapping[str, float], clock: Clock
    ) -> _Flown:
        home = mission.home
        assert home is not None  # noqa: S101 - ArduPilot's grammar has one
        speeds = {
            LEVEL: values["WPNAV_SPEED"] / 100.0,
            CLIMB: values["WPNAV_SPEED_UP"] / 100.0,
            DESCENT: values["WPNAV_SPEED_DN"] / 100.0,
        }
        flown, releases, in_force, lines = [home], [], [], []
        release, before = np.nan, 0.0
        for line, item in enumerate(mission.items, start=3):
            if item.word == "S":
                speeds[int(item.parameters[0])] = item.parameters[1]
            elif item.word == "C":
                release = clock.time(item)
                if release < before:
                    raise MissionFormatError(
                        f"line {line}: this slot comes before the one before it"
                    )
                before = release
            elif item.word == "F":
                release += item.parameters[0]
            elif item.word in "TWL":
                in_force.append([speeds[LEVEL], speeds[CLIMB], speeds[DESCENT]])
                releases.append(np.nan if item.word == "L" else release)
                flown.append(item)
                lines.append(line)
                release = np.nan
        latitude = np.array([item.latitude for item in flown]) * 1e-7
        longitude = np.array([item.longitude for item in flown]) * 1e-7
        heights = _stored([0.0, *(item.height for item in flown[1:])])
        places = to_show_frame(site, latitude, longitude, heights + home.height)
        shrink = np.cos(np.radians(site.latitude))
        steps = np.stack(
            [
                np.diff(latitude) * METRES_PER_DEGREE,
                np.diff(longitude) * METRES_PER_DEGREE * shrink,
                np.diff(heights),
            ],
            axis=1,
        )
        level, climb, descent = np.array(in_force).T
        vertical = np.where(steps[:, 2] > 0.0, climb, descent)
        return cls(
            places,
            np.array(releases),
            steps,
            np.stack([level, vertical], axis=1),
            np.array(lines),
        )


def _stored(heights: Sequence[float]) -> FloatArray:
    """Heights as they are stored: whole centimetres, truncated, shape (n,) [m]."""
    centimetres = np.trunc(np.array(heights, dtype=np.float32) * np.float32(100.0))
    return np.asarray(centimetres.astype(np.float64) / 100.0)
