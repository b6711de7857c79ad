"""Every limit at every instant: greatest values of polynomials, enclosed.

**Theorem.** At no instant of a segment does a quantity of the logged polynomials exceed
:attr:`Extreme.upper`; the flown quantity (see :mod:`showc.verify.kernel.dynamics`) does
not exceed that by more than the tube's radius.

Proof. Each limit is an upper bound on a polynomial q on each mesh interval: a state, a
control, a squared rotor speed, a slope of the velocity, or the sum of the squares of
two. On an interval q lies between its least and its greatest Bernstein coefficient, and
the first and the last are values that it takes (Farouki 2012, The Bernstein polynomial
basis: a centennial retrospective, section 4). So the greatest value of all is at most
the greatest coefficient, at least the greatest end; intervals that could hold more than
the greatest end so far are halved, until both are :data:`RESOLUTION` apart.

*Rounding.* Halving takes one addition for each coefficient and degree, differences and
products not more than 100: with :data:`GAMMA` of the greatest coefficient everything
here is covered (Higham 2002, section 3.1).

*Accelerations* are the slopes of the logged velocities. As the flown velocities stay
within 0.5 mm/s of these, the flown mean acceleration over any 0.1 s differs from the
mean of the slope by at most 1 cm/s².
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.bernstein import MOST, halves, square_sum
from showc.verify.kernel.dynamics import GAMMA, TOLERANCES, rotor_shares
from showc.verify.kernel.statement import Statement

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.arrays import FloatArray
    from showc.log.showc_pb2 import Limits, Rules, Vector3
    from showc.verify.kernel.dynamics import Tube
    from showc.verify.kernel.show import LoggedShow, PieceTable, Segment


RESOLUTION = 1e-9
"""Width of the enclosure at which halving stops, as a fraction of the limit's range."""

TOLERANCE = 1e-6
"""How far polynomials may exceed a limit, as a fraction of its range: what a solver
calls equal. What is flown may exceed it by the tolerance of its tie besides."""

_ROUNDS = 60

FAMILIES = {
    "volume": "VRF311",
    "velocity": "VRF312",
    "tilt": "VRF313",
    "body rates": "VRF314",
    "thrust": "VRF315",
    "torques": "VRF316",
    "rotor speeds": "VRF317",
    "accelerations": "VRF318",
}
"""Code of each family of limits."""

_STATES = ("x", "y", "z", "vx", "vy", "vz", "roll", "pitch", "yaw", "p", "q", "r")


@dataclass(frozen=True, slots=True)
class Bound:
    """One limit: ``sign`` times one quantity <= ``top``."""

    family: str
    """Key of ``FAMILIES``."""
    name: str
    """What exactly is limited."""
    quantity: str
    """Which of :class:`_Quantities`."""
    sign: float
    """1, or -1 where the quantity is bounded from below."""
    top: float
    """Greatest value allowed; of a sum of squares, of its root."""
    span: float
    """Range of allowed values: the yardstick of margin and tolerance."""
    unit: str
    """Unit of the value."""
    states: tuple[int, ...] = ()
    """States whose flown values may differ from the logged ones."""
    squared: bool = False
    """Whether the quantity is a sum of squares, and its root is limited."""


@dataclass(frozen=True, slots=True)
class Extreme:
    """Greatest value of one limit over one segment, as an enclosure."""

    bound: Bound
    lower: float
    """Value that is reached, but for rounding."""
    upper: float
    """Value that is not exceeded at any instant, rounding included."""
    drone: int
    """Where ``lower`` is reached, counting from 0."""
    time: float
    """When, since the start of the segment [s]."""

    @property
    def margin(self) -> float:
        """What is left to the limit in the worst case, as a fraction of the range."""
        bound, value = self.bound, self.upper
        if bound.squared:
            value = float(np.sqrt(max(value, 0.0)))
        return (bound.top - value) / bound.span


