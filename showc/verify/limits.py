"""Every limit at every instant: greatest values of polynomials, enclosed.

Each limit is an upper bound on a linear function of state and control, so on every
mesh interval it concerns one polynomial. The greatest value of all these polynomials is
enclosed by branch and bound: coefficients bound from above, values at interval ends
from below, and intervals that could still hold the greatest value are halved. No
sampling takes part in the proof.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.bernstein import halves
from showc.verify.kernel.dynamics import allocation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.log.showc_pb2 import Limits, Rules, Vector3
    from showc.verify.kernel.show import PieceTable, Segment

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

RESOLUTION = 1e-9
"""Width of the enclosure at which halving stops, as a fraction of the limit's range."""

TOLERANCE = 1e-6
"""How far a limit may be exceeded, as a fraction of its range: rounding, not flight."""

_ROUNDS = 60

_AT_ONCE = 500
"""Mesh intervals looked at together."""


@dataclass(frozen=True, slots=True)
class Bound:
    """One limit: ``sign`` times one quantity <= ``top``."""

    quantity: str
    """Family it is reported under."""
    name: str
    """What exactly is limited."""
    component: int
    """Which of 12 states, 4 controls, 4 squared rotor speeds."""
    sign: float
    """1, or -1 where the quantity is bounded from below."""
    top: float
    """Greatest value allowed."""
    span: float
    """Range of allowed values: the yardstick of margin and tolerance."""
    unit: str
    """Unit of the value."""


@dataclass(frozen=True, slots=True)
class Extreme:
    """Greatest value of one limit over one segment, as an enclosure."""

    bound: Bound
    lower: float
    """Value that is reached."""
    upper: float
    """Value that is not exceeded at any instant."""
    drone: int
    """Where ``lower`` is reached, counting from 0."""
    time: float
    """When, since the start of the segment [s]."""

    @property
    def margin(self) -> float:
        """What is left to the limit in the worst case, as a fraction of the range."""
        return (self.bound.top - self.upper) / self.bound.span


def _xyz(vector: Vector3) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def bounds(rules: Rules, limits: Limits) -> list[Bound]:
    """Return all limits of a segment.

    Position keeps the segment's volume and the site's; rotor speeds keep rest and full
    speed, as squared speeds over the greatest squared speed.
    """
    found: list[Bound] = []

    def both(  # noqa: PLR0917 - a line of a table
        quantity: str, name: str, component: int, low: float, top: float, unit: str
    ) -> None:
        span = top - low
        scale = span if span > 0.0 else max(abs(top), 1.0)
        found.append(
            Bound(quantity, f"greatest {name}", component, 1.0, top, scale, unit)
        )
        found.append(
            Bound(quantity, f"least {name}", component, -1.0, -low, scale, unit)
        )

    site = rules.site
    low = np.maximum(_xyz(limits.position_min), _xyz(site.volume_min))
    top = np.minimum(_xyz(limits.position_max), _xyz(site.volume_max))
    for axis, name in enumerate("xyz"):
        both("volume", name, axis, float(low[axis]), float(top[axis]), "m")
    pairs = zip(_xyz(limits.velocity_min), _xyz(limits.velocity_max), strict=True)
    for axis, (low_speed, top_speed) in enumerate(pairs):
        name = ("vx", "vy", "vz")[axis]
        both("velocity", name, 3 + axis, low_speed, top_speed, "m/s")
    for axis, name in enumerate(("roll", "pitch")):
        both("tilt", name, 6 + axis, -limits.tilt, limits.tilt, "rad")
    for axis, (name, top_rate) in enumerate(
        zip("pqr", _xyz(limits.body_rate), strict=True)
    ):
        both("body rates", name, 9 + axis, -top_rate, top_rate, "rad/s")
    both("thrust", "U1", 12, limits.thrust_min, limits.thrust_max, "N")
    for axis, (name, torque) in enumerate(
        zip(("U2", "U3", "U4"), _xyz(limits.torque_max), strict=True)
    ):
        both("torques", name, 13 + axis, -torque, torque, "N m")
    for rotor in range(4):
        name = f"rotor {rotor + 1} (squared)"
        both("rotor speeds", name, 16 + rotor, 0.0, 1.0, "")
    return found


def rotor_shares(rules: Rules) -> FloatArray:
    """Return the matrix (4, 4) from control to squared speeds, full speed being 1."""
    vehicle = rules.vehicle
    return np.asarray(np.linalg.inv(allocation(vehicle)) / vehicle.rotor_speed_max**2)


