"""From the timeline to the items of every drone's mission.

DO items run while the navigation item after them is flown: a leg's speed is set before
its clock slot, so it stands when the leg begins; its lights between slot and waypoint.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, nan
from typing import TYPE_CHECKING, Literal

import numpy as np

from showc.autopilot.timing import LIFT_OFF
from showc.geodesy import GlobalPoints, SiteFrame, stored_height
from showc.mission.items import (
    Command,
    Frame,
    Mission,
    MissionItem,
    SpeedKind,
    without_position,
)
from showc.script.lanes import chapters, own_times
from showc.script.rules.missions import pulse_widths

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.autopilot.parameters import Parameters
    from showc.autopilot.stage import Stage
    from showc.autopilot.tracking import Tracks
    from showc.mission.clock import MissionClock
    from showc.plan.itinerary import Leg
    from showc.schedule.timeline import ScheduledLeg, Timeline
    from showc.script.show import MissionOptions, Show

MOST_NAMED = 6
"""Of more, what missions leave out is counted."""

SPEED_MARGIN = 1.02
"""A speed limit that does not steer the leg stays above its need by this factor."""


@dataclass(frozen=True, slots=True, eq=False)
class Encoder:
    """What the missions of one fleet have in common."""

    show: Show
    timeline: Timeline
    parameters: Parameters
    home_altitude: FloatArray
    """Altitude of each drone's home, shape (drones,) [m]."""
    clock: MissionClock
    """What slots stand on."""
    autopilot: str
    """``ardupilot`` or ``px4``."""

    def missions(self) -> list[Mission]:
        """Return the mission of every drone, in order."""
        frame = SiteFrame.of(self.show.site)
        everyone = np.arange(self.show.drones)
        home = frame.round_points(self.timeline.pads, self.home_altitude)
        writers = [_Writer(self, int(drone), home, self._yaw()) for drone in everyone]
        self._takeoff(writers, home)
        for scheduled in self.timeline.legs:
            self._leg(writers, scheduled)
        staying, until = self.timeline.waiting
        for drone in staying.tolist():
            writers[drone].stay(until)
        for drone, row in zip(
            self.timeline.land.drones,
            range(self.timeline.land.drones.size),
            strict=True,
        ):
            writers[drone].land(self.timeline.land.stored, row)
        return [writer.mission() for writer in writers]

    def _yaw(self) -> float:
        """Fourth parameter of positions: PX4 turns to it, ArduPilot ignores it."""
        if self.autopilot != "px4":
            return 0.0
        bearing = self.show.site.heading + 90.0 - degrees(self.show.heading)
        return round(bearing % 360.0, 4) % 360.0

    def _takeoff(self, writers: list[_Writer], home: GlobalPoints) -> None:
        takeoff, staging = self.timeline.takeoff, self.timeline.staging
        heights, climbs = takeoff.stored.height.tolist(), takeoff.followed.tolist()
        for row, drone in enumerate(takeoff.drones):
            writers[drone].takeoff(home, heights[row], climbs[row])
        climbs = staging.followed.tolist()
        launch = self.timeline.launch_leg
        shown = pulse_widths(self.show.mission, leg_colours(self.show, launch))
        for row, drone in enumerate(launch.drones):
            writers[drone].show(shown[row])
        for row, drone in enumerate(staging.drones):
            writer = writers[drone]
            writer.waypoint(staging.stored, row)
            writer.clock += climbs[row]
        for writer in writers:
            writer.forget_speeds()

    def _leg(self, writers: list[_Writer], scheduled: ScheduledLeg) -> None:
        shown = pulse_widths(self.show.mission, leg_colours(self.show, scheduled.leg))
        changes = change_moments(self.show, scheduled.leg)
        # For all drones at once: for each alone it would take far longer.
        stages = [Moments(*one) for one in scheduled.tracked]
        rows = [
            {drone: row for row, drone in enumerate(one.stage.drones.tolist())}
            for one in stages
        ]
        for place, drone in enumerate(scheduled.leg.drones.tolist()):
            # Lights change on the first, the middle or the last of its own legs.
            own = [number for number, row in enumerate(rows) if drone in row]
            own = own or [*range(len(stages))]
            last = len(own) - 1
            moment = changes[place]
            # Nothing says that PX4 waits with single items during a leg.
            if self.autopilot == "px4" and moment == "middle":
                moment = "start"
            lit = own[{"start": 0, "middle": last // 2, "end": last}[moment]]
            for number, moments in enumerate(stages):
                colour = shown[place] if number == lit else None
                writers[drone].leg(moments, rows[number].get(drone), colour, moment)


class Moments:
    """When the drones of a stage leave, are half way, and take their next items.

    Attributes
    ----------
    releases
        Mission time at which each one leaves [s].
    half_way, ended
        Time from its own release [s].
    """

    def __init__(self, release: float, stage: Stage, track: Tracks) -> None:
        self.release = release
        self.stage = stage
        self.releases: list[float] = (release + stage.wait).tolist()
        self.half_way: list[float] = track.half_way.tolist()
        self.ended: list[float] = track.ended.tolist()


class _Writer:
    """Collects the items of one drone and remembers what it has been given."""

    def __init__(
        self, encoder: Encoder, drone: int, home: GlobalPoints, yaw: float
    ) -> None:
        self.encoder = encoder
        self.drone = drone
        self.yaw = yaw
        self.items: list[MissionItem] = []
        self.clock = LIFT_OFF
        parameters = encoder.parameters
        self.limits = {
            SpeedKind.LEVEL: parameters.cruise_speed,
            SpeedKind.CLIMB: parameters.climb_speed,
            SpeedKind.DESCENT: parameters.speed_down,
        }
        self.defaults = self.limits | {SpeedKind.CLIMB: parameters.speed_up}
        self.pulses: IntArray | None = None
        self.home = MissionItem(
            Command.NAV_WAYPOINT,
            Frame.GLOBAL,
            latitude=int(home.latitude[drone]),
            longitude=int(home.longitude[drone]),
            height=round(float(encoder.home_altitude[drone]), 2),
        )

    def mission(self) -> Mission:
        """Return what was collected."""
        return Mission(self.drone, self.home, tuple(self.items))

    def takeoff(self, home: GlobalPoints, height: int, duration: float) -> None:
        """Straight up to ``height`` [cm], in ``duration`` [s]."""
        row = GlobalPoints(
            home.latitude[[self.drone]],
            home.longitude[[self.drone]],
            np.array([height]),
        )
        self._position(Command.NAV_TAKEOFF, row, 0)
        self.clock += duration

    def land(self, stored: GlobalPoints, row: int) -> None:
        """Pause, go dark, and straight down at explicit coordinates."""
        pause = self.encoder.timeline.landing_pause
        self.items.append(without_position(Command.NAV_DELAY, round(pause, 2)))
        options = self.encoder.show.mission
        self.items.extend(self._lights(pulse_widths(options, np.zeros((1, 3)))[0]))
        self._position(Command.NAV_LAND, stored, row)

    def leg(
        self,
        moments: Moments,
        row: int | None,
        colour: IntArray | None,
        moment: Moment,
    ) -> None:
        """One clock slot: a leg, a change of colour, both or nothing."""
        lights = [] if colour is None else self._lights(colour)
        if row is None and not lights:
            return
        if row is None:
            self._wait(moments.release)
            self.items.extend(lights)
            return
        stage, release = moments.stage, moments.releases[row]
        self.speeds(stage, row)
        self._wait(release)
        if moment == "start":
            self.items.extend(lights)
        elif moment == "middle" and lights:
            half = round(moments.half_way[row], 2)
            self.items.append(without_position(Command.CONDITION_DELAY, half))
            self.items.extend(lights)
        self.waypoint(stage.stored, row)
        if moment == "end":
            self.items.extend(lights)
        # An autopilot takes the next item when its own time for the leg has ended.
        self.clock = release + moments.ended[row]

    def waypoint(self, stored: GlobalPoints, row: int) -> None:
        """One straight leg."""
        self._position(Command.NAV_WAYPOINT, stored, row)

    def stay(self, until: float) -> None:
        """Stay where it is until a slot."""
        place = next(one for one in reversed(self.items) if one.frame != Frame.MISSION)
        self._wait(until)
        self.items.append(place)

    def show(self, colour: IntArray) -> None:
        """Change colour at once."""
        self.items.extend(self._lights(colour))

    def speeds(self, stage: Stage, row: int) -> None:
        """Set the limit that steers the leg, and lift the other out of its way."""
        level = float(stage.level[row])
        climb = float(stage.climb[row])
        speed = float(stage.profile.speed[row])
        rising = SpeedKind.CLIMB if climb > 0.0 else SpeedKind.DESCENT
        command = round(float(stage.command[row]), 4)
        if stage.by_climb[row]:
            steered, other, need = rising, SpeedKind.LEVEL, speed * level
        else:
            steered, other, need = SpeedKind.LEVEL, rising, speed * abs(climb)
        # What is not known is not enough, either.
        if not self.limits[other] >= SPEED_MARGIN * need:
            self._speed(other, self.defaults[other])
        if self.limits[steered] != command:
            self._speed(steered, command)

    def forget_speeds(self) -> None:
        """Say all speeds again that matter.

        An autopilot whose parameters were loaded since it was built takes its vertical
        speeds from them once more when it first flies to a waypoint.
        """
        self.limits = dict.fromkeys(self.limits, nan)

    def _speed(self, kind: SpeedKind, value: float) -> None:
        self.limits[kind] = value
        if self.encoder.autopilot == "px4" and kind is not SpeedKind.LEVEL:
            return
        self.items.append(
            without_position(Command.DO_CHANGE_SPEED, float(kind), value, -1.0)
        )

    def _wait(self, release: float) -> None:
        """Hold until ``release``, mission time [s]."""
        if self.encoder.autopilot == "px4":
            # It waits for no clock: what is left of the time is all that it knows.
            pause = round(max(release - self.clock, 0.0), 3)
            if pause > 0.0:
                self._delay(pause, -1.0, -1.0, -1.0)
            self.clock = release
            return
        slot = self.encoder.clock.slot(release)
        self._delay(-1.0, slot.hour, slot.minute, slot.second)
        if slot.part > 0.0:
            self._delay(slot.part, -1.0, -1.0, -1.0)

    def _delay(self, *parameters: float) -> None:
        self.items.append(without_position(Command.NAV_DELAY, *parameters))

    def _lights(self, colour: IntArray) -> list[MissionItem]:
        before = None if self.pulses is None else self.pulses.tolist()
        self.pulses = colour
        return light_items(self.encoder.show.mission, before, colour.tolist())

    def _position(self, command: Command, stored: GlobalPoints, row: int) -> None:
        self.items.append(
            MissionItem(
                command,
                Frame.GLOBAL_RELATIVE,
                (0.0, 0.0, 0.0, self.yaw),
                int(stored.latitude[row]),
                int(stored.longitude[row]),
                stored_height(int(stored.height[row])),
            )
        )


Moment = Literal["start", "middle", "end"]

NO_LIGHTS = "missions have no lights: `light_servos` of `mission` names no outputs"


def leg_colours(show: Show, leg: Leg) -> FloatArray:
    """Linear red, green, blue (n, 3) of a leg's drones once they have arrived."""
    formation = show.formations[leg.to_formation]
    colours = formation.colours
    if leg.transition is not None:
        transition = show.transitions[leg.transition]
        if transition.colours is not None and transition.to == leg.to_formation:
            colours = transition.colours
    placed = leg.places >= 0
    chosen = colours[np.where(placed, leg.places, 0)]
    return np.asarray(np.where(placed[:, None], chosen, 0.0))


def change_moments(show: Show, leg: Leg) -> list[Moment]:
    """When during ``leg`` each of its drones changes colour.

    A servo item changes at once; an even fade becomes one change half way.
    """
    changes: list[Moment] = ["start"] * leg.drones.size
    if leg.transition is None:
        return changes
    chapter = next(some for some in chapters(show) if leg.transition in some)
    flown = [show.transitions[k] for k in chapter]
    if own_times(flown):
        flown = [show.transitions[leg.transition]]
    for one in flown:
        own = leg.drones if one.group is None else np.array(show.groups[one.group])
        for place in np.flatnonzero(np.isin(leg.drones, own)).tolist():
            changes[place] = "middle" if one.fade == "linear" else one.fade
    return changes


def lights_left_out(show: Show) -> tuple[str, ...]:
    """Say what of the show's colours its missions do not carry, a sentence each."""
    if show.mission.light_servos is None:
        return (NO_LIGHTS,)
    stepped, effects = [], []
    for transition in show.transitions:
        members = "" if transition.group is None else f" (group {transition.group})"
        if transition.fade == "linear":
            stepped.append(f"{transition.name}{members}")
        effect = transition.effect or show.formations[transition.to].effect
        if effect is not None:
            effects.append(f"{effect.kind} over {transition.to}{members}")
        if transition.lights:
            effects.append(f"lights at moments over {transition.to}{members}")
    found = []
    if effects:
        found.append(
            "missions leave colour effects out, because servos only step: "
            + _some(effects)
        )
    if stepped:
        found.append(
            "in missions a linear fade is one step half-way: " + _some(stepped)
        )
    return tuple(found)


def _some(names: Sequence[str]) -> str:
    """Name the first few, each once, and count the others."""
    every = list(dict.fromkeys(names))
    more = [f"and {len(every) - MOST_NAMED} more"] if len(every) > MOST_NAMED else []
    return ", ".join([*every[:MOST_NAMED], *more])


def light_items(
    options: MissionOptions, before: Sequence[int] | None, after: Sequence[int]
) -> list[MissionItem]:
    """Items that bring the three outputs to ``after`` [us], unchanged ones left out."""
    if options.light_servos is None:
        return []
    return [
        without_position(Command.DO_SET_SERVO, float(output), float(wanted))
        for index, (output, wanted) in enumerate(
            zip(options.light_servos, after, strict=True)
        )
        if before is None or before[index] != wanted
    ]
