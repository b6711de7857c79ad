"""A whole crowd apart at once: the gentlest changes of all its flights together.

Every drone keeps the flight that it would fly alone, plus a change that begins and ends
at rest. Changes cost the energy that bends them. Where drones come too near, the pair's
distance along the direction between them must be enough; in the same way speeds,
accelerations and the flight volume hold. That is a quadratic program for all drones,
posed anew about each of its solutions (sequential convex programming, as Augugliaro,
Schoellig, D'Andrea 2012). It is solved by its dual, whose unknowns are forces between
drones, with an accelerated gradient (Beck, Teboulle 2009; restarts by O'Donoghue,
Candès 2015): a step costs a few products of matrices, whatever the number of drones.

Which way round each other drones go is decided by where the changes begin. Where the
straight beginning leads nowhere, others are tried, each a little random.

What comes out holds at samples. It is a reference that full dynamics follow, and is
judged in continuous time only then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.crowd import sampled
from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.single_drone.basis import DEGREE, LOCAL, spline_basis
from showc.trajectory import bernstein_basis
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Iterator

    from scipy.sparse import csr_matrix

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.fleet.deconfliction.crowd import Crowd


_LAG = 0.35
"""Time in which a drone changes its acceleration [s]: weighs jerk in the energy."""
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
_AROUND = 2.0
"""Distance within which drones make way for some that come too near, in separations:
those about these stay as they are."""
_REACH = 1.08
"""Distance of pairs that are looked at, over what is aimed at."""
_TRUST = 0.5
"""Greatest move of a change from one program to the next, in separations."""
_PROGRAMS, _FEWER = 30, 10
"""Programs posed one after the other, and for many drones."""
_STEPS, _FURTHER = 40, 150
"""Steps of the dual of each, and for many drones, where forces have far to go. Where
few contradict each other, more steps let forces grow for nothing."""
_PATIENCE = 12
"""Programs after which a search ends that does not get better."""
_STARTS, _MORE, _FEW, _MANY = 4, 10, 30, 200
"""Beginnings tried, those for a few drones, and how many are few; and drones from which
on there is one beginning."""
_WANDER = 0.3
"""Size of a random beginning, in separations."""
_HEAD_ON = 0.15
"""Share of the separation below which a pair meets head-on, each on its own right."""
_LOYAL = 0.3
"""Any-axis: by how much another axis must part a pair better, in separations."""
_POWERS, _SURELY = 16, 1.15
"""Steps by which the greatest eigenvalue of a program is found, and what is added to
it: too low a value would let forces grow without bound."""
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
_FLOOR = 1e-5
"""Least part of the greatest give of a row by which it is scaled."""
_EXCESS, _FAR_BEYOND = 0.15, 0.25
"""Shares by which speeds and accelerations may lie beyond their limits in what can be
flown nearly as it is, where drones are many, and where they are few."""


@dataclass(frozen=True, slots=True, eq=False)
class Untangled:
    """Changes of flights by which a crowd keeps apart, as far as samples tell."""

    duration: float
    """[s]."""
    coefficients: FloatArray
    """Of the changes' splines, shape (n, coefficients, 3) [m]."""
    near: tuple[IntArray, IntArray]
    """Pairs that come near each other."""
    broken: int
    """Pairs that come too near all the same."""
    excess: FloatArray
    """Greatest share by which each drone passes a limit of speed or acceleration."""
    work: float
    """Products of numbers that it took."""

    @property
    def wrong(self) -> int:
        """What is wrong with it: pairs, and drones that use too much of limits."""
        return self.broken + int(np.count_nonzero(self.excess > _EXCESS))

    @property
    def strain(self) -> float:
        """Same, by how much: what little passes limits is followed nearly."""
        return self.broken + float(np.maximum(self.excess - _EXCESS, 0.0).sum())

    @property
    def beyond(self) -> float:
        """How far it is from what can be flown; as ``wrong``, unless drones are few.

        Of these it is by how much: optimal control may find what a change of a smooth
        flight does not.
        """
        if self.excess.size > _FEW:
            return self.wrong
        return self.broken + float(np.maximum(self.excess - _FAR_BEYOND, 0.0).sum())

    def among(self, rows: IntArray, drones: int) -> Untangled:
        """Return the same of a whole crowd, of which these were the ``rows``."""
        whole = np.zeros((drones, *self.coefficients.shape[1:]))
        excess = np.zeros(drones)
        whole[rows], excess[rows] = self.coefficients, self.excess
        near = rows[self.near[0]], rows[self.near[1]]
        return replace(self, coefficients=whole, excess=excess, near=near)

    def curves(self, rows: IntArray) -> FloatArray:
        """Return Bernstein coefficients of some drones' changes, (rows, K, 6, 3)."""
        intervals = self.coefficients.shape[1] + 8 - DEGREE
        whole = np.pad(self.coefficients[rows], ((0, 0), (4, 4), (0, 0)))
        local = whole[:, np.arange(intervals)[:, None] + np.arange(LOCAL)]
        basis = spline_basis(intervals, self.duration)
        return np.asarray(np.einsum("kij,nkja->nkia", basis.position, local))

    def aside(self, rows: IntArray, times: FloatArray) -> FloatArray:
        """Return changes of some drones at times (t,), shape (rows, t, 3) [m]."""
        values = _values(self.duration, self.coefficients.shape[1], times)[0]
        return np.asarray(values @ self.coefficients[rows])


