"""A stage: a set of drones flies one straight leg each, released at one instant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from showc.autopilot import s_curve as law
from showc.autopilot.following import law_time, leg_overshoot, time_followed
from showc.autopilot.s_curve import fitting_speed, speed_for
from showc.geodesy import GlobalPoints, SiteFrame, autopilot_displacement

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.autopilot.parameters import Parameters
    from showc.autopilot.s_curve import LegLimits, LegProfile
    from showc.vehicle import Limits


SLOWEST_COMMAND = 0.15
"""Speeds that are commanded stay above this [m/s]: ArduPilot ignores any below 0.1."""

STEEP = 0.5
"""A leg whose direction has less than this horizontal part is steered by its vertical
speed."""

COMMAND_STEP = 1e-4
"""Commanded speeds are whole multiples of this [m/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """One straight leg of each of n drones, all released together."""

    drones: IntArray
    """The drones that fly, counting from 0, shape (n,)."""
    begin: FloatArray
    """Where from, shape (n, 3), show frame [m], on the mission's grid."""
    end: FloatArray
    """Where to, likewise."""
    stored: GlobalPoints
    """The ends as the mission stores them."""
    profile: LegProfile
    """How they fly."""
    level: FloatArray
    """Horizontal part of the direction, 0 to 1, shape (n,)."""
    climb: FloatArray
    """Vertical part of the direction, -1 to 1, shape (n,)."""
    by_climb: BoolArray
    """Drones steered by the vertical instead of the horizontal speed, shape (n,)."""
    command: FloatArray
    """Commanded horizontal or vertical speed, shape (n,) [m/s]."""
    wait: FloatArray
    """How long after the stage's release each one leaves, shape (n,), multiples of
    0.1 s [s]."""

    @property
    def duration(self) -> float:
        """Time from the release to the last arrival [s]."""
        return float((self.wait + self.profile.duration).max(initial=0.0))

    @property
    def followed(self) -> FloatArray:
        """Time from its own release until each one has followed its leg, (n,) [s]."""
        return time_followed(self.level, self.profile.duration)

    def finish(self, late: float | FloatArray = 0.0) -> float:
        """Time from the release until all have followed their legs [s].

        ``late`` [s], or (n,), is by how much they may be later than they most likely
        are.
        """
        time = time_followed(self.level, self.profile.duration + late)
        return float((self.wait + time).max(initial=0.0))

    def covered(self, since: FloatArray) -> FloatArray:
        """Parts (..., n) of the legs flown at ``since`` (..., n) the release [s]."""
        shape = np.broadcast_shapes(np.shape(since), self.wait.shape)
        own = np.atleast_2d(since - self.wait)
        ended = own >= self.followed
        part = ended.astype(np.float64)
        # Most instants of a show are before or after all of a stage.
        some = np.any((own > 0.0) & ~ended, axis=-1)
        if some.any():
            part[some] = self.profile.fraction(law_time(self.level, own[some]))
        return part.reshape(shape)

    @property
    def overshoot(self) -> FloatArray:
        """How far each one may fly beyond its end, shape (n,) [m]."""
        return leg_overshoot(self.level, self.profile.speed)

    @property
    def farthest(self) -> FloatArray:
        """Ends with the overshoot, shape (n, 3), show frame [m]."""
        length = np.where(self.profile.length > 0.0, self.profile.length, 1.0)
        along = self.end - self.begin
        return np.asarray(self.end + (self.overshoot / length)[:, None] * along)

    def part(self, some: IntArray) -> Stage:
        """Return the legs at the positions ``some``."""
        return replace(
            self,
            stored=self.stored.select(some),
            profile=self.profile.select(some),
            **{name: getattr(self, name)[some] for name in STAGE_ROWS},
        )

    def waiting(self, wait: FloatArray) -> Stage:
        """Return the same legs, leaving ``wait`` (n,) [s] after the release."""
        return replace(self, wait=wait)


STAGE_ROWS = ("drones", "begin", "end", "level", "climb", "by_climb", "command", "wait")
"""Attributes of a stage that are plain arrays, a row for each leg."""


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Straight legs of n drones that move, before it is said how long they take."""

    drones: IntArray
    """The drones that fly, counting from 0, shape (n,)."""
    begin: FloatArray
    """Where from, shape (n, 3), show frame [m], on the mission's grid."""
    end: FloatArray
    """Where to, likewise."""
    stored: GlobalPoints
    """The ends as the mission stores them."""
    limits: LegLimits
    """What the autopilot and the show allow along each leg."""
    fastest: FloatArray
    """Greatest cruise speed that each leg has room for, shape (n,) [m/s]."""
    shortest: FloatArray
    """Shortest time of each leg, shape (n,) [s]."""
    parameters: Parameters
    """The autopilot's."""

    @property
    def together(self) -> float:
        """Shortest time in which all of them can be flown [s]."""
        return float(self.shortest.max(initial=0.0))

    def part(self, some: IntArray) -> Lines:
        """Return the legs at the positions ``some``."""
        return replace(
            self,
            stored=self.stored.select(some),
            limits=self.limits.select(some),
            **{
                name: getattr(self, name)[some]
                for name in ("drones", "begin", "end", "fastest", "shortest")
            },
        )

    def lasting(self, duration: float | FloatArray) -> Stage:
        """Return the stage whose legs take ``duration`` [s], one for all or (n,).

        A leg that needs longer takes its shortest time; none is slower than
        autopilots heed.
        """
        level, climb = self.limits.level, self.limits.climb
        by_climb = level < STEEP
        steering = np.where(by_climb, np.abs(climb), level)
        wanted = np.maximum(duration, self.shortest)
        chosen = speed_for(
            self.limits,
            self.parameters,
            wanted,
            SLOWEST_COMMAND / steering,
            self.fastest,
        )
        command = _commanded(chosen * steering)
        cruise = np.minimum(command / steering, self.fastest)
        return Stage(
            self.drones,
            self.begin,
            self.end,
            self.stored,
            law.profile(self.limits, self.parameters, cruise),
            level,
            climb,
            by_climb,
            command,
            np.zeros(self.drones.size),
        )


@dataclass(frozen=True, slots=True, eq=False)
class StageBuilder:
    """What stages of one show have in common."""

    frame: SiteFrame
    """The show frame on the globe."""
    home_altitude: FloatArray
    """Altitude of each drone's home, shape (drones,) [m]."""
    parameters: Parameters
    """The autopilot's."""
    fastest: FloatArray | float = np.inf
    """Further limit of each drone's speed along its legs, shape (drones,) [m/s]."""

    def on_grid(
        self, drones: IntArray, points: FloatArray
    ) -> tuple[GlobalPoints, FloatArray]:
        """Round ``points`` (n, 3) [m] to the mission's grid: stored, and as places."""
        home = self.home_altitude[drones]
        stored = self.frame.round_points(points, home)
        return stored, self.frame.place(stored, home)

    def lines(
        self,
        drones: IntArray,
        begin: FloatArray,
        end: FloatArray,
        limits: Limits,
        *,
        speed: float = np.inf,
    ) -> Lines:
        """Return the straight legs of those drones that move.

        Parameters
        ----------
        drones
            Shape (n,). Those that do not move are left out.
        begin, end
            Shape (n, 3), show frame [m].
        limits
            Whose velocities hold.
        speed
            Further limit of the speed along the leg [m/s].
        """
        (found,) = self.ways(drones, [[begin, end]], limits, speed=speed)[0]
        return found

    def ways(
        self,
        drones: IntArray,
        stops: Sequence[Sequence[FloatArray]],
        limits: Limits,
        *,
        speed: float = np.inf,
    ) -> list[list[Lines]]:
        """Return straight legs from stop to stop, for several choices of stops.

        All are worked out at once, for a few drones take no longer than one: ``stops``
        holds the places (n, 3) [m] of each choice, as many as they are, the other
        parameters are those of :meth:`lines`.
        """
        places = [place for way in stops for place in way]
        stored, places_on_grid = self.on_grid(
            np.tile(drones, len(places)), np.concatenate(places)
        )
        rows = np.arange(len(places) * drones.size).reshape(len(places), -1)
        firsts = np.cumsum([0, *(len(way) for way in stops)])
        legs = [
            (rows[stop], rows[stop + 1])
            for first, last in pairwise(firsts.tolist())
            for stop in range(first, last - 1)
        ]
        froms, tos = (np.concatenate([leg[side] for leg in legs]) for side in (0, 1))
        start, goal = stored.select(froms), stored.select(tos)
        begin, end = places_on_grid[froms], places_on_grid[tos]
        moves = (
            (start.latitude != goal.latitude)
            | (start.longitude != goal.longitude)
            | (start.height != goal.height)
        )
        start, goal = start.select(moves), goal.select(moves)
        begin, end = begin[moves], end[moves]
        displacement = autopilot_displacement(start, goal, self.frame.latitude)
        allowed = np.minimum(_box_speed(end - begin, limits), speed)
        leg = law.leg_limits(displacement, self.parameters, allowed)
        whose = np.tile(drones, len(legs))[moves]
        most = np.broadcast_to(self.fastest, self.home_altitude.shape)[whose]
        fastest = np.minimum(fitting_speed(leg, self.parameters), most)
        shortest = law.profile(leg, self.parameters, fastest).duration
        every = Lines(whose, begin, end, goal, leg, fastest, shortest, self.parameters)
        number = np.repeat(np.arange(len(legs)), drones.size)[moves]
        parts = iter(
            [every.part(np.flatnonzero(number == leg)) for leg in range(len(legs))]
        )
        return [[next(parts) for _ in way[1:]] for way in stops]

    def build(
        self,
        drones: IntArray,
        begin: FloatArray,
        end: FloatArray,
        limits: Limits,
        *,
        duration: float = 0.0,
        speed: float = np.inf,
    ) -> Stage:
        """Return the stage that takes ``duration`` [s], or the shortest that may be.

        Where a drone needs longer, all take as long as it does; the other parameters
        are those of :meth:`lines`.
        """
        lines = self.lines(drones, begin, end, limits, speed=speed)
        return lines.lasting(max(duration, lines.together))


def flown(ways: Sequence[Lines], times: Sequence[float | FloatArray]) -> list[Stage]:
    """Return the stages that take so long [s]: one for all of a stage's legs or (n,).

    As :meth:`Lines.lasting` of each, all worked out at once.
    """
    if not ways:
        return []
    first = ways[0]
    limits = [lines.limits for lines in ways]
    every = Lines(
        np.concatenate([lines.drones for lines in ways]),
        np.concatenate([lines.begin for lines in ways]),
        np.concatenate([lines.end for lines in ways]),
        GlobalPoints.joined([lines.stored for lines in ways]),
        law.LegLimits.joined(limits),
        np.concatenate([lines.fastest for lines in ways]),
        np.concatenate([lines.shortest for lines in ways]),
        first.parameters,
    )
    sizes = [lines.drones.size for lines in ways]
    lasting = [
        np.broadcast_to(np.asarray(time, dtype=np.float64), size)
        for time, size in zip(times, sizes, strict=True)
    ]
    stage = every.lasting(np.concatenate(lasting))
    edges = np.cumsum([0, *sizes]).tolist()
    return [stage.part(np.arange(low, high)) for low, high in pairwise(edges)]


def _commanded(speed: FloatArray) -> FloatArray:
    """Return commands for speeds [m/s]: on their grid, and such as are heeded."""
    steps = np.floor(speed / COMMAND_STEP + 1e-6)
    return np.maximum(steps * COMMAND_STEP, SLOWEST_COMMAND)


def _box_speed(displacement: FloatArray, limits: Limits) -> FloatArray:
    """Greatest speed (n,) [m/s] along ``displacement`` (n, 3) inside the limits."""
    length = np.linalg.norm(displacement, axis=1)
    direction = displacement / np.where(length > 0.0, length, 1.0)[:, None]
    box = np.where(
        direction > 0.0, np.array(limits.velocity_max), np.array(limits.velocity_min)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(np.abs(direction) > 1e-9, box / direction, np.inf)
    return np.asarray(ratio.min(axis=1))
