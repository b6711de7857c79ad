"""The container: every byte of an MCAP file accounted for.

Reads the file from the first byte to the last and believes nothing that it has
not recomputed: magics, lengths, CRCs, message indexes, sequence numbers, order in time,
and the whole summary. What it cannot confirm is damage (:class:`DamagedLogError`);
only a CRC that the writer left out is no more than a warning.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import UsageError
from showc.files import UnreadableFileError, open_file, reason_of
from showc.verify.damage import Damage, DamagedLogError
from showc.verify.indexes import MessageIndexes
from showc.verify.logfile import Chunk, LogFile, release
from showc.verify.order import Order
from showc.verify.outline import Outline, content, next_record
from showc.verify.records import (
    MAGIC,
    Attachment,
    Channel,
    ChunkIndex,
    Cursor,
    MetadataIndex,
    Opcode,
    Schema,
)
from showc.verify.summary import Contents, check_summary
from showc.verify.unpack import unpack

if TYPE_CHECKING:
    from pathlib import Path

    from showc.verify.outline import Record
    from showc.verify.unpack import Unpacked

_INDEX = struct.Struct("<HI")
"""What a message index begins with: its channel, and the size of its entries."""

_TIES_ALLOWED = {"/show/segments", "/tf"}
"""Topics on which several messages may have one time: concurrent segments, and frames
that stand beside those that move."""


def open_log(path: Path, jobs: int | None = 1) -> LogFile:
    """Read every byte of the file and return it with all its contents located.

    Parameters
    ----------
    path
        The file.
    jobs
        Processes to share the work; None: one for each core.

    Raises
    ------
    UsageError
        If there is no such file or it cannot be read.
    DamagedLogError
        If anything in it is not as its writer must have left it.
    """
    try:
        with open_file(path) as stream:
            size = stream.seek(0, 2)
            mapped = (
                mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) if size else b""
            )
    except UnreadableFileError as error:
        raise UsageError(
            f"{path}: cannot be read ({error.reason}); name a log that showc compiled"
        ) from None
    except (OSError, ValueError) as error:
        raise UsageError(
            f"{path}: cannot be read ({reason_of(error)}); name a log that showc "
            "compiled"
        ) from error
    view = memoryview(mapped)
    walk = _Walk(path, view)
    try:
        return walk.run(jobs)
    except Damage as damage:
        raise DamagedLogError(
            str(path), damage.text, damage.offset, walk.good_until
        ) from damage


class _Walk:
    """One pass over the file."""

    def __init__(self, path: Path, view: memoryview) -> None:
        self.path = path
        self.view = view
        self.contents = Contents()
        self.chunks: list[Chunk] = []
        self.warnings: list[tuple[int, str]] = []
        self.order = Order()
        self.good_until: float | None = None
        self._epoch: int | None = None
        self._strict = np.ones(1 << 16, dtype=bool)
        # The chunk whose message indexes are being read.
        self._open: tuple[Record, Unpacked, MessageIndexes] | None = None
        self._open_end = 0
        self._unpacked: dict[int, Unpacked | Damage] = {}
        self._crc = 0

    def run(self, jobs: int | None) -> LogFile:
        view = self.view
        if len(view) == 0:
            raise Damage(0, "the file is empty")
        if bytes(view[: len(MAGIC)]) != MAGIC:
            raise Damage(
                0, "this is not an MCAP file: its first eight bytes are others"
            )
        position = len(MAGIC)
        if position == len(view):
            raise Damage(position, "the file ends after its first eight bytes")
        position = self._header(position)
        position = self._data_section(position, jobs)
        check_summary(view, position, self.contents, self.warnings)
        release(view)
        return LogFile(self.path, view, self.contents, self.chunks, self.warnings)

    def _header(self, position: int) -> int:
        record = next_record(self.view, position)
        if record.opcode != Opcode.HEADER:
            raise Damage(position, "the first record is not a header")
        cursor = content(self.view, record)
        profile, library = cursor.text("profile"), cursor.text("library")
        cursor.close("header")
        if profile or not library.startswith("showc"):
            raise Damage(
                position,
                f"this is an MCAP file of {library!r} with profile {profile!r}, "
                "not a log of showc's",
            )
        self.contents.library = library
        return cursor.stop

    def _data_section(self, position: int, jobs: int | None) -> int:
        """Read up to and with the Data End record; return where the summary begins."""
        outline = Outline(self.view, position)
        self._unpacked, self._crc = unpack(self.view, outline, jobs)
        for record in outline:
            self._take(record)
            position = record.stop
        return position

    def _take(self, record: Record) -> None:
        """Take the next record, in the order of the file."""
        opcode, position = record.opcode, record.position
        if opcode == Opcode.MESSAGE_INDEX:
            self._message_index(record)
            return
        self._close_chunk(position)
        cursor = content(self.view, record)
        if opcode == Opcode.CHUNK:
            self._chunk(record)
        elif opcode == Opcode.SCHEMA:
            self.contents.add_schema(Schema.read(cursor), position)
        elif opcode == Opcode.CHANNEL:
            self._channel(Channel.read(cursor), position)
        elif opcode == Opcode.ATTACHMENT:
            self._attachment(position, cursor)
        elif opcode == Opcode.METADATA:
            self._metadata(position, cursor)
        elif opcode == Opcode.DATA_END:
            self._data_end(position, cursor)
        else:
            raise Damage(
                position,
                f"a record of kind {opcode} stands where the data of the show should "
                "go on or end",
            )

    def _channel(self, channel: Channel, position: int) -> None:
        self.contents.add_channel(channel, position)
        self._strict[channel.number] = channel.topic not in _TIES_ALLOWED

    def _chunk(self, record: Record) -> None:
        unpacked, position = self._unpacked[record.position], record.position
        if isinstance(unpacked, Damage):
            raise unpacked
        head, messages = unpacked.head, unpacked.messages
        if not head.crc:
            self.warnings.append((position, "a chunk has no CRC"))
        for schema in unpacked.schemas:
            self.contents.add_schema(schema, position)
        for channel in unpacked.channels:
            self._channel(channel, position)
        self.order.add(
            head.start_time,
            head.end_time,
            messages,
            known=self.contents.channels,
            strict=self._strict,
            offset=position,
        )
        self.chunks.append(Chunk(head, messages))
        self._open = (record, unpacked, MessageIndexes(messages))
        self._open_end = record.stop

    def _message_index(self, record: Record) -> None:
        position = record.position
        if self._open is None:
            raise Damage(position, "a message index follows no chunk")
        start = record.start + _INDEX.size
        channel, size = 0, -1
        if start <= record.stop:
            channel, size = _INDEX.unpack_from(self.view, record.start)
        if start + size != record.stop:
            # One of its fields is too long or too short: say which.
            cursor = content(self.view, record)
            cursor.number(2, "channel of a message index")
            cursor.raw(4, "entries of a message index")
            cursor.close("message index")
        _, _, indexes = self._open
        indexes.take(channel, bytes(self.view[start : record.stop]), position)
        self._open_end = record.stop

    def _close_chunk(self, position: int) -> None:
        """All message indexes of the last chunk are read: hold them against it."""
        if self._open is None:
            return
        record, (head, messages, _, _), indexes = self._open
        self._open = None
        if not indexes.complete:
            raise Damage(position, "a chunk lacks the index of one of its channels")
        start, stop = head.data
        self.contents.chunks.append(
            ChunkIndex(
                start_time=head.start_time,
                end_time=head.end_time,
                offset=record.position,
                length=record.stop - record.position,
                index_offsets=tuple(sorted(indexes.positions.items())),
                index_length=self._open_end - record.stop,
                compression=head.compression,
                compressed_size=stop - start,
                uncompressed_size=head.uncompressed_size,
            )
        )
        self.contents.count_messages(messages)
        if messages.log_time.size:
            if self._epoch is None:
                self._epoch = int(messages.log_time.min())
            self.good_until = (int(messages.log_time.max()) - self._epoch) * 1e-9

    def _attachment(self, position: int, cursor: Cursor) -> None:
        begin = cursor.position
        log_time = cursor.number(8, "time of an attachment")
        create_time = cursor.number(8, "creation time of an attachment")
        name = cursor.text("name of an attachment")
        media_type = cursor.text("media type of an attachment")
        start, stop = cursor.raw(8, "data of an attachment")
        crc = cursor.number(4, "CRC of an attachment")
        cursor.close("attachment")
        if not crc:
            self.warnings.append((position, f"attachment {name!r} has no CRC"))
        elif zlib.crc32(self.view[begin:stop]) != crc:
            raise Damage(
                position, f"the CRC of attachment {name!r} does not fit its data"
            )
        self.contents.attachments.append(
            (
                Attachment(
                    position,
                    cursor.stop - position,
                    log_time,
                    create_time,
                    stop - start,
                    name,
                    media_type,
                ),
                (start, stop),
            )
        )

    def _metadata(self, position: int, cursor: Cursor) -> None:
        name, content = cursor.text("name of metadata"), cursor.text_map("metadata")
        cursor.close("metadata")
        self.contents.metadata.append((name, content))
        self.contents.metadata_indexes.append(
            MetadataIndex(position, cursor.stop - position, name)
        )

    def _data_end(self, position: int, cursor: Cursor) -> None:
        crc = cursor.number(4, "CRC of the data")
        cursor.close("data end")
        if not crc:
            self.warnings.append((position, "the data as a whole have no CRC"))
        elif self._crc != crc:
            raise Damage(
                position,
                "the CRC of the data as a whole does not fit: metadata, an index or "
                "the head of a record was altered",
            )