def untangle(
    crowd: Crowd, known: FloatArray | None = None, *, anew: bool = True
) -> Untangled:
    """Change flights of a crowd until all pairs keep apart, as gently as can be.

    Parameters
    ----------
    crowd
        What each would fly alone.
    known
        Changes at the crowd's instants to begin with, shape (n, m, 3) [m]: those of
        the same crowd at another pace.
    """
    best, work = None, 0.0
    for program in _beginnings(crowd, known, anew=anew):
        found = program.run()
        work += found.work
        # About others that fly already, what asks for too much tangles them anew.
        better = best is None or (
            found.wrong < best.wrong if anew else found.strain < best.strain
        )
        best = found if better else best
        if not found.wrong:
            break
    assert best is not None  # noqa: S101 - there is a beginning
    return replace(best, work=work)


def _beginnings(
    crowd: Crowd, known: FloatArray | None, *, anew: bool
) -> Iterator[_Programs]:
    """Yield programs to be run until one of them parts the crowd."""
    many = crowd.places.shape[0] >= _MANY
    first = _Programs(_staying(crowd), limited=many, gently=not anew)
    if known is not None:
        first.change[:] = known
    yield first
    if crowd.hovers.any():
        first = _Programs(crowd, limited=False, gently=not anew)
        yield first
    if many:
        return
    if not anew:
        yield _Programs(_staying(crowd), limited=True, gently=True)
        return
    for number in range(_MORE if crowd.places.shape[0] <= _FEW else _STARTS):
        program = _Programs(crowd, limited=True)
        if number == 0:
            program.change[:], program.inner[:] = first.change, first.inner
        else:
            program.wander(number)
        yield program


def untangle_near(crowd: Crowd, rows: IntArray) -> Untangled:
    """Change flights of some drones, and of those about them, around all others.

    Parameters
    ----------
    rows
        Drones that come too near others, all else being well.
    """
    reach = _AROUND * crowd.separation.distance
    scaled = crowd.places * np.asarray(crowd.separation.metric_scale)
    pairs = [near_pairs(scaled[:, k], reach, 2.0) for k in range(scaled.shape[1])]
    drones = scaled.shape[0]
    first = np.concatenate([pair[0] for pair in pairs])
    second = np.concatenate([pair[1] for pair in pairs])

    def about(some: BoolArray) -> BoolArray:
        found = some.copy()
        found[first[some[second]]] = True
        found[second[some[first]]] = True
        return found

    wrong = np.zeros(drones, dtype=bool)
    wrong[rows] = True
    free = about(wrong)
    chosen = np.nonzero(about(free))[0]
    found = untangle(crowd.part(chosen, free[chosen]), anew=False)
    return found.among(chosen, drones)


def _staying(crowd: Crowd) -> Crowd:
    """Return the same crowd, in which those that hover cannot move."""
    still = crowd.hovers[:, None, None]
    return replace(crowd, give=np.where(still, 0.0, crowd.give))


