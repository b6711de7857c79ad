"""The moves of a log, one after the other: what missions visit, show and hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from showc.log import showc_pb2 as pb
from showc.script.lanes import chapters, least_rest, own_times
from showc.verify.specification.motion import reached

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.script.show import Show
    from showc.verify.kernel.show import LoggedShow, Segment


class Move(NamedTuple):
    """One move of the log, of the whole fleet or of a group at a time of its own."""

    segment: int
    """Index of its segment."""
    name: str
    start: float
    """Show time [s]."""
    duration: float
    """[s]"""
    drones: IntArray
    """Which drones fly it, increasing, shape (n,)."""
    goals: FloatArray
    """Where they are when it has ended, shape (n, 3) [m]."""
    held: float
    """For how long they are held there before they fly on [s]."""


def moves(show: LoggedShow, script: Show) -> list[Move]:
    """Return the moves of a log in order; of groups side by side by their starts.

    A hold before moves that have times of their own is as long as they leave: of it
    missions keep what the script asks for at least.
    """
    told, found = iter(chapters(script)), list[Move]()
    members: list[int] = []
    for one in show.segments:
        if one.holds:
            last = [move for move in found if move.segment == found[-1].segment]
            if len(last) == 1:
                found[-1] = last[0]._replace(held=last[0].held + one.duration)
            continue
        before, flown = members, one.message.kind == pb.Segment.TRANSITION
        members = next(told, []) if flown else []
        if before and any(script.transitions[index].timed for index in members):
            least = least_rest(script, before[0])
            found[-1] = found[-1]._replace(held=min(found[-1].held, least))
        found += sorted(_moves(one, members, script), key=lambda move: move.start)
    return found


def _moves(one: Segment, members: list[int], script: Show) -> Iterator[Move]:
    """Yield the moves of a segment, of which the script's transitions are members."""
    said = one.message
    if not own_times([script.transitions[index] for index in members]):
        everyone, goals = np.arange(len(one.goals)), one.ends()[1][:, :3]
        yield Move(said.index, said.name, one.start, one.duration, everyone, goals, 0.0)
    for claim, index in zip(said.moves, members, strict=False):
        drones = np.array(script.groups.get(claim.group, ()), dtype=np.int64)
        goals = reached(one, drones, claim.start + claim.duration)
        held = script.transitions[index].hold
        yield Move(
            said.index, claim.name, claim.start, claim.duration, drones, goals, held
        )
