"""Company: formations against whatever stands in the air at the same time.

Drones that are parked, other groups, and drones of no group that wait.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import Diagnostic, Label, Spot
from showc.script.formations.spacing import closest_between
from showc.script.lanes import (
    arrival,
    chapters,
    departure,
    ending,
    lanes,
    own_times,
)
from showc.script.language.wording import counted, number_text, point_text
from showc.script.moving import moving_places

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.script.language.settings import Settings
    from showc.script.sections.build import Sketch
    from showc.script.show import Formation, Show, Transition


def company_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield what is wrong between drones that stand at the same time."""
    yield from _parking(sketch)
    yield from _groups(sketch)
    yield from _in_motion(sketch)
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
                f"`{formation.name}`; the separation is "
                f"{number_text(sketch.separation.distance)} m",
                parking.mark,
                secondary=(Label(formation.mark, "the formation"),),
                help="move the parking further away",
                spot=Spot(formation.name, (pair.second,)),
            )
    if needs is not None and len(parking.points) < most:
        yield Diagnostic(
            "SHW205",
            f"the parking `{parking.name}` has "
            f"{counted(len(parking.points), 'place')} for {counted(most, 'drone')}",
            parking.mark,
            secondary=(Label(needs.mark_of("to"), "during this move"),),
            help="add places to the parking",
        )


def _groups(sketch: Sketch) -> Iterator[Diagnostic]:
    """Check formations of two groups that stand at the same time (SHW208)."""
    if sketch.separation is None:
        return
    standing: dict[str, tuple[Formation, Settings]] = {}
    gone = _gone(sketch.show)
    for row, item in enumerate(sketch.ordered()):
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

    What comes later in a chapter leaves before another arrives: together with it, or,
    where groups have times of their own, if these say so.
    """
    found: set[tuple[str, int]] = set()
    if show is None:
        return found
    for chapter in chapters(show):
        together = [show.transitions[index] for index in chapter]
        apart = own_times(together)
        for at, index in enumerate(chapter):
            # It arrives after it has left, at the soonest.
            there = arrival(together[at]) or departure(together[at])
            for later in together[at + 1 :]:
                leaves = departure(later)
                timed = there is not None and leaves is not None and leaves < there
                if timed or not apart:
                    found.add((str(later.group), index))
    return found


def _in_motion(sketch: Sketch) -> Iterator[Diagnostic]:
    """Check formations that move while they are held against other groups' (SHW208).

    At some instants: what is found is impossible, what is not found may be so too.
    """
    show, settings = sketch.show, sketch.ordered()
    if show is None or sketch.separation is None:
        return
    separation, limit = sketch.separation, sketch.separation.distance - _ROUNDING
    for chapter in chapters(show):
        held = list(_held(show, chapter))
        for one, other in combinations(held, 2):
            first, second = (show.transitions[part.index] for part in (one, other))
            low, high = max(one.begin, other.begin), min(one.end, other.end)
            moving = first.motion or second.motion
            if first.group == second.group or not moving or high <= low:
                continue
            still, theirs = (
                show.formations[part.to].points for part in (first, second)
            )
            if closest_between(still, theirs, limit, separation) is not None:
                continue  # said already, of formations that stand
            times = np.linspace(low, high, _INSTANTS)
            both = zip(one.places(show, times), other.places(show, times), strict=True)
            pairs = [
                (closest_between(mine, theirs, limit, separation), float(time))
                for time, (mine, theirs) in zip(times, both, strict=True)
            ]
            near = [(pair.distance, time, pair) for pair, time in pairs if pair]
            if not near:
                continue
            distance, time, pair = min(near, key=lambda found: found[:2])
            mover = one if first.motion else other
            yield Diagnostic(
                "SHW208",
                f"place {pair.first + 1} of `{first.to}` (group `{first.group}`) comes "
                f"within {number_text(round(distance, 3))} m of place "
                f"{pair.second + 1} of `{second.to}` (group `{second.group}`), "
                f"the separation is {number_text(separation.distance)} m",
                settings[mover.index].mark_of("motion"),
                notes=(f"{time - mover.begin:.1f} s into this motion",),
                help="make the motion smaller, or move one of the formations away",
                spot=Spot(first.to, (pair.first,)),
            )


_INSTANTS = 25
"""Instants at which two groups are looked at while they hold their formations."""
_ROUNDING = 1e-6
"""What counts as rounding of a distance [m]."""


@dataclass(frozen=True, slots=True)
class _Held:
    """How long a group holds a formation."""

    index: int
    """Of the transition that reaches it."""
    begin: float
    """Show time, or time since all groups of a chapter stand [s]."""
    end: float

    def places(self, show: Show, times: FloatArray) -> FloatArray:
        """Places of its formation at times (m,) of the hold [s], (m, n, 3) [m]."""
        one = show.transitions[self.index]
        formation = show.formations[one.to]
        every = np.arange(len(formation.points))
        moving = moving_places(every, every, formation, one, show.formations)
        since = times - self.begin
        return moving.positions(self.end - self.begin, since)


def _held(show: Show, chapter: list[int]) -> Iterator[_Held]:
    """Yield when groups of a chapter hold their formations, as far as that is known."""
    flown = [show.transitions[index] for index in chapter]
    if not own_times(flown):
        hold = max(one.hold for one in flown)
        yield from (_Held(index, 0.0, hold) for index in chapter if hold > 0.0)
        return
    over = ending(flown)
    for lane in lanes(flown):
        for at, after in zip(lane, [*lane[1:], None], strict=True):
            one, begin = flown[at], arrival(flown[at])
            end = over if after is None else departure(flown[after])
            if after is None and one.motion and begin is not None:
                end = over if one.under_way[1] else begin + one.hold
            if begin is not None and end is not None and end > begin:
                yield _Held(chapter[at], begin, end)


def _standing_by(sketch: Sketch) -> Iterator[Diagnostic]:
    """Check formations of groups against drones that wait (SHW208).

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
                    f"drone {drone + 1}, which waits there; the separation "
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
