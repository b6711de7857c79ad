"""Skybrush's compiled shows: a zip of JSON documents."""

from __future__ import annotations

import base64
import binascii
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.documents.archive import Archive, References
from showc.documents.numbers import array, number, places, rising
from showc.documents.values import parse_json
from showc.errors import DamagedFileError
from showc.foreign.fence import MOST_CORNERS
from showc.foreign.show import (
    Course,
    Courses,
    Cue,
    Declared,
    FencePolygon,
    ForeignShow,
    Location,
    Oddity,
    YawTrack,
)
from showc.processes import side_by_side
from showc.verify.kernel.bernstein import elevate

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from showc.arrays import FloatArray


MOST_DRONES = 5000
"""Drones that Skybrush's loader reads."""

MOST_POINTS = 50_000
"""Points of one drone: a quarter of an hour at 50 a second."""

MOST_INNER = 6
"""Inner control points of a segment: degree 7."""


GREAT = 100
"""Drones from which on a fleet is read in parts."""

PARTS = 4
"""Parts of a great fleet that are read side by side."""


@dataclass(frozen=True, slots=True, eq=False)
class _Drone:
    """What a show says of one drone."""

    name: str
    course: Course
    lights: bytes | None
    yaw: YawTrack | None
    home: FloatArray
    land: FloatArray
    flown: list[str]
    """References that led to its flight."""
    oddity: Oddity | None


