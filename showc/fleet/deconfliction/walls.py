"""Moving half-spaces that keep a pair apart: each drone keeps to its own side.

For a pair at relative position r(t) and any n(t) no longer than 1, keeping
``n . x_i >= m + q d / 2`` and ``-n . x_j >= -m + q d / 2``, with q at least the length
of n, implies that r is no shorter than d, whatever m(t) is. On each interval n turns
linearly from one unit vector to another, m is the middle of the pair at the last
iterate. Where the pair meets
head-on, n turns so that each passes on its own right. Where all axes have to be apart,
each has walls of its own that never turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.single_drone.convex_program import NO_WALLS, WALL_DEGREE, Walls
from showc.trajectory import PiecewisePolynomial, bernstein_basis_inverse

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.vehicle import Separation


NODES: FloatArray = 0.5 * (
    1.0 - np.cos(np.pi * np.arange(WALL_DEGREE + 1) / WALL_DEGREE)
)
"""Where positions are taken on each interval, as fractions of it, shape (7,)."""
HEAD_ON = 0.15
"""Share of the separation below which a pair meets head-on."""
_REACH, _STALLED, _NEARLY, _BEHIND = 1.6, 3, 0.8, 0.3
"""Separations within which a pair gets walls; tries after which a pair that misses by
less than the next share of the separation passes another way; and how far, in
separations, it must have passed for its wall to follow it: found by trial."""


@dataclass(frozen=True, slots=True, eq=False)
class PairWalls:
    """Walls of one pair, before they are given out."""

    interval: IntArray
    """Shape (m,)."""
    normal: FloatArray
    """For the first of the pair at both ends of the interval, (m, 2, 3), show frame."""
    first: FloatArray
    """Offsets for the first at ``NODES``, shape (m, 7) [m]."""
    second: FloatArray
    """Offsets for the second with the opposite normal, shape (m, 7) [m]."""


def pair_walls(  # noqa: PLR0917 - keyword-like geometry
    first: FloatArray,
    second: FloatArray,
    separation: Separation,
    share: float,
    margin: float,
    tries: int = 0,
) -> PairWalls:
    """Walls between two drones from their last positions.

    Parameters
    ----------
    first, second
        Positions at ``NODES`` of each interval, shape (K, 7, 3) [m].
    share
        Part of the correction that the first takes: 1/2, or 1 if the second cannot
        move, or 0.
    margin
        How much more than the separation to keep [m].
    tries
        How often walls have failed this pair; then other sides are tried.
    """
    scale = np.asarray(separation.metric_scale)
    relative = (first - second) * scale
    wanted = separation.distance + margin
    if separation.shape == "all-axes":
        # As many walls as axes: on each the drones keep their order throughout.
        sides = np.where(relative[0, 0] >= 0.0, 1.0, -1.0)
        planes = [
            (np.broadcast_to(sides[axis] * np.eye(3)[axis], (relative.shape[0], 2, 3)))
            for axis in range(3)
        ]
        reach = [relative[..., axis] * sides[axis] for axis in range(3)]
    elif separation.shape == "any-axis":
        reach = [np.abs(relative).max(axis=2)]
        planes = [_axis_normals(relative)]
    else:
        reach = [np.sqrt(np.einsum("kij,kij->ki", relative, relative))]
        planes = [_normals(relative, reach[0], wanted, tries)]
    parts = [
        _between(first * scale, second * scale, normal, distance, wanted, share)
        for normal, distance in zip(planes, reach, strict=True)
    ]
    return PairWalls(
        np.concatenate([part.interval for part in parts]),
        np.concatenate([part.normal for part in parts]) * scale,
        np.concatenate([part.first for part in parts]),
        np.concatenate([part.second for part in parts]),
    )


def _between(  # noqa: PLR0917 - keyword-like geometry
    first: FloatArray,
    second: FloatArray,
    normal: FloatArray,
    distance: FloatArray,
    wanted: float,
    share: float,
) -> PairWalls:
    """Walls with given normals (K, 2, 3), all in metric coordinates.

    Parameters
    ----------
    distance
        Of the pair at ``NODES`` of each interval, shape (K, 7) [m].
    """
    relative = first - second
    near = np.nonzero(distance.min(axis=1) < _REACH * wanted)[0]
    turning = (1.0 - NODES)[:, None] * normal[near, None, 0] + NODES[:, None] * normal[
        near, None, 1
    ]
    # |n|² = 1 - 4 s (1 - s) (1 - c²), c its length half way: |n| is at most this.
    halfway = 0.25 * np.einsum(
        "kj,kj->k", normal[near].sum(axis=1), normal[near].sum(axis=1)
    )
    length = 1.0 - 2.0 * (NODES * (1.0 - NODES)) * (1.0 - halfway)[:, None]
    reached = np.einsum("kij,kij->ki", relative[near], turning)
    keep = np.full(near.size, wanted)
    # Where the pair is apart already it need not do more than it does.
    safe = distance[near].min(axis=1) >= wanted
    keep[safe] = np.minimum(wanted, (reached / length).min(axis=1)[safe])
    # Both ends are given: no wall may ask for more than they allow.
    for index, node in ((0, 0), (relative.shape[0] - 1, -1)):
        row = np.nonzero(near == index)[0]
        keep[row] = np.minimum(keep[row], reached[row, node])
    along_first = np.einsum("kij,kij->ki", first[near], turning)
    along_second = np.einsum("kij,kij->ki", second[near], turning)
    lack = keep[:, None] * length - (along_first - along_second)
    return PairWalls(
        near,
        normal[near],
        along_first + share * lack,
        -(along_second - (1.0 - share) * lack),
    )


def _normals(
    relative: FloatArray, distance: FloatArray, wanted: float, tries: int
) -> FloatArray:
    """Choose unit normals at both ends of each interval, (K, 2, 3), metric."""
    borders = np.concatenate([relative[:, 0], relative[-1:, -1]])
    interval, node = np.unravel_index(int(np.argmin(distance)), distance.shape)
    motion = relative[interval, -1] - relative[interval, 0]
    aside = _side(relative[interval, node], motion, wanted, tries)
    across = borders @ aside
    along = borders - across[:, None] * aside
    # Slow the turning down to what an interval can follow.
    travel = float(np.linalg.norm(motion - (motion @ aside) * aside))
    slower = min(1.0, wanted / max(travel, 1e-9))
    pushed = slower * along + np.maximum(across, wanted)[:, None] * aside
    behind = across < -_BEHIND * wanted
    toward = np.where(behind[:, None], borders, pushed)
    length = np.linalg.norm(toward, axis=1, keepdims=True)
    normal = toward / np.where(length > 0.0, length, 1.0)
    return np.stack([normal[:-1], normal[1:]], axis=1)


def _side(
    miss: FloatArray, motion: FloatArray, wanted: float, tries: int
) -> FloatArray:
    """Direction in which the first passes the second, unit, metric coordinates.

    As they miss each other; head-on to the right; and where that has failed before
    and they are far from apart, above or below, then to the left.
    """
    size = float(np.linalg.norm(miss))
    pace = max(float(np.linalg.norm(motion)), 1e-12)
    # To the right of the first's motion as seen by the second: motion x e_z.
    right = np.array([motion[1], -motion[0], 0.0])
    level = float(np.linalg.norm(right))
    right = np.array([1.0, 0.0, 0.0]) if level < 1e-6 * pace else right / level
    if tries >= _STALLED and level > 0.5 * pace and size < _NEARLY * wanted:
        above = np.array([0.0, 0.0, 1.0])
        above -= (motion @ above) / pace**2 * motion
        above /= np.linalg.norm(above)
        choice = (tries // _STALLED) % 4
        return np.asarray((right, above, -above, -right)[choice])
    if size < HEAD_ON * wanted:
        return right
    return miss / size


def _axis_normals(relative: FloatArray) -> FloatArray:
    """Use the axis along which the pair is farthest apart on each interval."""
    middle = relative[:, relative.shape[1] // 2]
    low, high = relative.min(axis=1), relative.max(axis=1)
    axis = np.argmax(np.maximum(low, -high), axis=1)
    rows = np.arange(relative.shape[0])
    normal = np.zeros((relative.shape[0], 3))
    normal[rows, axis] = np.where(middle[rows, axis] >= 0.0, 1.0, -1.0)
    return np.stack([normal, normal], axis=1)


def interpolated(positions: FloatArray, duration: float) -> PiecewisePolynomial:
    """Return the polynomials through positions at ``NODES`` of even intervals.

    Parameters
    ----------
    positions
        Shape (K, 7, 3) [m].
    duration
        Of all intervals together [s].
    """
    inverse = bernstein_basis_inverse(WALL_DEGREE, tuple(NODES))
    return PiecewisePolynomial(
        np.linspace(0.0, duration, len(positions) + 1),
        np.einsum("ij,kja->kia", inverse, positions),
    )


Laid = tuple["IntArray", "FloatArray", "FloatArray"]
"""Walls of one drone: intervals, normals, offsets at ``NODES``."""


def gathered(parts: Sequence[Laid]) -> Walls:
    """Join walls of one drone."""
    parts = [part for part in parts if part[0].size]
    if not parts:
        return NO_WALLS
    inverse = bernstein_basis_inverse(WALL_DEGREE, tuple(NODES))
    return Walls(
        np.concatenate([part[0] for part in parts]),
        np.concatenate([part[1] for part in parts]),
        np.concatenate([part[2] for part in parts]) @ inverse.T,
    )


def reversed_order(
    start: FloatArray,
    goal: FloatArray,
    parked: FloatArray | None,
    axes: Iterable[int],
) -> tuple[int, int, int] | None:
    """Find a pair that changes its order along one of some axes.

    However it flies, its drones are side by side along that axis at some instant.

    Parameters
    ----------
    start, goal
        Shape (n, 3) [m].
    parked
        Positions of drones that stand still, shape (m, 3) [m].
    axes
        Counting from 0.

    Returns
    -------
    tuple or None
        Rows of the pair, the lower first (parked ones count from n), and the axis.
    """
    if parked is not None:
        start, goal = np.vstack([start, parked]), np.vstack([goal, parked])
    for axis in axes:
        order = np.argsort(start[:, axis], kind="stable")
        back = np.nonzero(np.diff(goal[order, axis]) < 0.0)[0]
        if back.size:
            first, second = sorted(order[back[0] : back[0] + 2].tolist())
            return first, second, axis
    return None