def _xyz(vector: Vector3) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def bounds(rules: Rules, limits: Limits) -> list[Bound]:
    """Return all limits of a segment.

    Position keeps the segment's volume and the site's; rotor speeds keep rest and full
    speed, as squared speeds over the greatest squared speed.
    """
    site = rules.site
    low = np.maximum(_xyz(limits.position_min), _xyz(site.volume_min)).tolist()
    top = np.minimum(_xyz(limits.position_max), _xyz(site.volume_max)).tolist()
    slow, fast = _xyz(limits.velocity_min), _xyz(limits.velocity_max)
    rate, torque = _xyz(limits.body_rate), _xyz(limits.torque_max)
    found: list[Bound] = []
    for axis in range(3):
        found += _both("volume", axis, low[axis], top[axis], "m")
    for axis in range(3):
        found += _both("velocity", 3 + axis, slow[axis], fast[axis], "m/s")
    for axis in range(2):
        found += _both("tilt", 6 + axis, -limits.tilt, limits.tilt, "rad")
    for axis in range(3):
        found += _both("body rates", 9 + axis, -rate[axis], rate[axis], "rad/s")
    found += _both("thrust", "U1", limits.thrust_min, limits.thrust_max, "N")
    for axis in range(3):
        name = f"U{axis + 2}"
        found += _both("torques", name, -torque[axis], torque[axis], "N m")
    for rotor in range(4):
        found += _both("rotor speeds", f"rotor {rotor + 1} (squared)", 0.0, 1.0, "")
    found += _further(limits)
    return found


def _both(
    family: str, quantity: str | int, low: float, top: float, unit: str
) -> list[Bound]:
    name = quantity if isinstance(quantity, str) else _STATES[quantity]
    states = () if isinstance(quantity, str) else (quantity,)
    span = top - low if top > low else max(abs(top), 1.0)
    return [
        Bound(family, f"greatest {name}", name, 1.0, top, span, unit, states),
        Bound(family, f"least {name}", name, -1.0, -low, span, unit, states),
    ]


def _further(limits: Limits) -> Iterator[Bound]:
    """Limits that are there only if they are not 0."""
    for name, family, unit, top, states in (
        ("level speed", "velocity", "m/s", limits.level_speed, (3, 4)),
        ("level acceleration", "accelerations", "m/s²", limits.acceleration, ()),
    ):
        if top > 0.0:
            square = top**2
            yield Bound(
                family,
                f"greatest {name}",
                name,
                1.0,
                square,
                square,
                unit,
                states,
                True,
            )
    for sign, name, top in (
        (1.0, "greatest az", limits.acceleration_up),
        (-1.0, "least az", limits.acceleration_down),
    ):
        if top > 0.0:
            yield Bound("accelerations", name, "az", sign, top, top, "m/s²")


class _Quantities:
    """Coefficients of everything that is limited, of one table: (degree + 1, rows)."""

    def __init__(self, table: PieceTable, rules: Rules) -> None:
        self.table = table
        self._state = np.ascontiguousarray(table.state.transpose(1, 2, 0))
        self._control = np.ascontiguousarray(table.control.transpose(1, 2, 0))
        self._shares = rotor_shares(rules.vehicle)

    def __call__(self, name: str) -> FloatArray:
        """Coefficients of one quantity."""
        if name in _STATES:
            return self._state[:, _STATES.index(name)]
        if name.startswith("U"):
            return self._control[:, int(name[1]) - 1]
        if name.startswith("rotor"):
            share = self._shares[int(name.split()[1]) - 1]
            return np.asarray(np.tensordot(self._control, share, axes=(1, 0)))
        if name == "az":
            return self._slope([5])[:, 0]
        part = self._state[:, 3:5] if name == "level speed" else self._slope([3, 4])
        return square_sum(np.ascontiguousarray(part.transpose(2, 0, 1))).T

    def _slope(self, states: list[int]) -> FloatArray:
        degree = self._state.shape[0] - 1
        if degree == 0:
            return np.zeros((1, len(states), self._state.shape[2]))
        width = self.table.end - self.table.start
        return np.asarray(degree * np.diff(self._state[:, states], axis=0) / width)


