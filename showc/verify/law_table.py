"""A law of straight legs, tabled in steps of time for many legs at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import PHASES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.autopilot import Profiles

    FloatArray = NDArray[np.float64]

_AT_ONCE = 10_000
"""Places of laws that are worked out together: they stay in the processor's cache."""


class LawTable:
    """Distance, speed and acceleration of legs in steps of ``step`` [s].

    Its memory is used again for the next legs: it takes long to get.
    """

    def __init__(self, step: float) -> None:
        self.step = step
        """Time between two rows [s]."""
        # Distance, speed, acceleration; a row more than can be asked for.
        self._law = np.empty((3, 0))
        self._make_room((0,))

    def _make_room(self, shape: tuple[int, ...]) -> None:
        self._row = np.empty(shape, dtype=np.int64)
        self._where, self._share = np.empty((2, *shape))
        self._next = np.empty((3, *shape))

    def fill(self, flights: Profiles) -> None:
        """Work out the table of n legs, one row of legs after the other.

        It takes least time if the longest legs come first.
        """
        duration = flights.duration
        count = self._count = flights.length.size
        self._leg = leg = np.arange(count)
        self._last = int(np.ceil(duration.max(initial=0.0) / self.step)) + 1
        height = self._last + 2
        if self._law.shape[1] < height * count:
            self._law = np.empty((3, height * count))
        law = self._law[:, : height * count].reshape(3, height, count)
        # Phases by the first step in each of them: they follow each other.
        begins = np.ceil(flights.edges[:, 1:PHASES] / self.step).astype(np.int64)
        begun = np.zeros((height, count), dtype=np.uint8)
        np.add.at(begun, (begins, leg[:, None]), 1)
        phase = np.zeros(count, dtype=np.int64)
        ends = flights.motion(leg, duration)[:, None]
        some = max(1, _AT_ONCE // max(count, 1))
        for begin in range(0, height, some):
            rows = slice(begin, min(begin + some, height))
            # Behind the last leg that still lasts, all rest at their ends.
            lasting = np.flatnonzero(duration > self.step * begin)
            moving = int(lasting[-1]) + 1 if lasting.size else 0
            part = np.cumsum(begun[rows, :moving], axis=0, dtype=np.int64)
            part += phase[:moving]
            phase[:moving] = part[-1]
            times = self.step * np.arange(rows.start, rows.stop)
            since = np.minimum(times[:, None], duration[:moving])
            since -= flights.edges[leg[:moving], part]
            legs = np.broadcast_to(leg[:moving], part.shape).ravel()
            found = flights.advanced(legs, part.ravel(), since.ravel())
            law[:, rows, :moving] = found.reshape(3, *part.shape)
            law[:, rows, moving:] = ends[..., moving:]

    def __call__(self, times: FloatArray, result: FloatArray) -> None:
        """Put distance, speed, acceleration (3, ..., m) in ``result``.

        At ``times`` (..., m) of the first m legs, in steps, 0 or more.
        """
        if times.shape != self._where.shape:
            self._make_room(times.shape)
        where, share, row, gain = self._where, self._share, self._row, self._next
        np.minimum(times, float(self._last), out=where)
        np.floor(where, out=share)
        np.copyto(row, share, casting="unsafe")
        np.subtract(where, share, out=share)
        row *= self._count
        row += self._leg[: times.shape[-1]]
        # All rows are within the table; "clip" spares a copy of the result.
        self._law.take(row, axis=1, out=result, mode="clip")
        row += self._count
        self._law.take(row, axis=1, out=gain, mode="clip")
        gain -= result
        gain *= share
        result += gain
