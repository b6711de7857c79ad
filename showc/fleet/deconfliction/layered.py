"""A crowd in layers: flights in closed form for every assignment, with a guarantee.

The crowd spreads out across a direction until no two places lie nearer to each other
across it than the separation. Then each drone moves along that direction, into its
layer. There all fly straight to above their goals, and back the same way. Layers are
colours of the graph of pairs that meet on these straight ways (Brelaz 1979), and lie a
separation apart. So

- while the crowd spreads, all distances grow;
- while drones change heights, they are far enough apart across the direction;
- while they fly across, no two of one layer meet, and others are in other layers.

Where the three follow each other that is a proof, wherever the volume has the room:
n layers are enough for n drones. As much of them happens at once as samples of all
pairs allow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.clock import (
    Curves,
    Pattern,
    fly_apart,
    laid_out,
    product_of,
)
from showc.fleet.deconfliction.layers import layers
from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.shared_profile.profile import Profile
from showc.fleet.shared_profile.synchronise import shared_profile
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.clock import ClosedFlights
    from showc.fleet.deconfliction.crowd import Crossing


_BEYOND = 2e-3
"""How much more than the separation layers and ways keep, as a share; samples half."""
_DIRECTIONS = 48
"""Directions that are tried besides the axes."""
_BEST = 3
"""Of those with room, the ones that are laid out: they spread the crowd least."""
_HALVINGS = 4
"""Halvings of the time between the move into layers and the way."""
_SAMPLES = 80
"""Instants at which pairs are looked at, over half of the time."""
_JUMP = 0.5
"""Share of the time that a ramp should take, below which it is a jump of thrust."""
_EVEN = 1e-9
"""Difference of places that is rounding [m]."""
_BLOCK = 2_000_000
"""Pairs that are looked at together: bounds the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Where all drones are asked to be on their way, n of them."""

    stages: FloatArray
    """Moves to a drone's layer, one after the other, from its start and from its goal,
    shape (k, 2, n, 3) [m]."""
    layers: int
    """How many there are."""
    rises: tuple[Profile, ...]
    """On which all can make each of the moves."""

    @property
    def rising(self) -> float:
        """Time that all moves take, one after the other [s]."""
        return sum(one.duration for one in self.rises)


def fly_layered(crossing: Crossing, most: float = np.inf) -> ClosedFlights | None:
    """Fly a crowd through layers, all drones on one clock.

    Parameters
    ----------
    most
        Time from which on a flight is of no use [s].

    Returns
    -------
    ClosedFlights or None
        None if the flight volume has no room for it, the moves into layers and back
        take longer, the separation is one along all axes, or drones that stand in the
        way are in the way here as well.
    """
    if crossing.separation.shape == "all-axes":
        return None
    for layout in sorted(_layouts(crossing), key=lambda one: one.rising):
        if 2.0 * layout.rising >= most:
            break
        for pattern in _apart(crossing, layout):
            found = fly_apart(crossing, [pattern])
            if found is not None:
                return replace(found, layers=layout.layers)
    return None


def _apart(crossing: Crossing, layout: Layout) -> Iterator[Pattern]:
    """Yield patterns that keep apart as far as samples tell, the quickest first.

    In the last one moves follow each other, so that it does surely.
    """
    ramp = max(one.ramp for one in layout.rises)
    base, rise = _eased(crossing.profile, ramp), layout.rising
    out, back = layout.stages[:, 0], layout.stages[:, 1]
    moves = np.stack([out, back - out], axis=1).reshape(-1, *crossing.start.shape)
    vectors = np.concatenate([(crossing.goal - crossing.start)[None], moves])
    early, late, patterns = 0.0, 2.0, []
    for _ in range(_HALVINGS + 1):
        share = 0.5 * (early + late)
        duration = max(base.duration + 2.0 * share * rise, 2.0 * rise)
        curves = partial(_curves, base, layout.rises, duration, share * rise)
        pattern = Pattern(vectors, curves, duration)
        if _keeps_apart(crossing, pattern):
            patterns.append(pattern)
            late = share
        elif patterns:
            early = share
        else:
            return
    yield from patterns[::-1]


def _curves(
    base: Profile,
    rises: tuple[Profile, ...],
    nominal: float,
    begun: float,
    duration: float,
) -> Curves:
    """Return the share of the way, then that of each move, and their product.

    Parameters
    ----------
    nominal
        Time of the whole in which each part takes what it takes alone [s].
    begun
        When the way begins then [s].
    """
    pace = duration / nominal
    late = pace * begun
    straight = base.stretched(duration - 2.0 * late)
    line = straight.derivatives()
    moves, breaks, at = [], [line[0].breaks + late], 0.0
    for one in rises:
        rise = one.stretched(pace * one.duration).derivatives()
        moves.append((at, rise))
        breaks += [at + rise[0].breaks, duration - at - rise[0].breaks]
        at += pace * one.duration
    times = laid_out(duration, *breaks)
    own = np.clip(times - late, 0.0, straight.duration)
    way = np.stack([part(own)[:, 0] for part in line])
    curves = [way]
    for since, rise in moves:
        # They come back as they went.
        ago = np.minimum(times, duration - times) - since
        ago = np.clip(ago, 0.0, rise[0].end)
        move = np.stack([part(ago)[:, 0] for part in rise])
        move[1] *= np.where(times > 0.5 * duration, -1.0, 1.0)
        curves += [move, product_of(way, move)]
    return Curves(times, np.stack(curves))


def _keeps_apart(crossing: Crossing, pattern: Pattern) -> bool:
    """Whether all pairs keep apart, motion between samples taken as straight."""
    separation = crossing.separation
    scale = np.asarray(separation.metric_scale)
    norm = np.inf if separation.shape == "any-axis" else 2.0
    curves = pattern.curves(pattern.duration)
    at = np.linspace(0.0, pattern.duration, 2 * _SAMPLES + 1)
    share = np.stack([np.interp(at, curves.breaks, one[0]) for one in curves.values])
    before = crossing.start * scale
    ends = (crossing.start, crossing.goal)
    for k in range(1, at.size):
        aside = np.einsum("c,cna->na", share[:, k], pattern.vectors)
        after = (crossing.start + aside) * scale
        half = 0.5 * float(np.linalg.norm(after - before, axis=1).max())
        middle = 0.5 * (before + after)
        first, second = near_pairs(middle, separation.distance + 2.0 * half, norm)
        gap = before[first] - before[second]
        motion = after[first] - after[second] - gap
        size = np.einsum("pa,pa->p", motion, motion)
        along = -np.einsum("pa,pa->p", gap, motion)
        part = np.clip(along / np.where(size > 0.0, size, 1.0), 0.0, 1.0)
        near = np.linalg.norm(gap + part[:, None] * motion, ord=norm, axis=1)
        wanted = np.full(near.size, separation.distance * (1.0 + 0.5 * _BEYOND))
        for end in ends:
            stood = measure(end[first] - end[second], separation)
            np.minimum(wanted, stood * (1.0 - 1e-6), out=wanted)
        if np.any(near < wanted):
            return False
        before = after
    return True


def _layouts(crossing: Crossing) -> Iterator[Layout]:
    """Yield layouts in the directions across which the crowd has to spread least."""
    scale = np.asarray(crossing.separation.metric_scale)
    distance = crossing.separation.distance * (1.0 + _BEYOND)
    if crossing.separation.shape == "any-axis":
        # As far apart as that, one axis is enough in whatever direction.
        distance *= np.sqrt(3.0)
    ends = np.stack([crossing.start, crossing.goal]) * scale
    tried: list[tuple[float, int, FloatArray, list[float]]] = []
    for normal in _normals():
        flat = _flattened(ends, normal)
        spread = [max(0.0, distance / _nearest(points) - 1.0) for points in flat]
        reach = [
            more * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
            for more, points in zip(spread, flat, strict=True)
        ]
        tried.append((max(reach), len(tried), normal, spread))
    tried.sort(key=lambda one: one[:2])
    found = (
        _layout(crossing, ends, normal, spread, distance)
        for _, _, normal, spread in tried
    )
    yield from islice((one for one in found if one is not None), _BEST)


def _normals() -> FloatArray:
    """Directions that are tried, shape (m, 3): the axes, upward first, and others."""
    place = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_DIRECTIONS)
    level = np.sqrt(1.0 - place**2)
    even = np.stack([level * np.cos(turn), level * np.sin(turn), place], axis=1)
    return np.concatenate([np.eye(3)[::-1], even])


def _flattened(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Return points without what lies along a direction."""
    return np.asarray(points - (points @ normal)[..., None] * normal)


