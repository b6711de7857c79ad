"""Spreading: places pushed apart until they keep a spacing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.script.spacing import close_pairs, closest

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.vehicle import Separation


_MOST_ROUNDS = 400
_EFFORT = 60_000
_MARGIN = 1.0 + 1e-3
"""Most rounds of pushing; most places moved in all of them, which bounds the time; and
the part of the spacing that is aimed at, for rounds end before they reach it."""


def spread_apart(
    points: FloatArray, spacing: float, separation: Separation
) -> FloatArray:
    """Push places apart until each pair keeps the spacing.

    Close pairs push each other, half the lack each, round after round; a flat
    formation stays flat. What is not apart after a number of rounds is scaled up
    about its middle, which always ends.

    Parameters
    ----------
    points
        Places, shape (places, 3) [m].
    spacing
        Wanted distance in the separation's metric [m].
    separation
        Gives the metric; ``all-axes`` is treated as a sphere.

    Returns
    -------
    FloatArray
        New places, shape (places, 3) [m]; the same number, in the same order.
    """
    scale = np.array(separation.metric_scale)
    metric = type(separation)(separation.distance)
    placed = _apart(points * scale)
    goal = spacing * _MARGIN
    # Many places settle slowly; what they lack then, the scaling gives them.
    for _ in range(min(_MOST_ROUNDS, max(_EFFORT // len(points), 1))):
        push = np.zeros_like(placed)
        close = False
        for first, second, distance in close_pairs(placed, goal, metric):
            close = close or first.size > 0
            direction = placed[second] - placed[first]
            step = (0.5 * (goal - distance) / distance)[:, None] * direction
            for axis in range(3):
                for places, sign in ((second, 1.0), (first, -1.0)):
                    push[:, axis] += sign * np.bincount(
                        places, weights=step[:, axis], minlength=len(placed)
                    )
        if not close:
            break
        placed = placed + push
    left = closest(placed, spacing, metric)
    if left is not None:
        middle = placed.mean(axis=0)
        placed = middle + (placed - middle) * (goal / left.distance)
    return np.asarray(placed / scale, dtype=np.float64)


def _apart(points: FloatArray) -> FloatArray:
    """Move coinciding places apart by a hair, within the formation's plane."""
    centred = points - points.mean(axis=0)
    size = max(float(np.abs(centred).max()), 1.0)
    axes = np.linalg.svd(centred, full_matrices=False)[2] if len(points) > 1 else None
    if axes is None:
        return points
    right = axes[0]
    up = axes[1] if len(axes) > 1 else np.roll(right, 1)
    angle = 2.399963229728653 * np.arange(len(points))  # the golden angle
    hair = 1e-6 * size * np.sqrt((np.arange(len(points)) + 1.0) / len(points))
    flat = float(np.ptp(centred @ up)) > 1e-9 * size
    side = np.sin(angle)[:, None] * up if flat else 0.0
    _, index, count = np.unique(
        np.round(points / (1e-7 * size)), axis=0, return_index=True, return_counts=True
    )
    alone = np.zeros(len(points), dtype=bool)
    alone[index[count == 1]] = True
    moved = points + hair[:, None] * (np.cos(angle)[:, None] * right + side)
    return np.where(alone[:, None], points, moved)
