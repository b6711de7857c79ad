"""Company: formations against whatever stands in the air at the same time.

Drones that are parked, other groups, and drones that stand by.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import Diagnostic, Label, Spot
from showc.script.lanes import arrival, chapters, departure, own_times
from showc.script.spacing import closest_between
from showc.script.wording import number_text, point_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import IntArray
    from showc.script.build import Sketch
    from showc.script.settings import Settings
    from showc.script.show import Formation, Show, Transition


def company_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield what is wrong between drones that stand at the same time."""
    yield from _parking(sketch)
    yield from _groups(sketch)
    yield from _standing_by(sketch)


def _parking(sketch: Sketch) -> Iterator[Diagnostic]:
    """Parked drones against the pictures that others fly meanwhile (SHW206)."""
    parking = sketch.formations.get(sketch.parking or "")
    if parking is None or sketch.separation is None or sketch.drones is None:
        return
    most, needs = 0, None
    seen = set()
    for item in sketch.settings.sound("transitions"):
        formation = sketch.formations.get(item.text("to"))
        group = item.word("group")
        if formation is None or (group is not None and group not in sketch.groups):
            continue
        flying = sketch.drones if group is None else len(sketch.groups[group])
        waiting = flying - len(formation.points)
        if waiting > most:
            most, needs = waiting, item
        if waiting <= 0 or formation.name in seen:
            continue
        seen.add(formation.name)
        pair = closest_between(
            parking.points,
            formation.points,
            sketch.separation.distance,
            sketch.separation,
        )
        if pair is not None:
            yield Diagnostic(
                "SHW206",
                f"place {pair.first + 1} of the parking `{parking.name}` is "
                f"{number_text(pair.distance)} m from place {pair.second + 1} of "
                f"`{formation.name}`, the separation is "
                f"{number_text(sketch.separation.distance)} m",
                parking.mark,
                secondary=(Label(formation.mark, "the picture"),),
                help="park further away",
                spot=Spot(formation.name, (pair.second,)),
            )
    if needs is not None and len(parking.points) < most:
        yield Diagnostic(
            "SHW205",
            f"the parking `{parking.name}` has {len(parking.points)} places, {most} "
            "drones wait there",
            parking.mark,
            secondary=(Label(needs.mark_of("to"), "during this picture"),),
            help="add places to the parking",
        )


def _groups(sketch: Sketch) -> Iterator[Diagnostic]:
    """Check formations of two groups that stand at the same time (SHW208)."""
    if sketch.separation is None:
        return
    standing: dict[str, tuple[Formation, Settings]] = {}
    gone = _gone(sketch.show)
    for row, item in enumerate(sketch.settings.sound("transitions")):
        formation = sketch.formations.get(item.text("to"))
        if formation is None or "group" not in item:
            standing.clear()
            continue
        group = item.text("group")
        for other, (theirs, where) in standing.items():
            if other == group or (other, row) in gone:
                continue
            pair = closest_between(
                formation.points,
                theirs.points,
                sketch.separation.distance,
                sketch.separation,
            )
            if pair is not None:
                yield Diagnostic(
                    "SHW208",
                    f"place {pair.first + 1} of `{formation.name}` (group `{group}`) "
                    f"is {number_text(pair.distance)} m from place "
                    f"{pair.second + 1} of `{theirs.name}` (group `{other}`), the "
                    f"separation is {number_text(sketch.separation.distance)} m",
                    item.mark_of("to"),
                    secondary=(Label(where.mark_of("to"), f"`{other}` stands here"),),
                    help="move one of the formations away",
                    spot=Spot(formation.name, (pair.first,)),
                )
        standing[group] = (formation, item)


def _gone(show: Show | None) -> set[tuple[str, int]]:
    """Find groups that have left again when another's transition, by index, arrives.

    Only where groups have times of their own, and of what comes later in the script.
    """
    found: set[tuple[str, int]] = set()
    if show is None:
        return found
    for chapter in chapters(show):
        together = [show.transitions[index] for index in chapter]
        for at, index in enumerate(chapter if own_times(together) else ()):
            there = arrival(together[at])
            for later in together[at + 1 :]:
                leaves = departure(later)
                if there is not None and leaves is not None and leaves < there:
                    found.add((str(later.group), index))
    return found


def _standing_by(sketch: Sketch) -> Iterator[Diagnostic]:
    """Check formations of groups against drones that stand by (SHW208).

    Where a drone stands that was given its place by the planner is not known here.
    """
    show, separation = sketch.show, sketch.separation
    if show is None or separation is None:
        return
    pads = show.formations[show.pads].points[: show.drones]
    if len(pads) < show.drones:
        return  # too few pads are a finding of their own
    places = pads + np.array([0.0, 0.0, show.launch.altitude])
    for chapter in chapters(show):
        flown = [show.transitions[index] for index in chapter]
        busy = np.zeros(show.drones, dtype=bool)
        for transition in flown:
            busy[_members(show, transition)] = True
        rows = np.flatnonzero(~busy & np.isfinite(places).all(axis=1))
        for transition in flown:
            formation = show.formations[transition.to]
            pair = closest_between(
                formation.points, places[rows], separation.distance, separation
            )
            if pair is not None:
                drone = rows[pair.second]
                yield Diagnostic(
                    "SHW208",
                    f"place {pair.first + 1} of `{formation.name}` (group "
                    f"`{transition.group}`) is {number_text(pair.distance)} m from "
                    f"drone {drone + 1}, which waits there, the separation "
                    f"is {number_text(separation.distance)} m",
                    transition.mark,
                    notes=(f"the drone stands at {point_text(places[drone])}",),
                    help="move the formation away, or move that drone first",
                    spot=Spot(formation.name, (pair.first,)),
                )
        for transition in flown:
            members = _members(show, transition)
            points = show.formations[transition.to].points
            known = transition.assignment == "fixed" and len(points) == len(members)
            known = known and not transition.motion
            places[members] = points if known else np.nan


def _members(show: Show, transition: Transition) -> IntArray:
    """Drones of a transition, counting from 0, shape (n,)."""
    if transition.group is None:
        return np.arange(show.drones)
    return np.array(show.groups[transition.group])
