"""Places: which drone takes which, and which drones wait in the parking."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from showc.errors import PlanError
from showc.plan.assignment import Assignment, in_order

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.script.show import Formation, Show, Transition
    from showc.vehicle import Separation


class Assign(Protocol):
    """Gives places to drones, as :func:`showc.plan.assignment.assign` does."""

    def __call__(
        self,
        start: FloatArray,
        goals: FloatArray,
        separation: Separation,
        *,
        required: int | None = None,
    ) -> Assignment:
        """Return the places."""
        ...


PARKED = -1
"""Place of a drone that has none in the formation."""


class Places:
    """Gives places to the drones of a show, transition by transition.

    Parameters
    ----------
    optimal
        Gives them where the script leaves that open.
    """

    def __init__(self, show: Show, optimal: Assign) -> None:
        self.show, self.optimal = show, optimal
        self._parking = np.full(show.drones, PARKED)
        self._numbers = np.arange(show.drones)

    def give(
        self,
        transition: Transition,
        formation: Formation,
        members: IntArray,
        start: FloatArray,
    ) -> Assignment:
        """Assign drones to the places of ``formation``, and the rest to parking.

        Parameters
        ----------
        members
            The drones, counting from 0, shape (n,).
        start
            Where they are, shape (n, 3) [m].

        Raises
        ------
        PlanError
            If there is no place, or no parking place, for each of them.
        """
        if transition.assignment == "keep":
            given = self._kept(transition, formation, members)
        else:
            given = self._chosen(transition, formation, members, start)
        self._numbers[members] = given.places
        return given

    def _chosen(
        self,
        transition: Transition,
        formation: Formation,
        members: IntArray,
        start: FloatArray,
    ) -> Assignment:
        drones, places = members.size, formation.points.shape[0]
        choose = self.optimal if transition.assignment == "optimal" else in_order
        separation = self.show.separation
        self._parking[members] = PARKED
        if places == drones:
            return choose(start, formation.points, separation)
        mark = transition.mark
        where = f"{mark}: formation {formation.name!r}"
        found = f"{where} has {places} places for {drones} drones"
        if places > drones:
            raise PlanError(f"{found}; take places away, or send more drones")
        if self.show.parking is None:
            raise PlanError(
                f"{found}; name a formation in 'parking' where the other "
                f"{drones - places} wait"
            )
        spots = self.show.formations[self.show.parking].points
        free = np.setdiff1d(np.arange(spots.shape[0]), self._parking)
        if free.size < drones - places:
            raise PlanError(
                f"{found}; the parking formation {self.show.parking!r} has "
                f"{free.size} free places, {drones - places} are needed: add places"
            )
        goals = np.concatenate([formation.points, spots[free]])
        if transition.assignment == "optimal":
            given = self.optimal(start, goals, separation, required=places)
        else:
            given = in_order(start, goals, separation)
        outside = given.places >= places
        self._parking[members[outside]] = free[given.places[outside] - places]
        return replace(given, places=np.where(outside, PARKED, given.places))

    def _kept(
        self, transition: Transition, formation: Formation, members: IntArray
    ) -> Assignment:
        """Leave every drone the number of its place."""
        numbers = self._numbers[members]
        if not np.array_equal(np.sort(numbers), np.arange(len(formation.points))):
            mark = transition.mark
            raise PlanError(
                f"{mark}: the drones cannot keep the "
                f"numbers of their places in {formation.name!r}, which has "
                f"{len(formation.points)} places; write `assignment: optimal`"
            )
        return Assignment(numbers, np.inf, "every drone keeps the number of its place")

    def positions(
        self, formation: Formation, places: IntArray, members: IntArray
    ) -> FloatArray:
        """Where drones go that were given ``places``, parked ones too, (n, 3) [m]."""
        goals = np.array(formation.points[np.maximum(places, 0)])
        outside = places == PARKED
        if outside.any():
            spots = self.show.formations[str(self.show.parking)].points
            goals[outside] = spots[self._parking[members[outside]]]
        return goals
