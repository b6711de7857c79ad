"""A rigorous lower bound on the common time of two drones that pass each other.

Let r be the place of the first drone less that of the second, in coordinates where the
separation is a ball of radius d, from r0 to r1. Let n . r0 < 0 < n . r1. Of instants
s_0 T, s_1 T, ... there are two, one after the other, at shares p and q of T, with
n . r(p T) <= 0 <= n . r(q T). In between n . r = 0 somewhere: r = rho u there, with
rho >= d and u a unit vector across n. Directions u within an angle alpha of w have
w . r >= d cos(alpha). With A the greatest size of w . r'', the straight line between
both instants errs by A ((q - p) T)² / 8 at most. So T is impossible if, for each of
finitely many arcs of u and spans of shares, no two flights have

    n . r(p T) <= 0 <= n . r(q T),  w . r(s T) >= d cos(alpha) - A ((q - p) T)² / 8

with s = p, nor with s = q. The relaxation of :mod:`showc.fleet.lower_bound.bound`
proves that. With b_k the multiplier of the way d_k of drone k, a, c, e >= 0 those of
these three, beta_k(t) = b_k, to which, for the first drone, a w is added before s T,
e n before q T and -c n before p T, and from which it is taken for the second,

    sum of b_k . d_k + a (d cos(alpha) - A ((q - p) T)² / 8 - w . r0) + (c - e) n . r0
        > sum of integrals of h_V(beta_k + lambda_k') + h_U(lambda_k) - g lambda_kz.

That is the identity of one drone, span by span, added. It makes shorter times
impossible as it does for one drone: what the line errs by grows as thrust's part does.
Where one axis is enough to keep apart, the faces of a cube stand for arcs.
Arcs and spans with the least proved time are halved first (branch and bound: Land, Doig
1960, An automatic method of solving discrete programming problems).
"""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.lower_bound.bound import (
    greatest_proved,
    knots_of,
    rounded_down,
    spending,
)
from showc.fleet.lower_bound.relaxation import HOVERS, Relaxation
from showc.fleet.lower_bound.relaxed_move import Columns, Part, Solver, program

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.fleet.single_drone.model import Aircraft
    from showc.vehicle import Separation


_SPANS, _ARCS = 4, 4
"""Spans of the time, and arcs, to begin with."""
_INTERVALS = 8
"""Even knots: half as many again sharpened the bound of an exchange by 2e-3."""
_PARTS = 8
"""Parts of a knot interval on which the thrust is bounded."""
_RESOLUTION = 3e-4
"""To what the time of a cell is found [s]: less than halving wins."""
_ROUNDS = 1
"""Programs of one cell. With three, bounds of six pairs were 1e-4 s greater at most,
and up to 4e-2 s less, for twice the work: halves of a cell are worth more."""
_CELLS, _MORE_CELLS = 24, 120
"""Cells looked at for each pair, after the first ones, and for the one that needs most.
That takes 2 s on one core."""
_SIGNS = (1.0, -1.0)
"""With which the drones' places make r."""
_TINY = 1e-12
"""What keeps quotients finite: far below any gain that counts."""
_FINE = 1e-3
"""Share of the time that halving a cell may win, below which it is fine enough."""
_LEAST, _AT_REST = 0.1, 0.1
"""Share of the time that a separation more to go aside is thought to take at least, and
way along the others' for a whole time of a cell's span [m]: for cells that bind not."""
_POWER = 1.5
"""With which power of the time ways grow, about: between a cruise and a push."""
_PAIRS = 2
"""Pairs of a leg that are bounded: the next ones seldom have the greatest bound."""
_ALIKE = 1e-3
"""Share by which pairs' measures differ at least for them not to be alike."""
_TOLERANCE = 1e-6
"""How much nearer than the separation a pair may come by rounding [m]."""


@dataclass(frozen=True, slots=True)
class PassingBound:
    """What two drones of a leg need to pass each other."""

    time: float
    """No common time can be less [s]."""
    first: int
    """Row of one of the drones."""
    second: int
    """Row of the other one."""


