"""The polynomials of all drones, gathered into one table for each segment."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from showc.verify.damage import Damage
from showc.verify.kernel.show import (
    CONTROL_COMPONENTS,
    LARGEST,
    STATE_COMPONENTS,
    PieceTable,
    Segment,
)
from showc.verify.wire import numbers_and_runs

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.log import showc_pb2 as pb
    from showc.verify.logfile import LogFile

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]
    Bytes = NDArray[np.uint8]
    Runs = Sequence[tuple[int, int]]

TOPIC = re.compile(r"/drone/(\d+)/trajectory")

_MOST_PIECES = 10_000
"""Mesh intervals from which a trajectory is refused: far more than are written."""

_LARGEST_DEGREE = 60
"""Beyond it binomials lose digits; no useful polynomial has it."""


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
    gathering = _Gathering(messages, epoch)
    for data, m, offset in log.read(set(channels)):
        raw = np.frombuffer(data, dtype=np.uint8)
        for start, size, time, channel in zip(
            m.payload.tolist(),
            m.size.tolist(),
            m.log_time.tolist(),
            m.channel.tolist(),
            strict=True,
        ):
            try:
                integers, runs = numbers_and_runs(data, start, start + size)
            except Damage as damage:
                raise Damage(offset, damage.text) from damage
            trajectory = _trajectory(raw, integers, runs, offset)
            if trajectory.drone != channels[channel]:
                raise Damage(offset, "a trajectory is on another drone's channel")
            gathering.add(trajectory, integers.get(1, 0), time)
    for index, message in messages.items():
        if index not in gathering.whole:
            raise Damage(
                0, f"segment {message.name!r} lacks the trajectories of its drones"
            )
    return gathering.whole


class _Trajectory(NamedTuple):
    """One message, its numbers still as bytes of its chunk."""

    drone: int
    pieces: int
    degrees: tuple[int, int]
    """Of state and control."""
    raw: Bytes
    """Of its chunk."""
    breaks: Runs
    state: Runs
    control: Runs
    offset: int
    """Where the data of its chunk begin in the file [bytes]."""


def _trajectory(
    raw: Bytes,
    integers: dict[int, int],
    runs: dict[int, list[tuple[int, int]]],
    offset: int,
) -> _Trajectory:
    """Find the parts of one message in the chunk's bytes ``raw``."""
    breaks, state, control = runs.get(3, []), runs.get(5, []), runs.get(7, [])
    pieces = _count(breaks) - 1
    degrees = integers.get(4, 0), integers.get(6, 0)
    if not (
        0 < pieces <= _MOST_PIECES
        and max(degrees) <= _LARGEST_DEGREE
        and _count(state) == pieces * (degrees[0] + 1) * STATE_COMPONENTS
        and _count(control) == pieces * (degrees[1] + 1) * CONTROL_COMPONENTS
    ):
        raise _contradiction(offset)
    drone = integers.get(2, 0)
    return _Trajectory(drone, pieces, degrees, raw, breaks, state, control, offset)


def _count(runs: Runs) -> int:
    """Count the doubles in some runs of bytes."""
    return sum([end - begin for begin, end in runs]) // 8


def _contradiction(offset: int) -> Damage:
    return Damage(offset, "a trajectory contradicts itself")


class _Gathering:
    """Collects trajectories until a segment has all of its drones'."""

    def __init__(self, messages: dict[int, pb.Segment], epoch: int) -> None:
        self.whole: dict[int, Segment] = {}
        self._messages = messages
        self._waiting = {
            index: set(message.drones) for index, message in messages.items()
        }
        self._starts = {
            index: epoch + round(message.start * 1e9)
            for index, message in messages.items()
        }
        self._found: dict[int, list[_Trajectory]] = defaultdict(list)

    def add(self, trajectory: _Trajectory, index: int, time: int) -> None:
        """Take the next trajectory of the file, of segment ``index``."""
        if trajectory.drone not in self._waiting.get(index, ()):
            raise Damage(
                trajectory.offset,
                f"drone {trajectory.drone + 1} flies segment {index} twice, or is not "
                "one of its drones",
            )
        if abs(time - self._starts[index]) > 1:
            raise Damage(
                trajectory.offset, "a trajectory is not at its segment's start"
            )
        self._waiting[index].remove(trajectory.drone)
        self._found[index].append(trajectory)
        if not self._waiting[index]:
            # Copied into tables at once, so that the chunk's bytes can go.
            found = self._found.pop(index)
            self.whole[index] = _segment(self._messages[index], found)


def _segment(message: pb.Segment, trajectories: list[_Trajectory]) -> Segment:
    groups: dict[tuple[int, int], list[_Trajectory]] = defaultdict(list)
    for trajectory in sorted(trajectories, key=lambda one: one.drone):
        groups[trajectory.degrees].append(trajectory)
    return Segment(
        message,
        tuple(_table(degrees, group) for degrees, group in sorted(groups.items())),
        np.array(message.drones, dtype=np.int64),
        np.array(message.goals).reshape(-1, 3),
    )


def _table(degrees: tuple[int, int], group: list[_Trajectory]) -> PieceTable:
    pieces = np.array([trajectory.pieces for trajectory in group])
    first = np.concatenate([[0], np.cumsum(pieces)]).astype(np.int64)
    breaks = _doubles([one.raw[a:b] for one in group for a, b in one.breaks])
    # Every break but a trajectory's last starts a piece, all but its first end one.
    begins, ends = np.ones(breaks.size, dtype=bool), np.ones(breaks.size, dtype=bool)
    begins[first[1:] + np.arange(len(group))] = False
    ends[first[:-1] + np.arange(len(group))] = False
    table = PieceTable(
        drones=np.array([trajectory.drone for trajectory in group], dtype=np.int64),
        first=first,
        start=breaks[begins],
        end=breaks[ends],
        state=_doubles([one.raw[a:b] for one in group for a, b in one.state]).reshape(
            -1, degrees[0] + 1, STATE_COMPONENTS
        ),
        control=_doubles(
            [one.raw[a:b] for one in group for a, b in one.control]
        ).reshape(-1, degrees[1] + 1, CONTROL_COMPONENTS),
    )
    bad = _senseless(table)
    if bad.size:
        owners = np.searchsorted(first, bad, side="right") - 1
        raise _contradiction(min(group[owner].offset for owner in owners.tolist()))
    return table


def _doubles(runs: Sequence[Bytes]) -> FloatArray:
    """Join runs of bytes; where they stand in a chunk, doubles are not aligned."""
    return np.concatenate(runs).view("<f8").astype(np.float64, copy=False)


def _senseless(table: PieceTable) -> IntArray:
    """Rows that take no time, or hold a number with which one cannot calculate."""
    numbers = (table.start, table.end, table.state, table.control)
    # Numbers that are undefined make the comparison false.
    if all(
        array.max() < LARGEST and array.min() > -LARGEST for array in numbers
    ) and np.all(table.end > table.start):
        return np.empty(0, dtype=np.int64)
    good = table.end > table.start
    for array in numbers:
        good &= np.all(np.abs(array).reshape(good.size, -1) < LARGEST, axis=1)
    return np.flatnonzero(~good)
