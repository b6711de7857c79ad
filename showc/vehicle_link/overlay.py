"""A flight laid over the plan it followed: logs read, brought to one frame and time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import UsageError
from showc.geodesy import SiteFrame
from showc.log.reader import read_log
from showc.vehicle_link.autopilot_log import ENDINGS, AutopilotTrack, read_autopilot_log
from showc.vehicle_link.course import Course, Kind, course_of
from showc.vehicle_link.flown import Track, read_flown

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from showc.arrays import FloatArray
    from showc.log.reader import LoggedShow


LAGS = np.arange(-0.5, 2.001, 0.02)
"""Shifts in time that are tried [s]."""

COARSE = 0.25
"""Step at which the beginning of a flight without a clock is looked for first [s]."""

FAR = 5.0
"""Distances beyond this count no more in that search [m]."""


@dataclass(frozen=True, eq=False)
class Flown:
    """A flight beside its plan: what a comparison is made of."""

    show: LoggedShow
    course: Course
    tracks: dict[int, Track]
    """By drone, counting from 0, in show time."""

    def errors(self, drone: int) -> FloatArray:
        """Return the distance of ``drone`` to its plan at its times, (n,) [m]."""
        track = self.tracks[drone]
        planned = self.course.at(drone, track.times)
        return np.asarray(np.linalg.norm(track.positions - planned, axis=1))

    def places(self, times: FloatArray) -> FloatArray:
        """Return where all drones of the show were, shape (k, drones, 3) [m].

        Parameters
        ----------
        times
            In the time of the course, shape (k,) [s]. A drone is not a number before
            its record begins and after its end, and where it has none.
        """
        found = np.full((times.size, self.show.drones, 3), np.nan)
        for drone, track in self.tracks.items():
            for axis in range(3):
                found[:, drone, axis] = np.interp(
                    times, track.times, track.positions[:, axis], np.nan, np.nan
                )
        return found


def load_flown(
    plan: Path, flown: Sequence[Path], *, against: Kind | None = None
) -> Flown:
    """Read a plan and a flight, and lay one over the other.

    Parameters
    ----------
    plan
        What ``showc compile`` wrote.
    flown
        What ``showc stream`` wrote, or logs of autopilots (``.BIN``, ``.tlog``), or
        folders with such. A drone is the MAVLink system id that its log tells, else
        the number at the end of the file's name.
    against
        What the fleet was to fly; None: missions if an autopilot flew one, else the
        trajectories.

    Raises
    ------
    UsageError
        If a file cannot be read, the flight has a drone that the show has not, or two
        logs are of one drone.
    DamagedFileError
        If a file is damaged.
    """
    show = read_log(plan)
    recorded: dict[int, Track] = {}
    logs: list[AutopilotTrack] = []
    for path in _files(flown):
        if path.suffix.lower() in ENDINGS:
            logs += read_autopilot_log(path)
        else:
            recorded |= read_flown(path)
    if logs and recorded:
        raise UsageError(
            "logs of autopilots and a log of showc stream were given; wanted one kind"
        )
    kind: Kind = against or (
        "missions" if any(track.missions for track in logs) else "trajectories"
    )
    course = course_of(show, kind)
    sources = {track.system - 1: track.source for track in logs} or {
        drone: str(path) for drone in recorded for path in flown[:1]
    }
    for drone, source in sources.items():
        if not 0 <= drone < show.drones:
            raise UsageError(
                f"{source}: has drone {drone + 1}, {plan} has {show.drones}: it is "
                "not a flight of that show"
            )
    if len(sources) < len(logs):
        raise UsageError(
            "two of the logs are of one drone; wanted one log for each, of one flight"
        )
    tracks = recorded or _aligned(show, course, logs)
    return Flown(show, course, {drone: tracks[drone] for drone in sorted(tracks)})


def _files(given: Sequence[Path]) -> list[Path]:
    """Return the logs that are given, those in folders by name."""
    found: list[Path] = []
    for path in given:
        if not path.is_dir():
            found.append(path)
            continue
        inside = sorted(one for one in path.rglob("*") if one.suffix.lower() in ENDINGS)
        if not inside:
            raise UsageError(f"{path}: holds no .BIN and no .tlog")
        found += inside
    return found


def _aligned(
    show: LoggedShow, course: Course, logs: list[AutopilotTrack]
) -> dict[int, Track]:
    """Bring the autopilots' tracks into the show's frame and time."""
    site = show.rules.site
    frame = SiteFrame(site.latitude, site.longitude, site.altitude, site.heading)
    places: dict[int, FloatArray] = {}
    for track in logs:
        drone = track.system - 1
        geodetic = track.geodetic.copy()
        geodetic[:, 2] = site.altitude
        places[drone] = frame.from_geodetic(geodetic)
        places[drone][:, 2] = course.pads[drone, 2] + track.geodetic[:, 2]
    zero = None
    if all(track.utc for track in logs):
        by_drone = {track.system - 1: track.times for track in logs}
        zero = course.zero(np.concatenate(list(by_drone.values())))
        if zero is None:
            zero = _found_zero(course, by_drone, places)
    tracks = {}
    for track in logs:
        drone = track.system - 1
        own = zero
        if own is None:
            own = _found_zero(course, {drone: track.times}, {drone: places[drone]})
        times = track.times - own
        inside = (times >= course.start) & (times <= course.end)
        if not inside.any():
            raise UsageError(
                f"{track.source}: was recorded {abs(float(times[0])):.0f} s "
                f"{'before' if times[0] < 0.0 else 'after'} the show's time 0; wanted "
                "the log of a flight of this compile"
            )
        tracks[drone] = Track(drone, times[inside], places[drone][inside])
    return tracks


def _found_zero(
    course: Course, times: dict[int, FloatArray], places: dict[int, FloatArray]
) -> float:
    """Return the time at which the show began, from where the drones were.

    The best common shift: first in steps of ``COARSE`` by one drone, then in those of
    ``LAGS`` by all.
    """
    grid = np.arange(course.start, course.end, 2.0 * COARSE)

    def misfit(zero: float, drones: list[int]) -> float:
        total = 0.0
        for drone in drones:
            own = np.stack(
                [
                    np.interp(grid + zero, times[drone], places[drone][:, axis])
                    for axis in range(3)
                ],
                axis=-1,
            )
            off = np.linalg.norm(own - course.at(drone, grid), axis=1)
            total += float(np.mean(np.minimum(off, FAR) ** 2))
        return total

    drones = list(times)
    first = drones[0]
    candidates = np.arange(
        times[first][0] - course.end, times[first][-1] - course.start, COARSE
    )
    best = min(candidates, key=lambda zero: misfit(float(zero), [first]))
    step = float(LAGS[1] - LAGS[0])
    fine = best + np.arange(-2.0 * COARSE, 2.0 * COARSE + step, step)
    return float(min(fine, key=lambda zero: misfit(float(zero), drones)))
