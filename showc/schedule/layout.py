"""Laying out a timeline: each leg is encoded, released in turn, and predicted.

A drone that swings too far flies its leg again, more slowly. Groups that have times of
their own are encoded beside what is on the clock already.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.following import SETTLING
from showc.autopilot.takeoff import LEAST_HEIGHT
from showc.autopilot.timing import (
    ANYTIME,
    CLOCK_LAG,
    LIFT_OFF,
    Timing,
)
from showc.autopilot.tracking import Tracker
from showc.errors import ExportError
from showc.processes import side_by_side
from showc.schedule.encodings import Encoding, choose_encoding
from showc.schedule.landings import landings_meet
from showc.schedule.releases import STEP
from showc.schedule.separation import closest_encounter
from showc.schedule.surroundings import Surroundings, stage_motion, tick
from showc.schedule.timeline import UNSURE, ScheduledLeg, Timeline
from showc.schedule.tubes import BESIDE, off_end, room_used

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.autopilot.stage import Stage, StageBuilder
    from showc.flight import Encounter
    from showc.plan.itinerary import Leg
    from showc.progress import Progress
    from showc.schedule.course import Course, Step
    from showc.script.show import Show


MANY = 200
"""Fleets of this size are worth several processes."""

TAKEOFF_HEIGHT = 2.5
"""Greatest height of the untimed take-off [m]; a waypoint flies the rest."""

FULL = 0.98
"""Part of the room beside its line that a drone may use, seen every 0.1 s: between, it
swings by less than the rest."""

SLOWER = 0.95
"""Part of the room that a slowed drone is to use, or one that settles: swings grow
with speed."""

CLEAR = 1.0
"""So long after the latest end of others' stage, and what follows it, a move that waits
for them is released [s]: it may be early by less."""

LONG_AGO = 2.0
"""What was released so long before has begun, however early a move is [s]."""

MOST_ADJUSTED = 4
"""So often is a release adjusted to what the move that is flown takes."""

MOST_REVISIONS = 12
"""Revisions of one move at most; once or twice is enough for most."""


def build_timeline(
    show: Show,
    course: Course,
    builder: StageBuilder,
    progress: Progress,
    jobs: int | None = None,
) -> Timeline:
    """Lay out the missions of a show that fly a ``course``.

    Legs of many drones are looked at in ``jobs`` processes (None: one for each core),
    which changes nothing in what is found.

    Raises
    ------
    ExportError
        If the predicted flights of a leg cannot be kept apart.
    """
    return _Layout(show, course, builder, progress, jobs).run()


class _Layout:
    """Carries the clock and everyone's place while the legs are laid out."""

    def __init__(
        self,
        show: Show,
        course: Course,
        builder: StageBuilder,
        progress: Progress,
        jobs: int | None,
    ) -> None:
        self.show = show
        self.course = course
        self.moves = [move for step in course.steps for move in step.moves]
        self.number = {id(move): number for number, move in enumerate(self.moves)}
        self.builder = builder
        self.progress = progress
        self.jobs = jobs
        # Drones settle before others fly, however little slack the show gives.
        self.pauses = np.full(len(self.moves), max(self.show.mission.slack, SETTLING))
        self.timing = Timing(wind=self.show.site.wind)
        self.fastest = np.full((len(self.moves), show.drones), np.inf)
        self.places: list[FloatArray] = []
        # Which move is the first of those that are flown with each one.
        self.first = [
            sum(len(one.moves) for one in course.steps[:number])
            for number, step in enumerate(course.steps)
            for _ in step.moves
        ]
        self.shift: float | None = None
        self.arrival = 0.0
        self.free = 0.0

    def run(self) -> Timeline:
        launch, land = self.course.launch, self.course.land
        everyone = np.arange(self.show.drones)
        _, pads = self.builder.on_grid(everyone, launch.start)
        self.progress.stage("planning missions", len(self.moves) + 2)
        takeoff, staging, launch_closest = self._launch(launch, pads)
        positions = pads.copy()
        positions[takeoff.drones] = takeoff.end
        positions[staging.drones] = staging.end
        self.progress.advance()
        self.places = self._places(positions)
        climbed = LIFT_OFF + takeoff.finish() + staging.finish()
        legs = self._scheduled(climbed)
        positions = self.places[-1]
        # Above the pads already, the last formation is held as well.
        held = [step.hold for step in self.course.steps[-1:]]
        pause = max(self.show.landing.hold, 1.0, *held)
        descent = self.builder.build(
            land.drones, positions[land.drones], land.goal, land.limits
        )
        land_closest = self._untimed(descent, positions, "landing")
        self.progress.advance()
        land_start = self.arrival + pause
        show = self.show
        around = Surroundings(positions, show.separation, show.site, self.timing)
        last = max(legs, key=lambda leg: leg.arrival, default=None)
        together = last is not None and landings_meet(last, descent, pause, around)
        return Timeline(
            pads,
            launch,
            takeoff,
            staging,
            tuple(legs),
            self.shift,
            self.free,
            pause,
            together,
            descent,
            land_start,
            launch_closest,
            land_closest,
        )

    def _scheduled(self, climbed: float) -> list[ScheduledLeg]:
        """Encode the timed legs and put them on the clock, from ``climbed`` [s] on.

        A drone that would leave the room beside its line flies that leg more slowly,
        or waits before it until it has settled. All flights are then predicted anew: a
        leg begins as the one before it ends.

        Raises
        ------
        ExportError
            If a leg cannot be kept apart, or is left however slowly it is flown.
        """
        encodings = self._encodings(list(range(len(self.moves))))
        tracker = Tracker(self.show.drones, self.builder.parameters, self.jobs)
        revisions = np.zeros(len(self.moves), dtype=np.int64)
        while True:
            legs, some = self._tracked(self._on_clock(encodings, climbed), tracker)
            if not some:
                return legs
            revisions[some] += 1
            if revisions.max() == MOST_REVISIONS:
                raise ExportError(
                    f"{self.moves[int(revisions.argmax())].leg.name}: drones leave "
                    f"their lines by more than {BESIDE:g} m, slowed down "
                    f"{MOST_REVISIONS} times; fly the show with `showc stream`"
                )
            self.progress.stage("slowing legs on which drones overshoot", len(some) + 1)
            encodings |= self._encodings(some)

    def _tracked(
        self, legs: list[ScheduledLeg], tracker: Tracker
    ) -> tuple[list[ScheduledLeg], list[int]]:
        """Add how drones are likely to fly ``legs``, up to those that are revised.

        What follows these begins otherwise once they are flown otherwise. Returned are
        the legs so far, and the moves that were revised, in order.
        """
        tracks = tracker.fly([part for leg in legs for part in leg.flown])
        found: list[ScheduledLeg] = []
        for _, step in groupby(legs, lambda leg: self.first[self.number[id(leg.move)]]):
            flown = [
                replace(leg, tracks=tuple(next(tracks) for _ in leg.releases))
                for leg in step
            ]
            found += flown
            if some := self._revised(flown):
                return found, some
        return found, []

    def _revised(self, legs: list[ScheduledLeg]) -> list[int]:
        """Slow drones that leave their lines, and let those settle that begin beside.

        Returns the moves that are flown otherwise then, in order.
        """
        found, pauses = set(), self.pauses.copy()
        # What a drone begins a leg with, its speed there does not change.
        unsettled = np.zeros(self.show.drones, dtype=np.bool_)
        for leg in legs:
            move = self.number[id(leg.move)]
            for _, stage, track in leg.tracked:
                used = room_used(stage, track, self.timing)
                over = np.flatnonzero((used > FULL) & ~unsettled[stage.drones])
                slower = (
                    np.minimum(SLOWER, 1.0 / used[over]) * stage.profile.speed[over]
                )
                self.fastest[move, stage.drones[over]] = slower
                found |= {move} if over.size else set()
                off = off_end(track) / BESIDE
                unsettled[stage.drones] = off > FULL
                if unsettled[stage.drones].any():
                    # What drones are off their ends fades at the gain of places.
                    rate = self.builder.parameters.gains.place
                    longer = self.pauses[move] + np.log(off.max() / SLOWER) / rate
                    pauses[move] = max(pauses[move], longer)
        found |= set(np.flatnonzero(pauses > self.pauses).tolist())
        self.pauses = pauses
        return sorted(found)

    def _on_clock(
        self, encodings: dict[int, Encoding], climbed: float
    ) -> list[ScheduledLeg]:
        """Release the stages one after the other, the first once all have climbed.

        Moves of groups that have times of their own are encoded here: when others fly
        is known no sooner.
        """
        self.shift = None
        self.arrival = climbed
        self.free = max(
            climbed + UNSURE + max(self.show.mission.slack, SETTLING),
            climbed + self.course.hold,
        )
        number, legs = 0, []
        for step in self.course.steps:
            if len(step.moves) > 1:
                legs += self._beside(number, step)
            else:
                release = self._release(number, encodings[number].stages, self.free)
                leg = self._timed(number, encodings[number], release)
                self.arrival, self.free = leg.arrival, leg.over
                legs.append(leg)
            number += len(step.moves)
            self.free = max(self.free, self.arrival + step.hold)
        return legs

    def _wanted(self, number: int, stages: Sequence[Stage]) -> float | None:
        """Show time at which a move is to be released, as the script asks [s]."""
        cue = self.moves[number].cue
        if cue is None:
            return None
        time, arrives = cue
        return time - self._takes(number, stages)[0] if arrives else time

    def _takes(self, number: int, stages: Sequence[Stage]) -> tuple[float, float]:
        """Time from the first release to the likely arrival, and until all is over."""
        around, likely, free = self._around(number), 0.0, 0.0
        for stage in stages:
            likely = free + stage.finish() + 0.5 * CLOCK_LAG
            free = around.following(free, stage)
        return likely, free

    def _release(self, number: int, stages: Sequence[Stage], free: float) -> float:
        """When a move is released: on time for its cue, not before ``free`` [s]."""
        soonest, wanted = tick(free), self._wanted(number, stages)
        if wanted is None:
            return soonest
        if self.shift is None:
            self.shift = max(tick(soonest - wanted), 0.0)
        return max(round(round((self.shift + wanted) / STEP) * STEP, 6), soonest)

    def _timed(self, number: int, encoding: Encoding, release: float) -> ScheduledLeg:
        """Put a move on the clock."""
        releases = [
            release + self._takes(number, encoding.stages[:count])[1]
            for count in range(len(encoding.stages))
        ]
        likely, over = self._takes(number, encoding.stages)
        arrival = release + likely
        move = self.moves[number]
        late = 0.0
        if move.cue is not None and self.shift is not None:
            time, arrives = move.cue
            late = (arrival if arrives else release) - self.shift - time
        rounded = tuple(round(one, 6) for one in releases)
        return ScheduledLeg(move, encoding, rounded, arrival, release + over, late)

    def _beside(self, number: int, step: Step) -> list[ScheduledLeg]:
        """Encode moves of groups that have times of their own, and release them."""
        free, first = np.full(self.show.drones, self.free), self.shift is None
        legs: list[ScheduledLeg] = []
        order = sorted(
            range(len(step.moves)), key=lambda place: (step.moves[place].start, place)
        )
        if self.shift is None:
            # The first move of each group is to be on time.
            firsts = {step.moves[k].leg.drones[0]: number + k for k in reversed(order)}
            wanted = (self._wanted(k, self._straight(k)) for k in firsts.values())
            needs = [tick(tick(self.free) - one) for one in wanted if one is not None]
            self.shift = max(0.0, *needs)
        for place in order:
            leg = step.moves[place].leg
            mine = float(free[leg.drones].max())
            found = self._among(number + place, legs, mine)
            legs.append(found)
            held = 0.0
            if leg.transition is not None:
                held = self.show.transitions[leg.transition].hold
            free[leg.drones] = max(found.over, found.arrival + held)
        if first and self.shift is not None:
            # Where all are slower than straight lines, one of them is on time still.
            least = min(leg.late for leg in legs if leg.move.cue is not None)
            self.shift += least
            legs = [replace(leg, late=max(leg.late - least, 0.0)) for leg in legs]
        self.free = float(free.max())
        self.arrival = max(leg.arrival for leg in legs)
        flown = [part for leg in legs for part in leg.flown]
        around = self._around(number)
        return [_seen_among(leg, flown, around) for leg in legs]

    def _straight(self, number: int) -> tuple[Stage, ...]:
        """Straight lines of a move in the shortest time, for what they take."""
        move, start = self.moves[number], self.places[number]
        drones = move.leg.drones
        lines = self.builder.lines(
            drones, start[drones], move.leg.goal, move.leg.limits
        )
        return (lines.lasting(max(move.duration, lines.together)),)

    def _among(
        self, number: int, legs: Sequence[ScheduledLeg], free: float
    ) -> ScheduledLeg:
        """Put a move beside those of other groups; it waits for them if it must.

        Parameters
        ----------
        number
            Of the move.
        legs
            What is on the clock already.
        free
            Before this it is not released [s].

        Raises
        ------
        ExportError
            If it cannot be kept apart even when all others rest.
        """
        flown = [part for leg in legs for part in leg.flown]
        release = self._release(number, self._straight(number), free)
        found: tuple[Encoding, float] | None = None
        for _ in range(len(flown) + MOST_ADJUSTED):
            try:
                encoding = self._encoded(
                    number, self._meanwhile(number, flown, release)
                )
            except ExportError:
                if found is not None:
                    break
                ends = [self._around(number).following(*one) for one in flown]
                later = [end + CLEAR for end in ends if end + CLEAR > release]
                if not later:
                    raise
                free = min(later)
                release = self._release(number, self._straight(number), free)
                continue
            found = encoding, release
            # An encoding that takes longer leaves sooner, if it can.
            wanted = self._release(number, encoding.stages, free)
            if wanted == release:
                break
            release = wanted
        assert found is not None  # noqa: S101 - each failure is at a later end
        return self._timed(number, *found)

    def _around(self, number: int) -> Surroundings:
        """Return where everyone is before a move, if it is flown by itself."""
        return Surroundings(
            self.places[number],
            self.show.separation,
            self.show.site,
            self.timing,
            float(self.pauses[number]),
        )

    def _meanwhile(
        self, number: int, flown: Sequence[tuple[float, Stage]], release: float
    ) -> Surroundings:
        """Return what is around a move that is released while stages are flown."""
        drones = self.moves[number].leg.drones
        around = self._around(number)
        places = self.places[self.first[number]].copy()
        for begin, stage in flown:
            if begin < release - LONG_AGO:
                places[stage.drones] = stage.end
        places[drones] = around.positions[drones]
        others = tuple((begin - release, stage) for begin, stage in flown)
        return replace(around, positions=places, others=others)

    def _encoded(self, number: int, around: Surroundings) -> Encoding:
        """Encode a move, with no drone faster than it has room for."""
        move = self.moves[number]
        builder = replace(self.builder, fastest=self.fastest[number])
        return choose_encoding(move.leg, move.flight, builder, around)

    def _launch(
        self, leg: Leg, pads: FloatArray
    ) -> tuple[Stage, Stage, Encounter | None]:
        """Untimed climb: a short take-off and a waypoint above it."""
        climb = leg.goal - pads[leg.drones]
        height = np.clip(0.5 * climb[:, 2], LEAST_HEIGHT, TAKEOFF_HEIGHT)
        middle = pads[leg.drones] + (height / climb[:, 2])[:, None] * climb
        build = partial(self.builder.build, leg.drones)
        speed = self.builder.parameters.climb_speed
        takeoff = build(pads[leg.drones], middle, leg.limits, speed=speed)
        staging = build(middle, leg.goal, leg.limits, speed=speed)
        whole = build(pads[leg.drones], leg.goal, leg.limits)
        return takeoff, staging, self._untimed(whole, pads, "launch")

    def _untimed(
        self, stage: Stage, positions: FloatArray, name: str
    ) -> Encounter | None:
        """Nearest encounter of a stage that may be flown at any time."""
        show = self.show
        around = Surroundings(positions, show.separation, show.site, ANYTIME)
        # A motion that may happen at any time is looked at for one instant.
        motion = replace(stage_motion(stage, positions, ANYTIME), window=(0.0, 1.0))
        found = closest_encounter(motion, show.separation, enough=around.required)
        if found is not None and found.distance < around.required:
            raise ExportError(
                f"{name}: drones {found.drone_a + 1} and {found.drone_b + 1} could "
                f"come as near as {found.distance:.2f} m, for an autopilot's {name} is "
                f"not timed; wanted {self.show.separation.distance:g} m. Give the pads "
                "more room"
            )
        return found

    def _places(self, positions: FloatArray) -> list[FloatArray]:
        """Say where everyone is before and after each move, however it is flown."""
        places = [positions]
        for move in self.moves:
            after = places[-1].copy()
            drones = move.leg.drones
            _, after[drones] = self.builder.on_grid(drones, move.leg.goal)
            places.append(after)
        return places

    def _encodings(self, some: list[int]) -> dict[int, Encoding]:
        """Encode those of ``some`` moves beside which no other is flown."""
        chosen = [one for one in some if self.first.count(self.first[one]) == 1]
        # Small fleets are done sooner than another process has started.
        jobs = self.jobs if self.show.drones >= MANY else 1
        parts = [
            partial(self._encoded, number, self._around(number)) for number in chosen
        ]
        found = side_by_side(parts, jobs, self.progress.advance)
        return dict(zip(chosen, found, strict=True))


def _seen_among(
    leg: ScheduledLeg, flown: Sequence[tuple[float, Stage]], around: Surroundings
) -> ScheduledLeg:
    """Add the nearest encounter of the fleet while a leg is flown beside others."""
    first, after = leg.releases[0], leg.releases[-1]
    last = leg.encoding.stages[-1]
    spread = around.timing.spread(last.profile.speed)
    closest = around.nearest(flown, first, after + last.finish(spread) + SETTLING)
    if closest is not None:
        closest = replace(closest, time=closest.time - first)
    none = (None,) * (len(leg.releases) - 1)
    return replace(leg, encoding=replace(leg.encoding, closest=(closest, *none)))
