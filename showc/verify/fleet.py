"""State and control of the whole fleet at given times, from the logged polynomials."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from showc.verify.kernel.bernstein import basis

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.verify.kernel.show import LoggedShow, PieceTable


_TIMES = 32
"""Instants evaluated together; bounds the memory."""

_MANY = 8
"""Drones whose pieces of one interval of time are worth a product of their own."""


class Fleet:
    """Evaluates a show; at the joint of two segments the later one counts."""

    def __init__(self, show: LoggedShow) -> None:
        self._segments = sorted(show.segments, key=lambda one: one.start)
        self._pieces = [
            [_Pieces(table) for table in segment.tables] for segment in self._segments
        ]
        self._drones = show.drones
        self._first = np.full((16, show.drones), np.nan)
        for segment in reversed(self._segments):
            for table in segment.tables:
                row = table.first[:-1]
                self._first[:12, table.drones] = table.state[row, 0].T
                self._first[12:, table.drones] = table.control[row, 0].T

    def __call__(self, times: FloatArray) -> FloatArray:
        """State and control (16, n, drones) at show times (n,) [s], increasing.

        Before its first segment a drone is as at that segment's start, after its last
        as at that one's end.
        """
        result = np.empty((16, times.size, self._drones))
        for begin in range(0, times.size, _TIMES):
            part = slice(begin, begin + _TIMES)
            self._fill(times[part], result[:, part])
        return result

    def _fill(self, times: FloatArray, result: FloatArray) -> None:
        result[:] = self._first[:, None]
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
                pieces.fill(moment, result[:, first:], drones)


class _Intervals(NamedTuple):
    """Intervals of time, and when they count: each array has the shape (n,)."""

    start: FloatArray
    """Since the start of the segment [s]."""
    end: FloatArray
    """Since the start of the segment [s]."""
    since: FloatArray
    """From when on it counts [s]."""
    until: FloatArray
    """When the next one does [s]."""

    def part(self, rows: IntArray) -> _Intervals:
        """Return some of them."""
        return _Intervals(*(column[rows] for column in self))

    def instants(self, times: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
        """Which of them count at ``times`` that rise, from which on, and at how many.

        All three have the shape (n,).
        """
        near = np.flatnonzero((self.since <= times[-1]) & (self.until > times[0]))
        first = np.searchsorted(times, self.since[near])
        count = np.searchsorted(times, self.until[near]) - first
        counts = count > 0
        return near[counts], first[counts], count[counts]

    def share(self, times: FloatArray) -> FloatArray:
        """How much of each is over at times (n, ...) [s], from 0 to 1."""
        shape = -1, *(1 for _ in times.shape[1:])
        start, end = self.start.reshape(shape), self.end.reshape(shape)
        return np.clip((times - start) / (end - start), 0.0, 1.0)


class _Pieces:
    """A table, and which of its rows counts when."""

    def __init__(self, table: PieceTable) -> None:
        self.table = table
        self.column = np.repeat(np.arange(table.drones.size), np.diff(table.first))
        """Place of each row's drone among the table's, shape (rows,)."""
        # A drone's first row counts before its start, its last one after its end.
        since = table.start.copy()
        since[table.first[:-1]] = -np.inf
        until = np.append(table.start[1:], np.inf)
        until[table.first[1:] - 1] = np.inf
        intervals = _Intervals(table.start, table.end, since, until)
        kind, count = _kinds(intervals)
        order = np.argsort(kind, kind="stable")
        many = np.flatnonzero(count >= _MANY)
        last = np.cumsum(count)[many]
        self.rows = [
            order[a:b]
            for a, b in zip((last - count[many]).tolist(), last.tolist(), strict=True)
        ]
        """Rows of each interval that many drones share."""
        self.shared = intervals.part(order[last - 1])
        self.single = np.flatnonzero(count[kind] < _MANY)
        """All other rows."""
        self.own = intervals.part(self.single)

    def fill(self, times: FloatArray, result: FloatArray, columns: IntArray) -> None:
        """Put state and control at times (n,) of the segment [s], rising, in a table.

        ``result`` has the shape (16, n, any); ``columns`` are those of the table's
        drones in it.
        """
        self._fill_shared(times, result, columns)
        self._fill_single(times, result, columns)

    def _fill_shared(
        self, times: FloatArray, result: FloatArray, columns: IntArray
    ) -> None:
        """Evaluate with one product what flies in one interval."""
        chosen, first, count = self.shared.instants(times)
        # The instants of all intervals, one interval after the other.
        last = np.cumsum(count)
        instant = np.arange(count.sum()) + np.repeat(first - (last - count), count)
        share = self.shared.part(np.repeat(chosen, count)).share(times[instant])
        for part, coefficients in self._parts():
            weights = basis(coefficients.shape[1] - 1, share)
            for number, begin, some, end in zip(
                chosen.tolist(),
                first.tolist(),
                count.tolist(),
                last.tolist(),
                strict=True,
            ):
                rows = self.rows[number]
                hull = coefficients[rows].transpose(1, 2, 0)
                values = weights[end - some : end] @ hull.reshape(hull.shape[0], -1)
                values = values.reshape(some, -1, rows.size).swapaxes(0, 1)
                place = columns[self.column[rows]]
                result[part, begin : begin + some, place] = values

    def _fill_single(
        self, times: FloatArray, result: FloatArray, columns: IntArray
    ) -> None:
        chosen, first, counts = self.own.instants(times)
        # Rows with the same number of instants are evaluated together.
        for count in np.unique(counts).tolist():
            some = chosen[counts == count]
            row = self.single[some]
            instant = first[counts == count][:, None] + np.arange(count)
            share = self.own.part(some).share(times[instant])
            place = columns[self.column[row, None]]
            for part, coefficients in self._parts():
                weights = basis(coefficients.shape[1] - 1, share)
                values = np.matmul(weights, coefficients[row])
                result[part, instant, place] = np.moveaxis(values, -1, 0)

    def _parts(self) -> tuple[tuple[slice, FloatArray], tuple[slice, FloatArray]]:
        """Rows of a result, and the coefficients that belong there."""
        return (slice(0, 12), self.table.state), (slice(12, 16), self.table.control)


def _kinds(intervals: _Intervals) -> tuple[IntArray, IntArray]:
    """Kind of each interval, from 0, shape (n,), and how many there are of each.

    Those that are of one kind are equal in all their times.
    """
    kind = np.zeros(intervals.start.size, dtype=np.int64)
    for times in intervals:
        _, other = np.unique(times, return_inverse=True)
        _, kind, count = np.unique(
            kind * (int(other.max(initial=0)) + 1) + other,
            return_inverse=True,
            return_counts=True,
        )
    return kind, count


def evaluate(table: PieceTable, times: FloatArray) -> FloatArray:
    """State and control (16, n, drones of the table) at times (n,) of a segment [s].

    Times rise; at the joint of two mesh intervals the later one counts.
    """
    count = table.drones.size
    result = np.empty((16, times.size, count))
    _Pieces(table).fill(times, result, np.arange(count))
    return result
