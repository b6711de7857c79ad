"""Read a trajectory log back, for pictures, reports, streams and comparisons.

This reader belongs to the planner's side: it trusts what a log of showc says once its
checksums hold. The verifier has a reader of its own, which trusts nothing.
"""

from __future__ import annotations

import json
import struct
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader, get_chunk_data_stream
from zstandard import ZstdError

from showc.errors import DamagedFileError, UsageError
from showc.files import UnreadableFileError, open_file, reason_of
from showc.flight import MeshTaken, Trajectory
from showc.log import schema
from showc.log import showc_pb2 as pb
from showc.log.additions import data_digest, names
from showc.log.sample import NANOSECONDS, PLACE, POINT, nanoseconds
from showc.trajectory import PiecewisePolynomial, concatenate

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.script import LoadResult


_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_DAMAGE = (
    McapError,
    CRCValidationError,
    ZstdError,
    DecodeError,
    MemoryError,
    OverflowError,
    UnicodeDecodeError,
    ValueError,
    IndexError,
    KeyError,
    struct.error,
)
"""All that the libraries below raise on bytes that are not what they claim."""


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


def read_log(source: Path | bytes) -> LoggedShow:
    """Read a whole log, checking the sums of its chunks and of its data section.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DamagedFileError
        If it is no log of showc, or not what it was when it was written.
    """
    if isinstance(source, bytes):
        return _Reading("log", BytesIO(source), len(source)).read()
    try:
        with open_file(source) as stream:
            return _Reading(str(source), stream, source.stat().st_size).read()
    except (UnreadableFileError, OSError) as error:
        reason = getattr(error, "reason", None) or reason_of(error)
        raise UsageError(
            f"{source}: cannot be read ({reason}); give a log of 'showc compile'"
        ) from None


class _Reading:
    """Collects what a log holds while its records go by."""

    def __init__(self, name: str, stream: BinaryIO, size: int) -> None:
        self.name, self.stream, self.size = name, stream, size
        self.topics: dict[int, str] = {}
        self.attachments: dict[str, bytes] = {}
        self.added: dict[str, bytes] = {}
        self.metadata: dict[str, str] = {}
        self.rules: pb.Rules | None = None
        self.segments: list[pb.Segment] = []
        self.flights: dict[tuple[int, int], bytes] = {}
        self.fleet_times: dict[str, list[int]] = {
            schema.FLEET: [],
            schema.PREDICTED: [],
        }
        self.fleet_bytes = {topic: bytearray() for topic in self.fleet_times}

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except _DAMAGE as error:
            reason = str(error) or type(error).__name__
            raise DamagedFileError(
                f"{self.name}: damaged near byte {self.stream.tell()} of {self.size}: "
                f"{reason}; wanted a whole log of showc. 'showc verify' says more; "
                "compile the show again, or fetch the file again"
            ) from error

    def read(self) -> LoggedShow:
        with self._guarded():
            reader = StreamReader(
                self.stream,
                emit_chunks=True,
                validate_crcs=True,
                record_size_limit=self.size,
            )
            for record in reader.records:
                if isinstance(record, Chunk):
                    self._chunk(record)
                elif isinstance(record, Attachment):
                    late = record.name in schema.ADDITIONS and self.topics
                    (self.added if late else self.attachments)[record.name] = (
                        record.data
                    )
                elif (
                    isinstance(record, Metadata) and record.name == schema.METADATA_NAME
                ):
                    self.metadata = record.metadata
            if self.added:
                # What was added to another log says nothing of this one.
                digest = data_digest(self.stream)
                self.added = {
                    name: content
                    for name, content in self.added.items()
                    if names(name, content) == digest
                }
            return self._show()

    def _chunk(self, chunk: Chunk) -> None:
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        data = memoryview(stream.read(size))
        offset = 0
        while offset < size:
            opcode, length = _HEAD.unpack_from(data, offset)
            offset += _HEAD.size
            body = data[offset : offset + length]
            offset += length
            if opcode == Opcode.MESSAGE:
                channel, _, time, _ = _MESSAGE.unpack_from(body)
                self._message(self.topics[channel], time, body[_MESSAGE.size :])
            elif opcode == Opcode.CHANNEL:
                number, _, named = struct.unpack_from("<HHI", body)
                self.topics[number] = bytes(body[8 : 8 + named]).decode()

    def _message(self, topic: str, time: int, body: memoryview) -> None:
        if topic in self.fleet_times:
            self.fleet_times[topic].append(time)
            self.fleet_bytes[topic] += PointCloud.FromString(bytes(body)).data
        elif topic.endswith("/trajectory"):
            message = pb.Trajectory.FromString(payload := bytes(body))
            self.flights[message.segment, message.drone] = payload
        elif topic == schema.RULES:
            self.rules = pb.Rules.FromString(bytes(body))
        elif topic == schema.SEGMENTS:
            self.segments.append(pb.Segment.FromString(bytes(body)))

    def _show(self) -> LoggedShow:
        if self.rules is None or not self.metadata:
            raise DamagedFileError(
                f"{self.name}: not a log of showc: it has no rules or no metadata "
                f"record named {schema.METADATA_NAME!r}; wanted a file that "
                "'showc compile' has written"
            )
        segments = tuple(
            LoggedSegment(
                message,
                tuple(self.flights[message.index, drone] for drone in message.drones),
            )
            for message in self.segments
        )
        epoch = int(self.metadata["epoch_ns"])
        times, samples = self._fleet(schema.FLEET, POINT, epoch)
        predicted_times, predicted = self._fleet(schema.PREDICTED, PLACE, epoch)
        if not segments or not times.size:
            raise ValueError("it has no segments or no samples")
        if nanoseconds(self.rules.duration) != round(times[-1] * NANOSECONDS):
            raise ValueError("its samples do not reach the end of the show")
        return LoggedShow(
            source=self.name,
            rules=self.rules,
            segments=segments,
            times=times,
            samples=samples,
            predicted_times=predicted_times,
            predicted=predicted,
            attachments=self.attachments,
            metadata=self.metadata,
            added=self.added,
        )

    def _fleet(
        self, topic: str, kind: np.dtype[np.void], epoch: int
    ) -> tuple[FloatArray, NDArray[np.void]]:
        times = np.array(self.fleet_times[topic], dtype=np.int64) - epoch
        drones = self.rules.drones if self.rules is not None else 0
        points = np.frombuffer(self.fleet_bytes[topic], dtype=kind)
        return times / NANOSECONDS, points.reshape(times.size, drones)
