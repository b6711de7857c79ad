"""The container: every byte of an MCAP file accounted for.

Reads the file from the first byte to the last and believes nothing that it has not
recomputed: magics, lengths, CRCs, message indexes, sequence numbers, order in time, and
the whole summary. What it cannot confirm is damage (:class:`DamagedLogError`); only a
CRC that the writer left out is no more than a warning.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import UsageError
from showc.files import UnreadableFileError, open_file
from showc.verify.damage import Damage, DamagedLogError
from showc.verify.logfile import MESSAGE_HEAD, Chunk, LogFile, Messages, inflate
from showc.verify.records import (
    HEAD,
    MAGIC,
    Attachment,
    Channel,
    Opcode,
    Record,
    Schema,
    fields,
    next_record,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST_FILE = 8 << 30
"""Size from which a log is refused [bytes]: an hour of 1,000 drones has half of it."""

LARGEST_UNPACKED = 16 << 30
"""Size of all chunks together from which a log is refused [bytes]."""

MOST_MESSAGES = 8_000_000
"""Messages from which a log is refused: an hour of the greatest fleet that has topics
for single drones."""

MOST_RECORDS = 500_000
"""Records beside messages from which a log is refused: twice what such a log has."""

_TIES_ALLOWED = {"/show/segments", "/tf"}
"""Topics on which several messages may have one time: concurrent segments, and frames
that stand beside those that move."""

_MESSAGE = np.dtype(
    [("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_ENTRY = 16
"""Size of an entry of a message index: time stamp and offset [bytes]."""

_IN_SUMMARY = {
    Opcode.SCHEMA: "schemas",
    Opcode.CHANNEL: "channels",
    Opcode.CHUNK_INDEX: "index of the chunks",
    Opcode.ATTACHMENT_INDEX: "index of the attachments",
    Opcode.METADATA_INDEX: "index of the metadata",
    Opcode.STATISTICS: "statistics",
}


def open_log(path: Path) -> LogFile:
    """Read every byte of the file and return it with all its contents located.

    Raises
    ------
    UsageError
        If there is no such file, or it is no regular file, or too large.
    DamagedLogError
        If anything in it is not as its writer must have left it.
    """
    try:
        with open_file(path) as stream:
            size = stream.seek(0, 2)
            mapped = (
                mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) if size else b""
            )
    except (OSError, ValueError, UnreadableFileError) as error:
        reason = getattr(error, "reason", None) or getattr(error, "strerror", error)
        raise UsageError(
            f"{path}: cannot be read ({reason}); name a log that showc compiled"
        ) from error
    if size > LARGEST_FILE:
        raise UsageError(f"{path}: it has {size:,} bytes, more than a log can have")
    walk = _Walk(LogFile(Path(path), memoryview(mapped)))
    try:
        return walk.run()
    except Damage as damage:
        raise DamagedLogError(
            str(path),
            damage.text,
            damage.offset,
            walk.log.good_until(damage.offset),
        ) from damage


class _Walk:
    """One pass over the file."""

    def __init__(self, log: LogFile) -> None:
        self.log, self.view = log, log.view
        self.expected: dict[int, list[tuple[Any, ...]]] = {
            opcode: [] for opcode in _IN_SUMMARY
        }
        """Records that the summary must hold."""
        self.counts: Counter[int] = Counter()
        self.unpacked = 0
        self.order = _Order()
        self.indexes: _Indexes | None = None
        """Those of the last chunk, while they are read."""
        self.records = 0

    def run(self) -> LogFile:
        view = self.view
        if len(view) == 0:
            raise Damage(0, "the file is empty")
        if bytes(view[: len(MAGIC)]) != MAGIC:
            raise Damage(
                0, "this is not an MCAP file: its first eight bytes are others"
            )
        record = self._next(len(MAGIC))
        self._header(record)
        while record.opcode != Opcode.DATA_END:
            record = self._next(record.stop)
            self._take(record)
        self._summary(record.stop)
        self.log.release()
        return self.log

    def _next(self, position: int) -> Record:
        self.records += 1
        if self.records > MOST_RECORDS:
            raise Damage(position, f"the log has more than {MOST_RECORDS:,} records")
        return next_record(self.view, position)

    def _header(self, record: Record) -> None:
        if record.opcode != Opcode.HEADER:
            raise Damage(record.position, "the first record is not a header")
        profile, self.log.library = fields(self.view, record)
        if profile or not self.log.library.startswith("showc"):
            raise Damage(
                record.position,
                f"this is an MCAP file of {self.log.library!r} with profile "
                f"{profile!r}, not a log of showc's",
            )

    def _take(self, record: Record) -> None:
        """Take the next record of the data."""
        opcode, position = record.opcode, record.position
        takers = {
            Opcode.CHUNK: self._chunk,
            Opcode.MESSAGE_INDEX: self._message_index,
            Opcode.SCHEMA: self._schema,
            Opcode.CHANNEL: self._channel,
            Opcode.ATTACHMENT: self._attachment,
            Opcode.METADATA: self._metadata,
            Opcode.DATA_END: self._data_end,
        }
        if opcode not in takers:
            raise Damage(
                position,
                f"a record of kind {opcode} stands in the data of the show, where the "
                "data should go on or end",
            )
        if opcode != Opcode.MESSAGE_INDEX:
            self._close_chunk(position)
        takers[Opcode(opcode)](record, fields(self.view, record))

    def _schema(self, record: Record, found: tuple[Any, ...]) -> None:
        schema = Schema(*found)
        if self.log.schemas.setdefault(schema.number, schema) != schema or not found[0]:
            raise Damage(record.position, f"schema {found[0]} is defined in two ways")

    def _channel(self, record: Record, found: tuple[Any, ...]) -> None:
        channel = Channel(*found)
        if self.log.channels.setdefault(channel.number, channel) != channel:
            raise Damage(record.position, f"channel {found[0]} is defined in two ways")
        if channel.schema not in self.log.schemas:
            raise Damage(
                record.position,
                f"channel {channel.topic!r} has a schema that is not defined before it",
            )
        self.order.strict[channel.number] = channel.topic not in _TIES_ALLOWED

    def _chunk(self, record: Record, found: tuple[Any, ...]) -> None:
        start_time, end_time, size, crc, compression, span = found
        position = record.position
        data = inflate(self.view, span, compression, size, crc)
        self.unpacked += size
        if self.unpacked > LARGEST_UNPACKED:
            raise Damage(position, "the chunks up to here are too large in sum")
        if not crc:
            self.log.warnings.append((position, "a chunk has no CRC"))
        table, messages = self._scan(data, position)
        self.order.add((start_time, end_time), table, self.log.channels, position)
        self.counts.update(messages.channel.tolist())
        if self.counts.total() > MOST_MESSAGES:
            raise Damage(position, f"the log has more than {MOST_MESSAGES:,} messages")
        self.log.chunks.append(Chunk(size, compression, span, messages))
        self.indexes = _Indexes(record, found, messages)

    def _scan(self, data: bytes, offset: int) -> tuple[NDArray[np.void], Messages]:
        """Walk the records of an uncompressed chunk: heads of messages, and places."""
        unpack, head = HEAD.unpack_from, HEAD.size
        places: list[int] = []
        sizes: list[int] = []
        position, end = 0, len(data)
        while position < end:
            try:
                opcode, size = unpack(data, position)
            except struct.error as error:
                raise Damage(offset, "a record in a chunk is cut") from error
            stop = position + head + size
            if stop > end:
                raise Damage(offset, "a record in a chunk is longer than the chunk")
            if opcode == Opcode.MESSAGE:
                if size < MESSAGE_HEAD:
                    raise Damage(offset, "a message in a chunk is cut")
                places.append(position)
                sizes.append(size - MESSAGE_HEAD)
            elif opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                take = self._schema if opcode == Opcode.SCHEMA else self._channel
                inner = Record(opcode, position, position + head, stop)
                # Damage in a chunk is reported at the chunk.
                content = fields(data, inner, offset - position - head)
                take(inner._replace(position=offset), content)
            else:
                raise Damage(offset, f"a record of kind {opcode} stands in a chunk")
            position = stop
        record = np.array(places, dtype=np.uint32)
        raw = np.frombuffer(data, dtype=np.uint8)
        rows = raw[record.astype(np.int64)[:, None] + head + np.arange(MESSAGE_HEAD)]
        table = np.ascontiguousarray(rows).view(_MESSAGE).reshape(-1)
        messages = Messages(
            table["channel"].copy(),
            table["log"].astype(np.int64),
            record,
            np.array(sizes, dtype=np.uint32),
        )
        return table, messages

    def _message_index(self, record: Record, found: tuple[Any, ...]) -> None:
        if self.indexes is None:
            raise Damage(record.position, "a message index follows no chunk")
        channel, (start, stop) = found
        self.indexes.take(channel, bytes(self.view[start:stop]), record)

    def _close_chunk(self, position: int) -> None:
        """All message indexes of the last chunk are read: note what they come to."""
        if self.indexes is not None:
            entry = self.indexes.entry(position)
            self.expected[Opcode.CHUNK_INDEX].append(entry)
            self.indexes = None

    def _attachment(self, record: Record, found: tuple[Any, ...]) -> None:
        log_time, create_time, name, media_type, (start, stop), crc = found
        attachment = Attachment(log_time, create_time, name, media_type, (start, stop))
        position = record.position
        if not crc:
            self.log.warnings.append((position, f"attachment {name!r} has no CRC"))
        elif zlib.crc32(self.view[record.start : record.stop - 4]) != crc:
            raise Damage(
                position, f"the CRC of attachment {name!r} does not fit its data"
            )
        self.log.attachments.append(attachment)
        length = record.stop - position
        self.expected[Opcode.ATTACHMENT_INDEX].append(
            (position, length, log_time, create_time, stop - start, name, media_type)
        )

    def _metadata(self, record: Record, found: tuple[Any, ...]) -> None:
        name, content = found
        self.log.metadata.append((name, dict(content)))
        self.expected[Opcode.METADATA_INDEX].append(
            (record.position, record.stop - record.position, name)
        )

    def _data_end(self, record: Record, found: tuple[Any, ...]) -> None:
        (crc,) = found
        position = record.position
        if not crc:
            self.log.warnings.append((position, "the data as a whole have no CRC"))
        elif zlib.crc32(self.view[:position]) != crc:
            raise Damage(
                position,
                "the CRC of the data as a whole does not fit: metadata, an index or "
                "the head of a record was altered",
            )

    def _statistics(self) -> tuple[Any, ...]:
        chunks = self.expected[Opcode.CHUNK_INDEX]
        filled = [chunk[:2] for chunk in chunks if chunk[1]]
        return (
            self.counts.total(),
            len(self.log.schemas),
            len(self.log.channels),
            len(self.log.attachments),
            len(self.log.metadata),
            len(chunks),
            min((start for start, _ in filled), default=0),
            max((end for _, end in filled), default=0),
            tuple(sorted(self.counts.items())),
        )

    def _summary(self, begin: int) -> None:
        """Hold the rest of the file against what the data come to."""
        view, expected = self.view, self.expected
        expected[Opcode.SCHEMA] = [tuple(one) for one in self.log.schemas.values()]
        expected[Opcode.CHANNEL] = [tuple(one) for one in self.log.channels.values()]
        expected[Opcode.STATISTICS] = [self._statistics()]
        found: dict[int, list[tuple[Any, ...]]] = {kind: [] for kind in expected}
        groups: list[tuple[int, int, int]] = []
        named: list[tuple[Any, ...]] = []
        first_offset = 0
        record = self._next(begin)
        while record.opcode != Opcode.FOOTER:
            kind, position = record.opcode, record.position
            if kind == Opcode.SUMMARY_OFFSET:
                first_offset = first_offset or position
                named.append(fields(view, record))
            elif kind not in found or first_offset:
                raise Damage(position, f"a record of kind {kind} stands in the summary")
            else:
                found[kind].append(fields(view, record))
                start = position
                if groups and groups[-1][0] == kind:
                    start = groups.pop()[1]
                groups.append((kind, start, record.stop - start))
            record = self._next(record.stop)
        self._footer(record, begin, first_offset)
        for opcode, what in _IN_SUMMARY.items():
            if sorted(found[opcode]) != sorted(expected[opcode]):
                raise Damage(begin, f"the {what} in the summary differ from the data")
        if named and sorted(named) != sorted(groups):
            raise Damage(first_offset, "the offsets in the summary do not fit")

    def _footer(self, record: Record, begin: int, offsets: int) -> None:
        """Check the footer, the magic after it, and that nothing follows."""
        view, position, stop = self.view, record.position, record.stop
        starts = fields(view, record)
        if bytes(view[stop : stop + len(MAGIC)]) != MAGIC:
            raise Damage(
                stop, "the last eight bytes of an MCAP file are missing or others"
            )
        extra = len(view) - stop - len(MAGIC)
        if extra:
            at = stop + len(MAGIC)
            raise Damage(at, f"{extra:,} bytes follow the end of the file")
        if not starts[2]:
            self.log.warnings.append((position, "the summary has no CRC"))
        elif zlib.crc32(view[begin : stop - 4]) != starts[2]:
            raise Damage(position, "the CRC of the summary does not fit")
        if starts[:2] != (begin, offsets):
            raise Damage(
                position,
                f"the footer says that the summary begins at byte {starts[0]:,} and "
                f"its offsets at {starts[1]:,}; it is {begin:,} and {offsets:,}",
            )


class _Order:
    """Follows all channels through the chunks: times rise, sequences have no gap."""

    def __init__(self) -> None:
        self.strict = np.ones(1 << 16, dtype=bool)
        """Whether times of a channel must increase strictly, by channel number."""
        self._next = np.zeros(1 << 16, dtype=np.int64)
        self._last = np.full(1 << 16, -1, dtype=np.int64)
        self._end = -1

    def add(
        self,
        span: tuple[int, int],
        table: NDArray[np.void],
        known: dict[int, Channel],
        offset: int,
    ) -> None:
        """Check the next chunk, whose messages have the heads ``table``."""
        time = table["log"].astype(np.int64)
        found = (int(time.min()), int(time.max())) if time.size else (0, 0)
        if found != span:
            raise Damage(
                offset,
                f"a chunk claims the times {span[0]} to {span[1]} ns, its messages "
                f"go from {found[0]} to {found[1]} ns",
            )
        if time.size == 0:
            return
        if span[0] < self._end:
            raise Damage(offset, "a chunk begins before the one before it ends")
        self._end = span[1]
        if np.any(np.diff(time) < 0):
            raise Damage(offset, "messages in a chunk are not in order of time")
        if np.any(table["publish"] != table["log"]):
            raise Damage(offset, "a message has two different times")
        order = np.argsort(table["channel"], kind="stable")
        channel = table["channel"][order]
        first = np.flatnonzero(np.r_[True, channel[1:] != channel[:-1]])
        last = np.r_[first[1:], channel.size] - 1
        present = channel[first]
        if unknown := set(present.tolist()) - known.keys():
            raise Damage(offset, f"messages on channel {min(unknown)}, not defined")
        sequence, time = table["sequence"].astype(np.int64)[order], time[order]
        before, earlier = np.r_[-1, sequence[:-1]], np.r_[np.int64(-1), time[:-1]]
        before[first], earlier[first] = self._next[present] - 1, self._last[present]
        if np.any(sequence != before + 1):
            raise Damage(offset, "messages are missing or double on a channel")
        if np.any(time - earlier < self.strict[channel]):
            raise Damage(offset, "times on a channel do not increase")
        self._next[present] = sequence[last] + 1
        self._last[present] = time[last]


class _Indexes:
    """Message indexes of one chunk, held against its messages one by one."""

    def __init__(
        self, record: Record, head: tuple[Any, ...], messages: Messages
    ) -> None:
        self._record, self._head = record, head
        self._positions: dict[int, int] = {}
        self._wanted: dict[int, bytes] = {}
        order = np.argsort(messages.channel, kind="stable")
        channel = messages.channel[order]
        table = np.empty((order.size, 2), dtype="<u8")
        table[:, 0] = messages.log_time[order]
        table[:, 1] = messages.record[order]
        edges = np.flatnonzero(np.diff(channel)) + 1
        if order.size:
            for rows, begin in zip(
                np.split(table, edges), [0, *edges.tolist()], strict=True
            ):
                self._wanted[int(channel[begin])] = rows.tobytes()

    def take(self, channel: int, entries: bytes, record: Record) -> None:
        """Check the index of a channel; its entries may stand in any order."""
        if len(entries) % _ENTRY or channel in self._positions:
            raise Damage(record.position, "a message index is malformed")
        table = np.frombuffer(entries, dtype="<u8").reshape(-1, 2)
        table = table[np.argsort(table[:, 1], kind="stable")]
        if table.tobytes() != self._wanted.get(channel, b""):
            raise Damage(
                record.position,
                "a message index does not say where the messages of its chunk lie",
            )
        self._positions[channel] = record.position

    def entry(self, end: int) -> tuple[Any, ...]:
        """Return what the summary must say of the chunk, whose indexes end there."""
        if self._positions.keys() != self._wanted.keys():
            raise Damage(end, "a chunk lacks the index of one of its channels")
        start_time, end_time, size, _, compression, span = self._head
        position, stop = self._record.position, self._record.stop
        return (
            start_time,
            end_time,
            position,
            stop - position,
            tuple(sorted(self._positions.items())),
            end - stop,
            compression,
            span[1] - span[0],
            size,
        )
