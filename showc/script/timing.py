"""Timing: moves quicker than any drone can fly, limits that rotors never reach."""

from __future__ import annotations

from itertools import pairwise
from math import inf, remainder, sin, sqrt, tau
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import Diagnostic, Severity
from showc.script.lanes import (
    arrival,
    chapters,
    common,
    departure,
    ending,
    lanes,
    own_times,
    rest,
)
from showc.script.show import Follow, Morph, Rotate, Travel
from showc.script.wording import number_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from showc.arrays import FloatArray
    from showc.script.build import Sketch
    from showc.script.settings import Settings
    from showc.script.show import Mark, Show, Transition
    from showc.vehicle import Limits, Quadrotor


ENVELOPE_UNITS = {
    "level_speed": "m/s",
    "acceleration": "m/s²",
    "acceleration_up": "m/s²",
    "acceleration_down": "m/s²",
}
"""Limits that an autopilot's envelope sets, and their units."""
_FEW, _SAMPLE, _PAIRS = 4, 40, 2_000_000
"""Others that each place is first held against, at least and at most, and pairs of
places that are looked at in a script: all of them up to ten moves of 450 drones."""
_MORE = 1.01
"""How far above the rotors' own limit a limit may be: printed ones are rounded."""


def least_times(
    displacement: FloatArray, limits: Limits, vehicle: Quadrotor
) -> FloatArray:
    """Return a time below which no drone moves by a displacement, hover to hover.

    Along each axis by itself: speed and acceleration are bounded, and a point with
    these bounds needs 2 sqrt(d / a), or d / v + v / a if it reaches the speed v. The
    horizontal acceleration is at most the thrust's horizontal part at full tilt, the
    vertical one what thrust and weight leave; both are generous, so that the time is
    a lower bound. Where jerk is at most j, a move of length d takes (32 d / j)^(1/3).

    Parameters
    ----------
    displacement
        Shape (..., 3) [m].
    limits
        What the drone keeps.
    vehicle
        What flies.

    Returns
    -------
    FloatArray
        Shape (...) [s].
    """
    thrust = min(limits.thrust_max, vehicle.thrust_max) / vehicle.mass
    # Roll and pitch tilt together: the horizontal part is at most sqrt(2) sin(tilt).
    level = thrust * min(1.0, sqrt(2.0) * sin(limits.tilt))
    level = min(level, limits.acceleration or inf)
    up = min(thrust - vehicle.gravity, limits.acceleration_up or inf)
    down = min(vehicle.gravity, limits.acceleration_down or inf)
    length = np.linalg.norm(displacement, axis=-1)
    times: FloatArray = np.cbrt(32.0 * length / (limits.jerk or inf))
    for axis in range(3):
        distance = np.abs(displacement[..., axis])
        forward = displacement[..., axis] > 0.0
        speed = np.where(forward, limits.velocity_max[axis], -limits.velocity_min[axis])
        if axis < 2:
            gain = loss = np.full(distance.shape, level)
        else:
            gain = np.where(forward, up, down)
            loss = np.where(forward, down, up)
        times = np.maximum(times, _axis_time(distance, speed, gain, loss))
    return times


def _axis_time(
    distance: FloatArray, speed: FloatArray, gain: FloatArray, loss: FloatArray
) -> FloatArray:
    """Return the least time of a point that gains and loses speed at given rates."""
    mean = 1.0 / gain + 1.0 / loss
    peak = np.sqrt(2.0 * distance / mean)
    reached = np.minimum(peak, speed)
    cruise = np.maximum(distance - reached**2 * mean / 2.0, 0.0)
    return np.asarray(reached * mean + cruise / np.maximum(reached, 1e-12))