def extremes(segment: Segment, rules: Rules) -> list[Extreme]:
    """Enclose the greatest value of every limit over a segment.

    Returns
    -------
    list of Extreme
        One for each of :func:`bounds`; ``upper - lower`` is at most ``RESOLUTION`` of
        the range.
    """
    wanted = bounds(rules, rules.limits[segment.message.limits])
    best: list[Extreme | None] = [None] * len(wanted)
    for table in segment.tables:
        hulls = _Hulls.of(table, rotor_shares(rules))
        for column, bound in enumerate(wanted):
            found = _greatest(hulls, bound)
            before = best[column]
            if before is None:
                best[column] = found
            else:
                upper = max(found.upper, before.upper)
                inner = found if found.lower > before.lower else before
                best[column] = Extreme(
                    bound, inner.lower, upper, inner.drone, inner.time
                )
    return [extreme for extreme in best if extreme is not None]


@dataclass(frozen=True, slots=True, eq=False)
class _Hulls:
    """Ranges of all limited quantities of a table, found in one pass."""

    table: PieceTable
    rotors: FloatArray
    """Squared rotor speeds, coefficients, shape (rows, degree + 1, 4)."""
    top: FloatArray
    """Greatest coefficient of each of 20 quantities, shape (20, rows)."""
    low: FloatArray
    """Least coefficient, shape (20, rows)."""
    begin: FloatArray
    """Value at the start of each row, shape (20, rows)."""
    end: FloatArray
    """Value at its end, shape (20, rows)."""

    @classmethod
    def of(cls, table: PieceTable, rotors: FloatArray) -> _Hulls:
        """Go through the coefficients of a table once."""
        speeds = table.control @ rotors.T
        sources = table.state, table.control, speeds
        count = sum(source.shape[2] for source in sources)
        top, low, begin, end = np.empty((4, count, table.start.size))
        first = 0
        for source in sources:
            part = slice(first, first + source.shape[2])
            first = part.stop
            for row in range(0, source.shape[0], _AT_ONCE):
                rows = slice(row, row + _AT_ONCE)
                # With all rows of a coefficient side by side, in the processor's cache.
                some = np.ascontiguousarray(source[rows].transpose(1, 2, 0))
                some.max(axis=0, out=top[part, rows])
                some.min(axis=0, out=low[part, rows])
                begin[part, rows], end[part, rows] = some[0], some[-1]
        return cls(table, speeds, top, low, begin, end)

    def coefficients(self, quantity: int, rows: NDArray[np.bool_]) -> FloatArray:
        """Coefficients (n, degree + 1) of one quantity on some rows."""
        states, controls = self.table.state.shape[2], self.table.control.shape[2]
        if quantity < states:
            return self.table.state[rows, :, quantity]
        if quantity < states + controls:
            return self.table.control[rows, :, quantity - states]
        return self.rotors[rows, :, quantity - states - controls]


def _greatest(hulls: _Hulls, bound: Bound) -> Extreme:
    number, sign = bound.component, bound.sign
    # The greatest of -x is minus the least x.
    hull = hulls.top[number] if sign > 0.0 else -hulls.low[number]
    first, last = sign * hulls.begin[number], sign * hulls.end[number]
    table = hulls.table
    resolution = RESOLUTION * bound.span
    reached = np.maximum(first, last)
    where = int(np.argmax(reached))
    lower, moment = float(reached[where]), float(last[where] > first[where])
    open_ = hull > lower + resolution
    # What is closed here cannot exceed the greatest value by more than this.
    upper = float(np.max(hull[~open_], initial=-np.inf))
    work = sign * hulls.coefficients(number, open_)
    row = np.flatnonzero(open_)
    begin, length = np.zeros(row.size), np.ones(row.size)
    for _ in range(_ROUNDS):
        if row.size == 0:
            break
        left, right = halves(work)
        half = 0.5 * length
        row = np.tile(row, 2)
        begin = np.concatenate([begin, begin + half])
        length = np.tile(half, 2)
        work = np.concatenate([left, right])
        reached = np.maximum(work[:, 0], work[:, -1])
        best = int(np.argmax(reached))
        if reached[best] > lower:
            lower = float(reached[best])
            where = int(row[best])
            late = work[best, -1] > work[best, 0]
            moment = float(begin[best] + late * length[best])
        hull = work.max(axis=1)
        open_ = hull > lower + resolution
        upper = max(upper, float(np.max(hull[~open_], initial=-np.inf)))
        work, row = work[open_], row[open_]
        begin, length = begin[open_], length[open_]
    else:
        upper = max(upper, float(work.max(initial=-np.inf)))
    start, end = table.start[where], table.end[where]
    return Extreme(
        bound,
        lower,
        max(lower, upper),
        int(table.owner[where]),
        float(start + moment * (end - start)),
    )
