"""The solved flight as setpoints: position, velocity and acceleration over time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import UsageError
from showc.geodesy import SiteFrame
from showc.safety.stop import Authority, Motion
from showc.vehicle import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import FloatArray
    from showc.autopilot.feedforward import Feedforward
    from showc.log.reader import LoggedShow
    from showc.trajectory import PiecewisePolynomial


GRID = 0.02
"""Step of the times at which the plan's greatest values are looked for [s]."""

AUTOPILOT_JERK = 15.0
"""Jerk limit that ArduCopter needs to follow solved flights [m/s³]: with its default of
5 it flew 2.4 to 5.5 m off, from 15 on the limit no longer decided."""

ROOM = 1.02
"""Factor above the plan's greatest values that a vehicle should follow: the greatest
value between the times of the grid lies above that on it."""


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """Where a fleet is to be, and how it is to move; all arrays (n, 3), show frame."""

    position: FloatArray
    """[m]."""
    velocity: FloatArray
    """[m/s]."""
    acceleration: FloatArray
    """[m/s²]."""

    def scaled(self, rate: float, rate_change: float) -> Instant:
        """Return the same with a clock that goes at ``rate``, changing [1/s]."""
        return Instant(
            self.position,
            rate * self.velocity,
            rate**2 * self.acceleration + rate_change * self.velocity,
        )

    def beyond(self, shift: Feedforward) -> Instant:
        """Return what vehicles are sent that need this ``shift`` to be here."""
        return Instant(
            self.position + shift.place,
            self.velocity + shift.speed,
            self.acceleration + shift.push,
        )


@dataclass(frozen=True, eq=False)
class StreamPlan:
    """What a set of drones flies."""

    drones: tuple[int, ...]
    """Counting from 0."""
    frame: SiteFrame
    """The show frame on the globe."""
    position: tuple[PiecewisePolynomial, ...]
    """Of each drone, over show time, 3 components [m]."""
    velocity: tuple[PiecewisePolynomial, ...]
    """Likewise [m/s]."""
    acceleration: tuple[PiecewisePolynomial, ...]
    """Derivative of the velocity [m/s²]."""
    launch_end: float
    """Show time at which all hover above their pads [s]."""
    landing_start: float
    """Show time from which all go down to their pads [s]."""
    duration: float
    """Show time at which the flight ends [s]."""
    separation: float
    """Distance that drones must keep [m]."""

    def pads(self) -> FloatArray:
        """Return where the drones stand at first, shape (n, 3), show frame [m]."""
        return np.array([path(0.0) for path in self.position])

    def at(self, time: float) -> Instant:
        """Return where the drones are, and how they move, at show ``time`` [s]."""
        return Instant(
            np.array([path(time) for path in self.position]),
            np.array([path(time) for path in self.velocity]),
            np.array([path(time) for path in self.acceleration]),
        )

    @cached_property
    def motion(self) -> Motion:
        """How the drones move, as pieces."""
        return Motion.of(self.velocity)

    @cached_property
    def _samples(self) -> tuple[FloatArray, FloatArray]:
        """Velocities and accelerations on a grid from the launch's end, (k, 3) each."""
        times = np.arange(self.launch_end, self.duration, GRID)
        return (
            np.concatenate([path(times) for path in self.velocity]),
            np.concatenate([path(times) for path in self.acceleration]),
        )

    @cached_property
    def greatest_speed(self) -> float:
        """Greatest speed of any drone after the launch [m/s]."""
        return float(np.linalg.norm(self._samples[0], axis=1).max(initial=0.0))

    @cached_property
    def authority(self) -> Authority:
        """Greatest accelerations that the plan asks for after the launch."""
        push = self._samples[1]
        return Authority(
            float(np.linalg.norm(push[:, :2], axis=1).max(initial=0.0)),
            float(push[:, 2].max(initial=0.0)),
            float(-push[:, 2].min(initial=0.0)),
        )

    @cached_property
    def return_rate(self) -> float:
        """Rate at which the plan may be flown backwards.

        Half, and no faster up or down than the plan flies these ways forwards.
        """
        rise = self._samples[0][:, 2]
        up, down = float(rise.max(initial=0.0)), float(-rise.min(initial=0.0))
        if min(up, down) <= 0.0:
            return 0.5
        return min(0.5, up / down, down / up)

    def arducopter_needs(self) -> dict[str, float]:
        """Return the least values of ArduCopter's parameters that follow the plan.

        Names and units of ArduCopter 4.6: cm, cm/s, cm/s², hundredths of a degree;
        PSC_JERK in m/s³.
        """
        speed, push = self._samples
        level = float(np.linalg.norm(speed[:, :2], axis=1).max(initial=0.0))
        authority = self.authority
        upright = max(authority.up, authority.down)
        lift = np.maximum(STANDARD_GRAVITY + push[:, 2], 0.1)
        tilt = np.arctan2(np.linalg.norm(push[:, :2], axis=1), lift)
        needs = {
            "WPNAV_SPEED": 100.0 * level,
            "WPNAV_SPEED_UP": 100.0 * float(speed[:, 2].max(initial=0.0)),
            "WPNAV_SPEED_DN": -100.0 * float(speed[:, 2].min(initial=0.0)),
            "WPNAV_ACCEL": 100.0 * authority.level,
            "WPNAV_ACCEL_Z": 100.0 * upright,
            "ANGLE_MAX": 100.0 * float(np.degrees(tilt.max(initial=0.0))),
        }
        least = {name: float(np.ceil(ROOM * value)) for name, value in needs.items()}
        return least | {"PSC_JERK_XY": AUTOPILOT_JERK, "PSC_JERK_Z": AUTOPILOT_JERK}


def stream_plan(show: LoggedShow, drones: Sequence[int] | None = None) -> StreamPlan:
    """Return what ``drones`` (counting from 1; None: all) fly in a logged show.

    Raises
    ------
    UsageError
        If a drone is not in the show.
    """
    chosen = range(1, show.drones + 1) if drones is None else sorted(set(drones))
    for drone in chosen:
        if not 1 <= drone <= show.drones:
            raise UsageError(
                f"drone {drone} is not in the show of {show.drones}; drones count "
                "from 1"
            )
    states = [show.trajectory(drone - 1).state for drone in chosen]
    velocity = tuple(state.select([3, 4, 5]) for state in states)
    launches = [
        segment.start + segment.duration
        for segment in show.segments
        if segment.kind == "launch"
    ]
    landings = [segment.start for segment in show.segments if segment.kind == "land"]
    site = show.rules.site
    return StreamPlan(
        tuple(drone - 1 for drone in chosen),
        SiteFrame(site.latitude, site.longitude, site.altitude, site.heading),
        tuple(state.select([0, 1, 2]) for state in states),
        velocity,
        tuple(speed.derivative() for speed in velocity),
        max(launches, default=0.0),
        min(landings, default=show.duration),
        show.duration,
        float(show.rules.separation.distance),
    )


def authority_of(parameters: Mapping[str, float]) -> Authority:
    """Return what an ArduCopter with ``parameters`` follows."""
    upright = parameters["WPNAV_ACCEL_Z"] / 100.0
    return Authority(parameters["WPNAV_ACCEL"] / 100.0, upright, upright)
