"""The draft: a show as a scene before it is solved, moves as straight lines.

Drones that arrive or leave in motion are drawn on cubics with those velocities.

Every drone of a move follows one profile along its straight line. Its time is that of
the quickest such flight of the drones with the longest ways (an estimate: nothing is
proved of it, and drones may pass too near). What has been solved takes its place.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.fleet.leg import aircraft_of
from showc.fleet.shared_profile.profile import Profile
from showc.fleet.shared_profile.synchronise import ROUGHLY, SHAPES, least_times
from showc.fleet.single_drone.vertical import quickest_ascent
from showc.fleet.timetable import scheduled, settled
from showc.flight import Flight
from showc.light.program import LightProgram
from showc.log.sampling import FleetSampler
from showc.plan.assignment import assign, nearest_on_lines
from showc.plan.build import build_itinerary
from showc.plan.itinerary import STILL
from showc.vehicle.metric import scaled
from showc.view.overview import box_of
from showc.view.scene import (
    Chapter,
    Ground,
    GroupMove,
    Meeting,
    Scene,
    Signal,
    Soundtrack,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from showc.arrays import FloatArray
    from showc.flight import LegFlight
    from showc.plan.assignment import Assignment
    from showc.plan.itinerary import Itinerary, Leg
    from showc.script.show import Show
    from showc.vehicle import Separation

RATE = 10.0
"""Frames a second of a small show [Hz]."""
FRAME_BUDGET = 250_000
"""Greatest number of positions (frames x drones): 1 s is to be enough for a change."""
_STILL = 1e-9
"""Time that is rounding [s]."""
_INSTANT = 1e-3
"""Least time of a move [s]: drones may come to rest on the spot."""
_LONGEST = 3
"""Drones of the longest ways, and of the longest along each axis, that set a time."""
_EVERY = 7
"""Of the profiles' shapes, every so-manyth is tried: of all phases and ramps some."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """How far all drones of a move are, over its time."""

    times: FloatArray
    """Shape (k,) [s], increasing from 0."""
    shares: FloatArray
    """Of the way, shape (k,)."""

    @property
    def duration(self) -> float:
        """Time of the whole [s]."""
        return float(self.times[-1])

    def share(self, elapsed: FloatArray, duration: float) -> FloatArray:
        """Share of the way at times since the start, if it takes ``duration`` [s]."""
        scale = self.duration / duration if duration > 0.0 else 1.0
        return np.interp(elapsed * scale, self.times, self.shares)


_STANDING = Course(np.zeros(1), np.ones(1))


