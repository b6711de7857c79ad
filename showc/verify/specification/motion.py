"""Groups with times of their own, and formations that move while they are held.

The moves of a group within one leg of the log, one after the other, are a lane. The log
says when each of them is flown, and when its formation moves after it. That is held
against the script, and against what is flown: in a motion every drone is where the
script has it, at every instant.

What a script means by a motion is said by :mod:`showc.script.moving`, as the places of
formations are by its generators: where each drone is at any time, with derivatives.

**Bound.** Let e be what is logged less what is asked, |e''| <= A. Between two instants
at a distance of h, ends of polynomials among them, |e| is at most the greater of its
values there, plus A h^2 / 8 (the error of linear interpolation, in the direction of e).
A is the greatest second difference of the logged polynomials plus
:meth:`MovingPlaces.greatest_acceleration`. So a few instants prove all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from showc.log import showc_pb2 as pb
from showc.script.lanes import lanes
from showc.script.moving import MovingPlaces
from showc.verify.kernel.choreography import AT_REST, JOINT, MOMENT, turn
from showc.verify.kernel.dynamics import STILL
from showc.verify.samples import evaluate, flown

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.script.show import Transition
    from showc.verify.kernel.show import LoggedShow, PieceTable, Segment

ON_TIME = 0.01
"""How far an arrival or a departure may be off the time that the script asks for [s]:
a quarter of a frame of film."""

FOLLOWED = 1e-3
"""Greatest distance from the place that the motion asks for, at any instant [m]: as
near as a place of a formation must be reached."""

JOINED = np.array([1e-5, 1e-4, 1e-2])
"""How far velocity [m/s], acceleration [m/s²] and jerk [m/s³] at an end of a motion may
be from those asked for: of these a hover is left with 0.001 deg and 0.06 deg/s."""

_REST = 8e-4
"""Share of it that is left to what happens between two instants [m]."""
_MOST = 500_000_000  # places at instants, by each motion: beyond, a look gives up
_ROWS, _AT_ONCE = 1_000, 2_000
"""Polynomials, and instants of them, that are looked at together; bounds the memory."""


def standing(rows: IntArray, places: FloatArray) -> MovingPlaces:
    """Return drones (n,) that stay at their places (n, 3) [m]."""
    return MovingPlaces(rows, places, (), np.zeros(3), ())


def astray(
    segment: Segment,
    parts: Sequence[MovingPlaces],
    span: tuple[float, float],
    name: str,
) -> list[str]:
    """Say how far the worst drone may be from where a motion wants it, if too far.

    Else say it of velocity, acceleration and jerk when the motion, called ``name``,
    begins and ends: that is ``span``, show times of the segment [s]. Attitude and body
    rates follow from these, and pass the joints without a jump, by the kernel.
    """
    part = during(segment, np.concatenate([one.rows for one in parts]), *span)
    if part is None:
        return [f"“{name}”: a polynomial runs across an end of its motion"]
    far, slip = np.zeros((2, len(segment.goals)))
    for one in parts:
        order, table = np.argsort(one.rows), part.table
        asked = one.greatest_acceleration(part.duration)
        for some in table.chosen(np.isin(table.owner, one.rows)).parts(_ROWS):
            row = order[np.searchsorted(one.rows, some.drones, sorter=order)]
            # Frames of one place are those of all.
            own = (each if each.shape[1] == 1 else each[:, row] for each in one.frames)
            mine = replace(one, rows=row, places=one.places[row], frames=tuple(own))
            found = _strayed(some, mine, part.duration, asked)
            far[some.drones], slip[some.drones] = found
    worst, other = int(np.argmax(far)), int(np.argmax(slip))
    said = ""
    if not far[worst] <= FOLLOWED:
        said = f"drone {worst + 1} may be {far[worst]:.6f} m off; {FOLLOWED:g} allowed"
    elif not slip[other] <= 1.0:
        said = f"drone {other + 1} turns, or begins or ends in another state"
        said += f": {slip[other]:.3g} times what is allowed"
    return [f"“{name}”: {said}"] if said else []


def _strayed(
    some: PieceTable, mine: MovingPlaces, duration: float, asked: float
) -> tuple[FloatArray, FloatArray]:
    """How far drones may be from where they are to be (n,) [m], and states at the ends.

    These (n,) over what is allowed. ``asked`` bounds what the motion has as
    acceleration [m/s²].
    """
    position = some.state[:, :, :3]
    slopes = [position]
    for _ in JOINED:
        slopes.append(some.slope(slopes[-1]))
    ends = np.stack(mine.ends(duration), axis=1)[1:]
    first, last = some.first[:-1], some.first[1:] - 1
    logged = np.stack([[one[first, 0], one[last, -1]] for one in slopes[1:]])
    missed = (np.abs(logged - ends).max(axis=(1, 3)).T / JOINED).max(axis=1)
    if not mine.frames:  # drones that stay where they are do not turn
        begun = np.repeat(some.state[first, :1, 8], np.diff(some.first), 0)
        yaw = np.abs(some.state[:, :, 8] - begun).max(axis=1)
        turned = np.maximum.reduceat(yaw, first)
        missed = np.maximum(missed, turned / JOINT)
    # The greatest second difference of the logged positions.
    bends = np.linalg.norm(slopes[2], axis=2).max(axis=1)
    bends = asked + np.maximum.reduceat(bends, first)
    step = np.sqrt(8.0 * _REST / max(bends.max(), 1e-9))
    count = max(2, ceil(duration / min(step, duration)) + 1)
    if count * bends.size * (1 + len(mine.motions)) > _MOST:
        return np.where(bends == bends.max(), np.inf, 0.0), missed
    alone = replace(some, state=position, control=some.control[:, :, :0])
    far = np.zeros(bends.size)
    # Where two polynomials meet, velocities may differ.
    breaks = np.clip([*some.start, *some.end], 0.0, duration)
    times = np.union1d(np.linspace(0.0, duration, count), breaks)
    for at in np.array_split(times, ceil(times.size / _AT_ONCE)):
        off = evaluate(alone, at) - mine.positions(duration, at)
        far = np.maximum(far, np.linalg.norm(off, axis=2).max(axis=0))
    return far + bends * (duration / (count - 1)) ** 2 / 8.0, missed


def during(
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
    table = table if within.all() else table.chosen(within)
    table = replace(table, start=table.start - first, end=table.end - first)
    return replace(segment, message=message, table=table)


def hovers(state: FloatArray, heading: float) -> BoolArray:
    """Whether drones hover on mesh intervals, from coefficients (n, degree + 1, 12)."""
    moved = np.ptp(state[:, :, :3], axis=1).max(axis=1)
    off = np.abs(state[:, :, AT_REST]).max(axis=(1, 2))
    turned = turn(state[:, :, 8] - heading).max(axis=1)
    return np.asarray((moved <= STILL) & (np.maximum(off, turned) <= JOINT))


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
        logged: LoggedShow,
        segment: Segment,
        transitions: Sequence[Transition],
        groups: Mapping[str, Sequence[int]],
    ) -> None:
        self.logged, self.segment = logged, segment
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
            members = np.array(groups[str(transitions[lane[0]].group)])
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
        part = during(self.segment, drones, claim.start, end)
        # What comes near it is a matter of the whole leg: a move claims no encounter.
        if part is None or claim.certificate.HasField("closest"):
            self.unproved.append(f"“{claim.name}”: more is claimed than a bound")
            return
        part.message.certificate.CopyFrom(claim.certificate)
        part.message.name = claim.name
        self.claims.append(replace(part, goals=part.ends()[1][:, :3]))

    def waits(self, drones: IntArray) -> BoolArray:
        """Whether drones (n,) hover, on each of their mesh intervals in the leg."""
        own = np.isin(self.segment.table.owner, drones)
        return hovers(self.segment.table.state[own], self.logged.rules.heading)

    def at(self, drones: IntArray, time: float) -> FloatArray:
        """States of drones (n,) at a show time [s], shape (n, 12) (SI)."""
        return flown(self.logged, np.array([time]))[0, drones, :12]

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
                said = f"from {claim.start:.3f} s, for {claim.duration:.3f} s"
                flies = f"is flown from {begins:.3f} s to {ends:.3f} s"
                yield f"“{claim.name}” {flies}, the log says {said}"
