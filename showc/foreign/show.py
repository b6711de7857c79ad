"""A show as a file of any format has it: flights, lights, rules, site, cues.

Everything here is what the bytes say, nothing is smoothed or mended. Positions are in
the show frame of the file, in metres: x forward, y left, z up, ground at zero (formats
with other axes are turned into it). Times are seconds since the start of the show.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import DamagedFileError
from showc.verify.kernel.bernstein import elevate
from showc.verify.kernel.slices import Tracks

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from showc.arrays import ByteArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Declared:
    """The validation settings of a file; None where it says nothing."""

    altitude: float | None = None
    """Greatest height [m]."""
    speed_xy: float | None = None
    """Greatest horizontal speed [m/s]."""
    speed_down: float | None = None
    """Greatest speed of descent [m/s]."""
    speed_up: float | None = None
    """Greatest speed of climb [m/s]."""
    distance: float | None = None
    """Least distance between two drones [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class FencePolygon:
    """An area that drones keep to, or keep out of."""

    inclusion: bool
    """Whether drones stay inside; else outside."""
    points: FloatArray
    """Corners, shape (n, 2) [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class LightTrack:
    """The light of one drone: colours at instants, linear in between."""

    times: FloatArray
    """Not decreasing, shape (n,) [s]; two equal ones are a jump."""
    colours: FloatArray | ByteArray
    """Linear light, 0 to 255, shape (n, 3)."""

    def at(self, moments: FloatArray) -> FloatArray:
        """Colours at ``moments`` (m,) [s]; shape (m, 3). After a jump the later one."""
        index = np.searchsorted(self.times, moments, side="right")
        before = np.clip(index - 1, 0, self.times.size - 1)
        after = np.clip(index, 0, self.times.size - 1)
        width = self.times[after] - self.times[before]
        share = np.where(
            width > 0.0,
            (moments - self.times[before]) / np.where(width > 0.0, width, 1.0),
            0.0,
        )[:, None]
        share = np.clip(share, 0.0, 1.0)
        return np.asarray(
            (1.0 - share) * self.colours[before] + share * self.colours[after]
        )


@dataclass(frozen=True, slots=True, eq=False)
class YawTrack:
    """Yaw that a file asks for, linear between instants."""

    times: FloatArray
    """Shape (n,) [s]."""
    angles: FloatArray
    """Clockwise from the bearing of +x, shape (n,) [deg]."""


@dataclass(frozen=True, slots=True)
class Cue:
    """A named instant."""

    time: float
    """Show time [s]."""
    name: str
    """What happens then."""


@dataclass(frozen=True, slots=True)
class Location:
    """Where on the globe a show frame lies."""

    latitude: float
    """Of the origin [deg]."""
    longitude: float
    """Of the origin [deg]."""
    altitude: float | None
    """Of the origin above mean sea level [m]; None: not said."""
    orientation: float
    """Compass bearing of +x [deg]."""


@dataclass(frozen=True, slots=True)
class Oddity:
    """Something about the bytes that is wrong, though the file can be read."""

    message: str
    """What, with the measured value and what was wanted."""
    drone: int | None = None
    """Counting from 1."""
    time: float | None = None
    """Show time [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """What of a drone's binary file a firmware looks at, beside the flight itself."""

    degrees: IntArray
    """Degree in which each segment stores x, y, z and yaw, shape (segments, 4)."""
    scale: int
    """Step of the coordinates [mm]."""
    block: int
    """Length of the trajectory block [bytes]."""


@dataclass(frozen=True, slots=True, eq=False)
class ForeignShow:
    """A whole show."""

    path: str
    """As it was named."""
    format: str
    """Name of the format, for people."""
    title: str
    """Name of the show; the file's where it has none."""
    names: tuple[str, ...]
    """Of the drones."""
    tracks: Tracks
    """Where all drones are from the start to the end."""
    declared: Declared = field(default_factory=Declared)
    """The file's own rules."""
    fences: tuple[FencePolygon, ...] = ()
    """The file's own fence."""
    lights: tuple[LightTrack | bytes | None, ...] = ()
    """Of each drone, programs as they are stored; empty where the format has none."""
    yaws: tuple[YawTrack | None, ...] = ()
    """Of each drone; empty where the format has none."""
    home: FloatArray | None = None
    """Where each drone starts by what the file says beside the flight, (drones, 3)."""
    land: FloatArray | None = None
    """Where each lands, (drones, 3)."""
    location: Location | None = None
    """Where it is flown."""
    cues: tuple[Cue, ...] = ()
    """Named instants."""
    stored: tuple[Stored, ...] = ()
    """Of each drone, where the file is what the firmware reads."""
    oddities: tuple[Oddity, ...] = ()
    """What is wrong with the bytes."""

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return self.tracks.drones

    @property
    def duration(self) -> float:
        """When the last drone's flight ends [s]."""
        return self.tracks.end - self.tracks.begin


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """The flight of one drone as its file has it."""

    times: FloatArray
    """Borders of the pieces, increasing, shape (pieces + 1,) [s]."""
    position: FloatArray
    """Bernstein coefficients, shape (pieces, degree + 1, 3) [m]."""


def polyline(times: FloatArray, places: FloatArray) -> Course:
    """Return the course through ``places`` (n, 3) at ``times`` (n,), straight between.

    One row is a drone that stands still.
    """
    if times.size == 1:
        return Course(np.array([times[0], times[0] + 1e-3]), places[None, :1])
    return Course(times, np.stack([places[:-1], places[1:]], axis=1))


MOST_CONTROLS = 6_000_000
"""Coefficients of a fleet, three numbers each, that a file of any size may have: a
thousand drones of twelve minutes, two cubics a second."""

BYTES_EACH = 6
"""Bytes of a file on disk for each further coefficient: numbers that are written out
take more even when packed, so memory stays in proportion to what is there."""


_ENDS = 2
"""Coefficients of a piece at least: its ends, also where it is a constant."""


class Courses:
    """Courses of a fleet, gathered up to what a show may have.

    Parameters
    ----------
    path
        Of the show, for the error.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._courses = path, list[Course]()
        files = path.iterdir() if path.is_dir() else [path]
        size = sum(file.stat().st_size for file in files if file.is_file())
        self._most = max(MOST_CONTROLS, size // BYTES_EACH)
        self._pieces, self._width = 0, _ENDS

    def add(self, course: Course) -> None:
        """Take the course of the next drone.

        Raises
        ------
        DamagedFileError
            If the fleet has more coefficients than are read.
        """
        pieces, width = course.position.shape[:2]
        self._pieces, self._width = self._pieces + pieces, max(self._width, width)
        # One degree serves all: what is lower is raised.
        controls = self._pieces * self._width
        if controls > self._most:
            raise DamagedFileError(
                f"{self._path}: up to drone {len(self._courses) + 1} there are "
                f"{self._pieces:,} pieces of degree {self._width - 1}, {controls:,} "
                f"coefficients; wanted at most {self._most:,}"
            )
        self._courses.append(course)

    def tracks(self) -> Tracks:
        """Lay the courses side by side; see :func:`fleet`."""
        return fleet(self._courses)


def fleet(courses: Sequence[Course]) -> Tracks:
    """Lay the courses of a fleet side by side.

    Before its first instant and after its last a drone stands still, so that every
    course covers the time of the longest.
    """
    begin = min(0.0, *(float(course.times[0]) for course in courses))
    end = max(float(course.times[-1]) for course in courses)
    degree = max(_ENDS, *(course.position.shape[1] for course in courses)) - 1
    starts, ends, rows, counts = [], [], [], []
    for course in courses:
        low, high, body = course.times[:-1], course.times[1:], course.position
        body = elevate(body, degree)
        if low[0] > begin:
            body = np.concatenate([np.repeat(body[:1, :1], degree + 1, axis=1), body])
            low, high = np.append(begin, low), np.append(low[0], high)
        if high[-1] < end:
            still = np.repeat(body[-1:, -1:], degree + 1, axis=1)
            body = np.concatenate([body, still])
            low, high = np.append(low, high[-1]), np.append(high, end)
        starts.append(low)
        ends.append(high)
        rows.append(body)
        counts.append(low.size)
    return Tracks(
        begin,
        end,
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        np.concatenate(starts),
        np.concatenate(ends),
        np.concatenate(rows),
    )
