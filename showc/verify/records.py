"""Records of the MCAP container, taken from bytes with every length checked.

Source: the MCAP specification 1.0, section Records. All integers are little-endian.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from showc.verify.damage import Damage

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""What every record starts with: opcode, length of the content."""

_PAIR = struct.Struct("<HQ")
"""An entry of a map of numbers."""


class Opcode(IntEnum):
    """Kinds of records."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    ATTACHMENT = 0x09
    ATTACHMENT_INDEX = 0x0A
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F


class Cursor:
    """Takes fields from ``data[start:stop]``; errors name ``base`` + position."""

    __slots__ = ("base", "data", "position", "stop")

    def __init__(
        self, data: memoryview | bytes, start: int, stop: int, base: int = 0
    ) -> None:
        self.data = data
        self.position = start
        self.stop = stop
        self.base = base

    def _take(self, size: int, what: str) -> int:
        position = self.position
        if size > self.stop - position:
            raise Damage(
                self.base + position,
                f"{what} needs {size:,} bytes where {self.stop - position:,} are left",
            )
        self.position = position + size
        return position

    def number(self, size: int, what: str) -> int:
        """Unsigned integer of ``size`` bytes."""
        start = self._take(size, what)
        return int.from_bytes(self.data[start : start + size], "little")

    def raw(self, prefix: int, what: str) -> tuple[int, int]:
        """Start and stop of bytes; ``prefix`` bytes before them hold their length."""
        size = self.number(prefix, f"length of {what}")
        start = self._take(size, what)
        return start, start + size

    def text(self, what: str) -> str:
        """UTF-8 text with its length before it in four bytes."""
        start, stop = self.raw(4, what)
        try:
            return bytes(self.data[start:stop]).decode("utf-8")
        except UnicodeDecodeError as error:
            raise Damage(self.base + start, f"{what} is not UTF-8 text") from error

    def text_map(self, what: str) -> dict[str, str]:
        """Map of text to text."""
        start, stop = self.raw(4, what)
        inner = Cursor(self.data, start, stop, self.base)
        result: dict[str, str] = {}
        while inner.position < stop:
            key = inner.text(f"key of {what}")
            if key in result:
                raise Damage(self.base + inner.position, f"{what} has {key!r} twice")
            result[key] = inner.text(f"value of {what}")
        return result

    def number_map(self, what: str) -> dict[int, int]:
        """Map of two-byte to eight-byte integers."""
        start, stop = self.raw(4, what)
        if (stop - start) % _PAIR.size == 0:
            return dict(_PAIR.iter_unpack(self.data[start:stop]))
        inner = Cursor(self.data, start, stop, self.base)
        result: dict[int, int] = {}
        while inner.position < stop:
            key = inner.number(2, f"key of {what}")
            result[key] = inner.number(8, f"value of {what}")
        return result

    def close(self, what: str) -> None:
        """Insist that nothing is left."""
        if self.position != self.stop:
            raise Damage(
                self.base + self.position,
                f"{what} has {self.stop - self.position:,} bytes more than its fields",
            )


@dataclass(frozen=True, slots=True)
class Schema:
    """Definition of a message type."""

    number: int
    name: str
    encoding: str
    data: bytes

    @classmethod
    def read(cls, cursor: Cursor) -> Schema:
        """Read the content of a Schema record."""
        number, name = cursor.number(2, "schema number"), cursor.text("schema name")
        encoding = cursor.text("schema encoding")
        start, stop = cursor.raw(4, "schema data")
        cursor.close("schema")
        return cls(number, name, encoding, bytes(cursor.data[start:stop]))


@dataclass(frozen=True, slots=True)
class Channel:
    """One stream of messages of one type."""

    number: int
    schema: int
    topic: str
    encoding: str
    metadata: tuple[tuple[str, str], ...]

    @classmethod
    def read(cls, cursor: Cursor) -> Channel:
        """Read the content of a Channel record."""
        channel = cls(
            cursor.number(2, "channel number"),
            cursor.number(2, "schema number of a channel"),
            cursor.text("topic"),
            cursor.text("message encoding"),
            tuple(sorted(cursor.text_map("channel metadata").items())),
        )
        cursor.close("channel")
        return channel


@dataclass(frozen=True, slots=True)
class ChunkIndex:
    """What the summary says of a chunk; the walker makes the same from the data."""

    start_time: int
    end_time: int
    offset: int
    length: int
    index_offsets: tuple[tuple[int, int], ...]
    index_length: int
    compression: str
    compressed_size: int
    uncompressed_size: int

    @classmethod
    def read(cls, cursor: Cursor) -> ChunkIndex:
        """Read the content of a Chunk Index record."""
        index = cls(
            cursor.number(8, "start time of a chunk"),
            cursor.number(8, "end time of a chunk"),
            cursor.number(8, "offset of a chunk"),
            cursor.number(8, "length of a chunk"),
            tuple(sorted(cursor.number_map("message index offsets").items())),
            cursor.number(8, "length of message indexes"),
            cursor.text("compression"),
            cursor.number(8, "compressed size"),
            cursor.number(8, "uncompressed size"),
        )
        cursor.close("chunk index")
        return index


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file inside the log, or what the summary says of it (``data`` empty)."""

    offset: int
    length: int
    log_time: int
    create_time: int
    size: int
    name: str
    media_type: str

    @classmethod
    def read_index(cls, cursor: Cursor) -> Attachment:
        """Read the content of an Attachment Index record."""
        index = cls(
            cursor.number(8, "offset of an attachment"),
            cursor.number(8, "length of an attachment"),
            cursor.number(8, "time of an attachment"),
            cursor.number(8, "creation time of an attachment"),
            cursor.number(8, "size of an attachment"),
            cursor.text("name of an attachment"),
            cursor.text("media type of an attachment"),
        )
        cursor.close("attachment index")
        return index


@dataclass(frozen=True, slots=True)
class MetadataIndex:
    """Where a metadata record lies."""

    offset: int
    length: int
    name: str

    @classmethod
    def read(cls, cursor: Cursor) -> MetadataIndex:
        """Read the content of a Metadata Index record."""
        index = cls(
            cursor.number(8, "offset of metadata"),
            cursor.number(8, "length of metadata"),
            cursor.text("name of metadata"),
        )
        cursor.close("metadata index")
        return index


@dataclass(frozen=True, slots=True)
class Statistics:
    """Counts and times of the whole file."""

    messages: int
    schemas: int
    channels: int
    attachments: int
    metadata: int
    chunks: int
    start_time: int
    end_time: int
    channel_messages: tuple[tuple[int, int], ...]

    @classmethod
    def read(cls, cursor: Cursor) -> Statistics:
        """Read the content of a Statistics record."""
        statistics = cls(
            cursor.number(8, "message count"),
            cursor.number(2, "schema count"),
            cursor.number(4, "channel count"),
            cursor.number(4, "attachment count"),
            cursor.number(4, "metadata count"),
            cursor.number(4, "chunk count"),
            cursor.number(8, "first time"),
            cursor.number(8, "last time"),
            tuple(sorted(cursor.number_map("message counts of channels").items())),
        )
        cursor.close("statistics")
        return statistics