def passing_bound(
    aircraft: Aircraft,
    separation: Separation,
    start: FloatArray,
    goal: FloatArray,
    flown: float,
) -> PassingBound | None:
    """Bound the common time of a leg by pairs that cannot both fly straight.

    Parameters
    ----------
    start, goal
        Where drones hover before and after, shape (n, 3) [m].
    flown
        A common time in which all have flown [s]: no bound is looked for beyond it.

    Returns
    -------
    PassingBound or None
        The greatest of those of some pairs; None where no pair has to give way.
    """
    limits = replace(aircraft.limits, jerk=0.0)
    relaxation = Relaxation(aircraft.vehicle, limits, aircraft.yaw, aircraft.heading)
    found = [
        (_Pair(relaxation, separation, start[rows], goal[rows], flown), rows)
        for rows in _pairs(separation, start, goal)
    ]
    if not found:
        return None
    times = [pair.refine(_CELLS) for pair, _ in found]
    pair, rows = found[int(np.argmax(times))]
    return PassingBound(pair.refine(_MORE_CELLS), int(rows[0]), int(rows[1]))


def _pairs(
    separation: Separation, start: FloatArray, goal: FloatArray
) -> list[IntArray]:
    """Choose pairs whose straight ways meet, and that may need the longest.

    A drone that speeds up and brakes with one acceleration over a way L, and goes aside
    by e and back, takes as long as for a way of sqrt(L² + 16 e²). Both share what they
    lack so that the longer of these is the least.
    """
    scale = np.asarray(separation.metric_scale)
    length = np.sum(((goal - start) * scale) ** 2, axis=1)
    found: list[tuple[FloatArray, IntArray]] = []
    for row in range(len(start) - 1):
        before = (start[row] - start[row + 1 :]) * scale
        after = (goal[row] - goal[row + 1 :]) * scale
        way = after - before
        square = np.maximum(np.einsum("na,na->n", way, way), 1e-12)
        share = -np.einsum("na,na->n", before, way) / square
        gap = before + share[:, None] * way
        near = np.linalg.norm(gap, axis=1)
        if separation.shape == "any-axis":
            near = np.abs(gap).max(axis=1)
        lack = separation.distance - near
        meet = np.nonzero((share > 0.0) & (share < 1.0) & (lack > _TOLERANCE))[0]
        one, other = length[row], length[row + 1 + meet]
        whole = 16.0 * lack[meet] ** 2
        # Both ways are as long with lack (1 ± t) / 2 each, t (whole) = other - one.
        tilt = np.clip((other - one) / whole, -1.0, 1.0)
        longest = np.maximum(
            one + 0.25 * whole * (1.0 + tilt) ** 2,
            other + 0.25 * whole * (1.0 - tilt) ** 2,
        )
        pair = np.stack([np.full(meet.size, row), row + 1 + meet], axis=1)
        found.append((np.column_stack([longest, lack[meet], one + other]), pair))
    if not found:
        return []
    measures = np.concatenate([measure for measure, _ in found])
    pairs = np.concatenate([pair for _, pair in found])
    chosen: list[int] = []
    for index in np.argsort(-measures[:, 0], kind="stable").tolist():
        mine = measures[index]
        if all(np.abs(mine / measures[other] - 1.0).max() > _ALIKE for other in chosen):
            chosen.append(index)
        if len(chosen) == _PAIRS:
            break
    return [pairs[index] for index in chosen]


@dataclass(frozen=True, slots=True, eq=False)
class _Cell:
    """Crossings with some directions and shares of the time."""

    toward: FloatArray
    """w, times the metric's scale, shape (3,)."""
    angle: float
    """Of w in its plane [rad]."""
    half: float
    """alpha [rad]."""
    low: float
    """p."""
    high: float
    """q."""
    late: bool
    """Whether s is q."""


@dataclass(frozen=True, slots=True, eq=False)
class _ProofOfPair:
    """Multipliers of a program of two drones."""

    time: float
    reach: float
    relaxation: Relaxation
    knots: FloatArray
    gain: float
    """The left side, were it not for what a straight line errs by."""
    bend: float
    """What that is, over the square of the time."""
    size: float
    """Sum of the sizes of its terms."""
    betas: FloatArray
    """Of each drone on each knot interval, shape (2, k - 1, 3)."""
    multipliers: FloatArray
    """lambda of each drone at the knots, shape (2, k, 3)."""
    aside: float
    """a."""
    along: float
    """c + e."""

    def over(self, time: float) -> float:
        """Surplus with which the multipliers, stretched, prove a time [s] wrong."""
        spent = spending(
            self.relaxation,
            time,
            self.betas,
            self.knots,
            self.multipliers * (time / self.time),
            parts=_PARTS,
        )
        bent = self.bend * time**2
        size = self.size + bent + spent.size
        return min(
            rounded_down(self.gain - bent - spent.most, size),
            rounded_down(self.gain, size),
            spent.pushing + bent,
        )


