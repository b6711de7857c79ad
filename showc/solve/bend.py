"""A first way round: drones that would meet head-on bend aside, each to its own right.

The bent ways are never flown. They only say on which side of each other the drones
shall pass, and how far aside a crowd that meets in one point must go; half-spaces are
then laid between them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.plan.metric import measure

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.solve.conflicts import Encounters
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]

HEAD_ON = 0.15
"""Share of the separation below which a pair meets head-on."""
_PULL = 2.0
_FIRST = 0.6
_GROWTH = 1.25
_STEPS = 14


def head_on_crowds(
    found: Encounters, separation: Separation, moving: int
) -> list[dict[int, float]]:
    """Drones that meet head-on, joined into crowds: row and time of meeting [s]."""
    head_on = (found.distance < HEAD_ON * separation.distance) & (found.second < moving)
    leader: dict[int, int] = {}

    def root(row: int) -> int:
        while leader.setdefault(row, row) != row:
            row = leader[row]
        return row

    times: dict[int, list[float]] = {}
    for first, second, time in zip(
        found.first[head_on].tolist(),
        found.second[head_on].tolist(),
        found.time[head_on].tolist(),
        strict=True,
    ):
        leader[max(root(first), root(second))] = min(root(first), root(second))
        times.setdefault(first, []).append(time)
        times.setdefault(second, []).append(time)
    crowds: dict[int, dict[int, float]] = {}
    for row in sorted(times):
        crowds.setdefault(root(row), {})[row] = float(np.mean(times[row]))
    return list(crowds.values())


def bent(
    positions: FloatArray,
    instants: FloatArray,
    meeting: FloatArray,
    way: FloatArray,
    separation: Separation,
) -> FloatArray:
    """Bend a crowd just far enough aside that it keeps apart, if it can.

    Parameters
    ----------
    positions
        Positions of the crowd, shape (n, m, 3) [m].
    instants
        Their times, shape (m,) [s].
    meeting
        When each drone meets others, shape (n,) [s].
    way
        Displacement of each drone over the leg, shape (n, 3) [m].

    Returns
    -------
    ndarray, shape (n, m, 3)
    """
    aside = np.stack([way[:, 1], -way[:, 0], np.zeros(way.shape[0])], axis=1)
    size = np.linalg.norm(aside, axis=1)
    # Straight up or down there is no right; who hovers stays (its sign is 0).
    upright = size <= 1e-6 * np.linalg.norm(way, axis=1)
    aside[upright] = np.sign(way[upright, 2:]) * np.array([1.0, 0.0, 0.0])
    aside /= np.where(upright, 1.0, size)[:, None]
    upper = np.triu_indices(way.shape[0], 1)
    first = positions
    for step in range(_STEPS):
        amplitude = _FIRST * separation.distance * _GROWTH**step
        # Time to go aside and back with a fair share of the sideways acceleration.
        half = np.minimum(
            3.0 * np.sqrt(amplitude / _PULL),
            np.minimum(meeting, instants[-1] - meeting),
        )[:, None]
        phase = np.clip((instants - meeting[:, None]) / np.maximum(half, 1e-6), -1, 1)
        bump = amplitude * np.cos(0.5 * np.pi * phase) ** 2
        moved = positions + bump[..., None] * aside[:, None, :]
        if step == 0:
            first = moved
        gap = moved[upper[0]] - moved[upper[1]]
        if float(measure(gap, separation).min()) >= 1.02 * separation.distance:
            return np.asarray(moved)
    return np.asarray(first)
