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

from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.conflicts import conflicts
from showc.fleet.deconfliction.neighbours import near_pairs
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.shared_profile.flat import fly, joined, use_of_limits
from showc.fleet.shared_profile.profile import Profile
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.crowd import Crossing
    from showc.fleet.shared_profile.flat import FlatFlights
    from showc.flight import Trajectory
    from showc.trajectory import PiecewisePolynomial


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
_DEGREE = 6
"""Of the flights' positions."""
_WIDEST = 0.12
"""Widest interval of a flight [s]; see :mod:`showc.fleet.deconfliction.changed`."""
_EVEN = 1e-9
"""Share of the separation that samples may lack by rounding."""
_SAMPLED = 100
"""Drones that choose the shape and the pace; all others are then asked."""
_HALVINGS = 9
"""Halvings of the pace: the time is found to a part in 512 of what is searched."""
_SLOWEST = 8.0
"""Time over that of the straight lines beyond which no pace is looked for."""
_ROUNDING = 1e-6
"""How much nearer than the separation a pair may come by rounding [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class WidenedFlights:
    """Flights of all drones that keep apart, and their limits."""

    duration: float
    """[s]."""
    trajectories: tuple[Trajectory, ...]
    """One a drone."""
    widening: float
    """k, 1 for a quarter of a circle."""
    counts: dict[str, float] = field(default_factory=dict)
    """What it took, for the certificate."""

    @property
    def method(self) -> str:
        """How it was found, in words."""
        return f"all on one clock, widening by {self.widening:.3g} of a quarter circle"

    @property
    def bent(self) -> dict[int, PiecewisePolynomial]:
        """Ways that leave their lines, by row."""
        flights = enumerate(self.trajectories) if self.widening else ()
        return {row: flight.state.select(slice(0, 3)) for row, flight in flights}


def fly_widened(crossing: Crossing) -> WidenedFlights | None:
    """Fly a crowd on one clock, as wide as its pairs need.

    Returns
    -------
    WidenedFlights or None
        None if no widening keeps all apart within the flight volume: only possible
        with a fixed assignment, drones that stand in the way, too little room, or a
        separation that is not an ellipsoid.
    """
    for widening in _widenings(crossing):
        aside = _aside(crossing, widening)
        found = None if aside is None else _quickest(crossing, aside)
        if found is None:
            return None
        duration, flights = found
        trajectories = tuple(
            flights.trajectory(row) for row in range(crossing.start.shape[0])
        )
        separation = crossing.separation
        near = conflicts(
            tracks_of(trajectories, crossing.parked),
            separation,
            separation.distance - _ROUNDING,
        )
        if not len(near):
            return WidenedFlights(duration, trajectories, widening)
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


def _quickest(
    crossing: Crossing, aside: FloatArray
) -> tuple[float, FlatFlights] | None:
    """Fly it on the clock, of some shapes, on which all take least."""
    size = np.linalg.norm(crossing.goal - crossing.start, axis=1)
    size = size + np.linalg.norm(aside, axis=1)
    sample = np.sort(np.argsort(-size, kind="stable")[:_SAMPLED])
    every = np.arange(size.size)
    base = crossing.profile.duration
    own = crossing.profile.phase / base, crossing.profile.ramp / base
    best: tuple[float, float, float] | None = None
    for phase, ramp in (own, *_SHAPES):
        profile = Profile(base, phase * base, ramp * base)
        time = _least_time(crossing, aside, profile, sample, best)
        if time is not None and (best is None or time < best[0]):
            best = time, phase, ramp
    if best is None:
        return None
    time, phase, ramp = best
    while time <= _SLOWEST * base:
        duration = float(np.ceil(1000.0 * time)) / 1000.0
        profile = Profile(duration, phase * duration, ramp * duration)
        flights = _flown(crossing, aside, profile, every)
        if _kept(crossing, flights):
            return (duration, flights) if joined(flights).all() else None
        time *= 1.01
    return None


def _least_time(
    crossing: Crossing,
    aside: FloatArray,
    profile: Profile,
    rows: IntArray,
    best: tuple[float, float, float] | None,
) -> float | None:
    """Least time in which some drones keep their limits on a clock of one shape [s]."""

    def kept(time: float) -> bool:
        flights = _flown(crossing, aside, profile.stretched(time), rows)
        return _kept(crossing, flights)

    low, high = 0.5 * profile.duration, profile.duration
    if best is not None:
        high = best[0]
        if not kept(high):
            return None
    while not kept(high):
        low, high = high, 1.5 * high
        if high > _SLOWEST * profile.duration:
            return None
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if kept(middle) else (middle, high)
    return high


def _kept(crossing: Crossing, flights: FlatFlights) -> bool:
    aircraft = crossing.aircraft
    use = use_of_limits(aircraft.vehicle, aircraft.limits, flights)
    return bool(np.all(use.greatest <= 1.0))


def _flown(
    crossing: Crossing, aside: FloatArray, profile: Profile, rows: IntArray
) -> FlatFlights:
    start, goal = crossing.start[rows], crossing.goal[rows]
    line = profile.derivatives()[0]
    breaks, along, across = _laid(line)
    position = start[:, None, None] + along * (goal - start)[:, None, None]
    position += across * aside[rows, None, None]
    # Not start + (goal - start), which rounds.
    position[:, 0, :4], position[:, -1, -4:] = start[:, None], goal[:, None]
    aircraft = crossing.aircraft
    return fly(aircraft.vehicle, aircraft.heading, breaks, position)


def _laid(
    line: PiecewisePolynomial,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lay s and w(s) out in time: breaks [s], coefficients, (K, 7, 1)."""
    parts = np.ceil(np.diff(line.breaks) / _WIDEST).astype(np.int64)
    breaks = np.concatenate(
        [
            left + (right - left) * np.arange(count) / count
            for left, right, count in zip(
                line.breaks[:-1], line.breaks[1:], parts.tolist(), strict=True
            )
        ]
        + [line.breaks[-1:]]
    )
    share = line.split(breaks[1:-1]).elevated(_DEGREE).coefficients
    ends = [0, -1]
    width = np.diff(breaks)[:, None]
    rate = _DEGREE * np.diff(share[..., 0], axis=1)[:, ends] / width
    pull = np.diff(share[..., 0], n=2, axis=1)[:, ends]
    pull *= _DEGREE * (_DEGREE - 1) / width**2
    w, w1, w2 = _width(share[:, ends, 0])
    speed, change = w1 * rate, w2 * rate**2 + w1 * pull
    across = np.zeros_like(share)
    for end, sign, order in ((0, 1.0, (0, 1, 2)), (1, -1.0, (6, 5, 4))):
        step = sign * width[:, 0] * speed[:, end] / _DEGREE
        bend = width[:, 0] ** 2 * change[:, end] / (_DEGREE * (_DEGREE - 1))
        across[:, order[0], 0] = w[:, end]
        across[:, order[1], 0] = w[:, end] + step
        across[:, order[2], 0] = w[:, end] + 2.0 * step + bend
    # In the middle a quintic's, raised; at both ends of all the jerk is zero.
    outer, inner = across[:, [0, 6]].sum(axis=1), across[:, [1, 5]].sum(axis=1)
    across[:, 3] = (outer - 6.0 * inner + 15.0 * across[:, [2, 4]].sum(axis=1)) / 20.0
    across[[0, -1], 3] = 0.0
    return breaks, share, across