def extremes(segment: Segment, rules: Rules) -> list[Extreme]:
    """Enclose the greatest value of every limit over a segment.

    Returns
    -------
    list of Extreme
        One for each of :func:`bounds`.
    """
    wanted = bounds(rules, rules.limits[segment.message.limits])
    tables = [_Quantities(table, rules) for table in segment.tables]
    return [_over([_greatest(table, bound) for table in tables]) for bound in wanted]


def _over(found: Sequence[Extreme]) -> Extreme:
    inner = max(found, key=lambda one: one.lower)
    upper = max(one.upper for one in found)
    return Extreme(inner.bound, inner.lower, upper, inner.drone, inner.time)


def _greatest(quantities: _Quantities, bound: Bound) -> Extreme:
    """Branch and bound over all rows of a table."""
    table = quantities.table
    work = bound.sign * quantities(bound.quantity)
    rounding = GAMMA * float(np.abs(work).max())
    if not np.isfinite(rounding):
        return Extreme(bound, np.inf, np.inf, int(table.drones[0]), 0.0)
    resolution = RESOLUTION * (bound.span**2 if bound.squared else bound.span)
    row = np.arange(work.shape[1])
    begin, length = np.zeros(row.size), np.ones(row.size)
    lower, upper, where, moment = -np.inf, -np.inf, 0, 0.0
    for _ in range(_ROUNDS):
        reached = np.maximum(work[0], work[-1])
        best = int(np.argmax(reached))
        if reached[best] > lower:
            lower, where = float(reached[best]), int(row[best])
            late = work[-1, best] > work[0, best]
            moment = float(begin[best] + late * length[best])
        hull = work.max(axis=0)
        open_ = hull > lower + resolution
        upper = max(upper, float(np.max(hull[~open_], initial=-np.inf)))
        if not open_.any():
            break
        if np.count_nonzero(open_) > MOST:
            upper = np.inf
            break
        left, right = halves(work[:, open_].T)
        half = 0.5 * length[open_]
        row = np.tile(row[open_], 2)
        begin = np.concatenate([begin[open_], begin[open_] + half])
        length = np.tile(half, 2)
        work = np.concatenate([left, right]).T
    else:
        upper = max(upper, float(work.max()))
    start, end = table.start[where], table.end[where]
    return Extreme(
        bound,
        lower,
        max(lower, upper) + rounding,
        int(table.owner[where]),
        float(start + moment * (end - start)),
    )


def kept(
    show: LoggedShow, tubes: Sequence[Tube], found: Sequence[Sequence[Extreme]]
) -> list[Statement]:
    """State of each family of limits which one is kept most narrowly.

    Parameters
    ----------
    tubes, found
        One for each segment of the show.
    """
    tightest: dict[str, tuple[Extreme, Segment, Tube]] = {}
    for segment, tube, some in zip(show.segments, tubes, found, strict=True):
        for extreme in some:
            family = extreme.bound.family
            before = tightest.get(family)
            if before is None or not extreme.margin >= before[0].margin:
                tightest[family] = extreme, segment, tube
    return [_statement(*tightest[name]) for name in FAMILIES if name in tightest]


def _statement(extreme: Extreme, segment: Segment, tube: Tube) -> Statement:
    bound, states = extreme.bound, list(extreme.bound.states)
    radius = float(np.linalg.norm(tube.radius[:, states].max(axis=0)))
    allowed = float(np.linalg.norm(TOLERANCES[states]))
    note = (
        f"{bound.name}: margin {extreme.margin:+.3%} of the range (tolerance "
        f"{TOLERANCE:.0e} of it)"
    )
    if states:
        note += (
            f"; flown within {radius:.1e} {bound.unit} of it ({allowed:.1e} allowed)"
        )
    value = bound.top - extreme.margin * bound.span + min(radius, allowed)
    return Statement(
        FAMILIES[bound.family],
        f"{bound.family} within limits at every instant",
        extreme.margin >= -TOLERANCE and radius <= allowed,
        bound.sign * value + 0.0,
        bound.sign * bound.top + 0.0,
        bound.unit,
        (extreme.drone,),
        segment.message.name,
        segment.start + extreme.time,
        (note,),
    )
