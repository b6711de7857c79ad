"""Which drones can go one after the other, on straight lines, at any timing."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING

import numpy as np

from showc.mission.separation import part_distance

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.mission.stage import Stage
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]
    Pairs = tuple[IntArray, IntArray]

MOST_WAVES = 4
"""More than these cost more time than a bend."""

ROWS = 256
"""Drones whose pairs are looked at together."""


def crossing_pairs(stage: Stage, separation: Separation, required: float) -> Pairs:
    """Pairs of a stage's drones whose lines come nearer than ``required`` [m].

    Returns
    -------
    tuple of ndarray
        Positions in the stage, first below second, each of shape (m,).
    """
    count = stage.drones.size
    found_a, found_b = [], []
    for top in range(0, count, ROWS):
        a, b = np.meshgrid(
            np.arange(top, min(top + ROWS, count)), np.arange(count), indexing="ij"
        )
        wanted = a < b
        a, b = a[wanted], b[wanted]
        near = (
            part_distance(
                (stage.begin[a], stage.end[a]),
                (stage.begin[b], stage.end[b]),
                separation,
            )
            < required
        )
        found_a.append(a[near])
        found_b.append(b[near])
    return np.concatenate(found_a), np.concatenate(found_b)


def waves(
    stage: Stage, separation: Separation, required: float
) -> list[IntArray] | None:
    """Split a stage into waves that can follow each other on the same straight lines.

    Of two drones whose lines meet, one goes first; it can if its line keeps away from
    where the other starts, and the other's line from where it ends.

    Returns
    -------
    list of ndarray or None
        Drones of each wave; None if there is no such order, or only one of more than
        ``MOST_WAVES`` waves.
    """
    a, b = crossing_pairs(stage, separation, required)
    first_a = _may_go_first(stage, (a, b), separation, required)
    first_b = _may_go_first(stage, (b, a), separation, required)
    if not np.all(first_a | first_b):
        return None
    rank = _longest_chains(stage.drones.size, a, b, first_a)
    if rank is None or rank.max(initial=0) >= MOST_WAVES:
        return None
    return [stage.drones[rank == wave] for wave in range(int(rank.max()) + 1)]


def _may_go_first(
    stage: Stage, pairs: Pairs, separation: Separation, required: float
) -> NDArray[np.bool_]:
    """Whether the first of each pair can fly before the second leaves."""
    early, late = pairs
    leaving = part_distance(
        (stage.begin[early], stage.end[early]),
        (stage.begin[late], stage.begin[late]),
        separation,
    )
    passing = part_distance(
        (stage.begin[late], stage.end[late]),
        (stage.end[early], stage.end[early]),
        separation,
    )
    return np.asarray(np.minimum(leaving, passing) >= required)


def _longest_chains(
    count: int, a: IntArray, b: IntArray, first_a: NDArray[np.bool_]
) -> IntArray | None:
    """Wave of each drone when ``a`` goes before ``b`` where it may; None on a cycle."""
    before: dict[int, set[int]] = {node: set() for node in range(count)}
    for one, other, forward in zip(a, b, first_a, strict=True):
        early, late = (one, other) if forward else (other, one)
        before[int(late)].add(int(early))
    rank = np.zeros(count, dtype=np.int64)
    try:
        for node in TopologicalSorter(before).static_order():
            rank[node] = max((rank[early] + 1 for early in before[node]), default=0)
    except CycleError:
        return None
    return rank


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
