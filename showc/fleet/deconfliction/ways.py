"""Ways round each other: bumps off the straight lines that keep a whole crowd apart.

Every drone follows its straight line on the shared profile, plus a bump by which it
leaves the line and comes back, all bumps on one clock. Which bump each drone takes is a
constraint satisfaction problem with a constraint for each pair. It is searched by
min-conflicts with weights that grow where the search is stuck (Morris 1993, The
breakout method for escaping from local minima). A crowd whose ways keep apart keeps
apart however slowly it flies them, because time only stretches.

The search looks at samples: what is flown is judged in continuous time afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.shared_profile.profile import Profile
from showc.plan.metric import measure
from showc.trajectory import PiecewisePolynomial, restrict

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.vehicle import Limits, Separation


RISES = (0.5, 0.35)
"""Shares of the time in which a bump rises, and falls. The first is one hump, the
gentlest; the second stays aside for a while, for lines that stay near for long."""

SIZES = ((0.5, 1.0), (0.35, 0.6, 1.0, 1.5), (0.5, 1.0, 1.5, 2.0, 3.0, 4.0))
"""Sizes of the bumps that are tried, in separations: few and small ones first. Half a
separation up and half a separation down part a pair."""

_MARGIN = 2e-3
"""How much more than the separation the samples keep, as a share of it: above what the
ways bend between two samples."""

_INSTANTS = 48
"""Intervals between samples of a way: shorter than a separation each on flights of
50 m at 1.5 m."""

_CHANGES = 12
"""Changes allowed for each drone in conflict before other bumps are tried."""

_PRICE, _PRESSED = 0.02, 5.0
"""Price of a bump of one separation, beside that of a breach (0.2 and more), and how
much more it is for a drone that is pressed for time."""

_HEAD_ON = 0.15
"""Share of the separation below which a pair meets head-on: each drone of it begins
with a step to its own right, as the rules of the air have it."""

_PAIRS_AT_ONCE = 4096
"""Bounds the memory of one comparison to some tens of megabytes."""

_STILL = 1e-9
"""A drone that moves less than this hovers, and others fly around it [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """A bump for each drone, on one clock."""

    aside: FloatArray
    """How far each drone leaves its line, and to which side, shape (n, 3) [m]."""
    rise: float
    """Share of the time in which bumps rise, and in which they fall."""
    broken: int
    """Pairs that come too near all the same, as far as samples tell."""

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
        breaks = breaks[np.append(True, np.diff(breaks) > 1e-9 * profile.duration)]
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
    if duration - 2.0 * time > 1e-9 * duration:
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


def find_ways(  # noqa: PLR0917 - geometry of one leg
    start: FloatArray,
    goal: FloatArray,
    parked: FloatArray | None,
    profile: Profile,
    separation: Separation,
    limits: Limits,
    pressed: BoolArray,
) -> Ways | None:
    """Find ways that keep all drones apart, or the most of them.

    Parameters
    ----------
    start, goal
        Shape (n, 3), show frame [m].
    parked
        Positions of drones that stand still, shape (m, 3) [m].
    profile
        Of the straight lines.
    limits
        For the flight volume.
    pressed
        Drones without time for a way round, shape (n,): others go round them.

    Returns
    -------
    Ways or None
        None where no way round exists: with ``all-axes`` drones keep their order on
        each axis.
    """
    if separation.shape == "all-axes":
        return None
    instants = np.linspace(0.0, profile.duration, _INSTANTS + 1)
    along = profile.derivatives()[0](instants)
    lines = start[:, None] + along * (goal - start)[:, None]
    if parked is not None:
        still = np.broadcast_to(parked[:, None], (parked.shape[0], *lines.shape[1:]))
        lines = np.concatenate([lines, still])
    moving = np.zeros(lines.shape[0])
    moving[: start.shape[0]] = np.where(pressed, 1.0 / _PRESSED, 1.0)
    moving[: start.shape[0]][np.linalg.norm(goal - start, axis=1) <= _STILL] = 0.0
    crowd = _Crowd(lines, moving, separation, limits)
    best: Ways | None = None
    for sizes in SIZES:
        for rise in RISES:
            bump = bump_over(profile.duration, rise)(instants)
            search = _Search(crowd, goal - start, bump, sizes)
            search.run()
            found = Ways(search.aside[: start.shape[0]], rise, search.broken)
            if best is None or found.broken < best.broken:
                best = found
            if best.broken == 0:
                return best
    return best


class _Crowd:
    """Lines of all drones at some instants, and the pairs that can meet."""

    def __init__(
        self,
        lines: FloatArray,
        moving: FloatArray,
        separation: Separation,
        limits: Limits,
    ) -> None:
        self.lines, self.moving, self.separation = lines, moving, separation
        self.low = np.asarray(limits.position_min)
        self.top = np.asarray(limits.position_max)
        self.scale = np.asarray(separation.metric_scale)
        wanted = (1.0 + _MARGIN) * separation.distance
        reach = wanted + 2.0 * max(map(max, SIZES)) * separation.distance
        self.first, self.second = self._near(reach)
        ends = lines[self.first][:, [0, -1]] - lines[self.second][:, [0, -1]]
        # No way can keep a pair further apart than it stands at the ends.
        standing = measure(ends, separation).min(axis=1)
        self.wanted = np.minimum(wanted, standing * (1.0 - 1e-6))

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

    def distances(self, bump: FloatArray, aside: FloatArray) -> FloatArray:
        """Least distance of each pair, shape (pairs,) [m], with bumps (n, 3) [m]."""
        found = [np.zeros(0)]
        for top in range(0, self.first.size, _PAIRS_AT_ONCE):
            some = slice(top, top + _PAIRS_AT_ONCE)
            first, second = self.first[some], self.second[some]
            gap = self.lines[first] - self.lines[second]
            gap += bump * (aside[first] - aside[second])[:, None]
            found.append(self.least(gap))
        return np.concatenate(found)

    def least(self, gap: FloatArray) -> FloatArray:
        """Least distance along a gap (..., samples, 3), straight between samples."""
        if self.separation.shape == "any-axis":
            begin, step = gap[..., :-1, :], np.diff(gap, axis=-2)
            found = np.full(begin.shape[:-2], np.inf)
            for share in (0.0, 0.25, 0.5, 0.75):
                place = np.abs(begin + share * step)
                # Axis by axis: NumPy is slow along an axis of three.
                size = np.maximum(place[..., 0], place[..., 1])
                np.minimum(found, np.maximum(size, place[..., 2]).min(-1), out=found)
            return found
        gap = gap * self.scale
        begin, step = gap[..., :-1, :], np.diff(gap, axis=-2)
        square = np.einsum("...c,...c->...", step, step)
        along = np.einsum("...c,...c->...", begin, step)
        share = np.clip(-along / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        least = np.einsum("...c,...c->...", begin, begin)
        least += share * (2.0 * along + share * square)
        return np.asarray(np.sqrt(np.maximum(least.min(axis=-1), 0.0)))


class _Search:
    """One search among bumps of some sizes."""

    def __init__(
        self,
        crowd: _Crowd,
        moves: FloatArray,
        bump: FloatArray,
        sizes: tuple[float, ...],
    ) -> None:
        self.crowd, self.moves, self.bump = crowd, moves, bump
        self.sizes = np.array(sizes) * (1.0 + _MARGIN) * crowd.separation.distance
        self.aside = np.zeros((crowd.lines.shape[0], 3))
        self.distance = crowd.distances(self.bump, self.aside)
        # Drones that meet head-on begin with a step to the right of each.
        head_on = self.distance < _HEAD_ON * crowd.separation.distance
        for row in np.union1d(crowd.first[head_on], crowd.second[head_on]).tolist():
            if crowd.moving[row] > 0.0:
                self.aside[row] = self._bumps(row)[1]
        self.distance = crowd.distances(self.bump, self.aside)
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
        """Change one drone's bump after another until all pairs keep apart."""
        budget = _CHANGES * int(np.count_nonzero(self._blame()))
        waiting = np.zeros(self.aside.shape[0], dtype=np.int64)
        for count in range(budget):
            blame = np.where(waiting <= count, self._blame(), 0.0)
            row = int(np.argmax(blame))
            if blame[row] <= 0.0:
                if not waiting.any():
                    return
                waiting[:] = 0
            elif not self._improve(row):
                mine = self._pairs_of(row)
                near = self.distance[mine] < self.crowd.wanted[mine]
                self.weight[mine[near]] += 1.0
                waiting[row] = count + 4

    def _pairs_of(self, row: int) -> IntArray:
        return self._pair[self._head[row] : self._head[row + 1]]

    def _cost(self, distance: FloatArray, wanted: FloatArray) -> FloatArray:
        """Price of a pair that comes so near: any breach counts, a deep one more."""
        lack = (wanted - distance) / wanted
        return np.where(lack > 0.0, 0.2 + lack, 0.0)

    def _blame(self) -> FloatArray:
        """Sum of the prices of each drone's pairs if it can move, shape (n,)."""
        price = self.weight * self._cost(self.distance, self.crowd.wanted)
        count = self.aside.shape[0]
        total = np.bincount(self.crowd.first, price, count)
        total += np.bincount(self.crowd.second, price, count)
        return np.where(self.crowd.moving > 0.0, total, 0.0)

    def _improve(self, row: int) -> bool:
        """Give a drone the bump that costs least; whether that is another one."""
        crowd = self.crowd
        pairs = self._pairs_of(row)
        other = crowd.first[pairs] + crowd.second[pairs] - row
        bumps = self._bumps(row)
        gap = crowd.lines[row] - crowd.lines[other]
        gap -= self.bump * self.aside[other][:, None]
        distance = np.stack([crowd.least(gap + self.bump * bump) for bump in bumps])
        wanted, weight = crowd.wanted[pairs], self.weight[pairs]
        price = _PRICE / (crowd.moving[row] * crowd.separation.distance)
        size = np.linalg.norm(np.vstack([bumps, self.aside[row]]), axis=1)
        total = self._cost(distance, wanted) @ weight + price * size[:-1]
        now = weight @ self._cost(self.distance[pairs], wanted) + price * size[-1]
        best = int(np.argmin(total))
        if total[best] >= now - 1e-12:
            return False
        self.aside[row] = bumps[best]
        self.distance[pairs] = distance[best]
        return True

    def _bumps(self, row: int) -> FloatArray:
        """Bumps that keep a drone in the volume, none at all first, shape (k, 3).

        The second is the smallest one to the right, or, where the volume ends there,
        to the next side that is free.
        """
        x, y, _ = self.moves[row]
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
