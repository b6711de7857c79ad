"""The container: every byte of an MCAP file accounted for.

Reads the file from the first byte to the last and believes nothing that it has not
recomputed: magics, lengths, CRCs, message indexes, sequence numbers, order in time. The
summary is written anew from the data, and compared byte by byte. What cannot be
confirmed is damage (:class:`DamagedLogError`); only a CRC that the writer left out is
no more than a warning.
"""

from __future__ import annotations

import mmap
import zlib
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import UsageError
from showc.files import UnreadableFileError, open_file
from showc.verify.damage import Damage
from showc.verify.logfile import MESSAGE_HEAD, Chunk, LogFile, Messages, inflate
from showc.verify.records import (
    HEAD,
    MAGIC,
    Attachment,
    Channel,
    Opcode,
    Record,
    Schema,
    encoded,
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

_IN_SUMMARY = {
    Opcode.SCHEMA: "schemas",
    Opcode.CHANNEL: "channels",
    Opcode.STATISTICS: "statistics",
    Opcode.CHUNK_INDEX: "index of the chunks",
    Opcode.ATTACHMENT_INDEX: "index of the attachments",
    Opcode.METADATA_INDEX: "index of the metadata",
}
"""Groups of the summary, in their order."""


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
    with walk.log.reported():
        return walk.run()


class _Walk:
    """One pass over the file."""

    def __init__(self, log: LogFile) -> None:
        self.log, self.view = log, log.view
        self.index: dict[Opcode, list[tuple[Any, ...]]] = {
            Opcode.CHUNK_INDEX: [],
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: [],
        }
        """What the summary must say of chunks, attachments and metadata."""
        self.counts: Counter[int] = Counter()
        """Messages of each channel so far."""
        self.last: dict[int, int] = {}
        """Time of each channel's last message [ns]."""
        self.end = self.unpacked = self.records = 0

    def run(self) -> LogFile:
        view, log = self.view, self.log
        if len(view) == 0:
            raise Damage(0, "the file is empty")
        if bytes(view[: len(MAGIC)]) != MAGIC:
            raise Damage(
                0, "this is not an MCAP file: its first eight bytes are others"
            )
        record = self._next(len(MAGIC))
        if record.opcode != Opcode.HEADER:
            raise Damage(record.position, "the first record is not a header")
        profile, log.library = fields(view, record)
        if profile or not log.library.startswith("showc"):
            raise Damage(
                record.position,
                f"this is an MCAP file of {log.library!r} with profile {profile!r}, "
                "not a log of showc's",
            )
        record = self._next(record.stop)
        while record.opcode != Opcode.DATA_END:
            record = self._take(record)
        self._crc(record, "the data as a whole", view[: record.position])
        self._summary(record.stop)
        log.release()
        return log

    def _next(self, position: int) -> Record:
        self.records += 1
        if self.records > MOST_RECORDS:
            raise Damage(position, f"the log has more than {MOST_RECORDS:,} records")
        return next_record(self.view, position)

    def _crc(self, record: Record, what: str, covered: memoryview) -> None:
        """Check the CRC with which a record ends."""
        crc = fields(self.view, record)[-1]
        if not crc:
            self.log.warnings.append((record.position, f"no CRC covers {what}"))
        elif zlib.crc32(covered) != crc:
            raise Damage(
                record.position,
                f"the CRC of {what} does not fit: it was altered, or what it covers",
            )

    def _take(self, record: Record) -> Record:
        """Take the next record of the data; return the one that follows."""
        kind, position = record.opcode, record.position
        if kind == Opcode.CHUNK:
            return self._chunk(record)
        if kind in {Opcode.SCHEMA, Opcode.CHANNEL}:
            self._define(record, fields(self.view, record))
        elif kind == Opcode.ATTACHMENT:
            *found, _ = fields(self.view, record)
            one = Attachment(*found)
            covered = self.view[record.start : record.stop - 4]
            self._crc(record, f"attachment {one.name!r}", covered)
            self.log.attachments.append(one)
            times, size = (one.log_time, one.create_time), one.span[1] - one.span[0]
            self.index[Opcode.ATTACHMENT_INDEX].append(
                (
                    *(position, record.stop - position),
                    *(*times, size, one.name, one.media_type),
                )
            )
        elif kind == Opcode.METADATA:
            name, content = fields(self.view, record)
            self.log.metadata.append((name, dict(content)))
            size = record.stop - position
            self.index[Opcode.METADATA_INDEX].append((position, size, name))
        else:
            raise Damage(
                position,
                f"a record of kind {kind} stands in the data of the show, where the "
                "data should go on or end",
            )
        return self._next(record.stop)

    def _define(self, record: Record, found: tuple[Any, ...]) -> None:
        """Take a schema or a channel."""
        number, log, position = found[0], self.log, record.position
        if record.opcode == Opcode.SCHEMA:
            schema = Schema(*found)
            if log.schemas.setdefault(number, schema) != schema or not number:
                raise Damage(position, f"schema {number} is defined in two ways")
            return
        channel = Channel(*found)
        if log.channels.setdefault(number, channel) != channel:
            raise Damage(position, f"channel {number} is defined in two ways")
        if channel.schema not in log.schemas:
            raise Damage(
                position,
                f"channel {channel.topic!r} has a schema that is not defined before it",
            )

    def _chunk(self, record: Record) -> Record:
        """Take a chunk and the message indexes after it."""
        start, end, size, crc, compression, span = fields(self.view, record)
        position = record.position
        if compression != "zstd":
            raise Damage(position, f"a chunk is packed with {compression!r}, not zstd")
        data = inflate(self.view, span, size)
        if not crc:
            self.log.warnings.append((position, "a chunk has no CRC"))
        elif zlib.crc32(data) != crc:
            raise Damage(span[0], "the CRC of a chunk does not fit its data")
        self.unpacked += size
        if self.unpacked > LARGEST_UNPACKED:
            raise Damage(position, "the chunks up to here are too large in sum")
        heads, messages = self._scan(data, position)
        self._check_times((start, end), heads, position)
        wanted = self._check_channels(heads, messages, position)
        self.log.chunks.append(Chunk(size, span, messages))
        following, positions = self._next(record.stop), []
        while following.opcode == Opcode.MESSAGE_INDEX:
            channel, entries = fields(self.view, following)
            if bytes(self.view[slice(*entries)]) != wanted.pop(channel, None):
                raise Damage(
                    following.position,
                    "a message index does not say where the messages of its chunk lie",
                )
            positions.append((channel, following.position))
            following = self._next(following.stop)
        if wanted:
            raise Damage(
                following.position, "a chunk lacks the message index of a channel"
            )
        length, indexes = record.stop - position, following.position - record.stop
        self.index[Opcode.CHUNK_INDEX].append(
            (
                *(start, end, position, length, positions, indexes),
                *(compression, span[1] - span[0], size),
            )
        )
        return following

    def _scan(self, data: bytes, offset: int) -> tuple[NDArray[np.void], Messages]:
        """Walk the records of an uncompressed chunk: heads of messages, and places.

        Damage in a chunk is reported at the chunk.
        """
        places: list[int] = []
        sizes: list[int] = []
        position = 0
        while position < len(data):
            try:
                record = next_record(data, position)
                if record.opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                    self._define(record, fields(data, record))
            except Damage as damage:
                raise Damage(offset, f"in a chunk: {damage.text}") from damage
            size = record.stop - record.start
            if record.opcode == Opcode.MESSAGE and size >= MESSAGE_HEAD:
                places.append(position)
                sizes.append(size - MESSAGE_HEAD)
            elif record.opcode not in {Opcode.SCHEMA, Opcode.CHANNEL}:
                raise Damage(
                    offset,
                    f"a record of kind {record.opcode} and {size:,} bytes stands in a "
                    "chunk",
                )
            position = record.stop
        places_, raw = np.array(places, dtype=np.int64), np.frombuffer(data, np.uint8)
        rows = raw[places_[:, None] + HEAD.size + np.arange(MESSAGE_HEAD)]
        heads = np.ascontiguousarray(rows).view(_MESSAGE).reshape(-1)
        channel, time = heads["channel"].copy(), heads["log"].astype(np.int64)
        return heads, Messages(channel, time, places_, np.array(sizes, dtype=np.int64))

    def _check_times(
        self, claimed: tuple[int, int], heads: NDArray[np.void], offset: int
    ) -> None:
        """Hold the times of a chunk against its messages and the chunks before."""
        time = heads["log"].astype(np.int64)
        found = (int(time.min()), int(time.max())) if time.size else (0, 0)
        if found != claimed:
            raise Damage(
                offset,
                f"a chunk claims the times {claimed[0]} to {claimed[1]} ns, its "
                f"messages go from {found[0]} to {found[1]} ns",
            )
        if time.size and found[0] < self.end:
            raise Damage(offset, "a chunk begins before the one before it ends")
        self.end = max(self.end, found[1])
        if np.any(np.diff(time) < 0):
            raise Damage(offset, "messages in a chunk are not in order of time")
        if np.any(heads["publish"] != heads["log"]):
            raise Damage(offset, "a message has two different times")

    def _check_channels(
        self, heads: NDArray[np.void], messages: Messages, offset: int
    ) -> dict[int, bytes]:
        """Follow channels: sequences have no gap, times rise.

        Returns what the message index of each channel must hold.
        """
        wanted: dict[int, bytes] = {}
        order = np.argsort(messages.channel, kind="stable")
        entries = np.column_stack([messages.log_time, messages.record]).astype("<u8")
        edges = np.flatnonzero(np.diff(messages.channel[order])) + 1
        for rows in np.split(order, edges) if order.size else ():
            number = int(messages.channel[rows[0]])
            if number not in self.log.channels:
                raise Damage(offset, f"messages on channel {number}, not defined")
            count, times = self.counts[number], messages.log_time[rows]
            if np.any(heads["sequence"][rows] != count + np.arange(rows.size)):
                raise Damage(offset, "messages are missing or double on a channel")
            rise = np.diff(times, prepend=self.last.get(number, -1))
            if np.any(rise < (self.log.channels[number].topic not in _TIES_ALLOWED)):
                raise Damage(offset, "times on a channel do not increase")
            self.last[number] = int(times[-1])
            wanted[number] = entries[rows].tobytes()
        self.counts.update(messages.channel.tolist())
        if self.counts.total() > MOST_MESSAGES:
            raise Damage(offset, f"the log has more than {MOST_MESSAGES:,} messages")
        return wanted

    def _summary(self, begin: int) -> None:
        """Hold the rest of the file against what the data come to."""
        view = self.view
        footer = self._next(begin)
        while footer.opcode != Opcode.FOOTER:
            footer = self._next(footer.stop)
        starts = fields(view, footer)[:2]
        if bytes(view[footer.stop : footer.stop + len(MAGIC)]) != MAGIC:
            raise Damage(
                footer.stop,
                "the last eight bytes of an MCAP file are missing or others",
            )
        end = footer.stop + len(MAGIC)
        if len(view) > end:
            raise Damage(end, f"{len(view) - end:,} bytes follow the end of the file")
        self._crc(footer, "the summary", view[begin : footer.stop - 4])
        position, offsets = begin, []
        for kind, rows in self._groups().items():
            group = b"".join(encoded(kind, *row) for row in rows)
            if bytes(view[position : position + len(group)]) != group:
                what = _IN_SUMMARY[kind]
                raise Damage(
                    position, f"the {what} in the summary differ from the data"
                )
            offsets.append((kind, position, len(group)))
            position += len(group)
        last = b"".join(encoded(Opcode.SUMMARY_OFFSET, *row) for row in offsets)
        if bytes(view[position : footer.position]) != last:
            raise Damage(position, "the offsets in the summary do not fit")
        if starts != (begin, position):
            raise Damage(
                footer.position,
                f"the footer says that the summary begins at byte {starts[0]:,} and "
                f"its offsets at {starts[1]:,}; it is {begin:,} and {position:,}",
            )

    def _groups(self) -> dict[Opcode, list[tuple[Any, ...]]]:
        """Return what the summary must hold, in its order."""
        log, chunks = self.log, self.index[Opcode.CHUNK_INDEX]
        filled = [chunk[:2] for chunk in chunks if chunk[1]]
        statistics = (
            self.counts.total(),
            len(log.schemas),
            len(log.channels),
            len(log.attachments),
            len(log.metadata),
            len(chunks),
            min((start for start, _ in filled), default=0),
            max((end for _, end in filled), default=0),
            tuple(self.counts.items()),
        )
        found: dict[Opcode, list[tuple[Any, ...]]] = {
            Opcode.SCHEMA: [*log.schemas.values()],
            Opcode.CHANNEL: [*log.channels.values()],
            Opcode.STATISTICS: [statistics],
        }
        return found | self.index
