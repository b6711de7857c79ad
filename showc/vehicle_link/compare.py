"""Hold what was flown against the plan, by leg and by drone."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.mission.predict import ARRIVED
from showc.vehicle_link.overlay import LAGS, Flown

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.log.reader import LoggedShow
    from showc.vehicle_link.course import CourseLeg, Kind


LATEST = 8.0
"""How long after its moment an arrival is still looked for [s]."""

SETTLED = 0.05
"""How long before the next leg a drone is looked at [s]."""

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
    """Positions in its log."""
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
class LegFlight:
    """How one drone flew one leg."""

    drone: int
    """Counting from 1."""
    late: float | None
    """Arrival within 0.3 m of the goal, less the plan's [s]; None: never, or it was
    there all along."""
    at_arrival: float | None
    """Distance to the plan when it was to arrive [m]; None in climb and landing."""
    settled: float
    """Distance to the plan just before the next leg [m]."""
    greatest_error: float
    """Greatest distance to the plan during the leg [m]."""
    rms_error: float
    """Root of the mean square of it [m]."""
    speed: float
    """Greatest speed that was planned [m/s]."""


@dataclass(frozen=True, slots=True)
class LegComparison:
    """How a fleet flew one leg."""

    name: str
    """As in the script."""
    start: float
    """When it began [s]."""
    end: float
    """When the next one began [s]."""
    flights: tuple[LegFlight, ...]
    """By drone; only those whose log covers it."""
    tightest: float | None
    """Least distance of two drones that was flown, in the show's metric [m]."""
    tightest_drones: tuple[int, int] | None
    """Which two, counting from 1."""
    tightest_time: float | None
    """When [s]."""
    proved: float | None
    """Least distance that was proved [m]."""

    @property
    def lateness(self) -> tuple[float, float] | None:
        """Earliest and latest arrival against the plan [s]."""
        late = [one.late for one in self.flights if one.late is not None]
        return (min(late), max(late)) if late else None

    def greatest(self, name: str) -> float | None:
        """Greatest value of a field of its flights; None where there is none."""
        values = [
            value for one in self.flights if (value := getattr(one, name)) is not None
        ]
        return max(values) if values else None


@dataclass(frozen=True, slots=True)
class Comparison:
    """How a fleet kept to its plan."""

    against: Kind
    """What the flight was held against."""
    drones: tuple[DroneComparison, ...]
    """By drone."""
    legs: tuple[LegComparison, ...]
    """In the order of time."""
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


def compared(flight: Flown) -> Comparison:
    """Measure how a flight kept to its plan."""
    everywhere = _separation(flight, -np.inf, np.inf)
    return Comparison(
        flight.course.kind,
        tuple(_drone(flight, drone) for drone in flight.tracks),
        tuple(_leg(flight, leg) for leg in flight.course.legs),
        float(flight.show.rules.separation.distance),
        *everywhere,
    )


def _drone(flight: Flown, drone: int) -> DroneComparison:
    track, course = flight.tracks[drone], flight.course
    error = flight.errors(drone)
    # Shift the plan, but only over times that it covers both ways.
    inner = (track.times - LAGS[-1] >= course.start) & (
        track.times - LAGS[0] <= course.end
    )
    if not inner.any():
        inner[:] = True
    times, positions = track.times[inner], track.positions[inner]
    shifted = [
        np.sqrt(
            np.mean(np.sum((positions - course.at(drone, times - lag)) ** 2, axis=1))
        )
        for lag in LAGS
    ]
    best = int(np.argmin(shifted))
    worst = int(np.argmax(error))
    return DroneComparison(
        drone + 1,
        int(track.times.size),
        round(float(track.times[0]), 3),
        round(float(track.times[-1]), 3),
        round(float(error[worst]), 4),
        round(float(track.times[worst]), 3),
        round(float(np.sqrt(np.mean(error**2))), 4),
        round(float(LAGS[best]), 3),
        round(float(shifted[best]), 4),
    )


def _leg(flight: Flown, leg: CourseLeg) -> LegComparison:
    flights = []
    for position, drone in enumerate(leg.drones):
        track = flight.tracks.get(drone)
        # A log may begin or end within climb and landing, but not within a leg.
        if track is None:
            continue
        arrival = float(leg.arrivals[position]) if leg.arrivals.size else None
        begin = leg.start if arrival is not None else track.times[0]
        end = arrival if arrival is not None else begin
        if track.times[0] <= begin + SETTLED and track.times[-1] >= end - SETTLED:
            one = _leg_flight(flight, leg, drone, arrival)
            if one is not None:
                flights.append(one)
    return LegComparison(
        leg.name,
        round(leg.start, 3),
        round(leg.until, 3),
        tuple(flights),
        *_separation(flight, leg.start, leg.until),
        leg.proved,
    )


