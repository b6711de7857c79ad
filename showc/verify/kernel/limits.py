"""Every limit at every instant: greatest values of polynomials, enclosed.

**Theorem.** At no instant of a segment does a quantity of the logged polynomials exceed
:attr:`Extreme.upper`; the flown quantity (see :mod:`showc.verify.kernel.dynamics`) does
not exceed that by more than its radius.

Proof. Each limit is an upper bound on a polynomial q on each mesh interval: a state, a
control, a squared rotor speed, a slope of the velocity, or the sum of the squares of
two. On an interval q lies between its least and its greatest Bernstein coefficient, and
the first and the last are values that it takes (Farouki 2012, The Bernstein polynomial
basis: a centennial retrospective, section 4). So the greatest value of all is at most
the greatest coefficient, at least the greatest end; halving brings both to
:data:`RESOLUTION` of each other (:func:`showc.verify.kernel.bernstein.least`).

*Rounding.* Halving takes one addition for each coefficient and degree, differences and
products not more than 100: with :data:`GAMMA` of the greatest coefficient everything
here is covered (Higham 2002, section 3.1).

*Accelerations* are the slopes of the logged velocities. As the flown velocities stay
within 0.5 mm/s of these, the flown mean acceleration over any 0.1 s differs from the
mean of the slope by at most 1 cm/s².

*Jerk* follows from thrust T and body rates: along the unit vector b of the thrust it is
T' / m, at right angles to it T |b'| / m. Roll and pitch turn b by sqrt(p² + q²) at
most, yaw by s |r|, s being the sine of the greatest lean, or 0 where yaw is held or r
is 0. As (a + s c)² <= (1 + s) (a² + s c²), the square of m |jerk| is at most T'² + (1 +
s) T² (p² + q² + s r²). Flown are this thrust, continuous by VRF334, and rates within
their radius R: (1 + s) T R / m more jerk at most. The fence is a theorem of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.kernel.bernstein import elevate, least, product, rows_last, square_sum
from showc.verify.kernel.dynamics import GAMMA, TOLERANCES, rotor_shares
from showc.verify.kernel.fence import RESOLUTION as TOUCHES
from showc.verify.kernel.fence import enclosed
from showc.verify.kernel.show import LoggedShow, PieceTable, Segment, Statement, xyz

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.log.showc_pb2 import Limits, Rules

RESOLUTION = 1e-9
"""Width of the enclosure at which halving stops, as a fraction of the limit's range."""

TOLERANCE = 1e-6
"""How far polynomials may exceed a limit, as a fraction of its range: what a solver
calls equal. What is flown may exceed it by the tolerance of its tie besides."""

FAMILIES = {
    "volume": "VRF311", "velocity": "VRF312", "tilt": "VRF313", "body rates": "VRF314",
    "thrust": "VRF315", "torques": "VRF316", "rotor speeds": "VRF317",
    "accelerations": "VRF318", "fence": "VRF319", "jerk": "VRF320",
}  # fmt: skip
"""Code of each family of limits."""

_STATES = ("x", "y", "z", "vx", "vy", "vz", "roll", "pitch", "yaw", "p", "q", "r")


@dataclass(frozen=True, slots=True)
class Bound:
    """One limit: ``sign`` times one quantity <= ``top``."""

    family: str
    """Key of ``FAMILIES``."""
    quantity: str
    """A state, a control, ``rotor`` and its number, ``level`` and what, ``az``,
    ``jerk``, or the ``distance`` to the fence."""
    sign: float
    """1, or -1 where the quantity is bounded from below."""
    top: float
    """Greatest value allowed; of a sum of squares, of its root."""
    span: float
    """Range of allowed values: the yardstick of margin and tolerance."""
    unit: str
    """Unit of the value."""

    @property
    def name(self) -> str:
        """What exactly is limited."""
        return f"{'greatest' if self.sign > 0.0 else 'least'} {self.quantity}"

    @property
    def squared(self) -> bool:
        """Whether the quantity is a sum of squares, and its root is limited."""
        return self.quantity.startswith("level ") or self.quantity == "jerk"

    @property
    def states(self) -> list[int]:
        """States whose flown values may differ from the logged ones."""
        known = {"distance to the fence": [0, 1], "level speed": [3, 4]}
        own = [number for number, one in enumerate(_STATES) if one == self.quantity]
        return known.get(self.quantity, own)


