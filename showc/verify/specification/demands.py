"""What the script asks of a flight: its rules, its legs, its places and its light.

The legs of the log are walked through in their order, and each is held against the next
one that the script asks for. Where the script leaves a choice (which drone takes which
place, how long a move takes), the choice of the log is checked for being admissible,
and what follows is derived from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.documents.values import unlike
from showc.light.keyframes import PARKED, Lit, keyframes_of
from showc.light.program import LaneMove, LightProgram, LightSpan, lane_spans, shown
from showc.log import showc_pb2 as pb
from showc.log.facts import rules_of
from showc.script.lanes import arrival, chapters, common, cue, departure, own_times
from showc.script.moving import MovingPlaces, moving_places
from showc.verify.kernel.choreography import AT_REST, JOINT, MOMENT, REACHED
from showc.verify.kernel.slices import near_pairs
from showc.verify.report import Check, agreement
from showc.verify.specification import motion
from showc.verify.specification.cover import differences

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.script.show import Show, Transition
    from showc.vehicle import Limits
    from showc.verify.kernel.show import LoggedShow, Segment

PLACE_ERROR = 1e-9  # how far a goal may be off its place: rounding, not flight [m]


@dataclass(slots=True, eq=False)
class Move:
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
    held: float = 0.0
    """For how long they are held there before they fly on, at least [s]."""
    cue: tuple[float, bool] | None = None
    """Show time that the script gives it [s], and whether it is the arrival's."""


@dataclass(slots=True)
class Demands:
    """What was found: differences in words, and what a viewer must show."""

    rules: list[str] = field(default_factory=list)
    """Differences of the rules."""
    legs: list[str] = field(default_factory=list)
    """Legs that the script does not ask for so."""
    places: list[str] = field(default_factory=list)
    """Goals that are not admissible."""
    times: list[str] = field(default_factory=list)
    """Arrivals and departures at other times than the script asks for."""
    motions: list[Callable[[], list[str]]] = field(default_factory=list)
    """Looks at formations in motion, to be made side by side: each says what does not
    move as it should."""
    lights: LightProgram | None = None
    """Light of the fleet; None if the legs are not those of the script."""
    claims: list[Segment] = field(default_factory=list)
    """Moves of groups with what the log claims of them, for a proof of their bounds."""
    moves: list[Move] = field(default_factory=list)
    """Moves in order, of groups side by side by their starts: what missions fly."""

    def checks(self, motions: Iterable[list[str]]) -> list[Check]:
        """Return what was found as checks, and what the looks at ``motions`` said."""
        codes = "VRF203", "VRF204", "VRF205", "VRF206", "VRF207"
        found = self.rules, self.legs, self.places, self.times, chain(*motions)
        return [agreement(*one) for one in zip(codes, found, strict=True)]


def hold_against(show: Show, logged: LoggedShow) -> Demands:
    """Compare the rules and legs that a log claims with what its script asks for."""
    demands = Demands()
    if logged.drones != show.drones:
        text = f"drones: the log has {logged.drones}, the script asks for {show.drones}"
        demands.rules.append(text)
        demands.legs.append("not looked at: the size of the fleet differs")
        return demands
    walk = _Walk(show, logged, demands)
    try:
        walk.run()
    except motion.StrayError as stray:
        demands.legs.append(str(stray))
    else:
        demands.lights = LightProgram(show.drones, logged.duration, tuple(walk.spans))
    # Of legs that went astray, the formations and limits so far.
    wanted = rules_of(show, walk.formations, walk.limits, logged.duration)
    demands.rules += differences(logged.rules, wanted)
    return demands


