"""Ways round each other: bumps off the straight lines that keep a whole crowd apart.

Every drone follows its straight line on the shared profile, plus a bump by which it
leaves the line and comes back, all bumps on one clock. Which bump each drone takes is a
constraint satisfaction problem with a constraint for each pair. It is searched by
min-conflicts with weights that grow where the search is stuck (Morris 1993, The
breakout method for escaping from local minima). A bump costs what it would lengthen its
drone's flight by. A crowd whose ways keep apart keeps apart however slowly it flies
them, because time only stretches.

Where no such search succeeds, the lines themselves are bent first: as the crowd turns
about its middle, or as it widens and comes together again.

The search looks at samples: what is flown is judged in continuous time afterwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.shared_profile.profile import Profile
from showc.trajectory import PiecewisePolynomial, restrict
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.crowd import Crossing
    from showc.fleet.single_drone.single import Aircraft


RISES = (0.5, 0.35)
"""Shares of the time in which a bump rises, and falls. The first is one hump, the
gentlest; the second stays aside for a while, for lines that stay near for long."""

SIZES = ((0.5, 1.0), (0.35, 0.6, 1.0, 1.5), (0.5, 1.0, 1.5, 2.0, 3.0, 4.0))
"""Sizes of the bumps that are tried, in separations: few and small ones first. Half a
separation up and half a separation down part a pair."""

_QUICK, _MANY = 2, 300
"""How many of these are small, and drones up to which others are tried."""

_INSTANTS = 48
"""Intervals between samples of a way: shorter than a separation each on flights of
50 m at 1.5 m."""

_COARSE, _FINE, _UNSURE = 4, 24, 0.06
"""With any axis: parts of an interval at which all pairs are looked at, those at which
the pairs are that come so near the separation, and how near, as a share of it."""

_CHANGED = tuple(0.005 * k for k in range(17))
"""Shares by which a rise may be shorter for the sake of its joints."""
_SAME = 1e-9
"""Share of the time within which two joints are one."""

_CHANGES, _STALLED = 12, 2
"""Changes allowed for each drone in conflict before other bumps are tried, and how many
of them may leave as many pairs too near as there were."""
_HOPELESS = 0.9
"""Share of the pairs left from which on a search has not helped."""

_PRICE, _HOVERS = 0.02, 100.0
"""Price of a bump of one separation, beside that of a breach (0.2 and more), and how
much more for one that hovers: it moves only where others are stuck."""

_HASTE = 2.0
"""Price of a bump that takes twice the time: 10 % more are as dear as a breach."""

_WIDER = math.sqrt(2.0) - 1.0
"""Share of its size by which a crowd widens: on straight lines to the places that
minimise the sum of squared distances, pairs come nearer by a factor of the square root
of two at most, half-way (Turpin, Michael, Kumar 2014)."""

_TURN = 0.1
"""Turn of a crowd below which its lines are as good [rad]."""

_TURNED = 1.05
"""How much of the way from chord to arc a crowd that turns leaves its lines: more than
all, because bumps are no circles."""

_HEAD_ON = 0.15
"""Share of the separation below which a pair meets head-on: each drone of it begins
with a step to its own right, as the rules of the air have it."""

_PAIRS_AT_ONCE = 4096
"""Bounds the memory of one comparison to some tens of megabytes."""

_STILL = 1e-9
"""A drone that moves less than this hovers, and moves aside only where it must [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """A bump for each drone, on one clock."""

    aside: FloatArray
    """How far each drone leaves its line, and to which side, shape (n, 3) [m]."""
    rise: float
    """Share of the time in which bumps rise, and in which they fall."""
    broken: int
    """Pairs that come too near all the same, as far as samples tell."""
    before: int
    """Pairs that came too near before the search."""
    sizes: tuple[float, ...]
    """Sizes of bumps among which they were found, in separations."""
    bent: FloatArray | None = None
    """Bumps of the whole crowd off which these were found, shape (n, 3) [m]."""

    def positions(
        self, start: FloatArray, goal: FloatArray, profile: Profile
    ) -> tuple[FloatArray, FloatArray]:
        """Lay out the ways in time.

        Parameters
        ----------
        start, goal
            Shape (n, 3), show frame [m].
        profile
            Of the straight lines; its duration is that of the ways.

        Returns
        -------
        breaks : ndarray, shape (K + 1,)
            [s].
        coefficients : ndarray, shape (n, K, 5, 3)
            Bernstein coefficients of the positions [m], with a continuous
            acceleration, from hover to hover.
        """
        line, bump = profile.derivatives()[0], bump_over(profile.duration, self.rise)
        breaks = np.union1d(line.breaks, bump.breaks)
        breaks = breaks[np.append(True, np.diff(breaks) > _SAME * profile.duration)]
        breaks[-1] = profile.duration
        along, aside = _on(breaks, line), _on(breaks, bump)
        positions = start[:, None, None] + along * (goal - start)[:, None, None]
        positions += aside * self.aside[:, None, None]
        # Not start + (goal - start), which rounds.
        positions[:, -1, -2:] = goal[:, None]
        return breaks, positions


def bump_over(duration: float, rise: float) -> PiecewisePolynomial:
    """Return a bump from 0 to 1 and back over ``duration`` [s], degree 4.

    It rises in ``rise`` of the duration, falls alike, and is 1 between.
    """
    time = rise * duration
    up = Profile(time, 0.5 * time, 0.25 * time).derivatives()[0]
    parts, breaks = [up.coefficients], [up.breaks]
    if duration - 2.0 * time > _SAME * duration:
        parts.append(np.ones((1, up.degree + 1, 1)))
        breaks.append(np.array([duration - time]))
    parts.append(up.coefficients[::-1, ::-1])
    breaks.append(duration - up.breaks[-2::-1])
    return PiecewisePolynomial(np.concatenate(breaks), np.concatenate(parts))


def _on(breaks: FloatArray, curve: PiecewisePolynomial) -> FloatArray:
    """Coefficients of a curve on finer intervals, shape (K, degree + 1, 1)."""
    middle = 0.5 * (breaks[:-1] + breaks[1:])
    piece = np.searchsorted(curve.breaks, middle, side="right") - 1
    begin, width = curve.breaks[piece], np.diff(curve.breaks)[piece]
    lower = np.clip((breaks[:-1] - begin) / width, 0.0, 1.0)
    upper = np.clip((breaks[1:] - begin) / width, 0.0, 1.0)
    return restrict(
        curve.coefficients[piece], lower[:, None, None], upper[:, None, None]
    )


def find_ways(
    crossing: Crossing, known: Ways | None = None, *, quickly: bool = False
) -> Ways | None:
    """Find ways that keep all drones apart, or the most of them.

    Parameters
    ----------
    crossing
        What is to be flown.
    known
        Ways of the same crossing at another pace: then they are adapted, and nothing
        else is looked for.
    quickly
        Whether to look among small bumps off the straight lines alone, and no longer
        than these help: where neighbours close in on places as near as may be, no bump
        of one drone does.

    Returns
    -------
    Ways or None
        None where no way round exists: with ``all-axes`` drones keep their order on
        each axis.
    """
    if crossing.separation.shape == "all-axes":
        return None
    if known is not None:
        return _search(
            crossing, known.sizes, known.rise, aside=known.aside, bent=known.bent
        )
    best: Ways | None = None
    for found in _searches(crossing, SIZES[:_QUICK] if quickly else SIZES):
        if best is None or found.broken < best.broken:
            best = found
        if best.broken == 0 or (quickly and found.broken > _HOPELESS * found.before):
            break
    return best


def _searches(
    crossing: Crossing, menus: tuple[tuple[float, ...], ...]
) -> Iterator[Ways]:
    """Search off the straight lines, and, if all bumps are allowed, off bent ones."""
    rises = [_clear(crossing.profile, rise) for rise in RISES]
    # Large bumps among many drones take minutes to choose from.
    few = crossing.start.shape[0] <= _MANY
    for sizes, rise in product(menus if few else menus[:_QUICK], rises):
        yield _search(crossing, sizes, rise)
    if menus is SIZES:
        for bent, sizes in product(_bent(crossing), SIZES[1:] if few else SIZES[:1]):
            yield _search(crossing, sizes, rises[0], bent=bent)


def _clear(profile: Profile, rise: float) -> float:
    """Change a rise by a little, so that joints of bump and line lie well apart.

    Derivatives on intervals of a few milliseconds drown in rounding.
    """
    line = profile.derivatives()[0].breaks

    def shortest(share: float) -> float:
        bump = bump_over(profile.duration, share).breaks
        widths = np.diff(np.union1d(line, bump)) / profile.duration
        return float(widths[widths > _SAME].min())

    return max((rise * (1.0 - change) for change in _CHANGED), key=shortest)


def _search(
    crossing: Crossing,
    sizes: tuple[float, ...],
    rise: float,
    *,
    aside: FloatArray | None = None,
    bent: FloatArray | None = None,
) -> Ways:
    """Search among bumps of some sizes, from some ways, or off bent lines, (n, 3)."""
    crowd = _Crowd(crossing, rise, max(sizes), bent)
    if bent is not None and aside is not None:
        aside = aside - crowd.bent
    search = _Search(crowd, sizes, aside)
    before = search.broken
    search.run()
    found = search.aside[: crossing.start.shape[0]] + crowd.bent
    base = None if bent is None else crowd.bent
    return Ways(found, rise, search.broken, before, sizes, base)


def _bent(crossing: Crossing) -> list[FloatArray]:
    """Bumps of a whole crowd, each of shape (n, 3) [m].

    The first turns it about its middle, by the turn that brings it nearest to its goals
    (Kabsch 1976): every drone leaves the chord for the arc. Without a bump such a crowd
    shrinks half-way. The others widen it.
    """
    start = crossing.start - crossing.start.mean(axis=0)
    goal = crossing.goal - crossing.goal.mean(axis=0)
    middle = 0.5 * (start + goal)
    left, _, right = np.linalg.svd(start.T @ goal)
    sign = np.sign(np.linalg.det(left @ right))
    turn = right.T @ np.diag([1.0, 1.0, sign]) @ left.T
    angle = math.acos(min(1.0, max(-1.0, 0.5 * (np.trace(turn) - 1.0))))
    found = []
    if angle > _TURN:
        axis = np.linalg.eigh(turn + turn.T)[1][:, -1]
        skew = turn - turn.T
        if axis @ np.array([skew[2, 1], skew[0, 2], skew[1, 0]]) < 0.0:
            axis = -axis
        arc = start @ _turned(axis, 0.5 * angle).T
        chord = 0.5 * (start + start @ _turned(axis, angle).T)
        found.append(_TURNED * (arc - chord))
    return [*found, 0.4 * _WIDER * middle, _WIDER * middle]


def _turned(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation matrix about a unit vector by an angle [rad] (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(
        np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    )


class _Crowd:
    """Lines of all drones at some instants, and the pairs that can meet."""

    def __init__(
        self,
        crossing: Crossing,
        rise: float,
        size: float,
        bent: FloatArray | None,
    ) -> None:
        start, goal, profile = crossing.start, crossing.goal, crossing.profile
        self.separation = crossing.separation
        limits = crossing.aircraft.limits
        self.low = np.asarray(limits.position_min)
        self.top = np.asarray(limits.position_max)
        self.scale = np.asarray(self.separation.metric_scale)
        instants = np.linspace(0.0, profile.duration, _INSTANTS + 1)
        bump = bump_over(profile.duration, rise)
        self.bump = bump(instants)
        along, speed, pull = (part(instants) for part in profile.derivatives())
        self.moves = goal - start
        lines = start[:, None] + along * self.moves[:, None]
        self.bent = np.zeros_like(start)
        if bent is not None:
            there = lines + self.bump * bent[:, None]
            # A drone that would leave the volume keeps its line.
            inside = np.all((there >= self.low) & (there <= self.top), axis=(1, 2))
            self.bent = np.where(inside[:, None], bent, 0.0)
            lines += self.bump * self.bent[:, None]
        still = np.linalg.norm(self.moves, axis=1) <= _STILL
        self.moving = np.ones(start.shape[0])
        self.moving[still] = 1.0 / _HOVERS
        if crossing.parked is not None:
            parked = crossing.parked
            there = np.broadcast_to(
                parked[:, None], (parked.shape[0], *lines.shape[1:])
            )
            lines = np.concatenate([lines, there])
            self.moving = np.append(self.moving, np.zeros(parked.shape[0]))
        self.lines = lines
        first = bump.derivative()
        self.rates = np.stack([speed, first(instants)])
        self.pulls = np.stack([pull, first.derivative()(instants)])
        self.limits = _Accelerations.of(crossing.aircraft)
        self.step = (1.0 + crossing.margin) * self.separation.distance
        wanted = self.step
        reach = wanted + 2.0 * size * self.step
        self.first, self.second = self._near(reach)
        ends = lines[self.first][:, [0, -1]] - lines[self.second][:, [0, -1]]
        # No way can keep a pair further apart than it stands at the ends.
        standing = measure(ends, self.separation).min(axis=1)
        self.wanted = np.minimum(wanted, standing * (1.0 - 1e-6))

    def lateness(self, row: int, bumps: FloatArray) -> FloatArray:
        """How much longer than given a drone takes with bumps (k, 3), as a share."""
        way, aside = self.moves[row], self.bent[row] + bumps
        pull = self.pulls[0] * way + self.pulls[1] * aside[:, None]
        rate = self.rates[0] * way + self.rates[1] * aside[:, None]
        return np.asarray(self.limits.stretch(rate, pull) - 1.0)

    def _near(self, reach: float) -> tuple[IntArray, IntArray]:
        """Pairs that come nearer than ``reach`` at some instant, one of them moving."""
        count = self.lines.shape[0]
        norm = np.inf if self.separation.shape == "any-axis" else 2.0
        keys = [np.zeros(0, dtype=np.int64)]
        for instant in range(self.lines.shape[1]):
            points = self.lines[:, instant] * self.scale
            first, second = near_pairs(points, reach, norm)
            gap = np.linalg.norm(points[first] - points[second], ord=norm, axis=1)
            near = (gap < reach) & (self.moving[first] + self.moving[second] > 0.0)
            keys.append(first[near] * count + second[near])
        pairs = np.unique(np.concatenate(keys))
        return pairs // count, pairs % count

    def distances(self, aside: FloatArray) -> FloatArray:
        """Least distance of each pair, shape (pairs,) [m], with bumps (n, 3) [m]."""
        found = [np.zeros(0)]
        for top in range(0, self.first.size, _PAIRS_AT_ONCE):
            some = slice(top, top + _PAIRS_AT_ONCE)
            first, second = self.first[some], self.second[some]
            gap = self.lines[first] - self.lines[second]
            gap += self.bump * (aside[first] - aside[second])[:, None]
            found.append(self.least(gap))
        return np.concatenate(found)

    def least(self, gap: FloatArray) -> FloatArray:
        """Least distance along a gap (..., samples, 3), straight between samples."""
        if self.separation.shape == "any-axis":
            found = _box_least(gap, _COARSE)
            # Where it matters, closer: what is between samples counts.
            unsure = (found >= self.step) & (found < (1.0 + _UNSURE) * self.step)
            if unsure.any():
                found[unsure] = _box_least(gap[unsure], _FINE)
            return found
        gap = gap * self.scale
        begin, step = gap[..., :-1, :], np.diff(gap, axis=-2)
        square = np.einsum("...c,...c->...", step, step)
        along = np.einsum("...c,...c->...", begin, step)
        share = np.clip(-along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        least = np.einsum("...c,...c->...", begin, begin)
        least += share * (2.0 * along + share * square)
        return np.asarray(np.sqrt(np.maximum(least.min(axis=-1), 0.0)))


@dataclass(frozen=True, slots=True)
class _Accelerations:
    """What a drone may do, roughly: for prices, not for proofs."""

    level: float
    """Greatest level acceleration [m/s²]."""
    up: float
    down: float
    low: FloatArray
    """Least velocity, shape (3,) [m/s]."""
    top: FloatArray
    """Greatest velocity, shape (3,) [m/s]."""

    @classmethod
    def of(cls, aircraft: Aircraft) -> _Accelerations:
        """Read them off the limits."""
        vehicle, limits = aircraft.vehicle, aircraft.limits
        most = min(limits.thrust_max, vehicle.thrust_max) / vehicle.mass
        tilt = vehicle.gravity * math.tan(limits.tilt)
        return cls(
            max(min(limits.acceleration or np.inf, tilt), 1e-3),
            max(min(limits.acceleration_up or np.inf, most - vehicle.gravity), 1e-3),
            min(limits.acceleration_down or np.inf, vehicle.gravity),
            np.asarray(limits.velocity_min),
            np.asarray(limits.velocity_max),
        )

    def stretch(self, rate: FloatArray, pull: FloatArray) -> FloatArray:
        """Factor by which to slow down flights, at least 1, shape (k,).

        Parameters
        ----------
        rate, pull
            Velocities and accelerations at some instants, shape (k, samples, 3).
        """
        level = np.hypot(pull[..., 0], pull[..., 1]) / self.level
        height = np.maximum(pull[..., 2] / self.up, -pull[..., 2] / self.down)
        use = np.sqrt(np.maximum(level, height).max(axis=-1))
        fast = np.maximum(rate / self.top, rate / self.low).max(axis=(-2, -1))
        return np.asarray(np.maximum(np.maximum(use, fast), 1.0))


def _box_least(gap: FloatArray, parts: int) -> FloatArray:
    """Least maximum norm along a gap (..., samples, 3), at parts of its intervals."""
    begin, step = gap[..., :-1, :], np.diff(gap, axis=-2)
    found = np.full(begin.shape[:-2], np.inf)
    for share in np.arange(parts) / parts:
        place = np.abs(begin + share * step)
        # Axis by axis: NumPy is slow along an axis of three.
        size = np.maximum(place[..., 0], place[..., 1])
        np.minimum(found, np.maximum(size, place[..., 2]).min(-1), out=found)
    return found


class _Search:
    """One search among bumps of some sizes."""

    def __init__(
        self, crowd: _Crowd, sizes: tuple[float, ...], aside: FloatArray | None
    ) -> None:
        self.crowd = crowd
        self.sizes = np.array(sizes) * crowd.step
        self.aside = np.zeros((crowd.lines.shape[0], 3))
        # How near each pair comes on its lines.
        self.lines = self.distance = crowd.distances(self.aside)
        if aside is None:
            # Drones that meet head-on begin with a step to the right of each.
            head_on = self.distance < _HEAD_ON * crowd.separation.distance
            for row in np.union1d(crowd.first[head_on], crowd.second[head_on]).tolist():
                if crowd.moving[row] == 1.0:
                    self.aside[row] = self._bumps(row)[1]
        else:
            self.aside[: aside.shape[0]] = aside
        self.distance = crowd.distances(self.aside)
        self.weight = np.ones(self.distance.size)
        both = np.concatenate([crowd.first, crowd.second])
        order = np.argsort(both, kind="stable")
        self._pair = order % max(self.distance.size, 1)
        self._head = np.searchsorted(both[order], np.arange(crowd.lines.shape[0] + 1))

    @property
    def broken(self) -> int:
        """Pairs that come too near."""
        return int(np.count_nonzero(self.distance < self.crowd.wanted))

    def run(self) -> None:
        """Change one drone's bump after another until all pairs keep apart.

        The best found is kept.
        """
        busy = int(np.count_nonzero(self._blame()))
        waiting = np.zeros(self.aside.shape[0], dtype=np.int64)
        fewest, stalled, best = (
            self.broken,
            0,
            (self.aside.copy(), self.distance.copy()),
        )
        for count in range(_CHANGES * busy):
            blame = np.where(waiting <= count, self._blame(), 0.0)
            row = int(np.argmax(blame))
            if blame[row] <= 0.0:
                if not waiting.any():
                    break
                waiting[:] = 0
            elif not self._improve(row):
                mine = self._pairs_of(row)
                near = self.distance[mine] < self.crowd.wanted[mine]
                self.weight[mine[near]] += 1.0
                waiting[row] = count + 4
            broken, stalled = self.broken, stalled + 1
            if broken < fewest:
                fewest, stalled = broken, 0
                best = self.aside.copy(), self.distance.copy()
            if not broken or stalled > _STALLED * busy:
                break
        self.aside, self.distance = best

    def _pairs_of(self, row: int) -> IntArray:
        return self._pair[self._head[row] : self._head[row + 1]]

    def _cost(self, distance: FloatArray, wanted: FloatArray) -> FloatArray:
        """Price of a pair that comes so near: any breach counts, a deep one more."""
        lack = (wanted - distance) / wanted
        return np.where(lack > 0.0, 0.2 + lack, 0.0)

    def _blame(self) -> FloatArray:
        """Sum of the prices of each drone's pairs if it can move, shape (n,)."""
        crowd = self.crowd
        near = np.flatnonzero(self.distance < crowd.wanted)
        price = self.weight[near] * self._cost(self.distance[near], crowd.wanted[near])
        count = self.aside.shape[0]
        total = np.bincount(crowd.first[near], price, count)
        total += np.bincount(crowd.second[near], price, count)
        return np.where(crowd.moving > 0.0, total, 0.0)

    def _improve(self, row: int) -> bool:
        """Give a drone the bump that costs least; whether that is another one."""
        crowd = self.crowd
        pairs = self._pairs_of(row)
        other = crowd.first[pairs] + crowd.second[pairs] - row
        bumps = np.vstack([self._bumps(row), self.aside[row]])
        size = np.linalg.norm(bumps, axis=1)
        # Others that no bump can bring too near need no look.
        reach = size.max() + np.linalg.norm(self.aside[other], axis=1)
        close = self.lines[pairs] < crowd.wanted[pairs] + reach * crowd.scale.max()
        far, pairs, other = pairs[~close], pairs[close], other[close]
        gap = crowd.lines[row] - crowd.lines[other]
        gap -= crowd.bump * self.aside[other][:, None]
        distance = np.stack([crowd.least(gap + crowd.bump * bump) for bump in bumps])
        wanted, weight = crowd.wanted[pairs], self.weight[pairs]
        price = _PRICE / (crowd.moving[row] * crowd.separation.distance)
        late = crowd.lateness(row, bumps)
        total = self._cost(distance, wanted) @ weight + price * size
        total += _HASTE * np.maximum(late - late[0], 0.0)
        best = int(np.argmin(total))
        if total[best] >= total[-1] - 1e-12:
            return False
        self.aside[row] = bumps[best]
        self.distance[pairs] = distance[best]
        self.distance[far] = np.inf
        return True

    def _bumps(self, row: int) -> FloatArray:
        """Bumps that keep a drone in the volume, none at all first, shape (k, 3).

        The second is the smallest one to the right, or, where the volume ends there,
        to the next side that is free.
        """
        x, y, _ = self.crowd.moves[row]
        level = np.hypot(x, y)
        right = np.array([y, -x, 0.0]) / level if level > _STILL else np.eye(3)[0]
        ahead = np.array([-right[1], right[0], 0.0])
        up = np.eye(3)[2]
        sides = [right, up, -up, -right, ahead, -ahead]
        sides += [np.sqrt(0.5) * (a + b) for a in (up, -up) for b in (right, -right)]
        some = np.multiply.outer(self.sizes, sides).reshape(-1, 3)
        bumps = np.concatenate([np.zeros((1, 3)), some])
        line = self.crowd.lines[row]
        low = line.min(axis=0) + np.minimum(bumps, 0.0)
        top = line.max(axis=0) + np.maximum(bumps, 0.0)
        # A bump that would leave the volume somewhere on the line is left out.
        inside = np.all((low >= self.crowd.low) & (top <= self.crowd.top), axis=1)
        inside[0] = True
        kept = bumps[inside]
        return np.asarray(kept if kept.shape[0] > 1 else np.repeat(kept, 2, axis=0))
