"""What a crowd would fly, what it may fly, and how readily it is changed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.fleet.shared_profile.profile import Profile
    from showc.fleet.single_drone.model import Aircraft
    from showc.script.fence import Fence
    from showc.vehicle import Separation


_SAMPLES = 0.15
"""Time between samples [s]. Between them, motion counts as straight."""
_CLOSER = (0.25, 0.5)
"""Where there are more within the first and the last of them, as shares: there a pair
that stands at the separation may draw nearer before it comes to rest."""
_LEAST_LIFT = 0.1
"""Thrust over the weight that is added, at right angles, where it turns the drone: what
has no thrust has no direction."""
_FALLING = 0.6
"""Share of gravity with which a drone is thought to fall: with less lift it hardly
turns. A guess, which the flights themselves correct."""


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Half-spaces ``normal . x >= offset`` for drones at instants, p of them."""

    drone: IntArray
    """Shape (p,)."""
    instant: IntArray
    """Shape (p,)."""
    normal: FloatArray
    """Shape (p, 3)."""
    offset: FloatArray
    """Shape (p,) [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Allowed:
    """Limits as half-spaces ``normal . v >= offset``, f of them, and as discs."""

    order: IntArray
    """Of what: 0 places, 1 velocities, 2 accelerations; shape (f,)."""
    normal: FloatArray
    """Shape (f, 3)."""
    offset: FloatArray
    """Below zero for all but places, shape (f,), SI."""
    level: tuple[float, float, float, float]
    """Greatest level size of each order and of jerk, infinite if there is none, SI."""
    gravity: float
    """[m/s²]."""
    left: FloatArray
    """To the left of the heading, shape (3,)."""
    rates: tuple[float, float]
    """Greatest rates of roll and pitch [rad/s]."""

    @classmethod
    def of(cls, aircraft: Aircraft) -> Allowed:
        """Return what an aircraft's limits allow.

        Tilt limits accelerations along and across the heading, the more the less the
        drone lifts; of the vertical ones, thrust aside, the present limits count.
        """
        order, normal, offset = [], [], []
        limits, gravity = aircraft.limits, aircraft.vehicle.gravity
        thrust = min(limits.thrust_max, aircraft.vehicle.thrust_max)
        climb = thrust / aircraft.vehicle.mass * np.cos(limits.tilt) - gravity
        fall = min(limits.acceleration_down or np.inf, _FALLING * gravity)
        climb = min(limits.acceleration_up or np.inf, climb)
        boxes = (
            (limits.position_min, limits.position_max),
            (limits.velocity_min, limits.velocity_max),
            ((-np.inf, -np.inf, -fall), (np.inf, np.inf, climb)),
        )
        for number, box in enumerate(boxes):
            for sign, bounds in zip((1.0, -1.0), box, strict=True):
                for axis in np.nonzero(np.isfinite(bounds))[0].tolist():
                    order.append(number)
                    normal.append(sign * np.eye(3)[axis])
                    offset.append(sign * bounds[axis])
        tangent = float(np.tan(limits.tilt))
        ahead = np.array([np.cos(aircraft.heading), np.sin(aircraft.heading), 0.0])
        left = np.array([-ahead[1], ahead[0], 0.0])
        roll, pitch = limits.body_rate[:2]
        for side in (ahead, -ahead, left, -left):
            order.append(2)
            normal.append(side + tangent * np.eye(3)[2])
            offset.append(-tangent * gravity)
        speed = limits.level_speed if limits.rounds_speed else np.inf
        return cls(
            np.array(order),
            np.array(normal),
            np.array(offset),
            (np.inf, speed, limits.acceleration or np.inf, limits.jerk or np.inf),
            gravity,
            left,
            (roll, pitch),
        )

    def turning(self, pulls: FloatArray, jerks: FloatArray) -> FloatArray:
        """Shares (...) of the lesser of these rates that no rate of theirs passes.

        Roll's is at most |j| / |f|, pitch's at most |j| / |l x f|, which is less.
        """
        force = pulls + np.array([0.0, 0.0, self.gravity])
        across = np.einsum("...a,...a->...", force, force)
        across += (_LEAST_LIFT * self.gravity) ** 2 - (force @ self.left) ** 2
        square = np.einsum("...a,...a->...", jerks, jerks) / across
        return np.asarray(np.sqrt(square) / min(self.rates))

    def turned(
        self, pulls: FloatArray, jerks: FloatArray
    ) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """Shares of the greatest rates that accelerations and jerks (..., 3) take.

        With f the thrust over the mass, l to the left of the heading and yaw held, roll
        is -asin(f . l / |f|) and pitch the angle of f about l. Their rates are
        (j . f f . l - j . l f²) / (f² |l x f|) and j . (l x f) / |l x f|².

        Yields
        ------
        tuple
            Of roll, then of pitch: the share (...), how it changes with accelerations
            and how with jerks, each (..., 3).
        """
        left, (x, y, z) = self.left, self.left
        across_left = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        force = pulls + np.array([0.0, 0.0, self.gravity])
        square = np.einsum("...a,...a->...", force, force)[..., None]
        square += (_LEAST_LIFT * self.gravity) ** 2
        aside, jerk_aside = force @ left[:, None], jerks @ left[:, None]
        level = force - aside * left
        across = np.sqrt(square - aside * aside)
        along = np.einsum("...a,...a->...", jerks, force)[..., None]
        turned = force @ across_left
        parts = (
            (
                along * aside - jerk_aside * square,
                jerks * aside + along * left - 2.0 * jerk_aside * force,
                force * aside - left * square,
                square * across,
                2.0 * force * across + square * level / across,
            ),
            (
                np.einsum("...a,...a->...", jerks, turned)[..., None],
                -(jerks @ across_left),
                turned,
                across * across,
                2.0 * level,
            ),
        )
        for rate, (size, by_pull, by_jerk, over, over_by_pull) in zip(
            self.rates, parts, strict=True
        ):
            share = size / over
            change = (by_pull - share * over_by_pull) / (over * rate)
            yield share[..., 0] / rate, change, by_jerk / (over * rate)


@dataclass(frozen=True, slots=True, eq=False)
class Crowd:
    """Flights that each drone would fly alone, and how far they may be changed."""

    times: FloatArray
    """Instants, as of :func:`sampled`, shape (m,) [s]."""
    places: FloatArray
    """Positions there, shape (n, m, 3) [m]."""
    speeds: FloatArray
    """Velocities there, shape (n, m, 3) [m/s]."""
    pulls: FloatArray
    """Accelerations there, shape (n, m, 3) [m/s²]."""
    jerks: FloatArray
    """Their rates there, shape (n, m, 3) [m/s³]."""
    duration: float
    """[s]."""
    intervals: int
    """Of the changes' splines, at least 6."""
    separation: Separation
    give: FloatArray
    """How readily each drone is moved, and to which side, symmetric, (n, 3, 3)."""
    hovers: BoolArray
    """Drones that stay where they are if others can go round them, shape (n,)."""
    supple: BoolArray
    """Drones whose changes can be flown as they are, within limits, shape (n,)."""
    planes: Planes
    """What the crowd is to stay behind."""
    often: Mapping[tuple[int, int], int]
    """How often each pair has come too near all the same: it has to part the more."""
    allowed: Allowed
    """Places, speeds and accelerations that drones may have."""

    def part(self, rows: IntArray, free: BoolArray) -> Crowd:
        """Return some of the drones, (k,) sorted, of which not all may be moved."""
        planes = self.planes
        mine = np.isin(planes.drone, rows)
        number = {row: index for index, row in enumerate(rows.tolist())}
        often = {
            (number[pair[0]], number[pair[1]]): count
            for pair, count in self.often.items()
            if pair[0] in number and pair[1] in number
        }
        return replace(
            self,
            places=self.places[rows],
            speeds=self.speeds[rows],
            pulls=self.pulls[rows],
            jerks=self.jerks[rows],
            give=np.where(free[:, None, None], self.give[rows], 0.0),
            hovers=self.hovers[rows],
            supple=self.supple[rows],
            planes=Planes(
                np.searchsorted(rows, planes.drone[mine]),
                planes.instant[mine],
                planes.normal[mine],
                planes.offset[mine],
            ),
            often=often,
        )


def sampled(duration: float, least: int = 0) -> FloatArray:
    """Instants at which a crowd is looked at, shape (m,) [s].

    Parameters
    ----------
    least
        Steps at least, whatever the duration.
    """
    count = int(np.clip(np.ceil(duration / _SAMPLES), 30, 160))
    count = max(count, least)
    even = np.linspace(0.0, duration, count + 1)
    close = even[1] * np.array(_CLOSER)
    return np.sort(np.concatenate([even, close, duration - close]))


@dataclass(frozen=True, slots=True, eq=False)
class Crossing:
    """What a crowd is to fly, all on one clock."""

    aircraft: Aircraft
    separation: Separation
    start: FloatArray
    """Shape (n, 3), show frame [m]."""
    goal: FloatArray
    """Shape (n, 3), show frame [m]."""
    parked: FloatArray | None
    """Positions of drones that stand still, shape (m, 3) [m]."""
    profile: Profile
    """One on which all can fly straight."""
    fence: Fence | None = None
