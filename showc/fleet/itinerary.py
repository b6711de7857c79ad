"""A whole itinerary: every leg solved, and its place on the timeline."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import SolveError
from showc.fleet.ends import check_ends, place
from showc.fleet.execution.cache import Cache, leg_key
from showc.fleet.execution.checkpoints import Checkpointing
from showc.fleet.execution.journal import Journal, journals
from showc.fleet.execution.pool import InProcess, Processes, workers
from showc.fleet.lanes import put_together
from showc.fleet.leg import solve_leg
from showc.fleet.proof import flaw
from showc.fleet.timetable import settled, timetable
from showc.flight import Flight, LegFlight

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from showc.arrays import FloatArray
    from showc.fleet.execution.pool import Workers
    from showc.fleet.options import SolveOptions
    from showc.plan.itinerary import Itinerary, Leg
    from showc.progress import Progress
    from showc.script.show import Show

SMALL, LARGE = 128, 500
"""Drones up to which a leg of several is one task, on a cluster and on one machine. Two
legs side by side keep two cores busier than the drones of one do, for most of a leg's
work is on all of them. Beyond, several crowded legs at once would take too much memory:
2.8 GiB for two of 1,000 drones that stand as near as they may."""
_UNDER_WAY = 2
"""Larger legs that are solved at once. This process does what is to be done of one leg
as a whole while the processes solve single drones of the other; a third leg would take
memory, and find no core left."""
LONE = 8
"""Drones up to which a leg that is missing alone is solved here: starting processes
takes longer than they would save."""


def solve_itinerary(
    itinerary: Itinerary, options: SolveOptions, progress: Progress
) -> Flight:
    """Solve all legs of ``itinerary`` and lay them on one timeline.

    Legs solved before, by this or another compile, come from the cache, and so does
    what an interrupted one had found of a leg. Legs are solved side by side, those of
    very many drones two at once, their drones side by side. The result depends on the
    itinerary and on how to solve it, never on where the work is done.

    Returns
    -------
    Flight
        A leg starts when all legs it waits for have ended.

    Raises
    ------
    SolveError
        If a leg has no solution; see :func:`showc.fleet.leg.solve_leg`.
    UsageError
        If the number of jobs or the address of the cluster is wrong.
    """
    if options.cluster is not None and not options.cluster.startswith("tls://"):
        progress.note(
            f"the cluster {options.cluster} is used without TLS: anything that "
            "reaches it can run code on its workers and change their results; see "
            "security.md"
        )
    check_places(itinerary)
    with workers(options.jobs, options.cluster) as pool:
        found: dict[str, LegFlight] = {}
        if any(leg.timed for leg in itinerary.legs):
            # When a cue's move may begin is known once those before it are solved.
            itinerary = settled(itinerary)
            free = replace(
                itinerary, legs=tuple(leg for leg in itinerary.legs if leg.open)
            )
            known, found = _solved(free, options, pool, progress, found)
            itinerary = timetable(itinerary, {leg.leg.index: leg for leg in known})
        moves = replace(
            itinerary,
            legs=tuple(part for leg in itinerary.legs for part in leg.parts or (leg,)),
        )
        motions = tuple(leg for leg in moves.legs if leg.motion)
        if motions:
            # Quick to refuse, where a move that is to meet one would search for long.
            alone = replace(itinerary, legs=motions)
            _, found = _solved(alone, options, pool, progress, found)
        solved, _ = _solved(moves, options, pool, progress, found)
        given = iter(solved)

        def again(part: Leg) -> LegFlight:
            alone = replace(itinerary, legs=(part,))
            return _solved(alone, options, pool, progress, {})[0][0]

        flights = tuple(
            put_together(leg, [next(given) for _ in leg.parts], itinerary.show, again)
            if leg.parts
            else next(given)
            for leg in itinerary.legs
        )
    return Flight(itinerary, flights, _starts(flights))


def check_places(itinerary: Itinerary) -> None:
    """Refuse places where drones cannot stand, before anything is solved.

    Up to the first motion that is met or left under way: where drones are from there on
    depends on times that are not known yet.

    Raises
    ------
    SolveError
        If two drones stand too near, or one outside the volume or the fence.
    """
    for leg in takewhile(lambda one: not one.in_motion, itinerary.legs):
        if leg.kind != "hold":
            check_ends(leg, itinerary.show)


def _solved(
    itinerary: Itinerary,
    options: SolveOptions,
    pool: Workers,
    progress: Progress,
    known: dict[str, LegFlight],
) -> tuple[tuple[LegFlight, ...], dict[str, LegFlight]]:
    """Solve the legs of ``itinerary`` that are not ``known``; by leg, and by key."""
    show = itinerary.show
    cache = Cache.of(options)
    keys = [leg_key(leg, show, options) for leg in itinerary.legs]
    found, missing = _look_up(itinerary, keys, cache, pool, progress, known=known)
    tasks = {
        key: _Task(leg, show, options, key, cache.parts(key))
        for key, leg in missing.items()
    }
    most = LARGE if options.cluster is None else SMALL
    few = [key for key, leg in missing.items() if leg.drones.size <= most]
    if len(few) > 1:
        together = [tasks.pop(key) for key in few]
        if options.cluster is not None:
            # Another machine has no business in this one's cache.
            together = [replace(task, parts=None) for task in together]
        found |= _side_by_side(together, cache, pool, progress)
    if options.cluster is None and isinstance(pool, Processes) and len(tasks) > 1:
        found |= _overlapping(list(tasks.values()), cache, pool, progress)
        tasks = {}
    lone = len(missing) == 1 and options.cluster is None
    for key, task in tasks.items():
        here = lone and task.leg.drones.size <= LONE
        flight = task.solve(InProcess() if here else pool, progress)
        found[key] = _kept(cache, task, flight)
    flights = tuple(
        replace(found[key], leg=leg)
        for key, leg in zip(keys, itinerary.legs, strict=True)
    )
    return flights, found


def _look_up(
    itinerary: Itinerary,
    keys: Sequence[str],
    cache: Cache,
    pool: Workers,
    progress: Progress,
    *,
    known: dict[str, LegFlight],
) -> tuple[dict[str, LegFlight], dict[str, Leg]]:
    """Return the legs that the cache has, each proved, and those that it has not.

    Those that are ``known`` already are among the former.
    """
    found = dict(known)
    missing: dict[str, Leg] = {}
    flawed = ""
    progress.stage("looking for solved legs", len(keys))
    for key, leg in zip(keys, itinerary.legs, strict=True):
        progress.advance()
        if key in found or key in missing:
            continue
        flight = cache.find(key, leg)
        wrong = flaw(flight, itinerary.show) if flight is not None else ""
        if flight is not None and not wrong:
            found[key] = flight
            continue
        missing[key] = leg
        if wrong:
            cache.forget(key)
            flawed = f"{leg.name}: {wrong}"
        if len(missing) > 1 or leg.drones.size > LONE:
            pool.prepare()
    if flawed:
        progress.note(
            f"the cache holds a wrong flight ({flawed}); the leg is solved again, and "
            "the cache should not be trusted"
        )
    kept = sum(key in found and key not in known for key in keys)
    if kept:
        progress.note(f"{kept} of {len(keys)} legs taken from the cache")
    return found, missing


def _proved(flight: LegFlight, show: Show) -> LegFlight:
    """Return a flight that workers found, proved here once more.

    Raises
    ------
    SolveError
        If it is not what it should be.
    """
    if wrong := flaw(flight, show):
        raise SolveError(
            f"{place(flight.leg)}: what a worker returned is not a flight of this leg "
            f"({wrong}); look at the machines that work, and report it if they are "
            "your own"
        )
    return flight


def _kept(cache: Cache, task: _Task, flight: LegFlight) -> LegFlight:
    """Prove the flight of a leg and put it into the cache."""
    cache.keep(task.key, _proved(flight, task.show))
    return flight


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """One leg to solve."""

    leg: Leg
    show: Show
    options: SolveOptions
    key: str
    """Name of the leg's entry in the cache."""
    parts: Path | None
    """Where to keep what is found on the way, if anywhere."""

    def solve(self, pool: Workers, progress: Progress) -> LegFlight:
        """Solve the leg, going on where an interrupted compile stopped."""
        given = self.leg, self.show, self.options
        if self.parts is None:
            return solve_leg(*given, pool, progress)
        checkpoints = Checkpointing(pool, self.parts, self.key)
        flight = solve_leg(*given, checkpoints, progress)
        checkpoints.forget()
        return flight


