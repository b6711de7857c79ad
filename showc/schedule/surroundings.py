"""Where all drones are while a leg is looked at, and how they move in a stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.s_curve import LegProfile
from showc.geodesy import POSITION_RESOLUTION
from showc.schedule.distances import segment_distance
from showc.schedule.separation import TOLERANCE, Motion

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray
    from showc.autopilot.stage import Stage
    from showc.autopilot.timing import Timing
    from showc.script.show import Site
    from showc.vehicle import Separation


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Where all drones are while one leg is looked at, and what must hold."""

    positions: FloatArray
    """Where everyone is before the leg, shape (drones, 3), on the grid [m]."""
    separation: Separation
    """What every pair keeps."""
    site: Site
    """Whose volume and fence they keep."""
    timing: Timing
    """How surely legs are flown on time."""
    pause: float = 0.0
    """Least time between the latest end of a stage and the next release [s]."""

    @property
    def required(self) -> float:
        """Least distance that a proof must show [m].

        Places that are as near as the separation allows can be nearer by the
        resolution of the mission's numbers; a proof may fall short of the truth by its
        tolerance.
        """
        return self.separation.distance - POSITION_RESOLUTION - TOLERANCE


def stage_motion(
    stage: Stage, positions: FloatArray, timing: Timing, start: float = 0.0
) -> Motion:
    """Return the motion of the whole fleet while ``stage`` is flown.

    ``positions`` (drones, 3) is where everyone is before it, ``start`` the time of its
    release [s]. Drones that it leaves out rest.
    """
    count = positions.shape[0]
    begin, end = positions.copy(), positions.copy()
    begin[stage.drones], end[stage.drones] = stage.begin, stage.end
    rank = np.full(count, len(stage.profile), dtype=np.int64)
    rank[stage.drones] = np.arange(stage.drones.size)
    spread = timing.spread(stage.profile.speed)
    # At no time in particular, there is no last instant.
    last = stage.finish(spread) if np.isfinite(spread).all() else np.inf
    beyond = stage.overshoot if timing.overshoots else np.zeros(stage.drones.size)
    return Motion(
        begin,
        end,
        with_rest(stage.profile).select(rank),
        start + np.append(stage.wait, 0.0)[rank],
        np.append(stage.level, 0.0)[rank],
        np.append(spread, timing.spread(np.zeros(1)))[rank],
        np.append(beyond, 0.0)[rank],
        (start - float(spread.max(initial=0.0)), start + last),
    )


def with_rest(profile: LegProfile) -> LegProfile:
    """Return the legs of ``profile`` and behind them one of length 0."""
    return LegProfile(
        *(
            np.append(getattr(profile, name), 0.0)
            for name in profile.__dataclass_fields__
        )
    )


TOUCHES = 1e-9
"""Lines that are so near an edge touch it [m]."""


def leaves(stage: Stage, site: Site) -> BoolArray:
    """Return which drones of a stage leave the volume, or the fence, shape (n,).

    Lines keep the margin that the site asks for, to the resolution of missions; what
    is flown beyond their ends may use it up.
    """
    begin, end, far = stage.begin, stage.end, stage.farthest
    low, high = (np.array(corner) - POSITION_RESOLUTION for corner in site.room)
    high = high + 2.0 * POSITION_RESOLUTION
    inside = np.all((end >= low) & (end <= high), axis=1)
    least, most = np.array(site.volume_min), np.array(site.volume_max)
    inside &= np.all(far >= least - POSITION_RESOLUTION, axis=1)
    inside &= np.all(far <= most + POSITION_RESOLUTION, axis=1)
    if site.fence is not None:
        corners = np.asarray(site.fence, dtype=np.float64)
        lines = _edge_distance(begin, end, corners) - site.fence_margin
        spare = np.minimum(lines, _edge_distance(end, far, corners))
        inside &= (spare >= -POSITION_RESOLUTION) & _within(begin, corners)
    return np.asarray(~inside)


def _edge_distance(
    one: FloatArray, other: FloatArray, corners: FloatArray
) -> FloatArray:
    """Least level distance (n,) [m] of lines between places (n, 3) from a fence."""
    p, u = _flat(one), _flat(other) - _flat(one)
    least = np.full(len(p), np.inf)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        q = np.broadcast_to(np.append(a, 0.0), p.shape)
        v = np.broadcast_to(np.append(b - a, 0.0), p.shape)
        # A drone that goes straight up is a point from above.
        least = np.minimum(least, segment_distance(p, u, q, v))
    # What touches an edge may be on its other side, however near.
    return np.where(least > TOUCHES, least, -np.inf)


def _flat(places: FloatArray) -> FloatArray:
    flat = places.copy()
    flat[:, 2] = 0.0
    return flat


def _within(places: FloatArray, corners: FloatArray) -> BoolArray:
    """Whether places (n, 3) are inside: a ray from them crosses edges oddly often."""
    x, y = places[:, 0], places[:, 1]
    inside = np.zeros(len(places), dtype=np.bool_)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        crosses = (a[1] > y) != (b[1] > y)
        rise = b[1] - a[1] if b[1] != a[1] else 1.0
        inside ^= crosses & (x < a[0] + (y - a[1]) * (b[0] - a[0]) / rise)
    return inside
