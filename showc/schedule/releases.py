"""When the drones of a stage leave, so that those whose lines meet pass one by one.

Every pair whose lines come too near has an interval of differences of release that are
forbidden. Giving out releases is scheduling with such pairs as constraints: each drone
in turn takes the first release that those before it allow. The order counts: those on
which the longest chains of others wait come first; other orders are tried, too.
Where a line passes another drone's start or end, only one of the two can pass first;
orders that respect all of this exist unless it goes round in circles, and then every
drone finds a release.
"""

from __future__ import annotations

from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from showc.arrays import FloatArray
    from showc.schedule.headways import Gaps

    Near = list[list[tuple[int, int, int]]]
    Number = TypeVar("Number", int, float)

STEP = 0.1
"""Releases are whole multiples of this [s]."""

LONGEST_WAIT = 600
"""No drone leaves later than this after the first [s]."""

SHUFFLES = 20
"""Orders with something random in them that are tried, besides the orderly one."""

MOST_TRIES = 200_000
"""Pairs looked at in all orders together: with more pairs, fewer orders are tried."""

MARGIN = 0.01
"""How much farther than their gap two releases are apart [s]."""

NEVER = 10**9
"""Steps that stand for a release that no schedule has: 3 years."""

ROUNDING = 1e-6
"""Times that differ by less may be the same [s]."""


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
    # The drones near each one, how much later it may leave, and how much sooner.
    near: Near = [[] for _ in range(gaps.drones)]
    for one, other, a, b in zip(
        first.tolist(), second.tolist(), after.tolist(), before.tolist(), strict=True
    ):
        near[one].append((other, b, a))
        near[other].append((one, a, b))
    order = gaps.order()
    chains = _chains(near, order)
    if chains is None:
        return None
    flights = np.ceil(takes / STEP).astype(np.int64)
    tails = _tails(chains, flights.tolist(), 1)
    own = takes.tolist()
    turns = _Turns(near, order, own, _tails(chains, own, STEP))
    best: list[int] | None = None
    end = float("inf")
    shuffle = np.random.default_rng(0)
    spread = max(tails) - min(tails) + 1
    for attempt in range(1 + min(SHUFFLES, MOST_TRIES // max(2 * first.size, 1))):
        chance = shuffle.random(gaps.drones)
        rank = -np.array(tails, dtype=np.float64)
        if attempt:
            rank += (0.02 + 0.04 * (attempt % 4)) * spread * chance
        waits = turns.give_out(rank.tolist(), end)
        if waits is None:
            continue
        arrival = float((np.array(waits) * STEP + takes).max(initial=0.0))
        if arrival >= end:
            continue
        best, end = waits, arrival
        # Nothing ends before the longest chain.
        if end <= max(tails) * STEP:
            break
    if best is None or max(best, default=0) * STEP > LONGEST_WAIT:
        return None
    found = np.array(best, dtype=np.float64)
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


def _chains(
    near: Near, order: list[tuple[int, int]]
) -> list[tuple[int, int, int]] | None:
    """Drones that can only come after others, by how much [steps]; last first.

    None if what must come first goes round in circles.
    """
    turns, circles = ordered(len(near), order, range(len(near)))
    if circles:
        return None
    return [
        (drone, other, behind)
        for drone in reversed(turns)
        for other, ahead, behind in near[drone]
        if ahead >= NEVER > behind
    ]


def _tails(
    chains: list[tuple[int, int, int]], flights: list[Number], step: Number
) -> list[Number]:
    """From each drone's release to the end of the longest chain that waits for it.

    In the unit of the ``flights``, of which one ``step`` has this number.
    """
    tails = list(flights)
    for drone, other, behind in chains:
        tails[drone] = max(tails[drone], behind * step + tails[other])
    return tails


class _Turns:
    """Gives out releases, in orders in which some drones come before others.

    Parameters
    ----------
    near
        For each drone those near it, how much later it may leave than that one, and
        how much sooner [steps].
    before
        Pairs of drones, the first of which gets its release before the second.
    takes
        How long each one flies [s].
    tails
        From each one's release to the end of the longest chain that waits for it [s].
    """

    def __init__(
        self,
        near: Near,
        before: list[tuple[int, int]],
        takes: list[float],
        tails: list[float],
    ) -> None:
        self.near, self.takes, self.tails = near, takes, tails
        self.later: list[list[int]] = [[] for _ in near]
        self.missing = [0] * len(near)
        for one, other in before:
            self.later[one].append(other)
            self.missing[other] += 1
        # A drone near no other leaves at once, whatever the order is.
        self.alone = max(
            (time for time, others in zip(takes, near, strict=True) if not others),
            default=0.0,
        )
        self.first = [
            drone for drone, none in enumerate(self.missing) if near[drone] and not none
        ]

    def give_out(self, rank: list[float], end: float) -> list[int] | None:
        """Give each drone the first release, in steps, that those before it allow.

        The least ``rank`` comes first where there is a choice, as in :func:`ordered`.
        None if a drone finds no release, or the last one cannot arrive before ``end``
        [s].
        """
        if self.alone >= end:
            return None
        near, takes, tails = self.near, self.takes, self.tails
        missing, given = self.missing.copy(), [-1] * len(near)
        forbidden: list[list[tuple[int, int]]] = [[] for _ in near]
        ready = [(rank[drone], drone) for drone in self.first]
        heapify(ready)
        # However the times of a chain are added up.
        enough = end + ROUNDING
        while ready:
            _, drone = heappop(ready)
            wait = _first_free(forbidden[drone]) if forbidden[drone] else 0
            if wait >= NEVER // 2:
                return None
            leaves = wait * STEP
            if leaves + takes[drone] >= end or leaves + tails[drone] >= enough:
                return None
            given[drone] = wait
            for other, ahead, behind in near[drone]:
                if given[other] < 0:
                    forbidden[other].append((wait - ahead, wait + behind))
            for other in self.later[drone]:
                missing[other] -= 1
                if not missing[other]:
                    heappush(ready, (rank[other], other))
        return [max(wait, 0) for wait in given]


def _first_free(forbidden: list[tuple[int, int]]) -> int:
    """Return the first step from 0 on that is in none of the open intervals."""
    wait = 0
    for low, high in sorted(forbidden):
        if low >= wait:
            break
        wait = max(wait, high)
    return wait
