"""The flight that the autopilots will really make, as a trajectory of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.autopilot.parameters import LAND_SLOW_HEIGHT, LAND_SLOW_SPEED
from showc.autopilot.s_curve import fitting_speed, leg_limits, profile
from showc.autopilot.takeoff import takeoff_risen, takeoff_times
from showc.autopilot.timing import CLOCK_LAG, LEAST_SPREAD, LIFT_OFF
from showc.autopilot.tracking import INSTANT
from showc.processes import side_by_side

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import ArrayLike

    from showc.arrays import FloatArray, IntArray
    from showc.autopilot.parameters import Parameters
    from showc.autopilot.stage import Stage
    from showc.flight import Encounter, Flight, LegFlight
    from showc.mission.clock import MissionClock
    from showc.schedule.timeline import ScheduledLeg, Timeline

    _Move = tuple[
        IntArray,
        FloatArray,
        FloatArray | float,
        Callable[[FloatArray], FloatArray],
    ]

CLOCK_LIKELY = 0.5 * CLOCK_LAG
"""How late the vehicles' clocks most likely are [s]."""

LAND_LEG_STRETCH = 1.44
"""Time over the law's own of the leg to the pad that ArduCopter flies before it sinks:
it leads from the height that the drone should have to the one that it has. Measured on
72 landings that were 1 to 6 cm off their heights: 0.78 to 1.15 s."""

OFF_HEIGHT = 2.3
"""How much farther off their heights drones landed than their legs were predicted to
leave them: 3 to 57 mm for 1 to 20 mm, on the same landings."""

SAME_HEIGHT = 0.002, 0.012
"""Heights are whole centimetres there: a drone that is less than the first off [m] has
no such leg, one that is more than the second has one; between, its time is shared."""

ROUNDED = 0.01
"""How far off its height a drone may be that is not known [m]: homes and heights are
whole centimetres. Drawn is the middle of the times that both ends give."""

LAND_RAMP = 0.55
"""Time constant of the speed of a landing [s]: drones without such a leg were 0.55 to
0.62 s later on their way down than the speed of the landing alone would make them."""

LAND_SLOWING = 0.28
"""How far above its height of slow landing ArduCopter slows down [m]: 1 m/s to 0.5 m/s
took 0.28 s longer than a change at that height would."""

ARRIVED = 0.3
"""A drone has arrived when it is this near its goal [m]."""

