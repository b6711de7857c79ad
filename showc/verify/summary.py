"""The summary section: rebuilt from the data, and compared with what the file says."""

from __future__ import annotations

import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.damage import Damage
from showc.verify.records import (
    HEAD,
    MAGIC,
    Attachment,
    Channel,
    ChunkIndex,
    Cursor,
    MetadataIndex,
    Opcode,
    Schema,
    Statistics,
)

if TYPE_CHECKING:
    from showc.verify.chunk import Messages

_FOOTER_CONTENT = 20
_FOOTER = HEAD.size + _FOOTER_CONTENT

_READERS = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
    Opcode.ATTACHMENT_INDEX: Attachment.read_index,
    Opcode.METADATA_INDEX: MetadataIndex.read,
    Opcode.STATISTICS: Statistics.read,
}


@dataclass(slots=True)
class Contents:
    """What the data section holds, collected record by record."""

    library: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    attachments: list[tuple[Attachment, tuple[int, int]]] = field(default_factory=list)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    metadata_indexes: list[MetadataIndex] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)

    def add_schema(self, schema: Schema, offset: int) -> None:
        """Take a schema; twice is fine if both are the same."""
        if (
            schema.number == 0
            or self.schemas.setdefault(schema.number, schema) != schema
        ):
            raise Damage(offset, f"schema {schema.number} is defined in two ways")

    def add_channel(self, channel: Channel, offset: int) -> None:
        """Take a channel; twice is fine if both are the same."""
        if self.channels.setdefault(channel.number, channel) != channel:
            raise Damage(offset, f"channel {channel.number} is defined in two ways")
        if channel.schema not in self.schemas:
            raise Damage(
                offset,
                f"channel {channel.topic!r} has a schema that is not defined before it",
            )

    def count_messages(self, messages: Messages) -> None:
        """Add the messages of a chunk to the statistics."""
        numbers, counts = np.unique(messages.channel, return_counts=True)
        self.counts.update(dict(zip(numbers.tolist(), counts.tolist(), strict=True)))

    def statistics(self) -> Statistics:
        """Return what the Statistics record must say."""
        filled = [chunk for chunk in self.chunks if chunk.end_time]
        return Statistics(
            messages=self.counts.total(),
            schemas=len(self.schemas),
            channels=len(self.channels),
            attachments=len(self.attachments),
            metadata=len(self.metadata),
            chunks=len(self.chunks),
            start_time=min((chunk.start_time for chunk in filled), default=0),
            end_time=max((chunk.end_time for chunk in filled), default=0),
            channel_messages=tuple(sorted(self.counts.items())),
        )


def check_summary(
    view: memoryview,
    begin: int,
    contents: Contents,
    warnings: list[tuple[int, str]],
) -> None:
    """Read the summary, the footer and the last magic, and compare with ``contents``.

    Parameters
    ----------
    view
        The whole file.
    begin
        Where the data section ended.
    contents
        What it held.
    warnings
        Gets what is left out, as byte offset and text.

    Raises
    ------
    Damage
        If anything differs from what the data say, or bytes follow the end.
    """
    footer = _find_footer(view, begin)
    cursor = Cursor(view, footer + HEAD.size, footer + _FOOTER)
    summary, offsets, crc = (
        cursor.number(8, "start of the summary"),
        cursor.number(8, "start of the summary offsets"),
        cursor.number(4, "CRC of the summary"),
    )
    if not crc:
        warnings.append((footer, "the summary has no CRC"))
    elif zlib.crc32(view[begin : footer + _FOOTER - 4]) != crc:
        raise Damage(footer, "the CRC of the summary does not fit")
    if summary != begin:
        raise Damage(footer, f"the footer says the summary begins at byte {summary:,}")
    found, groups, offset_start = _collect(view, begin, footer)
    if offsets != offset_start:
        raise Damage(footer, "the footer names a wrong start of the summary offsets")
    _compare(found, contents, begin)
    _compare_groups(view, groups, offset_start, footer)


