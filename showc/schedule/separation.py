"""Separation of predicted flights, over all times and all delays.

A drone's delay is only known to within a spread s. Progress along a leg is monotone in
the law's time, and that in the time t. So over the times [a, b] the drone is exactly on
the part of its straight leg between the law's places at law_time(a) - s and law_time(b)
+ s; the latter goes on beyond the end by the overshoot, until the drone has settled.
The distance of two such parts bounds the distance of the pair from below. At a single
time it is the least distance that any two delays give. From there it changes no faster
than the pair's greatest relative speed. Branch and bound over time makes both ends
meet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.following import SETTLING, SLOWEST, law_time
from showc.flight import Encounter
from showc.schedule.distances import dot, near_pairs, nearest_pair, part_distance

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.autopilot.s_curve import LegProfile
    from showc.vehicle import Separation


TOLERANCE = 2e-3
"""How far below the true least distance the proved one may lie [m]."""

FIRST_PIECES = 8
"""Pieces of the window that a pair is looked at in first."""

BLOCK = 400_000
"""Pairs handled at once: bounds the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What every drone of the fleet does during a stretch of time."""

    begin: FloatArray
    """Start of each one's leg, shape (n, 3), show frame [m]."""
    end: FloatArray
    """End of it; equal to ``begin`` for a drone at rest."""
    profile: LegProfile
    """Progress of each, of length 0 for a drone at rest."""
    start: FloatArray
    """Mission time at which each leg is released, shape (n,) [s]."""
    level: FloatArray
    """Horizontal part of each leg's direction, shape (n,): how late it is followed."""
    spread: FloatArray
    """How much more or less than that the delay may be, shape (n,) [s]; inf: the leg
    may be anywhere at any time."""
    overshoot: FloatArray
    """How far beyond its end each one may be, shape (n,) [m]: the foremost place goes
    on by it in the measure of the leg covered."""
    window: tuple[float, float]
    """First and last instant looked at, mission time [s]."""

    @property
    def stretch(self) -> FloatArray:
        """Way to the foremost end over length of the leg, shape (n,), at least 1."""
        length = self.profile.length
        return np.asarray(1.0 + self.overshoot / np.where(length > 0.0, length, np.inf))


def closest_encounter(
    motion: Motion,
    separation: Separation,
    *,
    enough: float = -np.inf,
    plenty: float = np.inf,
) -> Encounter | None:
    """Return the nearest encounter of ``motion``; None when no drone moves.

    Pairs that both rest are left out. The search ends early, with a valid encounter
    but not the nearest, as soon as one nearer than ``enough`` [m] is found. A
    pair that is proved to stay ``plenty`` [m] apart is not looked at more closely.
    """
    moving = np.any(motion.begin != motion.end, axis=1)
    if motion.begin.shape[0] < 2 or not np.any(moving):
        return None
    best = _nearest_at_ends(motion, separation, moving)
    if best.distance < enough:
        return best
    everywhere = np.nextafter(best.distance, np.inf)
    farthest = motion.begin + motion.stretch[:, None] * (motion.end - motion.begin)
    a, b = near_pairs((motion.begin, farthest), separation, everywhere, moving)
    bound = part_distance(
        (motion.begin[a], farthest[a]), (motion.begin[b], farthest[b]), separation
    )
    near = bound < everywhere
    a, b = a[near], b[near]
    return _branch_and_bound(motion, separation, (a, b), best, (enough, plenty))


def _branch_and_bound(
    motion: Motion,
    separation: Separation,
    pairs: tuple[IntArray, IntArray],
    best: Encounter,
    limits: tuple[float, float],
) -> Encounter:
    """Refine ``best`` over the ``pairs`` that could come nearer.

    Down to the first, and up to the second of the ``limits`` [m].
    """
    enough, plenty = limits
    pieces = FIRST_PIECES
    a, b = (np.repeat(drones, pieces) for drones in pairs)
    piece = np.tile(np.arange(pieces), pairs[0].size)
    first, last = motion.window
    while a.size:
        width = (last - first) / pieces
        bound, value = _examine(
            motion, separation, (a, b), piece, width, best=best.distance
        )
        least = int(np.argmin(value))
        if value[least] < best.distance:
            best = Encounter(
                int(a[least]),
                int(b[least]),
                first + (float(piece[least]) + 0.5) * width,
                float(value[least]),
            )
        if best.distance < enough:
            break
        # A piece is done once it cannot hold anything nearer by the tolerance.
        left = bound < min(best.distance - TOLERANCE, plenty)
        a, b = np.repeat(a[left], 2), np.repeat(b[left], 2)
        piece = np.repeat(2 * piece[left], 2)
        piece[1::2] += 1
        pieces *= 2
    return Encounter(
        min(best.drone_a, best.drone_b),
        max(best.drone_a, best.drone_b),
        best.time,
        max(min(best.distance - TOLERANCE, plenty), 0.0),
    )


