"""Programs for a whole crowd: the gentlest changes of all its flights together.

Every drone keeps the flight that it would fly alone, plus a change that begins and ends
at rest. Changes cost the energy that bends them. Where drones come too near, the pair's
distance along the direction between them must be enough; in the same way speeds,
accelerations and the flight volume hold. That is a quadratic program for all drones,
posed anew about each of its solutions (sequential convex programming, as Augugliaro,
Schoellig, D'Andrea 2012), and solved by its dual: see
:mod:`showc.fleet.deconfliction.forces`.

What comes out holds at samples. It is a reference that full dynamics follow, and is
judged in continuous time only then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.changes import (
    Untangled,
    energy_factor,
    excess,
    spline_values,
)
from showc.fleet.deconfliction.forces import Reach, Rows, distinct, raised, scales
from showc.fleet.deconfliction.layers import layers
from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.single_drone.basis import DEGREE
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.fleet.deconfliction.crowd import Crowd


_MARGIN, _ENOUGH = 0.015, 0.004
"""Share of the separation that is aimed at beyond it, and that is enough, away from
the ends: what following a change may cost."""
_SLIGHT = 0.003
"""Share of the separation by which less than enough leaves few conflicts."""
_AGAIN = 6
"""Times that this share is added at most where a pair comes too near all the same."""
_CALM = 0.2
"""Share of the time at either end over which that share rises from nothing."""
_PULL = 0.05
"""Acceleration with which a pair draws apart that stands at the separation [m/s²]."""
_REACH = 1.08
"""Distance of pairs that are looked at, over what is aimed at."""
_TRUST = 0.5
"""Greatest move of a change from one program to the next, in separations."""
_PROGRAMS, _FEWER = 30, 10
"""Programs posed one after the other, and those of many drones after which a search
ends that is slow."""
_LATELY, _SLOW, _LEFT = 5, 0.5, 0.25
"""It is slow where of the pairs too near these many programs ago more than this share
is left, and more than this share of the drones."""
_STEPS, _FURTHER = 40, 150
"""Steps of the dual of each, and for many drones, where forces have far to go. Where
few contradict each other, more steps let forces grow for nothing."""
_PATIENCE = 12
"""Programs after which a search ends that does not get better."""
_HEAD_ON = 0.15
"""Share of the separation below which a pair meets head-on, each on its own right."""
_LOYAL = 0.3
"""Any-axis: by how much another axis must part a pair better, in separations."""
_CLOSE = 1e-3
"""Lack at which a program counts as solved, as a share of the separation."""
_ROOM = 0.02
"""Distance from planes and the flight volume from which on they count [m]."""
_ROUNDING = 1e-6
"""What distances may lack by rounding [m]."""
_NEAR = 0.02
"""Share of a limit below it from which on it counts."""
_INSIDE = 4e-3
"""Share by which changed flights stay within limits, for what lies between samples."""
_FEW, _MANY = 30, 200
"""Drones that are few, and many."""
_FLAT = 0.1
"""How much the crowd's extent counts where layers lie, beside the ways that meet."""
_RISE = 0.25
"""Share of the time in which drones reach their layers, and leave them."""
_STRETCH = (0.0, 0.5, 1.0, 2.0)
"""By how much a crowd is stretched across its layers, over its extent there."""


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """Pairs near each other between two samples, c of them."""

    first: IntArray
    second: IntArray
    sample: IntArray
    """The earlier one."""
    share: FloatArray
    """Where between them they are nearest."""
    gap: FloatArray
    """There, metric coordinates, shape (c, 3) [m]."""
    motion: FloatArray
    """Change of the gap from one sample to the next, shape (c, 3) [m]."""
    distance: FloatArray
    """[m]."""

    def only(self, kept: BoolArray) -> Contacts:
        """Return some of them."""
        return Contacts(
            self.first[kept],
            self.second[kept],
            self.sample[kept],
            self.share[kept],
            self.gap[kept],
            self.motion[kept],
            self.distance[kept],
        )