def timing_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield the transitions whose duration is too short for physics (SHW209)."""
    show = sketch.show
    if show is None:
        return
    settings = sketch.settings.sound("transitions")
    for index, transition in enumerate(show.transitions):
        if transition.duration is None:
            continue
        least, drone = least_duration(show, index)
        if transition.duration >= least:
            continue
        slowest = f"drone {drone + 1}" if drone is not None else "some drone"
        yield Diagnostic(
            "SHW209",
            f"`{transition.name}` needs at least {number_text(_up(least))} s, the "
            f"script gives {number_text(transition.duration)} s",
            settings[index].mark_of("duration"),
            notes=(f"{slowest} cannot be there sooner, by its speed and thrust alone",),
            help=f"give at least {number_text(_up(least))} s, or leave `duration` out",
        )


def time_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield the times that cannot be met, by what comes before them (SHW213).

    Everything that is not given counts with a lower bound: what is found here is
    impossible, what is not found may be so all the same.
    """
    show = sketch.show
    if show is None:
        return
    settings = sketch.settings.sound("transitions")
    launch = show.launch
    earliest = launch.altitude / launch.climb_speed + launch.hold
    before = (
        f"launch and its hold end at {_time(show, earliest, up=True)} at the soonest"
    )
    leaving: int | None = None
    for members in chapters(show):
        together = [show.transitions[at] for at in members]
        if leaving is not None and own_times(together):
            yield Diagnostic(
                "SHW213",
                f"`{show.transitions[leaving].name}` is left in motion, and the groups "
                "that follow move at times of their own",
                settings[leaving].mark_of("leave"),
                help="leave `leave: moving` out, or give the groups one time",
            )
            return
        moving = (row for row in members if show.transitions[row].under_way[1])
        leaving = None if own_times(together) else next(moving, None)
        if own_times(together):
            asked = [settings[row] for row in members]
            if found := _lane_fault(show, members, asked, earliest, before):
                yield found
                return
            ends = ending(together) + rest(together)
            name = " + ".join(one.to for one in together)
            earliest = ends
            before = f"`{name}` is held until {_time(show, ends, up=True)}"
            continue
        at = next((one.at for one in together if one.at is not None), None)
        start = next((one.start for one in together if one.start is not None), None)
        taken = common(together) or 0.0
        least = max(taken, *(least_duration(show, row)[0] for row in members))
        for row, one in zip(members, together, strict=True):
            asked_for = one.duration or 0.0
            if asked_for > taken + _MILLISECOND:
                yield Diagnostic(
                    "SHW213",
                    f"`{one.name}` takes {number_text(asked_for)} s, and the groups "
                    f"that are flown with it {number_text(taken)} s",
                    settings[row].mark_of("duration"),
                    help="leave `duration` out, or say when this group arrives: by "
                    "`at`, or by `start`",
                )
                return
        for time, key, soonest in (
            (start, "start", earliest),
            (at, "at", max(earliest, start or 0.0) + least),
        ):
            if time is None or time >= soonest - _ON_TIME:
                continue
            member = next(row for row in members if settings[row].written(key))
            verb = "stand" if key == "at" else "start"
            move = f"the move takes {number_text(_up(least))} s at least"
            yield Diagnostic(
                "SHW213",
                f"`{show.transitions[member].name}` cannot {verb} at "
                f"{_time(show, time)}: {number_text(_up(soonest - time))} s too early",
                settings[member].mark_of(key),
                notes=(before, move) if key == "at" else (before,),
                help=f"the earliest time is {_time(show, soonest, up=True)}, or later; "
                "shorten what comes before, or move the time",
            )
            return
        hold = max(one.hold for one in together)
        arrived = at if at is not None else max(earliest, start or 0.0) + least
        earliest = arrived + hold
        name = show.transitions[members[0]].to
        before = (
            f"`{name}` stands at {_time(show, arrived, up=True)} at the soonest and is "
            f"held for {number_text(hold)} s"
        )


