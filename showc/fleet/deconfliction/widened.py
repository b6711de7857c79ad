"""A crowd that widens half-way: flights in closed form, with a guarantee.

Let the assignment minimise the sum of squared distances. On straight lines that all
drones share, a pair at ``(1 - s) dp + s dq`` then draws nearer by a factor of the
square root of two at most: then ``dp . dq >= 0`` for every pair, since exchanging its
goals gains nothing (Turpin, Michael, Kumar 2014, section III). Here every drone leaves
its line by ``k w(s) (p + q - 2 c)``, c common to all, so that pairs are at

    A dp + B dq,   A = 1 - s + k w,   B = s + k w.

With k = 1 and ``A² + B² = 1`` at every s, that is never nearer than the pair's nearer
end: ``A² dp² + B² dq² + 2 A B dp . dq >= min(dp², dq²)``. It holds in every metric that
comes from an inner product, the ellipsoid's as well. Less widening often is enough: k
is the least that parts all pairs. The common point cancels from all distances; it is
chosen so that all drones stay in the flight volume.

All drones share one clock, which is slowed down until each keeps its limits. The limits
are thus kept, the separation by the above, and what is returned is judged in continuous
time besides.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.clock import Curves, Pattern, fly_apart, laid_out
from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.shared_profile.profile import Profile
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.clock import ClosedFlights
    from showc.fleet.deconfliction.crowd import Crossing


_BEND = 4.0 - 8.0 * (np.sqrt(2.0) - 1.0)
"""Of ``w = u (1 - _BEND u)`` with ``u = s (1 - s)``: at the middle it is the circle's
(A² + B² = 1), elsewhere a little more."""
_SURELY = 1e-3
"""How much more than the circle flights widen, as a share: what interpolating takes."""
_SAMPLES = 64
"""Intervals between samples of s at which pairs are looked at."""
_SHARES = (0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0, 1.25, 1.5, 2.0)
"""Values of k that are tried. Beyond 1 nothing is guaranteed: for assignments that the
script fixes."""
_CENTRES = sorted(
    product((0.0, 0.5, -0.5, 1.0, -1.0, 2.0, -2.0), repeat=2),
    key=lambda at: at[0] ** 2 + at[1] ** 2,
)
"""Places of c that are tried, from the middle of all and in half-widths of it."""
_SHAPES = ((0.5, 0.2), (0.5, 0.35), (0.35, 0.14), (0.25, 0.08), (0.15, 0.05))
"""Shapes of the clock that are tried: phase / T and ramp / T."""
_EVEN = 1e-9
"""Share of the separation that samples may lack by rounding."""


def fly_widened(crossing: Crossing) -> ClosedFlights | None:
    """Fly a crowd on one clock, as wide as its pairs need.

    Returns
    -------
    ClosedFlights or None
        None if no widening keeps all apart within the flight volume: only possible
        with a fixed assignment, drones that stand in the way, too little room, or a
        separation that is not an ellipsoid.
    """
    for widening in _widenings(crossing):
        aside = _aside(crossing, widening)
        if aside is None:
            return None
        found = fly_apart(crossing, _patterns(crossing, aside))
        if found is not None:
            return replace(found, widening=widening)
    return None


def _width(share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far the crowd widens at s, w, and its derivatives by s."""
    u, v = share * (1.0 - share), 1.0 - 2.0 * share
    more = 1.0 + _SURELY
    return (
        more * u * (1.0 - _BEND * u),
        more * v * (1.0 - 2.0 * _BEND * u),
        more * (-2.0 * (1.0 - 2.0 * _BEND * u) - 2.0 * _BEND * v * v),
    )


