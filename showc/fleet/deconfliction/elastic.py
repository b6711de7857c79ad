"""Ways of a crowd through a fourth dimension, pressed flat.

Which way round each other drones go is a choice for every pair. Here nothing chooses:
each drone has one coordinate more, at first a random one, in which pairs pass each
other freely. What that coordinate costs is raised until it is flat; pairs that passed
through each other's place are then beside each other. All that is wanted is a price:
the squared lack of distance of every pair between two samples, the squared share by
which places, speeds and accelerations pass their limits, and a little of the energy
that bends flights. The sum falls by quasi-Newton steps (L-BFGS; Liu, Nocedal 1989)
while prices rise. The time may have a price as well: speeds fall with its first power,
accelerations with its second, and flights settle where a shorter time would cost more.
Where no way is found, what comes out says by how much: it lacks
little where the time is nearly enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.changes import (
    Untangled,
    energy_factor,
    excess,
    spline_values,
)
from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.single_drone.basis import DEGREE
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.crowd import Crowd


_STAGES: tuple[tuple[float, float | None, float, int], ...] = (
    (30.0, 0.0, 0.0, 40),
    (100.0, 0.01, 0.0, 40),
    (300.0, 0.1, 0.0, 60),
    (1000.0, 1.0, 0.0, 80),
    (3000.0, None, 3.0, 300),
    (30000.0, None, 0.3, 300),
)
"""Price of squared lacks, price of the fourth coordinate, None where it is gone, price
of the time over that of lacks where it is free, and steps at most: what parts the
crowds of the benchmarks, found by trial."""
_UNIT, _LONGEST = 0.03, 2.0
"""Logarithm of the time over a unit of its variable: makes it as stiff as others are,
found by trial; and its greatest value."""
_LAST = 2
"""Of these stages, those that go on from ways that are known."""
_SOONER = ((30000.0, None, 3.0, 700), (30000.0, None, 1.0, 300))
"""The stages in which ways that are known are flown sooner: the first alone leaves
little lacks in very dense crowds, the second mends them [found by trial]."""
_CROWD, _FEWEST_STEPS = 36, 1.0 / 3.0
"""Drones from which on stages take all their steps where the time is free, and the
least share of these that fewer drones take: 13 crowds of 2 to 12 drones then took at
most 2 % longer, in the median 0.1 %, for a third of the work."""
_HOPELESS = 0.02
"""Sum of squared lacks of each drone beyond which the last stage would not pay: where a
way was found in the end, a tenth of that was left."""
_MEMORY = 8
"""Steps that shape the next one."""
_AIM, _CALM = 0.02, 0.2
"""Share of the separation that is aimed at beyond it, and the share of the time at
either end over which that rises from nothing: what following a way may cost."""
_AGAIN = 4
"""Times that this share is added at most where a pair comes too near all the same."""
_PULL = 1.0
"""Acceleration with which a pair draws apart that stands at the separation [m/s²]."""
_DEAREST = 0.03
"""Over what share of its price a lack costs at the ends."""
_ASIDE, _LIFT = 0.15, 0.6
"""Size of the random beginning, and that in the fourth coordinate, in separations."""
_ENERGY = 1e-3
"""Price of the energy, over the time."""
_INSIDE, _BARELY = 0.05, 0.01
"""Share by which flights stay within limits, for what lies between samples: at first,
and where ways are known."""
_REACH, _MOVED = 1.5, 0.2
"""Distance of pairs that are looked at, and by how much drones move until pairs are
looked for again, in separations."""
_SLIGHT, _DEEP = 0.004, 0.05
"""Shares of the separation that a pair may lack, and that count as a whole pair."""
_SHARES = (0.0, 0.2, 0.4, 0.6, 0.8)
"""Any-axis: where between two samples pairs are looked at."""
_SHARPER, _POWERS = 0.01, (4.0, 64.0)
"""Any-axis: power of the norm that stands for the greatest axis, over the price of
lacks, and its bounds: a sharp one is blind to all axes but one."""
_TINY = 1e-12
"""What keeps quotients finite."""
_OF_PAIR, _OF_STEP, _DEAR = 250.0, 1.4e6, 4.6
"""Products that take as long as one pair between two samples, and as a step whatever
the crowd; and how much longer they take than what work is counted in [measured]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Limits:
    """Limits of places, speeds, accelerations or jerks; r of these, drone by drone."""

    normal: FloatArray
    """Of half-spaces, over their limits, shape (f, 3)."""
    bound: FloatArray
    """Shape (f,)."""
    alone: FloatArray
    """What is used alone, shape (r, f)."""
    level: float
    """Greatest level size, SI."""
    still: FloatArray
    """Level sizes alone, shape (r,), SI."""


