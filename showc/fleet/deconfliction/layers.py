"""Layers of a crowd: colours of the graph of pairs that meet (Brelaz 1979)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray


def layers(along: FloatArray, first: IntArray, second: IntArray) -> FloatArray:
    """Return layers of drones, (n,), one apart about zero, no pair in the same one.

    Drones that see the most layers about them choose first, then those of most pairs
    (Brelaz 1979). The layers follow each other as their drones do along a line: a row
    that is turned over turns as a bar does.

    Parameters
    ----------
    along
        Where each drone is on that line, shape (n,).
    first, second
        Pairs that meet, each shape (p,).
    """
    drones = along.size
    adjacent = np.zeros((drones, drones), dtype=bool)
    adjacent[first, second] = adjacent[second, first] = True
    pairs = adjacent.sum(axis=1)
    rank = np.argsort(np.argsort(-along, kind="stable")) / drones
    seen = np.zeros((drones, int(pairs.max()) + 1), dtype=bool)
    found = np.full(drones, -1)
    for _ in range(drones):
        urgent = np.where(found < 0, seen.sum(axis=1) * drones + pairs + rank, -1.0)
        drone = int(np.argmax(urgent))
        found[drone] = int(np.argmin(seen[drone]))
        seen[adjacent[drone], found[drone]] = True
    middle = np.bincount(found, along) / np.bincount(found)
    order = np.argsort(np.argsort(middle, kind="stable"))
    return np.asarray(order[found] - 0.5 * (order.size - 1))
