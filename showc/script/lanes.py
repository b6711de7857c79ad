"""Lanes: which transitions are flown together, and when each group moves by itself.

Transitions of groups that stand next to each other in the script are flown together.
Where they ask for different times, each group has a lane of its own: it stands, moves,
and stands again, whatever the others do meanwhile. A motion of what it holds lasts
until it leaves, or for its hold where it does not leave. One that is left under way
lasts until all of them are held, and what follows leaves. No drone is in two groups.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.script.show import Show, Transition

_SAME = 1e-6
"""Times that differ by less are one: a bar's time may be off by rounding [s]."""


def whole_milliseconds(time: float) -> float:
    """Round a time up to a whole millisecond, as the show counts them [s]."""
    return math.ceil(time * 1000.0 - 1e-6) / 1000.0


def departure(one: Transition) -> float | None:
    """Show time at which a transition starts, if the script fixes it [s]."""
    if one.start is not None:
        return one.start
    if one.at is None or one.duration is None:
        return None
    return round(one.at - one.duration, 3)


def arrival(one: Transition) -> float | None:
    """Show time at which a transition arrives, if the script fixes it [s]."""
    if one.at is not None:
        return one.at
    if one.start is None or one.duration is None:
        return None
    return round(one.start + one.duration, 3)


def cue(together: Sequence[Transition]) -> tuple[float, bool] | None:
    """Show time that the script gives transitions flown in one time, if any [s].

    Also tells whether it is their arrival's: where both are given, that one counts.
    """
    asked = [(one.at, True) for one in together]
    asked += [(one.start, False) for one in together]
    return next(((time, ends) for time, ends in asked if time is not None), None)


SHORTEST_MOVE = 0.1
"""Least time of a move [s], as the field table has it for `duration`."""
SHORTEST_MOTION = 0.5
"""Least time of a motion [s]."""


def held_for(one: Transition) -> float:
    """Time for which a transition is held at least [s]: what moves needs some."""
    return max(one.hold, SHORTEST_MOTION) if one.motion else one.hold


def chapters(show: Show) -> list[list[int]]:
    """Transitions (by index) that are flown together, in order.

    A transition of the whole fleet is a chapter of its own. Consecutive transitions of
    groups share a chapter while no group moves twice. One that does joins them too if
    it starts, or arrives at least, while another of them moves or is held, by the
    script's times. One that starts after all of them are held begins a new chapter,
    unless groups with times of their own leave a motion under way.
    """
    result: list[list[int]] = []
    for index, transition in enumerate(show.transitions):
        before = [show.transitions[k] for k in result[-1]] if result else []
        if before and _joins(before, transition):
            result[-1].append(index)
        else:
            result.append([index])
    together: list[list[int]] = result[:1]
    for chapter in result[1:]:
        both = [*together[-1], *chapter]
        if _tied([show.transitions[k] for k in both], len(together[-1])):
            together[-1] = both
        else:
            together.append(chapter)
    return together


def _tied(both: Sequence[Transition], first: int) -> bool:
    """Tell whether a group leaves the ``first`` of two chapters' transitions in motion.

    Only where one of them has times of its own, and the script says of all when they
    fly.
    """
    parts = both[:first], both[first:]
    return (
        None not in {one.group for one in both}
        and all(one.timed for one in both)
        and left_moving(parts[0])
        and any(own_times(part) for part in parts)
    )


def left_last(together: Sequence[Transition]) -> list[Transition]:
    """Return the last transition of each group of a chapter."""
    return [together[lane[-1]] for lane in lanes(together)]


def _joins(before: Sequence[Transition], one: Transition) -> bool:
    """Tell whether a transition is flown together with those before it."""
    if one.group is None or before[0].group is None:
        return False
    again = any(other.group == one.group for other in before)
    leaves, ends = departure(one), [arrival(other) for other in before]
    starts = leaves if leaves is not None else arrival(one)
    if starts is None or None in ends:
        return not again
    return (leaves is None and not again) or any(
        starts < end + other.hold - _SAME
        for other, end in zip(before, ends, strict=True)
        if end is not None and other.group != one.group
    )


def own_times(together: Sequence[Transition]) -> bool:
    """Tell whether transitions of a chapter are flown in different times.

    So they are where two of them depart or arrive, by the script, at different times.
    """
    for time in (departure, arrival):
        fixed = [found for one in together if (found := time(one)) is not None]
        if fixed and max(fixed) - min(fixed) > _SAME:
            return True
    return len({one.group for one in together}) < len(together)


def common(together: Sequence[Transition]) -> float | None:
    """How long transitions that are flown in one time take, if the script says [s].

    From the departure of any to the arrival of any, or the longest that is written.
    """
    departs, arrives = (
        next((found for one in together if (found := time(one)) is not None), None)
        for time in (departure, arrival)
    )
    if departs is not None and arrives is not None:
        return round(arrives - departs, 3)
    return max(
        (one.duration for one in together if one.duration is not None), default=None
    )


def lanes(together: Sequence[Transition]) -> Iterator[list[int]]:
    """Yield, for each group of a chapter, positions of its transitions, in order."""
    for group in dict.fromkeys(one.group for one in together):
        yield [at for at, one in enumerate(together) if one.group == group]


def ending(together: Sequence[Transition]) -> float:
    """Show time at which all groups of a chapter of own times stand for good [s].

    Each has arrived, and what its formation does while it is held is over. Where a
    motion is left under way at the end, all others have been held by then: it lasts
    until then, or until what follows leaves. So it is where an arrival is not known,
    and then this is a lower bound.
    """
    whole = left_moving(together) or not known(together)
    return round(
        max(
            (arrival(one) or 0.0) + one.hold * (whole or bool(one.motion))
            for one in together
        ),
        3,
    )


def known(together: Sequence[Transition]) -> bool:
    """Tell whether the script fixes when transitions of own times arrive.

    The others take the time that they prefer, from their start, or from when their
    group is free.
    """
    return None not in [arrival(one) for one in together]


def left_moving(together: Sequence[Transition]) -> bool:
    """Tell whether a group leaves the last motion of a chapter under way."""
    return any(one.under_way[1] for one in left_last(together))


def rest(together: Sequence[Transition]) -> float:
    """How long a chapter of own times is held after its groups stand, at least [s].

    Until each group has been held for as long as its last transition asks.
    """
    held = max((arrival(one) or 0.0) + one.hold for one in left_last(together))
    return max(0.0, round(held - ending(together), 3))


def over(together: Sequence[Transition]) -> float:
    """Show time until which a chapter of own times is held at least [s]."""
    return round(ending(together) + rest(together), 3)


def least_rest(show: Show, index: int) -> float:
    """How long what a transition reaches is held after its chapter at least [s]."""
    members = next(found for found in chapters(show) if index in found)
    together = [show.transitions[one] for one in members]
    return rest(together) if own_times(together) else max(one.hold for one in together)
