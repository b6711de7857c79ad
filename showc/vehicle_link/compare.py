"""Hold what was flown against the plan."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import UsageError
from showc.log.reader import read_log
from showc.vehicle_link.flown import read_flown

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from showc.log.reader import LoggedShow
    from showc.trajectory import PiecewisePolynomial
    from showc.vehicle_link.flown import Track

    FloatArray = NDArray[np.float64]

ARRIVED = 0.3
"""A drone has arrived when it is this near its goal [m]."""

LAGS = np.arange(-0.5, 2.001, 0.02)
"""Shifts in time that are tried [s]."""

GRID = 0.05
"""Step of the times at which all drones are looked at together [s]."""

SHAPES = ("sphere", "ellipsoid", "any-axis", "all-axes")
"""Names of the separation's shapes, in the order of the log's message."""


@dataclass(frozen=True, slots=True)
class DroneComparison:
    """How one drone kept to its plan."""

    drone: int
    """Counting from 1."""
    samples: int
    """Positions it told."""
    start: float
    """Show time of the first of them [s]."""
    end: float
    """Show time of the last of them [s]."""
    greatest_error: float
    """Greatest distance to the plan at equal time [m]."""
    greatest_error_time: float
    """When [s]."""
    rms_error: float
    """Root of the mean square of the distance [m]."""
    lag: float
    """Shift in time that fits best; positive: late [s]."""
    lagged_rms_error: float
    """What is left of ``rms_error`` then [m]."""


@dataclass(frozen=True, slots=True)
class ArrivalComparison:
    """When a drone came to the end of a segment."""

    segment: int
    """Index of the segment."""
    drone: int
    """Counting from 1."""
    difference: float | None
    """Arrival within 0.3 m, less the plan's [s]; None: never."""
    end_error: float
    """Distance to the goal at the segment's end [m]."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """How a fleet kept to its plan."""

    drones: tuple[DroneComparison, ...]
    """By drone."""
    arrivals: tuple[ArrivalComparison, ...]
    """By segment and drone."""
    separation: float
    """What the show wants [m]."""
    least_separation: float | None
    """Least distance of two drones, in the show's metric; None: only one flew [m]."""
    least_separation_drones: tuple[int, int] | None
    """Which two, counting from 1."""
    least_separation_time: float | None
    """When [s]."""

    @property
    def greatest_error(self) -> float:
        """Greatest distance of any drone to its plan [m]."""
        return max(drone.greatest_error for drone in self.drones)

    @property
    def kept_separation(self) -> bool:
        """Whether no two drones came nearer than the show wants."""
        return self.least_separation is None or self.least_separation >= self.separation

    def to_json(self) -> dict[str, Any]:
        """Return the comparison as JSON-able data."""
        return asdict(self)


def compare_flown(plan: Path, flown: Path) -> Comparison:
    """Compare the log of a flight with the log of the show it followed.

    Parameters
    ----------
    plan
        What ``showc compile`` wrote.
    flown
        What ``showc stream`` wrote.

    Raises
    ------
    UsageError
        If a file cannot be read, or the flight has a drone that the show has not.
    DamagedFileError
        If a file is damaged.
    """
    show, tracks = read_log(plan), read_flown(flown)
    strangers = [drone for drone in tracks if not 0 <= drone < show.drones]
    if strangers:
        raise UsageError(
            f"{flown}: has drone {strangers[0] + 1}, {plan} has {show.drones}: it is "
            "not a flight of that show"
        )
    paths = {drone: show.trajectory(drone).state.select([0, 1, 2]) for drone in tracks}
    least = _least_separation(show, tracks)
    return Comparison(
        tuple(_drone(track, paths[drone]) for drone, track in tracks.items()),
        tuple(_arrivals(show, tracks, paths)),
        float(show.rules.separation.distance),
        *least,
    )


