"""The container: every byte of an MCAP file accounted for, by any reader of a log.

Reads the file from the first byte to the last and believes nothing that it has not
worked out anew: magics, lengths, CRCs, message indexes, sequence numbers, order in
time. The summary is written again from the data, and compared byte by byte. What cannot
be confirmed is damage (:class:`DamagedLogError`), and so is a CRC that was left out.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections import Counter, defaultdict
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from showc.errors import UsageError
from showc.files import UnreadableFileError, open_file
from showc.log.records import (
    MAGIC,
    Attachment,
    Channel,
    Damage,
    DamagedLogError,
    Opcode,
    Record,
    Schema,
    UnpackedAhead,
    encoded,
    fields,
    inflate,
    next_record,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from showc.arrays import IntArray

LARGEST_FILE = 8 << 30
"""Size from which a log is refused [bytes]: an hour of 1,000 drones has half of it."""

LARGEST_UNPACKED = 16 << 30
"""Size of all chunks together from which a log is refused [bytes]."""

ANY_UNPACKED, GREATEST_RATIO = 1 << 24, 1_000
"""All chunks up to a place may unpack to this [bytes], and to this many times the bytes
of the file up to there. Clouds that are all the same pack best: 400 dark drones, held
for an hour at 20 Hz, reach 393 times. Held for ever, 1,000 drones reach 555, fewer or
more reach less, and up to 100 reach 25: an index takes 16 bytes of each message. One
chunk alone reaches 697, and 236 with a slow motion, so the sum is what is bounded."""

LARGEST_MESSAGE, MORE_EACH = 1 << 24, 6_000
"""Size of a message from which a log is refused, and how much more for each channel
[bytes]: a flight of 10,000 mesh intervals has less, and so have rules with the places
of each drone in 250 formations. Decoded, it takes up to seventy times as much."""

LARGEST_ATTACHED = 1 << 30
"""Size of all attachments together from which a log is refused [bytes]: the abort table
of the greatest fleet has some hundred million."""

MOST_MESSAGES = 8_000_000
"""Messages from which a log is refused: an hour of the greatest fleet that has topics
for single drones."""

MOST_RECORDS = 500_000
"""Records beside messages from which a log is refused: twice what such a log has."""

_TIES_ALLOWED = {"/show/segments", "/tf"}
"""Topics on which several messages may have one time: concurrent segments, and frames
that stand beside those that move."""

_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence number, times logged and published, before a message's bytes."""

_INDEX = struct.Struct("<BQHI")
"""A message index before its entries: opcode, length, channel, length of the entries;
a log of a great fleet has as many as messages."""

_ENTRY = struct.Struct("<QQ")
"""Entry of a message index: time, and offset in the uncompressed chunk."""


class Message(NamedTuple):
    """One message of a log."""

    channel: int
    time: int
    """Time stamp [ns]."""
    data: bytes
    offset: int
    """Where the data of its chunk begin in the file [bytes]."""


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """A chunk that was found whole, and where its messages lie."""

    size: int
    """When unpacked [bytes]."""
    span: tuple[int, int]
    """Start and stop of its data in the file [bytes]."""
    channel: IntArray
    """Channel number of each message, shape (n,)."""
    time: IntArray
    """Time stamp of each, shape (n,) [ns]."""
    start: IntArray
    """Where its own bytes begin in the unpacked chunk, shape (n,)."""
    stop: IntArray
    """Where they end, shape (n,)."""