def _alone(task: _Task, journal: Path | None) -> LegFlight | SolveError:
    """Solve a leg in this process; what it refuses is a result like any other."""
    try:
        return task.solve(InProcess(), Journal(journal))
    except SolveError as error:
        return error


def _side_by_side(
    tasks: Sequence[_Task], cache: Cache, pool: Workers, progress: Progress
) -> dict[str, LegFlight]:
    """Solve legs, a process for each.

    Raises
    ------
    SolveError
        That of the first leg that has no solution; the others are kept nevertheless.
    """
    found: dict[str, LegFlight] = {}
    progress.stage(f"solving {len(tasks)} legs in parallel", len(tasks))
    with journals([task.leg.name for task in tasks], progress) as kept:

        def keep(number: int, flight: LegFlight | SolveError) -> None:
            task = tasks[number]
            kept.close(number)
            if isinstance(flight, LegFlight):
                _proved(flight, task.show)
                progress.note(f"{task.leg.name}: {flight.duration:.3f} s")
                found[task.key] = flight
                cache.keep(task.key, flight)

        # Another machine does not see the files of this one.
        here = tasks[0].options.cluster is None
        given = [
            (task, path if here else None)
            for task, path in zip(tasks, kept.paths, strict=True)
        ]
        outcomes = pool.run(_alone, given, progress.advance, keep)
    for flight in outcomes:
        if isinstance(flight, SolveError):
            raise flight
    return found