class _Pair:
    """Two drones that pass each other, both from hover to hover.

    Parameters
    ----------
    start, goal
        Shape (2, 3) [m].
    flown
        A time near the least possible one, beyond which no bound is wanted [s].
    """

    def __init__(
        self,
        relaxation: Relaxation,
        separation: Separation,
        start: FloatArray,
        goal: FloatArray,
        flown: float,
    ) -> None:
        self.relaxation, self.ways = relaxation, goal - start
        self.scale = np.asarray(separation.metric_scale)
        self.distance = separation.distance - _TOLERANCE
        self.begin = start[0] - start[1]
        way = (self.ways[0] - self.ways[1]) * self.scale
        normal = way / np.linalg.norm(way)
        self.normal = normal * self.scale
        self.square = separation.shape == "any-axis"
        side = np.eye(3)[int(np.argmin(np.abs(normal)))]
        side -= (side @ normal) * normal
        side /= np.linalg.norm(side)
        self.across = np.stack([side, np.cross(normal, side)])
        self.solver = Solver()
        self.flown = flown
        # Cells by the time that is proved of them, the least first.
        self.bounded: list[tuple[float, int, list[_Cell]]] = []
        self.count = itertools.count()
        self._begin()

    def refine(self, cells: int) -> float:
        """Look at more cells; return the time up to which all are too short [s]."""
        while self.bounded[0][0] < self.flown and self.bounded[0][2] and cells > 0:
            time, _, halves = heapq.heappop(self.bounded)
            for cell in halves:
                self._bound(cell, time or self.flown)
            cells -= len(halves)
        return min(self.bounded[0][0], self.flown)

    def _begin(self) -> None:
        edges = np.linspace(0.0, 1.0, _SPANS + 1).tolist()
        for low, high in itertools.pairwise(edges):
            for cell in self._around():
                for late in (False, True):
                    fresh = replace(cell, low=low, high=high, late=late)
                    self._bound(fresh, self.flown)

    def _around(self) -> list[_Cell]:
        """All directions."""
        if self.square:
            sides = np.concatenate([np.eye(3), -np.eye(3)])
            return [_Cell(side, 0.0, 0.0, 0.0, 1.0, late=False) for side in sides]
        half = np.pi / _ARCS
        every = _Cell(np.zeros(3), 0.0, half, 0.0, 1.0, late=False)
        return [self._turned(every, 2.0 * half * number) for number in range(_ARCS)]

    def _turned(self, cell: _Cell, angle: float) -> _Cell:
        toward = np.array([np.cos(angle), np.sin(angle)]) @ self.across
        return replace(cell, toward=toward * self.scale, angle=angle)

    def _halves(self, cell: _Cell, narrower: float, shorter: float) -> list[_Cell]:
        """Return the same crossings in two cells, unless halving wins too little.

        Parameters
        ----------
        narrower, shorter
            What may be won by narrower arcs and shorter spans, shares of the time.
        """
        if max(narrower, shorter) < _FINE:
            return []
        if narrower > shorter:
            half = 0.5 * cell.half
            finer = replace(cell, half=half)
            return [self._turned(finer, cell.angle + sign * half) for sign in (-1, 1)]
        middle = 0.5 * (cell.low + cell.high)
        return [
            replace(cell, low=low, high=high, late=late)
            for low, high in ((cell.low, middle), (middle, cell.high))
            for late in (False, True)
        ]

    def _bound(self, cell: _Cell, guess: float) -> None:
        """Prove a time of a cell, near a guess [s], and say what to halve it into."""
        time, found = greatest_proved(
            partial(self._proof, cell), guess, _ROUNDS, _RESOLUTION
        )
        share = 1.0 / (_POWER * max(found.gain, _TINY))
        narrow = 1.0 - float(np.cos(cell.half))
        span = cell.high - cell.low
        # What closing at twice the mean speed makes of the span.
        passed = 2.0 * abs(float(self.normal @ (self.ways[0] - self.ways[1])))
        bent = self._curve(cell) * time**2
        aside, along = found.aside * share, found.along * share
        # A cell may be too wide to bind at all: then what it is itself counts.
        least = _LEAST / self.distance
        halves = self._halves(
            cell,
            max(aside, least) * self.distance * narrow,
            max(aside, least) * bent + max(along * passed, least * _AT_REST) * span,
        )
        heapq.heappush(self.bounded, (time, next(self.count), halves))

    def _proof(self, cell: _Cell, time: float) -> _ProofOfPair:
        """Solve the program of two flights in a time [s]."""
        knots = knots_of(self.relaxation, time, _INTERVALS)
        knots = np.union1d(knots, [cell.low, cell.high])
        widths = np.diff(knots) * time
        # What is asked at instants: of n at p and q, of w at one of them.
        instants = (cell.low, cell.high, cell.high if cell.late else cell.low)
        functionals = np.stack([-self.normal, self.normal, cell.toward])
        before = np.stack([knots[1:] <= instant for instant in instants])
        curve = self._curve(cell)
        asked = np.array([0.0, 0.0, self.distance * np.cos(cell.half)])
        asked -= functionals @ self.begin
        bent = asked - np.array([0.0, 0.0, curve * time**2])
        drones = [
            Columns.of(self.relaxation, way, time, knots, HOVERS, push="across")
            for way in self.ways
        ]
        offsets = [0, drones[0].rows]
        last = drones[0].rows + drones[1].rows
        parts = [self._share(offsets, last, bent)]
        for drone, offset, sign in zip(drones, offsets, _SIGNS, strict=True):
            moved = np.einsum("j,fj,fa->jaf", sign * widths, before, functionals)
            rows = np.broadcast_to(last + np.arange(3), (drone.velocities.shape[0], 3))
            velocity_rows = np.column_stack([offset + drone.velocity_rows, rows])
            entries = np.column_stack([drone.velocities, moved.reshape(-1, 3)])
            parts += [
                (velocity_rows, entries),
                (offset + drone.weight_rows, drone.weights),
            ]
        kept = np.stack([np.zeros(3), np.full(3, np.inf)])
        bounds = np.column_stack([drones[0].bounds, drones[1].bounds, kept])
        found = self.solver.solve(program(self.relaxation, bounds, parts))
        marginal, reach = (np.zeros(last + 3), 1.0) if found is None else found
        behind, ahead, aside = np.maximum(marginal[last:], 0.0).tolist()
        jump = np.array([behind, ahead, aside])
        jumps = np.einsum("f,fj,fa->ja", jump, before, functionals)
        after = [marginal[offset : offset + 3] for offset in offsets]
        lambdas = [
            -marginal[offset + 3 : offset + 3 + 3 * knots.size].reshape(-1, 3)
            for offset in offsets
        ]
        terms = [one @ way for one, way in zip(after, self.ways, strict=True)]
        terms += (jump * asked).tolist()
        return _ProofOfPair(
            time,
            reach,
            self.relaxation,
            knots,
            float(sum(terms)),
            aside * curve,
            float(np.abs(terms).sum()),
            np.stack([after[0] + jumps, after[1] - jumps]),
            np.stack(lambdas),
            aside,
            behind + ahead,
        )

    def _share(self, offsets: list[int], last: int, asked: FloatArray) -> Part:
        """Column of the share that is made of both ways, and of what is asked."""
        rows = [offset + np.arange(3) for offset in offsets]
        entries = [-way for way in self.ways]
        return (
            np.concatenate([*rows, last + np.arange(3)])[None],
            np.concatenate([*entries, -asked])[None],
        )

    def _curve(self, cell: _Cell) -> float:
        """By how much w . r leaves a straight line at most, over T² [m/s²].

        The error of linear interpolation.
        """
        relaxation = self.relaxation
        limits, gravity = relaxation.limits, relaxation.vehicle.gravity
        most = relaxation.specific_thrust[1]
        # The greatest lean of a thrust that both rolls and pitches.
        level = most * np.sqrt(1.0 - np.cos(limits.tilt) ** 4)
        level = min(level, limits.acceleration or np.inf)
        tilt = np.full(1, limits.tilt)
        low, high = (float(side[0]) for side in relaxation.vertical(tilt, tilt))
        upright = max(gravity - low, high - gravity)
        x, y, z = cell.toward.tolist()
        size = 2.0 * (np.hypot(x, y) * level + abs(z) * upright)
        return float(size * (cell.high - cell.low) ** 2 / 8.0)
