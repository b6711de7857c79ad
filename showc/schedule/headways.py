"""By how much one drone of a pair must leave before the other to pass it first.

Where on their two lines a pair comes too near is a region of the plane of both drones'
parts covered: x of the first, y of the second. Both only ever grow, so a flight of the
pair passes the region on one side: the first drone has left every place before the
second one comes near it, or the other way round. With tau the times at which places
are surely left, and may be reached, after each one's own release, the first drone
passes first if the second one leaves later than it by at least

    max over the region of tau_left_first(x) - tau_reached_second(y),

and for each x only the least y counts. So every pair has one open interval of
differences of release that are forbidden. The region is looked at for some values of
x: what follows from these gaps still has to be proved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.following import SETTLING, time_followed
from showc.schedule.distances import crossing_pairs, dot, point_distance

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.autopilot.stage import Stage
    from showc.autopilot.timing import Timing
    from showc.vehicle import Separation


NODES = 65
"""Instants of a leg between which progress is taken for even."""

PLACES = 17
"""Places of a first drone for which the second one's are worked out."""


@dataclass(frozen=True, slots=True, eq=False)
class Gaps:
    """Pairs of a stage's drones whose lines come too near; arrays of shape (m,)."""

    drones: int
    """How many fly in the stage."""
    first: IntArray
    """Position in the stage of each pair's first drone."""
    second: IntArray
    """Of its second one."""
    after: FloatArray
    """Apart if the second one leaves at least this later than the first [s]; inf:
    however late."""
    before: FloatArray
    """Apart if the first one leaves at least this later than the second [s]."""

    def order(self) -> list[tuple[int, int]]:
        """Pairs (earlier, later) of drones that can only pass in this order."""
        never_after, never_before = np.isposinf(self.after), np.isposinf(self.before)
        only_after = never_before & ~never_after
        only_before = never_after & ~never_before
        return [
            *_as_pairs(self.first[only_after], self.second[only_after]),
            *_as_pairs(self.second[only_before], self.first[only_before]),
        ]

    def hopeless(self) -> list[tuple[int, int]]:
        """Pairs that meet whichever of them passes first."""
        neither = np.isposinf(self.after) & np.isposinf(self.before)
        return _as_pairs(self.first[neither], self.second[neither])


def release_gaps(
    stage: Stage, separation: Separation, timing: Timing, required: float
) -> Gaps:
    """Return the gaps between the straight legs of ``stage``.

    Parameters
    ----------
    stage
        Straight legs of n drones; how long they wait makes no difference.
    separation, required
        The metric, and the least distance in it [m].
    timing
        How surely every leg is flown on time.
    """
    a, b = crossing_pairs(stage, separation, required)
    if not a.size:
        none = np.zeros(0)
        return Gaps(stage.drones.size, a, b, none, none)
    clock = _Clock.of(stage, timing)
    far = clock.farthest
    begin, goal = stage.begin, stage.end
    x, low, high = _region(
        (begin[a], begin[b]),
        (goal[a] - begin[a], goal[b] - begin[b]),
        (clock.stretch[a], clock.stretch[b]),
        separation,
        required,
    )
    empty = ~(low <= high)
    rows_a, rows_b = (np.broadcast_to(side[:, None], x.shape) for side in (a, b))
    with np.errstate(invalid="ignore"):
        after = clock.left(rows_a, x) - clock.reached(rows_b, low)
        before = clock.left(rows_b, high) - clock.reached(rows_a, x)
    after, before = (
        np.where(empty, -np.inf, gap).max(axis=1, initial=-np.inf)
        for gap in (after, before)
    )

    # Whose start or goal the other one's line passes knows only one order.
    def meets(point: FloatArray, line: tuple[FloatArray, FloatArray]) -> BoolArray:
        return _passes(point, line, separation, required)

    line_a, line_b = (begin[a], far[a]), (begin[b], far[b])
    after[meets(goal[a], line_b) | meets(begin[b], line_a)] = np.inf
    before[meets(goal[b], line_a) | meets(begin[a], line_b)] = np.inf
    # What lies between the places looked at is over when the first one has settled.
    after = np.where(np.isneginf(after) & np.isposinf(before), clock.settled[a], after)
    before = np.where(
        np.isneginf(before) & np.isposinf(after), clock.settled[b], before
    )
    return Gaps(stage.drones.size, a, b, after, before)


@dataclass(frozen=True, slots=True, eq=False)
class _Clock:
    """When each of n drones may be where, after its own release."""

    part: FloatArray
    """Parts of the legs covered at the nodes, behind each other, the k-th drone's moved
    by 2 k: increasing, shape (n NODES,)."""
    late: FloatArray
    """When each drone has surely covered that [s]."""
    early: FloatArray
    """When it may have covered it [s]."""
    settled: FloatArray
    """When each one has surely come back to its goal, shape (n,) [s]."""
    stretch: FloatArray
    """Way to the foremost place over length of the leg, shape (n,), at least 1."""
    farthest: FloatArray
    """The foremost places, shape (n, 3) [m]."""

    @classmethod
    def of(cls, stage: Stage, timing: Timing) -> _Clock:
        profile, level = stage.profile, stage.level
        spread = timing.spread(profile.speed)
        # Close together at the ends, where progress is slow.
        nodes = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, NODES))
        time = nodes[:, None] * profile.duration
        part = profile.fraction(time) + 2.0 * np.arange(level.size)
        beyond = stage.overshoot if timing.overshoots else 0.0 * level
        return cls(
            part.T.ravel(),
            time_followed(level, time + spread).T.ravel(),
            time_followed(level, time - spread).T.ravel(),
            time_followed(level, profile.duration + SETTLING + spread),
            1.0 + beyond / profile.length,
            stage.farthest if timing.overshoots else stage.end,
        )

    def left(self, drone: IntArray, part: FloatArray) -> FloatArray:
        """When ``drone`` has surely left the place at ``part``; a goal never."""
        key = np.clip(part, 0.0, 1.0) + 2.0 * drone
        found = np.interp(key, self.part, self.late)
        found = np.where(part >= 1.0, np.inf, found)
        return np.where(part > 1.0, self.settled[drone], found)

    def reached(self, drone: IntArray, part: FloatArray) -> FloatArray:
        """When ``drone`` may come to the place at ``part``; at a start it has been."""
        key = np.clip(part / self.stretch[drone], 0.0, 1.0) + 2.0 * drone
        found = np.interp(key, self.part, self.early)
        return np.where(part <= 0.0, -np.inf, found)


