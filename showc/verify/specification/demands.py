"""What the script asks of a flight: its rules, its legs, its places and its light.

The legs of the log are walked through in their order, and each is held against the next
one that the script asks for. Where the script leaves a choice (which drone takes which
place, how long a move takes), the choice of the log is checked for being admissible,
and what follows is derived from it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.light.program import LightProgram, LightSpan
from showc.log import showc_pb2 as pb
from showc.verify.report import Check, Place
from showc.verify.specification.compare import differences, same
from showc.verify.specification.motion import FOLLOWED, astray, at_rest, held

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.script.show import Effect, Formation, Show, Transition
    from showc.vehicle import Limits
    from showc.verify.kernel.show import LoggedShow, Segment


GROUP = "script"

FORMAT_VERSION = 1
"""Version of the log's content that this verifier knows."""

MOMENT = 1e-6
"""Rounding of times [s]."""

PLACE_ERROR = 1e-9
"""How far a goal may be off its place: rounding, not flight [m]."""

ON_TIME = 0.01
"""How far an arrival or a departure may be off the time that the script asks for [s]:
a quarter of a frame of film."""

PARKED = -1
"""Place of a drone that waits in the parking formation."""

_SHAPES = {"sphere": 0, "ellipsoid": 1, "any-axis": 2, "all-axes": 3}
_KINDS = ("launch", "transition", "approach", "land", "hold", "motion")


@dataclass(slots=True)
class Demands:
    """What was found: differences in words, and what a viewer must show."""

    rules: tuple[str, ...] = ()
    """Differences of the rules."""
    legs: list[str] = field(default_factory=list)
    """Legs that the script does not ask for so."""
    places: list[str] = field(default_factory=list)
    """Goals that are not admissible."""
    times: list[str] = field(default_factory=list)
    """Arrivals and departures at other times than the script asks for."""
    motions: list[str] = field(default_factory=list)
    """Formations that do not move as they should while they are held."""
    lights: LightProgram | None = None
    """Light of the fleet; None if the legs are not those of the script."""

    def checks(self) -> list[Check]:
        """Return what was found as checks."""
        found = (
            ("VRF203", "rules are those of the script", self.rules),
            ("VRF204", "legs are those that the script asks for", self.legs),
            ("VRF205", "places are given out as the script allows", self.places),
            ("VRF206", "arrivals and departures when the script asks", self.times),
            ("VRF207", "formations move as the script says", self.motions),
        )
        return [
            Check(
                code,
                GROUP,
                name,
                "fail" if notes else "pass",
                where=Place(),
                notes=tuple(notes[:5]),
            )
            for code, name, notes in found
        ]


def hold_against(show: Show, logged: LoggedShow) -> Demands:
    """Compare rules and legs of a log with the script.

    Parameters
    ----------
    show
        What the script asks for.
    logged
        What the log claims.
    """
    demands = Demands()
    if logged.drones != show.drones:
        text = f"drones: the log has {logged.drones}, the script asks for {show.drones}"
        demands.rules = (text,)
        demands.legs.append("not looked at: the size of the fleet differs")
        return demands
    walk = _Walk(show, logged, demands)
    try:
        walk.run()
    except _StrayError as stray:
        demands.legs.append(str(stray))
    else:
        demands.lights = LightProgram(show.drones, logged.duration, tuple(walk.spans))
    # Of legs that went astray, the formations and limits so far.
    demands.rules = differences(
        logged.rules, _rules(show, walk.formations, walk.limits, logged.duration)
    )
    return demands


class _StrayError(Exception):
    """The legs of the log are not the script's; what follows cannot be known."""


