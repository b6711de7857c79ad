"""Groups that move at times of their own, side by side within one leg of the log.

The moves of a group, one after the other, are a lane. The log says when each of them is
flown, and what a group does while it is held in motion after it. That is held against
the script, and against what is flown.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.script.lanes import lanes
from showc.verify.kernel.choreography import AT_REST, JOINT, MOMENT, turn
from showc.verify.kernel.dynamics import STILL
from showc.verify.samples import flown
from showc.verify.specification.motion import astray, standing

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.script.moving import MovingPlaces
    from showc.script.show import Show, Transition
    from showc.verify.kernel.show import LoggedShow, Segment

ON_TIME = 0.01
"""How far an arrival or a departure may be off the time that the script asks for [s]:
a quarter of a frame of film."""


class StrayError(Exception):
    """The legs of the log are not the script's; what follows cannot be known."""


@dataclass(slots=True)
class Flight:
    """When a group moves, at show times [s]."""

    begin: float
    end: float
    until: float = 0.0
    """When what its formation does while it is held is over; 0: it does nothing."""


class Lanes:
    """The lanes of one leg: its ``transitions``, by their groups."""

    def __init__(
        self,
        show: Show,
        logged: LoggedShow,
        segment: Segment,
        transitions: Sequence[Transition],
    ) -> None:
        self.show, self.logged, self.segment = show, logged, segment
        self.claims: list[Segment] = []
        """What groups fly in their moves, with what the log claims of each."""
        self.unproved: list[str] = []
        """Moves of which something is claimed that is not proved."""
        self.times: list[str] = []
        """Moves that are not flown when the log claims it."""
        said = list(segment.message.moves)
        asked = []
        for one in transitions:
            asked.append((one.name, one.group, one.to, pb.Segment.TRANSITION))
            held = f"hold after {one.name}", one.group, one.to, pb.Segment.MOTION
            asked += [held] * bool(one.motion)
        if [(one.name, one.group, one.to_formation, one.kind) for one in said] != asked:
            raise StrayError(f"moves of “{segment.message.name}” are not the script's")
        both = [[said.pop(0) for _ in (0, *one.motion[:1])] for one in transitions]
        self.flights = [Flight(m.start, m.start + m.duration) for m, *_ in both]
        """When each transition is flown."""
        for lane in lanes(transitions):
            members = np.array(show.groups[str(transitions[lane[0]].group)])
            self._follow([(transitions[at], self.flights[at], both[at]) for at in lane])
            for claim in (claim for at in lane for claim in both[at]):
                self._claim(members, claim)
            mine, own = [both[at][0] for at in lane], [self.flights[at] for at in lane]
            self.times += self._unlike(members, mine, own)

    def _follow(self, lane: list[tuple[Transition, Flight, list[pb.Move]]]) -> None:
        """Check that the moves of a lane follow each other, with their holds."""
        free, ends = self.segment.start, self.segment.end
        following = [*(flight.begin for _, flight, _ in lane[1:]), None]
        for (one, flight, (_, *held)), after in zip(lane, following, strict=True):
            time = flight.end - flight.begin
            if not free - MOMENT <= flight.begin < flight.end <= ends + MOMENT:
                raise StrayError(f"“{one.name}” is flown while its group is held")
            if abs((one.duration or time) - time) > ON_TIME:
                raise StrayError(f"“{one.name}” takes {time:.3f} s")
            free = flight.end + one.hold
            # What is held in motion moves until its group leaves, if it does.
            for claim in held:
                flight.until = after or (max(free, ends) if one.under_way[1] else free)
                wanted = flight.end, flight.until - flight.end
                off = np.abs(np.subtract(wanted, (claim.start, claim.duration)))
                if not max(*off, flight.until - ends) <= MOMENT:
                    raise StrayError(f"“{claim.name}” is not as long as its hold")

    def _claim(self, drones: IntArray, claim: pb.Move) -> None:
        """Take what is claimed of a group's move, for the proof of its bound."""
        end = claim.start + claim.duration
        part = _during(self.segment, drones, claim.start, end)
        # What comes near it is a matter of the whole leg: a move claims no encounter.
        if part is None or claim.certificate.HasField("closest"):
            self.unproved.append(f"“{claim.name}”: more is claimed than a bound")
            return
        part.message.certificate.CopyFrom(claim.certificate)
        part.message.name = claim.name
        self.claims.append(replace(part, goals=part.ends()[1][:, :3]))

    def waits(self, drones: IntArray) -> BoolArray:
        """Whether drones (n,) hover, on each of their mesh intervals in the leg."""
        state = self.segment.table.state[np.isin(self.segment.table.owner, drones)]
        moved = np.ptp(state[:, :, :3], axis=1).max(axis=1)
        off = np.abs(state[:, :, AT_REST]).max(axis=(1, 2))
        turned = turn(state[:, :, 8] - self.logged.rules.heading).max(axis=1)
        return np.asarray((moved <= STILL) & (np.maximum(off, turned) <= JOINT))

    def at(self, drones: IntArray, time: float) -> FloatArray:
        """States of drones (n,) at a show time [s], shape (n, 12) (SI)."""
        return flown(self.logged, np.array([time]))[:12, 0, drones].T

    def astray(
        self, moving: MovingPlaces, parked: IntArray, flight: Flight, name: str
    ) -> list[str]:
        """Say what a group does otherwise while it holds its formation in motion."""
        members = np.union1d(moving.rows, parked)
        part = _during(self.segment, members, flight.end, flight.until)
        if part is None:
            return [f"“{name}”: a polynomial runs across an end of its motion"]
        part.message.name = name
        still = standing(parked, self.at(parked, flight.end)[:, :3])
        return astray(part, [moving, still])

    def _unlike(
        self, drones: IntArray, claims: list[pb.Move], flights: list[Flight]
    ) -> Iterator[str]:
        """Yield moves of a group that do not begin and end when the log claims it.

        At all other times its drones hover in one place, or are held in motion.
        """
        segment = self.segment
        starts = np.array([flight.begin for flight in flights])
        first, last = np.full(len(claims), np.inf), np.full(len(claims), -np.inf)
        mine = np.isin(segment.table.owner, drones)
        mine[mine] = ~self.waits(drones)
        begin = segment.start + segment.table.start[mine]
        end = segment.start + segment.table.end[mine]
        for one in flights:
            moved = ~((begin >= one.end - MOMENT) & (end <= one.until + MOMENT))
            begin, end = begin[moved], end[moved]
        which = np.maximum(np.searchsorted(starts, 0.5 * (begin + end)) - 1, 0)
        np.minimum.at(first, which, begin)
        np.maximum.at(last, which, end)
        for claim, begins, ends in zip(claims, first, last, strict=True):
            wrong = begins - claim.start, ends - claim.start - claim.duration
            off = np.abs(wrong).max()
            if np.isfinite(begins) and not off <= MOMENT:
                yield (
                    f"“{claim.name}” is flown from {begins:.3f} s to {ends:.3f} s, the "
                    f"log says from {claim.start:.3f} s, for {claim.duration:.3f} s"
                )


def _during(
    segment: Segment, drones: IntArray, begin: float, end: float
) -> Segment | None:
    """Return what drones (n,) fly of a segment between two show times [s].

    None if a polynomial runs across one of them.
    """
    message = type(segment.message)()
    message.CopyFrom(segment.message)
    message.start, message.duration, table = begin, end - begin, segment.table
    first, last = begin - segment.start, end - segment.start
    within = (table.end > first + MOMENT) & (table.start < last - MOMENT)
    within &= np.isin(table.owner, drones)
    whole = (table.start >= first - MOMENT) & (table.end <= last + MOMENT)
    if (within & ~whole).any():
        return None
    table = table.chosen(within)
    table = replace(table, start=table.start - first, end=table.end - first)
    return replace(segment, message=message, table=table)
