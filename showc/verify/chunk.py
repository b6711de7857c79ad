"""The inside of a chunk: decompressed within bounds, its messages found and checked."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import zstandard

from showc.verify.damage import Damage
from showc.verify.records import HEAD, Channel, Cursor, Opcode, Schema

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    IntArray = NDArray[np.int64]

Record = TypeVar("Record", Schema, Channel)

LARGEST_CHUNK = 1 << 28
"""Greatest uncompressed size of a chunk that is read [bytes]: no bomb gets further."""

_MESSAGE = np.dtype(
    [("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_MESSAGE_HEAD = _MESSAGE.itemsize


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """Fields of a Chunk record before its data, and where the data lie in the file."""

    start_time: int
    end_time: int
    uncompressed_size: int
    crc: int
    compression: str
    data: tuple[int, int]

    @classmethod
    def read(cls, cursor: Cursor) -> ChunkHead:
        """Read the content of a Chunk record."""
        head = cls(
            cursor.number(8, "start time of a chunk"),
            cursor.number(8, "end time of a chunk"),
            cursor.number(8, "uncompressed size"),
            cursor.number(4, "CRC of a chunk"),
            cursor.text("compression"),
            cursor.raw(8, "data of a chunk"),
        )
        cursor.close("chunk")
        return head


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """Where the messages of one chunk lie and when they were logged."""

    channel: NDArray[np.uint16]
    """Channel number of each, shape (n,)."""
    sequence: IntArray
    """Sequence number of each, shape (n,)."""
    log_time: IntArray
    """Time stamp of each, shape (n,) [ns]."""
    publish_time: IntArray
    """Second time stamp of each, shape (n,) [ns]."""
    record: IntArray
    """Offset of each record in the uncompressed chunk, shape (n,)."""
    payload: IntArray
    """Offset of each message's bytes in the uncompressed chunk, shape (n,)."""
    size: IntArray
    """Number of those bytes, shape (n,)."""


def inflate(view: memoryview, head: ChunkHead, *, known: bool = False) -> bytes:
    """Return the uncompressed data of a chunk, its CRC checked if it is not ``known``.

    Raises
    ------
    Damage
        If sizes, compression or CRC are not as declared.
    """
    start, stop = head.data
    size = head.uncompressed_size
    if size > LARGEST_CHUNK:
        raise Damage(
            start,
            f"a chunk claims {size:,} bytes; more than {LARGEST_CHUNK:,} are refused",
        )
    if head.compression == "zstd":
        data = _decompress(view[start:stop], size, start)
    elif not head.compression:
        data = bytes(view[start:stop])
    else:
        raise Damage(start, f"a chunk is packed with {head.compression!r}, not zstd")
    if len(data) != size:
        raise Damage(start, f"a chunk unpacks to {len(data):,} bytes, not {size:,}")
    if not known and head.crc and zlib.crc32(data) != head.crc:
        raise Damage(start, "the CRC of a chunk does not fit its data")
    return data


@lru_cache(maxsize=1)
def _unpacker() -> zstandard.ZstdDecompressor:
    # Its tables take longer to make than a small chunk to unpack.
    return zstandard.ZstdDecompressor()


def _decompress(packed: memoryview, size: int, offset: int) -> bytes:
    try:
        declared = zstandard.get_frame_parameters(packed).content_size
        if declared == size:
            return _unpacker().decompress(packed, max_output_size=size)
        if declared != zstandard.CONTENTSIZE_UNKNOWN:
            raise Damage(
                offset, f"a chunk declares {size:,} bytes, its packing {declared:,}"
            )
        # One byte more than declared lets an overlong stream show itself.
        with _unpacker().stream_reader(packed) as stream:
            return bytes(stream.read(size + 1))
    except (zstandard.ZstdError, MemoryError, ValueError) as error:
        raise Damage(offset, f"a chunk does not unpack ({error})") from error


def scan(data: bytes, offset: int) -> tuple[Messages, list[Schema], list[Channel]]:
    """Walk the records of an uncompressed chunk that stands at ``offset`` of the file.

    Raises
    ------
    Damage
        If records do not fill the chunk exactly or are not what a chunk may hold.
    """
    unpack = HEAD.unpack_from
    head = HEAD.size
    records: list[int] = []
    sizes: list[int] = []
    schemas: list[Schema] = []
    channels: list[Channel] = []
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
            if size < _MESSAGE_HEAD:
                raise Damage(offset, "a message in a chunk is cut")
            records.append(position)
            sizes.append(size)
        elif opcode == Opcode.SCHEMA:
            schemas.append(_inside(Schema.read, data, position, stop, offset))
        elif opcode == Opcode.CHANNEL:
            channels.append(_inside(Channel.read, data, position, stop, offset))
        else:
            raise Damage(offset, f"a record of kind {opcode} stands in a chunk")
        position = stop
    return _columns(data, records, sizes), schemas, channels


def _inside(
    read: Callable[[Cursor], Record], data: bytes, position: int, stop: int, offset: int
) -> Record:
    """Read a record inside a chunk; damage is reported at the chunk."""
    try:
        return read(Cursor(data, position + HEAD.size, stop))
    except Damage as damage:
        raise Damage(offset, f"in a chunk, {damage.text}") from damage


def _columns(data: bytes, records: list[int], sizes: list[int]) -> Messages:
    record = np.array(records, dtype=np.int64)
    raw = np.frombuffer(data, dtype=np.uint8)
    start = record + HEAD.size
    rows = raw[start[:, None] + np.arange(_MESSAGE_HEAD)]
    table = np.ascontiguousarray(rows).view(_MESSAGE).reshape(-1)
    return Messages(
        channel=table["channel"].copy(),
        sequence=table["sequence"].astype(np.int64),
        log_time=table["log"].astype(np.int64),
        publish_time=table["publish"].astype(np.int64),
        record=record,
        payload=start + _MESSAGE_HEAD,
        size=np.array(sizes, dtype=np.int64) - _MESSAGE_HEAD,
    )
