"""The polynomials of all drones, gathered into one table for each segment."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from google.protobuf.message import DecodeError

from showc.log import showc_pb2 as pb
from showc.verify.damage import Damage
from showc.verify.kernel.show import (
    CONTROL_COMPONENTS,
    LARGEST,
    STATE_COMPONENTS,
    PieceTable,
    Segment,
)

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.verify.logfile import LogFile


TOPIC = re.compile(r"/drone/(\d+)/trajectory")

_MOST_PIECES = 10_000
"""Mesh intervals from which a trajectory is refused: far more than are written."""

_LARGEST_DEGREE = 60
"""Beyond it binomials lose digits; no useful polynomial has it."""


class _Flight(NamedTuple):
    """One trajectory: breaks (K + 1,), coefficients (K, degree + 1, components)."""

    breaks: FloatArray
    state: FloatArray
    control: FloatArray


def read_segments(
    log: LogFile, rules: pb.Rules, messages: dict[int, pb.Segment], epoch: int
) -> dict[int, Segment]:
    """Gather the trajectories of all segments.

    Parameters
    ----------
    log
        The file.
    rules
        Rules of the show.
    messages
        What the log says of each segment, by its index.
    epoch
        Time stamp of show time zero [ns].

    Raises
    ------
    Damage
        If trajectories are missing, double, malformed or not where they belong.
    """
    channels = {
        number: int(match[1]) - 1
        for number, channel in log.channels.items()
        if (match := TOPIC.fullmatch(channel.topic))
    }
    if sorted(channels.values()) != list(range(rules.drones)):
        raise Damage(
            0,
            f"there are trajectories of {len(channels)} drones, not of {rules.drones}",
        )
    missing = {index: set(message.drones) for index, message in messages.items()}
    flights: dict[int, dict[int, _Flight]] = defaultdict(dict)
    whole: dict[int, Segment] = {}
    for data, m, offset in log.read(set(channels)):
        for start, size, time, channel in zip(
            m.payload.tolist(),
            m.size.tolist(),
            m.log_time.tolist(),
            m.channel.tolist(),
            strict=True,
        ):
            found = _parsed(data[start : start + size], offset)
            index, drone = found.segment, found.drone
            if drone != channels[channel]:
                raise Damage(offset, "a trajectory is on another drone's channel")
            if drone not in missing.get(index, ()):
                raise Damage(
                    offset,
                    f"drone {drone + 1} flies segment {index} twice, or is not one of "
                    "its drones",
                )
            if abs(time - epoch - round(messages[index].start * 1e9)) > 1:
                raise Damage(offset, "a trajectory is not at its segment's start")
            missing[index].remove(drone)
            flights[index][drone] = _flight(found, offset)
            if not missing[index]:
                # Joined at once, so that the parts can go.
                whole[index] = _segment(messages[index], flights.pop(index))
    for index, message in messages.items():
        if index not in whole:
            raise Damage(
                0, f"segment {message.name!r} lacks the trajectories of its drones"
            )
    return whole


def _parsed(data: bytes, offset: int) -> pb.Trajectory:
    try:
        found = pb.Trajectory.FromString(data)
    except (DecodeError, MemoryError) as error:
        raise Damage(offset, f"a trajectory does not decode ({error})") from error
    # Fields that are not known are written again as they came.
    size = found.ByteSize()
    found.DiscardUnknownFields()
    if found.ByteSize() != size:
        raise Damage(offset, "a trajectory holds fields that are not known")
    return found


def _flight(found: pb.Trajectory, offset: int) -> _Flight:
    """Return a trajectory's numbers; damage if they contradict each other."""
    pieces = len(found.breaks) - 1
    parts = (
        (found.state, found.state_degree + 1, STATE_COMPONENTS),
        (found.control, found.control_degree + 1, CONTROL_COMPONENTS),
    )
    if not 0 < pieces <= _MOST_PIECES or any(
        terms > _LARGEST_DEGREE + 1 or len(numbers) != pieces * terms * components
        for numbers, terms, components in parts
    ):
        raise Damage(offset, "a trajectory contradicts itself")
    breaks = np.array(found.breaks)
    state, control = (
        np.array(numbers).reshape(pieces, terms, components)
        for numbers, terms, components in parts
    )
    # Numbers that are undefined make the comparisons false.
    if not (
        np.all(np.diff(breaks) > 0.0)
        and all(
            array.max() < LARGEST and array.min() > -LARGEST
            for array in (breaks, state, control)
        )
    ):
        raise Damage(offset, "a trajectory contradicts itself")
    return _Flight(breaks, state, control)


def _segment(message: pb.Segment, flights: dict[int, _Flight]) -> Segment:
    groups: dict[tuple[int, int], list[int]] = defaultdict(list)
    for drone in sorted(flights):
        flight = flights[drone]
        groups[flight.state.shape[1], flight.control.shape[1]].append(drone)
    return Segment(
        message,
        tuple(
            _table(drones, [flights[drone] for drone in drones])
            for _, drones in sorted(groups.items())
        ),
        np.array(message.goals).reshape(-1, 3),
    )


def _table(drones: list[int], flights: list[_Flight]) -> PieceTable:
    """Join flights of the same two degrees."""
    pieces = [len(flight.state) for flight in flights]
    return PieceTable(
        drones=np.array(drones, dtype=np.int64),
        first=np.concatenate([[0], np.cumsum(pieces)]).astype(np.int64),
        start=np.concatenate([flight.breaks[:-1] for flight in flights]),
        end=np.concatenate([flight.breaks[1:] for flight in flights]),
        state=np.concatenate([flight.state for flight in flights]),
        control=np.concatenate([flight.control for flight in flights]),
    )
