"""Records of the MCAP container, taken from bytes with every length checked.

Source: the MCAP specification 1.0, section Records. All integers are little-endian.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple

from showc.verify.damage import Damage

if TYPE_CHECKING:
    from collections.abc import Iterator

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""What every record starts with: opcode, length of the content."""


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


_FIELDS = {
    Opcode.HEADER: "text text",
    Opcode.FOOTER: "8 8 4",
    Opcode.SCHEMA: "2 text text bytes4",
    Opcode.CHANNEL: "2 2 text text texts",
    Opcode.CHUNK: "8 8 8 4 text span8",
    Opcode.MESSAGE_INDEX: "2 span4",
    Opcode.CHUNK_INDEX: "8 8 8 8 numbers 8 text 8 8",
    Opcode.ATTACHMENT: "8 8 text text span8 4",
    Opcode.ATTACHMENT_INDEX: "8 8 8 8 8 text text",
    Opcode.STATISTICS: "8 2 4 4 4 4 8 8 numbers",
    Opcode.METADATA: "text texts",
    Opcode.METADATA_INDEX: "8 8 text",
    Opcode.SUMMARY_OFFSET: "1 8 8",
    Opcode.DATA_END: "4",
}
"""Fields of each kind, in order: integers by their size, texts, maps sorted by key,
bytes, and spans (start and stop of bytes), those with the size of their length."""


class Schema(NamedTuple):
    """Definition of a message type."""

    number: int
    name: str
    encoding: str
    data: bytes


class Channel(NamedTuple):
    """One stream of messages of one type."""

    number: int
    schema: int
    topic: str
    encoding: str
    metadata: tuple[tuple[str, str], ...]


class Attachment(NamedTuple):
    """A file inside the log."""

    log_time: int
    create_time: int
    name: str
    media_type: str
    span: tuple[int, int]
    """Start and stop of its content in the file [bytes]."""


class Record(NamedTuple):
    """Where a record stands."""

    opcode: int
    position: int
    """Of its head [bytes]."""
    start: int
    """Of its content [bytes]."""
    stop: int
    """Of its content [bytes]."""


def next_record(view: memoryview | bytes, position: int) -> Record:
    """Return the record at ``position``; damage if it does not fit."""
    left = len(view) - position
    if left < HEAD.size:
        raise Damage(position, f"{left} bytes stand where a record should: it was cut")
    opcode, size = HEAD.unpack_from(view, position)
    if size > left - HEAD.size:
        raise Damage(
            position,
            f"a record of {size:,} bytes begins where {left - HEAD.size:,} are left: "
            "the file was cut or altered",
        )
    start = position + HEAD.size
    return Record(opcode, position, start, start + size)


def fields(view: memoryview | bytes, record: Record, base: int = 0) -> tuple[Any, ...]:
    """Return the fields of a record, which must fill it.

    Parameters
    ----------
    view
        The bytes that hold it.
    record
        Where it stands in them.
    base
        Added to positions in what is said of damage [bytes].
    """
    opcode = Opcode(record.opcode)
    what = opcode.name.lower().replace("_", " ")
    cursor = _Cursor(view, record.start, record.stop, base, what)
    found = tuple(cursor.field(kind) for kind in _FIELDS[opcode].split())
    if cursor.position != cursor.stop:
        raise cursor.damage(
            f"has {cursor.stop - cursor.position:,} bytes more than its fields"
        )
    return found


class _Cursor:
    """Takes fields one after the other."""

    def __init__(
        self, data: memoryview | bytes, start: int, stop: int, base: int, what: str
    ) -> None:
        self.data, self.position, self.stop = data, start, stop
        self.base, self.what = base, what

    def damage(self, text: str) -> Damage:
        return Damage(self.base + self.position, f"a record ({self.what}) {text}")

    def _take(self, size: int) -> int:
        position = self.position
        if size > self.stop - position:
            left = self.stop - position
            raise self.damage(f"needs {size:,} bytes where {left:,} are left")
        self.position = position + size
        return position

    def number(self, size: int) -> int:
        start = self._take(size)
        return int.from_bytes(self.data[start : start + size], "little")

    def span(self, prefix: int) -> tuple[int, int]:
        size = self.number(prefix)
        start = self._take(size)
        return start, start + size

    def text(self) -> str:
        start, stop = self.span(4)
        try:
            return bytes(self.data[start:stop]).decode("utf-8")
        except UnicodeDecodeError as error:
            raise self.damage("holds what is not UTF-8 text") from error

    def _map(self, key: str, value: str) -> Iterator[tuple[Any, Any]]:
        self.position, end = self.span(4)
        while self.position < end:
            yield self.field(key), self.field(value)
        if self.position != end:
            raise self.damage("holds a map that is cut")

    def field(self, kind: str) -> Any:  # noqa: ANN401 - whatever the kind says
        if kind == "text":
            return self.text()
        if kind in {"texts", "numbers"}:
            pairs = self._map(*(("text", "text") if kind == "texts" else ("2", "8")))
            found = sorted(pairs)
            if len(dict(found)) != len(found):
                raise self.damage("holds a map with one key twice")
            return tuple(found)
        if kind.startswith("span"):
            return self.span(int(kind[-1]))
        if kind.startswith("bytes"):
            start, stop = self.span(int(kind[-1]))
            return bytes(self.data[start:stop])
        return self.number(int(kind))
