"""Bending: single drones solved again, on their side of moving half-spaces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.deconfliction.enclosure import fence_walls
from showc.fleet.deconfliction.walls import gathered, interpolated, pair_walls
from showc.fleet.single_drone.avoiding import Passage
from showc.fleet.single_drone.common_time import OPTIMAL, STRAIGHT, fly_behind
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.fleet.deconfliction.conflicts import Encounters
    from showc.fleet.deconfliction.flights import Flights, Work
    from showc.fleet.deconfliction.walls import Laid, PairWalls
    from showc.fleet.single_drone.common_time import Outcome


_MARGIN = 2e-3
"""How much more than the separation walls keep, for each time that they failed [m]."""
_TRIES = 25
"""Times beyond which that grows no more."""
_CLEARANCE = 0.04
"""How far behind its walls a drone aims, in separations, for each try."""
_STRAY = 0.02
"""How much farther from the fence walls go each time that they were not enough [m]."""
_HALTING = 3
"""Walls that were not enough, after which a drone stops at every corner."""
_REACH = 2.5
"""Distance of others around which a single drone is moved, in separations."""


class Bending:
    """Solves drones of a fleet again, behind walls.

    Parameters
    ----------
    flights
        All flights; they change.
    built
        Whether all processes have the program behind walls: then splines, which need
        none, save nothing.
    """

    def __init__(self, flights: Flights, work: Work, *, built: bool) -> None:
        self.flights, self.work, self.built = flights, work, built
        self.missed: set[int] = set()
        """Drones for which splines are not supple enough."""
        self._rigid: set[int] = set()
        """Drones that found no flight: their partners take the whole correction."""

    def bend(
        self,
        pairs: Sequence[tuple[int, int]],
        active: Mapping[tuple[int, int], int],
        astray: Mapping[int, float],
    ) -> bool:
        """Solve drones again, behind the walls of all active pairs and of the fence.

        Parameters
        ----------
        pairs
            Pairs that come too near.
        active
            All pairs that did, and how often.
        astray
            Rows of drones that left the fence.

        Returns
        -------
        bool
            Whether any flight has changed.
        """
        flights = self.flights
        count, hovers = len(flights.flown), flights.hovers
        met = {row for pair in pairs for row in pair if row < count and not hovers[row]}
        busy = sorted(met | set(astray))
        walls, tried = self._walls(busy, active)
        first = [
            tried[row] == 1 and not self.built and row not in self.missed
            for row in busy
        ]
        tasks = [
            self._task(row, walls[row], tried[row], first=one)
            for row, one in zip(busy, first, strict=True)
        ]
        results = self.work.solve("repair_solves", fly_behind, tasks, "repair")
        changed = False
        self._rigid.clear()
        for row, outcome in zip(busy, results, strict=True):
            kind, flight, _ = self._halting(row) or outcome
            flights.forget(row)
            if flight is None:
                self._rigid.add(row)
            else:
                changed = True
                flights.take(row, kind, flight)
        return changed

    def one_by_one(self, met: Encounters, tries: int) -> bool:
        """Solve drones of pairs that come too near around all others, one by one.

        The worst pair comes first, and of each pair the second drone only if the first
        finds nothing better. Returns whether any did.
        """
        better = False
        # Drones that would be solved again among the same flights, in vain.
        vain: set[int] = set()
        for number in np.argsort(met.distance, kind="stable").tolist():
            for row in (int(met.first[number]), int(met.second[number])):
                if row in vain:
                    continue
                if self._around_others(row, tries):
                    better = True
                    vain.clear()
                    break
                vain.add(row)
        return better

    def _around_others(self, row: int, tries: int) -> bool:
        """Solve one drone around all others as they fly; whether that is better."""
        flights, separation = self.flights, self.flights.separation
        if row >= len(flights.flown) or flights.hovers[row]:
            return False
        own = flights.sampled(row)
        near = [
            other
            for other in range(len(flights.flown) + len(flights.others))
            if other != row
            and measure(own - flights.sampled(other), separation).min()
            < _REACH * separation.distance
        ]
        before = flights.lack(flights.flown[row], near)
        if before == 0.0:
            return False
        margin = _MARGIN * 3**tries
        walls = [
            pair_walls(own, flights.sampled(other), separation, 1.0, margin, tries - 1)
            for other in near
        ]
        laid = [(one.interval, one.normal, one.first) for one in walls]
        if flights.move.fence is not None:
            laid.append(fence_walls(flights.move.fence, own, _STRAY))
        task = self._task(row, laid, tries, first=False)
        ((kind, flight, _),) = self.work.solve("repair_solves", fly_behind, [task])
        if flight is None or flights.lack(flight, near) >= before:
            return False
        flights.take(row, kind, flight)
        return True

    def _task(
        self, row: int, walls: Sequence[Laid], tries: int, *, first: bool
    ) -> tuple[object, ...]:
        """Return what :func:`fly_behind` takes for a drone."""
        flights, reference = self.flights, self.flights.way(row)
        passage = Passage(
            gathered(walls),
            interpolated(flights.sampled(row), reference.end),
            _CLEARANCE * flights.separation.distance * tries,
        )
        return (
            flights.aircraft,
            *flights.move.ends[row],
            reference,
            passage,
            flights.flown[row] if flights.kind[row] == OPTIMAL else None,
            first,
        )

    def _halting(self, row: int) -> Outcome | None:
        """Stop at every corner, as a last resort, where walls were not enough."""
        flights, detours = self.flights, self.flights.move.detours
        if flights.strayed.get(row, 0) < _HALTING or row not in detours:
            return None
        flight = detours[row].halting(flights.aircraft, flights.duration)
        return None if flight is None else (STRAIGHT, flight, "")

    def _walls(
        self, busy: Sequence[int], active: Mapping[tuple[int, int], int]
    ) -> tuple[dict[int, list[Laid]], dict[int, int]]:
        """Lay the walls of drones that are solved again, and count their tries."""
        walls: dict[int, list[Laid]] = {row: [] for row in busy}
        tried = dict.fromkeys(busy, 1)
        fence = self.flights.move.fence
        for row in busy if fence is not None else ():
            assert fence is not None  # noqa: S101 - the line above says so
            again = self.flights.strayed.get(row, 0)
            tried[row] = max(tried[row], again)
            extra = _STRAY * max(again - 1, 0)
            walls[row].append(fence_walls(fence, self.flights.sampled(row), extra))
        for (first, second), tries in active.items():
            for row in {first, second} & walls.keys():
                tried[row] = max(tried[row], tries)
            if first not in walls and second not in walls:
                continue
            found = self._between(first, second, tries)
            if first in walls:
                walls[first].append((found.interval, found.normal, found.first))
            if second in walls:
                walls[second].append((found.interval, -found.normal, found.second))
        return walls, tried

    def _between(self, first: int, second: int, tries: int) -> PairWalls:
        """Lay the walls of a pair, and share out how far each goes."""
        flights, count = self.flights, len(self.flights.flown)
        stuck = [row >= count or row in self._rigid for row in (first, second)]
        hovering = [row >= count or flights.hovers[row] for row in (first, second)]
        if hovering[0] != hovering[1]:
            stuck = hovering
        share = 0.5 if stuck[0] == stuck[1] else float(stuck[1])
        return pair_walls(
            flights.sampled(first),
            flights.sampled(second),
            flights.separation,
            share,
            _MARGIN * min(tries, _TRIES),
            tries - 1,
        )
