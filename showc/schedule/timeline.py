"""The missions' own timeline: when each leg is released, and what is flown then.

An autopilot's legs take other times than the solved ones, and every clock slot needs
slack before it, so mission time runs apart from show time. Mission time 0 is the start
of the missions: take-off.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot.timing import ARMED, CLOCK_LAG, LEAST_SPREAD, LIFT_OFF

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.autopilot.stage import Stage
    from showc.autopilot.tracking import Tracks
    from showc.flight import Encounter
    from showc.plan.itinerary import Leg
    from showc.schedule.course import Move
    from showc.schedule.encodings import Encoding


UNSURE = ARMED + 2.0 * LEAST_SPREAD
"""By how much the climb may end later than predicted: if a vehicle is armed at the
last moment, and twice the spread of a leg [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class ScheduledLeg:
    """One timed leg of the show with its stages on the mission clock."""

    move: Move
    """What the show wants, and the solved flight."""
    encoding: Encoding
    """How it is flown."""
    releases: tuple[float, ...]
    """Mission time at which each stage is released, multiples of 0.1 s [s]."""
    arrival: float
    """Mission time at which its last drone most likely arrives [s]."""
    over: float
    """Mission time at which its drones may leave again [s]."""
    late: float
    """By how much it misses the time that the script asks for, if it does [s]."""
    tracks: tuple[Tracks, ...] = ()
    """How each stage is likely to be flown."""

    @property
    def leg(self) -> Leg:
        """What the show wants."""
        return self.move.leg

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
    """Everything timed, in the order of the show: groups that have times of their own
    may be flown in another."""
    shift: float | None
    """Mission time of show time 0, by which slots follow the times that the script asks
    for [s]; None: it asks for none."""
    free: float
    """Mission time at which all have flown, and have held what they reached [s]."""
    landing_pause: float
    """Hover between the last arrival and the landing [s]."""
    lands_together: bool
    """Whether no drone may sink before the last has come: else they come too near."""
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

    @property
    def waiting(self) -> tuple[IntArray, float]:
        """Drones that wait for a slot to land, and until when they do [s].

        Those that do not fly last would land as soon as they have flown, beneath the
        others; those that come much sooner than others, before the last formation is
        complete; and on their approach, those that would sink too near to others.
        """
        if not self.legs:
            return np.empty(0, dtype=np.int64), 0.0
        last = max(self.legs, key=lambda leg: leg.arrival)
        waits = np.ones(self.pads.shape[0], dtype=bool)
        complete = -np.inf if last.leg.kind == "approach" else last.arrival
        complete = last.over if self.lands_together else complete
        for release, stage in last.flown:
            lands = release + stage.wait + stage.followed + self.landing_pause
            waits[stage.drones] = lands < complete
        flown = np.concatenate([stage.drones for stage in last.encoding.stages])
        # One that has flown just before needs slack; on the grid of slots.
        until = last.over if waits[flown].any() else last.arrival
        # Groups that have flown before keep their own slack and holds.
        others = np.setdiff1d(np.flatnonzero(waits), last.leg.drones)
        until = max(until, self.free) if others.size else until
        # After a slot of lights alone, the second of this one is still to come.
        until = max(until, last.releases[-1] + CLOCK_LAG + 1.0)
        return np.flatnonzero(waits), ceil(10.0 * until) / 10.0
