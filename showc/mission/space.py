"""Whether straight legs keep the flight volume and the fence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.mission.distances import segment_distance
from showc.mission.geodesy import POSITION_RESOLUTION

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.mission.stage import Stage
    from showc.script.show import Site

    FloatArray = NDArray[np.float64]


TOUCHES = 1e-9
"""Lines that are so near an edge touch it [m]."""


def leaves(stage: Stage, site: Site) -> NDArray[np.bool_]:
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


def _within(places: FloatArray, corners: FloatArray) -> NDArray[np.bool_]:
    """Whether places (n, 3) are inside: a ray from them crosses edges oddly often."""
    x, y = places[:, 0], places[:, 1]
    inside = np.zeros(len(places), dtype=np.bool_)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        crosses = (a[1] > y) != (b[1] > y)
        rise = b[1] - a[1] if b[1] != a[1] else 1.0
        inside ^= crosses & (x < a[0] + (y - a[1]) * (b[0] - a[0]) / rise)
    return inside
