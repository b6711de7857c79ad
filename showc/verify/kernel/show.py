"""What the log says of the show, as numbers, and what a proof hands over.

Nothing here is computed by showc's planner: rules, segments and polynomials are read
from the file's bytes. Positions are in the show frame, units are SI.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from showc.verify.kernel.bernstein import elevate

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log.showc_pb2 import Rules, Vector3
    from showc.log.showc_pb2 import Segment as SegmentMessage

WIDTHS = 12, 4  # of a state: position, velocity, attitude, rates; of a control

LARGEST = 1e9
"""Greatest number that a show can hold (SI): beyond it products leave float64."""


def xyz(vector: Vector3) -> FloatArray:
    """Return the components of a logged vector, shape (3,)."""
    return np.array([vector.x, vector.y, vector.z])


@dataclass(frozen=True, slots=True, eq=False)
class PieceTable:
    """Polynomials of a fleet over one segment, all of the same two degrees.

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

    @classmethod
    def joined(cls, tables: Sequence[PieceTable]) -> PieceTable:
        """Join tables; those of lower degrees are written in the greatest ones.

        That is exact to a few roundings a degree, at ends of intervals to the bit.
        """
        names = "drones", "start", "end"
        columns = [np.concatenate([getattr(one, x) for one in tables]) for x in names]
        counts = np.concatenate([np.diff(one.first) for one in tables])
        first = np.append(0, np.cumsum(counts))
        for parts in ([one.state for one in tables], [one.control for one in tables]):
            degree, end = max(part.shape[1] for part in parts) - 1, 0
            whole = np.empty((first[-1], degree + 1, parts[0].shape[2]))
            for part in parts:
                end += len(part)
                whole[end - len(part) : end] = elevate(part, degree)
            columns.append(whole)
        return cls(columns[0], first, *columns[1:])

    @property
    def owner(self) -> IntArray:
        """Drone of each row, shape (rows,)."""
        return np.repeat(self.drones, np.diff(self.first))

    def slope(self, curves: FloatArray) -> FloatArray:
        """Coefficients of the derivatives of curves (rows, degree + 1, m)."""
        degree, width = curves.shape[1] - 1, (self.end - self.start)[:, None, None]
        # Where they are constant, there is no coefficient left.
        return degree * np.diff(curves, axis=1) / width if degree else 0.0 * curves

    def chosen(self, rows: BoolArray | slice) -> PieceTable:
        """Return the table of those rows (rows,) alone."""
        drones, first = np.unique(self.owner[rows], return_index=True)
        columns = self.start, self.end, self.state, self.control
        start, *others = (column[rows] for column in columns)
        return PieceTable(drones, np.append(first, start.size), start, *others)

    def parts(self, rows: int) -> Iterator[PieceTable]:
        """Cut into tables of whole drones with about ``rows`` rows each."""
        begin = 0
        while begin < self.drones.size:
            end = int(np.searchsorted(self.first, self.first[begin] + rows, "right"))
            end = min(max(end - 1, begin + 1), self.drones.size)
            yield self.chosen(slice(int(self.first[begin]), int(self.first[end])))
            begin = end


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """One leg of the show: what the whole fleet flies in it."""

    message: SegmentMessage  # as logged
    table: PieceTable
    """Every drone is in it; flights of lower degrees are written in the greatest."""
    goals: FloatArray  # where each drone must end, shape (drones, 3) [m]

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
        """States of the fleet at its start and at its end, each (drones, 12)."""
        state, first = self.table.state, self.table.first
        return state[first[:-1], 0], state[first[1:] - 1, -1]


@dataclass(frozen=True, slots=True, eq=False)
class LoggedShow:
    """Everything of the log except its samples."""

    rules: Rules  # as logged
    segments: tuple[Segment, ...]  # in order of their index
    epoch: int  # time stamp of show time zero [ns]

    @property
    def drones(self) -> int:
        """Size of the fleet."""
        return int(self.rules.drones)

    @property
    def duration(self) -> float:
        """Time of the whole show [s]."""
        return float(self.rules.duration)


@dataclass(frozen=True, slots=True)
class Statement:
    """A theorem about one show."""

    code: str
    """``VRF3`` and two digits; ``showc explain`` says what it means."""
    holds: bool | None
    """Whether it is proved; None: there is nothing to prove, ``notes`` say why."""
    value: float | None = None
    """The worst that is possible, error bound included, in ``unit``."""
    limit: float | None = None
    """What was allowed, in ``unit``."""
    unit: str = ""
    drones: tuple[int, ...] = ()
    """Drone or pair of the value, counting from 0."""
    segment: str | None = None
    """Name of what is under way then."""
    time: float | None = None
    """Show time of the value [s]."""
    notes: tuple[str, ...] = ()
    """Tolerances, error bounds, further findings."""


class Seen(NamedTuple):
    """What is found of some drones at some time of a segment."""

    segment: str
    time: FloatArray | float
    """One show time, or one for each value [s]."""
    drones: IntArray
    values: FloatArray  # of the same shape


def worst(code: str, limit: float, unit: str, found: Iterable[Seen]) -> Statement:
    """State whether all values keep the limit, and which is the worst.

    What is undefined keeps no limit; where nothing is found, nothing is to be proved.
    """
    nothing = ("there is none",)
    stated, count = Statement(code, None, None, limit, unit, notes=nothing), 0
    for one in found:
        values = np.where(np.isnan(one.values), np.inf, one.values)
        count += int(np.sum(values > limit))
        top = float(values.max(initial=-np.inf))
        if top > (-np.inf if stated.value is None else stated.value):
            at = int(np.argmax(values))
            time = float(np.broadcast_to(one.time, values.shape)[at])
            facts = code, top <= limit, top, limit, unit
            stated = Statement(*facts, (int(one.drones[at]),), one.segment, time)
    notes = (f"{count:,} findings of this kind",) if count > 1 else ()
    return stated if stated.value is None else replace(stated, notes=notes)
