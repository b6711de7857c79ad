"""From the show to its itinerary: launch, transitions with their holds, landing.

Transitions of groups that are flown together (:mod:`showc.script.lanes`) are one leg;
drones of no group hover. The leg has one common time, or a part for each move where
groups have times of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import PlanError
from showc.plan.assignment import Assignment, assign, in_order
from showc.plan.itinerary import (
    ANY_TIME,
    Itinerary,
    Leg,
    frozen,
    held_in_motion,
    in_parts,
    state_at,
)
from showc.plan.places import PARKED, Places
from showc.progress import Silent
from showc.script.lanes import (
    arrival,
    chapters,
    common,
    departure,
    ending,
    held_for,
    known,
    left_last,
    own_times,
    rest,
)
from showc.script.moving import moving_places
from showc.script.show import Formation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.plan.itinerary import LegKind
    from showc.plan.places import Assign
    from showc.progress import Progress
    from showc.script.mark import Mark
    from showc.script.moving import MovingPlaces
    from showc.script.show import Preference, Show, Transition
    from showc.vehicle import Limits


def build_itinerary(
    show: Show, progress: Progress | None = None, optimal: Assign = assign
) -> Itinerary:
    """Lay out all legs of ``show`` and assign drones to places.

    ``progress`` hears of each chapter; ``optimal`` assigns places where the script
    leaves that open, as :func:`assign` does, perhaps from memory.

    Raises
    ------
    PlanError
        If a formation does not have a place, or a parking place, for each drone that
        is to go there.
    """
    watcher = progress or Silent()
    flown = chapters(show)
    watcher.stage("assigning drones to places", len(flown) + 1)
    builder = _Builder(show, optimal)
    builder.launch()
    for chapter in flown:
        builder.chapter(chapter)
        watcher.advance()
    builder.land()
    watcher.advance()
    formations = {**show.formations, **builder.added}
    return Itinerary(replace(show, formations=formations), tuple(builder.legs))


@dataclass(frozen=True, slots=True)
class _Asked:
    """What the script asks of a move or a hold, see :class:`Leg`."""

    limits: Limits
    duration: float | None = None
    mark: Mark | None = None
    transition: int | None = None
    arrive: float | None = None
    depart: float | None = None
    prefer: Preference = 1.0
    motion: tuple[MovingPlaces, ...] = ()
    """Of the hold that it is, or that follows."""
    hold: float = 0.0
    """Of that hold [s]."""


class _Builder:
    """Carries where every drone is while the legs are laid out one by one."""

    def __init__(self, show: Show, optimal: Assign) -> None:
        self.show, self.optimal = show, optimal
        self.assigned = Places(show, optimal)
        self.legs: list[Leg] = []
        self.added: dict[str, Formation] = {}
        self.fleet = frozen(np.arange(show.drones))
        self.formation = show.pads
        self.places = self.fleet
        self.position = np.array(show.formations[show.pads].points[: show.drones])
        self.colours = np.zeros((show.drones, 3))
        self.placed: list[tuple[Transition, IntArray, IntArray]] = []
        self.motions = 0
        # Of drones that leave out of a motion.
        self.state: FloatArray | None = None

    def launch(self) -> None:
        """Straight up from the pads."""
        launch = self.show.launch
        above = self._raised(f"above {self.show.pads}", launch.altitude)
        limits = self.show.limits.upright(launch.climb_speed)
        given = Assignment(self.fleet, np.inf, "")
        self._move("launch", "launch", above, given, _Asked(limits))
        self._hold("launch", launch.hold)

    def chapter(self, indices: Sequence[int]) -> None:
        """One transition of the fleet, or several of groups at once, and the hold."""
        transitions = [self.show.transitions[index] for index in indices]
        parts: tuple[Leg, ...] = ()
        hold = round(max(held_for(transition) for transition in transitions), 3)
        if transitions[0].group is None:
            formation, given = self._whole_fleet(transitions[0], hold)
        else:
            formation, given, parts = self._groups(indices, hold)
        name = " + ".join(transition.name for transition in transitions)
        asked = _Asked(
            self.show.limits,
            common(transitions),
            transitions[0].mark,
            indices[0],
            next((t.at for t in transitions if t.at is not None), None),
            next((t.start for t in transitions if t.start is not None), None),
            _together([t.prefer for t in transitions]),
        )
        if own_times(transitions):
            if self.state is not None:
                mark = transitions[0].mark
                raise PlanError(
                    f"{mark}: groups that move at times of their own begin together "
                    "at rest; leave `leave: moving` out of what comes before, or give "
                    "them one time"
                )
            ends = ending(transitions)
            asked = replace(asked, duration=None, arrive=ends, depart=None)
            self._move("transition", name, formation, given, asked)
            # When it ends is known with the times of its parts.
            self.legs[-1] = in_parts(self.legs[-1], parts, self.show)
            self.state = self.legs[-1].goal_state
            self._hold(name, rest(transitions), asked)
            return
        motion = self._moving()
        joining = replace(asked, motion=motion, hold=hold)
        self._move("transition", name, formation, given, joining)
        self._hold(name, hold, asked, motion)

    def land(self) -> None:
        """To above the pads, and straight down."""
        landing = self.show.landing
        above = self._raised(f"above {self.show.pads} to land", landing.altitude)
        choose = self.optimal if landing.assignment == "optimal" else in_order
        given = choose(self.position, above.points, self.show.separation)
        if landing.assignment == "fixed":
            given = replace(given, reason="every drone to its own pad")
        # A fleet above its pads already lands from there.
        there = np.array_equal(above.points[given.places], self.position)
        if self.state is not None or not there:
            usual = _Asked(self.show.limits)
            self._move("approach", "approach to the pads", above, given, usual)
        self._hold("reaching the pads", landing.hold)
        limits = self.show.limits.upright(landing.descent_speed)
        pads = self.show.formations[self.show.pads]
        down = replace(given, reason="")
        self._move("land", "land", pads, down, _Asked(limits))

    def _raised(self, name: str, height: float) -> Formation:
        pads = self.show.formations[self.show.pads]
        points = np.array(pads.points[: self.show.drones])
        points[:, 2] += height
        colours = np.zeros_like(points)
        return self._added(name, points, colours, pads.mark)

    def _added(
        self,
        name: str,
        points: FloatArray,
        colours: FloatArray,
        mark: Mark,
    ) -> Formation:
        """Add a formation that the script does not name, under a name of its own.

        A group may be sent to one formation again while the others have moved on: each
        time all drones together stand elsewhere.
        """
        taken = self.show.formations.keys() | self.added.keys()
        number, free = 1, name
        while free in taken:
            number += 1
            free = f"{name} ({number})"
        formation = Formation(free, frozen(points), frozen(colours), mark)
        self.added[free] = formation
        return formation

    def _whole_fleet(
        self, transition: Transition, hold: float
    ) -> tuple[Formation, Assignment]:
        formation = self._met(transition, hold)
        if transition.under_way[0]:
            formation = self._added(
                formation.name,
                formation.points,
                formation.colours,
                formation.mark,
            )
        given = self.assigned.give(transition, formation, self.fleet, self.position)
        self.placed = [(transition, self.fleet, given.places)]
        return formation, given

    def _met(self, transition: Transition, hold: float) -> Formation:
        """Return the formation to reach, where it is when its motion is under way."""
        formation = self.show.formations[transition.to]
        if not transition.under_way[0]:
            return formation
        every = np.arange(len(formation.points))
        given = every, every, formation, transition, self.show.formations
        points = moving_places(*given).ends(hold or ANY_TIME)[0][0]
        colours = transition.colours
        return replace(
            formation,
            name=f"{formation.name} in motion",
            points=frozen(points),
            colours=formation.colours if colours is None else colours,
        )

    def _moving(self) -> tuple[MovingPlaces, ...]:
        """Return what the drones do over the hold after a chapter."""
        found = []
        for transition, members, places in self.placed:
            if transition.motion:
                standing = places != PARKED
                moving = moving_places(
                    members[standing],
                    places[standing],
                    self.show.formations[transition.to],
                    transition,
                    self.show.formations,
                )
                found.append(moving)
        return tuple(found)

    def _groups(
        self, indices: Sequence[int], hold: float
    ) -> tuple[Formation, Assignment, tuple[Leg, ...]]:
        """Join the goals of all groups into one formation with a place per drone.

        Also return the move of each group by itself.
        """
        transitions = [self.show.transitions[index] for index in indices]
        stood, colours, own = self.position, self.colours.copy(), own_times(transitions)
        reasons, parts = [], []
        left: dict[str | None, FloatArray | None] = {}
        self.placed = []
        for index, transition in zip(indices, transitions, strict=True):
            members = np.asarray(self.show.groups[str(transition.group)])
            formation = self._met(transition, hold)
            start = self.position[members]
            given = self.assigned.give(transition, formation, members, start)
            goals = self.assigned.positions(formation, given.places, members)
            parts.append(self._part(index, members, goals, given))
            # A group may move again in the same chapter.
            self.position = self.position.copy()
            self.position[members] = goals
            if own:
                before = left.pop(transition.group, None)
                parts[-1] = replace(parts[-1], start_state=before)
            if own and transition.motion:
                last = transition.under_way[1] and transition in left_last(transitions)
                until = ending(transitions) if last and known(transitions) else None
                held = self._part_in_motion(parts[-1], until)
                left[transition.group] = held.goal_state
                parts[-1] = replace(parts[-1], goal_state=held.start_state)
                parts.append(held)
                self.position[members] = held.goal
            shown = (
                formation.colours if transition.colours is None else transition.colours
            )
            self.placed.append((transition, members, given.places))
            placed = given.places != PARKED
            colours[members[placed]] = shown[given.places[placed]]
            colours[members[~placed]] = 0.0
            reasons.append(given.reason)
        reached = {transition.group: transition.to for transition in transitions}
        name = " + ".join(f"{group} in {to}" for group, to in reached.items())
        mark = transitions[0].mark
        points, self.position = self.position, stood
        joined = self._added(name, points, colours, mark)
        reason = "; ".join(dict.fromkeys(reasons))
        return joined, Assignment(self.fleet, np.inf, reason), tuple(parts)

    def _part(
        self, index: int, members: IntArray, goals: FloatArray, given: Assignment
    ) -> Leg:
        """Return the move of a group by itself."""
        transition = self.show.transitions[index]
        return Leg(
            index=len(self.legs),
            name=transition.name,
            kind="transition",
            drones=frozen(members.copy()),
            start=frozen(self.position[members]),
            goal=frozen(goals),
            from_formation=self.formation,
            to_formation=transition.to,
            places=frozen(given.places.copy()),
            limits=self.show.limits,
            duration=transition.duration,
            after=(),
            mark=transition.mark,
            transition=index,
            assignment=given.reason,
            arrive=transition.at,
            depart=departure(transition),
            prefer=transition.prefer,
        )

    def _part_in_motion(self, move: Leg, until: float | None) -> Leg:
        """Return what a group does by itself while it holds the end of a move.

        As long as it is to be held, or ``until`` a show time [s].
        """
        transition = self.show.transitions[move.transition or 0]
        time = transition.hold
        if until is not None:
            time = round(until - (arrival(transition) or 0.0), 3)
        rows = np.flatnonzero(move.places != PARKED)
        moving = moving_places(
            rows,
            move.places[rows],
            self.show.formations[transition.to],
            transition,
            self.show.formations,
        )
        part = replace(
            move,
            name=f"hold after {move.name}",
            kind="motion",
            start=move.goal,
            from_formation=transition.to,
            assignment="",
            arrive=None,
            depart=None,
            motion=(moving,),
        )
        return held_in_motion(part, self.show, time)

    def _move(
        self,
        kind: LegKind,
        name: str,
        formation: Formation,
        given: Assignment,
        asked: _Asked,
    ) -> None:
        places = frozen(given.places.copy())
        goal = self.assigned.positions(formation, places, self.fleet)
        colours = formation.colours
        if asked.transition is not None:
            override = self.show.transitions[asked.transition].colours
            if override is not None and formation.name not in self.added:
                colours = override
        leg = self._leg(kind, name, goal, formation.name, asked)
        self.legs.append(replace(leg, places=places, assignment=given.reason))
        self.formation, self.places, self.position = formation.name, places, goal
        self.colours = np.where(
            (places == PARKED)[:, None], 0.0, colours[np.maximum(places, 0)]
        )

    def _hold(
        self,
        name: str,
        duration: float,
        asked: _Asked | None = None,
        motion: tuple[MovingPlaces, ...] = (),
    ) -> None:
        goal, reached = self._carried(motion, duration)
        if duration > 0.0 or motion:
            wanted = asked or _Asked(self.show.limits)
            wanted = _Asked(
                wanted.limits,
                duration,
                wanted.mark,
                wanted.transition,
                motion=motion,
                hold=duration,
            )
            kind: LegKind = "motion" if motion else "hold"
            leg = self._leg(kind, f"hold after {name}", goal, reached, wanted)
            self.legs.append(replace(leg, motion=motion))
        self.formation, self.position = reached, goal

    def _carried(
        self, motion: tuple[MovingPlaces, ...], duration: float
    ) -> tuple[FloatArray, str]:
        """Where the drones stand after a motion, and what that formation is called."""
        if not any(one.moves_on for one in motion):
            return self.position, self.formation
        self.motions += 1
        before = (
            self.show.formations.get(self.formation, None) or self.added[self.formation]
        )
        goal, points = self.position.copy(), before.points.copy()
        for one in motion:
            goal[one.rows] = one.ends(duration or ANY_TIME)[1][0]
            points[self.places[one.rows]] = goal[one.rows]
        name = f"{before.name} after motion {self.motions}"
        self.added[name] = replace(before, name=name, points=frozen(points))
        return goal, name

    def _leg(
        self, kind: LegKind, name: str, goal: FloatArray, formation: str, asked: _Asked
    ) -> Leg:
        """Return the next leg of the fleet, from where it is to ``goal``."""
        index, duration = len(self.legs), asked.duration
        side = 1 if kind == "motion" else 0
        end = state_at(self.show, asked.motion, asked.hold, side, goal)
        begin, self.state = self.state, end
        return Leg(
            index=index,
            name=name,
            kind=kind,
            drones=self.fleet,
            start=frozen(self.position.copy()),
            goal=frozen(goal.copy()),
            from_formation=self.formation,
            to_formation=formation,
            places=self.places,
            limits=asked.limits,
            duration=None if duration is None else round(duration, 3),
            after=(index - 1,) if index else (),
            mark=asked.mark,
            transition=asked.transition,
            arrive=asked.arrive,
            depart=asked.depart,
            prefer=asked.prefer,
            start_state=begin,
            goal_state=self.state,
        )


def _together(wanted: Sequence[Preference]) -> Preference:
    """Return what groups that are flown together prefer: the calmest wish."""
    if "energy" in wanted:
        return "energy"
    numbers = [one for one in wanted if not isinstance(one, str)]
    return max(numbers) if numbers else "time"