class Memory:
    """What was worked out for the last drafts, so that a save changes little.

    All of it depends on its arguments alone; what two drafts in a row did not use is
    forgotten.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[object, ...], Any] = {}
        self._used: set[tuple[object, ...]] = set()

    def turn(self) -> None:
        """Begin another draft."""
        self._known = {key: self._known[key] for key in self._used}
        self._used = set()

    def recall(self, key: tuple[object, ...], make: Callable[[], Any]) -> Any:  # noqa: ANN401
        """Return what belongs to a key, made if it is not known."""
        if key not in self._known:
            self._known[key] = make()
        self._used.add(key)
        return self._known[key]


@dataclass(frozen=True, slots=True, eq=False)
class Draft:
    """A show laid out in time."""

    show: Show
    itinerary: Itinerary
    """Legs with the times that the script asks for."""
    starts: tuple[float, ...]
    """Show time of the start of each leg [s]."""
    durations: tuple[float, ...]
    """[s]."""
    courses: tuple[Course, ...]
    """Of each leg."""
    moves: Mapping[int, tuple[Course, ...]]
    """Of each part of the legs, by position, whose groups have times of their own."""
    solved: Mapping[int, LegFlight] = field(default_factory=dict)
    """Flights of legs, by index in the itinerary."""

    @property
    def duration(self) -> float:
        """Length of the show [s]."""
        return self.starts[-1] + self.durations[-1]


def lay_out(
    show: Show, memory: Memory, find: Callable[[Leg], LegFlight | None] | None = None
) -> Draft:
    """Lay a show out in time.

    Parameters
    ----------
    show
        As far as the script could be read.
    memory
        Of former drafts.
    find
        Returns the flight of a leg that is solved; None: no leg is.

    Raises
    ------
    PlanError
        If places and drones do not fit.
    SolveError
        If a time of the script cannot be met.
    """
    memory.turn()

    def optimal(
        start: FloatArray,
        goals: FloatArray,
        separation: Separation,
        *,
        required: int | None = None,
    ) -> Assignment:
        key = ("places", start.tobytes(), goals.tobytes(), separation, required)
        found: Assignment = memory.recall(
            key, lambda: assign(start, goals, separation, required=required)
        )
        return found

    planned = settled(build_itinerary(show, optimal=optimal))
    known = {} if find is None else {leg.index: find(leg) for leg in planned.legs}
    times = {}
    for leg in planned.legs:
        if leg.open:
            flight = known.get(leg.index)
            course = _course(leg, planned.show, memory)
            time = course.duration if flight is None else flight.duration
            times[leg.index] = max(round(time, 3), _INSTANT)
    itinerary = scheduled(planned, times)
    opened = iter(times.values())
    starts, durations, clock = [], [], 0.0
    for leg in itinerary.legs:
        time = leg.duration if leg.duration is not None else next(opened)
        starts.append(clock)
        durations.append(time)
        clock = round(clock + time, 3)
    flights = {} if find is None else {leg.index: find(leg) for leg in itinerary.legs}
    return Draft(
        show=itinerary.show,
        itinerary=itinerary,
        starts=tuple(starts),
        durations=tuple(durations),
        courses=tuple(_course(leg, itinerary.show, memory) for leg in itinerary.legs),
        moves={
            number: tuple(_course(part, itinerary.show, memory) for part in leg.parts)
            for number, leg in enumerate(itinerary.legs)
        },
        solved={index: one for index, one in flights.items() if one is not None},
    )


def _course(leg: Leg, show: Show, memory: Memory) -> Course:
    """Return the profile of a move along straight lines."""
    way = leg.goal - leg.start
    if leg.motion or leg.parts or not (np.linalg.norm(way, axis=1) > STILL).any():
        return _STANDING
    key = ("course", way.tobytes(), leg.kind, leg.limits, show.vehicle, show.heading)
    found: Course = memory.recall(key, lambda: _flown(leg, show, way))
    return found


def _flown(leg: Leg, show: Show, way: FloatArray) -> Course:
    if leg.kind in {"launch", "land"}:
        ascent = quickest_ascent(aircraft_of(show, leg), way[:, 2])
        times = np.linspace(0.0, ascent.duration, 101)
        return Course(times, ascent.derivatives()[0](times)[:, 0])
    rows = _telling(way)
    shapes = SHAPES[::_EVERY]
    least = least_times(
        show.vehicle, leg.limits, show.heading, way[rows], shapes, ROUGHLY
    ).max(axis=0)
    best = int(np.argmin(least))
    phase, ramp = shapes[best]
    time = float(least[best])
    profile = Profile(time, float(phase) * time, float(ramp) * time)
    times = np.linspace(0.0, profile.duration, 101)
    return Course(times, profile.derivatives()[0](times)[:, 0])


def _telling(way: FloatArray) -> FloatArray:
    """Return the rows of the moves that are likely to need most time, (m,)."""
    measures = [np.linalg.norm(way, axis=1), way[:, 2], -way[:, 2]]
    measures += [np.abs(way[:, 0]), np.abs(way[:, 1])]
    tops = [np.argsort(-one, kind="stable")[:_LONGEST] for one in measures]
    return np.unique(np.concatenate(tops))


def scene_of(draft: Draft, memory: Memory) -> Scene:
    """Return what a page draws of a draft."""
    show = draft.show
    count = max(2, min(int(draft.duration * RATE), FRAME_BUDGET // show.drones))
    step = draft.duration / count
    times = step * np.arange(count + 1)
    positions = np.empty((count + 1, show.drones, 3))
    for number, start in enumerate(draft.starts):
        time = draft.durations[number]
        inside = (times >= start - _STILL) & (times <= start + time + _STILL)
        elapsed = np.clip(times[inside] - start, 0.0, time)
        positions[inside] = _places(draft, number, elapsed)
    light = LightProgram.over(show, draft.itinerary.legs, draft.starts, draft.durations)
    speed = np.zeros((count + 1, show.drones))
    speed[1:] = np.linalg.norm(np.diff(positions, axis=0), axis=-1) / step
    site = show.site
    fence = site.fence
    if fence is None:
        fence = box_of(site.volume_min, site.volume_max)
    return Scene(
        name=show.name,
        duration=draft.duration,
        step=step,
        positions=positions,
        colours=light.srgb(times),
        chapters=tuple(_chapters(draft)),
        ground=Ground(
            fence=np.asarray(fence),
            floor=site.volume_min[2],
            ceiling=site.volume_max[2],
            pads=show.formations[show.pads].points[: show.drones],
            heading=site.heading,
            separation=show.separation.distance,
            metric=scaled(np.ones((1, 3)), show.separation)[0],
        ),
        encounters=_meetings(draft, memory),
        signals=(Signal("Speed", "m/s", 2, speed),),
        signal_step=step,
        soundtrack=Soundtrack.of(show.music),
    )


def _places(draft: Draft, number: int, elapsed: FloatArray) -> FloatArray:
    """Positions (T, drones, 3) [m] at times since a leg's start (T,) [s]."""
    leg, time = draft.itinerary.legs[number], draft.durations[number]
    flight = draft.solved.get(leg.index)
    if flight is not None and elapsed.size:
        alone = Flight(draft.itinerary, (flight,), np.zeros(1))
        return FleetSampler(alone)(np.minimum(elapsed, flight.duration))[0][..., :3]
    if not leg.parts:
        return _along(leg, draft.courses[number], elapsed, time)
    places = np.repeat(leg.start[None], elapsed.size, axis=0)
    for part, course in zip(leg.parts, draft.moves[number], strict=True):
        since = elapsed - ((part.depart or 0.0) - (leg.depart or 0.0))
        least, most = np.flatnonzero(since > 0.0), part.duration or 0.0
        moved = _along(part, course, np.clip(since[least], 0.0, most), most)
        places[np.ix_(least, part.drones)] = moved
    return places