class _Walk:
    """Goes through the legs of the log with the script beside it."""

    def __init__(self, show: Show, logged: LoggedShow, demands: Demands) -> None:
        self.show, self.logged, self.demands = show, logged, demands
        self.next = 0
        self.end = 0.0
        self.at = show.pads
        self.fleet = np.arange(show.drones)
        self.pads = np.array(show.formations[show.pads].points[: show.drones])
        self.position = self.pads
        self.colours = np.zeros((show.drones, 3))
        self.lit = np.zeros((show.drones, 3))
        self.parking = np.full(show.drones, PARKED)
        self.formations = {
            name: formation.points for name, formation in show.formations.items()
        }
        self.limits: list[pb.Limits] = []
        self.spans: list[LightSpan] = []
        self.placed: list[tuple[Transition, IntArray, IntArray]] = []
        self.carried = 0
        self.numbers = np.arange(show.drones)
        """Place of each drone in the formation that it last flew to."""

    def run(self) -> None:
        """Go from the pads to the pads."""
        show = self.show
        launch, landing = show.launch, show.landing
        up = self._raised(f"above {show.pads}", launch.altitude)
        climb = _limits(show.limits, launch.climb_speed)
        segment = self._leg("launch", "launch", up, climb)
        self._own(segment, self.formations[up])
        self._arrive(segment, np.zeros((show.drones, 3)))
        parts = _chapters(show)
        waits = [*(any(one.timed for one in chapter) for chapter in parts), False]
        self._hold("launch", launch.hold, grows=waits[0])
        for number, chapter in enumerate(parts, start=1):
            self._chapter(chapter, grows=waits[number])
        over = self._raised(f"above {show.pads} to land", landing.altitude)
        self._approach(over)
        self._hold("reaching the pads", landing.hold)
        segment = self._leg(
            "land", "land", show.pads, _limits(show.limits, landing.descent_speed)
        )
        # Straight down: the pad below.
        below = self.position - np.array([0.0, 0.0, landing.altitude])
        self._reach(segment, below)
        own = _one_to_one(segment.goals, self.pads)
        if own is None or not np.array_equal(segment.message.places, own):
            self._wrong(segment, "the places claimed are not the pads of the goals")
        self._arrive(segment, np.zeros((show.drones, 3)))
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
        there = (
            np.array_equal(self.position, points)
            if fixed
            else _one_to_one(self.position, points) is not None
        )
        if there:
            return
        segment = self._leg("approach", "approach to the pads", over, None)
        places = np.array(segment.message.places)
        if fixed:
            self._own(segment, points)
        elif sorted(places.tolist()) != self.fleet.tolist():
            self._wrong(segment, "two drones share a pad, or one has none")
        else:
            self._reach(segment, points[places])
        self._arrive(segment, np.zeros((self.show.drones, 3)))

    def _chapter(self, transitions: Sequence[Transition], *, grows: bool) -> None:
        """One transition of the fleet, or several of groups at once, and the hold."""
        first = transitions[0]
        name = " + ".join(one.name for one in transitions)
        times = [one.duration for one in transitions if one.duration is not None]
        duration = max(times) if times else None
        formation = self.show.formations[first.to]
        if first.group is None:
            segment = self._leg("transition", name, first.to, None, duration)
            places = self._whole(segment, first, formation)
            self.colours = _shown(first, formation, places)
        else:
            joined = self._unused(
                " + ".join(f"{one.group} in {one.to}" for one in transitions)
            )
            segment = self._leg("transition", name, joined, None, duration)
            self._groups(segment, transitions)
            self.formations[joined] = segment.goals
            self._own(segment, segment.goals)
        self._arrive(segment, self.colours, first.fade)
        self._on_time(segment, transitions)
        hold = max(one.hold for one in transitions)
        effect = first.effect or formation.effect
        if any(one.motion for one in transitions):
            self._moving(name, hold, effect, grows=grows)
        else:
            self._hold(name, hold, effect, grows=grows)

    def _on_time(self, segment: Segment, transitions: Sequence[Transition]) -> None:
        """Hold the times of a move against those that the script asks for."""
        for one in transitions:
            for asked, flown, what in (
                (one.start, segment.start, "starts"),
                (one.at, segment.end, "arrives"),
            ):
                if asked is not None and not abs(flown - asked) <= ON_TIME:
                    self.demands.times.append(
                        f"“{one.name}” {what} at {flown:.3f} s, the script asks for "
                        f"{asked:.3f} s"
                    )

    def _whole(
        self, segment: Segment, transition: Transition, formation: Formation
    ) -> IntArray:
        """Places of the whole fleet, checked."""
        self.parking[:] = PARKED
        places = self._given(segment, transition, formation, self.fleet)
        self.placed = [(transition, self.fleet, places)]
        if not np.array_equal(places, segment.message.places):
            self._wrong(segment, "the places claimed are not those of the goals")
        return places

    def _groups(self, segment: Segment, transitions: Sequence[Transition]) -> None:
        """Check the goals of each group; the others stay where they are."""
        others = np.ones(self.show.drones, dtype=bool)
        colours = self.colours.copy()
        self.placed = []
        for transition in transitions:
            members = np.asarray(self.show.groups[str(transition.group)])
            others[members] = False
            formation = self.show.formations[transition.to]
            self.parking[members] = PARKED
            places = self._given(segment, transition, formation, members)
            self.placed.append((transition, members, places))
            colours[members] = _shown(transition, formation, places)
        self._reach(segment, self.position, others)
        self.colours = colours

    def _given(
        self,
        segment: Segment,
        transition: Transition,
        formation: Formation,
        members: IntArray,
    ) -> IntArray:
        """Find the place of each member by its goal; those parked have none."""
        goals = segment.goals[members]
        points = formation.points
        spots = np.empty((0, 3))
        free = np.empty(0, dtype=np.int64)
        if members.size > len(points) and self.show.parking is not None:
            spots = self.show.formations[self.show.parking].points
            free = np.setdiff1d(np.arange(len(spots)), self.parking)
            spots = spots[free]
        places = np.arange(members.size)
        allowed = np.concatenate([points, spots])
        if transition.assignment == "keep":
            places = self.numbers[members]
            whole = np.array_equal(np.sort(places), np.arange(len(points)))
            if not whole or not _near(goals, points[places]):
                self._wrong(segment, "drones do not keep the numbers of their places")
        elif transition.assignment == "fixed":
            wanted = allowed[: members.size]
            if len(wanted) != members.size or not _near(goals, wanted):
                self._wrong(segment, "drones are not at the places of their numbers")
        else:
            found = _one_to_one(goals, allowed)
            if found is None:
                self._wrong(segment, "a goal is no place, or one place is taken twice")
            else:
                places = found
                if np.count_nonzero(found < len(points)) != len(points):
                    self._wrong(segment, "a place of the formation is left empty")
        outside = places >= len(points)
        if outside.any() and free.size:
            rank = np.minimum(places[outside] - len(points), free.size - 1)
            self.parking[members[outside]] = free[rank]
        given = np.where(outside, PARKED, places)
        self.numbers[members] = given
        return given

    def _leg(
        self,
        kind: str,
        name: str,
        to: str,
        limits: pb.Limits | None,
        duration: float | None = None,
    ) -> Segment:
        """Take the next leg of the log, which must be the one asked for."""
        if self.next >= len(self.logged.segments):
            raise _StrayError(f"the log lacks the leg “{name}”")
        segment = self.logged.segments[self.next]
        message = segment.message
        wanted = limits or _limits(self.show.limits)
        if wanted not in self.limits:
            self.limits.append(wanted)
        if message.kind != _KINDS.index(kind) or message.name != name:
            raise _StrayError(
                f"leg {self.next + 1} is “{message.name}”, the script asks for “{name}”"
            )
        facts = {
            f"it leaves “{message.from_formation}”": message.from_formation == self.at,
            f"it goes to “{message.to_formation}”": message.to_formation == to,
            f"it names limits {message.limits}": (
                message.limits == self.limits.index(wanted)
            ),
            f"it starts at {segment.start!r} s": same(
                segment.start, round(self.end, 3)
            ),
            f"it lasts {segment.duration!r} s": (
                duration is None or same(segment.duration, round(duration, 3))
            ),
        }
        self.demands.legs += [
            f"“{name}”: {text}, not as the script asks"
            for text, holds in facts.items()
            if not holds
        ]
        self.next += 1
        self.end = segment.end
        return segment

    def _hold(
        self,
        name: str,
        duration: float,
        effect: Effect | None = None,
        *,
        grows: bool = False,
    ) -> None:
        """Take a hold, which may last longer if it ``grows`` towards a given time."""
        title = f"hold after {name}"
        if duration <= 0.0 and not (grows and self._is_next(title)):
            return
        segment = self._leg("hold", title, self.at, None, None if grows else duration)
        self._lasts(segment, duration)
        self._reach(segment, self.position)
        self._same_places(segment)
        self._shine(segment, self.lit, "linear", effect)

    def _lasts(self, segment: Segment, least: float) -> None:
        if segment.duration < round(least, 3) - MOMENT:
            self.demands.legs.append(
                f"“{segment.message.name}” lasts {segment.duration!r} s, the script "
                f"asks for {least!r} s or more"
            )

    def _moving(
        self, name: str, duration: float, effect: Effect | None, *, grows: bool
    ) -> None:
        """Take a hold during which drones move, and look at where they are."""
        show, standing = self.show, np.ones(self.show.drones, dtype=bool)
        parts = []
        for transition, members, places in self.placed:
            if transition.motion:
                there = places != PARKED
                formation = show.formations[transition.to]
                moved = members[there]
                parts.append(
                    held(
                        transition.motion,
                        moved,
                        places[there],
                        formation,
                        show.formations,
                    )
                )
                standing[moved] = False
        to, goals = self.at, self.position.copy()
        if any(one.moves_on for one in parts):
            self.carried += 1
            to = f"{self.at} after motion {self.carried}"
            points = np.array(self.formations[self.at])
            before = np.array(self.logged.segments[self.next - 1].message.places)
            for one in parts:
                goals[one.drones] = one.at(np.ones(1), 1.0)[0]
                points[before[one.drones]] = goals[one.drones]
            self.formations[to] = points
        still = self.fleet[standing]
        parts.append(at_rest(still, self.position[still]))
        wanted = None if grows else duration
        segment = self._leg("motion", f"hold after {name}", to, None, wanted)
        self._lasts(segment, duration)
        self._reach(segment, goals)
        self._same_places(segment)
        off, drone = astray(segment, parts)
        if not off <= FOLLOWED:
            self.demands.motions.append(
                f"“{segment.message.name}”: drone {drone + 1} may be {off:.6f} m from "
                f"where the motion wants it, {FOLLOWED:g} m is allowed"
            )
        self.at, self.position = to, segment.goals
        self._shine(segment, self.lit, "linear", effect)

    def _is_next(self, name: str) -> bool:
        """Whether the next leg of the log is a hold of this name."""
        rest = self.logged.segments[self.next : self.next + 1]
        return any(one.message.name == name and one.holds for one in rest)

    def _own(self, segment: Segment, points: FloatArray) -> None:
        """Drone i takes place i."""
        if not np.array_equal(segment.message.places, self.fleet):
            self._wrong(segment, "drones are not at the places of their numbers")
        self._reach(segment, points)

    def _same_places(self, segment: Segment) -> None:
        """Places are those of the leg before."""
        before = self.logged.segments[self.next - 2].message.places
        if not np.array_equal(segment.message.places, before):
            self._wrong(segment, "drones change places without a move")

    def _reach(
        self, segment: Segment, wanted: FloatArray, who: BoolArray | None = None
    ) -> None:
        """Goals of drones (all, or those marked) are the places wanted."""
        chosen = slice(None) if who is None else who
        if not _near(segment.goals[chosen], wanted[chosen]):
            self._wrong(segment, "goals are not where the script puts them")

    def _arrive(
        self, segment: Segment, colours: FloatArray, fade: str = "linear"
    ) -> None:
        """Put the fleet where the leg ends, in its colours."""
        self.at = segment.message.to_formation
        self.position = segment.goals
        self.colours = colours
        self._shine(segment, colours, fade, None)

    def _shine(
        self, segment: Segment, end: FloatArray, fade: str, effect: Effect | None
    ) -> None:
        span = LightSpan(
            start=segment.start,
            duration=segment.duration,
            drones=self.fleet,
            begin=self.lit,
            end=end,
            fade=fade,
            effect=effect,
            places=segment.goals,
        )
        self.spans.append(span)
        self.lit = span.linear(np.array([span.duration]))[0]

    def _wrong(self, segment: Segment, text: str) -> None:
        self.demands.places.append(f"“{segment.message.name}”: {text}")


