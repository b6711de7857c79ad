"""A log whose every byte was found in order, and its contents."""

from __future__ import annotations

import mmap
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import zstandard

from showc.verify.damage import Damage, DamagedLogError
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
    record: IntArray
    """Offset of each record in the uncompressed chunk, shape (n,)."""
    size: IntArray
    """Number of each message's bytes, shape (n,)."""

    @property
    def payload(self) -> IntArray:
        """Offset of each message's bytes in the uncompressed chunk, shape (n,)."""
        return self.record + HEAD.size + MESSAGE_HEAD

    def only(self, keep: BoolArray) -> Messages:
        """Return those that are marked."""
        return Messages(
            self.channel[keep], self.log_time[keep], self.record[keep], self.size[keep]
        )


class Message(NamedTuple):
    """One message of a log."""

    channel: int
    time: int
    """Time stamp [ns]."""
    data: bytes
    offset: int
    """Where the data of its chunk begin in the file [bytes]."""


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """A chunk that was found whole."""

    uncompressed_size: int
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
                return bytes(self.view[slice(*attachment.span)])
        return None

    def good_until(self, offset: int) -> float | None:
        """Show time up to which all data before byte ``offset`` are whole [s]."""
        times = [
            (int(chunk.messages.log_time[0]), int(chunk.messages.log_time[-1]))
            for chunk in self.chunks
            if chunk.span[1] <= offset and chunk.messages.log_time.size
        ]
        return (times[-1][1] - times[0][0]) * 1e-9 if times else None

    @contextmanager
    def reported(self) -> Iterator[None]:
        """Turn damage that is met into the error that a user sees."""
        try:
            yield
        except Damage as damage:
            whole = self.good_until(damage.offset)
            raise DamagedLogError(
                str(self.path), damage.text, damage.offset, whole
            ) from damage

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
            Numbers of the channels.
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
        wanted = np.isin(np.arange(1 << 16), list(channels))
        kept = [
            (chunk, keep)
            for chunk in self.chunks
            if (keep := wanted[chunk.messages.channel]).any()
        ]
        first, last = (len(kept) * at // shares for at in (share, share + 1))
        for chunk, keep in kept[first:last]:
            data = inflate(self.view, chunk.span, chunk.uncompressed_size)
            self.release()
            yield data, chunk.messages.only(keep), chunk.span[0]

    def messages(
        self, channels: set[int], share: int = 0, shares: int = 1
    ) -> Iterator[Message]:
        """Go through the messages of some channels again, one by one: see ``read``."""
        for data, m, offset in self.read(channels, share, shares):
            yield from messages_of(data, m, offset)

    def release(self) -> None:
        """Let the system take back the memory of the mapped file."""
        if isinstance(self.view.obj, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            self.view.obj.madvise(mmap.MADV_DONTNEED)


def messages_of(data: bytes, messages: Messages, offset: int) -> Iterator[Message]:
    """Go through messages of an uncompressed chunk that begins at ``offset``."""
    for number, time, start, size in zip(
        messages.channel.tolist(),
        messages.log_time.tolist(),
        messages.payload.tolist(),
        messages.size.tolist(),
        strict=True,
    ):
        yield Message(number, time, data[start : start + size], offset)


@lru_cache(maxsize=1)
def _unpacker() -> zstandard.ZstdDecompressor:
    # Its tables take longer to make than a small chunk to unpack.
    return zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK)


def inflate(view: memoryview, span: tuple[int, int], size: int) -> bytes:
    """Return the uncompressed data of a chunk.

    Raises
    ------
    Damage
        If they are no single frame of zstd, or not of the declared size.
    """
    packed = view[slice(*span)]
    if size > LARGEST_CHUNK:
        raise Damage(
            span[0],
            f"a chunk claims {size:,} bytes; more than {LARGEST_CHUNK:,} are refused",
        )
    try:
        declared = zstandard.get_frame_parameters(packed).content_size
        if declared != size:
            raise Damage(span[0], f"a chunk of {size:,} bytes declares {declared:,}")
        unpacker = _unpacker().decompressobj()
        data = unpacker.decompress(packed)
    except (zstandard.ZstdError, MemoryError, ValueError) as error:
        raise Damage(span[0], f"a chunk does not unpack ({error})") from error
    if not unpacker.eof or unpacker.unused_data:
        raise Damage(span[0], "a chunk is no single frame from its start to its end")
    if len(data) != size:
        raise Damage(span[0], f"a chunk unpacks to {len(data):,} bytes, not {size:,}")
    return data