def _region(
    begin: tuple[FloatArray, FloatArray],
    along: tuple[FloatArray, FloatArray],
    stretch: tuple[FloatArray, FloatArray],
    separation: Separation,
    required: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places x of the first drones, and from where to where the second ones are near.

    All of shape (m, k), in parts of the legs; nothing is near where the third is
    below the second.
    """
    scale = np.array(separation.metric_scale)
    between, u, v = (begin[0] - begin[1]) * scale, along[0] * scale, along[1] * scale
    per_axis = separation.shape in {"any-axis", "all-axes"}
    first, last = np.zeros(len(u)), stretch[0].copy()
    if not per_axis:
        # Only where the first one's line is near the other's, both without an end.
        vv = dot(v, v)
        across = u - (dot(u, v) / vv)[:, None] * v
        offset = between - (dot(between, v) / vv)[:, None] * v
        uu = dot(across, across)
        skew = uu > 1e-9 * dot(u, u)
        safe = np.where(skew, uu, 1.0)
        middle = -dot(across, offset) / safe
        square = middle**2 - (dot(offset, offset) - required**2) / safe
        half = np.sqrt(np.maximum(square, 0.0))
        first = np.where(skew, np.clip(middle - half, 0.0, stretch[0]), first)
        last = np.where(skew, np.clip(middle + half, 0.0, stretch[0]), last)
    # Close together at the ends, where the region narrows.
    nodes = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, PLACES))
    even = first[:, None] + (last - first)[:, None] * nodes
    # Where the region is cut off at the ends of the second one's line.
    corners = [
        part
        for end in (0.0 * stretch[1], stretch[1])
        for part in _around(between - end[:, None] * v, u, required)
    ]
    x = np.column_stack([even, *corners])
    x = np.clip(x, 0.0, stretch[0][:, None])
    place = between[:, None, :] + x[..., None] * u[:, None, :]
    if per_axis:
        low, high = _near_per_axis(place, v, separation.shape == "any-axis", required)
    else:
        foot = np.einsum("mkj,mj->mk", place, v) / vv[:, None]
        aside = np.einsum("mkj,mkj->mk", place, place) - foot**2 * vv[:, None]
        square = (required**2 - aside) / vv[:, None]
        # Rounding at the region's ends is not its end.
        half = np.sqrt(np.maximum(square, 0.0))
        half = np.where(square < -1e-9, np.nan, half)
        low, high = foot - half, foot + half
    with np.errstate(invalid="ignore"):
        outside = ~((high >= 0.0) & (low <= stretch[1][:, None]))
    low = np.where(outside, np.inf, np.maximum(low, 0.0))
    high = np.where(outside, -np.inf, np.minimum(high, stretch[1][:, None]))
    return x, low, high


def _passes(
    point: FloatArray,
    line: tuple[FloatArray, FloatArray],
    separation: Separation,
    required: float,
) -> BoolArray:
    """Whether straight parts come nearer to their points, all (m, 3), than required."""
    if separation.shape not in {"any-axis", "all-axes"}:
        return point_distance(point, line, separation) < required
    low, high = _near_per_axis(
        (point - line[0])[:, None, :],
        line[1] - line[0],
        separation.shape == "any-axis",
        required,
    )
    return np.asarray((np.maximum(low, 0.0) <= np.minimum(high, 1.0))[:, 0])


def _around(
    between: FloatArray, u: FloatArray, required: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where lines ``between`` + x ``u``, both (m, 3), are nearest to the origin.

    And where they come nearer than ``required``, and leave; all of shape (m,).
    """
    uu = dot(u, u)
    foot = -dot(between, u) / uu
    aside = dot(between, between) - foot**2 * uu
    half = np.sqrt(np.maximum(required**2 - aside, 0.0) / uu)
    return foot, foot - half, foot + half


def _near_per_axis(
    place: FloatArray,
    v: FloatArray,
    every: bool,  # noqa: FBT001 - which of two forms
    required: float,
) -> tuple[FloatArray, FloatArray]:
    """From where to where on the lines y ``v`` a place is near: on every axis, or any.

    ``place`` (m, k, 3), ``v`` (m, 3); for any axis what lies between is near, too.
    """
    v = np.broadcast_to(v[:, None, :], place.shape)
    still = np.abs(v) < 1e-9
    safe = np.where(still, 1.0, v)
    one, other = (place - required) / safe, (place + required) / safe
    near = np.abs(place) < required
    low = np.where(still, np.where(near, -np.inf, np.inf), np.minimum(one, other))
    high = np.where(still, np.where(near, np.inf, -np.inf), np.maximum(one, other))
    if every:
        return low.max(axis=2), high.min(axis=2)
    return low.min(axis=2), high.max(axis=2)


def _as_pairs(one: IntArray, other: IntArray) -> list[tuple[int, int]]:
    return list(zip(one.tolist(), other.tolist(), strict=True))