@dataclass(slots=True, eq=False)
class LogFile:
    """A whole log; made by :func:`open_log` only."""

    path: Path
    """As it was named."""
    view: memoryview
    """All its bytes."""
    library: str = ""
    """What the header names as the writer."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    """By number."""
    channels: dict[int, Channel] = field(default_factory=dict)
    """By number."""
    chunks: list[Chunk] = field(default_factory=list)
    """In the file's order, as all that follows."""
    attachments: list[Attachment] = field(default_factory=list)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    """All metadata records: name and content."""

    def attachment(self, name: str) -> bytes | None:
        """Content of the attachment of that name; None if there is none."""
        for attachment in self.attachments:
            if attachment.name == name:
                return bytes(self.view[slice(*attachment.span)])
        return None

    @contextmanager
    def reported(self) -> Iterator[None]:
        """Turn damage that is met into the error that a user sees."""
        try:
            yield
        except Damage as damage:
            times = [
                (int(chunk.time[0]), int(chunk.time[-1]))
                for chunk in self.chunks
                if chunk.span[1] <= damage.offset and chunk.time.size
            ]
            whole = (times[-1][1] - times[0][0]) * 1e-9 if times else None
            raise DamagedLogError(
                str(self.path), damage.text, damage.offset, whole
            ) from damage

    def times(self, channel: int) -> IntArray:
        """Time stamps of a channel's messages in order, shape (n,) [ns]."""
        parts = [chunk.time[chunk.channel == channel] for chunk in self.chunks]
        return np.concatenate([*parts, np.empty(0, dtype=np.int64)])

    def sizes(self, channels: set[int]) -> IntArray:
        """Bytes of each message of some channels in order, shape (n,)."""
        rows = [np.isin(chunk.channel, [*channels]) for chunk in self.chunks]
        both = zip(self.chunks, rows, strict=True)
        parts = [(chunk.stop - chunk.start)[own] for chunk, own in both]
        return np.concatenate([*parts, np.empty(0, dtype=np.int64)])

    def before(self, names: Collection[str]) -> str:
        """SHA-256 of all bytes before the first attachment of these ``names``, hex."""
        begin = min(one.position for one in self.attachments if one.name in names)
        return sha256(self.view[:begin]).hexdigest()

    def messages(
        self, channels: set[int], share: int = 0, shares: int = 1
    ) -> Iterator[Message]:
        """Go through the messages of some channels again, in the file's order.

        ``channels`` are numbers; ``share`` is which of the equal ``shares`` of these.
        """
        wanted = np.isin(np.arange(1 << 16), list(channels))
        kept = [(one, np.flatnonzero(wanted[one.channel])) for one in self.chunks]
        many = sum(rows.size for _, rows in kept)
        first, last = (many * at // shares for at in (share, share + 1))
        for chunk, everything in kept:
            rows = everything[max(first, 0) : max(last, 0)]
            first, last = first - everything.size, last - everything.size
            if not rows.size:
                continue
            data = inflate(self.view, chunk.span, chunk.size)
            self.release()
            columns = (chunk.channel, chunk.time, chunk.start, chunk.stop)
            for number, time, start, stop in zip(
                *(column[rows].tolist() for column in columns), strict=True
            ):
                yield Message(number, time, data[start:stop], chunk.span[0])

    def release(self) -> None:
        """Let the system take back the memory of the mapped file."""
        if isinstance(self.view.obj, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            self.view.obj.madvise(mmap.MADV_DONTNEED)


def open_log(source: Path | bytes) -> LogFile:
    """Read every byte of a file, or of a log in memory, with all its contents located.

    Raises
    ------
    UsageError
        If there is no such file, or it is no regular file, or too large.
    DamagedLogError
        If anything in it is not as its writer must have left it.
    """
    if isinstance(source, bytes):
        return _walked(LogFile(Path("log"), memoryview(source)))
    try:
        with open_file(source) as stream:
            size = stream.seek(0, 2)
            mapped = (
                mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) if size else b""
            )
    except (OSError, ValueError, UnreadableFileError) as error:
        reason = getattr(error, "reason", None) or getattr(error, "strerror", error)
        raise UsageError(
            f"{source}: cannot be read ({reason}); name a log that showc compiled"
        ) from error
    if size > LARGEST_FILE:
        raise UsageError(f"{source}: it has {size:,} bytes, more than a log can have")
    return _walked(LogFile(Path(source), memoryview(mapped)))


def _walked(log: LogFile) -> LogFile:
    with log.reported():
        return _Walk(log).run()


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
        self.last: dict[int, int] = defaultdict(lambda: -1)
        """Time of each channel's last message [ns]."""
        self.end = self.unpacked = self.attached = self.records = self.messages = 0
        """Time of the last message [ns]; bytes unpacked and attached, records, messages
        so far."""

    def run(self) -> LogFile:
        with UnpackedAhead(self.view) as self.chunks:
            return self._run()

    def _run(self) -> LogFile:
        view, log = self.view, self.log
        if bytes(view[: len(MAGIC)]) != MAGIC:
            what = "its first eight bytes are others" if len(view) else "it is empty"
            raise Damage(0, f"this is not an MCAP file: {what}")
        record = self._next(len(MAGIC))
        if record.opcode != Opcode.HEADER:
            raise Damage(record.position, "the first record is not a header")
        profile, log.library = fields(view, record)
        if profile or not log.library.startswith("showc"):
            other = f"this is an MCAP file of {log.library!r}, profile {profile!r}"
            raise Damage(record.position, f"{other}, not a log of showc's")
        record = self._next(record.stop)
        while record.opcode != Opcode.DATA_END:
            record = self._take(record)
        (crc,), data = fields(view, record), view[: record.position]
        self._crc(crc, data, record.position, "the data as a whole")
        self._tail(record.stop)
        log.release()
        return log

    def _next(self, position: int) -> Record:
        self._count(position)
        return next_record(self.view, position)

    def _count(self, position: int) -> None:
        self.records += 1
        if self.records > MOST_RECORDS:
            raise Damage(position, f"the log has more than {MOST_RECORDS:,} records")

    def _crc(
        self, crc: int, covered: memoryview | bytes, position: int, what: str
    ) -> None:
        """Check the CRC of what a record covers."""
        if zlib.crc32(covered) != crc:
            text = f"the CRC of {what} does not fit: it was altered, or what it covers"
            raise Damage(position, text)

    def _take(self, record: Record) -> Record:
        """Take the next record of the data; return the one that follows."""
        kind, position = record.opcode, record.position
        if kind == Opcode.CHUNK:
            return self._chunk(record)
        if kind in {Opcode.SCHEMA, Opcode.CHANNEL}:
            self._define(record, fields(self.view, record))
        elif kind == Opcode.ATTACHMENT:
            *found, content, crc = fields(self.view, record)
            stop, size = record.stop - 4, len(content)
            self.attached += size
            if self.attached > LARGEST_ATTACHED:
                raise Damage(position, "attachments up to here are too large in sum")
            one = Attachment._make([*found, (stop - size, stop), position])
            covered = self.view[record.start : stop]
            self._crc(crc, covered, position, f"attachment {one.name!r}")
            self.log.attachments.append(one)
            row = (position, record.stop - position, *one[:2], size, *one[2:4])
            self.index[Opcode.ATTACHMENT_INDEX].append(row)
        elif kind == Opcode.METADATA:
            name, content = fields(self.view, record)
            self.log.metadata.append((name, dict(content)))
            size = record.stop - position
            self.index[Opcode.METADATA_INDEX].append((position, size, name))
        else:
            raise Damage(position, f"a record of kind {kind} stands in the show's data")
        return self._next(record.stop)

    def _define(self, record: Record, found: tuple[Any, ...]) -> None:
        """Take a schema or a channel."""
        number, log, position = found[0], self.log, record.position
        self._count(position)
        if record.opcode == Opcode.SCHEMA:
            schema = Schema(*found)
            if log.schemas.setdefault(number, schema) != schema or not number:
                raise Damage(position, f"schema {number} is defined in two ways")
            return
        channel = Channel(*found)
        if log.channels.setdefault(number, channel) != channel:
            raise Damage(position, f"channel {number} is defined in two ways")
        if channel.schema not in log.schemas:
            text = f"the schema of channel {channel.topic!r} is not defined before it"
            raise Damage(position, text)

    def _chunk(self, record: Record) -> Record:
        """Take a chunk and the message indexes after it."""
        start, end, size, crc, compression, packed = fields(self.view, record)
        position, span = record.position, (record.stop - len(packed), record.stop)
        if compression != "zstd":
            raise Damage(position, f"a chunk is packed with {compression!r}, not zstd")
        self._unpack(record, size)
        data = self.chunks.take(position)
        self._crc(crc, data, position, "a chunk")
        entries: dict[int, bytearray] = defaultdict(bytearray)
        try:
            places = self._places(data, entries)
        except Damage as damage:
            raise Damage(position, f"in a chunk: {damage.text}") from damage
        table = np.array(places, dtype=np.int64).reshape(-1, 4).T
        found = (int(table[1, 0]), int(table[1, -1])) if places else (0, 0)
        if found != (start, end):
            raise Damage(
                position,
                f"a chunk claims the times {start} to {end} ns, its messages go from "
                f"{found[0]} to {found[1]} ns",
            )
        self.log.chunks.append(Chunk(size, span, *table))
        index, positions = bytearray(), []
        for channel, some in entries.items():
            positions.append((channel, record.stop + len(index)))
            head = Opcode.MESSAGE_INDEX, 6 + len(some), channel, len(some)
            index += _INDEX.pack(*head) + some
        at = self._same(record.stop, bytes(index), Opcode.MESSAGE_INDEX)
        self.index[Opcode.CHUNK_INDEX].append(
            (
                *(start, end, position, record.stop - position, positions),
                *(at - record.stop, compression, len(packed), size),
            )
        )
        return self._next(at)

    def _unpack(self, record: Record, size: int) -> None:
        """Count what a chunk unpacks to, before it is unpacked."""
        self.unpacked += size
        text = f"the chunks up to here unpack to {self.unpacked:,} bytes"
        if self.unpacked > LARGEST_UNPACKED:
            raise Damage(record.position, f"{text}, too large in sum: refused")
        if self.unpacked > ANY_UNPACKED + GREATEST_RATIO * record.stop:
            text += f", over {GREATEST_RATIO:,} times the file up to here: refused"
            raise Damage(record.position, text)

    def _places(
        self, data: bytes, entries: dict[int, bytearray]
    ) -> list[tuple[int, int, int, int]]:
        """Walk the records of an unpacked chunk.

        Returns channel, time, start and stop of each message; ``entries`` takes what
        the message index of each channel must hold.
        """
        found, position = [], 0
        while position < len(data):
            record = next_record(data, position)
            if record.opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                self._define(record, fields(data, record))
            elif record.opcode != Opcode.MESSAGE:
                raise Damage(position, f"a record of kind {record.opcode} stands there")
            else:
                start = record.start + _MESSAGE.size
                if start > record.stop:
                    raise Damage(position, "a message is shorter than its head")
                most = LARGEST_MESSAGE + MORE_EACH * len(self.log.channels)
                if record.stop - start > most:
                    raise Damage(position, "a message is larger than any of showc's")
                channel, time = self._follow(_MESSAGE.unpack_from(data, record.start))
                entries[channel] += _ENTRY.pack(time, position)
                found.append((channel, time, start, record.stop))
            position = record.stop
        return found

    def _follow(self, head: tuple[int, int, int, int]) -> tuple[int, int]:
        """Hold a message against those before it; return its channel and its time."""
        channel, sequence, time, published = head
        if channel not in self.log.channels:
            raise Damage(0, f"messages on channel {channel}, not defined")
        if sequence != self.counts[channel]:
            raise Damage(0, "messages are missing or double on a channel")
        if published != time or not self.end <= time < 1 << 63:
            raise Damage(0, "messages are not in order of time, or have two times")
        ties = self.log.channels[channel].topic in _TIES_ALLOWED
        if time < self.last[channel] + (not ties):
            raise Damage(0, "times on a channel do not increase")
        self.counts[channel] += 1
        self.last[channel] = self.end = time
        self.messages += 1
        if self.messages > MOST_MESSAGES:
            raise Damage(0, f"the log has more than {MOST_MESSAGES:,} messages")
        return channel, time

    def _tail(self, begin: int) -> None:
        """Hold all that follows the data against what they come to."""
        position, offsets = begin, []
        for kind, rows in self._groups().items():
            group = b"".join(encoded(kind, *row) for row in rows)
            offsets.append((kind, position, len(group)))
            position = self._same(position, group, kind)
        group = b"".join(encoded(Opcode.SUMMARY_OFFSET, *row) for row in offsets)
        starts = begin, position
        position = self._same(position, group, Opcode.SUMMARY_OFFSET)
        # The CRC, the footer's last field, is of everything before it.
        footer = encoded(Opcode.FOOTER, *starts, 0)[:-4]
        crc = zlib.crc32(footer, zlib.crc32(self.view[begin:position]))
        footer += crc.to_bytes(4, "little") + MAGIC
        position = self._same(position, footer, Opcode.FOOTER)
        left = len(self.view) - position
        if left:
            raise Damage(position, f"{left:,} bytes follow the end of the file")

    def _same(self, position: int, wanted: bytes, kind: Opcode) -> int:
        """Hold records at a place against those that the data come to; return the end.

        All of them are of one kind, or end the file.
        """
        found = bytes(self.view[position : position + len(wanted)])
        if found != wanted:
            pairs = enumerate(zip(found, wanted, strict=False))
            at = next((k for k, (one, other) in pairs if one != other), len(found))
            what = kind.name.lower().replace("_", " ")
            text = f"the {what} is not what the data come to: it was altered or cut"
            raise Damage(position + at, text)
        return position + len(wanted)

    def _groups(self) -> dict[Opcode, list[tuple[Any, ...]]]:
        """Return what the summary must hold, in its order."""
        log, chunks = self.log, self.index[Opcode.CHUNK_INDEX]
        filled = [chunk[:2] for chunk in chunks if chunk[1]]
        statistics = (
            self.messages,
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