@lru_cache(maxsize=8)
def _energy(duration: float, count: int) -> FloatArray:
    """Factor H of the inverse energy, H Hᵀ, of splines (count, count)."""
    intervals = count + 8 - DEGREE
    basis = spline_basis(intervals, duration)

    def mean(part: FloatArray) -> FloatArray:
        full = np.zeros((*part.shape[:2], intervals + DEGREE))
        for k in range(intervals):
            full[k, :, k : k + LOCAL] = part[k]
        rows = full.reshape(-1, intervals + DEGREE)[:, 4:-4]
        return np.asarray(rows.T @ rows * (duration / rows.shape[0]))

    gram = mean(basis.acceleration) + _LAG**2 * mean(basis.jerk)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(gram)).T)


def _values(duration: float, count: int, times: FloatArray) -> list[FloatArray]:
    """Values, velocities and accelerations of splines at times, each (t, count).

    They have the coefficients that leave place, speed, pull and jerk zero at the ends.
    """
    intervals = count + 8 - DEGREE
    basis = spline_basis(intervals, duration)
    place = times / duration * intervals
    piece = np.clip(place.astype(np.int64), 0, intervals - 1)
    found = []
    for part in (basis.position, basis.velocity, basis.acceleration):
        local = bernstein_basis(part.shape[1] - 1, place - piece)
        values = np.zeros((times.size, intervals + DEGREE))
        columns = piece[:, None] + np.arange(LOCAL)
        values[np.arange(times.size)[:, None], columns] = np.einsum(
            "tk,tkn->tn", local, part[piece]
        )
        found.append(values[:, 4:-4])
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Contacts:
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

    def only(self, kept: BoolArray) -> _Contacts:
        return _Contacts(
            self.first[kept],
            self.second[kept],
            self.sample[kept],
            self.share[kept],
            self.gap[kept],
            self.motion[kept],
            self.distance[kept],
        )