class _Walk:
    """Goes through the legs of the log with the script beside it."""

    def __init__(self, show: Show, logged: LoggedShow, demands: Demands) -> None:
        self.show, self.logged, self.demands = show, logged, demands
        self.next, self.end = 0, 0.0
        self.at = show.pads
        self.fleet = self.places = np.arange(show.drones)
        self.pads = np.array(show.formations[show.pads].points[: show.drones])
        self.position = self.before = self.pads
        """Goals of the last leg, and of the one before it."""
        self.dark, self.colours, self.lit = np.zeros((3, show.drones, 3))
        self.parking = np.full(show.drones, PARKED)
        self.formations = {name: one.points for name, one in show.formations.items()}
        self.limits: list[Limits] = []
        self.spans: list[LightSpan] = []
        self.placed: list[LaneMove] = []
        self.grows: Iterator[bool] = iter(())
        """Whether each hold, in order, lasts until a given time."""
        self.carried = 0
        # Whether drones leave out of a motion, and do not hover.
        self.leaving = False
        self.numbers = np.arange(show.drones)
        """Place of each drone in the formation that it last flew to."""

    def run(self) -> None:
        """Go from the pads to the pads."""
        show = self.show
        launch, landing = show.launch, show.landing
        up = self._raised(f"above {show.pads}", launch.altitude)
        climb = show.limits.upright(launch.climb_speed)
        segment = self._leg("launch", "launch", up, limits=climb)
        self._expect(segment, self.formations[up], self.fleet)
        self._shine(segment, self.dark)
        parts = [[show.transitions[k] for k in chapter] for chapter in chapters(show)]
        timed = [any(one.timed for one in part) for part in parts]
        self.grows = iter([*timed, False, False])
        self._shine(self._hold("launch", launch.hold), self.lit)
        for part in parts:
            self._chapter(part)
        self._approach(self._raised(f"above {show.pads} to land", landing.altitude))
        self._shine(self._hold("reaching the pads", landing.hold), self.lit)
        sink = show.limits.upright(landing.descent_speed)
        segment = self._leg("land", "land", show.pads, limits=sink)
        # Straight down: the pad below.
        below = self.before - np.array([0.0, 0.0, landing.altitude])
        self._expect(segment, below, _one_to_one(segment.goals, self.pads))
        self._shine(segment, self.dark)
        if self.next != len(self.logged.segments):
            self.demands.legs.append("legs follow the landing")

    def _raised(self, name: str, height: float) -> str:
        name = self._unused(name)
        self.formations[name] = self.pads + np.array([0.0, 0.0, height])
        return name

    def _unused(self, name: str) -> str:
        """Name of a formation that the script does not define; a number tells twins."""
        names = [name, *(f"{name} ({n + 2})" for n in range(len(self.formations)))]
        return next(one for one in names if one not in self.formations)

    def _approach(self, over: str) -> None:
        """To above the pads, unless every drone is there already."""
        points = self.formations[over]
        fixed = self.show.landing.assignment == "fixed"
        match = _one_to_one(self.position, points)
        there = np.array_equal(self.position, points) if fixed else match is not None
        if there and not self.leaving:
            return
        segment = self._leg("approach", "approach to the pads", over)
        own = self.fleet if fixed else _one_to_one(segment.goals, points)
        self._expect(segment, points if own is None else points[own], own)
        self._shine(segment, self.dark)

    def _chapter(self, transitions: Sequence[Transition]) -> None:
        """One transition of the fleet, or several of groups at once, and the hold."""
        show, first, own = self.show, transitions[0], own_times(transitions)
        name, to = " + ".join(one.name for one in transitions), first.to
        if first.group is not None:
            last = {one.group: one.to for one in transitions}
            to = self._unused(" + ".join(f"{group} in {last[group]}" for group in last))
        elif first.under_way[0]:
            to = self._unused(f"{to} in motion")
        duration = None if own else common(transitions)
        count = sum(1 + bool(one.motion) for one in transitions) if own else 0
        segment = self._leg("transition", name, to, duration=duration, moves=count)
        flights = [motion.Flight(segment.start, segment.end) for _ in transitions]
        if own:
            lanes = motion.Lanes(self.logged, segment, transitions, show.groups)
            self.lanes, flights = lanes, lanes.flights
            self.demands.claims += lanes.claims
            self.demands.legs += lanes.unproved
            self.demands.times += lanes.times
        elif any(one.timed or one.duration for one in transitions):
            flies = ~motion.hovers(segment.table.state, show.heading)
            idle = segment.duration - segment.table.end[flies].max(initial=0.0)
            # In a given time it may begin with a wait.
            if not any(t.at or t.duration or t.prefer != "time" for t in transitions):
                idle = max(idle, segment.table.start[flies].min(initial=np.inf))
            if flies.any() and idle > motion.ON_TIME:
                text = f"“{name}”: no drone flies for {idle:.3f} s at an end of it"
                self.demands.times.append(text)
        self._place(segment, transitions, flights)
        places = self.fleet if first.group is not None else self.placed[0].places
        if to not in self.formations:
            goals = segment.goals if first.group is not None else self._met(first)
            self.formations[to] = goals
        self._expect(segment, segment.goals, places)
        if own:
            over = max(one.end + one.transition.hold for one in self.placed)
            held = self._hold(name, round(over - segment.end, 3)) or segment
            window = segment.start, held.end
            for span in lane_spans(show, self.placed, self.lit, window):
                self.spans.append(span)
                self.lit[span.drones] = span.linear(np.array([span.duration]))[0]
            return
        self.demands.moves[-1].cue = cue(transitions)
        self._shine(segment, self.colours, self.placed)
        hold = max(one.hold for one in transitions)
        moving = [self._moving(one) for one in self.placed if one.transition.motion]
        self._shine(self._hold(name, hold, moving), self.lit, self.placed)

    def _place(
        self,
        segment: Segment,
        transitions: Sequence[Transition],
        flights: list[motion.Flight],
    ) -> None:
        """Check times and goals of the fleet, or of groups; others stay where they are.

        Where a group moves on in the leg, its goal is where it is at the end of a move.
        """
        apart, final = own_times(transitions), {one.group: one for one in transitions}
        others, resting = np.ones((2, self.show.drones), dtype=bool)
        colours = self.colours.copy()
        self.placed, moved = [], []
        for transition, flight in zip(transitions, flights, strict=True):
            group, last = transition.group, transition is final[transition.group]
            members = np.array(self.fleet if group is None else self.show.groups[group])
            self._on_time(transition, flight)
            others[members] = False
            self.parking[members] = PARKED
            goals, error = segment.goals[members], PLACE_ERROR
            if flight.until or not last:
                goals, error = self.lanes.at(members, flight.end)[:, :3], REACHED
            places = self._given(segment, transition, members, goals, error)
            one = LaneMove(transition, members, places, flight.begin, flight.end)
            self.placed.append(one)
            times = flight.begin, flight.end - flight.begin
            own = segment.message.index, transition.name, *times, members, goals
            moved.append(Move(*own, transition.hold, cue([transition])))
            if flight.until:
                self._moved(segment, one, flight, last=last)
                resting[members] = not (last and transition.under_way[1])
            formation = self.show.formations[transition.to]
            colours[members] = shown(transition, formation, places)
        stay = _near(segment.goals[others], self.before[others])
        # Groups that keep times of their own fly round all others.
        if apart:
            stay &= bool(self.lanes.waits(self.fleet[others]).all())
        if not stay:
            self._wrong(segment, "drones of no group do not stay where they are")
        self.colours = colours
        self.leaving = not resting.all()
        if apart:
            self.demands.moves += sorted(moved, key=lambda move: move.start)
            if (np.abs(segment.ends()[1][resting][:, AT_REST]) > JOINT).any():
                self._wrong(segment, "drones that are not left in motion do not rest")

    def _on_time(self, one: Transition, flight: motion.Flight) -> None:
        """Hold the times of a move against those that the script asks for."""
        starts = departure(one), flight.begin, "starts"
        for asked, taken, what in (starts, (arrival(one), flight.end, "arrives")):
            if asked is not None and not abs(taken - asked) <= motion.ON_TIME:
                text = f"“{one.name}” {what} at {taken:.3f} s, the script asks for "
                self.demands.times.append(f"{text}{asked:.3f} s")

    def _moved(
        self, segment: Segment, one: LaneMove, flight: motion.Flight, *, last: bool
    ) -> None:
        """Look at what a group does while it holds its formation in motion."""
        moving, parked = self._moving(one), one.drones[one.places < 0]
        still = motion.standing(parked, self.lanes.at(parked, flight.end)[:, :3])
        span, name = (flight.end, flight.until), one.transition.name
        look = partial(motion.astray, segment, [moving, still], span, name)
        self.demands.motions.append(look)
        goal, goals = moving.ends(flight.until - flight.end)[1][0], segment.goals
        near = _near(goals[moving.rows], goal)
        if last and not (near and _near(goals[parked], still.places, REACHED)):
            self._wrong(segment, "goals are not where a motion ends")

    def _met(self, transition: Transition) -> FloatArray:
        """Places of a formation when drones arrive, its motion perhaps under way."""
        points = self.show.formations[transition.to].points
        if not transition.under_way[0]:
            return points
        every = np.arange(len(points))
        # Where it is at the start does not depend on how long it is held.
        whole = self._moving(LaneMove(transition, every, every, 0.0, 0.0))
        return np.asarray(whole.ends(1.0)[0][0])

    def _moving(self, one: LaneMove) -> MovingPlaces:
        """Return how drones, each at its place of a formation, are to move with it."""
        given, every = one.places >= 0, self.show.formations
        rows = one.drones[given], one.places[given]
        return moving_places(*rows, every[one.transition.to], one.transition, every)

    def _given(
        self,
        segment: Segment,
        transition: Transition,
        members: IntArray,
        goals: FloatArray,
        error: float,
    ) -> IntArray:
        """Find the place of each member by its goal; those parked have none."""
        points, parking = self._met(transition), self.show.parking
        allowed, free = points, np.empty(0, dtype=np.int64)
        if members.size > len(points) and parking is not None:
            spots = self.show.formations[parking].points
            free = np.setdiff1d(np.arange(len(spots)), self.parking)
            allowed = np.concatenate([points, spots[free]])
        places: IntArray | None = np.arange(members.size)
        wrong = "drones are not at the places of their numbers"
        if transition.assignment == "keep":
            places = self.numbers[members]
        elif transition.assignment != "fixed":
            places = _one_to_one(goals, allowed, error)
            wrong = "a goal is no place, or a place is taken twice, or left empty"
        if (
            places is None
            or places.max() >= len(allowed)
            or not _near(goals, allowed[places], error)
            or sorted(places[places < len(points)]) != list(range(len(points)))
        ):
            self._wrong(segment, wrong)
            places = np.minimum(np.arange(members.size), len(allowed) - 1)
        outside = places >= len(points)
        self.parking[members[outside]] = free[places[outside] - len(points)]
        given = np.where(outside, PARKED, places)
        self.numbers[members] = given
        return given

    def _leg(
        self,
        kind: str,
        name: str,
        to: str,
        *,
        limits: Limits | None = None,
        duration: float | None = None,
        least: float = 0.0,
        moves: int = 0,
    ) -> Segment:
        """Take the next leg of the log, which must be the one asked for.

        It lasts ``duration`` [s], or ``least`` or more if that is None; ``moves``
        groups have times of their own in it.
        """
        if self.next >= len(self.logged.segments):
            raise motion.StrayError(f"the log lacks the leg “{name}”")
        segment = self.logged.segments[self.next]
        message = segment.message
        limits = limits or self.show.limits
        if limits not in self.limits:
            self.limits.append(limits)
        if message.kind != pb.Segment.Kind.Value(kind.upper()) or message.name != name:
            text = f"leg {self.next + 1} is “{message.name}”, the script asks for"
            raise motion.StrayError(f"{text} “{name}”")
        facts: list[tuple[str, Any, Any]] = [
            ("from", message.from_formation, self.at),
            ("to", message.to_formation, to),
            ("limits", message.limits, self.limits.index(limits)),
            ("start", segment.start, round(self.end, 3)),
            ("moves of groups", len(message.moves), moves),
        ]
        if duration is not None:
            facts.append(("duration", segment.duration, round(duration, 3)))
        elif segment.duration < round(least, 3) - MOMENT:
            text = f"“{name}” lasts {segment.duration!r} s, the script asks for "
            self.demands.legs.append(f"{text}{least!r} s or more")
        for key, found, wanted in facts:
            self.demands.legs += unlike(found, wanted, f"“{name}”: {key}")
        if not (moves or kind in {"hold", "motion"}):
            own = message.index, name, segment.start, segment.duration
            self.demands.moves.append(Move(*own, self.fleet, segment.goals))
        self.next += 1
        self.end, self.leaving = segment.end, False
        self.before, self.position, self.at = self.position, segment.goals, to
        return segment

    def _hold(
        self, name: str, least: float, moving: Sequence[MovingPlaces] = ()
    ) -> Segment | None:
        """Take a hold, during which drones may move: look at where they are.

        It may last longer if it grows towards a given time.
        """
        kind, title = "motion" if moving else "hold", f"hold after {name}"
        grows = next(self.grows)
        following = self.logged.segments[self.next : self.next + 1]
        there = any(one.message.name == title and one.holds for one in following)
        moves, last = self.demands.moves, self.demands.moves[-1]
        if not moving and least <= 0.0 and not (grows and there):
            if least < 0.0 and not grows:
                self.demands.legs.append(f"“{name}” lasts {-least:g} s too long")
            return None
        at, to, goals = self.at, self.at, self.position.copy()
        moves_on = any(one.moves_on for one in moving)
        if moves_on:
            self.carried += 1
            to = f"{self.at} after motion {self.carried}"
        asked = None if grows else least
        segment = self._leg(kind, title, to, duration=asked, least=least)
        if [one.segment for one in moves].count(last.segment) == 1:
            # Before a given time it is as long as is left: missions keep the least.
            last.held = least if grows else segment.duration
        if moves_on:
            points = np.array(self.formations[at])
            for one in moving:
                goals[one.rows] = one.ends(segment.duration)[1][0]
                points[self.places[one.rows]] = goals[one.rows]
            self.formations[to] = points
        self._expect(segment, goals, self.places)
        if moving:
            others = np.setdiff1d(self.fleet, np.concatenate([m.rows for m in moving]))
            still = motion.standing(others, self.before[others])
            span = segment.start, segment.end
            look = partial(motion.astray, segment, [*moving, still], span, title)
            self.demands.motions.append(look)
            self.leaving = any(one.under_way[1] for one in moving)
        return segment

    def _expect(
        self, segment: Segment, goals: FloatArray, places: IntArray | None
    ) -> None:
        """Hold goals and places of a leg against those wanted; None: there are none."""
        if places is None or not np.array_equal(segment.message.places, places):
            self._wrong(segment, "drones are not at the places that are theirs")
        if not _near(segment.goals, goals):
            self._wrong(segment, "goals are not where the script puts them")
        self.places = self.fleet if places is None else places

    def _shine(
        self, segment: Segment | None, end: FloatArray, flown: Sequence[LaneMove] = ()
    ) -> None:
        """Add the light of a leg, or of a hold: of what is ``flown``, and of others."""
        if segment is None:
            return
        others = np.setdiff1d(self.fleet, [d for one in flown for d in one.drones])
        for move in [*flown, *[None] * bool(others.size)]:
            drones = others if move is None else move.drones
            begin, fade, effect, keys = self.lit[drones], "linear", None, None
            if move is not None and segment.message.kind == pb.Segment.TRANSITION:
                fade = move.transition.fade
            elif move is not None:
                one, every = move.transition, np.arange(drones.size)
                effect = one.effect or self.show.formations[one.to].effect
                lit = [Lit(one.lights, every, move.places)]
                keys = keyframes_of(begin, segment.start, lit)
            span = segment.start, segment.duration, drones, begin, end[drones], fade
            self.spans.append(LightSpan(*span, effect, segment.goals[drones], keys))
            self.lit[drones] = self.spans[-1].linear(np.array([segment.duration]))[0]

    def _wrong(self, segment: Segment, text: str) -> None:
        self.demands.places.append(f"“{segment.message.name}”: {text}")


def _near(found: FloatArray, wanted: FloatArray, error: float = PLACE_ERROR) -> bool:
    return bool(np.all(np.abs(found - wanted) <= error))


def _one_to_one(
    goals: FloatArray, allowed: FloatArray, error: float = PLACE_ERROR
) -> IntArray | None:
    """Find the place of each goal; None unless each has one of its own."""
    both, many = np.concatenate([goals, allowed]), len(goals)
    # One for each goal, and hardly any more: places lie apart.
    pairs = near_pairs(both, error, 10 * len(both)) if np.isfinite(both).all() else None
    if pairs is None:
        return None
    (goal, place), off = pairs.T, np.abs(np.subtract(*both[pairs.T])).max(axis=1)
    pairs = pairs[(goal < many) & (many <= place) & (off <= error)]
    goal, place = pairs[np.argsort(pairs[:, 0])].T
    alone = np.array_equal(goal, np.arange(many)) and np.unique(place).size == many
    return place - many if alone else None
