"""The timetable: holds and durations, so that arrivals fall where the script asks.

A move that is to arrive at a time takes its duration where the script gives one. Else
it takes what it prefers: as short as can be, a multiple of its quickest straight
flight's time, or the time that costs the least energy, and never more than there is.
The hold before it takes up what is left. Moves without a time of their own are
flown as short as can be, so their times must be known first.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.errors import SolveError
from showc.fleet.ends import place
from showc.fleet.pace import preferred_time, straight_time
from showc.plan.itinerary import Leg, held_in_motion, in_parts, state_at
from showc.script.lanes import SHORTEST_MOVE, held_for, whole_milliseconds

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import FloatArray
    from showc.flight import LegFlight
    from showc.plan.itinerary import Itinerary
    from showc.script.show import Show

Shifts = dict[int, "tuple[FloatArray, FloatArray]"]
"""Drones that stand elsewhere than planned: where that was, and where it is [m]."""
_ON_TIME = 5e-4
"""By how much a wait may be negative by rounding to milliseconds [s]."""


def timetable(itinerary: Itinerary, known: Mapping[int, LegFlight]) -> Itinerary:
    """Return the itinerary with the times that the script's times ask for.

    Parameters
    ----------
    itinerary
        Legs as planned.
    known
        Flights of the :func:`settled` legs whose time is only known when they are
        solved, by index.

    Raises
    ------
    SolveError
        If a move is to start or to arrive before it can; the message says by how much,
        what is in the way, and what the earliest time is.
    """
    times = {index: flight.duration for index, flight in known.items()}
    return scheduled(itinerary, times, estimated=False)


def scheduled(
    itinerary: Itinerary, times: Mapping[int, float], *, estimated: bool = True
) -> Itinerary:
    """Do the same from the ``times`` [s] of those legs, by index, or estimates.

    An estimate that is longer than there is time for is taken to be too long. What
    moves prefer depends on how fast they leave or join a motion, and that on how long
    it is held: times are worked out from a guess of these at first.
    """
    legs, show, met = _scheduled(itinerary, times, estimated=estimated)
    if met:
        guessed = tuple(
            replace(leg, start_state=met[leg.index][0], goal_state=met[leg.index][1])
            if leg.index in met
            else leg
            for leg in itinerary.legs
        )
        better = replace(itinerary, legs=guessed)
        legs, show, _ = _scheduled(better, times, estimated=estimated)
    return replace(itinerary, show=show, legs=legs)


def settled(itinerary: Itinerary) -> Itinerary:
    """Give moves beside a motion the times that nothing else says.

    Where a motion is held until a given time, how fast it is met depends on that
    arrival: the move takes the time that it prefers. Groups that are left in motion are
    put where they are when all groups have arrived.
    """
    legs, show = list(itinerary.legs), itinerary.show
    for before, motion, after in zip(legs, legs[1:], legs[2:], strict=False):
        met = any(one.paced for one in motion.motion)
        if met and after.timed and before.open and not isinstance(before.prefer, str):
            held = max(motion.duration or 0.0, _HELD)
            state = state_at(show, motion.motion, held, 0, before.goal)
            time = preferred_time(replace(before, goal_state=state), show, math.inf)
            legs[before.index] = replace(before, duration=time)
    shifts: Shifts = {}
    for index, planned in enumerate(itinerary.legs):
        if shifts:
            legs[index], show = _shifted(legs[index], shifts, show)
        if planned.parts and planned.goal_state is not None and _waits(planned):
            ended = _lanes(legs[index], show, 0.0, legs[:index])
            both = enumerate(zip(planned.goal, ended.goal, strict=True))
            shifts |= {row: one for row, one in both if not np.array_equal(*one)}
            left = replace(planned, goal=ended.goal, goal_state=ended.goal_state)
            legs[index] = left
            legs[index + 1], show = _left(left, legs[index + 1], show)
    return replace(itinerary, legs=tuple(legs), show=show)


def _waits(leg: Leg) -> bool:
    """Tell whether groups are held until others arrive at times that are not given."""
    return any(
        one.arrive is None and None in {one.depart, one.duration}
        for one in leg.parts
        if not one.motion
    )


_HELD = 20.0
"""Time for which a motion is taken to be held where that is not known yet [s]."""


def _scheduled(
    itinerary: Itinerary, times: Mapping[int, float], *, estimated: bool
) -> tuple[tuple[Leg, ...], Show, dict[int, tuple[Any, Any]]]:
    """Return legs and show with the times that are asked for.

    Also the states at the ends of moves, by index, where motions beside them are held
    for longer than they were planned.
    """
    show, clock = itinerary.show, 0.0
    legs: list[Leg] = []
    shifts: Shifts = {}
    planned_as: dict[int, int] = {}
    met: dict[int, tuple[Any, Any]] = {}
    for planned in itinerary.legs:
        leg, show = _shifted(planned, shifts, show)
        leg = _lanes(leg, show, clock, legs) if leg.parts else leg
        if estimated and leg.open and leg.arrive is not None:
            room = max(round(leg.arrive - clock, 3), SHORTEST_MOVE)
            times = {**times, leg.index: min(times[leg.index], room)}
        start, duration = _times(leg, show, clock, times, legs)
        wait = round(start - clock, 3)
        if wait > 0.0 and _held_on(legs[-1]):
            before = legs[-1].goal
            leg = _known(leg, legs[-1], wait, show)
            lengthen = _lengthen_lanes if legs[-1].parts else _lengthen_motion
            leg, show = lengthen(legs, wait, leg, show)
            both = enumerate(zip(before, legs[-1].goal, strict=True))
            shifts |= {row: one for row, one in both if not np.array_equal(*one)}
            leg, show = _shifted(leg, shifts, show)
            duration = leg.duration or duration
            joins = len(legs) - (1 if legs[-1].parts else 2)
            moves = (planned_as[joins], legs[joins]), (planned.index, leg)
            met |= {at: (one.start_state, one.goal_state) for at, one in moves}
        elif wait > 0.0:
            _lengthen(legs, wait, show)
        index = len(legs)
        planned_as[index] = planned.index
        fixed = None if leg.open else round(duration, 3)
        after = (index - 1,) if index else ()
        legs.append(replace(leg, index=index, duration=fixed, after=after))
        clock = round(start + duration, 3)
    return tuple(legs), show, met


def _shifted(leg: Leg, shifts: Shifts, show: Show) -> tuple[Leg, Show]:
    """Let drones stand where a motion that is held longer has left them.

    Those that the leg moves are taken out of ``shifts``.
    """
    own = None if leg.transition is None else show.transitions[leg.transition].to
    stays = [
        row
        for row, (old, _) in shifts.items()
        if leg.to_formation != own and np.array_equal(leg.goal[row], old)
    ]
    moved: dict[str, Any] = {}
    for name in ("start", "start_state", "goal", "goal_state"):
        places = getattr(leg, name)
        if places is not None and shifts:
            moved[name] = places.copy()
            for row in shifts if name.startswith("start") else stays:
                if np.array_equal(places[row, :3], shifts[row][0]):
                    moved[name][row, :3] = shifts[row][1]
            moved[name].setflags(write=False)
    if stays:
        formation = show.formations[leg.to_formation]
        points = formation.points.copy()
        points[leg.places[stays]] = [shifts[row][1] for row in stays]
        points.setflags(write=False)
        standing = {leg.to_formation: replace(formation, points=points)}
        show = replace(show, formations={**show.formations, **standing})
    parts = tuple(
        replace(part, start=moved["start"][part.drones])
        if shifts and np.array_equal(part.start, leg.start[part.drones])
        else part
        for part in leg.parts
    )
    for row in [row for row in shifts if row not in stays]:
        del shifts[row]
    return replace(leg, parts=parts, **moved), show


def _times(
    leg: Leg, show: Show, clock: float, times: Mapping[int, float], legs: list[Leg]
) -> tuple[float, float]:
    """Show time at which a leg starts, and its time [s]."""
    duration = times.get(leg.index) if leg.open else leg.duration
    start = clock
    if leg.depart is not None:
        start = leg.depart
    elif leg.arrive is not None and duration is not None:
        start = round(leg.arrive - duration, 3)
    elif leg.arrive is not None:
        straight = whole_milliseconds(straight_time(leg, show))
        room = round(leg.arrive - clock, 3)
        if room < SHORTEST_MOVE:
            raise _late(leg, leg.arrive, clock + straight, legs, straight)
        duration = min(preferred_time(leg, show, room), room)
        start = round(leg.arrive - duration, 3)
    if start < clock - _ON_TIME:
        if leg.arrive is not None:
            least = duration or 0.0
            raise _late(leg, leg.arrive, clock + least, legs, least)
        raise _late(leg, start, clock, legs, 0.0)
    return max(start, clock), duration or 0.0


def _lanes(
    leg: Leg, show: Show, clock: float, legs: list[Leg], until: float = 0.0
) -> Leg:
    """Give every part of a leg its time, and the leg the time from first to last.

    A group stands for as long as the script holds it before it moves again. How long a
    move takes depends on how it leaves what its group held, and that on how long. What
    is left in motion at the end lasts for as long as the leg, or ``until`` later [s].
    """
    parts = leg.parts
    fixed = all(
        part.motion
        or part.arrive is not None
        or None not in (part.depart, part.duration)
        for part in parts
    )
    for _ in range(_ROUNDS if any(part.in_motion for part in parts) else 1):
        moves, free = _moves(parts, show, clock, legs)
        last = {int(part.drones[0]): part for part in parts}
        left = (at for at, part in last.items() if part.goal_state is not None)
        ends = dict.fromkeys(left, max(until, *free.values()))
        timed = _in_motion(parts, moves, free | ends, show)
        both = zip(parts, timed, strict=True)
        parts = tuple(
            replace(one, duration=planned.duration, depart=planned.depart)
            for planned, one in both
        )
    begin = min(part.depart or 0.0 for part in timed)
    end = max((part.depart or 0.0) + (part.duration or 0.0) for part in timed)
    if not fixed:
        end = max(end, *free.values())
    leg = replace(leg, depart=begin, arrive=end, duration=round(end - begin, 3))
    return in_parts(leg, tuple(_among(part, leg, timed) for part in timed), show)


_ROUNDS = 2
"""How often times of groups in motion are worked out: at first from a guess of how fast
they leave it."""


def _moves(
    parts: Sequence[Leg], show: Show, clock: float, legs: list[Leg]
) -> tuple[list[Leg], dict[int, float]]:
    """Return the moves of groups with their times, and when each group is free [s].

    One whose arrival the script leaves open takes the time that it prefers.
    """
    free: dict[int, float] = {}
    found: list[Leg] = []
    for part in parts:
        if part.motion:
            continue
        group = int(part.drones[0])
        before = [*legs, *(one for one in found if int(one.drones[0]) == group)]
        if part.arrive is None and part.duration is None:
            time = preferred_time(part, show, math.inf)
            part = replace(part, duration=time)  # noqa: PLW2901 - as it is flown
        start, duration = _times(part, show, free.get(group, clock), {}, before)
        found.append(replace(part, depart=start, duration=duration))
        held = 0.0
        if part.transition is not None:
            held = held_for(show.transitions[part.transition])
        free[group] = round(start + duration + held, 3)
    return found, free


def _in_motion(
    planned: Sequence[Leg], moves: Sequence[Leg], free: Mapping[int, float], show: Show
) -> list[Leg]:
    """Put motions between moves: from an arrival until the group leaves.

    One that does not leave again is held as long as the script says, which is until it
    is ``free``, or, left in motion, until all are. Moves join and leave what is under
    way in its own state.
    """
    found: list[Leg] = []
    given, held = iter(moves), dict[int, Leg]()
    for part in planned:
        group = int(part.drones[0])
        if not part.motion:
            move = next(given)
            if group in held:
                before = held.pop(group)
                move = replace(move, start=before.goal, start_state=before.goal_state)
            found.append(move)
            continue
        begin = round((found[-1].depart or 0.0) + (found[-1].duration or 0.0), 3)
        leaves = [
            one.depart or 0.0
            for one in moves
            if int(one.drones[0]) == group and (one.depart or 0.0) >= begin
        ]
        time = round(min(leaves, default=free[group]) - begin, 3)
        motion = replace(part, depart=begin, duration=time)
        held[group] = held_in_motion(motion, show, time)
        found[-1] = replace(found[-1], goal_state=held[group].start_state)
        found.append(held[group])
    return found


def _among(part: Leg, leg: Leg, parts: Sequence[Leg]) -> Leg:
    """Put the drones that stand while a part of a leg is flown in its way."""
    begin = part.depart or 0.0
    end = begin + (part.duration or 0.0)
    places, still = leg.start.copy(), np.ones(leg.drones.size, dtype=bool)
    still[part.drones] = False
    for other in parts:
        start = other.depart or 0.0
        if start + (other.duration or 0.0) <= begin:
            places[other.drones] = other.goal
        elif start < end:
            still[other.drones] = False
    parked = places[still] if still.any() else None
    if parked is not None:
        parked.setflags(write=False)
    numbers = tuple(leg.drones[still].tolist())
    return replace(part, others_parked=parked, others_drones=numbers)


def _late(
    leg: Leg, asked: float, earliest: float, legs: list[Leg], takes: float
) -> SolveError:
    """Say that a time cannot be met."""
    verb = "arrive" if leg.arrive is not None else "start"
    why = f"“{legs[-1].name}” ends at {earliest - takes:.3f} s"
    if takes:
        why += f" and the move takes {takes:.3f} s"
    return SolveError(
        f"{place(leg)}: cannot {verb} at {asked:.3f} s of the show, "
        f"{earliest - asked:.3f} s too early: {why}; the earliest time is "
        f"{whole_milliseconds(earliest):.3f} s, or shorten what comes "
        "before"
    )


def _held_on(leg: Leg) -> bool:
    """Tell whether drones hold a motion at the end of a leg until they can leave."""
    if leg.parts:
        return leg.goal_state is not None
    return any(one.tied for one in leg.motion)


def _known(leg: Leg, last: Leg, wait: float, show: Show) -> Leg:
    """Return a move that leaves a motion with a time that is known.

    Raises
    ------
    SolveError
        If it is as short as can be: when the motion is left is not known then.
    """
    if leg.open and not isinstance(leg.prefer, str):
        # Solved already, from where it does not start: it takes what it prefers.
        leg = replace(leg, duration=preferred_time(leg, show, math.inf))
    if leg.open:
        raise _held_open(last, wait, "leave `prefer` out of what follows")
    return leg


def _held_open(last: Leg, wait: float, repair: str) -> SolveError:
    return SolveError(
        f"{place(last)}: is held for {last.duration:.3f} s, {wait:.3f} s less than "
        "the times of what follows leave; drones that meet or leave a moving "
        f"formation as soon as they can must know for how long: {repair}"
    )


def _lengthen_lanes(
    legs: list[Leg], wait: float, leg: Leg, show: Show
) -> tuple[Leg, Show]:
    """Let groups hold a motion longer that they leave under way.

    Others hover meanwhile. Returns what :func:`_lengthen_motion` does.
    """
    last = legs[-1]
    ends = (last.depart or 0.0) + (last.duration or 0.0) + wait
    legs[-1] = _lanes(last, show, 0.0, legs[:-1], round(ends, 3))
    return _left(legs[-1], leg, show)


def _left(last: Leg, leg: Leg, show: Show) -> tuple[Leg, Show]:
    """Let drones leave groups' motions from where and how fast these are."""
    standing = replace(show.formations[last.to_formation], points=last.goal)
    formations = {**show.formations, last.to_formation: standing}
    return (
        replace(leg, start=last.goal, start_state=last.goal_state),
        replace(show, formations=formations),
    )


