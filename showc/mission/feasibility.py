"""What the missions of a show cannot carry, known before anything is solved.

Of all that missions are made from, only bends follow the solved flight. So whether
their straight legs, staggered, layered or above the others, keep apart is known from
the places alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.timing import Timing, tube
from showc.errors import ExportError
from showc.mission.clock import MissionClock
from showc.mission.encode import leg_colours, lights_left_out
from showc.mission.fleet import builder_of, cue_notes, items_of
from showc.progress import Silent
from showc.schedule.course import Course
from showc.schedule.encodings import choose_encoding
from showc.schedule.layout import build_timeline
from showc.schedule.surroundings import Surroundings
from showc.script.rules.missions import (
    ALWAYS,
    UNMOVED,
    pulse_widths,
    refusals,
)

if TYPE_CHECKING:
    from showc.plan.itinerary import Itinerary


BENDS_MAY_HELP = (
    "before the solve it is not known whether a bend along the solved flight helps"
)


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
        return MissionOutlook(("the script asks for none",), ())
    least = _most_items(itinerary)
    notes, found = list(lights_left_out(show)), list[str]()
    for one in refusals(show, least):
        (notes if one.written else found).append(f"{one.message}; {one.help}")
    try:
        tube(show.site.wind)
    except ExportError as error:
        found.append(str(error))
    if not found and show.mission.autopilot != "px4":
        notes += _likely(itinerary)
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


def _likely(itinerary: Itinerary) -> list[str]:
    """Say what is found when missions are laid out on straight flights.

    Legs are named that no encoding carries but a bend along the solved flight.
    """
    show = itinerary.show
    try:
        course = Course.planned(itinerary)
    except ExportError as error:
        return [str(error)]
    builder, altitude = builder_of(show)
    _, places = builder.on_grid(np.arange(show.drones), course.launch.goal)
    timing, found = Timing(wind=show.site.wind), list[str]()
    for move in (move for step in course.steps for move in step.moves):
        # Where others fly meanwhile, the timeline says more.
        around = Surroundings(
            places, show.separation, show.site, timing, show.mission.slack
        )
        drones = move.leg.drones
        try:
            if drones.size == show.drones:
                choose_encoding(move.leg, None, builder, around)
        except ExportError as error:
            found.append(f"{error}; {BENDS_MAY_HELP}")
        places = places.copy()
        _, places[drones] = builder.on_grid(drones, move.leg.goal)
    if found:
        return found
    try:
        timeline = build_timeline(show, course, builder, Silent())
    except ExportError as error:
        return [f"{error}; {BENDS_MAY_HELP}"]
    found += cue_notes(timeline, show.music)
    clock = MissionClock.of(None, show.mission.start_minute)
    try:
        items_of(show, timeline, altitude, clock, "ardupilot")
    except ExportError as error:
        found.append(f"on straight flights {error}")
    return found
