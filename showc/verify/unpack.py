"""All chunks of a file unpacked, checked and scanned, side by side."""

from __future__ import annotations

import zlib
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from showc.verify.chunk import ChunkHead, Messages, inflate, scan
from showc.verify.crew import run_all
from showc.verify.damage import Damage
from showc.verify.outline import Outline, Record, content
from showc.verify.records import Opcode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.verify.records import Channel, Schema

_SHARES = 16
"""Parts of the file that can be unpacked side by side."""

_WORTH = 4_000_000
"""Size of a file from which copies of the process are worth making [bytes]."""


class Unpacked(NamedTuple):
    """What a chunk holds."""

    head: ChunkHead
    messages: Messages
    schemas: list[Schema]
    channels: list[Channel]


def unpack(
    view: memoryview, outline: Outline, jobs: int | None
) -> tuple[dict[int, Unpacked | Damage], int]:
    """Unpack all chunks of a file.

    Damage inside a chunk is returned, not raised: what stands before it in the file
    is to be judged first.

    Parameters
    ----------
    view
        The whole file.
    outline
        Its records.
    jobs
        Processes to share the work; None: one for each core.

    Returns
    -------
    dict
        Chunks by the position of their record. Those before the first damaged one are
        all there, and so is that.
    int
        CRC-32 of all bytes before the Data End record; 0 if there is no such record.
    """
    chunks = outline.of(Opcode.CHUNK)
    end = outline.of(Opcode.DATA_END)
    before = view[: end[0].position if end else 0]
    edges = [len(chunks) * share // _SHARES for share in range(_SHARES + 1)]
    crc, *shares = run_all(
        [
            partial(zlib.crc32, before),
            *(partial(_share, view, chunks[a:b]) for a, b in pairwise(edges)),
        ],
        jobs if len(view) > _WORTH else 1,
    )
    return {position: found for share in shares for position, found in share}, crc


def _share(
    view: memoryview, chunks: Sequence[Record]
) -> list[tuple[int, Unpacked | Damage]]:
    """Unpack some chunks, up to the first that is damaged."""
    found: list[tuple[int, Unpacked | Damage]] = []
    for record in chunks:
        try:
            unpacked = _unpacked(view, record)
        except Damage as damage:
            found.append((record.position, damage))
            break
        found.append((record.position, unpacked))
    return found


def _unpacked(view: memoryview, record: Record) -> Unpacked:
    head = ChunkHead.read(content(view, record))
    return Unpacked(head, *scan(inflate(view, head), record.position))
