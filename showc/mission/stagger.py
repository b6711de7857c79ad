"""Whose straight legs can pass each other by leaving at different whole seconds.

For every pair of drones whose lines come too near, a table says at which differences of
their releases the pair is proved apart. Giving out the releases is then a colouring
with these tables as constraints, done greedily in several orders. Where a line passes
another drone's start or end, only one of the two can fly first; orders that respect all
of this exist unless it goes round in circles, and then every drone finds a release.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from showc.mission.pair_table import PairTable

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]
    BoolArray = NDArray[np.bool_]
    Neighbours = list[list[tuple[int, BoolArray]]]

LONGEST_WAIT = 600
"""Nobody leaves later than this after the first [s]."""

SHUFFLES = 20
"""Random orders that are tried, besides the orderly ones."""

MOST_TRIES = 200_000
"""Drones placed in all orders together: with more drones, fewer orders are tried."""


def staggered(table: PairTable) -> FloatArray | None:
    """Return how long each drone of a stage waits, so that all keep apart.

    Returns
    -------
    ndarray or None
        Whole seconds, shape (n,), least zero; None if no such waits are found.
    """
    if not table.first.size or not np.all(table.allowed.any(axis=1)):
        return None
    neighbours = table.neighbours()
    conflicts = sum(len(near) for near in neighbours)
    shuffles = min(SHUFFLES, MOST_TRIES // max(conflicts, 1))
    found = [
        waits
        for order, forward in _orders(table, neighbours, shuffles)
        if (waits := _give_out(order, neighbours, table.reach, forward=forward))
        is not None
    ]
    if not found:
        return None
    best = min(found, key=lambda waits: (waits.max(), waits.sum()))
    return np.asarray(best, dtype=np.float64)


def ordered(
    count: int, before: Iterable[tuple[int, int]], rank: Sequence[float]
) -> tuple[list[int], list[int]]:
    """Order things so that the first of each pair ``before`` comes before the second.

    Kahn's algorithm (1962), the least ``rank`` (count,) first where there is a choice.

    Returns
    -------
    tuple
        Those that could be put in order, and the others, each of which is in a circle
        or behind one.
    """
    later: list[list[int]] = [[] for _ in range(count)]
    missing = [0] * count
    for one, other in before:
        later[one].append(other)
        missing[other] += 1
    ready = [(rank[item], item) for item in range(count) if not missing[item]]
    heapify(ready)
    order = []
    while ready:
        _, item = heappop(ready)
        order.append(item)
        for other in later[item]:
            missing[other] -= 1
            if not missing[other]:
                heappush(ready, (rank[other], other))
    return order, [item for item in range(count) if missing[item]]


def _orders(
    table: PairTable, neighbours: Neighbours, shuffles: int
) -> Iterator[tuple[list[int], bool]]:
    """Orders in which releases are given out, and whether only forward in time."""
    count = len(neighbours)
    busy = [-len(near) for near in neighbours]
    shuffle = np.random.default_rng(0)
    ranks: list[Sequence[float]] = [busy, range(count)]
    ranks += [shuffle.random(count).tolist() for _ in range(shuffles)]
    before = table.order()
    for rank in ranks:
        yield sorted(range(count), key=lambda drone: (rank[drone], drone)), False
        order, circles = ordered(count, before, rank)
        if before and not circles:
            yield order, True


def _give_out(
    order: list[int], neighbours: Neighbours, reach: int, *, forward: bool
) -> IntArray | None:
    """Give each drone in turn the first release that its neighbours allow.

    Unless ``forward``, releases may come before the first one's: the least is moved to
    zero at the end.
    """
    given: dict[int, int] = {}
    if forward:
        tries: Sequence[int] = range(LONGEST_WAIT + 1)
    else:
        around = range(-3 * reach, 3 * reach + 1)
        tries = sorted(around, key=lambda k: (abs(k), k < 0))
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