def _examine(
    motion: Motion,
    separation: Separation,
    pairs: tuple[IntArray, IntArray],
    piece: IntArray,
    width: float,
    *,
    best: float,
) -> tuple[FloatArray, FloatArray]:
    """Lower bounds over pieces of time and least distances in their middles.

    Piece k is ``width`` [s] long and starts k widths into the window; all arrays have
    shape (m,). Pairs that stay farther apart than ``best`` [m] are not looked at more
    closely: their distance in the middle stands as infinite.
    """
    a, b = pairs
    count = int(piece.max()) + 1
    keys = np.concatenate([a, b]) * count + np.concatenate([piece, piece])
    # A drone is in many pairs: its part of a piece is worked out once.
    unique, place = np.unique(keys, return_inverse=True)
    reach = _reach(motion, unique // count, unique % count, width)
    bounds, values = np.empty(a.size), np.full(a.size, np.inf)
    for top in range(0, a.size, BLOCK):
        rows = slice(top, min(top + BLOCK, a.size))
        one, other = place[: a.size][rows], place[a.size :][rows]
        bounds[rows] = part_distance(
            (reach.first[one], reach.last[one]),
            (reach.first[other], reach.last[other]),
            separation,
        )
    close = np.flatnonzero(bounds < best)
    one, other = place[: a.size][close], place[a.size :][close]
    values[close] = value = part_distance(
        (reach.back[one], reach.front[one]),
        (reach.back[other], reach.front[other]),
        separation,
    )
    closing = _relative_speed(reach, one, other, separation)
    # Settling is a jump: no speed bounds what was before it.
    settles = reach.settles[one] | reach.settles[other]
    sharp = np.maximum(bounds[close], value - 0.5 * width * closing)
    bounds[close] = np.where(settles, bounds[close], sharp)
    return bounds, values


@dataclass(frozen=True, slots=True, eq=False)
class _Reach:
    """Where drones can be during pieces of time; shapes (m, 3) and (m,)."""

    first: FloatArray
    """Rearmost place in the piece."""
    last: FloatArray
    """Foremost place in the piece."""
    back: FloatArray
    """Rearmost place at its middle."""
    front: FloatArray
    """Foremost place at its middle."""
    settles: BoolArray
    """Whether the drone settles in the first half of the piece, (m,)."""
    direction: FloatArray
    """Of the leg, show metres for each of the autopilot's."""
    slow: FloatArray
    """Least speed [m/s]."""
    fast: FloatArray
    """Greatest speed [m/s]."""


def _reach(motion: Motion, drone: IntArray, piece: IntArray, width: float) -> _Reach:
    """Work out where ``drone`` can be during ``piece``, both (m,)."""
    profile = motion.profile.select(drone)
    since = motion.window[0] - motion.start[drone] + piece * width
    level, spread = motion.level[drone], motion.spread[drone]
    late = law_time(level, since) - spread
    middle = law_time(level, since + 0.5 * width)
    early = law_time(level, since + width) + spread
    begin = motion.begin[drone]
    along = motion.end[drone] - begin
    settled = profile.duration + SETTLING
    stretch = np.where(late < settled, motion.stretch[drone], 1.0)
    settles = (late < settled) & (middle - spread >= settled)
    # The speed rises, stays and falls: least at an end, greatest next to the middle.
    peak = np.clip(0.5 * profile.duration, late, early)
    times = np.stack([late, middle - spread, middle + spread, early, peak])
    distance, speed, _ = profile.motion(times)
    length = np.where(profile.length > 0.0, profile.length, 1.0)
    part = distance / length
    first, back = (begin + share[:, None] * along for share in part[:2])
    front = begin + np.where(settles, 1.0, stretch * part[2])[:, None] * along
    last = begin + (stretch * part[3])[:, None] * along
    return _Reach(
        first,
        last,
        back,
        front,
        settles,
        along / length[:, None],
        SLOWEST * np.minimum(speed[0], speed[3]),
        stretch * speed[4],
    )


def _relative_speed(
    reach: _Reach, one: IntArray, other: IntArray, separation: Separation
) -> FloatArray:
    """Upper bound (m,) of the pairs' relative speed, in the separation's metric [m/s].

    The speed of a difference of velocities is convex in both speeds: greatest at a
    corner of their intervals.
    """
    scale = np.array(separation.metric_scale)
    first, second = reach.direction[one] * scale, reach.direction[other] * scale
    greatest = np.zeros(one.size)
    for speed_a in (reach.slow[one], reach.fast[one]):
        for speed_b in (reach.slow[other], reach.fast[other]):
            gap = speed_a[:, None] * first - speed_b[:, None] * second
            greatest = np.maximum(greatest, dot(gap, gap))
    return np.asarray(np.sqrt(greatest))


def _nearest_at_ends(
    motion: Motion, separation: Separation, moving: BoolArray
) -> Encounter:
    """Nearest pair at the window's first and last instant, all as late as expected."""
    length = np.where(motion.profile.length > 0.0, motion.profile.length, 1.0)
    found = []
    for time in motion.window:
        since = law_time(motion.level, time - motion.start)
        part = motion.profile.distance(since) / length
        places = motion.begin + part[:, None] * (motion.end - motion.begin)
        there = np.where(part[:, None] < 1.0, places, motion.end)
        one, other, distance = nearest_pair(there, separation, moving)
        found.append(Encounter(one, other, time, distance))
    before, after = found
    return after if after.distance < before.distance else before
