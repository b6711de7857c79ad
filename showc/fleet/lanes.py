"""A leg whose groups have times of their own, put together from their moves.

Each move is solved as a leg of its group, around the drones that stand meanwhile, and
so is what a formation does while a group holds it. Here the drones hover before,
between and after, and all pairs are looked at over the whole leg, in continuous time.
Moves are flown again around others; what a formation does is as the script has it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import SolveError
from showc.fleet.deconfliction.conflicts import conflicts
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.ends import TOLERANCE, pair_names, place
from showc.fleet.leg import aircraft_of, nearest_pair
from showc.fleet.single_drone.following import hover
from showc.flight import Certificate, LegFlight, Trajectory
from showc.trajectory import PiecewisePolynomial, concatenate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from showc.fleet.single_drone.model import Aircraft
    from showc.plan.itinerary import Leg
    from showc.script.show import Show


_MOMENT = 1e-6
"""Time that is rounding [s]: flights last whole milliseconds."""


_AGAIN = 3
"""How often each move is flown again at most."""


def put_together(
    leg: Leg, moves: Sequence[LegFlight], show: Show, solve: Callable[[Leg], LegFlight]
) -> LegFlight:
    """Return the flight of a leg from those of its parts.

    Parameters
    ----------
    leg
        With its times.
    moves
        One for each of ``leg.parts``, flown as if no other group moved.
    show
        With the separation.
    solve
        Flies a part again, around others.

    Raises
    ------
    SolveError
        If two drones come too near, whatever flies again; the message names them.
    """
    duration, separation = leg.duration or 0.0, show.separation
    found, tries = list(moves), [0] * len(moves)
    while True:
        flown = _flown(leg, found, show)
        met = conflicts(tracks_of(flown), separation, separation.distance - TOLERANCE)
        if not len(met):
            break
        nearest = int(np.argmin(met.distance))
        pair = int(met.first[nearest]), int(met.second[nearest])
        time = float(met.time[nearest])
        movers = [
            number
            for number, part in enumerate(leg.parts)
            if tries[number] < _AGAIN
            and not part.motion
            and np.isin(leg.drones[list(pair)], part.drones).any()
            and 0.0 < time - _begin(part, leg) < (part.duration or 0.0)
        ]
        if not movers:
            raise SolveError(
                f"{place(leg)}: {pair_names(leg, *pair)} come within "
                f"{met.distance[nearest]:.3f} m at {(leg.depart or 0.0) + time:.2f} s "
                "of the show, while their groups move at times of their own, the "
                f"separation is {separation.distance:.3f} m ({len(met)} pairs in all); "
                "let one of the groups move later, or move their formations apart"
            )
        # The one that was not tried yet, of these the one that starts last, gives way.
        again = min(movers, key=lambda one: (tries[one], -_begin(leg.parts[one], leg)))
        tries[again] += 1
        with suppress(SolveError):
            found[again] = solve(_around(leg.parts[again], leg, flown))
    certificate = Certificate(
        duration,
        0.0,
        0.0,
        None,
        nearest_pair(leg, flown, separation),
        "groups in times of their own: "
        + "; ".join(f"{move.leg.name}: {move.certificate.method}" for move in found),
        {
            "drones": float(leg.drones.size),
            "moves": float(len(moves)),
            "flown_again": float(sum(tries)),
        },
    )
    return LegFlight(
        leg, duration, flown, certificate, tuple(_of_fleet(move) for move in found)
    )


def _begin(part: Leg, leg: Leg) -> float:
    """When a part begins since the start of its leg [s]."""
    return round((part.depart or 0.0) - (leg.depart or 0.0), 3)


def _flown(leg: Leg, moves: Sequence[LegFlight], show: Show) -> tuple[Trajectory, ...]:
    """Flights of all drones over the leg."""
    aircraft = aircraft_of(show, leg)
    return tuple(
        _whole(leg, row, list(_moves_of(leg, row, moves)), aircraft)
        for row in range(leg.drones.size)
    )


def _around(part: Leg, leg: Leg, flown: Sequence[Trajectory]) -> Leg:
    """Return a part that is to be flown around all others as they fly now."""
    begin, duration = _begin(part, leg), part.duration or 0.0
    rows = np.flatnonzero(~np.isin(leg.drones, part.drones)).tolist()
    others = tuple(
        _during(flown[row].state.select(slice(0, 3)), begin, duration) for row in rows
    )
    numbers = tuple(leg.drones[rows].tolist())
    return replace(part, others=others, others_parked=None, others_drones=numbers)


def _during(
    path: PiecewisePolynomial, begin: float, duration: float
) -> PiecewisePolynomial:
    """Cut a path to a time, and count from its beginning [s]."""
    ends = np.array([begin, begin + duration])
    # Breaks that are the ends but for rounding stay whole.
    near = np.abs(path.breaks - ends[:, None]).min(axis=1) < _MOMENT
    path = path.split(ends[~near])
    first, last = (int(np.argmin(np.abs(path.breaks - end))) for end in ends)
    breaks = path.breaks[first : last + 1] - begin
    breaks[0], breaks[-1] = 0.0, duration
    return PiecewisePolynomial(breaks, path.coefficients[first:last])


def _of_fleet(move: LegFlight) -> LegFlight:
    """Return a move whose witness names its drone by its number in the fleet."""
    certificate = move.certificate
    if certificate.witness is None:
        return move
    drone = int(move.leg.drones[certificate.witness.drone])
    witness = replace(certificate.witness, drone=drone)
    return replace(move, certificate=replace(certificate, witness=witness))


def _moves_of(
    leg: Leg, row: int, moves: Sequence[LegFlight]
) -> Iterator[tuple[float, Trajectory]]:
    """Yield the moves of one drone of a leg, and when each begins since its start."""
    drone = int(leg.drones[row])
    for part, move in zip(leg.parts, moves, strict=True):
        column = int(np.searchsorted(part.drones, drone))
        if column < part.drones.size and part.drones[column] == drone:
            yield _begin(part, leg), move.trajectories[column]


def _whole(
    leg: Leg, row: int, moves: Sequence[tuple[float, Trajectory]], aircraft: Aircraft
) -> Trajectory:
    """Return a drone's flight over the leg: hovers and moves in turn."""
    where, clock, parts = leg.start[row], 0.0, []
    for begin, move in [*moves, (leg.duration or 0.0, None)]:
        if begin - clock > _MOMENT:
            parts.append(_later(hover(aircraft, where, begin - clock), clock))
        if move is not None:
            parts.append(_later(move, begin))
            clock = begin + move.state.end
            where = move.state.coefficients[-1, -1, :3]
    state = concatenate([part.state for part in parts])
    control = concatenate([part.control for part in parts])
    breaks = np.append(state.breaks[:-1], leg.duration or 0.0)
    return Trajectory(
        PiecewisePolynomial(breaks, state.coefficients),
        PiecewisePolynomial(breaks, control.coefficients),
    )


def _later(flight: Trajectory, time: float) -> Trajectory:
    return Trajectory(flight.state.shifted(time), flight.control.shifted(time))
