"""Whether missions stay in the flight volume and inside the fence.

Drones fly straight lines from place to place, and beyond their ends by the overshoot
at most. A line is inside a fence if it begins inside and comes near no edge of it, so
concave fences are no other case.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.missions.distances import segment_distance
from showc.verify.missions.plan import fence_corners

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.log.showc_pb2 import Site
    from showc.verify.missions.legs import MissionLegs


TOUCHES = 1e-9
"""Lines that are so near an edge touch it [m]."""

ROUNDING = 0.02
"""How far a stored place may be off the one that was meant [m]."""


@dataclass(frozen=True, slots=True)
class Inside:
    """How far inside a boundary the missions stay, less what is asked for."""

    spare: float
    """Negative outside [m]."""
    drone: int
    """Counting from 0."""
    line: int
    """Of the mission's file, whose item flies there."""


def inside_volume(missions: Sequence[MissionLegs], site: Site) -> Inside:
    """Return how far inside the volume's walls all places are, overshoot included.

    Where the walls are the fence, lines keep its margin; what is flown beyond their
    ends may use it up.
    """
    low, high = (
        np.array([corner.x, corner.y, corner.z])
        for corner in (site.volume_min, site.volume_max)
    )
    margin = 0.0 if len(site.fence) else site.fence_margin
    inset = np.array([margin, margin, 0.0])
    begin, end, beyond, drone, line = _lines(missions)
    spare = np.minimum.reduce(
        [
            (begin - low - inset).min(axis=1),
            (high - inset - begin).min(axis=1),
            (end - low - inset).min(axis=1),
            (high - inset - end).min(axis=1),
            (beyond - low).min(axis=1),
            (high - beyond).min(axis=1),
        ]
    )
    return _least(spare, drone, line)


def inside_fence(missions: Sequence[MissionLegs], site: Site) -> Inside | None:
    """Return how far inside the fence all lines are, its margin taken off.

    None where the site has no fence but the volume's walls.
    """
    if not len(site.fence):
        return None
    corners = fence_corners(site)
    begin, end, beyond, drone, line = _lines(missions)
    lines, tails = (
        np.full(len(begin), np.inf),
        np.full(len(begin), np.inf),
    )
    for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        first, second = (
            np.repeat(np.append(corner, 0.0)[:, None], len(begin), axis=1)
            for corner in (one, other)
        )
        for found, a, b in ((lines, begin, end), (tails, end, beyond)):
            np.minimum(
                found,
                segment_distance(_flat(a), _flat(b), first, second),
                out=found,
            )
    # What touches an edge may be on its other side, however near.
    spare = np.minimum(lines - site.fence_margin, tails)
    spare[np.minimum(lines, tails) <= TOUCHES] = -np.inf
    spare[~contains(corners, begin[:, :2])] = -np.inf
    return _least(spare, drone, line)


def contains(corners: FloatArray, points: FloatArray) -> BoolArray:
    """Whether points (n, 2) are within corners (m, 2): a ray crosses oddly often."""
    x, y = points.T
    inside = np.zeros(len(points), dtype=np.bool_)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        crosses = (ay > y) != (by > y)
        rise = by - ay if by != ay else 1.0
        inside ^= crosses & (x < ax + (y - ay) * (bx - ax) / rise)
    return inside


def _flat(points: FloatArray) -> FloatArray:
    """Return points (n, 3) seen from above, axis by axis (3, n)."""
    flat = points.T.copy()
    flat[2] = 0.0
    return flat


def _lines(
    missions: Sequence[MissionLegs],
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, IntArray]:
    """Begin, end and foremost place (n, 3) of all lines; whose, and of which row."""
    begin = np.concatenate([one.places[:-1] for one in missions])
    end = np.concatenate([one.places[1:] for one in missions])
    excess = np.concatenate([one.profiles.excess for one in missions])
    drone = np.repeat(np.arange(len(missions)), [one.lines.size for one in missions])
    line = np.concatenate([one.lines for one in missions])
    # A landing ends on the ground.
    last = np.cumsum([one.lines.size for one in missions]) - 1
    excess[last] = 1.0
    return begin, end, begin + excess[:, None] * (end - begin), drone, line


def _least(spare: FloatArray, drone: IntArray, line: IntArray) -> Inside:
    row = int(spare.argmin())
    return Inside(float(spare[row]), int(drone[row]), int(line[row]))
