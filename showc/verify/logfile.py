"""A log whose every byte was found in order, and its contents."""

from __future__ import annotations

import mmap
import zlib
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import zstandard

from showc.verify.damage import Damage
from showc.verify.records import HEAD

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from showc.arrays import BoolArray, IntArray
    from showc.verify.records import Attachment, Channel, Schema

LARGEST_CHUNK = 1 << 26
"""Greatest uncompressed size of a chunk that is read [bytes]: sixty times what showc
writes, and no bomb gets further."""

MESSAGE_HEAD = 22
"""Channel, sequence number and two times before a message's bytes [bytes]."""


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """Where the messages of one chunk lie and when they were logged."""

    channel: NDArray[np.uint16]
    """Channel number of each, shape (n,)."""
    log_time: IntArray
    """Time stamp of each, shape (n,) [ns]."""
    record: NDArray[np.uint32]
    """Offset of each record in the uncompressed chunk, shape (n,)."""
    size: NDArray[np.uint32]
    """Number of each message's bytes, shape (n,)."""

    @property
    def payload(self) -> IntArray:
        """Offset of each message's bytes in the uncompressed chunk, shape (n,)."""
        return self.record.astype(np.int64) + HEAD.size + MESSAGE_HEAD

    def only(self, keep: BoolArray) -> Messages:
        """Return those that are marked."""
        return Messages(
            self.channel[keep], self.log_time[keep], self.record[keep], self.size[keep]
        )


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """A chunk that was found whole."""

    uncompressed_size: int
    compression: str
    span: tuple[int, int]
    """Start and stop of its data in the file [bytes]."""
    messages: Messages


@dataclass(slots=True, eq=False)
class LogFile:
    """A whole log; made by :func:`showc.verify.mcap.open_log` only."""

    path: Path
    """As it was named."""
    view: memoryview
    """All its bytes."""
    library: str = ""
    """What the header names as the writer."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    """By number."""
    channels: dict[int, Channel] = field(default_factory=dict)
    """By number."""
    chunks: list[Chunk] = field(default_factory=list)
    """In the file's order."""
    attachments: list[Attachment] = field(default_factory=list)
    """In the file's order."""
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    """All metadata records: name and content."""
    warnings: list[tuple[int, str]] = field(default_factory=list)
    """Byte offset and text of every CRC that the writer left out."""

    def attachment(self, name: str) -> bytes | None:
        """Content of the attachment of that name; None if there is none."""
        for attachment in self.attachments:
            if attachment.name == name:
                start, stop = attachment.span
                return bytes(self.view[start:stop])
        return None

    def good_until(self, offset: int) -> float | None:
        """Show time up to which all data before byte ``offset`` are whole [s]."""
        times = [
            (int(chunk.messages.log_time[0]), int(chunk.messages.log_time[-1]))
            for chunk in self.chunks
            if chunk.span[1] <= offset and chunk.messages.log_time.size
        ]
        return (times[-1][1] - times[0][0]) * 1e-9 if times else None

    def times(self, channel: int) -> IntArray:
        """Time stamps of a channel's messages in order, shape (n,) [ns]."""
        parts = [
            chunk.messages.log_time[chunk.messages.channel == channel]
            for chunk in self.chunks
        ]
        return np.concatenate([*parts, np.empty(0, dtype=np.int64)])

    def read(
        self, channels: set[int], share: int = 0, shares: int = 1
    ) -> Iterator[tuple[bytes, Messages, int]]:
        """Go through the messages of some channels again, chunk by chunk.

        Parameters
        ----------
        channels
            Numbers of the channels; a negative one is none.
        share, shares
            Which of the equal shares of the chunks, in the file's order.

        Yields
        ------
        data
            The uncompressed chunk.
        messages
            Only those of ``channels``, in the file's order.
        offset
            Where the chunk's data begin in the file [bytes].
        """
        wanted = np.zeros(1 << 16, dtype=bool)
        wanted[[number for number in channels if number >= 0]] = True
        kept = [
            (chunk, keep)
            for chunk in self.chunks
            if (keep := wanted[chunk.messages.channel]).any()
        ]
        first, last = (len(kept) * at // shares for at in (share, share + 1))
        for chunk, keep in kept[first:last]:
            data = inflate(
                self.view, chunk.span, chunk.compression, chunk.uncompressed_size
            )
            self.release()
            yield data, chunk.messages.only(keep), chunk.span[0]

    def release(self) -> None:
        """Let the system take back the memory of the mapped file."""
        if isinstance(self.view.obj, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            self.view.obj.madvise(mmap.MADV_DONTNEED)


@lru_cache(maxsize=1)
def _unpacker() -> zstandard.ZstdDecompressor:
    # Its tables take longer to make than a small chunk to unpack.
    return zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK)


def inflate(
    view: memoryview, span: tuple[int, int], compression: str, size: int, crc: int = 0
) -> bytes:
    """Return the uncompressed data of a chunk, its CRC checked unless that is 0.

    Raises
    ------
    Damage
        If sizes, compression or CRC are not as declared.
    """
    start, stop = span
    packed = view[start:stop]
    if size > LARGEST_CHUNK:
        raise Damage(
            start,
            f"a chunk claims {size:,} bytes; more than {LARGEST_CHUNK:,} are refused",
        )
    if compression not in {"zstd", ""}:
        raise Damage(start, f"a chunk is packed with {compression!r}, not zstd")
    if compression:
        try:
            declared = zstandard.get_frame_parameters(packed).content_size
            if declared != size:
                raise Damage(start, f"a chunk of {size:,} bytes declares {declared:,}")
            unpacker = _unpacker().decompressobj()
            data = unpacker.decompress(packed)
        except (zstandard.ZstdError, MemoryError, ValueError) as error:
            raise Damage(start, f"a chunk does not unpack ({error})") from error
        if not unpacker.eof or unpacker.unused_data:
            raise Damage(start, "a chunk is no single frame from its start to its end")
    else:
        data = bytes(packed)
    if len(data) != size:
        raise Damage(start, f"a chunk unpacks to {len(data):,} bytes, not {size:,}")
    if crc and zlib.crc32(data) != crc:
        raise Damage(start, "the CRC of a chunk does not fit its data")
    return data
