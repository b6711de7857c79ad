"""State and control of the whole fleet at given times, from the logged polynomials."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.bernstein import basis

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.verify.kernel.show import LoggedShow, PieceTable


_AT_ONCE = 4096
"""Places on polynomials that are evaluated together; bounds the memory."""


def flown(show: LoggedShow, times: FloatArray) -> FloatArray:
    """State and control (16, n, drones) at show times (n,) [s].

    At the joint of two segments the later one counts; before the first one a drone is
    as at its start, after the last one as at its end.
    """
    result = np.empty((16, times.size, show.drones))
    starts = np.array([segment.start for segment in show.segments])
    number = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
    for chosen in np.unique(number).tolist():
        at = np.flatnonzero(number == chosen)
        for table in show.segments[chosen].tables:
            found = evaluate(table, times[at] - starts[chosen])
            result[:, at[:, None], table.drones] = found
    return result


def evaluate(table: PieceTable, times: FloatArray) -> FloatArray:
    """State and control (16, n, drones of the table) at times (n,) of a segment [s].

    At the joint of two mesh intervals the later one counts.
    """
    drones = np.arange(table.drones.size)
    result = np.empty((16, times.size, drones.size))
    # Times rise along a drone's rows; an offset for each makes them rise over all.
    far = 2.0 * (float(table.end.max()) + float(np.abs(times).max(initial=0.0)) + 1.0)
    keys = table.start + far * np.repeat(drones, np.diff(table.first))
    step = max(1, _AT_ONCE // drones.size)
    for begin in range(0, times.size, step):
        part = times[begin : begin + step, None]
        row = np.searchsorted(keys, part + far * drones, side="right") - 1
        row = np.clip(row, table.first[:-1], table.first[1:] - 1)
        start, end = table.start[row], table.end[row]
        share = np.clip((part - start) / (end - start), 0.0, 1.0)
        for some, coefficients in (
            (slice(0, 12), table.state),
            (slice(12, 16), table.control),
        ):
            weights = basis(coefficients.shape[1] - 1, share)[:, :, None]
            values = np.matmul(weights, coefficients[row])[:, :, 0]
            result[some, begin : begin + step] = np.moveaxis(values, -1, 0)
    return result