def _overlapping(
    tasks: Sequence[_Task], cache: Cache, pool: Processes, progress: Progress
) -> dict[str, LegFlight]:
    """Solve legs, some at once in threads that share the processes.

    Raises
    ------
    SolveError
        That of the first leg that has no solution.
    """
    progress.stage(f"solving {len(tasks)} legs, {_UNDER_WAY} at once", len(tasks))
    threads = ThreadPoolExecutor(_UNDER_WAY)
    with journals([task.leg.name for task in tasks], progress) as kept:

        def solve(number: int) -> LegFlight:
            task, journal = tasks[number], Journal(kept.paths[number])
            flight = _kept(cache, task, task.solve(pool, journal))
            kept.close(number)
            progress.note(f"{task.leg.name}: {flight.duration:.3f} s")
            progress.advance()
            return flight

        try:
            waiting = [threads.submit(solve, number) for number in range(len(tasks))]
            return {
                task.key: flight.result()
                for task, flight in zip(tasks, waiting, strict=True)
            }
        finally:
            # What goes wrong is said at once; a leg under way ends where it next asks
            # for the processes.
            threads.shutdown(wait=False, cancel_futures=True)


def _starts(flights: Sequence[LegFlight]) -> FloatArray:
    """Return when each leg starts: when all that it waits for have ended [s]."""
    starts = np.zeros(len(flights))
    for index, flight in enumerate(flights):
        ends = [
            starts[before] + flights[before].duration for before in flight.leg.after
        ]
        starts[index] = round(max(ends, default=0.0), 3)
    starts.setflags(write=False)
    return starts
