"""Read a trajectory log back, for pictures, reports, streams and comparisons.

What a log says is trusted here once its container is whole; :mod:`showc.log.container`
sees to that, for the verifier too, which goes on and trusts nothing of it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.message import DecodeError

from showc.errors import DamagedFileError
from showc.flight import MeshTaken, Trajectory
from showc.log import schema
from showc.log import showc_pb2 as pb
from showc.log.container import open_log
from showc.log.facts import named_digest
from showc.log.records import Damage
from showc.log.sample import NANOSECONDS, PLACE, POINT, nanoseconds
from showc.trajectory import PiecewisePolynomial, concatenate

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.log.container import LogFile
    from showc.script import LoadResult


@dataclass(frozen=True, eq=False)
class LoggedSegment:
    """One leg as the log has it."""

    message: pb.Segment
    """Names, times, goals, certificate."""
    payloads: tuple[bytes, ...]
    """Encoded ``showc.Trajectory`` of each drone of ``message.drones``."""

    @property
    def start(self) -> float:
        """Show time at which it starts [s]."""
        return float(self.message.start)

    @property
    def duration(self) -> float:
        """How long it lasts [s]."""
        return float(self.message.duration)

    @property
    def kind(self) -> str:
        """``launch``, ``transition``, ``approach``, ``land`` or ``hold``."""
        return str(pb.Segment.Kind.Name(self.message.kind)).lower()

    @cached_property
    def drones(self) -> IntArray:
        """Drones that take part, counting from 0, increasing."""
        return np.array(self.message.drones, dtype=np.int64)

    def trajectory(self, position: int) -> Trajectory:
        """Exact flight, in time since the start, of the drone at ``position``.

        Raises
        ------
        DamagedFileError
            If its message makes no polynomials.
        """
        try:
            message = pb.Trajectory.FromString(self.payloads[position])
            breaks = np.array(message.breaks)
            parts = [
                PiecewisePolynomial(
                    breaks, np.array(values).reshape(-1, degree + 1, components)
                )
                for values, degree, components in (
                    (message.state, message.state_degree, 12),
                    (message.control, message.control_degree, 4),
                )
            ]
        except (DecodeError, ValueError) as error:
            raise DamagedFileError(
                f"segment {self.message.index}: the trajectory of drone "
                f"{self.message.drones[position] + 1} makes no polynomials: {error}"
            ) from error
        meshes = tuple(
            MeshTaken(
                tuple(mesh.breaks),
                tuple(mesh.points),
                mesh.iterations,
                mesh.why,
                mesh.found,
                tuple(mesh.errors),
            )
            for mesh in message.meshes
        )
        return Trajectory(parts[0], parts[1], meshes)

    @cached_property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """Exact flights of all its drones, in the order of ``drones``."""
        return tuple(self.trajectory(k) for k in range(len(self.payloads)))


@dataclass(frozen=True, eq=False)
class LoggedShow:
    """A whole log."""

    source: str
    """Path of the file, for messages."""
    rules: pb.Rules
    """What the flight must keep, and what flies."""
    segments: tuple[LoggedSegment, ...]
    """All legs, in the order of their start."""
    times: FloatArray
    """Show times of the samples, shape (T,) [s]."""
    samples: NDArray[np.void]
    """Records of ``showc.log.sample.POINT``, shape (T, drones)."""
    predicted_times: FloatArray
    """Times of the predicted fleet, shape (P,) [s]; empty where there is none."""
    predicted: NDArray[np.void]
    """Records of ``showc.log.sample.PLACE``, shape (P, drones)."""
    attachments: dict[str, bytes]
    """By name: script, inputs, manifest, layout."""
    metadata: dict[str, str]
    """The record ``showc``."""
    added: dict[str, bytes] = field(default_factory=dict)
    """What was added for this log, by name, see :mod:`showc.log.additions`."""

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return int(self.rules.drones)

    @property
    def duration(self) -> float:
        """Length of the show [s]."""
        return float(self.rules.duration)

    @property
    def script(self) -> bytes:
        """The show script."""
        return self.attachments.get(self.metadata.get("script", ""), b"")

    def read_script(self) -> LoadResult:
        """Read the show script, with the files that are attached to it."""
        from showc.script import read_show  # noqa: PLC0415 - few readers need it

        own = {
            self.metadata.get("script", ""),
            schema.MANIFEST_NAME,
            schema.LAYOUT_NAME,
        }
        inputs = {n: data for n, data in self.attachments.items() if n not in own}
        path = self.metadata.get("script", "script")
        return read_show(self.script, path=path, attached=inputs)

    @cached_property
    def aborts(self) -> pb.AbortTable:
        """How the stopped fleet comes down; without rows where none was planned."""
        return pb.AbortTable.FromString(self.added.get(schema.ABORT_NAME, b""))

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """What lies beside the missions; empty where it is no JSON object."""
        try:
            found = json.loads(self.attachments.get(schema.MANIFEST_NAME, b"{}"))
        except ValueError:
            return {}
        return found if isinstance(found, dict) else {}

    @cached_property
    def positions(self) -> FloatArray:
        """Sampled positions, shape (T, drones, 3), show frame [m]."""
        return np.stack([self.samples[name] for name in "xyz"], axis=-1, dtype=float)

    def trajectory(self, drone: int) -> Trajectory:
        """Exact flight of one drone, counting from 0, over the whole show."""
        state, control = [], []
        for segment in self.segments:
            position = int(np.searchsorted(segment.drones, drone))
            if position < segment.drones.size and segment.drones[position] == drone:
                flown = segment.trajectory(position)
                state.append(flown.state.shifted(segment.start))
                control.append(flown.control.shifted(segment.start))
        return Trajectory(concatenate(state), concatenate(control))


def read_log(source: Path | bytes, rate: float | None = None) -> LoggedShow:
    """Read a whole log; every byte of its container is looked at.

    Parameters
    ----------
    source
        The file, or its content.
    rate
        How many samples of the fleet a second are kept at most [Hz]: those of 1,000
        drones over 200 s take 0.4 GB; None: all.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DamagedFileError
        If it is no log of showc, or not what it was when it was written.
    """
    log = open_log(source)
    with log.reported():
        try:
            return _show(log, 0.0 if rate is None else NANOSECONDS / rate)
        except (DecodeError, ValueError, LookupError) as error:
            text = str(error) or type(error).__name__
            raise Damage(0, f"its messages make no show ({text})") from error


def _show(log: LogFile, gap: float) -> LoggedShow:
    """Gather what messages and attachments say, samples no nearer than ``gap`` [ns]."""
    topics = {number: channel.topic for number, channel in log.channels.items()}
    rules: pb.Rules | None = None
    segments: list[pb.Segment] = []
    flights: dict[tuple[int, int], bytes] = {}
    fleet = {schema.FLEET: _Points(gap), schema.PREDICTED: _Points(gap)}
    single = {n for n, topic in topics.items() if topic.endswith("/state")}
    single -= {n for n, topic in topics.items() if topic in fleet}
    for message in log.messages(topics.keys() - single):
        topic, data = topics[message.channel], message.data
        if topic in fleet:
            fleet[topic].take(message.time, PointCloud.FromString(data).data)
        elif topic.endswith("/trajectory"):
            found = pb.Trajectory.FromString(data)
            flights[found.segment, found.drone] = data
        elif topic == schema.RULES:
            rules = pb.Rules.FromString(data)
        elif topic == schema.SEGMENTS:
            segments.append(pb.Segment.FromString(data))
    metadata = dict(log.metadata).get(schema.METADATA_NAME, {})
    if rules is None or not metadata:
        text = f"it has no rules or no metadata record named {schema.METADATA_NAME!r}"
        raise Damage(0, f"this is not a log of showc: {text}")
    legs = tuple(
        LoggedSegment(one, tuple(flights[one.index, drone] for drone in one.drones))
        for one in segments
    )
    epoch = int(metadata["epoch_ns"])
    times, samples = fleet[schema.FLEET].read(POINT, epoch, rules.drones)
    predicted = fleet[schema.PREDICTED].read(PLACE, epoch, rules.drones)
    if not legs or not times.size:
        raise ValueError("it has no segments or no samples")
    if nanoseconds(rules.duration) != round(times[-1] * NANOSECONDS):
        raise ValueError("its samples do not reach the end of the show")
    attachments = {one.name: log.attachment(one.name) or b"" for one in log.attachments}
    late = [one for one in schema.ADDITIONS if one in attachments]
    added = {name: attachments.pop(name) for name in late}
    # What was added to another log says nothing of this one.
    digest = log.before(late) if late else ""
    return LoggedShow(
        source=str(log.path),
        rules=rules,
        segments=legs,
        times=times,
        samples=samples,
        predicted_times=predicted[0],
        predicted=predicted[1],
        attachments=attachments,
        metadata=metadata,
        added={k: one for k, one in added.items() if named_digest(k, one) == digest},
    )


class _Points:
    """Points of a fleet's messages, one after the other, no nearer than ``gap`` [ns].

    They grow in one place: as objects of their own they would leave holes in memory.
    """

    def __init__(self, gap: float) -> None:
        self.gap = gap
        self.times: list[int] = []
        self.data = bytearray()
        self.last = 0

    def take(self, time: int, points: bytes) -> None:
        """Add a message's; the last one is always kept, as yet."""
        if len(self.times) > 1 and self.times[-1] - self.times[-2] < self.gap:
            self.times.pop()
            del self.data[len(self.data) - self.last :]
        self.times.append(time)
        self.data += points
        self.last = len(points)

    def read(
        self, kind: np.dtype[np.void], epoch: int, drones: int
    ) -> tuple[FloatArray, NDArray[np.void]]:
        """Return times (n,) [s], and points (n, drones)."""
        times = np.array(self.times, dtype=np.int64) - epoch
        points = np.frombuffer(self.data, dtype=kind)
        return times / NANOSECONDS, points.reshape(times.size, drones)