SAMPLES = 60
"""Instants per leg at which the prediction is held against the solved flight."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictedFlight:
    """Positions over mission time: where the drones most likely are.

    The lag of the vehicles' clocks is in the middle of its interval: timed legs begin
    late by half of it. A drone that has not settled at the end of a leg takes what it
    is off along with it.
    """

    timeline: Timeline
    """What is flown when."""
    parameters: Parameters
    """The autopilot's."""

    @property
    def duration(self) -> float:
        """Mission time at which the last drone is down [s]."""
        land = self.timeline.land
        height = land.begin[:, 2] - land.end[:, 2]
        slow = np.minimum(height, LAND_SLOW_HEIGHT + LAND_SLOWING)
        down = (height - slow) / self.parameters.descent_speed + slow / LAND_SLOW_SPEED
        end = self._landings()[land.drones] + down + LAND_RAMP
        return float(end.max(initial=0.0))

    def position(self, times: ArrayLike) -> FloatArray:
        """Show-frame positions (n, drones, 3) [m] at mission times (n,) [s].

        Take-off and landing are not timed; what they give here is nominal.
        """
        t = np.asarray(times, dtype=np.float64)[:, None]
        line = self.timeline
        place = np.broadcast_to(line.pads, (t.shape[0], *line.pads.shape)).copy()
        for drones, since, over, ways in self._moves(t):
            # Most stages are over, or have not begun, at most of these times.
            ended = np.all(since >= over, axis=1)
            moving = np.any(since >= -INSTANT, axis=1) & ~ended
            if ended.any():
                place[np.ix_(ended, drones)] += ways(since[ended][:1])
            if moving.any():
                place[np.ix_(moving, drones)] += ways(since[moving])
        land = line.land
        height = land.begin[:, 2] - land.end[:, 2]
        since = t - self._landings()[land.drones]
        place[:, land.drones, 2] -= descent(since, height, self.parameters)
        return place

    def _landings(self) -> FloatArray:
        """When each drone begins to sink, mission time, shape (drones,) [s].

        Its own last leg has ended, it has hovered, and flown the leg to its pad that
        ArduCopter flies before every landing.
        """
        line = self.timeline
        ended = np.full(line.pads.shape[0], line.staged)
        off = np.zeros(line.pads.shape[0])
        for scheduled in line.legs:
            for release, stage, track in scheduled.tracked:
                own = release + CLOCK_LIKELY + stage.wait + track.ended
                ended[stage.drones] = own
                left = track.along - track.places(track.ended + line.landing_pause)
                off[stage.drones] = OFF_HEIGHT * np.abs(left[:, 2])
        staying, until = line.waiting
        ended[staying] = until
        least, most = (
            self.pad_legs(np.maximum(off + by, 0.0)) for by in (-ROUNDED, ROUNDED)
        )
        return ended + line.landing_pause + 0.5 * (least + most)

    def pad_legs(self, off: FloatArray) -> FloatArray:
        """Return times (n,) [s] of the legs before landings of drones ``off`` (n,) [m].

        That is how far they are above or below the heights that they were to have.
        """
        some = np.maximum(off, SAME_HEIGHT[0])
        upright = some[:, None] * np.array([0.0, 0.0, 1.0])
        limits = leg_limits(upright, self.parameters, np.full(some.size, np.inf))
        speed = fitting_speed(limits, self.parameters)
        time = profile(limits, self.parameters, speed).duration
        share = np.interp(off, SAME_HEIGHT, (0.0, 1.0))
        return np.asarray(LAND_LEG_STRETCH * share * time)

    def _moves(self, times: FloatArray) -> Iterator[_Move]:
        """Stages in order: the drones, from when, till when, and how far they come.

        ``times`` (n, 1) [s].
        """
        line = self.timeline
        heights = line.takeoff.stored.height.tolist()
        took = takeoff_times(heights, self.parameters)
        follow = np.zeros(line.pads.shape[0])
        follow[line.takeoff.drones] = LIFT_OFF + took
        since = np.broadcast_to(times - LIFT_OFF, (len(times), took.size))
        climb = line.takeoff.end - line.takeoff.begin

        def rise(elapsed: FloatArray) -> FloatArray:
            part = takeoff_risen(heights, self.parameters, elapsed)
            return np.asarray(part[..., None] * climb)

        yield line.takeoff.drones, since, took, rise
        stage = line.staging
        since = times - follow[stage.drones]
        yield stage.drones, since, stage.followed, partial(_climbed, stage)
        for scheduled in line.legs:
            for release, stage, track in scheduled.tracked:
                since = times - release - CLOCK_LIKELY - stage.wait
                yield stage.drones, since, track.over, track.places


def descent(
    since: FloatArray, height: FloatArray, parameters: Parameters
) -> FloatArray:
    """Return how far landing drones have sunk, (n, m) [m].

    ``since`` (n, m) [s] they began to, from ``height`` (m,) [m]: at the speed of the
    landing, which they gain exponentially, and slowly near the ground.
    """
    slow = np.minimum(height, LAND_SLOW_HEIGHT + LAND_SLOWING)
    fast = parameters.descent_speed
    time = np.maximum(since, 0.0)
    steady = time - LAND_RAMP * -np.expm1(-time / LAND_RAMP)
    sunk = np.minimum(fast * steady, height - slow)
    late = np.maximum(steady - (height - slow) / fast, 0.0) * LAND_SLOW_SPEED
    return np.asarray(np.minimum(sunk + late, height))


