"""Which moves of a fleet can have the greatest bound: the corners of their hull.

The inequality that proves a bound is linear in the displacement d: ``beta . d`` on one
side, an integral without d on the other. If a move is a mixture of others, ``beta . d``
is a mixture of theirs, and the same multipliers prove as much for one of these. So the
greatest bound of all moves is that of a corner of their convex hull. Mirror images
count as moves where flights have such images, and so does the move of no length, which
every bound spares.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

_FLAT = 1e-9
"""Extent, over the greatest, below which the moves have no extent in a direction."""


def extreme_moves(displacement: FloatArray) -> IntArray:
    """Rows of the moves that are corners of the hull of all moves and the origin.

    Parameters
    ----------
    displacement
        Shape (n, 3) [m], at least one of them not zero.

    Returns
    -------
    ndarray
        Increasing; moves that differ from a mixture of these by less than rounding may
        be left out.
    """
    from scipy.spatial import ConvexHull, QhullError  # noqa: PLC0415 - slow to import

    points = np.vstack([displacement, np.zeros(3)])
    origin = displacement.shape[0]
    _, spread, axes = np.linalg.svd(points, full_matrices=False)
    rank = int((spread > _FLAT * spread[0]).sum())
    # The origin is among the points: they span a subspace, not only a plane or a line.
    inner = points @ axes[:rank].T
    if rank == 1:
        corners = np.array([int(np.argmin(inner)), int(np.argmax(inner))])
    elif points.shape[0] <= rank + 1:
        corners = np.arange(points.shape[0])
    else:
        try:
            corners = np.asarray(ConvexHull(inner).vertices, dtype=np.int64)
        except QhullError:
            corners = np.arange(points.shape[0])
    return np.unique(corners[corners != origin])
