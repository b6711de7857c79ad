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

from showc.verify.bernstein import halves
from showc.verify.physics import allocation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.log.showc_pb2 import Limits, Rules, Vector3
    from showc.verify.show import PieceTable, Segment

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

RESOLUTION = 1e-9
"""Width of the enclosure at which halving stops, as a fraction of the limit's range."""

TOLERANCE = 1e-6
"""How far a limit may be exceeded, as a fraction of its range: rounding, not flight."""

_ROUNDS = 60


@dataclass(frozen=True, slots=True)
class Bound:
    """One limit: ``weights`` . (state, control) <= ``top``."""

    quantity: str
    """Family it is reported under."""
    name: str
    """What exactly is limited."""
    weights: FloatArray
    """Factors on the 12 states and 4 controls, shape (16,)."""
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
        quantity: str, name: str, weights: FloatArray, low: float, top: float, unit: str
    ) -> None:
        span = top - low
        scale = span if span > 0.0 else max(abs(top), 1.0)
        found.append(Bound(quantity, f"greatest {name}", weights, top, scale, unit))
        found.append(Bound(quantity, f"least {name}", -weights, -low, scale, unit))

    unit_vectors = np.eye(16)
    site = rules.site
    low = np.maximum(_xyz(limits.position_min), _xyz(site.volume_min))
    top = np.minimum(_xyz(limits.position_max), _xyz(site.volume_max))
    for axis, name in enumerate("xyz"):
        both("volume", name, unit_vectors[axis], low[axis], top[axis], "m")
    pairs = zip(_xyz(limits.velocity_min), _xyz(limits.velocity_max), strict=True)
    for axis, (low_speed, top_speed) in enumerate(pairs):
        name = ("vx", "vy", "vz")[axis]
        both("velocity", name, unit_vectors[3 + axis], low_speed, top_speed, "m/s")
    for axis, name in enumerate(("roll", "pitch")):
        both("tilt", name, unit_vectors[6 + axis], -limits.tilt, limits.tilt, "rad")
    for axis, (name, top_rate) in enumerate(
        zip("pqr", _xyz(limits.body_rate), strict=True)
    ):
        both("body rates", name, unit_vectors[9 + axis], -top_rate, top_rate, "rad/s")
    both("thrust", "U1", unit_vectors[12], limits.thrust_min, limits.thrust_max, "N")
    for axis, (name, torque) in enumerate(
        zip(("U2", "U3", "U4"), _xyz(limits.torque_max), strict=True)
    ):
        both("torques", name, unit_vectors[13 + axis], -torque, torque, "N m")
    inverse = (
        np.linalg.inv(allocation(rules.vehicle)) / rules.vehicle.rotor_speed_max**2
    )
    for rotor in range(4):
        weights = np.concatenate([np.zeros(12), inverse[rotor]])
        both("rotor speeds", f"rotor {rotor + 1} (squared)", weights, 0.0, 1.0, "")
    return found


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
        for column, bound in enumerate(wanted):
            found = _greatest(table, bound)
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


def _polynomials(table: PieceTable, bound: Bound) -> FloatArray:
    """Coefficients (rows, degree + 1) of the limited quantity."""
    if np.any(bound.weights[:12]):
        (component,) = np.flatnonzero(bound.weights)
        return np.asarray(bound.weights[component] * table.state[:, :, component])
    return np.asarray(table.control @ bound.weights[12:])


def _greatest(table: PieceTable, bound: Bound) -> Extreme:
    work = _polynomials(table, bound)
    row = np.arange(work.shape[0])
    begin, length = np.zeros(row.size), np.ones(row.size)
    lower, upper = -np.inf, -np.inf
    where, moment = 0, 0.0
    resolution = RESOLUTION * bound.span
    for _ in range(_ROUNDS):
        reached = np.maximum(work[:, 0], work[:, -1])
        best = int(np.argmax(reached))
        if reached[best] > lower:
            lower = float(reached[best])
            where = int(row[best])
            late = work[best, -1] > work[best, 0]
            moment = float(begin[best] + late * length[best])
        hull = work.max(axis=1)
        open_ = hull > lower + resolution
        # What is closed here cannot exceed the greatest value by more than this.
        upper = max(upper, float(np.max(hull[~open_], initial=-np.inf)))
        if not open_.any():
            break
        left, right = halves(work[open_])
        half = 0.5 * length[open_]
        row = np.tile(row[open_], 2)
        begin = np.concatenate([begin[open_], begin[open_] + half])
        length = np.tile(half, 2)
        work = np.concatenate([left, right])
    else:
        upper = max(upper, float(work.max()))
    start, end = table.start[where], table.end[where]
    return Extreme(
        bound,
        lower,
        max(lower, upper),
        int(table.owner[where]),
        float(start + moment * (end - start)),
    )
