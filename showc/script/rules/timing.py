"""Timing: moves quicker than any drone can fly, limits that rotors never reach."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from showc.script.diagnostic import Diagnostic, Severity
from showc.script.lanes import (
    SHORTEST_MOVE,
    arrival,
    chapters,
    common,
    departure,
    lanes,
    left_last,
    left_moving,
    over,
    own_times,
    whole_milliseconds,
)
from showc.script.language.wording import number_text
from showc.script.rules.least_time import least_duration
from showc.script.show import Follow, Rotate

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.script.language.settings import Settings
    from showc.script.mark import Mark
    from showc.script.sections.build import Sketch
    from showc.script.show import Show


ENVELOPE_UNITS = {
    "level_speed": "m/s",
    "acceleration": "m/s²",
    "acceleration_up": "m/s²",
    "acceleration_down": "m/s²",
}
"""Limits that an autopilot's envelope sets, and their units."""
_MORE = 1.01
"""How far above the rotors' own limit a limit may be: printed ones are rounded."""


def timing_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield the transitions whose duration is too short for physics (SHW209)."""
    show = sketch.show
    if show is None:
        return
    settings = sketch.ordered()
    for index, transition in enumerate(show.transitions):
        if transition.duration is None:
            continue
        least, drone = least_duration(show, index)
        if transition.duration >= least:
            continue
        written = settings[index].written("duration")
        slowest = f"drone {drone + 1}" if drone is not None else "some drone"
        yield Diagnostic(
            "SHW209",
            f"`{transition.name}` needs at least {_up(least)} s; the "
            f"script gives {number_text(transition.duration)} s",
            settings[index].mark_of("duration" if written else "at"),
            notes=(
                f"{slowest} cannot get there sooner within its speed and thrust limits",
            ),
            help=f"allow at least {_up(least)} s, or leave "
            f"`{'duration' if written else 'start'}` out",
        )


def time_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield the times that cannot be met, by what comes before them (SHW213).

    Everything that is not given counts with a lower bound: what is found here is
    impossible, what is not found may be so all the same.
    """
    show = sketch.show
    if show is None:
        return
    settings = sketch.ordered()
    launch = show.launch
    earliest = launch.altitude / launch.climb_speed + launch.hold
    before = (
        f"launch and its hold end at {_time(show, earliest, up=True)} at the earliest"
    )
    leaving: int | None = None
    for members in chapters(show):
        together = [show.transitions[at] for at in members]
        if leaving is not None and own_times(together):
            yield Diagnostic(
                "SHW213",
                f"`{show.transitions[leaving].name}` stays in motion, and the groups "
                "that follow move at different times",
                settings[leaving].mark_of("leave"),
                help="leave `leave: moving` out, or give the groups the same times",
            )
            return
        last = left_last(together)
        both = zip(members, together, strict=True)
        moving = (row for row, one in both if one in last and one.under_way[1])
        leaving = next(moving, None)
        if own_times(together):
            asked = [settings[row] for row in members]
            if found := _lane_fault(show, members, asked, earliest, before):
                yield found
                return
            earliest = over(together)
            name = " + ".join(one.to for one in together)
            before = f"`{name}` is held until {_time(show, earliest, up=True)}"
            continue
        at = next((one.at for one in together if one.at is not None), None)
        start = next((one.start for one in together if one.start is not None), None)
        taken = common(together) or 0.0
        least = max(taken, *(least_duration(show, row)[0] for row in members))
        for row, one in zip(members, together, strict=True):
            asked_for = one.duration or 0.0
            if asked_for and abs(asked_for - taken) > _MILLISECOND:
                yield Diagnostic(
                    "SHW213",
                    f"`{one.name}` takes {number_text(asked_for)} s, the groups that "
                    f"fly with it {number_text(taken)} s",
                    settings[row].mark_of("duration"),
                    help="leave `duration` out, or give this group an `at` or `start` "
                    "of its own",
                )
                return
        # The time from a start to an arrival is a duration, and judged as one.
        paired = any(None not in {one.start, one.at} for one in together)
        for time, key, soonest in (
            (start, "start", earliest),
            (None if paired else at, "at", max(earliest, start or 0.0) + least),
        ):
            if time is None or time >= soonest - _ON_TIME:
                continue
            member = next(row for row in members if settings[row].written(key))
            verb = "arrive" if key == "at" else "start"
            move = f"the move takes at least {_up(least)} s"
            yield Diagnostic(
                "SHW213",
                f"`{show.transitions[member].name}` cannot {verb} at "
                f"{_time(show, time)}: {_up(soonest - time)} s too early",
                settings[member].mark_of(key),
                notes=(before, move) if key == "at" else (before,),
                help=_sooner(show, soonest),
            )
            return
        hold = max(one.hold for one in together)
        arrived = at if at is not None else max(earliest, start or 0.0) + least
        earliest = arrived + hold
        name = show.transitions[members[0]].to
        before = (
            f"`{name}` is reached at {_time(show, arrived, up=True)} at the earliest, "
            f"and held for {number_text(hold)} s"
        )