def loose_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield moves that cannot know how fast a motion is that they join (SHW213).

    Where what follows has a time, the motion is held until then, and how fast it is
    depends on when it is met: of a move that is as fast as can be nothing says when.
    """
    show = sketch.show
    if show is None:
        return
    settings = sketch.settings.sound("transitions")
    for members, following in pairwise(chapters(show)):
        before, after = (
            [show.transitions[row] for row in rows] for rows in (members, following)
        )
        timed = any(one.timed for one in after)
        if not timed or own_times(before) or own_times(after):
            continue
        # What saves energy may leave a motion as soon as it can.
        waits = common(after) is not None or all(
            one.prefer != "energy" or one.at is None for one in after
        )
        met = waits and any(
            one.under_way[0] and isinstance(motion, Rotate | Follow)
            for one in before
            for motion in one.motion
        )
        left = met or any(one.under_way[1] for one in before)
        for rows, flown, joins in ((members, before, met), (following, after, left)):
            wishes = {one.prefer for one in flown}
            quick = wishes == {"time"} or (
                "energy" in wishes and all(one.at is None for one in flown)
            )
            if quick and joins and common(flown) is None:
                one = show.transitions[rows[0]]
                yield Diagnostic(
                    "SHW213",
                    f"how long `{one.name}` takes is not known, and the motion that it "
                    f"{'leaves' if flown is after else 'meets'} is held for what is "
                    "left of a given time",
                    settings[rows[0]].mark_of("prefer"),
                    help="give it `duration`, or leave `prefer` out",
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
    for lane in lanes(together):
        free, why = earliest, before
        for row in lane:
            one, there = together[row], arrival(together[row])
            starts = departure(one)
            if there is None:
                return Diagnostic(
                    "SHW213",
                    f"when `{one.name}` arrives is not known, and other groups move "
                    "meanwhile at times of their own",
                    asked[row].mark,
                    help="give it `at`, or both `start` and `duration`",
                )
            if one.under_way[1] and row == lane[-1]:
                return Diagnostic(
                    "SHW213",
                    f"`{one.name}` leaves a motion under way, and groups with times of "
                    "their own have moved before it",
                    asked[row].mark_of("leave"),
                    help="leave `leave: moving` out, or let the group itself fly on, "
                    "at a time that the script says",
                )
            least = max(least_duration(show, members[row])[0], _SHORTEST)
            soonest = free if starts is not None else free + least
            time = starts if starts is not None else there
            if time < soonest - _ON_TIME:
                key = "start" if one.start is not None else "at"
                return Diagnostic(
                    "SHW213",
                    f"`{one.name}` cannot {'start' if starts else 'stand'} at "
                    f"{_time(show, time)}: {number_text(_up(soonest - time))} s too "
                    "early",
                    asked[row].mark_of(key),
                    notes=(why,),
                    help=f"the earliest time is {_time(show, soonest, up=True)}, or "
                    "later; shorten what comes before, or move the time",
                )
            free = there + one.hold
            why = (
                f"`{one.group}` stands in `{one.to}` at {_time(show, there)} and is "
                f"held for {number_text(one.hold)} s"
            )
    return None


_MILLISECOND = 1e-3
"""What a time may be off by rounding [s]."""
_SHORTEST = 0.1
"""Least time of a move [s], as for `duration`."""


def _time(show: Show, time: float, *, up: bool = False) -> str:
    """Return a show time as the script counts it, rounded up where asked."""
    counted = time - (show.music.offset if show.music is not None else 0.0)
    shown = number_text(_up(counted) if up else round(counted, 3))
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
                f"`{key}` is {number_text(asked)} {unit}, the autopilot follows "
                f"{number_text(kept)} {unit}",
                section.mark_of(key),
                help="lower the limit, or write `envelope: airframe` in `vehicle`",
                severity=Severity.WARNING,
            )


def _beyond(mark: Mark, what: str, limit: float, most: float, unit: str) -> Diagnostic:
    return Diagnostic(
        "SHW210",
        f"the limit of {what} is {number_text(limit)} {unit}, the rotors give "
        f"{number_text(most)} {unit} at most",
        mark,
        help="check the limit, or the vehicle's rotors; the rotors' own holds too",
        severity=Severity.WARNING,
    )


def _up(time: float) -> float:
    return float(np.ceil(time * 1000.0 - 1e-6) / 1000.0)


def least_mean_time(show: Show, index: int) -> float:
    """Return a lower bound on a transition's time from the fleet's middle alone [s].

    Some drone moves at least as far along an axis as the middle of all places does.
    Cheap, and weaker than :func:`least_duration`.
    """
    ends = _ends(show, index)
    if ends is None:
        return 0.0
    start, goal = ends
    way = goal.mean(axis=0) - start.mean(axis=0)
    # The middle may move along several axes with different drones: each by itself.
    each = [least_times(way * axis, show.limits, show.vehicle) for axis in np.eye(3)]
    return float(np.max(each))


def _ends(show: Show, index: int) -> tuple[FloatArray, FloatArray] | None:
    """Return where the drones of a transition start and end, if that is known."""
    transition = show.transitions[index]
    own = transition.group
    if show.parking is not None:
        return None
    before = next(
        (
            one
            for one in reversed(show.transitions[:index])
            if own is None or one.group in {None, own}
        ),
        None,
    )
    rows = slice(None) if own is None else list(show.groups[own])
    if before is None:
        start = show.formations[show.pads].points[: show.drones][rows]
        start = start + np.array([0.0, 0.0, show.launch.altitude])
    elif (
        _elsewhere(before)
        or (own is None and before.group is not None)
        or before.under_way[1]
        or transition.under_way[0]
    ):
        return None
    else:
        start = show.formations[before.to].points
        if before.group != own:
            if before.assignment != "fixed":
                return None
            start = start[rows]
    goal = show.formations[transition.to].points
    return (start, goal) if len(start) == len(goal) else None


def _elsewhere(held: Transition) -> bool:
    """Tell whether a formation ends its hold in other places than it began it."""
    return any(
        abs(remainder(one.angle, tau)) > _ON_TIME
        if isinstance(one, Rotate)
        else isinstance(one, Travel | Morph | Follow)
        for one in held.motion
    )


def least_duration(show: Show, index: int) -> tuple[float, int | None]:
    """Return a lower bound on a transition's time [s], and the drone that sets it.

    With fixed places it is that of the drone that needs longest. With optimal ones
    it is that of the drone whose nearest place, or of the place whose nearest drone,
    is furthest in time. Zero where it is not known where the drones come from.
    """
    transition = show.transitions[index]
    ends = _ends(show, index)
    if ends is None:
        return 0.0, None
    start, goal = ends
    known = index == 0 or all(
        item.assignment == "fixed" for item in show.transitions[:index]
    )
    if transition.assignment == "fixed" and known:
        times = least_times(goal - start, show.limits, show.vehicle)
        row = int(np.argmax(times))
        own = transition.group
        return float(times[row]), row if own is None else show.groups[own][row]
    if transition.assignment == "fixed":
        return 0.0, None
    pairs = _PAIRS // len(show.transitions)
    return max(
        _furthest(start, goal, lambda way: _moves(show, way), pairs),
        _furthest(goal, start, lambda way: _moves(show, -way), pairs),
    ), None


def _moves(show: Show, displacement: FloatArray) -> FloatArray:
    return least_times(displacement, show.limits, show.vehicle)


def _furthest(
    places: FloatArray,
    others: FloatArray,
    times: Callable[[FloatArray], FloatArray],
    pairs: int,
) -> float:
    """Return how long the way to the nearest other takes, from the furthest place [s].

    Places that are near one of a few others are not looked at further; of great fleets
    at most as many places as take little time, the least of which is a bound too.

    Parameters
    ----------
    places, others
        Shape (n, 3) and (m, 3) [m].
    times
        Least times of displacements, shape (..., 3) [m], to shape (...) [s].
    pairs
        How many displacements take little time.
    """
    sample = min(max(pairs // (2 * len(places)), _FEW), _SAMPLE)
    few = others[:: max(len(others) // sample, 1)]
    most = np.min([times(other - places) for other in few], axis=0)
    least = 0.0
    for place in np.argsort(-most, kind="stable")[: max(pairs // len(others), 1)]:
        if most[place] <= least:
            break
        least = max(least, float(times(others - places[place]).min()))
    return least