class _Reading:
    def __init__(self, path: Path) -> None:
        self.archive = Archive(path)
        self.path = path
        self.references = References(self.archive)
        self.flown_by: dict[tuple[str, str], int] = {}

    def mapping(self, value: Any, what: str) -> dict[str, Any]:  # noqa: ANN401
        """Return the object behind ``value``; an empty one where there is none."""
        found = self.references.resolved(value)
        if found is None:
            return {}
        if not isinstance(found, dict):
            raise DamagedFileError(f"{self.path}: {what} is no object")
        return found

    def items(self, value: Any, what: str) -> list[Any]:  # noqa: ANN401
        """Return the list behind ``value``; an empty one where there is none."""
        found = self.references.resolved(value)
        if found is None:
            return []
        if not isinstance(found, list):
            raise DamagedFileError(f"{self.path}: {what} is no list")
        return found

    def read(self) -> ForeignShow:
        """Read the whole show."""
        if "show.json" not in self.archive.names:
            raise DamagedFileError(f"{self.path}: has no show.json in its root")
        name = f"{self.path}:show.json"
        top = self.mapping(parse_json(self.archive.read("show.json"), name), "the show")
        if top.get("version") != 1:
            raise DamagedFileError(
                f"{name}: version is {top.get('version')!r}; wanted 1"
            )
        swarm = self.mapping(top.get("swarm"), "swarm")
        drones = self.items(swarm.get("drones"), "swarm.drones")
        if not 1 <= len(drones) <= MOST_DRONES:
            raise DamagedFileError(
                f"{name}: has {len(drones)} drones; wanted 1 to {MOST_DRONES}"
            )
        settings = self.mapping(top.get("settings"), "settings")
        meta = self.mapping(top.get("meta"), "meta")
        environment = self.mapping(top.get("environment"), "environment")
        fleet = self._fleet(drones)
        courses = Courses(self.path)
        for one in fleet:
            courses.add(one.course)
        return ForeignShow(
            path=str(self.path),
            format=".skyc",
            title=str(meta.get("title") or self.path.stem)[:200],
            names=tuple(one.name for one in fleet),
            tracks=courses.tracks(),
            declared=self._declared(settings),
            fences=self._fences(settings),
            lights=tuple(one.lights for one in fleet),
            yaws=tuple(one.yaw for one in fleet),
            home=np.array([one.home for one in fleet]),
            land=np.array([one.land for one in fleet]),
            location=self._location(environment),
            cues=self._cues(settings),
            oddities=tuple(one.oddity for one in fleet if one.oddity is not None),
        )

    def _fleet(self, entries: list[Any]) -> list[_Drone]:
        """Read all drones; of a great fleet, parts of it side by side."""
        count = PARTS if len(entries) >= GREAT else 1
        most = -(-len(entries) // count)
        every = range(len(entries))
        parts = [
            partial(self._some, every[low : low + most], entries)
            for low in every[::most]
        ]
        if count == 1:
            return parts[0]()
        fleet = [one for part in side_by_side(parts) for one in part]
        for index, one in enumerate(fleet):
            self._alone(one.flown, index + 1)
        return fleet

    def _some(self, numbers: Sequence[int], entries: list[Any]) -> list[_Drone]:
        """Read some drones, in a copy of this process or in it."""
        # A file that was opened before has one position for all copies.
        self.archive = Archive(self.path)
        self.references = References(self.archive)
        courses, found = Courses(self.path), []
        for index in numbers:
            found.append(self._drone(entries[index], index + 1))
            courses.add(found[-1].course)
            self.references.forget()
        return found

    def _drone(self, entry: Any, drone: int) -> _Drone:  # noqa: ANN401
        what = f"drone {drone}"
        settings = self.mapping(entry, what).get("settings")
        own = self.mapping(settings, f"{what}: settings")
        course, flown = self._course(own.get("trajectory"), drone)
        lights, oddity = self._lights(own.get("lights"), drone)
        yaw, turned = self._yaw(own.get("yawControl"), drone)
        first, last = course.position[0, 0], course.position[-1, -1]
        return _Drone(
            str(own.get("name") or what)[:80],
            course,
            lights,
            yaw,
            self._place(own.get("home"), drone, "home", first),
            self._place(own.get("landAt"), drone, "landAt", last),
            flown,
            oddity or turned,
        )

    def _alone(self, references: list[str], drone: int) -> None:
        """Refuse a drone that refers to the trajectory of another one."""
        for name in references:
            path, _, pointer = name.partition("#")
            place = str(PurePosixPath(path)), pointer.strip("/")
            other = self.flown_by.setdefault(place, drone)
            if other != drone:
                raise DamagedFileError(
                    f"{self.path}: drones {other} and {drone} refer to one trajectory, "
                    f"{name!r}; wanted one for each: they would fly into each other"
                )

    def _course(self, value: Any, drone: int) -> tuple[Course, list[str]]:  # noqa: ANN401
        """Read a flight, and the references that led to it."""
        what = f"{self.path}: drone {drone}"
        begun = len(self.references.followed)
        trajectory = self.mapping(value, f"drone {drone}: trajectory")
        points = self.items(trajectory.get("points"), f"drone {drone}: points")
        flown = self.references.followed[begun:]
        self._alone(flown, drone)
        if trajectory.get("version") != 1 or not points:
            raise DamagedFileError(
                f"{what}: has no trajectory of version 1 with points"
            )
        if len(points) > MOST_POINTS:
            raise DamagedFileError(
                f"{what}: has {len(points):,} points; wanted at most {MOST_POINTS:,}"
            )
        if any(not isinstance(point, list) or len(point) < 2 for point in points):
            raise DamagedFileError(f"{what}: a point is not [time, place, controls]")
        shift = number(trajectory.get("takeoffTime") or 0.0, f"{what}: takeoffTime")
        times = array([point[0] for point in points], (-1,), f"{what}: times") + shift
        knots = array([point[1] for point in points], (-1, 3), f"{what}: points")
        # The firmware skips pieces without duration; what jumps there is found later.
        rising(times, what, strictly=False)
        places(knots, what)
        inner = [
            list(point[2]) if len(point) > 2 and point[2] else [] for point in points
        ]
        counts = np.array([len(one) for one in inner])
        if counts.max() > MOST_INNER:
            raise DamagedFileError(
                f"{what}: a segment has {counts.max()} inner control points; wanted at "
                f"most {MOST_INNER}"
            )
        lasting = np.diff(times) > 0.0
        if not lasting.any():
            still = Course(np.array([times[0], times[0] + 1e-3]), knots[None, -1:])
            return still, flown
        top = int(counts[1:].max()) + 1
        body = np.empty((times.size - 1, top + 1, 3))
        for count in np.unique(counts[1:]).tolist():
            rows = np.flatnonzero(counts[1:] == count)
            part = np.empty((rows.size, count + 2, 3))
            part[:, 0], part[:, -1] = knots[rows], knots[rows + 1]
            if count:
                given = [inner[row + 1] for row in rows]
                part[:, 1:-1] = places(
                    array(given, (-1, count, 3), f"{what}: controls"), what
                )
            body[rows] = elevate(part, top)
        borders = np.append(times[:-1][lasting], times[-1])
        return Course(borders, body[lasting]), flown

    def _lights(
        self,
        value: Any,  # noqa: ANN401
        drone: int,
    ) -> tuple[bytes | None, Oddity | None]:
        """Read a light program, or what is wrong with it."""
        lights = self.mapping(value, f"drone {drone}: lights")
        data = self.references.resolved(lights.get("data"))
        if data is None:
            return None, None
        try:
            return base64.b64decode(data, validate=True), None
        except (TypeError, ValueError, binascii.Error):
            return None, Oddity("its light program is no base64", drone)

    def _yaw(
        self,
        value: Any,  # noqa: ANN401
        drone: int,
    ) -> tuple[YawTrack | None, Oddity | None]:
        """Read set points of yaw, or what is wrong with them."""
        turns = self.mapping(value, f"drone {drone}: yawControl")
        points = self.items(turns.get("setpoints"), f"drone {drone}: set points")
        if not points:
            return None, None
        try:
            rows = places(array(points, (-1, 2), "its yaw"), "its yaw")
            times = rising(rows[:, 0].copy(), "its yaw", strictly=False)
        except DamagedFileError as error:
            return None, Oddity(str(error), drone)
        return YawTrack(times, rows[:, 1]), None

    def _place(
        self,
        value: Any,  # noqa: ANN401
        drone: int,
        key: str,
        otherwise: FloatArray,
    ) -> FloatArray:
        found = self.references.resolved(value)
        if found is None:
            return otherwise
        what = f"{self.path}: drone {drone}: {key}"
        return places(array(found, (3,), what), what)

    def _declared(self, settings: dict[str, Any]) -> Declared:
        validation = self.mapping(settings.get("validation"), "settings.validation")

        def limit(key: str) -> float | None:
            value = validation.get(key)
            if value is None:
                return None
            return number(value, f"{self.path}: settings.validation.{key}")

        vertical = limit("maxVelocityZ")
        upward = limit("maxVelocityZUp")
        return Declared(
            limit("maxAltitude"),
            limit("maxVelocityXY"),
            vertical,
            vertical if upward is None else upward,
            limit("minDistance"),
        )

    def _fences(self, settings: dict[str, Any]) -> tuple[FencePolygon, ...]:
        fence = self.mapping(settings.get("geofence"), "settings.geofence")
        found: list[FencePolygon] = []
        for index, entry in enumerate(self.items(fence.get("polygons"), "polygons")):
            polygon = self.mapping(entry, f"polygon {index + 1}")
            what = f"{self.path}: polygon {index + 1} of the fence"
            corners = self.items(polygon.get("points"), what)
            before = sum(len(one.points) for one in found)
            if not 3 <= len(corners) <= MOST_CORNERS - before:
                raise DamagedFileError(
                    f"{what}: has {len(corners)} corners, those before {before}; "
                    f"wanted 3 or more, {MOST_CORNERS} in all"
                )
            flat = [
                corner[:2] if isinstance(corner, list) else corner for corner in corners
            ]
            points = places(array(flat, (-1, 2), what), what)
            found.append(FencePolygon(bool(polygon.get("isInclusion")), points))
        return tuple(found)

    def _location(self, environment: dict[str, Any]) -> Location | None:
        location = self.mapping(environment.get("location"), "environment.location")
        origin = self.references.resolved(location.get("origin"))
        if origin is None:
            return None
        what = f"{self.path}: environment.location.origin"
        values = array(origin, (-1,), what)
        if values.size < 2 or not np.all(np.isfinite(values)):
            raise DamagedFileError(f"{what}: wanted latitude and longitude")
        return Location(
            values[0] * 1e-7,
            values[1] * 1e-7,
            float(values[2]) / 1000.0 if values.size > 2 else None,
            _bearing(location.get("orientation"), f"{what}: orientation"),
        )

    def _cues(self, settings: dict[str, Any]) -> tuple[Cue, ...]:
        sheet = self.mapping(settings.get("cues"), "settings.cues")
        found = []
        for entry in self.items(sheet.get("items"), "settings.cues.items")[:10_000]:
            cue = self.mapping(entry, "a cue")
            time = number(cue.get("time"), f"{self.path}: time of a cue")
            found.append(Cue(time, str(cue.get("name") or "")[:200]))
        return tuple(sorted(found, key=lambda cue: cue.time))


def _bearing(value: Any, what: str) -> float:  # noqa: ANN401 - anything may come
    """Return a bearing [deg]; text too: Skybrush Live keeps them so."""
    if isinstance(value, str):
        with suppress(ValueError):
            value = float(value)
    return number(value or 0.0, what)


def read_skyc(path: Path) -> ForeignShow:
    """Read a compiled show.

    Raises
    ------
    DamagedFileError
        If the archive, a document or a number in it is not what the format wants.
    """
    return _Reading(path).read()