def _find_footer(view: memoryview, begin: int) -> int:
    """Walk to the footer; insist on the magic after it and on nothing more."""
    position = begin
    while True:
        left = len(view) - position
        if left < HEAD.size:
            raise Damage(position, "the file ends before its footer: it was cut")
        opcode, size = HEAD.unpack_from(view, position)
        if size > left - HEAD.size:
            raise Damage(position, "the file ends inside its summary: it was cut")
        if opcode == Opcode.FOOTER:
            break
        position += HEAD.size + size
    if size != _FOOTER_CONTENT:
        raise Damage(position, "the footer has a wrong length")
    after = position + _FOOTER
    tail = bytes(view[after : after + len(MAGIC)])
    if tail != MAGIC:
        raise Damage(
            after, "the last eight bytes of an MCAP file are missing or others"
        )
    if after + len(MAGIC) != len(view):
        extra = len(view) - after - len(MAGIC)
        raise Damage(after + len(MAGIC), f"{extra:,} bytes follow the end of the file")
    return position


Groups = list[tuple[int, int, int]]


def _collect(
    view: memoryview, begin: int, footer: int
) -> tuple[dict[int, list[object]], Groups, int]:
    """Read all records of the summary: contents by kind, groups, start of offsets."""
    found: dict[int, list[object]] = {int(kind): [] for kind in _READERS}
    groups: Groups = []
    position = begin
    while position < footer:
        opcode, size = HEAD.unpack_from(view, position)
        stop = position + HEAD.size + size
        if opcode == Opcode.SUMMARY_OFFSET:
            return found, groups, position
        if opcode not in found:
            raise Damage(position, f"a record of kind {opcode} stands in the summary")
        cursor = Cursor(view, position + HEAD.size, stop)
        found[opcode].append(_READERS[Opcode(opcode)](cursor))
        if groups and groups[-1][0] == opcode:
            groups[-1] = (opcode, groups[-1][1], stop - groups[-1][1])
        else:
            groups.append((opcode, position, stop - position))
        position = stop
    return found, groups, 0


def _compare(found: dict[int, list[object]], contents: Contents, begin: int) -> None:
    expected: dict[int, list[object]] = {
        Opcode.SCHEMA: list(contents.schemas.values()),
        Opcode.CHANNEL: list(contents.channels.values()),
        Opcode.CHUNK_INDEX: list(contents.chunks),
        Opcode.ATTACHMENT_INDEX: [index for index, _ in contents.attachments],
        Opcode.METADATA_INDEX: list(contents.metadata_indexes),
        Opcode.STATISTICS: [contents.statistics()],
    }
    names = {
        Opcode.SCHEMA: "schemas",
        Opcode.CHANNEL: "channels",
        Opcode.CHUNK_INDEX: "index of the chunks",
        Opcode.ATTACHMENT_INDEX: "index of the attachments",
        Opcode.METADATA_INDEX: "index of the metadata",
        Opcode.STATISTICS: "statistics",
    }
    for kind, wanted in expected.items():
        if sorted(map(repr, found[kind])) != sorted(map(repr, wanted)):
            raise Damage(
                begin, f"the {names[Opcode(kind)]} in the summary differ from the data"
            )


def _compare_groups(view: memoryview, groups: Groups, begin: int, footer: int) -> None:
    position = begin or footer
    named: Groups = []
    while position < footer:
        opcode, size = HEAD.unpack_from(view, position)
        cursor = Cursor(view, position + HEAD.size, position + HEAD.size + size)
        if opcode != Opcode.SUMMARY_OFFSET:
            raise Damage(position, f"a record of kind {opcode} follows the offsets")
        named.append(
            (
                cursor.number(1, "kind of a group"),
                cursor.number(8, "start of a group"),
                cursor.number(8, "length of a group"),
            )
        )
        cursor.close("summary offset")
        position = cursor.stop
    if named and sorted(named) != sorted(groups):
        raise Damage(begin, "the offsets in the summary do not fit its groups")
