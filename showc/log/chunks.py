"""An MCAP file in chunks, as the mcap library writes it, many messages at a time.

The library adds message by message, which for a topic per drone takes longer than the
rest of the log together. Messages of one time and length are laid out by NumPy here;
records of all other kinds are the library's own, and so are the rules of when a chunk
is closed: the same messages give the same bytes.
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict, deque
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

if TYPE_CHECKING:
    from collections.abc import Iterable
    from concurrent.futures import Future

    from mcap.summary import Summary
    from numpy.typing import NDArray

    _Index = dict[int, list[tuple[int, int]]]

MAGIC = b"\x89MCAP0\r\n"
_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])
_INDEX = struct.Struct("<BQHI")
_FOOTER = struct.Struct("<BQQQ")
_MESSAGE = struct.Struct("<BQHIQQ")
_AHEAD = 4
"""Chunks that wait for being packed, at most: bounds the memory."""


class ChunkWriter:
    """Writes one file: Zstandard chunks, all indexes, all checksums.

    Parameters
    ----------
    stream
        With ``write`` and ``tell``.
    chunk_size
        Uncompressed bytes after which a chunk is closed.
    """

    def __init__(self, stream: BinaryIO, chunk_size: int) -> None:
        self._stream, self._limit = stream, chunk_size
        self._checksum = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: defaultdict[int, int] = defaultdict(int)
        self._span: tuple[int, int] | None = None
        # One after the other, so that what is waiting is in order; off the main thread,
        # because packing takes as long as filling.
        self._packer = ThreadPoolExecutor(1)
        self._packing: deque[tuple[Future[tuple[Chunk, bytes]], _Index]] = deque()
        self._open()

    def begin(self, library: str) -> None:
        """Begin a new file; its header names ``library`` as the writer."""
        self._write(MAGIC)
        self._write(_bytes(Header(profile="", library=library)))

    def resume(self, data: Iterable[bytes], summary: Summary) -> None:
        """Begin with the data of another file, of which ``summary`` says what it has.

        Attachments that it names behind these data are left out.
        """
        for part in data:
            self._write(part)
        end = self._stream.tell()
        self._schemas = [*summary.schemas.values()]
        self._channels = [*summary.channels.values()]
        self._chunks = summary.chunk_indexes
        self._attachments = [
            one for one in summary.attachment_indexes if one.offset < end
        ]
        self._metadata = summary.metadata_indexes
        found = summary.statistics
        if found is not None:
            self._counts.update(found.channel_message_counts)
            self._span = found.message_start_time, found.message_end_time

    def _open(self) -> None:
        """Begin a chunk."""
        self._parts: list[bytes] = []
        self._size = 0
        self._chunk_span: tuple[int, int] | None = None
        self._index: defaultdict[int, list[tuple[int, int]]] = defaultdict(list)

    def _write(self, data: bytes) -> None:
        self._checksum = zlib.crc32(data, self._checksum)
        self._stream.write(data)

    def _append(self, data: bytes) -> None:
        """Add records to the chunk."""
        self._parts.append(data)
        self._size += len(data)
        if self._size > self._limit:
            self._close()

    def add_metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write a record of names and values."""
        offset, data = (
            self._stream.tell(),
            _bytes(Metadata(name=name, metadata=entries)),
        )
        self._write(data)
        self._metadata.append(MetadataIndex(offset=offset, length=len(data), name=name))

    def add_attachment(self, time: int, name: str, media: str, content: bytes) -> None:
        """Write a file's content, created and logged at ``time`` [ns]."""
        offset = self._stream.tell()
        data = _bytes(
            Attachment(
                create_time=time,
                data=content,
                log_time=time,
                media_type=media,
                name=name,
            )
        )
        self._write(data)
        self._attachments.append(
            AttachmentIndex(
                create_time=time,
                data_size=len(content),
                length=len(data),
                log_time=time,
                media_type=media,
                name=name,
                offset=offset,
            )
        )

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema; returns its number."""
        number = len(self._schemas) + 1
        schema = Schema(data=data, encoding=encoding, id=number, name=name)
        self._schemas.append(schema)
        self._append(_bytes(schema))
        return number

    def register_channel(self, topic: str, encoding: str, schema: int) -> int:
        """Declare a topic whose messages follow a schema; returns its number."""
        number = len(self._channels) + 1
        channel = Channel(
            id=number,
            message_encoding=encoding,
            metadata={},
            schema_id=schema,
            topic=topic,
        )
        self._channels.append(channel)
        self._append(_bytes(channel))
        return number

    def add_message(
        self, channel: int, sequence: int, time: int, message: bytes
    ) -> None:
        """Write one message, logged and published at ``time`` [ns].

        ``sequence`` is its number among the channel's.
        """
        self._note([channel], 0, time)
        length = _MESSAGE.size - 9 + len(message)
        head = _MESSAGE.pack(Opcode.MESSAGE, length, channel, sequence, time, time)
        self._append(head + message)

    def add_messages(
        self, channels: list[int], sequence: int, time: int, messages: NDArray[np.void]
    ) -> None:
        """Write a message to each of some channels at ``time`` [ns].

        Parameters
        ----------
        sequence
            Number of each message among its channel's.
        messages
            Shape (n,), all of one length.
        """
        records = np.zeros(len(channels), dtype=_records(messages.dtype))
        records["opcode"] = Opcode.MESSAGE
        records["length"] = records.itemsize - 9
        records["channel"], records["sequence"] = channels, sequence
        records["logged"] = records["published"] = time
        records["message"] = messages
        begin = 0
        while begin < len(channels):
            # The message that passes the limit is the chunk's last one.
            room = max(0, self._limit - self._size) // records.itemsize + 1
            part = slice(begin, begin + room)
            self._note(channels[part], records.itemsize, time)
            self._append(records[part].tobytes())
            begin += room

    def _note(self, channels: list[int], size: int, time: int) -> None:
        """Put the messages that come next into the chunk's index, ``size`` bytes."""
        offset = self._size
        for channel in channels:
            self._index[channel].append((time, offset))
            offset += size
        first, last = self._chunk_span or (time, time)
        self._chunk_span = min(first, time), max(last, time)

    def _close(self) -> None:
        """End the chunk; it is packed while the next one fills."""
        if self._chunk_span is None:
            return
        content = b"".join(self._parts)
        packing = self._packer.submit(_packed, content, self._chunk_span)
        self._packing.append((packing, dict(self._index)))
        if len(self._packing) > _AHEAD:
            self._write_chunk()
        self._open()

    def _write_chunk(self) -> None:
        """Write the first of the packed chunks, and its message indexes."""
        packing, index = self._packing.popleft()
        chunk, data = packing.result()
        begin = self._stream.tell()
        self._write(data)
        offset, offsets, indexes = begin + len(data), {}, []
        for channel, entries in index.items():
            table = np.array(entries, dtype=_ENTRY).tobytes()
            head = _INDEX.pack(
                Opcode.MESSAGE_INDEX, 6 + len(table), channel, len(table)
            )
            offsets[channel] = offset
            offset += len(head) + len(table)
            indexes += [head, table]
            self._counts[channel] += len(entries)
        self._write(b"".join(indexes))
        first, last = chunk.message_start_time, chunk.message_end_time
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(data),
                chunk_start_offset=begin,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=last,
                message_index_length=offset - begin - len(data),
                message_index_offsets=offsets,
                message_start_time=first,
                uncompressed_size=chunk.uncompressed_size,
            )
        )
        start, end = self._span or (first, last)
        self._span = min(start, first), max(end, last)

    def finish(self) -> None:
        """Write the last chunk, the summary and the footer."""
        self._close()
        while self._packing:
            self._write_chunk()
        self._packer.shutdown()
        end = RecordBuilder()
        DataEnd(self._checksum).write(end)
        self._stream.write(end.end())
        start = self._stream.tell()
        first, last = self._span or (0, 0)
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=last,
            message_start_time=first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        summary = RecordBuilder()
        groups = []
        for opcode, group in (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ):
            place = summary.count
            for record in group:
                record.write(summary)
            length = summary.count - place
            groups.append(
                SummaryOffset(
                    group_length=length, group_opcode=opcode, group_start=start + place
                )
            )
        offsets = start + summary.count
        for offset in groups:
            offset.write(summary)
        content = summary.end()
        # The checksum covers the summary and the footer up to itself.
        footer = _FOOTER.pack(Opcode.FOOTER, 20, start, offsets)
        checksum = zlib.crc32(footer, zlib.crc32(content))
        self._stream.write(content)
        end_of_file = Footer(
            summary_crc=checksum, summary_offset_start=offsets, summary_start=start
        )
        self._stream.write(_bytes(end_of_file))
        self._stream.write(MAGIC)


def _packed(content: bytes, span: tuple[int, int]) -> tuple[Chunk, bytes]:
    """Compress a chunk; the chunk, and its record as it stands in the file."""
    first, last = span
    chunk = Chunk(
        compression="zstd",
        data=zstandard.compress(content),
        message_end_time=last,
        message_start_time=first,
        uncompressed_crc=zlib.crc32(content),
        uncompressed_size=len(content),
    )
    return chunk, _bytes(chunk)


@lru_cache(maxsize=4)
def _records(message: np.dtype[np.void]) -> np.dtype[np.void]:
    """Return the layout of records of messages of one length."""
    return np.dtype(
        [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("sequence", "<u4"),
            ("logged", "<u8"),
            ("published", "<u8"),
            ("message", message),
        ]
    )


def _bytes(record: Any) -> bytes:  # noqa: ANN401 - a record of the library
    """Return a record as it stands in the file."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