def _climbed(stage: Stage, elapsed: FloatArray) -> FloatArray:
    """Ways (n, m, 3) [m] that the stage's drones have covered, ``elapsed`` (n, m)."""
    return stage.covered(elapsed)[..., None] * (stage.end - stage.begin)


def prediction_summary(
    flight: Flight,
    timeline: Timeline,
    clock: MissionClock,
    parameters: Parameters,
    jobs: int | None = 1,
) -> dict[str, Any]:
    """Return what the report and the manifest say about the predicted flight.

    Legs are looked at in ``jobs`` processes (None: one for each core), which changes
    nothing.
    """
    from showc.autopilot.parameters import FIRMWARE  # noqa: PLC0415

    legs = side_by_side(
        [partial(_leg_entry, scheduled) for scheduled in timeline.legs],
        jobs,
    )
    return {
        "firmware": FIRMWARE,
        "clock": clock.kind,
        "start": None if clock.start is None else clock.start.isoformat(),
        "start_minute": clock.minute if clock.start is None else None,
        "latest_mission_start": _latest(timeline),
        "duration": round(PredictedFlight(timeline, parameters).duration, 3),
        "delay": round(_typical_delay(timeline), 3),
        "delay_spread": LEAST_SPREAD,
        "clock_lag": CLOCK_LAG,
        "required_separation": flight.itinerary.show.separation.distance,
        "launch": _encounter(timeline.launch_closest),
        "legs": legs,
        "land": _encounter(timeline.land_closest),
        "land_start": round(timeline.land_start, 3),
    }


def _typical_delay(timeline: Timeline) -> float:
    """Median of what timed legs are late by, half the clocks' lag included [s]."""
    delays = [
        stage.followed - stage.profile.duration
        for leg in timeline.legs
        for stage in leg.encoding.stages
    ]
    # Where no drone moves, legs have no stages, or such of no drone.
    every = np.concatenate([*delays, np.zeros(0)])
    return (float(np.median(every)) if every.size else 0.0) + CLOCK_LIKELY


def _latest(timeline: Timeline) -> float | None:
    """Latest mission time at which a mission may be started and still make slot 1."""
    if not timeline.legs:
        return None
    first = min(leg.releases[0] for leg in timeline.legs)
    return round(first - timeline.staged, 3)


def _leg_entry(scheduled: ScheduledLeg) -> dict[str, Any]:
    """One leg of the summary."""
    late, solved = CLOCK_LIKELY, scheduled.move.flight
    assert solved is not None  # noqa: S101 - what is predicted was solved
    arrivals = arrival_times(scheduled, late)
    position, arrival = _difference(scheduled, solved, late, arrivals)
    closest = [
        _encounter(found, release)
        for found, release in zip(
            scheduled.encoding.closest, scheduled.releases, strict=True
        )
    ]
    near = [item for item in closest if item is not None]
    return {
        "leg": scheduled.leg.index,
        "name": scheduled.leg.name,
        "encoding": scheduled.encoding.name,
        "slots": [round(release, 3) for release in scheduled.releases],
        "durations": [round(stage.duration, 3) for stage in scheduled.encoding.stages],
        "slot": round(scheduled.releases[0], 3),
        "duration": round(scheduled.finish - scheduled.releases[0], 3),
        "optimal_start": round(scheduled.move.start, 3),
        "optimal_duration": round(scheduled.move.duration, 3),
        "drones": [int(drone) + 1 for drone in scheduled.leg.drones],
        "delays": [round(float(value), 3) for value in _delays(scheduled)],
        "arrivals": [round(float(value), 3) for value in arrivals],
        "ended": [round(float(value), 3) for value in _ended(scheduled)],
        "position_difference": [round(float(value), 3) for value in position],
        "arrival_difference": [round(float(value), 3) for value in arrival],
        "closest": min(near, key=lambda item: item["distance"]) if near else None,
    }


