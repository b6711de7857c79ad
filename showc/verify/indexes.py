"""The message indexes that follow a chunk, held against the chunk's messages."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.damage import Damage

if TYPE_CHECKING:
    from showc.verify.chunk import Messages

_ENTRY = 16
"""Size of an entry: time stamp and offset of a message [bytes]."""


class MessageIndexes:
    """Message indexes of one chunk, taken one by one."""

    def __init__(self, messages: Messages) -> None:
        self.positions: dict[int, int] = {}
        """Where the index of each channel stands in the file [bytes]."""
        order = np.argsort(messages.channel, kind="stable")
        channel = messages.channel[order]
        table = np.empty((order.size, 2), dtype="<u8")
        table[:, 0] = messages.log_time[order]
        table[:, 1] = messages.record[order]
        edges = np.flatnonzero(np.diff(channel)) + 1
        first = np.r_[np.zeros(min(order.size, 1), dtype=np.int64), edges]
        last = np.r_[edges, order.size][: first.size]
        self._wanted = table.tobytes()
        self._spans = {
            number: (_ENTRY * begin, _ENTRY * end)
            for number, begin, end in zip(
                channel[first].tolist(), first.tolist(), last.tolist(), strict=True
            )
        }

    def take(self, channel: int, entries: bytes, position: int) -> None:
        """Check the index of a channel that stands at ``position`` of the file.

        Raises
        ------
        Damage
            If it is malformed, or says of the messages what is not so.
        """
        if len(entries) % _ENTRY or channel in self.positions:
            raise Damage(position, "a message index is malformed")
        begin, end = self._spans.get(channel, (0, 0))
        wanted = self._wanted[begin:end]
        if entries != wanted and _by_place(entries) != wanted:
            raise Damage(
                position,
                "a message index does not say where the messages of its chunk lie",
            )
        self.positions[channel] = position

    @property
    def complete(self) -> bool:
        """Whether every channel of the chunk had its index, and no other."""
        return self.positions.keys() == self._spans.keys()


def _by_place(entries: bytes) -> bytes:
    """Sort entries as the messages stand in the chunk: any order is allowed."""
    table = np.frombuffer(entries, dtype="<u8").reshape(-1, 2)
    return table[np.argsort(table[:, 1], kind="stable")].tobytes()
