"""When the drones of a stage leave, so that those whose lines meet pass one by one.

Every pair whose lines come too near has an interval of differences of release that are
forbidden. Giving out releases is scheduling with such pairs as constraints: each drone
in turn takes the first release that those before it allow. The order counts: those on
whom the longest chains of others wait come first, and some other orders are tried, too.
Where a line passes another drone's start or end, only one of the two can pass first;
orders that respect all of this exist unless it goes round in circles, and then every
drone finds a release.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from showc.mission.gaps import Gaps

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]
    Near = list[list[tuple[int, int, int]]]

STEP = 0.1
"""Releases are whole multiples of this [s]."""

LONGEST_WAIT = 600
"""Nobody leaves later than this after the first [s]."""

SHUFFLES = 20
"""Orders with something random in them that are tried, besides the orderly one."""

MOST_TRIES = 200_000
"""Pairs looked at in all orders together: with more pairs, fewer orders are tried."""

MARGIN = 0.01
"""How much farther than their gap two releases are apart [s]."""

NEVER = 10**9


def staggered(
    gaps: Gaps, takes: FloatArray, margin: float = MARGIN
) -> FloatArray | None:
    """Return how long each drone of a stage waits, so that all keep apart.

    Parameters
    ----------
    gaps
        Of the stage's n drones.
    takes
        How long each one flies, shape (n,) [s]: the last arrival is to be early.
    margin
        How much farther than their gap two releases are apart [s].

    Returns
    -------
    ndarray or None
        Multiples of ``STEP``, shape (n,) [s], least zero; None if there are no such
        waits, or none is found.
    """
    if gaps.hopeless():
        return None
    after, before = (
        np.where(
            np.isfinite(gap),
            np.ceil((gap + margin) / STEP - 1e-9),
            np.sign(gap) * NEVER,
        ).astype(np.int64)
        for gap in (gaps.after, gaps.before)
    )
    first, second = gaps.first, gaps.second
    # Whom each drone is near, how much later it may leave, and how much sooner.
    near: Near = [[] for _ in range(gaps.drones)]
    for one, other, a, b in zip(
        first.tolist(), second.tolist(), after.tolist(), before.tolist(), strict=True
    ):
        near[one].append((other, b, a))
        near[other].append((one, a, b))
    order = gaps.order()
    flights = np.ceil(takes / STEP).astype(np.int64)
    tails = _tails(near, order, flights.tolist())
    if tails is None:
        return None
    best: tuple[float, list[int]] | None = None
    shuffle = np.random.default_rng(0)
    spread = max(tails) - min(tails) + 1
    for attempt in range(1 + min(SHUFFLES, MOST_TRIES // max(2 * first.size, 1))):
        chance = shuffle.random(gaps.drones)
        rank = -np.array(tails, dtype=np.float64)
        if attempt:
            rank += (0.02 + 0.04 * (attempt % 4)) * spread * chance
        turns, _ = ordered(gaps.drones, order, rank.tolist())
        waits = _give_out(turns, near)
        if waits is None:
            continue
        end = float((np.array(waits) * STEP + takes).max(initial=0.0))
        if best is None or end < best[0]:
            best = end, waits
        # Nothing ends before the longest chain.
        if best[0] <= max(tails) * STEP:
            break
    if best is None or max(best[1], default=0) * STEP > LONGEST_WAIT:
        return None
    found = np.array(best[1], dtype=np.float64)
    return np.asarray(np.round((found - found.min(initial=0.0)) * STEP, 6))


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


def _tails(
    near: Near, order: list[tuple[int, int]], flights: list[int]
) -> list[int] | None:
    """From each drone's release to the end of the longest chain that waits for it.

    In steps; None if what must come first goes round in circles.
    """
    turns, circles = ordered(len(near), order, range(len(near)))
    if circles:
        return None
    tails = list(flights)
    for drone in reversed(turns):
        for other, ahead, behind in near[drone]:
            # The other one can only come after this one.
            if ahead >= NEVER > behind:
                tails[drone] = max(tails[drone], behind + tails[other])
    return tails


def _give_out(turns: list[int], near: Near) -> list[int] | None:
    """Give each drone in turn the first release, in steps, that the others allow."""
    given = [-1] * len(near)
    for drone in turns:
        wait = 0
        forbidden = [
            (given[other] - behind, given[other] + ahead)
            for other, ahead, behind in near[drone]
            if given[other] >= 0
        ]
        forbidden.sort()
        for low, high in forbidden:
            if low >= wait:
                break
            wait = max(wait, high)
        if wait >= NEVER // 2:
            return None
        given[drone] = wait
    return given
