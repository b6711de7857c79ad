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
from showc.mission.encode import leg_colours, lights_left_out
from showc.schedule.encodings import choose_encoding
from showc.schedule.surroundings import Surroundings
from showc.script.missions import (
    ALWAYS,
    UNMOVED,
    pulse_widths,
    refusals,
)

if TYPE_CHECKING:
    from showc.plan.itinerary import Itinerary


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
    found = [one.message for one in refusals(show, _most_items(itinerary))]
    notes = list(lights_left_out(show))
    if show.mission.autopilot == "px4":
        return MissionOutlook((), (*notes, *found))
    try:
        tube(show.site.wind)
    except ExportError as error:
        found.append(str(error))
    if not found:
        notes += _of_legs(itinerary)
    return MissionOutlook(tuple(found), tuple(notes))


def _most_items(itinerary: Itinerary) -> int:
    """Items at least of the drone that has most of them, by its places and colours."""
    show = itinerary.show
    options, autopilot = show.mission, show.mission.autopilot
    servos = 0 if options.light_servos is None else len(options.light_servos)
    count = np.full(show.drones, ALWAYS[autopilot] + servos)
    shown = pulse_widths(options, np.zeros((show.drones, 3)))
    for leg in itinerary.legs:
        if leg.kind not in {"transition", "approach"}:
            continue
        after = pulse_widths(options, leg_colours(show, leg))
        changed = np.sum(after != shown, axis=1) if servos else 0
        moved = np.any(np.abs(leg.goal - leg.start) > UNMOVED, axis=1)
        count += (moved | (np.asarray(changed) > 0)) + moved.astype(int) + changed
        shown = after
    return int(count.max())


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
