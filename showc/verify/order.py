"""Order of messages over the whole file: in time, and in their sequence numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.damage import Damage

if TYPE_CHECKING:
    from collections.abc import Container

    from numpy.typing import NDArray

    from showc.verify.chunk import Messages

_CHANNELS = 1 << 16


class Order:
    """Follows all channels through the chunks of a file."""

    def __init__(self) -> None:
        self._next = np.zeros(_CHANNELS, dtype=np.int64)
        self._last = np.full(_CHANNELS, -1, dtype=np.int64)
        self._end = -1

    def add(
        self,
        start_time: int,
        end_time: int,
        messages: Messages,
        *,
        known: Container[int],
        strict: NDArray[np.bool_],
        offset: int,
    ) -> None:
        """Check the next chunk.

        Parameters
        ----------
        start_time, end_time
            What the chunk says of its time [ns].
        messages
            Its messages.
        known
            Numbers of the channels defined so far.
        strict
            Whether times of a channel must increase strictly, by channel number.
        offset
            Where the chunk stands in the file [bytes].

        Raises
        ------
        Damage
            If times or sequence numbers are not as a writer leaves them.
        """
        time = messages.log_time
        if time.size == 0:
            if start_time or end_time:
                raise Damage(offset, "an empty chunk claims a time")
            return
        if (int(time.min()), int(time.max())) != (start_time, end_time):
            raise Damage(
                offset,
                f"a chunk claims the times {start_time} to {end_time} ns, its messages "
                f"go from {int(time.min())} to {int(time.max())} ns",
            )
        if start_time < self._end:
            raise Damage(offset, "a chunk begins before the one before it ends")
        self._end = end_time
        if np.any(np.diff(time) < 0):
            raise Damage(offset, "messages in a chunk are not in order of time")
        if np.any(messages.publish_time != time):
            raise Damage(offset, "a message has two different times")
        self._channels(messages, known=known, strict=strict, offset=offset)

    def _channels(
        self,
        messages: Messages,
        *,
        known: Container[int],
        strict: NDArray[np.bool_],
        offset: int,
    ) -> None:
        order = np.argsort(messages.channel, kind="stable")
        channel = messages.channel[order]
        first = np.flatnonzero(np.r_[True, channel[1:] != channel[:-1]])
        last = np.r_[first[1:], channel.size] - 1
        present = channel[first]
        for number in present.tolist():
            if number not in known:
                raise Damage(
                    offset, f"messages on channel {number}, which is not defined"
                )
        sequence = messages.sequence[order]
        before = np.r_[-1, sequence[:-1]]
        before[first] = self._next[present] - 1
        if np.any(sequence != before + 1):
            bad = int(np.flatnonzero(sequence != before + 1)[0])
            raise Damage(
                offset,
                f"messages are missing or double on channel {int(channel[bad])}: "
                f"number {int(sequence[bad])} follows {int(before[bad])}",
            )
        self._next[present] = sequence[last] + 1
        time = messages.log_time[order]
        earlier = np.r_[np.int64(-1), time[:-1]]
        earlier[first] = self._last[present]
        if np.any(time - earlier < strict[channel]):
            bad = int(channel[np.flatnonzero(time - earlier < strict[channel])[0]])
            raise Damage(offset, f"times on channel {bad} do not increase")
        self._last[present] = time[last]
