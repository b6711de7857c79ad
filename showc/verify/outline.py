"""The records of a file's data section, found by their lengths alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from showc.verify.damage import Damage
from showc.verify.records import HEAD, Cursor, Opcode

if TYPE_CHECKING:
    from collections.abc import Iterator

IN_DATA = frozenset(
    {
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.CHUNK,
        Opcode.MESSAGE_INDEX,
        Opcode.ATTACHMENT,
        Opcode.METADATA,
        Opcode.DATA_END,
    }
)
"""Kinds of records that may stand between the header and the summary."""


class Record(NamedTuple):
    """Where a record stands."""

    opcode: int
    position: int
    """Of its head, in the file [bytes]."""
    start: int
    """Of its content [bytes]."""
    stop: int
    """Of its content [bytes]."""


class Outline:
    """All records from a position up to and with Data End, or up to what is damaged.

    Nothing of their content has been looked at. Iterating gives the records in the
    order of the file, and raises :class:`Damage` where they do not go on.
    """

    def __init__(self, view: memoryview, position: int) -> None:
        self.records: list[Record] = []
        """Those that were found."""
        self._damage: Damage | None = None
        opcode = -1
        while opcode != Opcode.DATA_END:
            try:
                record = next_record(view, position)
            except Damage as damage:
                self._damage = damage
                return
            self.records.append(record)
            opcode, position = record.opcode, record.stop
            if opcode not in IN_DATA:
                return

    def __iter__(self) -> Iterator[Record]:
        """Go through the records, then raise what ended them early."""
        yield from self.records
        if self._damage is not None:
            raise self._damage

    def of(self, opcode: Opcode) -> list[Record]:
        """Return the records of one kind."""
        return [record for record in self.records if record.opcode == opcode]


def next_record(view: memoryview, position: int) -> Record:
    """Return the record at ``position``; damage if it does not fit into the file."""
    left = len(view) - position
    if left == 0:
        raise Damage(position, "the file ends where a record should follow: it was cut")
    if left < HEAD.size:
        raise Damage(position, f"the file ends {left} bytes into a record: it was cut")
    opcode, size = HEAD.unpack_from(view, position)
    if size > left - HEAD.size:
        raise Damage(
            position,
            f"a record of {size:,} bytes begins where {left - HEAD.size:,} are left: "
            "the file was cut or altered",
        )
    start = position + HEAD.size
    return Record(opcode, position, start, start + size)


def content(view: memoryview, record: Record) -> Cursor:
    """Return a cursor over the record's content."""
    return Cursor(view, record.start, record.stop)
