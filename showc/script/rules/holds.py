"""Holds: motions that no drone can fly, or that lead out of what is allowed.

A motion is looked at in some of its places and at some instants. What is found is
impossible; what is not found may be so all the same, and compile proves it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, floor, inf
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import Diagnostic, Spot
from showc.script.fence import LEAST, TOLERANCE, Fence
from showc.script.formations.spacing import closest
from showc.script.lanes import (
    SHORTEST_MOTION,
    arrival,
    chapters,
    departure,
    ending,
    lanes,
    over,
    own_times,
)
from showc.script.language.wording import measured_text, number_text, point_text
from showc.script.moving import moving_places
from showc.script.rules.geometry import reached, wall_notes
from showc.script.rules.least_time import least_duration
from showc.script.show import Follow, Morph, Orbit, Rotate, Travel, Wave
from showc.vehicle.flatness import attitude_and_thrust

if TYPE_CHECKING:
    from collections.abc import Iterator

    from showc.arrays import FloatArray, IntArray
    from showc.script.moving import MovingPlaces
    from showc.script.sections.build import Sketch
    from showc.script.show import Show, Transition


_SHARES = 24
"""Instants in a period or ramp: a sine between two of them is 1 % higher at most."""
_INSTANTS = (40, 240)
"""Fewest and most instants of a hold: those of ten periods."""
_WATCHED = 60_000
"""Places times instants that are looked at in a script, as long as each motion has
its outermost places: a tenth of a second."""
_PAIRED, _MOMENTS, _FEWEST = 4_000, 480, 12
"""Places times instants whose distances are looked at for each motion, for the same
reason; instants for all motions of a script, and for one at least."""
_MOST = 48
"""Most instants for one motion: a sixth of a second in a hold of eight seconds."""
_ROUNDING = 1e-6
"""What counts as rounding: a share of limits and distances."""


@dataclass(frozen=True, slots=True)
class _Need:
    """What a motion asks for most, against what is allowed."""

    what: str
    unit: str
    value: float
    limit: float
    power: float
    """By which power of the time it shrinks where everything is slower."""
    place: int
    time: float

    @property
    def use(self) -> float:
        return self.value / self.limit


@dataclass(frozen=True, slots=True)
class _Fault:
    """What cannot be, what to do, and which places show it."""

    message: str
    help: str
    spot: Spot
    notes: tuple[str, ...] = ()


def motion_findings(sketch: Sketch) -> Iterator[Diagnostic]:
    """Yield the motions that cannot be flown as they are written (SHW217)."""
    show = sketch.show
    if show is None or not any(one.motion for one in show.transitions):
        return
    settings = sketch.ordered()
    motions = sum(bool(one.motion) for one in show.transitions)
    share, moments = _WATCHED // motions, _MOMENTS // motions
    for index, time, whole in longest_holds(show):
        transition = show.transitions[index]
        if not transition.motion:
            continue
        mark = settings[index].mark_of("motion")
        if time < SHORTEST_MOTION:
            yield Diagnostic(
                "SHW217",
                f"`{transition.to}` has a motion, but is held for only "
                f"{number_text(round(max(time, 0.0), 3))} s",
                mark,
                help=f"hold the formation for {SHORTEST_MOTION:g} s or more: a motion "
                "lasts as long as its hold",
            )
            continue
        flown = _Flown(show, transition, time, whole=whole)
        if found := flown.fault(share, min(max(moments, _FEWEST), _MOST)):
            yield Diagnostic(
                "SHW217",
                found.message,
                mark,
                notes=found.notes,
                help=found.help,
                spot=found.spot,
            )


def longest_holds(show: Show) -> Iterator[tuple[int, float, bool]]:
    """Transitions by index, how long each is held at most [s], whether just so long.

    Where the next one has a time of its own, it is held until then at the longest.
    """
    together = chapters(show)
    earliest = show.launch.altitude / show.launch.climb_speed + show.launch.hold
    asked = [
        {key: _first(show, members, key) for key in ("at", "start")}
        for members in together
    ]
    timed = any(set(one.values()) != {None} for one in asked)
    for number, members in enumerate(together):
        flown = [show.transitions[index] for index in members]
        if own_times(flown):
            after = together[number + 1 : number + 2]
            timed_after = any(show.transitions[k].timed for one in after for k in one)
            yield from _held_apart(show, members, flown, last=not timed_after)
            earliest = over(flown)
            continue
        own = asked[number]
        arrived = own["at"]
        if arrived is None:
            # Only a time that is asked for needs to know what is flown before it.
            least = least_duration(show, members[0])[0] if timed else 0.0
            arrived = max(earliest, own["start"] or 0.0) + least
        hold = longest = max(show.transitions[index].hold for index in members)
        following = asked[number + 1] if number + 1 < len(together) else {}
        if (start := following.get("start")) is not None:
            longest = start - arrived
        elif (at := following.get("at")) is not None:
            move = least_duration(show, together[number + 1][0])[0]
            longest = at - move - arrived
        whole = not following or set(following.values()) == {None}
        for index in members:
            yield index, longest, whole
        earliest = arrived + hold


def _held_apart(
    show: Show, members: list[int], flown: list[Transition], *, last: bool
) -> Iterator[tuple[int, float, bool]]:
    """Do the same for groups with times of their own: each until it leaves.

    ``last`` says that what follows has no time of its own.
    """
    for lane in lanes(flown):
        for at, after in zip(lane, [*lane[1:], None], strict=True):
            one, arrived = flown[at], arrival(flown[at])
            known = arrived is not None
            if arrived is None:
                least = least_duration(show, members[at])[0]
                arrived = (departure(one) or 0.0) + least
            if after is None:
                time, whole = one.hold, True
                if one.under_way[1] and known:
                    # Until what follows leaves, if that has no time of its own.
                    time, whole = ending(flown) - arrived, last
                yield members[at], time, whole
                continue
            leaves, there = departure(flown[after]), arrival(flown[after])
            if leaves is not None:
                yield members[at], leaves - arrived, known
            elif there is None:
                yield members[at], one.hold, True
            else:
                latest = there - least_duration(show, members[after])[0]
                yield members[at], latest - arrived, False


def _first(show: Show, members: list[int], key: str) -> float | None:
    found = (getattr(show.transitions[index], key) for index in members)
    return next((one for one in found if one is not None), None)


class _Flown:
    """One motion, as its places would fly it."""

    def __init__(
        self, show: Show, transition: Transition, time: float, *, whole: bool
    ) -> None:
        self.show = show
        self.time, self.whole = time, whole
        self.name = transition.to
        self.motion = transition.motion
        formation = show.formations[transition.to]
        self.points = formation.points
        everywhere = np.arange(len(self.points))
        self.moving: MovingPlaces = moving_places(
            everywhere, everywhere, formation, transition, show.formations
        )
        # The end of a hold whose length is not known is not looked at.
        until = time if whole else 0.5 * time
        ramps = [
            getattr(one, key)
            for one in self.motion
            if not isinstance(one, Travel | Morph)
            for key in ("ramp", "period")
            if not (key == "period" and isinstance(one, Rotate | Follow))
        ]
        few, most = _INSTANTS
        step = min([*ramps, 2.0 * time]) / _SHARES
        count = most if not ramps else min(max(ceil(until / step), few), most)
        self.instants = np.linspace(0.0, until, count + 1)

    def fault(self, share: int, moments: int) -> _Fault | None:
        """Say what cannot be, and what to do; None if nothing was found.

        Limits are looked at in a ``share`` of places times instants, distances at
        ``moments`` of the hold at most.
        """
        rows = self._outermost(max(share // self.instants.size, 0))
        states = self._states(rows, self.instants)
        return (
            self._beyond(rows, states)
            or self._unbalanced()
            or self._outside(rows, states)
            or self._beyond_fence(rows, states)
            or self._around(rows, states)
            or self._near(moments)
        )

    def _states(self, rows: IntArray, instants: FloatArray) -> FloatArray:
        """Position, velocity, acceleration, jerk, shape (4, instants, rows, 3) (SI)."""
        frames = tuple(
            frame if frame.shape[1] in {0, 1} else frame[:, rows]
            for frame in self.moving.frames
        )
        chosen = replace(
            self.moving, rows=rows, places=self.points[rows], frames=frames
        )
        return chosen.derivatives(self.time, instants)

    def _outermost(self, most: int) -> IntArray:
        """Return the places that are furthest out, and others up to ``most``."""
        corners = np.array(
            [[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
        )
        outer = np.argmax(self.points @ corners.T, axis=0)
        count = len(self.points)
        others = np.linspace(0, count - 1, min(most, count)).astype(np.int64)
        return np.unique(np.concatenate([outer, others]))

    def _beyond(self, rows: IntArray, states: FloatArray) -> _Fault | None:
        """Limits that places would break."""
        worst = max(self._needs(rows, states), key=lambda one: one.use)
        if worst.use <= 1.0 + _ROUNDING:
            return None
        slower, smaller = worst.use ** (1.0 / worst.power), _down(1.0 / worst.use)
        return _Fault(
            f"the motion of `{self.name}` needs "
            f"{measured_text(worst.value, worst.limit)} {worst.unit} of {worst.what}; "
            f"the limit is {measured_text(worst.limit)} {worst.unit}",
            f"multiply its times (`period`, `ramp`, `hold`) by {_up(slower)}"
            + f", or its size by {smaller}" * (float(smaller) > 0.0),
            Spot(self.name, (worst.place,)),
            (f"at place {worst.place + 1}, {worst.time:.1f} s into the hold",),
        )

    def _unbalanced(self) -> _Fault | None:
        """Places that rise or fall from rest where the motion is joined or left.

        Only with a limit of jerk: thrust would jump there.
        """
        for side, joined in enumerate(self.moving.under_way):
            if not (joined and self.whole and self.show.limits.jerk):
                continue
            _, speed, push, change = self.moving.ends(self.time)[side]
            still = np.abs(np.column_stack([speed, push[:, :2], change[:, :2]]))
            rises = (still.max(axis=1) < _ROUNDING) & (np.abs(push[:, 2]) > _ROUNDING)
            if rises.any():
                place = int(np.argmax(rises))
                return _Fault(
                    f"place {place + 1} of `{self.name}` starts to rise or fall from "
                    f"rest where its motion is {('joined', 'left')[side]}, which the "
                    "limit of jerk does not allow",
                    "make the hold a little longer or shorter",
                    Spot(self.name, (place,)),
                )
        return None

    def _needs(self, rows: IntArray, states: FloatArray) -> Iterator[_Need]:
        limits, vehicle = self.show.limits, self.show.vehicle
        _, speed, push, change = states

        def need(
            what: str, unit: str, used: FloatArray, limit: float, power: float
        ) -> _Need:
            instant, row = np.unravel_index(int(np.argmax(used)), used.shape)
            most = float(used[instant, row])
            when = float(self.instants[instant])
            return _Need(what, unit, most, limit, power, int(rows[row]), when)

        for axis, letter in enumerate("xyz"):
            along = speed[..., axis]
            most, least = limits.velocity_max[axis], limits.velocity_min[axis]
            yield need(f"speed along {letter}", "m/s", along, most, 1.0)
            yield need(f"speed along -{letter}", "m/s", -along, -least, 1.0)
        if limits.level_speed:
            level = np.hypot(speed[..., 0], speed[..., 1])
            yield need("level speed", "m/s", level, limits.level_speed, 1.0)
        if limits.acceleration:
            level = np.hypot(push[..., 0], push[..., 1])
            yield need("level acceleration", "m/s²", level, limits.acceleration, 2.0)
        if limits.acceleration_up:
            up = limits.acceleration_up
            yield need("upward acceleration", "m/s²", push[..., 2], up, 2.0)
        # Nothing falls faster than freely.
        down = limits.acceleration_down or vehicle.gravity
        yield need("downward acceleration", "m/s²", -push[..., 2], down, 2.0)
        if limits.jerk:
            jerk = np.linalg.norm(change, axis=-1)
            yield need("jerk", "m/s³", jerk, limits.jerk, 3.0)
        roll, pitch, thrust = attitude_and_thrust(vehicle, push, self.show.heading)
        tilt = np.degrees(np.maximum(np.abs(roll), np.abs(pitch)))
        tilt[push[..., 2] <= -vehicle.gravity] = 0.0
        yield need("tilt", "deg", tilt, float(np.degrees(limits.tilt)), 2.0)
        most = min(limits.thrust_max, vehicle.thrust_max)
        yield need("thrust", "N", thrust, most, 2.0)

    def _outside(self, rows: IntArray, states: FloatArray) -> _Fault | None:
        """Places that would leave the flight volume."""
        site = self.show.site
        low, high = map(np.array, site.walls)
        beyond = np.maximum(low - states[0], states[0] - high)
        instant, row, axis = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        if beyond[instant, row, axis] <= _ROUNDING:
            return None
        place = int(rows[row])
        if ((self.points[place] < low) | (self.points[place] > high)).any():
            # It stands outside already.
            return None
        value = states[0][instant, row, axis]
        above = value > high[axis]
        limit = high[axis] if above else low[axis]
        return _Fault(
            f"place {place + 1} of `{self.name}` leaves the flight volume "
            f"{self.instants[instant]:.1f} s into its motion: {'xyz'[axis]} is "
            f"{measured_text(float(value), float(limit))} m, "
            f"{'at most' if above else 'at least'} {number_text(float(limit))} m is "
            "allowed",
            "make the motion smaller, move the formation, or enlarge `site: volume:`",
            Spot(self.name, (place,)),
            wall_notes(site),
        )

    def _beyond_fence(self, rows: IntArray, states: FloatArray) -> _Fault | None:
        """Places that would leave the fence, or come nearer to it than its margin."""
        fence = Fence.of(self.show.site)
        if fence is None:
            return None
        level = states[0][..., :2]
        middle = 0.5 * (level.min(axis=0) + level.max(axis=0))
        radius = np.linalg.norm(level - middle, axis=2).max(axis=0)
        doubtful = fence.clearance(middle) - radius < fence.margin - TOLERANCE
        # What stands too near already is another finding's.
        doubtful &= fence.keeps(self.points[rows, :2])
        rows, places = rows[doubtful], states[0][:, doubtful]
        flat = places[..., :2].reshape(-1, 2)
        clearance = fence.clearance(flat).reshape(places.shape[:2])
        if clearance.min(initial=np.inf) >= fence.margin - TOLERANCE:
            return None
        instant, row = np.unravel_index(int(np.argmin(clearance)), clearance.shape)
        place, left = int(rows[row]), float(clearance[instant, row])
        moment = f"{self.instants[instant]:.1f} s into its motion"
        said = f"leaves the fence {moment}"
        if left >= LEAST:
            said = (
                f"comes within {measured_text(left, fence.margin)} m of the fence "
                f"{moment}; the margin is {number_text(fence.margin)} m"
            )
        return _Fault(
            f"place {place + 1} of `{self.name}` {said}",
            "make the motion smaller, or move the formation or the fence",
            Spot(self.name, (place,)),
            (f"it is at {point_text(places[instant, row])}",),
        )

    def _around(self, rows: IntArray, states: FloatArray) -> _Fault | None:
        """Places that would rise above the ceiling, over the audience or in walls."""
        site, places = self.show.site, states[0]
        stand = self.points[rows]
        instant, row = np.unravel_index(int(places[..., 2].argmax()), places.shape[:2])
        top = float(places[instant, row, 2])
        said = ""
        highest = inf if site.ceiling is None else site.ceiling + _ROUNDING
        if top > highest >= stand[:, 2].max():
            said = f"rises above the ceiling of {number_text(site.ceiling or 0.0)} m"
        flat = places.reshape(-1, 3)
        still = (met.any() for *_, met in reached(site, stand))
        for (where, _, name, met), there in zip(
            reached(site, flat), still, strict=True
        ):
            # What stands there already is another finding's.
            if not (said or there) and met.any():
                instant, row = np.unravel_index(int(met.argmax()), places.shape[:2])
                said = f"gets {where + 'to' * (where == 'in')} `{name}`"
        if not said:
            return None
        place = int(rows[row])
        return _Fault(
            f"place {place + 1} of `{self.name}` {said} "
            f"{self.instants[instant]:.1f} s into its motion",
            "make the motion smaller, or move the formation",
            Spot(self.name, (place,)),
            (f"it is at {point_text(places[instant, row])}",),
        )

    def _near(self, moments: int) -> _Fault | None:
        """Places that the motion would bring nearer than the separation."""
        separation = self.show.separation
        count = min(max(_PAIRED // len(self.points), 1), moments)
        instants = np.linspace(0.0, float(self.instants[-1]), count + 2)[1:-1]
        places = self._states(np.arange(len(self.points)), instants)[0]
        limit = separation.distance * (1.0 - _ROUNDING)
        if closest(self.points, limit, separation):
            # They stand too near already.
            return None
        found = [closest(points, limit, separation) for points in places]
        pairs = [(one.distance, at, one) for at, one in enumerate(found) if one]
        if not pairs:
            return None
        lags = any(isinstance(one, Orbit | Wave) for one in self.motion)
        longer = ", or give a longer `wavelength`" if lags else ""
        apart, at, pair = min(pairs, key=lambda one: one[:2])
        return _Fault(
            f"places {pair.first + 1} and {pair.second + 1} of `{self.name}` come "
            f"within {measured_text(apart, separation.distance)} m of each other "
            f"{instants[at]:.1f} s into its motion; the separation is "
            f"{number_text(separation.distance)} m",
            "make the formation larger or its motion smaller" + longer,
            Spot(self.name, (pair.first, pair.second)),
        )


def _up(factor: float) -> str:
    """Return a factor, rounded up to a hundredth."""
    return number_text(ceil(100.0 * factor) / 100.0)


def _down(factor: float) -> str:
    """Return a factor, rounded down to a hundredth."""
    return number_text(floor(100.0 * factor) / 100.0)