def loose_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield moves that cannot know how fast a motion is that they join (SHW213).

    Where what follows has a time, the motion is held until then, and how fast it is
    depends on when it is met: of a move that is as fast as can be nothing says when.
    """
    show = sketch.show
    if show is None:
        return
    settings = sketch.ordered()
    for members, following in pairwise(chapters(show)):
        before, after = (
            [show.transitions[row] for row in rows] for rows in (members, following)
        )
        timed = any(one.timed for one in after)
        if not timed or own_times(after):
            continue
        apart = own_times(before)
        # What saves energy may leave a motion as soon as it can.
        waits = common(after) is not None or all(
            one.prefer != "energy" or one.at is None for one in after
        )
        met = (
            not apart
            and waits
            and any(
                one.under_way[0] and isinstance(motion, Rotate | Follow)
                for one in before
                for motion in one.motion
            )
        )
        ends = left_last(before) if apart else before
        left = met or any(one.under_way[1] for one in ends)
        for rows, flown, joins in ((members, before, met), (following, after, left)):
            wishes = {one.prefer for one in flown}
            quick = wishes == {"time"} or (
                "energy" in wishes and all(one.at is None for one in flown)
            )
            if quick and joins and common(flown) is None:
                one = show.transitions[rows[0]]
                yield Diagnostic(
                    "SHW213",
                    f"`{one.name}` has no fixed duration, and the motion that it "
                    f"{'leaves' if flown is after else 'joins'} depends on it",
                    settings[rows[0]].mark_of("prefer"),
                    help="give it a `duration`, or leave `prefer` out",
                )
                return


_ON_TIME = 1e-6
"""By how much a bound may be above a time by rounding alone [s]."""


def _lane_fault(
    show: Show,
    members: list[int],
    asked: list[Settings],
    earliest: float,
    before: str,
) -> Diagnostic | None:
    """Say which transition of a group with times of its own cannot be (SHW213)."""
    together = [show.transitions[index] for index in members]
    for lane in lanes(together) if left_moving(together) else ():
        one = together[lane[0]]
        if not one.timed:
            return Diagnostic(
                "SHW213",
                f"`{one.name}` has no time, and a group stays in motion until all have "
                "arrived",
                asked[lane[0]].mark,
                help="give it `start` or `at`",
            )
    for lane in lanes(together):
        free, why = earliest, before
        for row in lane:
            one, there = together[row], arrival(together[row])
            starts = departure(one)
            least = max(least_duration(show, members[row])[0], SHORTEST_MOVE)
            soonest = free if starts is not None else free + least
            time = starts if starts is not None else there
            there = there or max(free, starts or 0.0) + (one.duration or least)
            if time is not None and time < soonest - _ON_TIME:
                key = "start" if one.start is not None else "at"
                return Diagnostic(
                    "SHW213",
                    f"`{one.name}` cannot {'start' if starts else 'arrive'} at "
                    f"{_time(show, time)}: {_up(soonest - time)} s too "
                    "early",
                    asked[row].mark_of(key),
                    notes=(why,),
                    help=_sooner(show, soonest),
                )
            free = there + one.hold
            why = (
                f"`{one.group}` reaches `{one.to}` at {_time(show, there)}, and holds "
                f"it for {number_text(one.hold)} s"
            )
    return None


def _sooner(show: Show, soonest: float) -> str:
    """Say what to do about a time that is too early."""
    time = _time(show, soonest, up=True)
    return f"ask for {time} or later, or shorten what comes before"


_MILLISECOND = 1e-3
"""What a time may be off by rounding [s]."""


def _time(show: Show, time: float, *, up: bool = False) -> str:
    """Return a show time as the script counts it, rounded up where asked."""
    counted = time - (show.music.offset if show.music is not None else 0.0)
    shown = _up(counted) if up else number_text(round(counted, 3))
    return f"{shown} s" + (" of the music" if show.music is not None else "")


def limit_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield limits that the rotors or the autopilot never reach (SHW210, SHW211)."""
    show = sketch.show
    if show is None:
        return
    section = sketch.settings.section("limits")
    vehicle, limits = show.vehicle, show.limits
    if section.written("thrust_max") and limits.thrust_max > vehicle.thrust_max * _MORE:
        yield _beyond(section.mark_of("thrust_max"), "thrust", limits.thrust_max,
                      vehicle.thrust_max, "N")  # fmt: skip
    if section.written("torque"):
        pairs = zip("234", limits.torque_max, vehicle.torque_max, strict=True)
        for axis, limit, most in pairs:
            if limit > most * _MORE:
                mark = section.mark_of("torque")
                yield _beyond(mark, f"torque U{axis}", limit, most, "N m")

    yield from _envelope_findings(sketch)


def _envelope_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield the limits that the autopilot's envelope overrides (SHW211)."""
    show = sketch.show
    if show is None or show.airframe_limits is None:
        return
    section = sketch.settings.section("limits")
    for key, unit in ENVELOPE_UNITS.items():
        kept, asked = getattr(show.limits, key), getattr(show.airframe_limits, key)
        if section.written(key) and asked > kept:
            yield Diagnostic(
                "SHW211",
                f"`{key}` is {number_text(asked)} {unit}; the autopilot follows "
                f"{number_text(kept)} {unit}",
                section.mark_of(key),
                help="lower the limit, or write `envelope: airframe` in `vehicle`",
                severity=Severity.WARNING,
            )


def _beyond(mark: Mark, what: str, limit: float, most: float, unit: str) -> Diagnostic:
    return Diagnostic(
        "SHW210",
        f"the limit of {what} is {number_text(limit)} {unit}; the rotors produce "
        f"{number_text(most)} {unit} at most",
        mark,
        help="check the limit, or the parameters of the rotors",
        severity=Severity.WARNING,
    )


def _up(time: float) -> str:
    """Show a time [s], rounded up to what the script can give."""
    return number_text(whole_milliseconds(time))