def _nearest(points: FloatArray) -> float:
    """Least distance of two of the points [m]; never zero."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - for crowds alone

    found, _ = cKDTree(points).query(points, k=2)
    return max(float(found[:, 1].min()), _EVEN)


def _layout(
    crossing: Crossing,
    ends: FloatArray,
    normal: FloatArray,
    spread: list[float],
    distance: float,
) -> Layout | None:
    """Lay drones out across a direction; None if the volume has no room for that.

    Parameters
    ----------
    ends
        Starts and goals, metric, shape (2, n, 3).
    spread
        By how much more the crowd spreads at either end.
    """
    scale = np.asarray(crossing.separation.metric_scale)
    flat = _flattened(ends, normal)
    wide = flat - flat.mean(axis=1, keepdims=True)
    out = np.asarray(spread)[:, None, None] * wide
    along = ends @ normal
    layer = layers(
        along.mean(axis=0), *_meeting(flat[0] + out[0], flat[1] + out[1], distance)
    )
    middle = 0.5 * (along.max() + along.min())
    into = (distance * layer + middle - along)[..., None] * normal
    # All move on until they are inside, those of both ends as far along the direction.
    limits = crossing.aircraft.limits
    low = np.asarray(limits.position_min) * scale
    high = np.asarray(limits.position_max) * scale
    there = ends + out + into
    shift = np.maximum(low - there.min(axis=1), 0.0)
    shift += np.minimum(high - there.max(axis=1), 0.0)
    further = shift @ normal
    out += _flattened(shift, normal)[:, None]
    into += further[np.argmax(np.abs(further))] * normal
    for places in (ends + out, ends + out + into):
        if np.any(places < low - _EVEN) or np.any(places > high + _EVEN):
            return None
    moves = [move / scale for move in (out, into) if np.abs(move).max() > _EVEN]
    if not moves:
        # None meet on straight ways, which need no layers.
        return None
    rises = tuple(_rise(crossing, move) for move in moves)
    return Layout(np.stack(moves), int(np.ptp(layer)) + 1, rises)


def _rise(crossing: Crossing, move: FloatArray) -> Profile:
    """Find the profile on which all drones make their moves at both ends."""
    aircraft = crossing.aircraft
    way = np.concatenate([move[0], -move[1]])
    quickest = shared_profile(
        aircraft.vehicle, aircraft.limits, aircraft.heading, np.zeros_like(way), way
    )
    return _eased(quickest, crossing.profile.ramp)


def _eased(profile: Profile, ramp: float) -> Profile:
    """Return a profile of the same acceleration and speed, with ramps of a time [s].

    Straight up thrust may jump. While a drone leans, such a jump turns the direction of
    its thrust, which takes as long as on level ways.
    """
    pull, speed = profile.acceleration, profile.speed
    ramp = min(ramp, np.sqrt(0.5 / pull), speed / pull)
    if profile.ramp >= _JUMP * ramp:
        return profile
    phase = 0.5 * (ramp + np.sqrt(ramp**2 + 4.0 / pull))
    if phase * speed >= 1.0:
        return Profile(2.0 * phase, phase, ramp)
    phase = ramp + speed / pull
    return Profile(phase + 1.0 / speed, phase, ramp)


def _meeting(
    start: FloatArray, goal: FloatArray, distance: float
) -> tuple[IntArray, IntArray]:
    """Pairs that come nearer to each other than a distance on straight lines."""
    count = start.shape[0]
    firsts, seconds = [], []
    rows = max(1, _BLOCK // count)
    for top in range(0, count, rows):
        ahead = np.arange(top, min(top + rows, count))
        gap = start[ahead, None] - start
        motion = goal[ahead, None] - goal - gap
        size = np.einsum("mna,mna->mn", motion, motion)
        along = -np.einsum("mna,mna->mn", gap, motion)
        share = np.clip(along / np.where(size > 0.0, size, 1.0), 0.0, 1.0)
        near = gap + share[..., None] * motion
        square = np.einsum("mna,mna->mn", near, near)
        one, other = np.nonzero(square < distance**2)
        kept = ahead[one] < other
        firsts.append(ahead[one[kept]])
        seconds.append(other[kept])
    return np.concatenate(firsts), np.concatenate(seconds)
