"""Records of the MCAP container, taken from bytes with every length checked.

Source: the MCAP specification 1.0, section Records. All integers are little-endian.
"""

from __future__ import annotations

import struct
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from enum import IntEnum
from functools import lru_cache
from threading import get_ident
from typing import Any, NamedTuple, Self

import zstandard

from showc.errors import DamagedFileError, escaped

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""What every record starts with: opcode, length of the content."""

LARGEST_CHUNK = 1 << 26
"""Greatest uncompressed size of a chunk that is read [bytes]: sixty times what showc
writes, and no bomb gets further."""


_AHEAD = 2
"""Chunks that are unpacked, or begun, at a time: one that is gone through, and the
next. One more gains nothing, and a chunk may take all that one may take."""

_BETWEEN = 1 << 16
"""Records looked at for the next chunk: an index of each channel stands before it."""


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
    Opcode.CHANNEL: "2 2 text text text-text",
    Opcode.CHUNK: "8 8 8 4 text bytes8",
    Opcode.MESSAGE_INDEX: "2 bytes4",
    Opcode.CHUNK_INDEX: "8 8 8 8 2-8 8 text 8 8",
    Opcode.ATTACHMENT: "8 8 text text bytes8 4",
    Opcode.ATTACHMENT_INDEX: "8 8 8 8 8 text text",
    Opcode.STATISTICS: "8 2 4 4 4 4 8 8 2-8",
    Opcode.METADATA: "text text-text",
    Opcode.METADATA_INDEX: "8 8 text",
    Opcode.SUMMARY_OFFSET: "1 8 8",
    Opcode.DATA_END: "4",
}
"""Fields of each kind, in order: integers by their size, texts, maps by what they map,
and bytes with the size of their length."""

_KINDS = {opcode: kinds.split() for opcode, kinds in _FIELDS.items()}
"""The same, taken apart."""


class DamagedLogError(DamagedFileError):
    """The log is cut, altered, or not one of showc's.

    Attributes
    ----------
    offset
        Byte of the file at which the damage shows.
    good_until
        Show time up to which all data before that byte are whole [s]; None if there
        are none.
    """

    def __init__(
        self, path: str, text: str, offset: int, good_until: float | None = None
    ) -> None:
        self.offset = offset
        self.good_until = good_until
        whole = (
            "nothing before that can be used"
            if good_until is None
            else f"the data before that are whole up to {good_until:.3f} s of the show"
        )
        super().__init__(
            escaped(
                f"{path}: {text}, at byte {offset:,}; {whole}. "
                "Compile the show again, or fetch the file again."
            )
        )


class Damage(Exception):  # noqa: N818 - it becomes a DamagedLogError at the border
    """Raised inside the reader, which adds path and last good time."""

    def __init__(self, offset: int, text: str) -> None:
        super().__init__(text)
        self.offset = offset
        self.text = text

    def __reduce__(self) -> tuple[type[Damage], tuple[int, str]]:
        """Make a copy from the arguments; found elsewhere, it is raised here."""
        return Damage, (self.offset, self.text)


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
    position: int
    """Of its record in the file [bytes]."""


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


def fields(view: memoryview | bytes, record: Record) -> tuple[Any, ...]:
    """Return the fields of a record; written again, they must be its bytes."""
    opcode, data = Opcode(record.opcode), memoryview(view)[record.start : record.stop]
    kinds, found, at = _KINDS[opcode], list[Any](), 0
    with suppress(UnicodeDecodeError):
        for kind in kinds:
            value, end = _taken(data, at, kind)
            # So nothing is cut, or there twice in a map; what may be large is no copy.
            same = kind == "bytes8" or bytes(data[at:end]) == _field(kind, value)
            if end > len(data) or not same:
                break
            found.append(value)
            at = end
    if at != len(data) or len(found) != len(kinds):
        what = opcode.name.lower().replace("_", " ")
        text = f"a record ({what}) has bytes that its fields have not"
        raise Damage(record.start, text)
    return tuple(found)


def _taken(data: memoryview, at: int, kind: str) -> tuple[Any, int]:
    """Return the field at a place of a record's content, and where it ends."""
    if kind.isdecimal():
        end = at + int(kind)
        return int.from_bytes(data[at:end], "little"), end
    size, at = _taken(data, at, kind[-1] if kind.startswith("bytes") else "4")
    end = at + size
    if kind == "text":
        return bytes(data[at:end]).decode(), end
    if "-" not in kind:
        return data[at:end] if kind == "bytes8" else bytes(data[at:end]), end
    pairs: dict[Any, Any] = {}
    first, second = kind.split("-")
    while at < min(end, len(data)):
        key, at = _taken(data, at, first)
        pairs[key], at = _taken(data, at, second)
    return tuple(pairs.items()), at