def _widenings(crossing: Crossing) -> Iterator[float]:
    """Yield k at which samples keep all pairs apart, the least first."""
    start, goal = crossing.start, crossing.goal
    if crossing.parked is not None and len(crossing.parked):
        # They widen with no crowd.
        start = np.concatenate([start, crossing.parked])
        goal = np.concatenate([goal, crossing.parked])
    first, second = _crossing_pairs(crossing, start, goal)
    share = np.linspace(0.0, 1.0, _SAMPLES + 1)[:, None]
    before, after = start[first] - start[second], goal[first] - goal[second]
    lines = (1.0 - share) * before[:, None] + share * after[:, None]
    aside = _width(share)[0] * (before + after)[:, None]
    for widening in _SHARES:
        distance = measure(lines + widening * aside, crossing.separation)
        ends = distance[:, [0, -1]].min(axis=1)
        wanted = np.minimum(crossing.separation.distance, ends) * (1.0 - _EVEN)
        if np.all(distance.min(axis=1, initial=np.inf) >= wanted):
            yield widening


def _crossing_pairs(
    crossing: Crossing, start: FloatArray, goal: FloatArray
) -> tuple[IntArray, IntArray]:
    """Pairs that come too near on straight lines, and some more."""
    separation = crossing.separation
    scale, count = np.asarray(separation.metric_scale), start.shape[0]
    norm = np.inf if separation.shape == "any-axis" else 2.0
    longest = float((np.abs(goal - start) * scale).sum(axis=1).max())
    reach = separation.distance
    # Between samples a pair moves by less than this.
    samples = int(np.clip(np.ceil(4.0 * longest / reach), 8, 4 * _SAMPLES))
    reach += longest / samples
    keys = []
    for share in np.linspace(0.0, 1.0, samples + 1).tolist():
        points = ((1.0 - share) * start + share * goal) * scale
        first, second = near_pairs(points, reach, norm)
        keys.append(np.minimum(first, second) * count + np.maximum(first, second))
    pairs = np.unique(np.concatenate(keys))
    return pairs // count, pairs % count


def _aside(crossing: Crossing, widening: float) -> FloatArray | None:
    """By how much of w each drone leaves its line, (n, 3) [m]; None without room."""
    start, goal = crossing.start, crossing.goal
    if not widening:
        return np.zeros_like(start)
    limits = crossing.aircraft.limits
    share = np.linspace(0.0, 1.0, _SAMPLES + 1)[1:-1, None, None]
    width = widening * _width(share)[0]
    lines = (1.0 - share) * start + share * goal + width * (start + goal)
    low, top = np.asarray(limits.position_min), np.asarray(limits.position_max)
    least = ((lines - top) / (2.0 * width)).max(axis=(0, 1))
    most = ((lines - low) / (2.0 * width)).min(axis=(0, 1))
    if np.any(least > most):
        return None
    ends = start + goal
    half = 0.25 * (ends.max(axis=0) - ends.min(axis=0))
    middle = 0.5 * ends.min(axis=0) + half
    for share_x, share_y in _CENTRES:
        centre = middle + half * np.array([share_x, share_y, 0.0])
        centre = np.clip(centre, least, most)
        places = (lines - 2.0 * width * centre)[..., :2].reshape(-1, 2)
        if crossing.fence is None or crossing.fence.keeps(places).all():
            return np.asarray(widening * (ends - 2.0 * centre))
    return None


def _patterns(crossing: Crossing, aside: FloatArray) -> Iterator[Pattern]:
    """Yield the flights on clocks of some shapes."""
    base = crossing.profile.duration
    own = crossing.profile.phase / base, crossing.profile.ramp / base
    vectors = np.stack([crossing.goal - crossing.start, aside])
    for phase, ramp in (own, *_SHAPES):
        profile = Profile(base, phase * base, ramp * base)
        yield Pattern(vectors, partial(_curves, profile), base)


def _curves(profile: Profile, duration: float) -> Curves:
    """Return s and w(s) over a time [s]."""
    line = profile.stretched(duration).derivatives()
    breaks = laid_out(duration, line[0].breaks)
    share, rate, pull = (part(breaks)[:, 0] for part in line)
    w, w1, w2 = _width(share)
    width = np.stack([w, w1 * rate, w2 * rate**2 + w1 * pull])
    return Curves(breaks, np.stack([np.stack([share, rate, pull]), width]))
