"""The itinerary: each drone's way from place to place, before its time is known.

A show becomes an ordered list of legs. A leg moves a set of drones from hover to
hover in one common time, or holds them still.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from showc.vehicle.flatness import state_in_motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.arrays import FloatArray, IntArray
    from showc.script.mark import Mark
    from showc.script.moving import MovingPlaces
    from showc.script.show import Preference, Show
    from showc.trajectory import PiecewisePolynomial
    from showc.vehicle import Limits


ANY_TIME = 1.0
"""Length of a hold that is not known yet [s]: where it leads does not depend on it."""
STILL = 1e-7
"""Distance of places that differ by rounding alone [m]: a tenth of what a proof calls
equal."""
LegKind = Literal["launch", "transition", "approach", "land", "hold", "motion"]


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One move, or one hold, of a set of drones."""

    index: int
    """Position in the itinerary."""
    name: str
    """For people."""
    kind: LegKind
    """``approach`` is the move from the last formation to above the pads, ``motion`` a
    formation that moves while it is held."""
    drones: IntArray
    """Drones that take part, counting from 0, shape (n,), increasing; read-only."""
    start: FloatArray
    """Their positions at the start, shape (n, 3), show frame [m]; read-only."""
    goal: FloatArray
    """Their positions at the end, shape (n, 3); equal to ``start`` for a hold."""
    from_formation: str
    """Name of the formation they leave."""
    to_formation: str
    """Name of the formation they reach."""
    places: IntArray
    """Place in ``to_formation`` of each drone, shape (n,); -1: parked."""
    limits: Limits
    """What holds during this leg."""
    duration: float | None
    """Its time [s]: fixed by the script or a hold's; None: as short as can be."""
    after: tuple[int, ...]
    """Legs that must have ended before this one starts."""
    mark: Mark | None
    """Where the script asks for it."""
    transition: int | None = None
    """Which of the script's transitions it belongs to, counting from 0."""
    others_parked: FloatArray | None = None
    """Positions (m, 3) [m] of drones that stand still meanwhile and take no part."""
    others: tuple[PiecewisePolynomial, ...] = ()
    """Positions over its time of drones that fly meanwhile and take no part."""
    others_drones: tuple[int, ...] = ()
    """Which drones those are, counting from 0, in this order; for messages."""
    assignment: str = ""
    """How places were assigned to drones, in words."""
    arrive: float | None = None
    """Show time at which the script wants it to end [s]."""
    depart: float | None = None
    """Show time at which the script wants it to start [s]."""
    motion: tuple[MovingPlaces, ...] = ()
    """What drones of a ``motion`` do; the others hover."""
    start_state: FloatArray | None = None
    """States and thrusts (n, 13) at the start, thrust 0 where it may be any; None: all
    hover."""
    goal_state: FloatArray | None = None
    """The same at the end."""
    prefer: Preference = 1.0
    """What it does with time that it does not need."""
    parts: tuple[Leg, ...] = ()
    """Moves of groups that have times of their own within this one, in the script's
    order, each followed by what its formation does while it is held; each has the
    drones of its group. Before, between and after they hover, but for those that are
    left in motion at the end."""

    @property
    def timed(self) -> bool:
        """Whether the script says when it is flown."""
        return self.arrive is not None or self.depart is not None

    @property
    def open(self) -> bool:
        """Whether its time is known only when it is solved."""
        soon = self.arrive is None or self.prefer == "time"
        return self.duration is None and soon

    def ends(self, row: int) -> tuple[FloatArray, FloatArray]:
        """Start and goal of a drone: places (3,) to hover at, or states (13,)."""
        start, goal = self.start[row], self.goal[row]
        return (
            start if self.start_state is None else self.start_state[row],
            goal if self.goal_state is None else self.goal_state[row],
        )

    @property
    def in_motion(self) -> bool:
        """Whether drones do not hover at its start or at its end."""
        return self.start_state is not None or self.goal_state is not None


@dataclass(frozen=True, slots=True, eq=False)
class Itinerary:
    """All legs of a show, in an order in which each follows those it waits for."""

    show: Show
    """The show, with the formations that planning added: above the pads, groups."""
    legs: tuple[Leg, ...]
    """Every leg has all drones of the fleet; a drone that does not move hovers."""


def held_in_motion(part: Leg, show: Show, duration: float) -> Leg:
    """Return a motion of some drones with its ends, when it is held for a time [s].

    0 if that is not known yet. Its drones are counted within the leg.
    """
    goal = part.start.copy()
    for one in part.motion:
        goal[one.rows] = one.ends(duration or ANY_TIME)[1][0]
    return replace(
        part,
        goal=frozen(goal),
        start_state=state_at(show, part.motion, duration, 0, part.start),
        goal_state=state_at(show, part.motion, duration, 1, goal),
    )


def in_parts(leg: Leg, parts: tuple[Leg, ...], show: Show) -> Leg:
    """Return a leg of groups with times of their own, with its ends.

    It ends where the last part of each group does; those whose motion is under way
    there are left in it, the others hover.
    """
    goal = leg.goal.copy()
    states = np.zeros((leg.drones.size, 13))
    states[:, :-1] = show.vehicle.hover_state(goal, show.heading)
    last = {int(part.drones[0]): part for part in parts}
    for part in last.values():
        rows = np.searchsorted(leg.drones, part.drones)
        goal[rows] = part.goal
        if part.goal_state is not None:
            states[rows] = part.goal_state
    states[:, :3] = goal
    moving = any(part.goal_state is not None for part in last.values())
    return replace(
        leg,
        parts=parts,
        goal=frozen(goal),
        goal_state=frozen(states) if moving else None,
    )


def state_at(
    show: Show,
    motion: Sequence[MovingPlaces],
    duration: float,
    side: int,
    places: FloatArray,
) -> FloatArray | None:
    """States and thrusts (n, 13) in which a fleet joins or leaves what it holds.

    Parameters
    ----------
    motion
        What drones do while they hold it.
    duration
        For how long [s]; 0: not known yet, any time does.
    side
        0 where they join it, 1 where they leave it.
    places
        Where they are then, shape (n, 3) [m].

    Returns
    -------
    ndarray or None
        Those that are not in motion hover; None: all do.
    """
    moving = [one for one in motion if one.under_way[side]]
    if not moving:
        return None
    states = np.zeros((len(places), 13))
    states[:, :-1] = show.vehicle.hover_state(places, show.heading)
    for one in moving:
        there = one.ends(duration or ANY_TIME)[side]
        states[one.rows] = state_in_motion(show.vehicle, there, show.heading)
    states[:, :3] = places
    return frozen(states)


def frozen(array: NDArray) -> NDArray:  # type: ignore[type-arg]
    """Return an array that cannot be written any more."""
    array.setflags(write=False)
    return array