@dataclass(frozen=True, slots=True)
class Extreme:
    """Greatest value of one limit over one segment, as an enclosure."""

    bound: Bound
    lower: float  # value that is reached, but for rounding
    upper: float  # value that is not exceeded at any instant, rounding included
    drone: int  # where ``lower`` is reached, counting from 0
    time: float  # when, since the start of the segment [s]

    @property
    def margin(self) -> float:
        """What is left to the limit in the worst case, as a fraction of the range."""
        bound, value = self.bound, self.upper
        if bound.squared:
            value = float(np.sqrt(max(value, 0.0)))
        return (bound.top - value) / bound.span


def bounds(rules: Rules, limits: Limits) -> list[Bound]:
    """Return all limits of a segment.

    Position keeps the segment's volume and the site's; rotor speeds keep rest and full
    speed, as squared speeds over the greatest squared speed.
    """
    site = rules.site
    low = np.maximum(xyz(limits.position_min), xyz(site.volume_min)).tolist()
    top = np.minimum(xyz(limits.position_max), xyz(site.volume_max)).tolist()
    slow, fast = xyz(limits.velocity_min), xyz(limits.velocity_max)
    rate, torque, tilt = xyz(limits.body_rate), xyz(limits.torque_max), limits.tilt
    up, down = limits.acceleration_up, limits.acceleration_down
    ranges = [("thrust", "U1", limits.thrust_min, limits.thrust_max, "N")]
    for axis in range(3):
        ranges += [
            ("volume", _STATES[axis], low[axis], top[axis], "m"),
            ("velocity", _STATES[3 + axis], slow[axis], fast[axis], "m/s"),
            ("body rates", _STATES[9 + axis], -rate[axis], rate[axis], "rad/s"),
            ("torques", f"U{axis + 2}", -torque[axis], torque[axis], "N m"),
        ]
    ranges += [("tilt", angle, -tilt, tilt, "rad") for angle in ("roll", "pitch")]
    rotors = (f"rotor {number} (squared)" for number in (1, 2, 3, 4))
    ranges += [("rotor speeds", rotor, 0.0, 1.0, "") for rotor in rotors]
    found = []
    for family, quantity, least_, greatest, unit in ranges:
        span = greatest - least_ if greatest > least_ else max(abs(greatest), 1.0)
        for sign, top in ((1.0, greatest), (-1.0, -least_)):
            found.append(Bound(family, quantity, sign, top, span, unit))
    # Limits that are there only if they are not 0.
    further = (
        ("velocity", "level speed", 1.0, limits.level_speed, "m/s"),
        ("accelerations", "level acceleration", 1.0, limits.acceleration, "m/s²"),
        ("accelerations", "az", 1.0, up, "m/s²"),
        ("accelerations", "az", -1.0, down, "m/s²"),
        ("jerk", "jerk", 1.0, limits.jerk, "m/s³"),
    )
    found += [
        Bound(family, quantity, sign, most, most, unit)
        for family, quantity, sign, most, unit in further
        if most > 0.0
    ]
    return found


def _coefficients(table: PieceTable, rules: Rules, quantity: str) -> FloatArray:
    """Coefficients of what is limited, (rows, degree + 1)."""
    state, control = table.state, table.control
    if quantity in _STATES:
        return state[:, :, _STATES.index(quantity)]
    if quantity.startswith("U"):
        return control[:, :, int(quantity[1]) - 1]
    if quantity.startswith("rotor"):
        share = rotor_shares(rules.vehicle)[int(quantity.split()[1]) - 1]
        return np.asarray(sum(own * control[:, :, k] for k, own in enumerate(share)))
    if quantity == "level speed":
        return square_sum(state[:, :, 3:5])
    if quantity == "jerk":
        return _jerk_square(table, rules)
    slope = table.slope(state[:, :, 3:6])
    return slope[:, :, 2] if quantity == "az" else square_sum(slope[:, :, :2])


def _jerk_square(table: PieceTable, rules: Rules) -> FloatArray:
    """Coefficients of a bound on the squared jerk; see above."""
    thrust, rates = table.control[:, :, :1], table.state[:, :, 9:]
    tilt = np.abs(table.state[:, :, 6:8]).max(axis=(0, 1)).clip(max=np.pi / 2.0)
    turns = np.any(rates[:, :, 2:], axis=1, keepdims=True) & (not rules.yaw_held)
    sine = turns * np.sqrt(1.0 - np.prod(np.cos(tilt)) ** 2)
    weights = np.sqrt((1.0 + sine) * np.where([False, False, True], sine, 1.0))
    squares = square_sum(thrust), square_sum(weights * rates)
    turning = product(*(some[:, :, None] for some in squares))
    push = elevate(square_sum(table.slope(thrust))[:, :, None], turning.shape[1] - 1)
    return np.asarray((push[:, :, 0] + turning) / rules.vehicle.mass**2)


