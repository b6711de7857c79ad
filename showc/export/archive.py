"""Zip archives whose entries are packed one by one, the same bytes at any time of day.

Layout after PKWARE's APPNOTE 6.3.10: local headers with their contents, a directory,
its end. Entries that were packed in other processes are only put in a row.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

LEVEL = 5
"""Of compression: beyond it a show shrinks by a per cent."""

_LOCAL, _DIRECTORY, _END = "<4s5H3I2H", "<4s6H3I5H2I", "<4s4H2IH"
"""Fields of the three kinds of record."""

_VERSION, _UNIX, _DEFLATED, _DATE = 20, 3, 8, (1 << 5) | 1
"""Version 2.0 of the format; the system it comes from; the method; 1980-01-01, the
oldest day it knows, so that equal shows have equal bytes."""

_MODE = 0o100644 << 16
"""A plain file that its owner may write."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A file, packed."""

    name: str
    """With slashes."""
    crc: int
    """Of the content."""
    size: int
    """Of the content [bytes]."""
    packed: bytes
    """Deflated."""


def packed(name: str, text: str) -> Entry:
    """Pack a text file."""
    content = text.encode()
    deflate = zlib.compressobj(LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    body = deflate.compress(content) + deflate.flush()
    return Entry(name, zlib.crc32(content), len(content), body)


def archive(entries: Iterable[Entry]) -> bytes:
    """Return the archive of some entries, in their order."""
    body, directory, count, offset = [], [], 0, 0
    for entry in entries:
        name = entry.name.encode("ascii")
        shared = (0, _DEFLATED, 0, _DATE, entry.crc, len(entry.packed), entry.size)
        head = struct.pack(_LOCAL, b"PK\3\4", _VERSION, *shared, len(name), 0) + name
        made = (_UNIX << 8) | _VERSION
        rest = (len(name), 0, 0, 0, 0, _MODE, offset)
        directory += [
            struct.pack(_DIRECTORY, b"PK\1\2", made, _VERSION, *shared, *rest),
            name,
        ]
        body += [head, entry.packed]
        offset += len(head) + len(entry.packed)
        count += 1
    listed = b"".join(directory)
    end = struct.pack(_END, b"PK\5\6", 0, 0, count, count, len(listed), offset, 0)
    return b"".join([*body, listed, end])