def _chapters(show: Show) -> list[list[Transition]]:
    """Transitions that are flown together: groups without a common drone."""
    result: list[list[Transition]] = []
    busy: set[int] = set()
    for transition in show.transitions:
        if transition.group is None:
            result.append([transition])
            busy = set(range(show.drones))
            continue
        members = set(show.groups[transition.group])
        if result and not busy & members:
            result[-1].append(transition)
            busy |= members
        else:
            result.append([transition])
            busy = members
    return result


def _shown(
    transition: Transition, formation: Formation, places: IntArray
) -> FloatArray:
    """Colours at places (n,); those parked are dark."""
    colours = formation.colours if transition.colours is None else transition.colours
    parked = places == PARKED
    return np.where(parked[:, None], 0.0, colours[np.where(parked, 0, places)])


def _near(found: FloatArray, wanted: FloatArray) -> bool:
    return bool(np.all(np.abs(found - wanted) <= PLACE_ERROR))


def _one_to_one(goals: FloatArray, allowed: FloatArray) -> IntArray | None:
    """Find the place of each goal; None unless each has one of its own."""
    # Places stand apart by the separation: sorting by rounded numbers pairs them.
    found = np.empty(len(goals), dtype=np.int64)
    for row, goal in enumerate(goals):
        near = np.flatnonzero(np.all(np.abs(allowed - goal) <= PLACE_ERROR, axis=1))
        if near.size != 1:
            return None
        found[row] = near[0]
    return found if np.unique(found).size == found.size else None


