"""From a solved show to the mission files of its whole fleet, as bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from showc.autopilot.parameters import FIRMWARE, parameter_file, parameters_for
from showc.autopilot.stage import StageBuilder
from showc.autopilot.timing import ARMED_IN_TIME
from showc.errors import ExportError
from showc.geodesy import SiteFrame
from showc.log.facts import fleet_token
from showc.mission.clock import MissionClock
from showc.mission.encode import Encoder, lights_left_out
from showc.mission.items import check_budget, waypoint_file
from showc.mission.plan_file import PlanSettings, fence_corners, plan_file
from showc.mission.predict import PredictedFlight, prediction_summary
from showc.progress import Silent
from showc.schedule.course import Course
from showc.schedule.layout import MANY, build_timeline
from showc.script.rules.operations import BATTERY

if TYPE_CHECKING:
    from datetime import datetime

    from showc.arrays import FloatArray
    from showc.flight import Flight
    from showc.mission.items import Mission
    from showc.progress import Progress
    from showc.schedule.timeline import Timeline
    from showc.script.show import Music, Show


Autopilot = Literal["ardupilot", "px4"]

SILENT = Silent()

ON_TIME = 0.1
"""A slot that is off its time by less is on it [s]: slots are multiples of this."""

LEAST_SLACK = 2.0
"""Slack before a clock slot that calm air needs [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class MissionSet:
    """The missions of a fleet, ready to be written."""

    files: dict[str, bytes]
    """By name relative to the output folder: ``missions/drone_0001.waypoints``, ..."""
    fleet_token: str
    """Hash over all missions, 64 hexadecimal digits: one for each compile."""
    prediction: dict[str, Any]
    """The predicted flight in numbers, for manifest and report; JSON-able."""
    warnings: tuple[str, ...]
    """What the user should know, one sentence each."""
    predicted: PredictedFlight | None
    """The predicted flight itself; None where the autopilot's law is not known."""


def drone_name(drone: int) -> str:
    """Return the stem of a drone's files, counting from 0: ``drone_0001``."""
    return f"drone_{drone + 1:04d}"


def mission_files(
    flight: Flight,
    *,
    start: datetime | None = None,
    start_minute: int | None = None,
    autopilot: Autopilot = "ardupilot",
    progress: Progress = SILENT,
    jobs: int | None = None,
) -> MissionSet:
    """Return all mission files of a solved show.

    Parameters
    ----------
    flight
        The solved show.
    start
        When the missions start, UTC, a whole second: every leg waits for its slot on
        the vehicle's clock. None: slots are minutes and seconds of any hour.
    start_minute
        Minute of any hour at which the missions start then; None: the script's.
    autopilot
        Whose dialect the files speak. PX4 cannot wait for a clock time, and its leg
        law is not known, so that nothing is predicted for it.
    progress
        Hears of every leg.
    jobs
        Processes to look at the legs of many drones in; None: one for each core.

    Raises
    ------
    UsageError
        If ``start`` has no time zone or is no whole second.
    ExportError
        If a mission has more items than its board holds, or the predicted flights of a
        leg come too near each other in every encoding. Also if slots would come round
        again while the missions are flown.
    """
    show = flight.itinerary.show
    minute = show.mission.start_minute if start_minute is None else start_minute
    clock = MissionClock.of(start, minute)
    builder, home_altitude = builder_of(show)
    parameters = builder.parameters
    course = Course.of(show, [item.leg for item in flight.legs], flight)
    timeline = build_timeline(show, course, builder, progress, jobs)
    missions = items_of(show, timeline, home_altitude, clock, autopilot)
    home_row = autopilot == "ardupilot"
    files = {
        f"missions/{drone_name(mission.drone)}.waypoints": waypoint_file(
            mission, home_row=home_row
        )
        for mission in missions
    }
    token = fleet_token(files)
    files |= _plans(show, missions, autopilot, parameters.speed, token)
    if autopilot == "px4":
        notes = (*PX4_WARNINGS, *lights_left_out(show))
        return MissionSet(files, token, {"clock": "relative"}, notes, None)
    files["missions/ardupilot.parm"] = parameter_file(parameters)
    prediction = prediction_summary(
        flight, timeline, clock, parameters, jobs if show.drones >= MANY else 1
    )
    return MissionSet(
        files,
        token,
        prediction,
        _warnings(flight, timeline, prediction, clock),
        PredictedFlight(timeline, parameters),
    )


def builder_of(show: Show) -> tuple[StageBuilder, FloatArray]:
    """Return what stages are built with, and altitudes of homes, (drones,) [m]."""
    frame = SiteFrame.of(show.site)
    pads = np.asarray(show.formations[show.pads].points[: show.drones])
    altitude = np.round(frame.to_geodetic(pads)[:, 2], 2)
    return StageBuilder(frame, altitude, parameters_for(show)), altitude


def items_of(
    show: Show,
    timeline: Timeline,
    home_altitude: FloatArray,
    clock: MissionClock,
    autopilot: Autopilot,
) -> list[Mission]:
    """Return the missions of a timeline; ``home_altitude`` has shape (drones,) [m].

    Raises
    ------
    ExportError
        If one has more items than its board holds, or slots would come round again.
    """
    if autopilot == "ardupilot":
        clock.check_span(timeline.land_start)
    parameters = parameters_for(show)
    encoder = Encoder(show, timeline, parameters, home_altitude, clock, autopilot)
    missions = encoder.missions()
    for mission in missions:
        count = len(mission.items) + (autopilot == "ardupilot")
        check_budget(count, autopilot, show.mission.board, mission.drone)
    return missions


def _plans(
    show: Show,
    missions: list[Mission],
    autopilot: Autopilot,
    speed: float,
    token: str,
) -> dict[str, bytes]:
    settings = PlanSettings(
        autopilot,
        fence_corners(show.site),
        speed,
        show.landing.altitude,
        token,
    )
    return {
        f"missions/{drone_name(mission.drone)}.plan": plan_file(mission, settings)
        for mission in missions
    }


PX4_WARNINGS = (
    "PX4 waits for no clock: relative delays only, nothing keeps the drones together",
    "PX4's flights are not predicted, nor proved apart: fly with `showc stream`",
)


def _warnings(
    flight: Flight,
    timeline: Timeline,
    prediction: dict[str, Any],
    clock: MissionClock,
) -> tuple[str, ...]:
    """Say what the user should know, a line each."""
    show = flight.itinerary.show
    legs = prediction["legs"]
    found = [
        f"load missions/ardupilot.parm onto {FIRMWARE} before the missions",
        (
            f"the missions take {prediction['duration']:.0f} s, the solved show "
            f"{flight.duration:.0f} s, which `showc stream` flies"
        ),
        ARMED_IN_TIME,
    ]
    if prediction["duration"] > BATTERY:
        found.append(
            f"batteries of show drones surely last {BATTERY:.0f} s, less than these "
            "missions: measure yours, shorten the holds or lower mission.slack"
        )
    if timeline.legs:
        latest = clock.text(prediction["latest_mission_start"])
        again = "day" if clock.start else "hour"
        found.append(
            f"start the missions before {latest}: a drone that misses a slot waits for "
            f"it until the next {again}"
        )
        if show.mission.slack < LEAST_SLACK:
            found.append(
                f"slack is {show.mission.slack:g} s; drones were measured to need "
                f"{LEAST_SLACK:g} s before a slot, 3 s in wind"
            )
    found += cue_notes(timeline, show.music)
    changed = [leg for leg in legs if leg["encoding"] != "straight"]
    if changed:
        longest = max(changed, key=lambda leg: leg["duration"])
        others = len(changed) - 1
        more = f"; shorter legs that need such a form: {others}" if others else ""
        found.append(
            f"to keep drones apart, missions fly `{longest['name']}` in the form "
            f"“{longest['encoding']}”{more}"
        )
    found.extend(lights_left_out(show))
    return tuple(found)


def cue_notes(timeline: Timeline, music: Music | None) -> list[str]:
    """Say how missions keep the times that the script asks for."""
    if timeline.shift is None:
        return []
    found = []
    if timeline.shift or music is not None:
        begins = timeline.shift + (0.0 if music is None else music.offset)
        when = f"{abs(begins):.1f} s {'after' if begins >= 0.0 else 'before'}"
        found.append(
            f"show time 0 is {when} the start of the missions"
            if music is None
            else f"start the music {when} the missions"
        )
    worst = max(timeline.legs, key=lambda one: one.late)
    if worst.late > ON_TIME:
        late = sum(one.late > ON_TIME for one in timeline.legs)
        more = f" ({late - 1} more legs are late)" if late > 1 else ""
        found.append(
            f"the missions fly `{worst.leg.name}` {worst.late:.1f} s late{more}: their "
            "legs need longer than the solved ones; `showc stream` keeps all times"
        )
    return found


__all__ = ["ExportError", "MissionSet", "drone_name", "mission_files"]
