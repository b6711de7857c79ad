"""The outlook: what a compile would solve, and between which bounds, before solving."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.plan.itinerary import STILL
from showc.script.lanes import arrival
from showc.script.language.wording import counted
from showc.script.rules.least_time import least_times

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.options import SolveOptions
    from showc.flight import LegFlight
    from showc.plan.itinerary import Itinerary, Leg
    from showc.script.show import Show
    from showc.vehicle import Limits


@dataclass(frozen=True, slots=True)
class LegOutlook:
    """What is known of a leg before it is solved."""

    index: int
    name: str
    solve: bool
    """Whether a compile would have to solve it."""
    reason: str
    """Why, or why not."""
    lower: float
    """The leg cannot take less, by limits of the slowest drone along each axis [s]."""
    upper: float
    """A straight flight of all drones side by side takes this long [s]."""
    start: float = 0.0
    """Show time of its start, moves not solved yet as straight flights [s]."""
    asked: float | None = None
    """Show time at which the script wants it to end [s]."""
    saved: float | None = None
    """Where it prefers energy: what it saves as a straight flight, against flying at
    once and hovering; an estimate [J]."""
    group: str | None = None
    """Group whose move it is, within the leg before, at a time of its own."""
    ends: float | None = None
    """Show time at which that ends [s]."""

    def to_json(self) -> dict[str, Any]:
        """Return the same as plain data."""
        return asdict(self)


def outlook(itinerary: Itinerary, options: SolveOptions) -> list[LegOutlook]:
    """Look at every leg of a show: bounds on its time, and whether it is cached."""
    from showc.fleet.execution.cache import Cache, leg_key  # noqa: PLC0415
    from showc.fleet.pace import straight_time  # noqa: PLC0415
    from showc.fleet.timetable import scheduled, settled  # noqa: PLC0415

    cache, show, itinerary = Cache.of(options), itinerary.show, settled(itinerary)

    def cached(leg: Leg) -> LegFlight | None:
        return cache.find(leg_key(leg, show, options), leg)

    # What is not solved yet counts with its straight flight, which takes longer.
    solved = {leg.index: cached(leg) for leg in itinerary.legs if leg.open}
    times = {
        index: flight.duration
        if flight is not None
        else straight_time(itinerary.legs[index], show)
        for index, flight in solved.items()
    }
    legs = scheduled(itinerary, times).legs
    open_times = iter(times.values())
    found, clock = [], 0.0
    for leg in legs:
        time = next(open_times) if leg.open else leg.duration or 0.0
        found.append(_look(leg, show, clock, cached(leg) is not None))
        for part in leg.parts:
            one = _look(part, show, part.depart or 0.0, cached(part) is not None)
            flown = show.transitions[part.transition or 0]
            asked = None if part.motion else arrival(flown)
            ends = round(one.start + (part.duration or 0.0), 3)
            group = flown.group
            found.append(
                replace(one, index=leg.index, group=group, asked=asked, ends=ends)
            )
        clock = round(clock + time, 3)
    return found


def cue_sheet(legs: list[LegOutlook], offset: float, *, csv: bool) -> bytes:
    """Return the timeline as Audacity reads labels, or as CSV with a header.

    Parameters
    ----------
    legs
        As :func:`outlook` found them.
    offset
        Show time at which the music begins [s]; what ends before it is left out.
    csv
        Whether to write CSV with the columns Name, Start and End, as Reaper does.
    """
    whole = [leg.start for leg in legs if leg.group is None]
    last = legs[-1].start + legs[-1].upper
    ends = [
        (leg.ends or leg.start)
        if leg.group is not None
        else min((start for start in whole if start > leg.start), default=last)
        for leg in legs
    ]
    joint = "," if csv else "\t"
    rows = ["Name,Start,End"] if csv else []
    for leg, end in zip(legs, ends, strict=True):
        times = [f"{max(time - offset, 0.0):.3f}" for time in (leg.start, end)]
        name = " ".join(leg.name.replace(joint, " ").replace('"', "").split())
        if end > offset:
            rows.append(joint.join([name, *times] if csv else [*times, name]))
    return ("\n".join(rows) + "\n").encode()


def _look(leg: Leg, show: Show, start: float, cached: bool) -> LegOutlook:  # noqa: FBT001
    from showc.fleet.pace import straight_time  # noqa: PLC0415 - heavy

    if leg.parts:
        time, reason = leg.duration or 0.0, "groups at times of their own, see below"
        return LegOutlook(
            leg.index, leg.name, False, reason, time, time, start, leg.arrive
        )
    if leg.motion:
        time = leg.duration or 0.0
        reason = "solved before" if cached else "moving formation"
        return LegOutlook(leg.index, leg.name, not cached, reason, time, time, start)
    way = np.linalg.norm(leg.goal - leg.start, axis=1)
    if not (way > STILL).any():
        time, reason = leg.duration or 0.0, "no drone moves"
        return LegOutlook(leg.index, leg.name, False, reason, time, time, start)
    move = leg.goal - leg.start
    lower = _in_motion(move, leg.limits)
    if not leg.in_motion:
        lower = float(least_times(move, leg.limits, show.vehicle).max())
    upper = max(straight_time(leg, show), leg.duration or 0.0)
    reason = (
        "solved before"
        if cached
        else f"to solve: {counted(int((way > STILL).sum()), 'drone')}, up to "
        f"{way.max():.1f} m"
    )
    saved = None
    if leg.prefer == "energy" and leg.duration is not None:
        saved = _saved(leg, show, leg.duration)
        reason += f"; saves about {saved:.0f} J"
    return LegOutlook(
        leg.index, leg.name, not cached, reason, lower, upper, start, leg.arrive, saved
    )


def _saved(leg: Leg, show: Show, duration: float) -> float:
    from showc.fleet.leg import fleet_of  # noqa: PLC0415 - heavy
    from showc.fleet.shared_profile.sparing import sparing_profile  # noqa: PLC0415
    from showc.fleet.shared_profile.synchronise import shared_profile  # noqa: PLC0415

    fleet = fleet_of(show, leg)
    quickest = shared_profile(
        show.vehicle, leg.limits, show.heading, leg.start, leg.goal
    )
    waiting = max(duration - quickest.duration, 0.0)
    at_once = fleet.energy(quickest) + fleet.hover * waiting
    return at_once - fleet.energy(sparing_profile(fleet, quickest, duration))


def _in_motion(displacement: FloatArray, limits: Limits) -> float:
    """Time that drones need by their speeds alone, in motion before and after [s]."""
    velocity = np.where(
        displacement > 0.0, limits.velocity_max, np.abs(limits.velocity_min)
    )
    return float((np.abs(displacement) / velocity).max())
