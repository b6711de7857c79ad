"""Wires: lines between fixed points, strung with places."""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heapify, heapreplace
from typing import TYPE_CHECKING

import numpy as np

from showc.script.formations.evenly import spread_evenly

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Wire:
    """One line from a fixed point to another, or a ring without any."""

    points: FloatArray
    """Corners of the line, shape (corners, k); a ring ends where it begins."""
    ring: bool = False
    """Whether it is a ring."""


def string(anchors: FloatArray, wires: Sequence[Wire], count: int) -> FloatArray:
    """Place points on the fixed points first, then evenly on the wires.

    Each further point goes to the wire whose gaps are the widest. Where there are
    fewer points than fixed points, those are chosen that are furthest apart.

    Parameters
    ----------
    anchors
        Fixed points, shape (anchors, k).
    wires
        The lines between them, and rings.
    count
        Number of points.

    Returns
    -------
    FloatArray
        Shape (count, k): the fixed points, then wire by wire.
    """
    rings = [wire for wire in wires if wire.ring]
    if count < len(anchors) + len(rings):
        seeds = np.concatenate([anchors, *(ring.points[:1] for ring in rings)])
        return np.asarray(seeds[spread_evenly(seeds, count, rounds=0)])
    reach = [
        np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(wire.points, axis=0), axis=1))]
        )
        for wire in wires
    ]
    inner = [int(wire.ring) for wire in wires]
    widest = [
        (-round(float(lengths[-1]) / (number + (not wire.ring)), 9), index)
        for index, (wire, lengths, number) in enumerate(
            zip(wires, reach, inner, strict=True)
        )
    ]
    heapify(widest)
    for _ in range(count - len(anchors) - len(rings)):
        index = widest[0][1]
        inner[index] += 1
        gap = float(reach[index][-1]) / (inner[index] + (not wires[index].ring))
        heapreplace(widest, (-round(gap, 9), index))
    placed = [anchors]
    for wire, lengths, number in zip(wires, reach, inner, strict=True):
        steps = np.arange(number) if wire.ring else np.arange(number) + 1.0
        share = steps / (number + (not wire.ring)) if number else steps
        placed.append(
            np.column_stack(
                [
                    np.interp(share * lengths[-1], lengths, axis)
                    for axis in wire.points.T
                ]
            )
        )
    return np.concatenate(placed)