def _drone(track: Track, path: PiecewisePolynomial) -> DroneComparison:
    error = np.linalg.norm(track.positions - path(track.times), axis=1)
    # Shift the plan, but only over times that it covers both ways.
    inner = (track.times - LAGS[-1] >= path.start) & (track.times - LAGS[0] <= path.end)
    if not inner.any():
        inner[:] = True
    times, positions = track.times[inner], track.positions[inner]
    shifted = [
        np.sqrt(np.mean(np.sum((positions - path(times - lag)) ** 2, axis=1)))
        for lag in LAGS
    ]
    best = int(np.argmin(shifted))
    worst = int(np.argmax(error))
    return DroneComparison(
        track.drone + 1,
        int(track.times.size),
        round(float(track.times[0]), 3),
        round(float(track.times[-1]), 3),
        round(float(error[worst]), 4),
        round(float(track.times[worst]), 3),
        round(float(np.sqrt(np.mean(error**2))), 4),
        round(float(LAGS[best]), 3),
        round(float(shifted[best]), 4),
    )


def _arrivals(
    show: LoggedShow,
    tracks: dict[int, Track],
    paths: dict[int, PiecewisePolynomial],
) -> list[ArrivalComparison]:
    """Arrivals at the ends of all segments that move."""
    found = []
    for index, segment in enumerate(show.segments):
        if segment.kind == "hold":
            continue
        start, end = segment.start, segment.start + segment.duration
        for drone in segment.drones.tolist():
            track = tracks.get(drone)
            if track is None or track.times[0] > end or track.times[-1] < end:
                continue
            goal = paths[drone](end)
            fine = np.linspace(start, end, 1001)
            planned = _entry(fine, paths[drone](fine), goal)
            during = (track.times >= start) & (track.times <= end + LAGS[-1])
            actual = _entry(track.times[during], track.positions[during], goal)
            at_end = np.array(
                [np.interp(end, track.times, track.positions[:, k]) for k in range(3)]
            )
            late = None if actual is None or planned is None else actual - planned
            found.append(
                ArrivalComparison(
                    index,
                    drone + 1,
                    None if late is None else round(late, 3),
                    round(float(np.linalg.norm(at_end - goal)), 4),
                )
            )
    return found


def _entry(times: FloatArray, places: FloatArray, goal: FloatArray) -> float | None:
    """First time [s] at which a drone is near ``goal``; None: never."""
    near = np.linalg.norm(places - goal, axis=1) <= ARRIVED
    return float(times[np.argmax(near)]) if near.any() else None


def _least_separation(
    show: LoggedShow, tracks: dict[int, Track]
) -> tuple[float | None, tuple[int, int] | None, float | None]:
    """Least distance of two drones on a common grid of times, who and when."""
    if len(tracks) < 2:
        return None, None, None
    rules = show.rules.separation
    shape = SHAPES[rules.shape]
    scale = np.ones(3)
    if shape == "ellipsoid":
        scale[2] = 1.0 / rules.vertical_stretch
    start = max(track.times[0] for track in tracks.values())
    end = min(track.times[-1] for track in tracks.values())
    times = np.arange(start, max(end, start) + GRID / 2, GRID)
    names = list(tracks)
    places = np.stack(
        [
            np.stack(
                [np.interp(times, track.times, track.positions[:, k]) for k in range(3)]
            )
            for track in tracks.values()
        ]
    )
    best, who, when = np.inf, (0, 0), 0.0
    for row in range(len(names) - 1):
        gap = (places[row] - places[row + 1 :]) * scale[:, None]
        if shape == "any-axis":
            distance = np.abs(gap).max(axis=1)
        elif shape == "all-axes":
            distance = np.abs(gap).min(axis=1)
        else:
            distance = np.linalg.norm(gap, axis=1)
        other, moment = np.unravel_index(int(distance.argmin()), distance.shape)
        if distance[other, moment] < best:
            best = float(distance[other, moment])
            who = (names[row] + 1, names[row + 1 + int(other)] + 1)
            when = float(times[moment])
    return round(best, 4), who, round(when, 3)
