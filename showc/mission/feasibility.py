"""What the missions of a show cannot carry, told before anything is solved.

Of all that missions are made from, only bends follow the solved flight. So whether
their straight legs, staggered, layered or above the others, keep apart is known from
the places alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.parameters import parameters_for
from showc.autopilot.stage import StageBuilder
from showc.autopilot.timing import Timing, tube
from showc.errors import ExportError
from showc.geodesy import SiteFrame
from showc.mission.clock import MissionClock
from showc.mission.encode import lights_left_out
from showc.mission.items import item_budget
from showc.schedule.encodings import choose_encoding
from showc.schedule.surroundings import Surroundings
from showc.schedule.timeline import refuse_motions

if TYPE_CHECKING:
    from showc.plan.itinerary import Itinerary, Leg
    from showc.script.show import Show

LEAST_ITEMS = 4
"""Items of a leg: speed, slot, its fraction, waypoint."""


@dataclass(frozen=True, slots=True)
class MissionOutlook:
    """What is known of the missions before the solve."""

    refused: tuple[str, ...]
    """Why there will be no missions; a sentence each."""
    notes: tuple[str, ...]
    """What they will not carry, or only with the solved flight's help."""


def mission_outlook(itinerary: Itinerary) -> MissionOutlook:
    """Return what the missions of a show cannot carry.

    Parameters
    ----------
    itinerary
        Legs with their places; nothing need be solved.
    """
    show = itinerary.show
    if not show.mission.wanted:
        return MissionOutlook(("the script wants none",), ())
    notes = list(lights_left_out(show))
    if show.mission.autopilot == "px4":
        return MissionOutlook(
            (), (*notes, "how PX4 flies missions is not known: nothing is proved")
        )
    refused = _of_show(show, itinerary.legs)
    if not refused:
        notes += _of_legs(itinerary)
    return MissionOutlook(tuple(refused), tuple(notes))


def _of_show(show: Show, legs: tuple[Leg, ...]) -> list[str]:
    """Return what forbids missions of this show altogether."""
    found = []
    try:
        refuse_motions(legs)
        tube(show.site.wind)
        budget = item_budget("ardupilot", show.mission.board)
        moves = sum(leg.kind not in {"hold", "launch", "land"} for leg in legs)
        if LEAST_ITEMS * moves > budget:
            found.append(
                f"missions of {moves} legs have at least {LEAST_ITEMS * moves} items, "
                f"board {show.mission.board!r} holds {budget}"
            )
        holds = sum(leg.duration or 0.0 for leg in legs if leg.kind == "hold")
        MissionClock(None, show.mission.start_minute).check_span(holds)
    except ExportError as error:
        found.append(str(error))
    return found


def _of_legs(itinerary: Itinerary) -> list[str]:
    """Name legs that no encoding carries but a bend along the solved flight."""
    show = itinerary.show
    frame = SiteFrame.of(show.site)
    pads = np.asarray(show.formations[show.pads].points[: show.drones])
    altitude = np.round(frame.to_geodetic(pads)[:, 2], 2)
    builder = StageBuilder(frame, altitude, parameters_for(show))
    everyone = np.arange(show.drones)
    _, places = builder.on_grid(everyone, pads)
    timing, found = Timing(wind=show.site.wind), []
    for leg in itinerary.legs:
        if leg.kind in {"transition", "approach"}:
            around = Surroundings(
                places, show.separation, show.site, timing, show.mission.slack
            )
            try:
                choose_encoding(leg, None, builder, around)
            except ExportError as error:
                found.append(
                    f"{error}; before the solve it is not known whether a bend along "
                    "the solved flight helps"
                )
        if leg.kind != "hold":
            places = places.copy()
            _, places[leg.drones] = builder.on_grid(leg.drones, leg.goal)
    return found