class Programs:
    """Quadratic programs about one change after the other."""

    def __init__(self, crowd: Crowd, *, limited: bool, gently: bool = False) -> None:
        self.crowd, self.limited, self.gently = crowd, limited, gently
        self.drones, self.samples = crowd.places.shape[:2]
        duration = crowd.duration
        count = crowd.intervals + DEGREE - 8
        times = crowd.times
        self.share = times / duration
        factor = energy_factor(duration, count)
        self.factor = factor
        # Places, velocities and accelerations, one below the other.
        self.whole = np.vstack(spline_values(duration, count, times)[:3]) @ factor
        self.inner = np.zeros((self.drones, factor.shape[1], 3))
        self.change = np.zeros_like(crowd.places)
        self.scale = np.asarray(crowd.separation.metric_scale)
        self.used = np.concatenate([crowd.places, crowd.speeds, crowd.pulls], axis=1)
        # Of these, what programs look at.
        seen = 3 * self.samples if limited else self.samples
        self.reach, self.alone = self.whole[:seen], self.used[:, :seen]
        ends = crowd.places[:, [0, -1]]
        self.ends = ends
        self.moving = np.any(crowd.give != 0.0, axis=(1, 2))
        share, axes = np.linalg.eigh(crowd.give)
        share = np.sqrt(np.maximum(share, 0.0))
        self.root = np.einsum("nab,nb,ncb->nac", axes, share, axes)
        # Forces found, by contact, and the axes that part pairs.
        self.known = np.zeros(0, dtype=np.int64)
        self.forces = np.zeros(0)
        self.work = 0.0
        self.slow = _PROGRAMS if self.drones < _MANY else _FEWER
        self.patience = _PATIENCE
        self.axes: dict[int, tuple[int, float]] = {}

    def begin_in_layers(self) -> None:
        """Begin with drones in layers, in each of which none meet on straight ways.

        Layers are colours of the graph of pairs that come too near (Brelaz 1979, exact
        where two are enough). They lie beside each other where least is in the way, and
        the crowd is stretched there until layers pass between each other.
        """
        near = self._contacts()
        met = near.only(near.distance < self._wanted(near)[1])
        met = met.only(self.moving[met.first] & self.moving[met.second])
        if not met.distance.size:
            return
        points = self.crowd.places * self.scale
        full = self._met_along(met)
        most = np.linalg.eigh(full)[1][:, -1]
        layer = layers(points[:, 0] @ most, met.first, met.second) * self.moving
        apart = layer * (1.0 + _MARGIN) * self.crowd.separation.distance
        rise = np.clip(np.minimum(self.share, 1.0 - self.share) / _RISE, 0.0, 1.0)
        rise *= rise * (3.0 - 2.0 * rise)
        middle = points.mean(axis=(0, 1))
        best, fewest = self.change, np.inf
        self.slow = self.patience = _PROGRAMS
        for normal in self._across(full):
            along = (points - middle) @ normal * self.moving[:, None]
            for stretch in _STRETCH:
                aside = rise * (apart[:, None] + stretch * along)
                self.change = aside[..., None] * normal / self.scale
                found = self._contacts()
                wrong = int(np.sum(found.distance < self._wanted(found)[1]))
                if wrong < fewest:
                    best, fewest = self.change, wrong
        self.change = best

    def _met_along(self, met: Contacts) -> FloatArray:
        """Squares of ways that meet, metric, (3, 3), and a little of the crowd's."""
        size = np.linalg.norm(met.motion, axis=1, keepdims=True)
        ways = met.motion / np.maximum(size, _ROUNDING)
        spread = np.cov((self.crowd.places * self.scale).reshape(-1, 3).T)
        return np.asarray(ways.T @ ways / size.size + _FLAT * spread / np.trace(spread))

    def _across(self, full: FloatArray) -> list[FloatArray]:
        """Directions, metric, across most of the ways that meet and of the crowd."""
        if self.crowd.separation.shape == "any-axis":
            return [np.eye(3)[axis] for axis in np.argsort(np.diag(full))[:2]]
        least, less = np.linalg.eigh(full)[1].T[:2]
        return [least, less, (least + less) / np.sqrt(2.0)]

    def run(self) -> Untangled:
        """Pose and solve programs until all pairs keep apart, or long enough."""
        fewest, stalled, wrong = self.drones**2, 0, []
        for number in range(_PROGRAMS):
            near = self._contacts()
            wanted, enough = self._wanted(near)
            left = int(np.count_nonzero(near.distance < enough)) + self._outside()
            wrong.append(left)
            slow = max(_SLOW * wrong[max(number - _LATELY, 0)], _LEFT * self.drones)
            if number >= self.slow and left > slow:
                break
            stalled = 0 if left < fewest else stalled + 1
            fewest = min(left, fewest)
            if (not left and number) or stalled > self.patience:
                break
            self._solve(near, wanted, trusting=number == 0)
        near = self._contacts()
        slight = _SLIGHT * self.crowd.separation.distance
        short = near.only(near.distance < self._wanted(near)[1] - slight)
        broken = distinct(short.first * self.drones + short.second).size
        pairs = distinct(near.first * self.drones + near.second)
        return Untangled(
            self.crowd.duration,
            self.factor @ self.inner,
            (pairs // self.drones, pairs % self.drones),
            broken,
            excess(self.crowd, self.used, self.used + self.whole @ self.inner),
            self.work,
        )

    def _outside(self) -> int:
        """Count places beyond the flight volume, or on the wrong side of a plane."""
        flown = self.alone + self.reach @ self.inner
        rows, bounds = self._limit_rows(flown)
        places = rows.sample[:, 0] < self.samples
        return int(np.count_nonzero((rows.on(flown) < bounds - _ROOM) & places))

    def _contacts(self) -> Contacts:
        """Find pairs that come near each other, and those with a force."""
        points = (self.crowd.places + self.change) * self.scale
        square = self.crowd.separation.shape == "any-axis"
        norm = np.inf if square else 2.0
        reach = _REACH * (1.0 + _MARGIN) * self.crowd.separation.distance
        segments = self.samples - 1
        keys = []
        for k in range(segments):
            middle = 0.5 * (points[:, k] + points[:, k + 1])
            step = points[:, k + 1] - points[:, k]
            half = 0.5 * float(np.linalg.norm(step, axis=1).max())
            first, second = near_pairs(middle, reach + 2.0 * half, norm)
            keys.append((first * self.drones + second) * segments + k)
        key = np.concatenate(keys)
        key = np.sort(
            np.concatenate([key, np.setdiff1d(self.known, key, assume_unique=True)])
        )
        pair, sample = key // segments, key % segments
        first, second = pair // self.drones, pair % self.drones
        begin = points[first, sample] - points[second, sample]
        motion = points[first, sample + 1] - points[second, sample + 1] - begin
        if square:
            parts = np.linspace(0.0, 1.0, 9)
            there = np.abs(begin[:, None] + parts[:, None] * motion[:, None])
            share = parts[there.max(axis=2).argmin(axis=1)]
        else:
            size = np.einsum("ca,ca->c", motion, motion)
            along = -np.einsum("ca,ca->c", begin, motion)
            share = np.clip(along / np.where(size > 0.0, size, 1.0), 0.0, 1.0)
        gap = begin + share[:, None] * motion
        distance = np.linalg.norm(gap, axis=1, ord=norm)
        found = Contacts(first, second, sample, share, gap, motion, distance)
        moves = self.moving[first] | self.moving[second]
        return found.only(
            ((distance < reach) & moves) | np.isin(key, self.known, assume_unique=True)
        )

    def _wanted(self, near: Contacts) -> tuple[FloatArray, FloatArray]:
        """Distances that are aimed at and that are enough, each (c,) [m]."""
        least = self.crowd.separation.distance
        ends = self.ends[near.first] - self.ends[near.second]
        # No change can keep a pair further apart than it stands at the ends.
        standing = measure(ends, self.crowd.separation).min(axis=1) * (1.0 - 1e-7)
        step = np.diff(self.share)[near.sample]
        at = self.share[near.sample] + near.share * step
        calm = np.clip(np.minimum(at, 1.0 - at) / _CALM, 0.0, 1.0)
        often = self.crowd.often
        pairs = zip(near.first.tolist(), near.second.tolist(), strict=True)
        times = np.array([often.get(pair, 0) for pair in pairs], dtype=np.float64)
        again = np.clip(times - 1.0, 0.0, _AGAIN)
        # What came too near between samples needs more at the ends as well.
        calm = np.where(again > 0.0, 1.0, calm)
        more = _MARGIN * (1.0 + again)
        # What stands at the separation and comes too near all the same moves off.
        away = self.crowd.duration * np.minimum(at, 1.0 - at)
        off = 0.5 * _PULL * again * away**2
        wanted = np.minimum(least * (1.0 + more * calm), standing + off)
        enough = np.minimum(least * (1.0 + _ENOUGH * calm), standing)
        if self.gently:
            # Pairs that keep apart need not move.
            before = self._before(near)
            kept = (before >= least) & (times == 0.0)
            wanted = np.where(kept, np.minimum(wanted, before), wanted)
            enough = np.where(kept, np.minimum(enough, before - _ROUNDING), enough)
        return wanted, enough - 1e-5 * least

    def _before(self, near: Contacts) -> FloatArray:
        """Distances there as drones fly alone, shape (c,) [m]."""
        places = self.crowd.places
        at, late = near.sample, near.share[:, None]
        gap = (1.0 - late) * (places[near.first, at] - places[near.second, at])
        gap += late * (places[near.first, at + 1] - places[near.second, at + 1])
        return measure(gap, self.crowd.separation)

    def _normals(self, near: Contacts) -> FloatArray:
        """Directions in which pairs are to part, (c, 3), metric coordinates."""
        least = self.crowd.separation.distance
        right = np.stack(
            [near.motion[:, 1], -near.motion[:, 0], 0.0 * near.distance], axis=1
        )
        level = np.linalg.norm(right, axis=1, keepdims=True)
        right = np.where(level > 1e-6, right / np.maximum(level, 1e-6), np.eye(3)[0])
        gap = np.where((near.distance < _HEAD_ON * least)[:, None], right, near.gap)
        if self.crowd.separation.shape != "any-axis":
            return np.asarray(gap / np.linalg.norm(gap, axis=1, keepdims=True))
        return self._axis_normals(near, gap)

    def _axis_normals(self, near: Contacts, gap: FloatArray) -> FloatArray:
        """Axes along which pairs part, each pair loyal to the one it had."""
        least = self.crowd.separation.distance
        rows = np.arange(near.distance.size)
        pairs = near.first * self.drones + near.second
        held = [self.axes.get(pair, (0, 0.0)) for pair in pairs.tolist()]
        axis = np.array([one[0] for one in held], dtype=np.int64)
        side = np.array([one[1] for one in held])
        liking = np.abs(gap)
        liking[rows, axis] += _LOYAL * least * np.abs(side)
        chosen = np.argmax(liking, axis=1)
        found = gap[rows, chosen]
        sign = np.where(found >= 0.0, 1.0, -1.0)
        stays = (chosen == axis) & (side != 0.0) & (np.abs(found) < _LOYAL * least)
        sign = np.where(stays, np.sign(side), sign)
        normal = np.zeros((rows.size, 3))
        normal[rows, chosen] = sign
        # Where a pair is nearest decides.
        for row in np.argsort(-near.distance, kind="stable").tolist():
            self.axes[int(pairs[row])] = (int(chosen[row]), float(sign[row]))
        return normal

    def _solve(self, near: Contacts, wanted: FloatArray, *, trusting: bool) -> None:
        """Solve the program about the present change, as far as steps allow."""
        pairs = self._pair_rows(near)
        segments = self.samples - 1
        key = (near.first * self.drones + near.second) * segments + near.sample
        flown = self.alone + np.concatenate(
            [self.change, (self.reach @ self.inner)[:, self.samples :]], axis=1
        )
        force, inner = self._forced(pairs, wanted, key, self._limit_rows(flown))
        if trusting:
            # Nothing has moved before: which limits count shows only now.
            self._keep(key, force)
            limits = self._limit_rows(self.alone + self.reach @ inner)
            force, inner = self._forced(pairs, wanted, key, limits)
        self._keep(key, force)
        change = self.reach[: self.samples] @ inner
        moved = np.linalg.norm(change - self.change, axis=2).max(axis=1)
        room = _TRUST * self.crowd.separation.distance
        step = np.minimum(1.0, room / np.maximum(moved, 1e-12))[:, None, None]
        if trusting:
            step = np.ones_like(step)
        self.inner += step * (inner - self.inner)
        self.change += step * (change - self.change)

    def _keep(self, key: IntArray, force: FloatArray) -> None:
        """Keep the forces found, for the programs to come."""
        held = force > 0.0
        order = np.argsort(key[held], kind="stable")
        self.known, self.forces = key[held][order], force[held][order]

    def _forced(
        self,
        pairs: Rows,
        wanted: FloatArray,
        key: IntArray,
        limits: tuple[Rows, FloatArray],
    ) -> tuple[FloatArray, FloatArray]:
        """Find forces of pairs (c,), and the coefficients (n, k, 3) they lead to."""
        rows = Rows.joined(pairs, limits[0])
        lack = np.concatenate([wanted, limits[1]]) - rows.on(self.alone)
        # Pushes act through the root of what a drone gives, so that it counts once.
        rows = replace(
            rows, value=np.einsum("rpa,rpab->rpb", rows.value, self.root[rows.drone])
        )
        reach = Reach(self.reach, self.samples)
        size = scales(rows, reach)
        force = np.zeros(lack.size)
        if self.known.size:
            at = np.minimum(np.searchsorted(self.known, key), self.known.size - 1)
            same = self.known[at] == key
            force[: key.size] = np.where(same, self.forces[at], 0.0)
        found = raised(
            rows,
            reach,
            lack * size,
            size,
            force / size,
            _CLOSE * self.crowd.separation.distance,
            _STEPS if self.drones <= _FEW else _FURTHER,
        )
        self.work += found.work
        inner = np.zeros_like(self.inner)
        inner[found.drones] = np.matmul(found.push, self.root[found.drones])
        return (found.force * size)[: key.size], inner

    def _pair_rows(self, near: Contacts) -> Rows:
        normal = self._normals(near) * self.scale
        late, early = near.share[:, None], 1.0 - near.share[:, None]
        drone = np.stack([near.first, near.first, near.second, near.second], axis=1)
        sample = np.stack([near.sample, near.sample + 1] * 2, axis=1)
        value = np.stack(
            [early * normal, late * normal, -early * normal, -late * normal], axis=1
        )
        return Rows(drone, sample, value)

    def _limit_rows(self, flown: FloatArray) -> tuple[Rows, FloatArray]:
        """Rows of limits that are passed, or nearly."""
        count = self.samples
        held = distinct(self.known // (count - 1))
        changed = np.zeros(self.drones, dtype=bool)
        changed[held // self.drones] = changed[held % self.drones] = True
        changed &= self.crowd.supple
        changed, allowed = changed[:, None], self.crowd.allowed
        drones, samples, normals, bounds = [], [], [], []

        def add(
            passed: BoolArray, order: int, normal: FloatArray, at: FloatArray
        ) -> None:
            passed &= self.moving[:, None]
            passed[:, [0, -1]] = False
            drone, sample = np.nonzero(passed)
            drones.append(drone)
            samples.append(sample + order * count)
            normals.append(np.broadcast_to(normal, (*passed.shape, 3))[drone, sample])
            bounds.append(at[drone, sample])

        def inside(limit: FloatArray) -> FloatArray:
            return np.where(changed, limit * (1.0 - _INSIDE), limit)

        for order, normal, offset in zip(
            allowed.order.tolist(), allowed.normal, allowed.offset, strict=True
        ):
            if order > (2 if self.limited else 0):
                continue
            part = slice(order * count, (order + 1) * count)
            # What a drone uses when it flies alone it may use.
            limit: FloatArray = np.minimum(offset, self.alone[:, part] @ normal)
            room = _NEAR * abs(offset) if order else _ROOM
            passed = flown[:, part] @ normal < limit + room
            add(passed, order, normal, inside(limit) if order else limit)
        for order in (1, 2) if self.limited else ():
            part = slice(order * count, (order + 1) * count)
            level = flown[:, part] * [1.0, 1.0, 0.0]
            size = np.linalg.norm(level, axis=2)
            alone = np.hypot(self.alone[:, part, 0], self.alone[:, part, 1])
            limit = np.maximum(allowed.level[order], alone)
            toward = -level / np.maximum(size, 1e-9)[..., None]
            add(size > (1.0 - _NEAR) * limit, order, toward, inside(-limit))
        row, sample = np.concatenate(drones), np.concatenate(samples)
        value, bound = np.concatenate(normals), np.concatenate(bounds)
        planes = self.crowd.planes
        there = flown[planes.drone, planes.instant]
        near = np.einsum("pa,pa->p", planes.normal, there) < planes.offset + _ROOM
        row = np.append(row, planes.drone[near])
        sample = np.append(sample, planes.instant[near])
        value = np.concatenate([value, planes.normal[near]])
        bound = np.append(bound, planes.offset[near])
        return Rows(row[:, None], sample[:, None], value[:, None]), bound