def extremes(segment: Segment, rules: Rules) -> list[Extreme]:
    """Enclose the greatest value of each of :func:`bounds` over a segment."""
    asked, table = bounds(rules, rules.limits[segment.message.limits]), segment.table
    # Rows last in memory: the least and greatest of each are then found far sooner.
    curves = (np.moveaxis(rows_last(x), -1, 0) for x in (table.state, table.control))
    table, found = replace(table, state=next(curves), control=next(curves)), []
    for quantity, some in groupby(asked, key=lambda bound: bound.quantity):
        own = _coefficients(table, rules, quantity)
        found += [_greatest(table, own, bound) for bound in some]
    fence = np.array(rules.site.fence).reshape(-1, 2)
    if fence.size:
        # On the fence itself nothing is left between inside and outside.
        least_ = max(rules.site.fence_margin, TOUCHES + TOLERANCE)
        bound = Bound("fence", "distance to the fence", -1.0, -least_, 1.0, "m")
        lower, row = enclosed(table.state[:, :, :2], fence)
        drone, time = int(table.owner[row]), float(table.start[row])
        found.append(Extreme(bound, -lower, -lower, drone, time))
    return found


def _greatest(table: PieceTable, curves: FloatArray, bound: Bound) -> Extreme:
    """Enclose a limit's quantity, ``curves`` (rows, degree + 1), over a table."""
    low, top = curves.min(axis=1), curves.max(axis=1)
    rounding = GAMMA * float(max(top.max(), -low.min()))
    if not np.isfinite(rounding):
        return Extreme(bound, np.inf, np.inf, int(table.drones[0]), 0.0)
    # All other rows stay below what one of these reaches at an end.
    tops = top if bound.sign > 0.0 else -low
    rows = np.flatnonzero(tops >= (bound.sign * curves[:, [0, -1]]).max())
    resolution = RESOLUTION * (bound.span**2 if bound.squared else bound.span)
    work = -bound.sign * curves[rows]
    found = least(work, lambda some: some.min(axis=1), np.asarray, resolution)
    row = rows[found.row]
    start, end, drone = table.start[row], table.end[row], int(table.owner[row])
    time = float(start + found.fraction * (end - start))
    return Extreme(bound, -found.upper, rounding - found.lower, drone, time)


def kept(
    show: LoggedShow, radii: Sequence[FloatArray], found: Sequence[Sequence[Extreme]]
) -> list[Statement]:
    """State of each family of limits which one is kept most narrowly.

    There is one of ``radii``, and one of ``found``, for each segment of the show.
    """
    tightest: dict[str, tuple[Extreme, Segment, FloatArray]] = {}
    for segment, radius, some in zip(show.segments, radii, found, strict=True):
        for extreme in some:
            family = extreme.bound.family
            before = tightest.get(family)
            if before is None or not extreme.margin >= before[0].margin:
                tightest[family] = extreme, segment, radius
    stated = [_statement(*tightest[name]) for name in FAMILIES if name in tightest]
    if "fence" not in tightest:
        note = "the script asks for no fence; the flight volume holds instead"
        stated.append(Statement(FAMILIES["fence"], None, notes=(note,)))
    return stated


def _statement(extreme: Extreme, segment: Segment, radii: FloatArray) -> Statement:
    bound, states = extreme.bound, extreme.bound.states
    radius = float(np.linalg.norm(radii[:, states].max(axis=0)))
    allowed = float(np.linalg.norm(TOLERANCES[states]))
    left, rest, unit = extreme.margin * bound.span, TOLERANCE * bound.span, bound.unit
    note = f"{bound.name}: {left:+.6g} {unit} are left (tolerance {rest:.0e} {unit})"
    if states:
        note += f"; flown within {radius:.1e} {unit} of it ({allowed:.1e} allowed)"
    value = bound.sign * (bound.top - left + min(radius, allowed)) + 0.0
    holds = extreme.margin >= -TOLERANCE and radius <= allowed
    facts = FAMILIES[bound.family], holds, value, bound.sign * bound.top + 0.0, unit
    time = segment.start + extreme.time
    return Statement(*facts, (extreme.drone,), segment.message.name, time, (note,))
