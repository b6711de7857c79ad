"""Which drones of a stage have lines that meet, and how to give them numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.mission.distances import near_pairs, part_distance

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.mission.stage import Stage
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]
    Pairs = tuple[IntArray, IntArray]


def crossing_pairs(stage: Stage, separation: Separation, required: float) -> Pairs:
    """Pairs of a stage's drones whose lines come nearer than ``required`` [m].

    Lines go on beyond their ends by the overshoot.

    Returns
    -------
    tuple of ndarray
        Positions in the stage, first below second, each of shape (m,).
    """
    farthest = stage.farthest
    everyone = np.ones(stage.drones.size, dtype=np.bool_)
    a, b = near_pairs((stage.begin, farthest), separation, required, everyone)
    near = (
        part_distance(
            (stage.begin[a], farthest[a]), (stage.begin[b], farthest[b]), separation
        )
        < required
    )
    return a[near], b[near]


def conflict_colours(stage: Stage, separation: Separation, required: float) -> IntArray:
    """Give drones whose lines meet different numbers, few and small; shape (n,).

    Greedy colouring, drones with most conflicts first (Welsh and Powell 1967).
    """
    a, b = crossing_pairs(stage, separation, required)
    count = stage.drones.size
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for one, other in zip(a.tolist(), b.tolist(), strict=True):
        neighbours[one].append(other)
        neighbours[other].append(one)
    colour = np.full(count, -1, dtype=np.int64)
    for node in _by_degree(neighbours):
        taken = {int(colour[other]) for other in neighbours[node]}
        colour[node] = next(free for free in range(count) if free not in taken)
    return colour


def _by_degree(neighbours: list[list[int]]) -> Iterator[int]:
    return iter(sorted(range(len(neighbours)), key=lambda i: (-len(neighbours[i]), i)))