def encoded(opcode: Opcode, *values: Any) -> bytes:  # noqa: ANN401 - see the table
    """Return a record with these fields, as it stands in a file."""
    pairs = zip(_KINDS[opcode], values, strict=True)
    content = b"".join([_field(*one) for one in pairs])
    return HEAD.pack(opcode, len(content)) + content


def _field(kind: str, value: Any) -> bytes:  # noqa: ANN401 - whatever the kind says
    if kind.isdecimal():
        return int(value).to_bytes(int(kind), "little")
    if "-" in kind:
        pair = kind.split("-")
        value = b"".join(
            _field(*one) for row in value for one in zip(pair, row, strict=True)
        )
    content: bytes = value.encode() if kind == "text" else value
    size = kind[-1] if kind.startswith("bytes") else "4"
    return _field(size, len(content)) + content


@lru_cache(maxsize=4)
def _unpacker(thread: int) -> zstandard.ZstdDecompressor:
    # Its tables take longer to make than a small chunk to unpack; each thread has its
    # own.
    del thread
    return zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK)


def inflate(view: memoryview, span: tuple[int, int], size: int) -> bytes:
    """Return the uncompressed data of a chunk.

    Raises
    ------
    Damage
        If they are no single frame of zstd, or not of the declared size.
    """
    packed = view[slice(*span)]
    # An empty frame is returned before what follows it is looked at.
    if not 0 < size <= LARGEST_CHUNK:
        text = f"a chunk claims {size:,} bytes; none or over {LARGEST_CHUNK:,} are"
        raise Damage(span[0], f"{text} refused")
    try:
        declared = zstandard.get_frame_parameters(packed).content_size
        if declared != size:
            raise Damage(span[0], f"a chunk of {size:,} bytes declares {declared:,}")
        data = _unpacker(get_ident()).decompress(packed, size, allow_extra_data=False)
    except (zstandard.ZstdError, MemoryError, ValueError) as error:
        raise Damage(span[0], f"a chunk does not unpack ({error})") from error
    if len(data) != size:
        raise Damage(span[0], f"a chunk unpacks to {len(data):,} bytes, not {size:,}")
    return bytes(data)


_FIXED = {1: 8, 5: 4}
"""Bytes of a field of fixed length, by the wire type."""


def has_more_fields(message: bytes, most: int) -> bool:
    """Whether an encoded protobuf message has more than ``most`` fields.

    Fields within fields do not count. What is malformed counts up to there: parsing it
    says so. Source: the Protocol Buffers encoding, section Message Structure.
    """
    if len(message) <= 2 * most:  # a field takes two bytes or more
        return False
    at = 0
    for _ in range(most + 1):
        if at >= len(message):
            return False
        tag, at = _varint(message, at)
        wire = tag & 7
        if wire in {0, 2}:
            length, at = _varint(message, at)
            at += length if wire == 2 else 0
        else:
            at += _FIXED.get(wire, len(message))
    return True


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """Return the number whose bytes begin at a place, and where they end."""
    number = shift = 0
    for byte in message[at : at + 10]:
        number, shift, at = number | (byte & 127) << shift, shift + 7, at + 1
        if byte < 128:
            break
    return number, at


class UnpackedAhead:
    """The chunks of a file in turn: a thread unpacks the next one meanwhile.

    To unpack a chunk takes about as long as to go through it.
    """

    def __init__(self, view: memoryview) -> None:
        self._view, self._position = view, 0
        self._begun: dict[int, Future[bytes]] = {}
        self._thread = ThreadPoolExecutor(1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._thread.shutdown(cancel_futures=True)

    def take(self, position: int) -> bytes:
        """Return the uncompressed data of the chunk whose record is at ``position``.

        Raises
        ------
        Damage
            If it does not unpack. What is wrong behind it is reported in its turn.
        """
        self._position = max(self._position, position)
        with suppress(Damage):
            for _ in range(_BETWEEN):
                if len(self._begun) == _AHEAD:
                    break
                record = next_record(self._view, self._position)
                if record.opcode == Opcode.CHUNK:
                    *_, size, _, _, packed = fields(self._view, record)
                    span = record.stop - len(packed), record.stop
                    job = self._thread.submit(inflate, self._view, span, size)
                    self._begun[record.position] = job
                self._position = record.stop
        return self._begun.pop(position).result()
