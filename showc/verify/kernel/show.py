"""What the log says of the show, as numbers: the input of every proof.

Nothing here is computed by showc's planner: rules, segments and polynomials are read
from the file's bytes. Positions are in the show frame, units are SI.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.log.showc_pb2 import Rules
    from showc.log.showc_pb2 import Segment as SegmentMessage


STATE_COMPONENTS = 12
CONTROL_COMPONENTS = 4

LARGEST = 1e9
"""Greatest number that a show can hold (SI): beyond it products leave float64."""


@dataclass(frozen=True, slots=True, eq=False)
class PieceTable:
    """Polynomials of some drones over one segment, all of the same two degrees.

    Row k is one mesh interval of one drone; the rows of a drone follow each other in
    time. ``first`` says where each drone's rows begin.
    """

    drones: IntArray
    """Drones, counting from 0, increasing, shape (n,)."""
    first: IntArray
    """First row of each drone, and the number of rows at the end, shape (n + 1,)."""
    start: FloatArray
    """Start of each row since the start of the segment, shape (rows,) [s]."""
    end: FloatArray
    """End of each row since the start of the segment, shape (rows,) [s]."""
    state: FloatArray
    """Bernstein coefficients, shape (rows, state degree + 1, 12)."""
    control: FloatArray
    """Bernstein coefficients, shape (rows, control degree + 1, 4)."""

    @property
    def owner(self) -> IntArray:
        """Drone of each row, shape (rows,)."""
        return np.repeat(self.drones, np.diff(self.first))

    def only(self, column: int) -> PieceTable:
        """Return the table of one of its drones, the ``column``-th."""
        return self._columns(column, column + 1)

    def parts(self, rows: int) -> Iterator[PieceTable]:
        """Cut into tables of whole drones with about ``rows`` rows each."""
        begin = 0
        while begin < self.drones.size:
            end = int(np.searchsorted(self.first, self.first[begin] + rows, "right"))
            end = min(max(end - 1, begin + 1), self.drones.size)
            yield self._columns(begin, end)
            begin = end

    def _columns(self, begin: int, end: int) -> PieceTable:
        rows = slice(int(self.first[begin]), int(self.first[end]))
        return PieceTable(
            self.drones[begin:end],
            self.first[begin : end + 1] - rows.start,
            self.start[rows],
            self.end[rows],
            self.state[rows],
            self.control[rows],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """One leg of the show with everything that flies in it."""

    message: SegmentMessage
    """As logged."""
    tables: tuple[PieceTable, ...]
    """Each of its drones is in exactly one of them."""
    drones: IntArray
    """All its drones, increasing, shape (n,)."""
    goals: FloatArray
    """Where each of ``drones`` must end, shape (n, 3) [m]."""

    @property
    def start(self) -> float:
        """Show time of its start [s]."""
        return float(self.message.start)

    @property
    def duration(self) -> float:
        """Its time [s]."""
        return float(self.message.duration)

    @property
    def end(self) -> float:
        """Show time of its end [s]."""
        return self.start + self.duration

    @property
    def holds(self) -> bool:
        """Whether its drones hover in place."""
        return bool(self.message.kind == self.message.HOLD)

    def ends(self) -> tuple[FloatArray, FloatArray]:
        """States at its start and at its end, each (n, 12), in order of ``drones``."""
        first = np.empty((self.drones.size, STATE_COMPONENTS))
        last = np.empty((self.drones.size, STATE_COMPONENTS))
        for table in self.tables:
            rows = np.searchsorted(self.drones, table.drones)
            first[rows] = table.state[table.first[:-1], 0]
            last[rows] = table.state[table.first[1:] - 1, -1]
        return first, last


@dataclass(frozen=True, slots=True, eq=False)
class LoggedShow:
    """Everything of the log except its samples."""

    rules: Rules
    """As logged."""
    segments: tuple[Segment, ...]
    """In order of their index."""
    epoch: int
    """Time stamp of show time zero [ns]."""

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return int(self.rules.drones)

    @property
    def duration(self) -> float:
        """Time of the whole show [s]."""
        return float(self.rules.duration)
