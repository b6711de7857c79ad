"""The abort table: for moments of a show, how the stopped fleet comes down.

The fleet's clock is brought to rest, which keeps every distance, and from there all
drones go straight down where they are, if that keeps them apart; else home, above the
pads and down; else back along the plan, which keeps what the plan keeps. Every way is
planned by the fleet planner and proved. The table goes into the log, with the flights
and with how the clock is slowed down, so that ``showc verify`` proves it again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from showc.errors import SolveError
from showc.fleet import solve_itinerary
from showc.log import showc_pb2 as pb
from showc.log.content import leg_message, trajectory_message
from showc.plan.assignment import assign, in_order
from showc.plan.itinerary import Itinerary, Leg
from showc.safety.stop import PERIOD, Motion, SharedClock, authority_within, stops
from showc.script.fence import inside_polygon
from showc.vehicle.metric import measure

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.options import SolveOptions
    from showc.flight import LegFlight
    from showc.log.reader import LoggedShow
    from showc.progress import Progress
    from showc.script.show import Show

Way = Literal["on the ground", "down in place", "home", "back along the plan"]
_WAYS: dict[Way, pb.AbortRow.Way] = {
    "on the ground": pb.AbortRow.ON_THE_GROUND,
    "down in place": pb.AbortRow.DOWN_IN_PLACE,
    "home": pb.AbortRow.HOME,
    "back along the plan": pb.AbortRow.BACK_ALONG_THE_PLAN,
}

_GROUNDED = 0.05
"""Height over the pads up to which a drone stands on the ground [m]."""
_SAME = 9
"""Decimals to which places are the same: rounding, not flight [m]."""
BACKWARDS = 0.5
"""Greatest rate at which the plan is flown backwards."""


@dataclass(frozen=True, slots=True)
class Row:
    """What follows a stop at one moment."""

    time: float
    """Show time at which the stop begins [s]."""
    changes: tuple[float, ...]
    """Of the clock's rate, in each period until the fleet stands [1/s]."""
    rest: float
    """Show time at which it stands [s]."""
    way: Way
    """How it comes down."""
    legs: tuple[LegFlight, ...]
    """What it flies then."""
    back: tuple[float, ...]
    """Changes of the clock's rate back along the plan; none on other ways [1/s]."""
    duration: float
    """Time from rest to the ground [s]."""

    @property
    def stop(self) -> float:
        """Time until the fleet stands still [s]."""
        return PERIOD * len(self.changes)

    @property
    def closest(self) -> float | None:
        """Least distance of two drones on the way, by the separation's metric [m].

        None: that of the plan, or there is one drone.
        """
        found = [flight.certificate.closest for flight in self.legs]
        return min((one.distance for one in found if one is not None), default=None)

    @property
    def total(self) -> float:
        """Time from the stop's beginning to the ground [s]."""
        return self.stop + self.duration


@dataclass(frozen=True, slots=True)
class AbortTable:
    """All rows, in the order of time."""

    every: float
    """Time between two rows [s]."""
    rows: tuple[Row, ...]

    @property
    def longest(self) -> Row:
        """The row that takes longest."""
        return max(self.rows, key=lambda row: row.total)

    def to_json(self) -> list[dict[str, Any]]:
        """Return the table as JSON-able data; times in s, distances in m."""
        return [
            {
                "time": round(row.time, 3),
                "stop": round(row.stop, 3),
                "rest": round(row.rest, 3),
                "way": row.way,
                "duration": round(row.duration, 3),
                "closest": None if row.closest is None else round(row.closest, 3),
                "total": round(row.total, 3),
            }
            for row in self.rows
        ]

    def to_message(self, digest: str) -> pb.AbortTable:
        """Return the table as it stands in the log with that digest."""
        message = pb.AbortTable(data_sha256=digest, every=self.every, period=PERIOD)
        numbers: dict[int, int] = {}
        for row in self.rows:
            start = 0.0
            for flown in row.legs:
                if flown.leg.index not in numbers:
                    number = numbers[flown.leg.index] = len(message.legs)
                    limits = int(flown.leg.kind == "land")
                    one = leg_message(flown, number, start, limits)
                    closest = flown.certificate.closest
                    if closest is not None:
                        one.certificate.closest.distance = closest.distance
                    message.legs.append(one)
                    message.flights.extend(
                        trajectory_message(flown, number, place)
                        for place in range(len(flown.trajectories))
                    )
                start += flown.duration
            message.rows.add(
                time=row.time,
                rest=row.rest,
                changes=row.changes + row.back,
                way=_WAYS[row.way],
                legs=[numbers[flown.leg.index] for flown in row.legs],
                duration=row.duration,
            )
        return message


