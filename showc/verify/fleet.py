"""State and control of the whole fleet at given times, from the logged polynomials."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.bernstein import basis

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.verify.show import LoggedShow, PieceTable

    FloatArray = NDArray[np.float64]

_TIMES = 32
"""Instants evaluated together; bounds the memory."""


class Fleet:
    """Evaluates a show; at the joint of two segments the later one counts."""

    def __init__(self, show: LoggedShow) -> None:
        self._segments = sorted(show.segments, key=lambda one: one.start)
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
            for table in segment.tables:
                if ended and not np.any(last[table.drones] == number):
                    continue
                here = times >= segment.start
                moment = np.minimum(times[here] - segment.start, segment.duration)
                result[np.ix_(here, table.drones)] = evaluate(table, moment)


def evaluate(table: PieceTable, times: FloatArray) -> FloatArray:
    """State and control (n, drones of the table, 16) at times (n,) of a segment [s]."""
    count = table.drones.size
    if table.start.size == count:
        # One interval each, holds above all: no search.
        row = np.broadcast_to(np.arange(count), (times.size, count))
    else:
        span = 2.0 * (float(table.end.max()) + 1.0)
        owner = np.repeat(np.arange(count), np.diff(table.first))
        keys = table.start + owner * span
        wanted = times[:, None] + np.arange(count) * span
        row = np.searchsorted(keys, wanted.ravel(), side="right") - 1
        row = row.reshape(times.size, count)
        row = np.clip(row, table.first[:-1], table.first[1:] - 1)
    start = table.start[row]
    fraction = np.clip((times[:, None] - start) / (table.end[row] - start), 0.0, 1.0)
    result = np.empty((times.size, count, 16))
    for part, coefficients in (
        (slice(0, 12), table.state),
        (slice(12, 16), table.control),
    ):
        degree = coefficients.shape[1] - 1
        if degree == 0:
            result[..., part] = coefficients[row, 0]
            continue
        weights = basis(degree, fraction)
        chosen = coefficients[row]
        result[..., part] = np.matmul(weights[..., None, :], chosen)[..., 0, :]
    return result