def _vector(values: Sequence[float]) -> pb.Vector3:
    x, y, z = (float(value) for value in values)
    return pb.Vector3(x=x, y=y, z=z)


def _limits(limits: Limits, vertical: float = np.inf) -> pb.Limits:
    """Limits of a leg that neither climbs nor sinks faster than ``vertical`` [m/s].

    Launch and landing have such a limit: they are upright, so that x and y are held.
    """
    down, up = limits.velocity_min[2], limits.velocity_max[2]
    return pb.Limits(
        velocity_min=_vector((*limits.velocity_min[:2], max(down, -vertical))),
        velocity_max=_vector((*limits.velocity_max[:2], min(up, vertical))),
        tilt=limits.tilt if np.isinf(vertical) else 0.0,
        body_rate=_vector(limits.body_rate),
        thrust_min=limits.thrust_min,
        thrust_max=limits.thrust_max,
        torque_max=_vector(limits.torque_max),
        position_min=_vector(limits.position_min),
        position_max=_vector(limits.position_max),
        level_speed=limits.level_speed,
        acceleration=limits.acceleration,
        acceleration_up=limits.acceleration_up,
        acceleration_down=limits.acceleration_down,
    )


def _rules(
    show: Show,
    formations: dict[str, FloatArray],
    limits: list[pb.Limits],
    duration: float,
) -> pb.Rules:
    """Return the rules that a log of the show must carry."""
    site, vehicle, separation = show.site, show.vehicle, show.separation
    fence = [] if site.fence is None else np.asarray(site.fence).ravel().tolist()
    return pb.Rules(
        format_version=FORMAT_VERSION,
        name=show.name,
        drones=show.drones,
        duration=duration,
        site=pb.Site(
            latitude=site.latitude,
            longitude=site.longitude,
            altitude=site.altitude,
            heading=site.heading,
            volume_min=_vector(site.volume_min),
            volume_max=_vector(site.volume_max),
            fence=fence,
            fence_margin=site.fence_margin,
        ),
        vehicle=pb.Vehicle(
            name=vehicle.name,
            mass=vehicle.mass,
            arm_length=vehicle.arm_length,
            thrust_coefficient=vehicle.thrust_coefficient,
            torque_coefficient=vehicle.torque_coefficient,
            inertia=_vector(vehicle.inertia),
            rotor_speed_max=vehicle.rotor_speed_max,
            gravity=vehicle.gravity,
            torque_factor=vehicle.torque_factor,
        ),
        separation=pb.Separation(
            distance=separation.distance,
            shape=pb.Separation.Shape.Name(_SHAPES[separation.shape]),
            vertical_stretch=separation.vertical_stretch,
        ),
        yaw_held=show.yaw == "held",
        heading=show.heading,
        log_rate=show.log_rate,
        formations=[
            pb.Formation(name=name, points=np.asarray(points).ravel().tolist())
            for name, points in formations.items()
        ],
        limits=limits,
    )
