"""Whose straight legs can pass each other by leaving at different whole seconds.

For every pair of drones whose lines come too near, a table says at which differences
of their releases the pair is proved apart. Giving out the releases is then a colouring
with these tables as constraints, done greedily in several orders.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from showc.mission.conflicts import crossing_pairs
from showc.mission.separation import Motion, pairs_apart

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from showc.mission.stage import Stage
    from showc.mission.timing import Timing
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]
    BoolArray = NDArray[np.bool_]

LONGEST_WAIT = 30
"""Nobody leaves later than this after the first [s]."""

NEAR_DIFFERENCE = 8
"""Differences of release up to this are looked at one by one [s]."""

MOST_PAIRS = 4000
"""With more pairs too near, other encodings are quicker found."""

SHUFFLES = 20
"""Random orders that are tried, besides the orderly ones."""


def staggered(
    stage: Stage, separation: Separation, timing: Timing, required: float
) -> FloatArray | None:
    """Return how long each drone of ``stage`` waits, so that all keep apart.

    Parameters
    ----------
    stage
        Straight legs of n drones.
    separation, required
        The metric, and the least distance in it [m].
    timing
        How surely every leg is flown on time.

    Returns
    -------
    ndarray or None
        Whole seconds, shape (n,), least zero; None if no such waits are found.
    """
    a, b = crossing_pairs(stage, separation, required)
    if not 0 < a.size <= MOST_PAIRS:
        return None
    reach = min(ceil(stage.duration + 2.0 * timing.spread), LONGEST_WAIT)
    rows = np.arange(a.size)
    table = np.zeros((a.size, 2 * reach + 1), dtype=np.bool_)
    for later in range(-reach, reach + 1):
        # Differences in between count as too near: they are seldom the best.
        if NEAR_DIFFERENCE < abs(later) < reach:
            continue
        motion = _pair_motion(stage, timing, (a, b), float(later))
        table[:, later + reach] = pairs_apart(
            motion, separation, (rows, a.size + rows), required
        )
    if not np.all(table.any(axis=1)):
        return None
    neighbours: list[list[tuple[int, BoolArray]]] = [[] for _ in stage.drones]
    for row, (one, other) in enumerate(zip(a.tolist(), b.tolist(), strict=True)):
        # Column k of a table: this drone leaves k - reach seconds after the other.
        neighbours[one].append((other, table[row, ::-1]))
        neighbours[other].append((one, table[row]))
    found = [
        waits
        for order in _orders(neighbours)
        if (waits := _give_out(order, neighbours, reach)) is not None
    ]
    if not found:
        return None
    best = min(found, key=lambda waits: (waits.max(), waits.sum()))
    return np.asarray(best, dtype=np.float64)


def _pair_motion(
    stage: Stage, timing: Timing, pairs: tuple[IntArray, IntArray], later: float
) -> Motion:
    """Return each pair on its own: first ones at rows 0.., second ones behind them.

    The second ones leave ``later`` [s] after the first ones.
    """
    both = np.concatenate(pairs)
    start = np.repeat([0.0, later], pairs[0].size)
    overshoot = stage.overshoot[both]
    return Motion(
        stage.begin[both],
        stage.end[both],
        stage.profile.select(both),
        start,
        stage.level[both],
        np.full(both.size, timing.spread),
        overshoot if timing.overshoots else np.zeros(both.size),
        (
            min(later, 0.0) - timing.spread,
            max(later, 0.0) + stage.finish(timing.spread),
        ),
    )


def _orders(neighbours: list[list[tuple[int, BoolArray]]]) -> Iterator[list[int]]:
    """Orders in which releases are given out: busiest first, then shuffled."""
    count = len(neighbours)
    yield sorted(range(count), key=lambda drone: (-len(neighbours[drone]), drone))
    yield list(range(count))
    shuffle = np.random.default_rng(0)
    for _ in range(SHUFFLES):
        yield shuffle.permutation(count).tolist()


def _give_out(
    order: list[int], neighbours: list[list[tuple[int, BoolArray]]], reach: int
) -> IntArray | None:
    """Give each drone in turn the first release that its neighbours allow.

    Releases may come before the first one's: the least is moved to zero at the end.
    """
    given: dict[int, int] = {}
    tries = sorted(
        range(-LONGEST_WAIT, LONGEST_WAIT + 1), key=lambda k: (abs(k), k < 0)
    )
    for drone in order:
        near = [
            (given[other], allowed)
            for other, allowed in neighbours[drone]
            if other in given
        ]
        for wait in tries:
            if all(
                allowed[min(max(wait - other, -reach), reach) + reach]
                for other, allowed in near
            ):
                given[drone] = wait
                break
        else:
            return None
    waits = np.array([given[drone] for drone in range(len(order))], dtype=np.int64)
    waits -= waits.min()
    return waits if waits.max() <= LONGEST_WAIT else None
