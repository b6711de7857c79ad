"""Stretches of time in which every drone flies at most one timed leg."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.verify.missions.law import Profiles
    from showc.verify.missions.legs import MissionLegs


TOGETHER = 0.5
"""Legs that begin within this time of each other are looked at together [s]."""


class OverlappingLegsError(Exception):
    """A drone may still fly one leg when the next one is released."""

    def __init__(self, drone: int, time: float) -> None:
        super().__init__(f"drone {drone + 1} at {time:.2f} s")
        self.drone = drone
        self.time = time


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """One leg of every drone, or rest, during a stretch of time."""

    begin: FloatArray
    """Where each drone's leg begins, shape (drones, 3), show frame [m]."""
    along: FloatArray
    """From there to its end, zero for a drone at rest, shape (drones, 3) [m]."""
    leg: IntArray
    """Row of each one's leg in the table of all legs, shape (drones,)."""
    release: FloatArray
    """When it is released, shape (drones,) [s]."""
    first: float
    """First instant [s]."""
    last: float
    """Last instant [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Timed:
    """The timed legs of all drones, one after the other.

    Drones with fewer legs than others, or none, are filled up with legs that begin
    never and lead nowhere.
    """

    legs: IntArray
    """Rows in the table of all legs, shape (drones, most)."""
    release: FloatArray
    """When each is released, shape (drones, most) [s]."""
    first: FloatArray
    """When each can begin at the earliest, shape (drones, most) [s]."""
    last: FloatArray
    """When each has ended at the latest, shape (drones, most) [s]."""
    begin: FloatArray
    """Where each begins, shape (drones, most, 3), show frame [m]."""
    along: FloatArray
    """From there to its end, shape (drones, most, 3) [m]."""

    def stretch(self, first: float, following: float) -> Stretch | None:
        """Return what is flown from ``first`` up to ``following`` [s], if anything."""
        begun = np.count_nonzero(self.first < following - 1e-9, axis=1)
        flies = begun > 0
        # A drone not yet off rests where its first timed leg begins.
        chosen = np.arange(begun.size), np.maximum(begun - 1, 0)
        last = min(following, float(self.last[chosen][flies].max(initial=-np.inf)))
        if last <= first:
            return None
        return Stretch(
            self.begin[chosen],
            self.along[chosen] * flies[:, None],
            self.legs[chosen],
            self.release[chosen],
            first,
            last,
        )


def stretches(
    missions: Sequence[MissionLegs], flights: Profiles, first_leg: IntArray
) -> Iterator[Stretch]:
    """Cut time so that a drone flies at most one timed leg in a stretch.

    ``flights`` is the table of all legs, ``first_leg`` (drones,) the row of each one's
    first leg in it.

    Raises
    ------
    OverlappingLegsError
        If a drone's legs are not surely apart in time.
    """
    fleet = _timed_legs(missions, flights, first_leg)
    late = np.argwhere(fleet.last[:, :-1] > fleet.first[:, 1:])
    if late.size:
        drone, leg = late[0].tolist()
        raise OverlappingLegsError(drone, float(fleet.release[drone, leg + 1]))
    cuts = _cuts(fleet)
    for first, following in pairwise([*cuts.tolist(), np.inf]):
        stretch = fleet.stretch(first, following)
        if stretch is not None:
            yield stretch


def _timed_legs(
    missions: Sequence[MissionLegs], flights: Profiles, first_leg: IntArray
) -> _Timed:
    """Return the legs of all drones, those that are timed."""
    followed = flights.followed(flights.spread)
    timed = [np.flatnonzero(np.isfinite(one.release)) for one in missions]
    shape = len(missions), max((rows.size for rows in timed), default=0) or 1
    legs = np.zeros(shape, dtype=np.int64)
    release, begin, along = (
        np.zeros(shape),
        np.zeros((*shape, 3)),
        np.zeros((*shape, 3)),
    )
    first, last = np.full(shape, np.inf), np.full(shape, -np.inf)
    for drone, (one, rows) in enumerate(zip(missions, timed, strict=True)):
        # A drone without timed legs waits where its last leg begins.
        some = rows if rows.size else np.array([one.release.size - 1])
        part = slice(some.size)
        legs[drone, part] = first_leg[drone] + some
        begin[drone, part] = one.places[some]
        along[drone, part] = one.places[some + 1] - one.places[some]
        if rows.size:
            release[drone, part] = one.release[rows]
            own = legs[drone, part]
            first[drone, part] = release[drone, part] - flights.spread[own]
            last[drone, part] = release[drone, part] + followed[own]
    return _Timed(legs, release, first, last, begin, along)


def _cuts(fleet: _Timed) -> FloatArray:
    """Return times [s] between which no drone can fly more than one leg.

    Legs that begin close together share a cut, unless a drone's own leg before it still
    runs then.
    """
    moments = np.unique(fleet.first[np.isfinite(fleet.first)])
    cuts: list[float] = []
    for moment in moments.tolist():
        if not cuts or moment - cuts[-1] > TOGETHER:
            cuts.append(moment)
    known = np.isfinite(fleet.first[:, 1:])
    begins, before = fleet.first[:, 1:][known], fleet.last[:, :-1][known]
    while True:
        edges = np.array(cuts)
        shared = edges[np.searchsorted(edges, begins + 1e-9) - 1]
        missing = set(begins[before > shared + 1e-9].tolist()) - set(cuts)
        if not missing:
            return edges
        cuts = sorted([*cuts, *missing])
