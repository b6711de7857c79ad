"""What the whole fleet does over the show, against its limits.

Extremes are those of the log's samples: curves to look at, no proof.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.view.digest import nearest_at
from showc.view.scene import Band

if TYPE_CHECKING:
    from collections.abc import Iterable

    from showc.arrays import FloatArray
    from showc.log.reader import LoggedShow
    from showc.view.scene import Meeting

POINTS = 600
"""Greatest number of points of a curve over the fleet."""
DENSE = 150
"""Of these, how many have the nearest pair of a fleet of a thousand looked up."""


def bands_of(logged: LoggedShow, meetings: Iterable[Meeting]) -> tuple[Band, ...]:
    """Return speed, acceleration, separation and height of the fleet, with limits.

    Parameters
    ----------
    logged
        The show.
    meetings
        Encounters that are known exactly, which the samples may miss.
    """
    count = min(POINTS, logged.times.size)
    edges = np.linspace(0, logged.times.size, count + 1).astype(int)
    rows = [np.arange(first, last) for first, last in pairwise(edges)]
    times = logged.times[edges[:-1]]
    found = [*_speeds(logged, rows, times)]
    apart = _apart(logged, times, meetings)
    if apart is not None:
        found.append(apart)
    heights = np.array([logged.positions[part, :, 2].max() for part in rows])
    ceiling = np.full(count, logged.rules.site.volume_max.z)
    found.append(Band("Greatest height", "m", 1, times, heights, ceiling))
    return tuple(found)


def _speeds(
    logged: LoggedShow, rows: list[FloatArray], times: FloatArray
) -> tuple[Band, Band]:
    """Speed along the axis that is nearest to its limit, and level acceleration."""
    low, high, level = _limits(logged)
    step = float(logged.times[1] - logged.times[0]) if logged.times.size > 1 else 1.0
    speed, bound = np.zeros(len(rows)), np.zeros(len(rows))
    push, most = np.zeros(len(rows)), np.full(len(rows), np.nan)
    for number, part in enumerate(rows):
        samples = logged.samples[part]
        velocity = np.stack([samples[name] for name in ("vx", "vy", "vz")], axis=-1)
        extreme = velocity.max(axis=1), velocity.min(axis=1)
        shares = np.stack([extreme[0] / high[part], extreme[1] / low[part]])
        side, row, axis = np.unravel_index(int(shares.argmax()), shares.shape)
        speed[number] = abs(float(extreme[side][row, axis]))
        bound[number] = abs(float((high, low)[side][part[row], axis]))
        after = np.minimum(part + 1, logged.times.size - 1)
        change = [logged.samples[name][after] - samples[name] for name in ("vx", "vy")]
        push[number] = float(np.hypot(*change).max()) / step
        least = level[part]
        most[number] = least.min() if (least > 0.0).all() else np.nan
    return (
        Band("Speed along an axis", "m/s", 2, times, speed, bound),
        Band("Greatest level acceleration", "m/s²", 2, times, push, most),
    )


def _limits(logged: LoggedShow) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Limits at each sample: velocities (T, 3) [m/s], level acceleration (T,)."""
    size = logged.times.size
    low, high, level = np.empty((size, 3)), np.empty((size, 3)), np.empty(size)
    first = logged.rules.limits[0]
    spans = [(0.0, logged.duration, first)]
    spans += [
        (one.start, one.start + one.duration, logged.rules.limits[one.message.limits])
        for one in logged.segments
    ]
    for start, end, limits in spans:
        inside = (logged.times >= start - 1e-6) & (logged.times <= end + 1e-6)
        low[inside] = _vector(limits.velocity_min)
        high[inside] = _vector(limits.velocity_max)
        level[inside] = limits.acceleration
    return low, high, level


def _vector(message: pb.Vector3) -> tuple[float, float, float]:
    return message.x, message.y, message.z


def _apart(
    logged: LoggedShow, times: FloatArray, meetings: Iterable[Meeting]
) -> Band | None:
    """Distance of the nearest pair; None where the metric is no distance."""
    separation = logged.rules.separation
    if separation.shape == pb.Separation.ALL_AXES or logged.drones < 2:
        return None
    many = max(2, min(times.size, DENSE * 1000 // logged.drones))
    chosen = np.linspace(0, times.size - 1, many).astype(int)
    apart = np.empty(many)
    for number, row in enumerate(np.searchsorted(logged.times, times[chosen])):
        near = nearest_at(logged.positions[row], times[chosen[number]], separation)
        assert near is not None  # noqa: S101 - there are pairs, and a distance
        apart[number] = near.distance
    for one in meetings:
        row = int(np.abs(times[chosen] - one.time).argmin())
        apart[row] = min(apart[row], one.distance)
    limit = np.full(many, separation.distance)
    return Band("Closest pair", "m", 2, times[chosen], apart, limit, least=True)
