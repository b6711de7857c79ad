"""The missions' own timeline: when each leg is released, and what is flown then.

An autopilot's legs take other times than the solved ones, and every clock slot needs
slack before it, so mission time runs apart from show time. Mission time 0 is the start
of the missions: take-off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.following import SETTLING
from showc.autopilot.timing import (
    ANYTIME,
    ARMED,
    CLOCK_LAG,
    LEAST_SPREAD,
    LIFT_OFF,
    Timing,
)
from showc.autopilot.tracking import tracks
from showc.errors import ExportError
from showc.processes import side_by_side
from showc.schedule.encodings import Encoding, choose_encoding
from showc.schedule.releases import STEP
from showc.schedule.separation import Motion, closest_encounter
from showc.schedule.surroundings import Surroundings, stage_motion
from showc.schedule.tubes import BESIDE, room_used

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray
    from showc.autopilot.stage import Stage, StageBuilder
    from showc.autopilot.tracking import Tracks
    from showc.flight import Encounter, Flight, LegFlight
    from showc.plan.itinerary import Leg
    from showc.progress import Progress


MANY = 200
"""Fleets of this size are worth several processes."""

UNSURE = ARMED + 2.0 * LEAST_SPREAD
"""By how much the climb may end later than predicted: if a vehicle is armed at the
last moment, and twice the spread of a leg [s]."""

TAKEOFF_HEIGHT = 2.5
"""Greatest height of the untimed take-off [m]; a waypoint flies the rest."""

FULL = 0.98
"""Part of the room beside its line that a drone may use, seen every 0.1 s: between, it
swings by less than the rest."""

SLOWER = 0.95
"""Part of the room that a slowed drone is to use: swings grow with speed."""

MOST_SLOWINGS = 12
"""So often are drones slowed; once or twice is enough for most."""


@dataclass(frozen=True, slots=True, eq=False)
class ScheduledLeg:
    """One timed leg of the show with its stages on the mission clock."""

    leg: Leg
    """What the show wants."""
    encoding: Encoding
    """How it is flown."""
    releases: tuple[float, ...]
    """Mission time at which each stage is released, multiples of 0.1 s [s]."""
    planned_start: float
    """Show time at which the solved leg starts [s]."""
    planned_duration: float
    """Time of the solved leg [s]."""
    tracks: tuple[Tracks, ...] = ()
    """How each stage is likely to be flown."""

    @property
    def finish(self) -> float:
        """Mission time at which the last stage nominally ends, without delay [s]."""
        return self.releases[-1] + self.encoding.stages[-1].duration

    @property
    def flown(self) -> list[tuple[float, Stage]]:
        """Release and stage, in order."""
        return list(zip(self.releases, self.encoding.stages, strict=True))

    @property
    def tracked(self) -> list[tuple[float, Stage, Tracks]]:
        """Release, stage and how it is likely to be flown, in order."""
        return list(zip(self.releases, self.encoding.stages, self.tracks, strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """All missions of a fleet, from the pads to the pads."""

    pads: FloatArray
    """Where the drones stand before, shape (drones, 3), on the grid [m]."""
    launch_leg: Leg
    """The climb as the show wants it."""
    takeoff: Stage
    """Straight up, untimed."""
    staging: Stage
    """The rest of the climb, untimed, straight after it."""
    legs: tuple[ScheduledLeg, ...]
    """Everything timed, in order."""
    landing_pause: float
    """Hover between the last arrival and the landing [s]."""
    land: Stage
    """Straight down, untimed."""
    land_start: float
    """Mission time at which the landing nominally begins [s]."""
    launch_closest: Encounter | None
    """Nearest encounter of the climb, at any timing."""
    land_closest: Encounter | None
    """Nearest encounter of the landing, at any timing."""

    @property
    def staged(self) -> float:
        """Mission time at which the slowest drone has climbed [s]."""
        climb = LIFT_OFF + self.takeoff.finish() + self.staging.finish()
        return climb + UNSURE


def build_timeline(
    flight: Flight,
    builder: StageBuilder,
    progress: Progress,
    jobs: int | None = None,
) -> Timeline:
    """Lay out the missions of ``flight``.

    Legs of many drones are looked at in ``jobs`` processes (None: one for each core),
    which changes nothing in what is found.

    Raises
    ------
    ExportError
        If the predicted flights of a leg cannot be kept apart, or the show is not one
        launch, transitions and one landing.
    """
    refuse_motions([item.leg for item in flight.legs])
    moves = [item for item in flight.legs if item.leg.kind != "hold"]
    if (
        len(moves) < 2
        or moves[0].leg.kind != "launch"
        or moves[-1].leg.kind != "land"
        or any(item.leg.kind in {"launch", "land"} for item in moves[1:-1])
    ):
        raise ExportError(
            "a mission goes from one launch of all drones to one landing of all; "
            f"found {', '.join(item.leg.kind for item in moves)}"
        )
    return _Layout(flight, builder, progress, jobs).run(moves)


def refuse_motions(legs: Sequence[Leg]) -> None:
    """Refuse formations that move while held, and groups with times of their own.

    Raises
    ------
    ExportError
        If there is one: a mission has straight legs and slots for all, nothing else.
    """
    moving = [leg.name for leg in legs if leg.kind == "motion"]
    if moving:
        more = f", and {len(moving) - 1} more" if len(moving) > 1 else ""
        raise ExportError(
            f"a mission cannot carry a formation that moves: “{moving[0]}”{more}; fly "
            "the log with `showc stream`"
        )
    apart = [leg.name for leg in legs if leg.parts]
    if apart:
        more = f", and {len(apart) - 1} more" if len(apart) > 1 else ""
        raise ExportError(
            f"a mission cannot carry groups with times of their own: “{apart[0]}”"
            f"{more}; fly the log with `showc stream`, or give groups that are flown "
            "together the same times"
        )


class _Layout:
    """Carries the clock and everyone's place while the legs are laid out."""

    def __init__(
        self,
        flight: Flight,
        builder: StageBuilder,
        progress: Progress,
        jobs: int | None,
    ) -> None:
        self.flight = flight
        self.builder = builder
        self.progress = progress
        self.jobs = jobs
        self.show = flight.itinerary.show
        # Drones settle before others fly, however little slack the show gives.
        self.pause = max(self.show.mission.slack, SETTLING)
        self.timing = Timing(wind=self.show.site.wind)
        self.fastest = np.full((0, self.show.drones), np.inf)
        self.arrival = 0.0
        self.free = 0.0

    def run(self, moves: list[LegFlight]) -> Timeline:
        launch, land = moves[0].leg, moves[-1].leg
        everyone = np.arange(self.show.drones)
        _, pads = self.builder.on_grid(everyone, launch.start)
        self.progress.stage("missions", len(moves))
        takeoff, staging, launch_closest = self._launch(launch, pads)
        positions = pads.copy()
        positions[takeoff.drones] = takeoff.end
        positions[staging.drones] = staging.end
        self.progress.advance()
        places = self._places(moves[1:-1], positions)
        climbed = LIFT_OFF + takeoff.finish() + staging.finish()
        legs = self._scheduled(moves[1:-1], places, climbed)
        positions = places[-1]
        pause = max(self.show.landing.hold, 1.0)
        descent = self.builder.build(
            land.drones, positions[land.drones], land.goal, land.limits
        )
        land_closest = self._untimed(descent, positions, "landing")
        self.progress.advance()
        land_start = self.arrival + pause
        return Timeline(
            pads,
            launch,
            takeoff,
            staging,
            tuple(legs),
            pause,
            descent,
            land_start,
            launch_closest,
            land_closest,
        )

    def _scheduled(
        self, moves: list[LegFlight], places: list[FloatArray], climbed: float
    ) -> list[ScheduledLeg]:
        """Encode the timed legs and put them on the clock, from ``climbed`` [s] on.

        A drone that would leave the room beside its line flies that leg more slowly.
        All flights are then predicted anew: a leg begins as the one before it ends.

        Raises
        ------
        ExportError
            If a leg cannot be kept apart, or is left however slowly it is flown.
        """
        self.fastest = np.full((len(moves), self.show.drones), np.inf)
        encodings: dict[int, Encoding] = {}
        some = list(range(len(moves)))
        for _ in range(MOST_SLOWINGS):
            encodings |= self._encodings(moves, places, some)
            legs = self._tracked(self._on_clock(moves, encodings, climbed))
            some = self._slowed(moves, legs)
            if not some:
                return legs
            self.progress.stage("missions, slower where drones swing", len(some))
        raise ExportError(
            f"{moves[some[0]].leg.name}: drones leave their lines by more than "
            f"{BESIDE:g} m, slowed down {MOST_SLOWINGS} times; fly the show with "
            "`showc stream`"
        )

    def _slowed(self, moves: list[LegFlight], legs: list[ScheduledLeg]) -> list[int]:
        """Slow drones that leave their lines; return on which of the moves they are."""
        number = {item.leg.index: number for number, item in enumerate(moves)}
        found = set()
        for leg in legs:
            move = number[leg.leg.index]
            for _, stage, track in leg.tracked:
                used = room_used(stage, track, self.timing)
                over = np.flatnonzero(used > FULL)
                slower = (
                    np.minimum(SLOWER, 1.0 / used[over]) * stage.profile.speed[over]
                )
                self.fastest[move, stage.drones[over]] = slower
                found |= {move} if over.size else set()
        return sorted(found)

    def _on_clock(
        self, moves: list[LegFlight], encodings: dict[int, Encoding], climbed: float
    ) -> list[ScheduledLeg]:
        """Release the stages one after the other, the first once all have climbed."""
        number = {item.leg.index: number for number, item in enumerate(moves)}
        self._reached(climbed, climbed + UNSURE)
        legs = []
        for item, start in zip(self.flight.legs, self.flight.starts, strict=True):
            if item.leg.kind == "hold":
                self.free = max(self.free, self.arrival + item.duration)
            elif item.leg.index in number:
                encoding = encodings[number[item.leg.index]]
                scheduled = self._timed(item, float(start), encoding)
                if scheduled is not None:
                    legs.append(scheduled)
        return legs

    def _tracked(self, legs: list[ScheduledLeg]) -> list[ScheduledLeg]:
        """Add how the drones are likely to fly ``legs``, one after the other."""
        flown = [part for leg in legs for part in leg.flown]
        every = iter(
            tracks(flown, self.show.drones, self.builder.parameters, self.jobs)
        )
        return [
            replace(leg, tracks=tuple(next(every) for _ in leg.releases))
            for leg in legs
        ]

    def _launch(
        self, leg: Leg, pads: FloatArray
    ) -> tuple[Stage, Stage, Encounter | None]:
        """Untimed climb: a short take-off and a waypoint above it."""
        climb = leg.goal - pads[leg.drones]
        part = np.minimum(TAKEOFF_HEIGHT / np.maximum(climb[:, 2], 1e-9), 0.5)
        middle = pads[leg.drones] + part[:, None] * climb
        speed = self.show.launch.climb_speed
        takeoff = self.builder.build(leg.drones, pads[leg.drones], middle, leg.limits)
        staging = self.builder.build(
            leg.drones, middle, leg.goal, leg.limits, speed=speed
        )
        whole = self.builder.build(leg.drones, pads[leg.drones], leg.goal, leg.limits)
        return takeoff, staging, self._untimed(whole, pads, "launch")

    def _untimed(
        self, stage: Stage, positions: FloatArray, name: str
    ) -> Encounter | None:
        """Nearest encounter of a stage that may be flown at any time."""
        show = self.show
        around = Surroundings(positions, show.separation, show.site, ANYTIME)
        motion = stage_motion(stage, positions, ANYTIME)
        found = closest_encounter(
            _at_rest(motion), self.show.separation, enough=around.required
        )
        if found is not None and found.distance < around.required:
            raise ExportError(
                f"{name}: drones {found.drone_a + 1} and {found.drone_b + 1} could "
                f"come as near as {found.distance:.2f} m, for an autopilot's {name} is "
                f"not timed; wanted {self.show.separation.distance:g} m. Give the pads "
                "more room"
            )
        return found

    def _places(
        self, moves: list[LegFlight], positions: FloatArray
    ) -> list[FloatArray]:
        """Say where everyone is before and after each move, however it is flown."""
        places = [positions]
        for item in moves:
            after = places[-1].copy()
            drones = item.leg.drones
            _, after[drones] = self.builder.on_grid(drones, item.leg.goal)
            places.append(after)
        return places

    def _encodings(
        self, moves: list[LegFlight], places: list[FloatArray], some: list[int]
    ) -> dict[int, Encoding]:
        """Encode ``some`` of the moves; ``places`` are those before and after each."""

        def encode(number: int) -> Encoding:
            around = Surroundings(
                places[number],
                self.show.separation,
                self.show.site,
                self.timing,
                self.pause,
            )
            builder = replace(self.builder, fastest=self.fastest[number])
            item = moves[number]
            chosen = choose_encoding(item.leg, item, builder, around)
            kept = [
                (stage, closest)
                for stage, closest in zip(chosen.stages, chosen.closest, strict=True)
                if stage.drones.size
            ]
            stages, closest = zip(*kept, strict=True) if kept else ((), ())
            return Encoding(chosen.name, stages, closest)

        # Small fleets are done sooner than another process has started.
        jobs = self.jobs if self.show.drones >= MANY else 1
        parts = [partial(encode, number) for number in some]
        found = side_by_side(parts, jobs, self.progress.advance)
        return dict(zip(some, found, strict=True))

    def _timed(
        self, item: LegFlight, planned_start: float, encoding: Encoding
    ) -> ScheduledLeg | None:
        """Put the stages of one leg on the clock."""
        if not encoding.stages:
            self.free = max(self.free, self.arrival + item.duration)
            return None
        releases = []
        for stage in encoding.stages:
            release = round(ceil(self.free / STEP - 1e-6) * STEP, 6)
            releases.append(release)
            speed = stage.profile.speed
            self._reached(
                release + stage.finish() + 0.5 * CLOCK_LAG,
                release + stage.finish(self.timing.late(speed)) + CLOCK_LAG,
            )
        return ScheduledLeg(
            item.leg,
            encoding,
            tuple(releases),
            planned_start,
            item.duration,
        )

    def _reached(self, likely: float, latest: float) -> None:
        """Note an arrival: the next release waits for the slack."""
        self.arrival = likely
        self.free = latest + self.pause


def _at_rest(motion: Motion) -> Motion:
    """Narrow the window of a motion that may happen at any time to one instant."""
    return replace(motion, window=(0.0, 1.0))
