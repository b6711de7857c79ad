"""At which differences of their releases two drones are proved apart."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from showc.mission.conflicts import crossing_pairs
from showc.mission.separation import Motion, pairs_apart

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.mission.stage import Stage
    from showc.mission.timing import Timing
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]
    BoolArray = NDArray[np.bool_]

NEAR_DIFFERENCE = 8
"""Differences of release up to this are looked at one by one [s]."""

MOST_PROOFS = 80_000
"""With more pairs too near, fewer of those differences are looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class PairTable:
    """Pairs of a stage's drones whose lines come too near, and when they may leave."""

    drones: int
    """How many fly in the stage."""
    first: IntArray
    """Position in the stage of each pair's first drone, shape (m,)."""
    second: IntArray
    """Of its second one."""
    reach: int
    """With this difference [s] one has ended its leg before the other leaves."""
    allowed: BoolArray
    """Column k, shape (m, 2 reach + 1): apart if the second one leaves k - reach
    seconds after the first."""

    @property
    def after(self) -> BoolArray:
        """Whether the second one may leave when the first has ended, shape (m,)."""
        return np.asarray(self.allowed[:, -1])

    @property
    def before(self) -> BoolArray:
        """Whether the first one may leave when the second has ended, shape (m,)."""
        return np.asarray(self.allowed[:, 0])

    def neighbours(self) -> list[list[tuple[int, BoolArray]]]:
        """For each drone, those it conflicts with and when it may leave.

        Column k: this drone leaves k - reach seconds after the other.
        """
        found: list[list[tuple[int, BoolArray]]] = [[] for _ in range(self.drones)]
        pairs = zip(self.first.tolist(), self.second.tolist(), strict=True)
        for row, (one, other) in enumerate(pairs):
            found[one].append((other, self.allowed[row, ::-1]))
            found[other].append((one, self.allowed[row]))
        return found

    def order(self) -> list[tuple[int, int]]:
        """Pairs (earlier, later) of drones that can only fly in this order."""
        only_after = self.after & ~self.before
        only_before = self.before & ~self.after
        return [
            *_as_pairs(self.first[only_after], self.second[only_after]),
            *_as_pairs(self.second[only_before], self.first[only_before]),
        ]

    def hopeless(self) -> list[tuple[int, int]]:
        """Pairs that meet whichever of them flies first."""
        neither = ~self.after & ~self.before
        return _as_pairs(self.first[neither], self.second[neither])


def pair_table(
    stage: Stage, separation: Separation, timing: Timing, required: float
) -> PairTable:
    """Return the table of the straight legs of ``stage``.

    Parameters
    ----------
    stage
        Straight legs of n drones.
    separation, required
        The metric, and the least distance in it [m].
    timing
        How surely every leg is flown on time.
    """
    a, b = crossing_pairs(stage, separation, required)
    reach = max(1, ceil(stage.finish(2.0 * timing.spread) + timing.spread))
    proofs = 2 * NEAR_DIFFERENCE * a.size
    near = NEAR_DIFFERENCE if proofs <= MOST_PROOFS else MOST_PROOFS // (2 * a.size)
    count = stage.drones.size
    table = np.zeros((a.size, 2 * reach + 1), dtype=np.bool_)
    for later in range(-reach, reach + 1):
        # Differences in between count as too near: they are seldom the best.
        if near < abs(later) < reach:
            continue
        motion = _twice(stage, timing, float(later))
        table[:, later + reach] = pairs_apart(
            motion, separation, (a, count + b), required
        )
    return PairTable(stage.drones.size, a, b, reach, table)


def _as_pairs(one: IntArray, other: IntArray) -> list[tuple[int, int]]:
    return list(zip(one.tolist(), other.tolist(), strict=True))


def _twice(stage: Stage, timing: Timing, later: float) -> Motion:
    """Return every drone of the stage twice, the second time ``later`` [s] released.

    A pair's first drone is looked up in the first half, its second one in the other.
    """
    count = stage.drones.size
    both = np.tile(np.arange(count), 2)
    overshoot = stage.overshoot[both]
    return Motion(
        stage.begin[both],
        stage.end[both],
        stage.profile.select(both),
        np.repeat([0.0, later], count),
        stage.level[both],
        np.full(both.size, timing.spread),
        overshoot if timing.overshoots else np.zeros(both.size),
        (
            min(later, 0.0) - timing.spread,
            max(later, 0.0) + stage.finish(timing.spread),
        ),
    )
