"""What is added to a log after it was compiled: abort table, simulated flights.

An addition is an attachment behind all other data. It names the SHA-256 of the bytes
before the first addition, so that it holds for this log alone. Additions come in the
order of their names, and each name once: whatever was worked out first, and however
often, the same additions give the same file. The data that were compiled stay as they
are, byte by byte.
"""

from __future__ import annotations

import struct
from contextlib import contextmanager
from hashlib import sha256
from typing import TYPE_CHECKING

from mcap.exceptions import McapError
from mcap.reader import make_reader

from showc.errors import DamagedFileError, UsageError
from showc.files import flush, open_file, stage_for, unwritable
from showc.log.chunks import ChunkWriter
from showc.log.facts import media_type, named_digest
from showc.log.schema import ADDITIONS

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import BinaryIO

    from mcap.summary import Summary

_BLOCK = 1 << 20
"""Bytes that are read at once."""
_FOOTER = struct.Struct("<BQQQI8s")
"""End of a file: opcode, length, starts of summary and offsets, checksum, magic."""
_DATA_END = 13
"""Length of the record that ends the data [bytes]."""


def digest_of(log: Path) -> str:
    """Return the SHA-256 of a log's bytes before anything was added to it.

    Raises
    ------
    DamagedFileError
        If it is no log.
    """
    with open_file(log) as stream, _guarded(log):
        return data_digest(stream)


def data_digest(stream: BinaryIO) -> str:
    """Return the same of an open log."""
    hasher = sha256()
    for block in _blocks(stream, _layout(stream)[1]):
        hasher.update(block)
    return hasher.hexdigest()


def add(log: Path, name: str, content: bytes, digest: str) -> None:
    """Add something to a log, in the place of what had that name.

    Parameters
    ----------
    log
        The file; it is written anew, whole or not at all.
    name
        One of :data:`showc.log.schema.ADDITIONS`.
    content
        Names ``digest``.
    digest
        Of the log that it was worked out of, see :func:`digest_of`.

    Raises
    ------
    DamagedFileError
        If it is no log.
    UsageError
        If another log lies there by now, or it cannot be written.
    """
    try:
        # A name of its own: stages of a compile are for the compile to finish.
        with (
            open_file(log) as source,
            stage_for(log.with_suffix(".added")) as stage,
            _guarded(log),
        ):
            fresh = stage / log.name
            with fresh.open("wb") as target:
                _write(source, target, {name: content}, digest)
                flush(target)
            fresh.chmod(log.stat().st_mode & 0o777)
            fresh.replace(log)
    except OSError as error:
        raise unwritable(log, error) from error


def _write(
    source: BinaryIO, target: BinaryIO, more: dict[str, bytes], digest: str
) -> None:
    """Write a log with ``more`` additions."""
    if data_digest(source) != digest:
        raise UsageError(
            f"{source.name}: the log was compiled again meanwhile; nothing was added "
            "to it, repeat the command"
        )
    summary, end = _layout(source)
    source.seek(0)
    kept = {
        one.name: one.data
        for one in make_reader(source).iter_attachments()
        if one.name in ADDITIONS and named_digest(one.name, one.data) == digest
    }
    time = summary.attachment_indexes[0].log_time
    writer = ChunkWriter(target, _BLOCK)
    writer.resume(_blocks(source, end), summary)
    for name, content in sorted((kept | more).items()):
        writer.add_attachment(time, name, media_type(name), content)
    writer.finish()


def _layout(stream: BinaryIO) -> tuple[Summary, int]:
    """Return what a log has, and where the data end that were compiled [bytes]."""
    stream.seek(0)
    summary = make_reader(stream).get_summary()
    stream.seek(-_FOOTER.size, 2)
    end = _FOOTER.unpack(stream.read(_FOOTER.size))[2] - _DATA_END
    if summary is None or not summary.chunk_indexes or not summary.attachment_indexes:
        raise ValueError("it has no summary")
    last = max(one.chunk_start_offset for one in summary.chunk_indexes)
    added = [
        one.offset
        for one in summary.attachment_indexes
        if one.name in ADDITIONS and one.offset > last
    ]
    return summary, min([end, *added])


def _blocks(stream: BinaryIO, end: int) -> Iterator[bytes]:
    """Read a file from its first byte to ``end``."""
    stream.seek(0)
    while left := min(end - stream.tell(), _BLOCK):
        if not (block := stream.read(left)):
            raise ValueError("it is cut")
        yield block


@contextmanager
def _guarded(log: Path) -> Iterator[None]:
    try:
        yield
    except (McapError, ValueError, struct.error) as error:
        raise DamagedFileError(
            f"{log}: damaged: {error}; wanted a whole log of showc. 'showc verify' "
            "says more; compile the show again, or fetch the file again"
        ) from error
