"""What a fleet was to fly, with its legs: trajectories, or the predicted missions."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from showc.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from showc.arrays import FloatArray
    from showc.log.reader import LoggedSegment, LoggedShow
    from showc.trajectory import PiecewisePolynomial


Kind = Literal["trajectories", "missions"]

HOUR = 3600.0
"""[s]."""


@dataclass(frozen=True, slots=True, eq=False)
class CourseLeg:
    """One move of some drones."""

    name: str
    """For people."""
    drones: tuple[int, ...]
    """Counting from 0."""
    start: float
    """When the first of them begins [s]."""
    arrivals: FloatArray
    """When each is to arrive, shape (n,) [s]."""
    goals: FloatArray
    """Where, shape (n, 3), show frame [m]; empty where none is to arrive on time."""
    until: float
    """When the next leg begins: all are settled just before [s]."""
    proved: float | None
    """Least distance of two of them that was proved, in the show's metric [m]."""


@dataclass(frozen=True, eq=False)
class Course:
    """What a fleet was to fly."""

    kind: Kind
    legs: tuple[CourseLeg, ...]
    """In the order of time; the climb first and the landing last."""
    start: float
    """Where it begins [s]."""
    end: float
    """Where it ends [s]."""
    pads: FloatArray
    """Where the drones stand, shape (drones, 3), show frame [m]."""
    paths: tuple[PiecewisePolynomial, ...] | None
    """Of each drone, for trajectories."""
    times: FloatArray
    """Of the predicted places, shape (k,) [s], for missions."""
    places: FloatArray
    """Predicted, shape (k, drones, 3) [m]."""
    begins: datetime | None
    """UTC of time 0; None: at a minute of any hour, or not known."""
    minute: int | None
    """That minute."""

    def at(self, drone: int, times: FloatArray) -> FloatArray:
        """Return where ``drone`` (counting from 0) is to be, shape (k, 3) [m]."""
        if self.paths is not None:
            path = self.paths[drone]
            return np.asarray(path(np.clip(times, path.start, path.end)))
        return np.stack(
            [
                np.interp(times, self.times, self.places[:, drone, axis])
                for axis in range(3)
            ],
            axis=-1,
        )

    def zero(self, flown: FloatArray) -> float | None:
        """Return the UTC of show time 0 [s since 1970] for a flight.

        Parameters
        ----------
        flown
            UTC of the flight's positions [s since 1970]; decides the hour.
        """
        if self.begins is not None:
            return self.begins.timestamp()
        if self.minute is None:
            return None
        middle = float(flown[0] + flown[-1]) / 2.0 - (self.start + self.end) / 2.0
        offset = 60.0 * self.minute
        return offset + HOUR * round((middle - offset) / HOUR)


def course_of(show: LoggedShow, kind: Kind) -> Course:
    """Return what the fleet of a logged show was to fly.

    Raises
    ------
    UsageError
        If missions are asked for and the log holds none that were predicted.
    """
    return _missions(show) if kind == "missions" else _trajectories(show)


def _trajectories(show: LoggedShow) -> Course:
    paths = tuple(
        show.trajectory(drone).state.select([0, 1, 2]) for drone in range(show.drones)
    )
    moving = [segment for segment in show.segments if segment.kind != "hold"]
    flown = [(one, _leg_of(show, one, moving)) for one in moving]
    launches = [leg.until for one, leg in flown if one.kind == "launch"]
    beside = any(one.message.moves for one in moving)
    script = show.read_script().show if beside else None
    groups = {} if script is None else script.groups
    legs = tuple(part for one, leg in flown for part in _parts(show, one, leg, groups))
    return Course(
        "trajectories",
        legs,
        max(launches, default=0.0),
        show.duration,
        np.array([path(0.0) for path in paths]),
        paths,
        np.zeros(0),
        np.zeros((0, show.drones, 3)),
        None,
        None,
    )