class Elastic:
    """Changes of a crowd that lack least.

    Parameters
    ----------
    crowd
        What each would fly alone.
    seed
        Of the random beginning.
    known
        Changes at the crowd's instants to go on from, shape (n, m, 3) [m].
    """

    def __init__(
        self, crowd: Crowd, seed: int = 0, known: FloatArray | None = None
    ) -> None:
        self.crowd, self.seed, self.known = crowd, seed, known
        self.inside = 1.0 - (_INSIDE if known is None else _BARELY)
        self.drones, self.samples = crowd.places.shape[:2]
        self.distance = crowd.separation.distance
        self.square = crowd.separation.shape == "any-axis"
        self.scale = np.asarray(crowd.separation.metric_scale)
        times = crowd.times
        self.factor = energy_factor(crowd.duration, crowd.intervals + DEGREE - 8)
        values = spline_values(crowd.duration, self.factor.shape[0], times)
        # Places, velocities, accelerations and jerks, one below the other.
        self.reach = np.vstack(values) @ self.factor
        parts = (crowd.places, crowd.speeds, crowd.pulls, crowd.jerks)
        used = np.concatenate(parts, axis=1)
        self.used = np.ascontiguousarray(used.transpose(1, 0, 2))
        self.moving = np.any(crowd.give != 0.0, axis=(1, 2))
        share, axes = np.linalg.eigh(crowd.give)
        share = np.sqrt(np.maximum(share, 0.0))
        self.root = np.einsum("nab,nb,ncb->nac", axes, share, axes)
        middle = 0.5 * (times[1:] + times[:-1]) / crowd.duration
        away = np.minimum(middle, 1.0 - middle)
        self.calm = np.clip(away / _CALM, 0.0, 1.0)
        self.off = 0.5 * _PULL * (crowd.duration * away) ** 2
        # How often each pair came too near, by the number of the pair.
        often = {
            first * self.drones + second: count
            for (first, second), count in crowd.often.items()
        }
        self.known_pairs = np.array(sorted(often), dtype=np.int64)
        self.often = np.array([often[pair] for pair in self.known_pairs.tolist()])
        self.limits = [self._limits(order) for order in range(len(parts))]
        self.looked: FloatArray | None = None
        # Logarithm of the time over the crowd's, and by how many powers of the time
        # each row of values falls.
        self.slower = 0.0
        self.order = np.repeat(np.arange(len(parts), dtype=np.float64), self.samples)
        # What is wrong with the outcome.
        self.lacking = np.inf
        self.work = 0.0

    def _limits(self, order: int) -> _Limits:
        """Limits of an order of derivatives."""
        allowed, part = self.crowd.allowed, self._part(self.used, order)
        mine = allowed.order == order
        normal, offset = allowed.normal[mine], allowed.offset[mine]
        unit = np.abs(offset) if order else np.full(offset.size, self.distance)
        bound = offset * (self.inside if order else 1.0) / unit
        normal, part = normal / unit[:, None], part.reshape(-1, 3)
        still = np.hypot(part[:, 0], part[:, 1])
        return _Limits(normal, bound, part @ normal.T, allowed.level[order], still)

    def _part(self, values: FloatArray, order: int) -> FloatArray:
        return values[order * self.samples : (order + 1) * self.samples]

    def run(self, slower: float | None = None) -> Untangled:
        """Let the sum of all prices fall, stage by stage.

        Parameters
        ----------
        slower
            Where the time is free, what it is at first, over the crowd's.
        """
        from scipy.optimize import minimize  # noqa: PLC0415 - for crowds alone

        stages, inner = _STAGES, self._beginning()
        if self.known is not None:
            stages = _SOONER if slower else _STAGES[-_LAST:]
        self.slower = float(np.log(slower or 1.0))
        share = max(self.drones / _CROWD, _FEWEST_STEPS) if slower else 1.0
        for price, lift, haste, steps in stages:
            if lift is None:
                inner = np.ascontiguousarray(inner[..., :3])
            shape, self.looked = inner.shape, None
            hurry = haste * price if slower else 0.0
            found = minimize(
                self._cost,
                np.append(inner.ravel(), self.slower / _UNIT),
                args=(shape, price, lift or 0.0, hurry),
                jac=True,
                method="L-BFGS-B",
                bounds=[(None, None)] * inner.size + [(0.0, _LONGEST / _UNIT)],
                options={"maxiter": round(min(share, 1.0) * steps), "maxcor": _MEMORY},
            )
            inner = found.x[:-1].reshape(shape)
            self.slower = _UNIT * float(found.x[-1])
            hopeless = float(found.fun) > _HOPELESS * price * self.drones
            if lift is None and hopeless and not slower:
                break
            # With the time free, later stages only mend what is wrong.
            if lift is None and slower and not self._judged(inner).wrong:
                break
        outcome = self._judged(inner)
        self.lacking = outcome.wrong
        return outcome

    def _beginning(self) -> FloatArray:
        """Coefficients to begin with, (k, n, 3 or 4)."""
        count = self.factor.shape[1]
        places = self.reach[: self.samples]
        if self.known is not None:
            wanted = self.known.transpose(1, 0, 2).reshape(self.samples, -1)
            inner = np.linalg.lstsq(places, wanted, rcond=None)[0]
            inner = inner.reshape(count, self.drones, 3)
            back = np.linalg.pinv(self.root)
            inner = np.einsum("kna,nab->knb", inner, back)
        else:
            bump = places.sum(axis=0)
            bump /= np.abs(places @ bump).max()
            draw = np.random.default_rng(self.seed).standard_normal((self.drones, 4))
            size = self.distance * np.array([_ASIDE, _ASIDE, _ASIDE, _LIFT])
            inner = bump[:, None, None] * draw * size
        inner[:, ~self.moving] = 0.0
        return np.asarray(inner)

    def _cost(
        self,
        inner: FloatArray,
        shape: tuple[int, int, int],
        price: float,
        lift: float,
        hurry: float,
    ) -> tuple[float, FloatArray]:
        """Sum of all prices, and its gradient; the last variable is the time's."""
        parts = inner[:-1].reshape(shape)
        slower = _UNIT * float(inner[-1])
        pace = np.exp(-slower * self.order)[:, None, None]
        count, drones, axes = shape
        flat = parts[..., :3]
        push = np.einsum("kna,nab->knb", flat, self.root).reshape(count, -1)
        flown = pace * (self.used + (self.reach @ push).reshape(-1, drones, 3))
        points = self._part(flown, 0) * self.scale
        if axes > 3:
            fourth = self._part(self.reach, 0) @ parts[..., 3]
            points = np.concatenate([points, fourth[..., None]], axis=2)
        cost, pull = self._apart(np.ascontiguousarray(points), price)
        slope = np.zeros_like(flown)
        self._part(slope, 0)[:] = pull[..., :3] * self.scale
        more, later = self._within(flown, slope, price, slower)
        cost += more
        cost += self._turning(flown, slope, price)
        cost += self._behind(flown, slope, price)
        if hurry:
            haste = hurry * float(np.exp(slower))
            cost += haste
            later += haste - float(self.order @ np.einsum("mna,mna->m", slope, flown))
        slope *= pace
        energy = _ENERGY * self.crowd.duration
        cost += 0.5 * energy * float((flat**2).sum())
        back = (self.reach.T @ slope.reshape(slope.shape[0], -1)).reshape(count, -1, 3)
        gradient = np.empty(shape)
        gradient[..., :3] = np.einsum("knb,nab->kna", back, self.root) + energy * flat
        if axes > 3:
            heights = parts[..., 3]
            cost += 0.5 * (lift + energy) * float((heights**2).sum())
            gradient[..., 3] = self._part(self.reach, 0).T @ pull[..., 3]
            gradient[..., 3] += (lift + energy) * heights
        gradient[:, ~self.moving] = 0.0
        self.work += 4.0 * self.reach.size * drones * axes + _OF_STEP
        self.work += _OF_PAIR * self.ahead.size
        return cost, np.append(gradient.ravel(), _UNIT * later if hurry else 0.0)

    def _look(self, points: FloatArray) -> None:
        """Find pairs near each other between two samples."""
        flat = points[..., :3]
        middle = 0.5 * (flat[1:] + flat[:-1])
        half = 0.5 * np.linalg.norm(flat[1:] - flat[:-1], axis=2)
        reach, norm = _REACH * self.distance, np.inf if self.square else 2.0
        far = (reach + 2.0 * half.max(axis=1)).tolist()
        found = [near_pairs(*one, norm) for one in zip(middle, far, strict=True)]
        segment = np.repeat(np.arange(len(found)), [one.size for one, _ in found])
        first, second = (np.concatenate(some) for some in zip(*found, strict=True))
        self.work += _OF_PAIR * segment.size
        gap = middle[segment, first] - middle[segment, second]
        near = np.linalg.norm(gap, ord=norm, axis=1)
        near -= half[segment, first] + half[segment, second]
        kept = (near < reach) & (self.moving[first] | self.moving[second])
        segment, first, second = segment[kept], first[kept], second[kept]
        self.ahead = segment * self.drones + first
        self.behind = segment * self.drones + second
        # What came too near all the same needs more, at the ends as well.
        again = np.clip(self._how_often(first, second) - 1.0, 0.0, _AGAIN)
        calm = np.where(again > 0.0, 1.0, self.calm[segment])
        aim = self.distance * (1.0 + _AIM * (1.0 + again) * calm)
        # Near the ends no share is aimed at: what lacks there costs more.
        self.dear = 1.0 / np.maximum(self.calm[segment], _DEAREST)
        off = self.off[segment] * (1.0 + again)
        self.wanted = np.minimum(aim, self._standing(first, second) + off)
        self.looked = flat

    def _how_often(self, first: IntArray, second: IntArray) -> FloatArray:
        """How often pairs (m,) have come too near, shape (m,)."""
        if not self.often.size:
            return np.zeros(first.size)
        pair = first * self.drones + second
        at = np.searchsorted(self.known_pairs, pair) % self.often.size
        return np.where(self.known_pairs[at] == pair, self.often[at], 0.0)

    def _standing(self, first: IntArray, second: IntArray) -> FloatArray:
        """Distances (m,) at which pairs (m,) stand at the nearer of their ends.

        No change can keep a pair further apart there.
        """
        ends = self.crowd.places[:, [0, -1]]
        apart = measure(ends[first] - ends[second], self.crowd.separation)
        return np.asarray(apart.min(axis=1) * (1.0 - 1e-7))

    def _apart(self, points: FloatArray, price: float) -> tuple[float, FloatArray]:
        """Price of what distances lack, and its slope (m, n, axes)."""
        far = _MOVED * self.distance
        if self.looked is None or np.abs(points[..., :3] - self.looked).max() > far:
            self._look(points)
        _, later, axes = points.shape
        # Axis by axis, as sums over few axes take long row by row.
        rows = np.ascontiguousarray(points.reshape(-1, axes).T)
        first, second = self.ahead, self.behind
        gap = rows.take(first, axis=1) - rows.take(second, axis=1)
        motion = rows.take(first + later, axis=1) - rows.take(second + later, axis=1)
        motion -= gap
        cost, slope = 0.0, np.zeros_like(rows)
        lacks = (
            self._square(gap, motion, price)
            if self.square
            else self._round(gap, motion)
        )
        for here, share, lack, toward in lacks:
            dear = price * self.dear[here]
            cost += float(dear @ (lack * lack))
            force = 2.0 * dear * lack * toward
            late, early = share * force, (1.0 - share) * force
            first, second = self.ahead[here], self.behind[here]
            where = np.concatenate([first, first + later, second, second + later])
            value = np.concatenate([early, late, -early, -late], axis=1)
            for axis in range(axes):
                slope[axis] += np.bincount(where, value[axis], rows.shape[1])
        return cost, slope.T.reshape(points.shape)

    def _round(
        self, gap: FloatArray, motion: FloatArray
    ) -> Iterator[tuple[IntArray, FloatArray, FloatArray, FloatArray]]:
        """Columns that lack distance, where, by which share, and how that changes."""
        size = np.einsum("ac,ac->c", motion, motion)
        along = np.einsum("ac,ac->c", gap, motion)
        share = np.clip(-along / np.maximum(size, _TINY), 0.0, 1.0)
        square = np.einsum("ac,ac->c", gap, gap) + share * (2.0 * along + share * size)
        here = np.nonzero(square < self.wanted**2)[0]
        share = share[here]
        there = gap.take(here, axis=1) + share * motion.take(here, axis=1)
        near = np.sqrt(np.maximum(square[here], _TINY))
        lack = (self.wanted[here] - near) / self.distance
        yield here, share, lack, there / (-near * self.distance)

    def _square(
        self, gap: FloatArray, motion: FloatArray, price: float
    ) -> Iterator[tuple[IntArray, FloatArray, FloatArray, FloatArray]]:
        """Return the same where one axis is enough."""
        power = float(np.clip(_SHARPER * price, *_POWERS))
        weight = 1.0 / np.sqrt(len(_SHARES))
        for part in _SHARES:
            there = gap + part * motion
            size = np.abs(there)
            most = size.max(axis=0)
            here = np.nonzero(most < self.wanted)[0]
            most = np.maximum(most[here], _TINY)
            ratio = size.take(here, axis=1) / most
            total = (ratio**power).sum(axis=0)
            near = most * total ** (1.0 / power)
            lack = weight * (self.wanted[here] - near) / self.distance
            toward = np.sign(there.take(here, axis=1)) * ratio ** (power - 1.0)
            toward *= -weight / self.distance * total ** (1.0 / power - 1.0)
            kept = lack > 0.0
            share = np.full(int(kept.sum()), part)
            yield here[kept], share, lack[kept], toward[:, kept]

    def _within(
        self, flown: FloatArray, slope: FloatArray, price: float, slower: float
    ) -> tuple[float, float]:
        """Price of limits that are passed, and its slope by ``slower``; adds its slope.

        What a drone uses when it flies alone, as much slower, it may use.
        """
        cost = later = 0.0
        for order, limits in enumerate(self.limits):
            part, toward = (self._part(one, order) for one in (flown, slope))
            part, toward = part.reshape(-1, 3), toward.reshape(-1, 3)
            pace = float(np.exp(-slower * order))
            reached = part @ limits.normal.T
            # What is within limits lacks nothing, whatever the drone uses alone.
            row, side = np.nonzero(reached < limits.bound)
            if row.size:
                bound, own = limits.bound[side], pace * limits.alone[row, side]
                most = np.minimum(bound, own)
                lack = np.maximum(0.0, most - reached[row, side])
                cost += price * float(lack @ lack)
                later -= 2.0 * price * order * float(lack @ (most * (own < bound)))
                force = (-2.0 * price * lack)[:, None] * limits.normal[side]
                np.add.at(toward, row, force)
            if np.isfinite(limits.level):
                inside, level = limits.level * self.inside, part[:, :2]
                row = np.nonzero(np.einsum("ra,ra->r", level, level) > inside**2)[0]
                used, own = np.hypot(*level[row].T), pace * limits.still[row]
                more = np.maximum(0.0, used - np.maximum(inside, own)) / limits.level
                cost += price * float(more @ more)
                later += (
                    2.0 * price * order * float(more @ (own * (own > inside)))
                ) / limits.level
                force = 2.0 * price * more / (limits.level * np.maximum(used, _TINY))
                toward[row, :2] += force[:, None] * level[row]
        return cost, later

    def _turning(self, flown: FloatArray, slope: FloatArray, price: float) -> float:
        """Price of rates that are passed; adds its slope."""
        cost = 0.0
        allowed, most = self.crowd.allowed, self.inside
        pulls, jerks = self._part(flown, 2), self._part(flown, 3)
        rows = np.nonzero(allowed.turning(pulls, jerks) > most)
        for share, by_pull, by_jerk in allowed.turned(pulls[rows], jerks[rows]):
            more = np.maximum(0.0, np.abs(share) - most)
            cost += price * float(more @ more)
            force = (2.0 * price * more * np.sign(share))[:, None]
            self._part(slope, 2)[rows] += force * by_pull
            self._part(slope, 3)[rows] += force * by_jerk
        return cost

    def _behind(self, flown: FloatArray, slope: FloatArray, price: float) -> float:
        """Price of planes that are passed; adds its slope."""
        planes = self.crowd.planes
        if not planes.drone.size:
            return 0.0
        there = flown[planes.instant, planes.drone]
        reached = np.einsum("pa,pa->p", planes.normal, there)
        lack = np.maximum(0.0, planes.offset - reached) / self.distance
        force = (-2.0 * price / self.distance * lack)[:, None] * planes.normal
        np.add.at(slope, (planes.instant, planes.drone), force)
        return price * float(lack @ lack)

    def _judged(self, inner: FloatArray) -> Untangled:
        """Say what changes lack, as they come out of a stage."""
        crowd = self.crowd
        inner = np.einsum("kna,nab->nkb", inner, self.root)
        values = np.einsum("mk,nka->nma", self.reach, inner)
        pace = np.exp(-self.slower * self.order)[:, None]
        used, values = self.used.transpose(1, 0, 2) * pace, values * pace
        places = (used + values)[:, : self.samples].transpose(1, 0, 2)
        points = np.ascontiguousarray(places * self.scale)
        self._look(points)
        rows = points.reshape(-1, 3)
        gap = rows[self.ahead] - rows[self.behind]
        motion = rows[self.ahead + self.drones] - rows[self.behind + self.drones] - gap
        lack = np.zeros(gap.shape[0])
        for part in np.linspace(0.0, 1.0, 9).tolist():
            there = np.abs(gap + part * motion)
            near = there.max(axis=1) if self.square else np.linalg.norm(there, axis=1)
            aim = np.minimum(self.distance * (1.0 + _SLIGHT), self.wanted)
            np.maximum(lack, (aim - near) / self.distance, out=lack)
        pair = (self.ahead % self.drones) * self.drones + self.behind % self.drones
        pairs, number = np.unique(pair, return_inverse=True)
        worst = np.zeros(pairs.size)
        np.maximum.at(worst, number, lack)
        worst = np.where(worst > _SLIGHT, np.minimum(worst / _DEEP, 1.0), 0.0)
        return Untangled(
            crowd.duration * float(np.exp(self.slower)),
            self.factor @ inner,
            (pairs // self.drones, pairs % self.drones),
            float(worst.sum()),
            excess(crowd, used, used + values),
            _DEAR * self.work,
        )