def _along(leg: Leg, course: Course, elapsed: FloatArray, time: float) -> FloatArray:
    """Positions (T, n, 3) [m] of a leg's drones that all move in its time [s]."""
    if leg.motion:
        places = np.repeat(leg.start[None], elapsed.size, axis=0)
        for one in leg.motion:
            places[:, one.rows] = one.derivatives(time, elapsed)[0]
        return places
    if leg.in_motion:
        return _in_motion(leg, elapsed, time)
    share = course.share(elapsed, time)[:, None, None]
    return np.asarray(leg.start + share * (leg.goal - leg.start))


def _in_motion(leg: Leg, elapsed: FloatArray, time: float) -> FloatArray:
    """Positions (T, drones, 3) [m] on cubics that have the velocities at both ends."""
    begin, end = (
        np.zeros_like(leg.start) if state is None else time * state[:, 3:6]
        for state in (leg.start_state, leg.goal_state)
    )
    u = (elapsed / max(time, _STILL))[:, None, None]
    # Cubic Hermite interpolation by its Bernstein form.
    return np.asarray(
        (1.0 - u) ** 3 * leg.start
        + 3.0 * u * (1.0 - u) ** 2 * (leg.start + begin / 3.0)
        + 3.0 * u**2 * (1.0 - u) * (leg.goal - end / 3.0)
        + u**3 * leg.goal
    )


def _chapters(draft: Draft) -> list[Chapter]:
    labels = {"launch": "launch", "approach": "to the pads", "land": "land"}
    found = []
    for leg, start, time in zip(
        draft.itinerary.legs, draft.starts, draft.durations, strict=True
    ):
        found.append(
            Chapter(
                name=leg.name.replace("->", "→"),
                label=labels.get(leg.kind) or held_formation(leg) or leg.to_formation,
                kind=leg.kind,
                start=start,
                duration=time,
                picture=held_formation(leg),
                state="solved" if leg.index in draft.solved else "straight",
                moves=tuple(
                    GroupMove.of(
                        part.name,
                        draft.show.transitions[part.transition or 0].group or "",
                        (part.depart or 0.0, part.duration or 0.0),
                        part.to_formation,
                        held=part.kind == "motion",
                    )
                    for part in leg.parts
                ),
            )
        )
    return found


def held_formation(leg: Leg) -> str:
    """Return the name of the formation that stands or moves while held, or nothing."""
    # What a moving formation becomes has a name of its own.
    return {"hold": leg.to_formation, "motion": leg.from_formation}.get(leg.kind, "")


def _meetings(draft: Draft, memory: Memory) -> tuple[Meeting, ...]:
    """Nearest pair of every move along straight lines."""
    separation, found = draft.show.separation, []
    for number, leg in enumerate(draft.itinerary.legs):
        course = draft.courses[number]
        if course is _STANDING or leg.in_motion or leg.index in draft.solved:
            continue  # what arrives or leaves in motion flies no straight line
        key = ("meeting", leg.start.tobytes(), leg.goal.tobytes(), separation)
        pair = memory.recall(
            key, partial(nearest_on_lines, leg.start, leg.goal, separation)
        )
        if pair is None:
            continue
        share = float(np.interp(pair.share, course.shares, course.times))
        time = draft.starts[number] + share / course.duration * draft.durations[number]
        found.append((pair, time))
    least = min((pair.distance for pair, _ in found), default=0.0)
    return tuple(
        Meeting(one.first, one.second, time, one.distance, one.distance == least)
        for one, time in found
    )