def _lengthen_motion(
    legs: list[Leg], wait: float, leg: Leg, show: Show
) -> tuple[Leg, Show]:
    """Let drones hold a motion longer that they meet, or leave, under way.

    Where they are and how fast at its ends depends on how long it takes.

    Returns
    -------
    Leg, Show
        The leg that follows, from where they leave it; the show, whose formation after
        the motion is there.

    Raises
    ------
    SolveError
        If how they meet it was needed to find out when they do.
    """
    last, before = legs[-1], legs[-2]
    duration = round((last.duration or 0.0) + wait, 3)
    met = any(one.paced for one in last.motion)
    if met and before.open:
        raise _held_open(last, wait, "say when they meet it, by `at` or `duration`")
    goal, points = last.goal.copy(), show.formations[last.to_formation].points.copy()
    for one in last.motion:
        goal[one.rows] = one.ends(duration)[1][0]
        points[last.places[one.rows]] = goal[one.rows]
    begin, end = last.start_state, state_at(show, last.motion, duration, 1, goal)
    if met:
        begin = state_at(show, last.motion, duration, 0, last.start)
        legs[-2] = replace(before, goal_state=begin)
    legs[-1] = replace(
        last, duration=duration, goal=goal, start_state=begin, goal_state=end
    )
    formations = dict(show.formations)
    if any(one.moves_on for one in last.motion):
        name = last.to_formation
        formations[name] = replace(formations[name], points=points)
    for array in (goal, points):
        array.setflags(write=False)
    return (
        replace(leg, start=goal, start_state=end),
        replace(show, formations=formations),
    )


def _lengthen(legs: list[Leg], wait: float, show: Show) -> None:
    """Let the drones stand longer where they are, by ``wait`` [s]."""
    last = legs[-1]
    if last.kind in {"hold", "motion"}:
        legs[-1] = replace(last, duration=round((last.duration or 0.0) + wait, 3))
        return
    legs.append(
        Leg(
            index=len(legs),
            name=f"hold after {last.name}",
            kind="hold",
            drones=last.drones,
            start=last.goal,
            goal=last.goal,
            from_formation=last.to_formation,
            to_formation=last.to_formation,
            places=last.places,
            limits=show.limits,
            duration=wait,
            after=(len(legs) - 1,),
            mark=last.mark,
            transition=last.transition,
        )
    )
