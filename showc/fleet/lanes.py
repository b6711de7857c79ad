"""A leg whose groups have times of their own, put together from their moves.

Each move is solved as a leg of its group, around the drones that stand meanwhile. Here
the drones hover before, between and after their moves, and all pairs are looked at over
the whole leg, in continuous time.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import SolveError
from showc.fleet.deconfliction.conflicts import conflicts
from showc.fleet.deconfliction.tracks import tracks_of
from showc.fleet.leg import (
    TOLERANCE,
    aircraft_of,
    nearest_pair,
    pair_names,
    place,
)
from showc.fleet.single_drone.single import hover
from showc.flight import Certificate, LegFlight, Trajectory
from showc.trajectory import PiecewisePolynomial, concatenate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.fleet.single_drone.single import Aircraft
    from showc.plan.itinerary import Leg
    from showc.script.show import Show


_MOMENT = 1e-6
"""Time that is rounding [s]."""


def put_together(leg: Leg, moves: Sequence[LegFlight], show: Show) -> LegFlight:
    """Return the flight of a leg from those of its parts.

    Parameters
    ----------
    leg
        With its times.
    moves
        One for each of ``leg.parts``.
    show
        With the separation.

    Raises
    ------
    SolveError
        If two drones come too near; the message names them, and when.
    """
    duration, aircraft = leg.duration or 0.0, aircraft_of(show, leg)
    flown = tuple(
        _whole(leg, row, list(_moves_of(leg, row, moves)), aircraft)
        for row in range(leg.drones.size)
    )
    tracks, separation = tracks_of(flown), show.separation
    met = conflicts(tracks, separation, separation.distance - TOLERANCE)
    if len(met):
        nearest = int(np.argmin(met.distance))
        pair = int(met.first[nearest]), int(met.second[nearest])
        raise SolveError(
            f"{place(leg)}: {pair_names(leg, *pair)} come within "
            f"{met.distance[nearest]:.3f} m at "
            f"{(leg.depart or 0.0) + met.time[nearest]:.2f} s of the show, while their "
            f"groups move at times of their own, the separation is "
            f"{separation.distance:.3f} m ({len(met)} pairs in all); let one of the "
            "groups move later, or move their formations apart"
        )
    certificate = Certificate(
        duration,
        0.0,
        0.0,
        None,
        nearest_pair(leg, flown, separation),
        "groups in times of their own: "
        + "; ".join(f"{move.leg.name}: {move.certificate.method}" for move in moves),
        {"drones": float(leg.drones.size), "moves": float(len(moves))},
    )
    return LegFlight(
        leg, duration, flown, certificate, tuple(_of_fleet(move) for move in moves)
    )


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
            begin = round((part.depart or 0.0) - (leg.depart or 0.0), 3)
            yield begin, move.trajectories[column]


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