def _leg_flight(
    flight: Flown, leg: CourseLeg, drone: int, arrival: float | None
) -> LegFlight | None:
    track, course = flight.tracks[drone], flight.course
    during = (track.times >= leg.start) & (track.times < leg.until)
    if not during.any():
        return None
    error = flight.errors(drone)[during]
    last = max(leg.until - SETTLED, leg.start)
    fine = np.linspace(leg.start, leg.until, 1001)
    steps = np.diff(course.at(drone, fine), axis=0) / np.diff(fine)[:, None]
    return LegFlight(
        drone + 1,
        None if arrival is None else _lateness(flight, leg, drone),
        None if arrival is None else _off(flight, drone, arrival),
        _off(flight, drone, min(last, float(track.times[-1]))),
        round(float(error.max()), 4),
        round(float(np.sqrt(np.mean(error**2))), 4),
        round(float(np.linalg.norm(steps, axis=1).max()), 2),
    )


def _lateness(flight: Flown, leg: CourseLeg, drone: int) -> float | None:
    """Arrival near the leg's goal, less the plan's [s]."""
    track, course = flight.tracks[drone], flight.course
    goal = leg.goals[leg.drones.index(drone)]
    fine = np.linspace(leg.start, leg.until, 1001)
    planned = _entry(fine, course.at(drone, fine), goal)
    during = (track.times >= leg.start) & (track.times <= leg.until + LATEST)
    flown = _entry(track.times[during], track.positions[during], goal)
    if flown is None or planned is None or planned <= fine[0]:
        return None
    return round(flown - planned, 3)


def _entry(times: FloatArray, places: FloatArray, goal: FloatArray) -> float | None:
    """First time [s] at which a drone is near ``goal``; None: never."""
    off = np.linalg.norm(places - goal, axis=1)
    near = off <= ARRIVED
    if not near.any():
        return None
    first = int(np.argmax(near))
    if first == 0:
        return float(times[0])
    part = (off[first - 1] - ARRIVED) / (off[first - 1] - off[first])
    return float(times[first - 1] + part * (times[first] - times[first - 1]))


def _off(flight: Flown, drone: int, moment: float) -> float:
    """Distance of a drone to its plan at a moment [m]."""
    track = flight.tracks[drone]
    place = [np.interp(moment, track.times, track.positions[:, k]) for k in range(3)]
    planned = flight.course.at(drone, np.array([moment]))[0]
    return round(float(np.linalg.norm(np.array(place) - planned)), 4)


def _separation(
    flight: Flown, start: float, end: float
) -> tuple[float | None, tuple[int, int] | None, float | None]:
    """Least distance of two drones on a common grid of times, which and when."""
    tracks = flight.tracks
    start = max([start, *(float(track.times[0]) for track in tracks.values())])
    end = min([end, *(float(track.times[-1]) for track in tracks.values())])
    if len(tracks) < 2 or end < start:
        return None, None, None
    times = np.arange(start, end + GRID / 2, GRID)
    names, places = list(tracks), _places(flight, times)
    best, pair, when = np.inf, (0, 0), 0.0
    for index in range(len(names) - 1):
        distance = _distances(flight.show, places[index] - places[index + 1 :])
        other, moment = np.unravel_index(int(distance.argmin()), distance.shape)
        if distance[other, moment] < best:
            best = float(distance[other, moment])
            pair = (names[index] + 1, names[index + 1 + int(other)] + 1)
            when = float(times[moment])
    return round(best, 4), pair, round(when, 3)


def nearest(flight: Flown, times: FloatArray) -> FloatArray:
    """Return the least distance of two drones at ``times`` (k,), shape (k,) [m]."""
    places = _places(flight, times)
    least = np.full(times.size, np.inf)
    for index in range(len(places) - 1):
        distance = _distances(flight.show, places[index] - places[index + 1 :])
        least = np.minimum(least, distance.min(axis=0))
    return least


def _places(flight: Flown, times: FloatArray) -> FloatArray:
    """Return where the drones were at ``times`` (k,), shape (n, 3, k) [m]."""
    return np.stack(
        [
            np.stack(
                [np.interp(times, track.times, track.positions[:, k]) for k in range(3)]
            )
            for track in flight.tracks.values()
        ]
    )


def _distances(show: LoggedShow, gap: FloatArray) -> FloatArray:
    """Distances in the show's metric for gaps (n, 3, k), shape (n, k) [m]."""
    rules = show.rules.separation
    shape = SHAPES[rules.shape]
    if shape == "any-axis":
        return np.asarray(np.abs(gap).max(axis=1))
    if shape == "all-axes":
        return np.asarray(np.abs(gap).min(axis=1))
    scale = np.ones(3)
    if shape == "ellipsoid":
        scale[2] = 1.0 / rules.vertical_stretch
    return np.asarray(np.linalg.norm(gap * scale[:, None], axis=1))
