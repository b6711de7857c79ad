"""A log whose every byte was found in order, and its contents."""

from __future__ import annotations

import mmap
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.chunk import ChunkHead, Messages, inflate

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from showc.verify.records import Attachment, Channel, Schema
    from showc.verify.summary import Contents


def release(view: memoryview) -> None:
    """Let the system take back the memory of a mapped file; it can be read again."""
    if isinstance(view.obj, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        view.obj.madvise(mmap.MADV_DONTNEED)


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """A chunk that was found whole."""

    head: ChunkHead
    messages: Messages


class LogFile:
    """A whole log; made by :func:`open_log` only."""

    def __init__(
        self,
        path: Path,
        view: memoryview,
        contents: Contents,
        chunks: list[Chunk],
        warnings: list[tuple[int, str]],
    ) -> None:
        self.path = path
        self.contents = contents
        self.warnings = tuple(warnings)
        """Byte offset and text of every CRC that the writer left out."""
        self.size = len(view)
        """Number of bytes of the file."""
        self._view = view
        self._chunks = chunks

    @property
    def channels(self) -> dict[int, Channel]:
        """Channels by number."""
        return self.contents.channels

    @property
    def schemas(self) -> dict[int, Schema]:
        """Schemas by number."""
        return self.contents.schemas

    @property
    def attachments(self) -> list[Attachment]:
        """All attachments without their content, in the file's order."""
        return [entry for entry, _ in self.contents.attachments]

    @property
    def library(self) -> str:
        """What the header names as the writer."""
        return self.contents.library

    @property
    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """All metadata records: name and content."""
        return self.contents.metadata

    def attachment(self, name: str) -> bytes | None:
        """Content of the attachment of that name; None if there is none."""
        for attachment, (start, stop) in self.contents.attachments:
            if attachment.name == name:
                return bytes(self._view[start:stop])
        return None

    def good_until(self, offset: int) -> float | None:
        """Show time up to which all data before byte ``offset`` are whole [s]."""
        times = [
            (int(chunk.messages.log_time[0]), int(chunk.messages.log_time[-1]))
            for chunk in self._chunks
            if chunk.head.data[1] <= offset and chunk.messages.log_time.size
        ]
        return (times[-1][1] - times[0][0]) * 1e-9 if times else None

    def times(self, channel: int) -> np.ndarray:
        """Time stamps of a channel's messages in order, shape (n,) [ns]."""
        parts = [
            chunk.messages.log_time[chunk.messages.channel == channel]
            for chunk in self._chunks
        ]
        return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)

    def read(
        self, channels: set[int], share: int = 0, shares: int = 1
    ) -> Iterator[tuple[bytes, Messages, int]]:
        """Go through the messages of some channels again, chunk by chunk.

        Parameters
        ----------
        channels
            Numbers of the channels; a negative one is none.
        share, shares
            Which of so many equal shares of the chunks, in the file's order.

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
            for chunk in self._chunks
            if (keep := wanted[chunk.messages.channel]).any()
        ]
        first, last = (len(kept) * at // shares for at in (share, share + 1))
        for chunk, keep in kept[first:last]:
            data = inflate(self._view, chunk.head, known=True)
            release(self._view)
            m = chunk.messages
            yield (
                data,
                Messages(
                    channel=m.channel[keep],
                    sequence=m.sequence[keep],
                    log_time=m.log_time[keep],
                    publish_time=m.publish_time[keep],
                    record=m.record[keep],
                    payload=m.payload[keep],
                    size=m.size[keep],
                ),
                chunk.head.data[0],
            )