def _delays(scheduled: ScheduledLeg) -> FloatArray:
    """Delay (n,) [s] at the end of each drone's leg, 0 for one that rests."""
    found = np.zeros(scheduled.leg.drones.size)
    for _, stage in scheduled.flown:
        late = stage.followed - stage.profile.duration
        found[np.searchsorted(scheduled.leg.drones, stage.drones)] = late
    return found


def arrival_times(scheduled: ScheduledLeg, late: float) -> FloatArray:
    """Mission time [s] at which each drone of a leg first is within 0.3 m of its end.

    Shape (n,) in the order of the leg's drones; the first release for a drone that
    does not move. ``late`` [s] is the lag of the clocks.
    """
    found = np.full(scheduled.leg.drones.size, scheduled.releases[0])
    for release, stage, track in scheduled.tracked:
        near = track.near(ARRIVED)
        place = np.searchsorted(scheduled.leg.drones, stage.drones)
        found[place] = release + stage.wait + late + near
    return found


def _ended(scheduled: ScheduledLeg) -> FloatArray:
    """Mission time (n,) [s] at which each drone's autopilot takes the next item.

    Its own clock waits; the first release for a drone that does not move.
    """
    found = np.full(scheduled.leg.drones.size, scheduled.releases[0])
    for release, stage, track in scheduled.tracked:
        place = np.searchsorted(scheduled.leg.drones, stage.drones)
        found[place] = release + stage.wait + track.ended
    return found


def _difference(
    scheduled: ScheduledLeg, solved: LegFlight, late: float, arrivals: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Greatest distance and difference of arrival to the solved flight, per drone.

    Both are taken on the leg's own clock: release against the solved leg's start. A
    drone has arrived when it first is within 0.3 m of its goal: at the mission times
    ``arrivals`` (n,) [s] of the predicted flights.
    """
    drones = scheduled.leg.drones
    first = scheduled.releases[0]
    last = scheduled.releases[-1] - first
    span = max(last + scheduled.encoding.stages[-1].finish() + late, solved.duration)
    times = np.linspace(0.0, span, SAMPLES)
    wanted = np.stack(
        [part.state.select([0, 1, 2])(times) for part in solved.trajectories], axis=1
    )
    start, goal = wanted[0], scheduled.leg.goal
    fleet = int(drones.max()) + 1
    place = np.zeros((SAMPLES, fleet, 3))
    place[:, drones] = start
    for release, stage, track in scheduled.tracked:
        since = times[:, None] - (release - first) - late - stage.wait
        place[:, stage.drones] += track.places(since)
    difference = np.linalg.norm(place[:, drones] - wanted, axis=2).max(axis=0)
    moves = np.linalg.norm(goal - start, axis=1) > ARRIVED
    flown = np.where(moves, arrivals - first, 0.0)
    return difference, flown - _arrivals(times, wanted, goal)


def _arrivals(times: FloatArray, flown: FloatArray, goal: FloatArray) -> FloatArray:
    """Time of each drone's first entry into the ball around its goal [s]."""
    distance = np.linalg.norm(flown - goal, axis=2)
    inside = distance <= ARRIVED
    after = np.where(inside.any(axis=0), inside.argmax(axis=0), times.size - 1)
    before = np.maximum(after - 1, 0)
    column = np.arange(goal.shape[0])
    high, low = distance[before, column], distance[after, column]
    fall = np.where(high > low, high - low, 1.0)
    part = np.clip((high - ARRIVED) / fall, 0.0, 1.0)
    moment = times[before] + part * (times[after] - times[before])
    return np.where(after == 0, 0.0, moment)


def _encounter(found: Encounter | None, offset: float = 0.0) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "drones": [found.drone_a + 1, found.drone_b + 1],
        "time": round(found.time + offset, 3),
        "distance": round(found.distance, 3),
    }