class _Programs:
    """Quadratic programs about one change after the other."""

    def __init__(self, crowd: Crowd, *, limited: bool, gently: bool = False) -> None:
        self.crowd, self.limited, self.gently = crowd, limited, gently
        self.drones, self.samples = crowd.places.shape[:2]
        duration = crowd.duration
        count = crowd.intervals + DEGREE - 8
        times = sampled(duration)
        self.share = times / duration
        factor = _energy(duration, count)
        self.factor = factor
        # Places, velocities and accelerations, one below the other.
        self.whole = np.vstack(_values(duration, count, times)) @ factor
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
        self.axes: dict[int, tuple[int, float]] = {}

    def wander(self, seed: int) -> None:
        """Begin with a random change of every drone."""
        draw = np.random.default_rng(seed).standard_normal((self.drones, 1, 3))
        push = np.matmul(draw, self.crowd.give)
        bump = self.reach[: self.samples] @ self.reach[: self.samples].sum(axis=0)
        size = np.abs(push).max() * np.abs(bump).max()
        wanted = _WANDER * self.crowd.separation.distance
        self.change = wanted / size * bump[:, None] * push

    def run(self) -> Untangled:
        """Pose and solve programs until all pairs keep apart, or long enough."""
        fewest, stalled = self.drones**2, 0
        programs = _PROGRAMS if self.drones < _MANY else _FEWER
        for number in range(programs):
            near = self._contacts()
            wanted, enough = self._wanted(near)
            left = int(np.count_nonzero(near.distance < enough)) + self._outside()
            stalled = 0 if left < fewest else stalled + 1
            fewest = min(left, fewest)
            if (not left and number) or stalled > _PATIENCE:
                break
            self._solve(near, wanted, trusting=number == 0)
        near = self._contacts()
        slight = _SLIGHT * self.crowd.separation.distance
        wrong = near.only(near.distance < self._wanted(near)[1] - slight)
        broken = _distinct(wrong.first * self.drones + wrong.second).size
        pairs = _distinct(near.first * self.drones + near.second)
        return Untangled(
            self.crowd.duration,
            self.factor @ self.inner,
            (pairs // self.drones, pairs % self.drones),
            broken,
            self._excess(),
            self.work,
        )

    def _outside(self) -> int:
        """Count places beyond the flight volume, or on the wrong side of a plane."""
        flown = self.alone + self.reach @ self.inner
        rows, bounds = self._limit_rows(flown)
        places = rows.sample[:, 0] < self.samples
        return int(np.count_nonzero((rows.on(flown) < bounds - _ROOM) & places))

    def _excess(self) -> FloatArray:
        most = np.ones(self.drones)
        flown, allowed = self.used + self.whole @ self.inner, self.crowd.allowed
        before = most.copy()
        for order in (1, 2):
            part = slice(order * self.samples, (order + 1) * self.samples)
            for values, use in ((flown[:, part], most), (self.used[:, part], before)):
                mine = allowed.order == order
                shares = values @ allowed.normal[mine].T / allowed.offset[mine]
                level = np.hypot(values[..., 0], values[..., 1]) / allowed.level[order]
                np.maximum(use, shares.max(axis=(1, 2)), out=use)
                np.maximum(use, level.max(axis=1), out=use)
        return np.asarray(most - before)

    def _contacts(self) -> _Contacts:
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
        found = _Contacts(first, second, sample, share, gap, motion, distance)
        moves = self.moving[first] | self.moving[second]
        return found.only(
            ((distance < reach) & moves) | np.isin(key, self.known, assume_unique=True)
        )

    def _wanted(self, near: _Contacts) -> tuple[FloatArray, FloatArray]:
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

    def _before(self, near: _Contacts) -> FloatArray:
        """Distances there as drones fly alone, shape (c,) [m]."""
        places = self.crowd.places
        at, late = near.sample, near.share[:, None]
        gap = (1.0 - late) * (places[near.first, at] - places[near.second, at])
        gap += late * (places[near.first, at + 1] - places[near.second, at + 1])
        return measure(gap, self.crowd.separation)

    def _normals(self, near: _Contacts) -> FloatArray:
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

    def _axis_normals(self, near: _Contacts, gap: FloatArray) -> FloatArray:
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

    def _solve(self, near: _Contacts, wanted: FloatArray, *, trusting: bool) -> None:
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
        pairs: _Rows,
        wanted: FloatArray,
        key: IntArray,
        limits: tuple[_Rows, FloatArray],
    ) -> tuple[FloatArray, FloatArray]:
        """Find forces of pairs (c,), and the coefficients (n, k, 3) they lead to."""
        rows = _Rows.joined(pairs, limits[0])
        lack = np.concatenate([wanted, limits[1]]) - rows.on(self.alone)
        # Pushes act through the root of what a drone gives, so that it counts once.
        rows = replace(
            rows, value=np.einsum("rpa,rpab->rpb", rows.value, self.root[rows.drone])
        )
        size = self._scaled(rows)
        force = np.zeros(lack.size)
        if self.known.size:
            at = np.minimum(np.searchsorted(self.known, key), self.known.size - 1)
            same = self.known[at] == key
            force[: key.size] = np.where(same, self.forces[at], 0.0)
        force, inner = self._dual(rows, lack * size, size, force / size)
        return (force * size)[: key.size], inner

    def _pair_rows(self, near: _Contacts) -> _Rows:
        normal = self._normals(near) * self.scale
        late, early = near.share[:, None], 1.0 - near.share[:, None]
        drone = np.stack([near.first, near.first, near.second, near.second], axis=1)
        sample = np.stack([near.sample, near.sample + 1] * 2, axis=1)
        value = np.stack(
            [early * normal, late * normal, -early * normal, -late * normal], axis=1
        )
        return _Rows(drone, sample, value)

    def _limit_rows(self, flown: FloatArray) -> tuple[_Rows, FloatArray]:
        """Rows of limits that are passed, or nearly."""
        count = self.samples
        held = _distinct(self.known // (count - 1))
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
            if order and not self.limited:
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
        return _Rows(row[:, None], sample[:, None], value[:, None]), bound

    def _scaled(self, rows: _Rows) -> FloatArray:
        """Scales of rows: each then gives as much as any other."""
        give = np.zeros(rows.count)
        for one in range(rows.drone.shape[1]):
            for other in range(rows.drone.shape[1]):
                same = rows.drone[:, one] == rows.drone[:, other]
                reach = np.einsum(
                    "rk,rk->r",
                    self.reach[rows.sample[:, one]],
                    self.reach[rows.sample[:, other]],
                )
                both = np.einsum("ra,ra->r", rows.value[:, one], rows.value[:, other])
                give += np.where(same, reach * both, 0.0)
        block = rows.sample[:, 0] // self.samples
        floor = np.ones(rows.count)
        for number in range(3):
            mine = block == number
            floor[mine] = _FLOOR * give[mine].max(initial=0.0)
        return np.asarray(1.0 / np.sqrt(np.maximum(np.maximum(give, floor), 1e-30)))

    def _dual(
        self, rows: _Rows, goal: FloatArray, size: FloatArray, force: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Raise forces where distance lacks; return them and the coefficients.

        Values of ``rows`` are those that meet unit forces: see ``root``.
        """
        drones, local = np.unique(rows.drone, return_inverse=True)
        local = local.reshape(rows.drone.shape)
        moments, count = self.reach.shape
        forward = rows.matrix(size, local, moments, drones.size)
        back = forward.T.tocsr()
        there = np.ascontiguousarray(self.reach.T)

        def moved(push: FloatArray) -> FloatArray:
            return np.asarray(there @ (back @ push).reshape(moments, -1))

        def reached(inner: FloatArray) -> FloatArray:
            return np.asarray(forward @ (self.reach @ inner).ravel())

        # Power iteration, from a vector that no symmetry of the crowd makes blind.
        trial = np.random.default_rng(0).standard_normal(goal.size)
        length = 1.0
        for _ in range(_POWERS):
            answer = reached(moved(trial))
            length = float(np.linalg.norm(answer))
            trial = answer / max(length, 1e-30)
        length *= _SURELY
        ahead, pace = force, 1.0
        close = _CLOSE * self.crowd.separation.distance
        step = 2.0 * (forward.nnz + 3.0 * there.size * drones.size)
        self.work += _POWERS * step
        for _ in range(_STEPS if self.drones <= _FEW else _FURTHER):
            lack = goal - reached(moved(ahead))
            self.work += step
            if float((lack / size).max(initial=0.0)) < close and ahead is not force:
                break
            raised = np.maximum(0.0, ahead + lack / max(length, 1e-30))
            if float((ahead - raised) @ (raised - force)) > 0.0:
                pace = 1.0
            faster = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * pace * pace))
            ahead = raised + (pace - 1.0) / faster * (raised - force)
            force, pace = raised, faster
        inner = np.zeros((self.drones, count, 3))
        found = moved(force).reshape(count, drones.size, 3)
        inner[drones] = np.matmul(np.moveaxis(found, 1, 0), self.root[drones])
        return force, inner


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """Rows on values of drones at samples, up to four of them in each row."""

    drone: IntArray
    """Shape (r, parts)."""
    sample: IntArray
    """Shape (r, parts)."""
    value: FloatArray
    """Shape (r, parts, 3)."""

    @property
    def count(self) -> int:
        return int(self.drone.shape[0])

    @classmethod
    def joined(cls, pairs: _Rows, single: _Rows) -> _Rows:
        """Put rows of limits below rows of pairs."""
        empty = ((0, 0), (0, 3))
        return cls(
            np.concatenate([pairs.drone, np.pad(single.drone, empty)]),
            np.concatenate([pairs.sample, np.pad(single.sample, empty, mode="edge")]),
            np.concatenate([pairs.value, np.pad(single.value, (*empty, (0, 0)))]),
        )

    def on(self, values: FloatArray) -> FloatArray:
        """Left-hand sides for values (n, 3 m, 3), shape (r,)."""
        return np.asarray(
            np.einsum("rpa,rpa->r", self.value, values[self.drone, self.sample])
        )

    def matrix(
        self, size: FloatArray, drone: IntArray, samples: int, drones: int
    ) -> csr_matrix:
        """Sparse matrix of the rows times ``size`` (r,), compressed by rows.

        Its columns are samples, in each the drones (as numbered by ``drone``, of the
        shape of ``self.drone``), of each the axes.
        """
        from scipy.sparse import csr_matrix  # noqa: PLC0415 - for crowds alone

        value = self.value * size[:, None, None]
        column = (self.sample * drones + drone)[..., None] * 3 + np.arange(3)
        head = np.arange(self.count + 1) * value[0].size if self.count else [0]
        shape = (self.count, drones * samples * 3)
        return csr_matrix((value.ravel(), column.ravel(), head), shape=shape)


def _distinct(keys: IntArray) -> IntArray:
    """Return the different keys in order.

    NumPy 2.3 and later finds them with a table of hashes, which takes 25 times as long
    as sorting them (57,000 keys: 6.5 ms for 0.25 ms).
    """
    ordered = np.sort(keys)
    return np.asarray(ordered[np.diff(ordered, prepend=-1) > 0])
