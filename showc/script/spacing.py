"""Spacing: which places of a formation are how close to each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.vehicle import Separation


_TOLERANCE = 1e-9
_BLOCK = 200_000
"""Pairs looked at together: some ten megabytes."""


@dataclass(frozen=True, slots=True)
class Closeness:
    """The closest pair of places among those below a threshold."""

    first: int
    """Place, counting from 0."""
    second: int
    """Another place, or a place of the other formation."""
    distance: float
    """How far apart, in the separation's metric [m]."""
    pairs: int
    """How many pairs are below the threshold."""


def pair_distance(difference: FloatArray, separation: Separation) -> FloatArray:
    """Return the distance of pairs in the separation's metric.

    Parameters
    ----------
    difference
        Differences of position, shape (..., 3) [m].
    separation
        Whose shape says how they are measured.
    """
    size = np.abs(difference)
    if separation.shape == "any-axis":
        return np.asarray(size.max(axis=-1))
    if separation.shape == "all-axes":
        return np.asarray(size.min(axis=-1))
    scaled = size * np.array(separation.metric_scale)
    square = scaled * scaled
    # Sums over so short an axis take longer than all the rest.
    return np.asarray(np.sqrt(square[..., 0] + square[..., 1] + square[..., 2]))


def close_pairs(
    points: FloatArray, threshold: float, separation: Separation
) -> Iterator[tuple[IntArray, IntArray, FloatArray]]:
    """Yield all pairs closer than a threshold, in batches: first, second, distance.

    Sorts along the longest side and sweeps: places further apart along it than the
    threshold need not be looked at. ``all-axes`` has no such bound and looks at all.
    """
    count = len(points)
    axis = int(np.argmax(np.ptp(points, axis=0)))
    order = np.argsort(points[:, axis], kind="stable")
    placed = points[order]
    reach = threshold
    if separation.shape == "ellipsoid" and axis == 2:
        reach = threshold * separation.vertical_stretch
    bounded = separation.shape != "all-axes"
    limit = threshold * (1.0 - _TOLERANCE)
    for offset in range(1, count):
        difference = placed[offset:] - placed[:-offset]
        if bounded and np.all(difference[:, axis] >= reach):
            return
        distance = pair_distance(difference, separation)
        near = np.nonzero(distance < limit)[0]
        if near.size:
            yield order[near], order[near + offset], distance[near]


def closest(
    points: FloatArray, threshold: float, separation: Separation
) -> Closeness | None:
    """Return the closest pair below a threshold, or None if all keep it."""
    best: Closeness | None = None
    total = 0
    for first, second, distance in close_pairs(points, threshold, separation):
        total += distance.size
        at = int(np.lexsort((second, first, distance))[0])
        low, high = sorted((int(first[at]), int(second[at])))
        found = Closeness(low, high, float(distance[at]), 0)
        if best is None or _key(found) < _key(best):
            best = found
    if best is None:
        return None
    return Closeness(best.first, best.second, best.distance, total)


def closest_between(
    points: FloatArray, others: FloatArray, threshold: float, separation: Separation
) -> Closeness | None:
    """Return the closest pair of one place of each of two sets, below a threshold."""
    if not len(points) or not len(others):
        return None
    best: Closeness | None = None
    total = 0
    # All pairs at once would not fit into memory.
    rows = max(_BLOCK // len(others), 1)
    for start in range(0, len(points), rows):
        difference = points[start : start + rows, None, :] - others[None, :, :]
        distance = pair_distance(difference, separation)
        total += int(np.sum(distance < threshold * (1.0 - _TOLERANCE)))
        first, second = np.unravel_index(int(np.argmin(distance)), distance.shape)
        least = float(distance[first, second])
        if best is None or least < best.distance:
            best = Closeness(start + int(first), int(second), least, 0)
    if best is None or not total:
        return None
    return Closeness(best.first, best.second, best.distance, total)


def _key(pair: Closeness) -> tuple[float, int, int]:
    return pair.distance, pair.first, pair.second
