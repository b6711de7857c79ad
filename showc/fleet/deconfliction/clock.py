"""Flights of a crowd that shares one clock, in closed form.

Every drone is at its start plus a sum of vectors of its own, each times a curve that
all share: the fraction of the way, how far the crowd has widened, whether it stands in
layers. Which pairs come too near depends on the curves' shape alone, never on how long
they take. So the clock is slowed down until every drone keeps its limits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.conflicts import conflicts
from showc.fleet.deconfliction.flights import Ways
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.shared_profile.flat import fly, joined, use_of_limits
from showc.script.lanes import whole_milliseconds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.deconfliction.crowd import Crossing
    from showc.fleet.shared_profile.flat import FlatFlights
    from showc.flight import Trajectory


_DEGREE = 6
"""Of the flights' positions."""
_WIDEST, _NEAREST = 0.12, 0.005
"""Widest interval of a flight [s]; see :mod:`showc.fleet.deconfliction.changed`; and
breaks nearer each other than this are one."""
_SAMPLED = 100
"""Drones that choose the shape and the pace; all others are then asked."""
_HALVINGS = 9
"""Halvings of the pace: the time is found to a part in 512 of what is searched."""
_ROUNDING = 1e-6
"""How much nearer than the separation a pair may come by rounding [m]."""
_SOONEST, _SLOWEST = 0.5, 8.0
"""Times over that with which the search for a pace begins, between which it looks."""


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """What all drones share over a time: curves and their derivatives."""

    breaks: FloatArray
    """Shape (K + 1,) [s]."""
    values: FloatArray
    """Of each curve, its speed and its pull at the breaks, shape (c, 3, K + 1)."""


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """Flights of all drones on one clock: start + sum of curves times vectors."""

    vectors: FloatArray
    """Shape (c, n, 3) [m]; curves go from 0 to 1, the first, or back to 0."""
    curves: Callable[[float], Curves]
    """The curves over a time [s]; times that differ stretch them."""
    duration: float
    """A time from which the search begins [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosedFlights:
    """Flights of all drones that keep apart, and their limits."""

    duration: float
    """[s]."""
    trajectories: tuple[Trajectory, ...]
    """One a drone."""
    widening: float = 0.0
    """Half-way, 1 for a quarter of a circle."""
    layers: int = 0
    """In which drones fly; 0: in none."""
    counts: dict[str, float] = field(default_factory=dict)
    """What it took, for the certificate."""

    @property
    def method(self) -> str:
        """How it was found, in words."""
        how = f"widening by {self.widening:.3g} of a quarter circle"
        if self.layers:
            how = f"in {self.layers} layers"
        return f"all on one clock, {how}"

    @property
    def ways(self) -> Ways:
        """Ways that leave their lines."""
        flights = self.trajectories if self.widening or self.layers else ()
        ways = [one.state.select(slice(0, 3)) for one in flights]
        return Ways(dict(enumerate(ways)), ())


def fly_apart(crossing: Crossing, patterns: Iterable[Pattern]) -> ClosedFlights | None:
    """Fly, of some patterns, the one that takes least; None if a pair meets in it."""
    found = _quickest(crossing, patterns)
    if found is None:
        return None
    duration, flights = found
    count, separation = crossing.start.shape[0], crossing.separation
    trajectories = tuple(flights.trajectory(row) for row in range(count))
    near = conflicts(
        tracks_of(trajectories, crossing.parked),
        separation,
        separation.distance - _ROUNDING,
    )
    return None if len(near) else ClosedFlights(duration, trajectories)


def _quickest(
    crossing: Crossing, patterns: Iterable[Pattern]
) -> tuple[float, FlatFlights] | None:
    """Fly, of some patterns, the one that takes least; None if limits allow none."""
    best: tuple[float, Pattern] | None = None
    for pattern in patterns:
        size = np.linalg.norm(pattern.vectors, axis=2).sum(axis=0)
        sample = np.sort(np.argsort(-size, kind="stable")[:_SAMPLED])
        time = _least_time(crossing, pattern, sample, best[0] if best else None)
        if time is not None and (best is None or time < best[0]):
            best = time, pattern
    if best is None:
        return None
    time, pattern = best
    every = np.arange(pattern.vectors.shape[1])
    while time <= _SLOWEST * pattern.duration:
        duration = whole_milliseconds(time)
        flights = _flown(crossing, pattern, duration, every)
        if _kept(crossing, flights):
            return (duration, flights) if joined(flights).all() else None
        time *= 1.01
    return None


def _least_time(
    crossing: Crossing, pattern: Pattern, rows: IntArray, best: float | None
) -> float | None:
    """Least time in which some drones keep their limits [s]; None if that is more."""

    def kept(time: float) -> bool:
        return _kept(crossing, _flown(crossing, pattern, time, rows))

    low, high = _SOONEST * pattern.duration, pattern.duration
    if best is not None:
        high = best
        if not kept(high):
            return None
    while not kept(high):
        low, high = high, 1.5 * high
        if high > _SLOWEST * pattern.duration:
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
    crossing: Crossing, pattern: Pattern, duration: float, rows: IntArray
) -> FlatFlights:
    start, goal = crossing.start[rows], crossing.goal[rows]
    curves = pattern.curves(duration)
    position = start[:, None, None] + np.einsum(
        "ckj,cna->nkja", _laid(curves), pattern.vectors[:, rows]
    )
    # Not start + (goal - start), which rounds; at both ends the jerk is zero.
    position[:, 0, :4], position[:, -1, -4:] = start[:, None], goal[:, None]
    aircraft = crossing.aircraft
    return fly(aircraft.vehicle, aircraft.heading, curves.breaks, position)


def laid_out(duration: float, *breaks: FloatArray) -> FloatArray:
    """Return breaks of all curves over a time [s] in order, and more between these."""
    every = np.sort(np.concatenate([[0.0], *breaks]))
    inside = every[(every > 0.0) & (every < duration - _NEAREST)]
    kept = [0.0]
    for one in inside.tolist():
        if one - kept[-1] > _NEAREST:
            kept.append(one)
    whole = np.append(kept, duration)
    parts = np.ceil(np.diff(whole) / _WIDEST).astype(np.int64)
    pieces = [
        left + (right - left) * np.arange(count) / count
        for left, right, count in zip(
            whole[:-1], whole[1:], parts.tolist(), strict=True
        )
    ]
    return np.append(np.concatenate(pieces), duration)


def _laid(curves: Curves) -> FloatArray:
    """Lay curves out: Bernstein coefficients of degree 6, shape (c, K, 7)."""
    width = np.diff(curves.breaks)
    ends = np.stack([curves.values[..., :-1], curves.values[..., 1:]], axis=-1)
    value, speed, change = np.moveaxis(ends, 1, 0)
    laid = np.zeros((*value.shape[:2], _DEGREE + 1))
    for end, sign, order in ((0, 1.0, (0, 1, 2)), (1, -1.0, (6, 5, 4))):
        step = sign * width * speed[..., end] / _DEGREE
        bend = width**2 * change[..., end] / (_DEGREE * (_DEGREE - 1))
        laid[..., order[0]] = value[..., end]
        laid[..., order[1]] = value[..., end] + step
        laid[..., order[2]] = value[..., end] + 2.0 * step + bend
    # In the middle a quintic's, raised.
    outer, inner = laid[..., [0, 6]].sum(axis=2), laid[..., [1, 5]].sum(axis=2)
    laid[..., 3] = (outer - 6.0 * inner + 15.0 * laid[..., [2, 4]].sum(axis=2)) / 20.0
    return laid


def product_of(first: FloatArray, second: FloatArray) -> FloatArray:
    """Product of two curves, with its speed and pull, from theirs, each (3, m)."""
    a, a1, a2 = first
    b, b1, b2 = second
    return np.stack([a * b, a1 * b + a * b1, a2 * b + 2.0 * a1 * b1 + a * b2])