def abort_table(
    logged: LoggedShow,
    show: Show,
    step: float,
    options: SolveOptions,
    progress: Progress,
) -> AbortTable:
    """Plan and prove an abort from every ``step`` [s] of a logged show.

    Parameters
    ----------
    logged
        The log.
    show
        What its script asks for.
    step
        Time between two moments [s].
    options
        How to solve.
    progress
        Notified of the legs.

    Raises
    ------
    DamagedFileError
        If a trajectory of the log makes no polynomials.
    """
    states = [logged.trajectory(drone).state for drone in range(logged.drones)]
    velocity = [state.select([3, 4, 5]) for state in states]
    motion, authority = Motion.of(velocity), authority_within(show)
    found = stops(motion, authority, step)
    planner = _Planner(show)
    planned: list[tuple[Way, tuple[Leg, ...]]] = []
    # A fleet that holds stands where it stood the moment before: one plan serves both.
    known: dict[bytes, int] = {}
    which = []
    for rest in found.rests.tolist():
        places = np.array([state(rest)[:3] for state in states])
        key = np.round(places, _SAME).tobytes()
        if key not in known:
            known[key] = len(planned)
            planned.append(planner.ways(places))
        which.append(known[key])
    flights = _solved(show, [legs for _, legs in planned], options, progress)
    rows = []
    for index, plan in enumerate(which):
        rest = float(found.rests[index])
        way, flown = planned[plan][0], flights[plan]
        back: tuple[float, ...] = ()
        if flown is None:
            way = "back along the plan"
            clock = SharedClock(motion, authority, rest, motion.fastest)
            back = _back(show, clock)
        duration = sum((one.duration for one in flown or ()), PERIOD * len(back))
        time, changes = float(found.times[index]), found.changes[index]
        rows.append(Row(time, changes, rest, way, flown or (), back, duration))
    return AbortTable(step, tuple(rows))


class _Planner:
    """Chooses how a fleet at rest comes down."""

    def __init__(self, show: Show) -> None:
        self.show = show
        pads = show.formations[show.pads].points[: show.drones]
        self.pads = np.array(pads)
        self.ground = float(pads[:, 2].min())
        self.count = 0

    def ways(self, places: FloatArray) -> tuple[Way, tuple[Leg, ...]]:
        """Return the way of a fleet that stands at ``places`` (n, 3), and its legs."""
        below = places.copy()
        below[:, 2] = self.ground
        away = np.linalg.norm(places[:, None] - self.pads, axis=2).min(axis=1)
        if (away < _GROUNDED).all():
            return "on the ground", ()
        if self._may_land(below):
            return "down in place", (self._leg("land", places, below),)
        landing = self.show.landing
        above = self.pads + np.array([0.0, 0.0, landing.altitude])
        choose = assign if landing.assignment == "optimal" else in_order
        taken = choose(places, above, self.show.separation).places
        return "home", (
            self._leg("approach", places, above[taken]),
            self._leg("land", above[taken], self.pads[taken]),
        )

    def _may_land(self, below: FloatArray) -> bool:
        """Tell whether drones may stand at ``below``: apart, and on free ground.

        Where pads are at different heights, the ground is known at the pads alone.
        """
        if np.ptp(self.pads[:, 2]) > _GROUNDED:
            return False
        separation = self.show.separation
        gap = measure(below[:, None] - below, separation)
        np.fill_diagonal(gap, np.inf)
        if gap.min() < separation.distance:
            return False
        site = self.show.site
        taken = [people.points for people in site.audience if people.area]
        taken += [building.corners for building in site.buildings]
        return not any(inside_polygon(below[:, :2], one).any() for one in taken)

    def _leg(
        self,
        kind: Literal["approach", "land"],
        start: FloatArray,
        goal: FloatArray,
    ) -> Leg:
        limits = self.show.limits
        if kind == "land":
            limits = limits.upright(self.show.landing.descent_speed)
        self.count += 1
        return Leg(
            index=self.count - 1,
            name=f"abort {self.count}: {kind}",
            kind=kind,
            drones=np.arange(self.show.drones),
            start=start,
            goal=goal,
            from_formation="",
            to_formation="",
            places=np.arange(self.show.drones),
            limits=limits,
            duration=None,
            after=(),
            mark=None,
        )


def _solved(
    show: Show,
    legs: list[tuple[Leg, ...]],
    options: SolveOptions,
    progress: Progress,
) -> list[tuple[LegFlight, ...] | None]:
    """Solve and prove all legs; None for a row of which one cannot be flown."""
    together = tuple(leg for row in legs for leg in row)
    if not together:
        return [() for _ in legs]
    try:
        flights = solve_itinerary(Itinerary(show, together), options, progress).legs
    except SolveError:
        found: list[tuple[LegFlight, ...] | None] = []
        for row in legs:
            try:
                alone = Itinerary(show, row)
                flown = solve_itinerary(alone, options, progress).legs if row else ()
                found.append(tuple(flown))
            except SolveError:
                found.append(None)
        return found
    by_index = {flight.leg.index: flight for flight in flights}
    return [tuple(by_index[leg.index] for leg in row) for row in legs]


def _back(show: Show, clock: SharedClock) -> tuple[float, ...]:
    """Return the changes of a clock that flies the plan backwards [1/s]."""
    low, high = show.limits.velocity_min, show.limits.velocity_max
    ratios = (-one / other for one, other in zip(low + high, high + low, strict=True))
    clock.turn_back(min(BACKWARDS, *ratios))
    return clock.changes(0.0, np.inf)
