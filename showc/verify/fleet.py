"""State and control of the whole fleet at given times, from the logged polynomials."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.bernstein import basis

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.show import LoggedShow, PieceTable

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

_TIMES = 32
"""Instants evaluated together; bounds the memory."""


class Fleet:
    """Evaluates a show; at the joint of two segments the later one counts."""

    def __init__(self, show: LoggedShow) -> None:
        self._segments = sorted(show.segments, key=lambda one: one.start)
        self._pieces = [
            [_Pieces(table) for table in segment.tables] for segment in self._segments
        ]
        self._drones = show.drones
        self._first = np.full((show.drones, 16), np.nan)
        for segment in reversed(self._segments):
            for table in segment.tables:
                row = table.first[:-1]
                self._first[table.drones, :12] = table.state[row, 0]
                self._first[table.drones, 12:] = table.control[row, 0]

    def __call__(self, times: FloatArray) -> FloatArray:
        """State and control (n, drones, 16) at show times (n,) [s], increasing.

        Before its first segment a drone is as at that segment's start, after its last
        as at that one's end.
        """
        result = np.empty((times.size, self._drones, 16))
        for begin in range(0, times.size, _TIMES):
            part = slice(begin, begin + _TIMES)
            self._fill(times[part], result[part])
        return result

    def _fill(self, times: FloatArray, result: FloatArray) -> None:
        result[:] = self._first
        last = np.full(self._drones, -1)
        for number, segment in enumerate(self._segments):
            if segment.end <= times[0]:
                last[segment.drones] = number
        for number, segment in enumerate(self._segments):
            if segment.start > times[-1]:
                break
            ended = segment.end <= times[0]
            first = int(np.searchsorted(times, segment.start))
            moment = np.minimum(times[first:] - segment.start, segment.duration)
            for pieces in self._pieces[number]:
                drones = pieces.table.drones
                if ended and not np.any(last[drones] == number):
                    continue
                pieces.fill(moment, result[first:], drones)


class _Pieces:
    """A table, and which of its rows counts when."""

    def __init__(self, table: PieceTable) -> None:
        self.table = table
        self.column = np.repeat(np.arange(table.drones.size), np.diff(table.first))
        """Place of each row's drone among the table's, shape (rows,)."""
        # A drone's first row counts before its start, its last one after its end.
        self.since = table.start.copy()
        self.since[table.first[:-1]] = -np.inf
        self.until = np.append(table.start[1:], np.inf)
        self.until[table.first[1:] - 1] = np.inf

    def fill(self, times: FloatArray, result: FloatArray, columns: IntArray) -> None:
        """Put state and control at times (n,) of the segment [s], rising, in a table.

        ``result`` has the shape (n, any, 16); ``columns`` are those of the table's
        drones in it.
        """
        table = self.table
        rows = np.flatnonzero((self.since <= times[-1]) & (self.until > times[0]))
        first = np.searchsorted(times, self.since[rows])
        counts = np.searchsorted(times, self.until[rows]) - first
        # Rows with the same number of instants are evaluated together.
        for count in np.unique(counts[counts > 0]).tolist():
            chosen = counts == count
            row = rows[chosen]
            instant = first[chosen][:, None] + np.arange(count)
            start, end = table.start[row, None], table.end[row, None]
            fraction = np.clip((times[instant] - start) / (end - start), 0.0, 1.0)
            place = instant, columns[self.column[row, None]]
            for part, coefficients in (
                (slice(0, 12), table.state),
                (slice(12, 16), table.control),
            ):
                weights = basis(coefficients.shape[1] - 1, fraction)
                result[*place, part] = np.matmul(weights, coefficients[row])


def evaluate(table: PieceTable, times: FloatArray) -> FloatArray:
    """State and control (n, drones of the table, 16) at times (n,) of a segment [s].

    Times rise; at the joint of two mesh intervals the later one counts.
    """
    count = table.drones.size
    result = np.empty((times.size, count, 16))
    _Pieces(table).fill(times, result, np.arange(count))
    return result
