"""Which points are near each other, in metric coordinates."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray


FEW = 200
"""Points up to which looking at all pairs, in some hundred places of a leg, costs less
than to load what has a k-d tree."""


def near_pairs(
    points: FloatArray, reach: float, norm: float
) -> tuple[IntArray, IntArray]:
    """Pairs (first, second) that contain all whose points are within ``reach``.

    Parameters
    ----------
    points
        Shape (n, 3) [m].
    reach
        Distance [m].
    norm
        In which it is measured: 2, or infinity for the greatest of the axes.
    """
    if points.shape[0] <= FEW:
        first, second = all_pairs(points.shape[0])
        # Both norms are at most this far from each other, whichever is meant. The
        # longest axis first: of its pairs few are left to look at along the others.
        for axis in np.argsort(-np.ptp(points, axis=0)).tolist():
            place = np.ascontiguousarray(points[:, axis])
            near = np.abs(place[first] - place[second]) <= reach
            first, second = first[near], second[near]
        return first, second
    from scipy.spatial import cKDTree  # noqa: PLC0415 - only for many points

    pairs = cKDTree(points).query_pairs(reach, p=norm, output_type="ndarray")
    return pairs[:, 0], pairs[:, 1]


def least_distance(points: FloatArray, norm: float) -> float:
    """Least distance of a pair of ``points`` (n, 3) [m], n at least 2."""
    if points.shape[0] <= FEW:
        first, second = all_pairs(points.shape[0])
        gap = points[first] - points[second]
        return float(np.linalg.norm(gap, ord=norm, axis=1).min())
    from scipy.spatial import cKDTree  # noqa: PLC0415 - only for many points

    distance, _ = cKDTree(points).query(points, k=2, p=norm)
    return float(distance[:, 1].min())


@lru_cache(maxsize=4)
def all_pairs(count: int) -> tuple[IntArray, IntArray]:
    """All pairs (first, second) of ``count``, the first the lower index."""
    first, second = np.triu_indices(count, 1)
    first.setflags(write=False)
    second.setflags(write=False)
    return first, second
