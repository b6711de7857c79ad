"""Stretches of time in which every drone flies at most one timed leg."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.autopilot import SPREAD

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from showc.verify.autopilot import Profiles
    from showc.verify.legs import MissionLegs

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]

TOGETHER = 0.5
"""Legs that begin within this time of each other are looked at together [s]."""

DAY = 86400.0


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
    """The timed legs of one drone."""

    mission: MissionLegs
    rows: IntArray
    release: FloatArray
    begin: FloatArray
    """When each can begin at the earliest [s]."""
    end: FloatArray
    """When each has ended at the latest [s]."""
    followed: FloatArray
    """Time from release to that of all the drone's legs [s]."""

    def during(self, last: float) -> tuple[int, float, bool]:
        """Leg up to ``last`` [s], its release, and whether it is flown at all."""
        begun = int(np.searchsorted(self.begin, last - 1e-9))
        if begun:
            return int(self.rows[begun - 1]), float(self.release[begun - 1]), True
        # Not yet off: it rests where its first timed leg begins.
        if self.rows.size:
            return int(self.rows[0]), float(self.release[0]), False
        return max(self.mission.release.size - 1, 0), 0.0, False


def stretches(
    missions: Sequence[MissionLegs], flights: Profiles, first_leg: IntArray
) -> Iterator[Stretch]:
    """Cut time so that everybody flies at most one timed leg in a stretch.

    ``flights`` is the table of all legs, ``first_leg`` (drones,) the row of each one's
    first leg in it.

    Raises
    ------
    OverlappingLegsError
        If a drone's legs are not surely apart in time.
    """
    fleet = _timed_legs(missions, flights.followed(SPREAD), first_leg)
    for drone, one in enumerate(fleet):
        late = np.flatnonzero(one.end[:-1] > one.begin[1:])
        if late.size:
            raise OverlappingLegsError(drone, float(one.release[late[0] + 1]))
    if not any(one.rows.size for one in fleet):
        return
    cuts = _cuts(fleet)
    for first, following in zip(cuts, [*cuts[1:], np.inf], strict=True):
        chosen = [one.during(following) for one in fleet]
        legs = [leg for leg, _, _ in chosen]
        begin, along, end = [], [], [-np.inf]
        for one, (leg, release, flies) in zip(fleet, chosen, strict=True):
            places = one.mission.places
            begin.append(places[leg])
            along.append((places[leg + 1] - places[leg]) * flies)
            if flies:
                end.append(release + one.followed[leg])
        last = min(following, max(end))
        if last > first:
            yield Stretch(
                np.array(begin),
                np.array(along),
                first_leg + np.array(legs),
                np.array([release for _, release, _ in chosen]),
                float(first),
                float(last),
            )


def _timed_legs(
    missions: Sequence[MissionLegs], followed: FloatArray, first_leg: IntArray
) -> list[_Timed]:
    """Legs of all drones, those behind midnight after those before it."""
    first = [
        mission.release[np.isfinite(mission.release)][:1].sum() for mission in missions
    ]
    late = max(first, default=0.0)
    fleet = []
    for mission, moment, row in zip(missions, first, first_leg.tolist(), strict=True):
        rows = np.flatnonzero(np.isfinite(mission.release))
        release = mission.release[rows]
        if moment < late - DAY / 2.0:
            release = release + DAY
        own = followed[row : row + mission.release.size]
        end = release + own[rows]
        fleet.append(_Timed(mission, rows, release, release - SPREAD, end, own))
    return fleet


def _cuts(fleet: Sequence[_Timed]) -> FloatArray:
    """Return times [s] between which nobody can fly more than one leg.

    Legs that begin close together share a cut, unless a drone's own leg before it still
    runs then.
    """
    moments = np.sort(np.concatenate([one.begin for one in fleet]))
    cuts: list[float] = []
    for moment in moments.tolist():
        if not cuts or moment - cuts[-1] > TOGETHER:
            cuts.append(moment)
    while True:
        edges = np.array(cuts)
        missing = set()
        for one in fleet:
            begins = one.begin[1:]
            shared = edges[np.searchsorted(edges, begins + 1e-9) - 1]
            missing |= set(begins[one.end[:-1] > shared + 1e-9].tolist())
        missing -= set(cuts)
        if not missing:
            return edges
        cuts = sorted([*cuts, *missing])
