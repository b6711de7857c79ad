"""A whole itinerary: every leg solved, and its place on the timeline."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.flight import Flight, LegFlight
from showc.solve.cache import Cache, leg_key
from showc.solve.leg import solve_leg
from showc.solve.pool import workers
from showc.solve.remembering import Remembering

if TYPE_CHECKING:
    from showc.plan.itinerary import Itinerary
    from showc.progress import Progress
    from showc.solve.options import SolveOptions


def solve_itinerary(
    itinerary: Itinerary, options: SolveOptions, progress: Progress
) -> Flight:
    """Solve all legs of ``itinerary`` and lay them on one timeline.

    Legs solved before, by this or another compile, come from the cache, and so does
    what an interrupted one had found of a leg. The result
    depends on the itinerary and on how to solve it, never on where the work is done.

    Returns
    -------
    Flight
        A leg starts when all legs it waits for have ended.

    Raises
    ------
    SolveError
        If a leg has no solution; see :func:`showc.solve.leg.solve_leg`.
    UsageError
        If the number of jobs or the address of the cluster is wrong.
    """
    show = itinerary.show
    cache = Cache.of(options)
    flights: list[LegFlight] = []
    with workers(options.jobs, options.cluster) as crew:
        for leg in itinerary.legs:
            progress.stage(f"{leg.name}: looking up")
            key = leg_key(leg, show, options)
            flight = cache.find(key, leg)
            if flight is None:
                crew.prepare()
                folder = cache.parts(key)
                if folder is None:
                    flight = solve_leg(leg, show, options, crew, progress)
                else:
                    remembering = Remembering(crew, folder, key)
                    flight = solve_leg(leg, show, options, remembering, progress)
                    cache.keep(key, flight)
                    remembering.forget()
            else:
                progress.note(f"{leg.name}: taken from the cache")
                flight = replace(flight, leg=leg)
            flights.append(flight)
    starts = np.zeros(len(flights))
    for index, flight in enumerate(flights):
        ends = [
            starts[before] + flights[before].duration for before in flight.leg.after
        ]
        starts[index] = round(max(ends, default=0.0), 3)
    starts.setflags(write=False)
    return Flight(itinerary, tuple(flights), starts)