def _leg_of(
    show: LoggedShow, segment: LoggedSegment, moving: list[LoggedSegment]
) -> CourseLeg:
    end = segment.start + segment.duration
    later = [one.start for one in moving if one.start >= end - 1e-9]
    certificate = segment.message.certificate
    proved = None
    if certificate.HasField("closest"):
        proved = float(certificate.closest.distance)
    drones = tuple(int(drone) for drone in segment.drones)
    return CourseLeg(
        segment.message.name or segment.kind,
        drones,
        segment.start,
        np.full(len(drones), end),
        _goals(show, drones, end),
        min(later, default=show.duration),
        proved,
    )


def _parts(
    show: LoggedShow,
    segment: LoggedSegment,
    whole: CourseLeg,
    groups: Mapping[str, tuple[int, ...]],
) -> Iterator[CourseLeg]:
    """Yield the moves of groups that have times of their own; else the whole leg."""
    moves = [one for one in segment.message.moves if one.group in groups]
    if not moves:
        yield whole
    for move in sorted(moves, key=lambda one: one.start):
        drones, end = tuple(groups[move.group]), move.start + move.duration
        later = [one.start for one in moves if one.group == move.group]
        yield CourseLeg(
            move.name,
            drones,
            move.start,
            np.full(len(drones), end),
            _goals(show, drones, end),
            min((start for start in later if start >= end), default=whole.until),
            whole.proved,
        )


def _missions(show: LoggedShow) -> Course:
    prediction: dict[str, Any] = show.manifest.get("missions", {}).get("prediction", {})
    if not show.predicted_times.size or not prediction.get("legs"):
        raise UsageError(
            f"{show.source}: holds no predicted missions; compile the show with "
            "missions, or compare with --against trajectories"
        )
    times = show.predicted_times
    places = np.stack([show.predicted[name] for name in "xyz"], axis=-1, dtype=float)
    everyone = tuple(range(show.drones))
    entries = sorted(prediction["legs"], key=lambda entry: float(entry["slot"]))
    slots = [
        (float(slot), frozenset(entry["drones"]))
        for entry in entries
        for slot in entry["slots"]
    ]
    landing = float(prediction["land_start"])
    legs = [
        CourseLeg(
            "climb",
            everyone,
            0.0,
            np.zeros(0),
            np.zeros((0, 3)),
            min(slot for slot, _ in slots),
            _distance(prediction.get("launch")),
        )
    ]
    for entry in entries:
        arrivals = np.array(entry["arrivals"], dtype=np.float64)
        # Groups may fly beside each other: what its own drones fly next ends a leg.
        own = frozenset(entry["drones"])
        later = [slot for slot, some in slots if slot > arrivals.max() and some & own]
        drones = tuple(int(drone) - 1 for drone in entry["drones"])
        end = float(entry["optimal_start"]) + float(entry["optimal_duration"])
        legs.append(
            CourseLeg(
                str(entry["name"]),
                drones,
                min(float(slot) for slot in entry["slots"]),
                arrivals,
                _goals(show, drones, end),
                min(later, default=landing),
                _distance(entry.get("closest")),
            )
        )
    end = float(prediction["duration"])
    closest = _distance(prediction.get("land"))
    none, nowhere = np.zeros(0), np.zeros((0, 3))
    legs.append(CourseLeg("landing", everyone, landing, none, nowhere, end, closest))
    start = prediction.get("start")
    return Course(
        "missions",
        tuple(legs),
        0.0,
        end,
        places[0],
        None,
        times,
        places,
        None if start is None else datetime.fromisoformat(start).astimezone(UTC),
        prediction.get("start_minute"),
    )


def _goals(show: LoggedShow, drones: tuple[int, ...], end: float) -> FloatArray:
    """Return where the trajectories of ``drones`` are at ``end`` [s], (n, 3) [m]."""
    places = [
        show.trajectory(drone).state.select([0, 1, 2])(np.array([end]))[0]
        for drone in drones
    ]
    return np.array(places).reshape(-1, 3)


def _distance(encounter: dict[str, Any] | None) -> float | None:
    return None if not encounter else float(encounter["distance"])
