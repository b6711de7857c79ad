"""What missions fly: moves of the fleet, or of groups, what is held, and the cues."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

from showc.autopilot.stage import SLOWEST_COMMAND
from showc.autopilot.takeoff import LEAST_HEIGHT
from showc.errors import ExportError
from showc.script.lanes import least_rest
from showc.script.rules.missions import DATE_LINE, crosses_date_line

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.flight import Flight, LegFlight
    from showc.plan.itinerary import Itinerary, Leg
    from showc.script.show import Show


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """One move of the show, of all drones or of a group."""

    leg: Leg
    """What the show wants; its index is that of the log's segment."""
    flight: LegFlight | None
    """The same solved; None before that."""
    start: float
    """Show time at which it starts; before the solve, about [s]."""

    @property
    def duration(self) -> float:
        """Time of the solved flight, or the one that the script asks for [s]."""
        if self.flight is not None:
            return self.flight.duration
        return self.leg.duration or 0.0

    @property
    def cue(self) -> tuple[float, bool] | None:
        """Show time that the script asks for [s], and whether it is the arrival's."""
        if self.leg.arrive is not None:
            return self.leg.arrive, True
        return None if self.leg.depart is None else (self.leg.depart, False)


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Moves that are flown together, and the hold after them."""

    moves: tuple[Move, ...]
    """One; or those of groups that have times of their own, in the script's order."""
    hold: float
    """How long what they reach is held at least [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Everything that missions fly, in order."""

    launch: Leg
    """Straight up."""
    hold: float
    """How long the fleet hovers there at least [s]."""
    steps: tuple[Step, ...]
    """Everything that is timed."""
    land: Leg
    """Straight down."""

    @classmethod
    def of(cls, show: Show, legs: Sequence[Leg], flight: Flight | None = None) -> Self:
        """Return the course of ``legs``, with their flights if they are solved.

        Raises
        ------
        ExportError
            If missions cannot carry it: it is not one launch, transitions and one
            landing, its launch is too low or too slow, a formation moves, or
            longitudes jump within the flight volume.
        """
        if crosses_date_line(show):
            raise ExportError(
                f"{DATE_LINE}; give a `volume` on one side of it, or fly the log with "
                "`showc stream`"
            )
        _refuse_motions(legs)
        found: list[Step] = []
        for number, leg in enumerate(legs):
            if leg.kind == "hold":
                held = leg.duration if flight is None else flight.legs[number].duration
                if found:
                    held = found[-1].hold + (held or 0.0)
                    found[-1] = replace(found[-1], hold=held)
                continue
            if found and any(move.cue for move in _moves(number, leg, flight)):
                # A hold is as long as is left of the time until the next cue.
                before = found[-1].moves[-1].leg.transition
                least = show.launch.hold if before is None else least_rest(show, before)
                found[-1] = replace(found[-1], hold=min(found[-1].hold, least))
            found.append(Step(tuple(_moves(number, leg, flight)), 0.0))
        kinds = [step.moves[0].leg.kind for step in found]
        if (
            len(found) < 2
            or (kinds[0], kinds[-1]) != ("launch", "land")
            or {"launch", "land"} & set(kinds[1:-1])
        ):
            raise ExportError(
                "a mission goes from one launch of all drones to one landing of all; "
                f"found {', '.join(kinds)}"
            )
        first, *steps, last = found
        launch, land = first.moves[0].leg, last.moves[0].leg
        lowest = float((launch.goal - launch.start)[:, 2].min())
        if lowest <= LEAST_HEIGHT:
            raise ExportError(
                f"the launch ends {lowest:g} m above a pad, and an autopilot takes off "
                f"to {LEAST_HEIGHT:g} m at least; raise `launch: altitude:`, or fly "
                "the log with `showc stream`"
            )
        vertical = min(show.limits.velocity_max[2], -show.limits.velocity_min[2])
        if vertical < SLOWEST_COMMAND:
            raise ExportError(
                f"the limits allow {vertical:g} m/s up or down, an autopilot heeds "
                f"{SLOWEST_COMMAND:g} m/s at least; raise the limits of climb and "
                "descent, or fly the log with `showc stream`"
            )
        return cls(launch, first.hold, tuple(steps), land)

    @classmethod
    def planned(cls, itinerary: Itinerary) -> Self:
        """Return the course of a show that is not solved; raises as :meth:`of` does."""
        return cls.of(itinerary.show, itinerary.legs)


def _moves(number: int, leg: Leg, flight: Flight | None) -> Iterator[Move]:
    """Yield the moves of a leg of the itinerary."""
    solved = None if flight is None else flight.legs[number]
    if not leg.parts:
        yield Move(leg, solved, 0.0 if flight is None else float(flight.starts[number]))
        return
    flights = [None] * len(leg.parts) if solved is None else solved.parts
    for part, own in zip(leg.parts, flights, strict=True):
        start = part.arrive if part.depart is None else part.depart
        yield Move(replace(part, index=leg.index), own, start or 0.0)


def _refuse_motions(legs: Sequence[Leg]) -> None:
    every = [part for leg in legs for part in (leg, *leg.parts)]
    moving = [leg.name for leg in every if leg.kind == "motion"]
    if moving:
        more = f", and {len(moving) - 1} more" if len(moving) > 1 else ""
        raise ExportError(
            f"a mission cannot carry a formation that moves: “{moving[0]}”{more}; fly "
            "the log with `showc stream`"
        )
