"""The convex program behind a spline: limits linearised about an iterate.

It stays as near as it can to a reference, keeps the limits as linearised, and gives way
behind walls only at a price.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.straight import followed
from showc.fleet.single_drone.basis import (
    DEGREE,
    LOCAL,
    NODES,
    free_coefficients,
    nearest_coefficients,
    quadratic_upper,
    spline_basis,
)
from showc.fleet.single_drone.rows import Rows, System
from showc.fleet.single_drone.sparse import Columns

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.fleet.shared_profile.flat import Use
    from showc.fleet.single_drone.model import Aircraft
    from showc.trajectory import PiecewisePolynomial


WALL_DEGREE = DEGREE + 1
"""Of walls that move with a flight: positions, and one more."""
_MARGIN = 0.995
"""Part of a limit that a program may use: the flight bends between its points."""
_SPEED = 1.0 - 1e-7
"""Part of a velocity limit that it may use: polynomials keep it exactly, and the solver
keeps rows to 1e-8."""
_PRICE = 30.0
"""Linear price of what is lacking behind a wall: an exact penalty (Nocedal and Wright
2006, section 17.2)."""
_NEAR, _NEARLY = 0.5, 0.9
"""Share of its bound at which a row counts from the beginning, and once others that
did not count were passed."""
_TANGENTS = 8
"""Tangents for each disc; one of them, along the iterate, is exact."""
_CUBE = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
_TOWARD: FloatArray = np.delete(_CUBE, 13, axis=0)
_TOWARD /= np.linalg.norm(_TOWARD, axis=1, keepdims=True)
"""Tangents of a ball, towards faces, edges and corners of a cube, shape (26, 3)."""
_FIRST_OF_CUBIC: FloatArray = np.array(
    [[1.0, 0.0, 0.0], [1.0 / 3.0, 2.0 / 3.0, 0.0], [0.0, 2.0 / 3.0, 1.0 / 3.0]]
)
"""From the coefficients of a parabola to the first three of it as a cubic."""


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Moving half-spaces ``normal(t) . x(t) >= offset(t)``, each on one interval."""

    interval: IntArray
    """Shape (m,)."""
    normal: FloatArray
    """At the start and end of the interval, linear between; (m, 2, 3), show frame."""
    offset: FloatArray
    """Bernstein coefficients of the offset, shape (m, 7) [m]."""


NO_WALLS = Walls(np.zeros(0, dtype=np.int64), np.zeros((0, 2, 3)), np.zeros((0, 7)))


@dataclass(frozen=True, slots=True)
class Aim:
    """Shares of the limits that the linearised program aims at."""

    tilt: float = _MARGIN
    rate: float = _MARGIN
    power: float = _MARGIN
    acceleration: float = _MARGIN
    floor: float = 0.2
    """Least vertical thrust over the weight: rotors need some to make torques."""

    def corrected(self, use: Use) -> Aim:
        """Aim lower where the true use was too great."""

        def lower(share: float, found: float) -> float:
            return share * max(0.85, 0.997 / found) if found > 1.0 else share

        return Aim(
            lower(self.tilt, float(use.tilt[0])),
            lower(self.rate, float(use.rate[0])),
            lower(self.power, float(use.power[0])),
            lower(self.acceleration, float(use.acceleration[0])),
            1.4 * self.floor if use.weak[0] else self.floor,
        )


class Program:
    """The convex program of one drone, linearised about an iterate."""

    def __init__(  # noqa: PLR0917 - as follow_spline
        self,
        aircraft: Aircraft,
        start: FloatArray,
        goal: FloatArray,
        reference: PiecewisePolynomial,
        intervals: int,
        walls: Walls,
    ) -> None:
        duration = reference.end
        self.aircraft = aircraft
        self.breaks = np.linspace(0.0, duration, intervals + 1)
        self.walls = walls
        self.intervals = intervals
        self.basis = spline_basis(intervals, duration)
        count = intervals + DEGREE
        self.leaps = not aircraft.limits.jerk
        self.free = free_coefficients(count, leaps=self.leaps)
        fixed = ~self.free.reshape(3, count).T
        ends = np.zeros((count, 3))
        ends[: count // 2], ends[count // 2 :] = start, goal
        self.given = np.where(fixed, ends, 0.0).T.ravel()
        self.start, self.goal = start, goal
        self.pitch = np.zeros((intervals, 4))
        self.roll = np.zeros((intervals, 4))
        at = (self.breaks[:-1, None] + NODES * np.diff(self.breaks)[:, None]).ravel()
        wanted = followed(reference, start, goal, at)
        linear = self.given.reshape(3, count) @ self.basis.gram
        linear = linear + (self.basis.weights @ wanted).T
        heading = float(np.arctan2(*(goal - start)[1::-1]))
        self.bearing = np.full((intervals, 4), heading)
        self.course = np.full((intervals, 4), heading)
        self.change = np.zeros((intervals, 3, 3))
        self._linear = linear.ravel()[self.free]
        size = self._linear.size + walls.interval.size
        self._quadratic = Columns.of(
            *quadratic_upper(intervals, duration, leaps=self.leaps), (size, size)
        )
        self._counted: BoolArray | None = None
        nearest = nearest_coefficients(intervals, duration, leaps=self.leaps)
        self._nearest = self._whole(nearest @ -self._linear)

    def relinearise(self, position: FloatArray) -> None:
        """Take pitch and roll at each coefficient from an iterate, (K, 6, 3) [m]."""
        width = self.breaks[1] - self.breaks[0]
        second = np.diff(position, 2, axis=1) * DEGREE * (DEGREE - 1) / width**2
        self.bearing = np.arctan2(second[..., 1], second[..., 0])
        change = _FIRST_OF_CUBIC @ np.diff(position, 3, axis=1)
        size = np.linalg.norm(change, axis=-1, keepdims=True)
        self.change = change / np.where(size > 0.0, size, 1.0)
        first = np.diff(position, axis=1)[:, :-1]
        self.course = np.arctan2(first[..., 1], first[..., 0])
        second[..., 2] += self.aircraft.vehicle.gravity
        cosine, sine = np.cos(self.aircraft.heading), np.sin(self.aircraft.heading)
        ahead = cosine * second[..., 0] + sine * second[..., 1]
        left = cosine * second[..., 1] - sine * second[..., 0]
        self.pitch = np.arctan2(ahead, second[..., 2])
        self.roll = -np.arctan2(left, np.hypot(ahead, second[..., 2]))

    def _rows(self, aim: Aim) -> tuple[Rows, int]:
        """All rows, the hard ones first, and how many of these there are."""
        rows = Rows()
        limits = self.aircraft.limits
        # The last velocity coefficient of an interval is the first of the next.
        velocity = self.basis.velocity[:, :-1]
        for axis in range(3):
            for sign, bound in (
                (1.0, limits.velocity_max[axis]),
                (-1.0, -limits.velocity_min[axis]),
            ):
                rows.add_axis(axis, sign * velocity, _SPEED * bound)
        self._attitude_rows(rows, aim)
        self._rate_rows(rows, aim)
        self._round_rows(rows, aim)
        self._volume_rows(rows)
        hard = rows.count
        walls = self.walls
        if walls.interval.size:
            at = self.basis.position[walls.interval]
            # Bernstein coefficients of (linear) x (degree 5).
            share = np.arange(WALL_DEGREE + 1) / WALL_DEGREE
            padding = np.zeros_like(at[:, :1])
            early = (1.0 - share)[:, None] * np.concatenate([at, padding], axis=1)
            late = share[:, None] * np.concatenate([padding, at], axis=1)
            values = (
                walls.normal[:, 0, None, :, None] * early[:, :, None, :]
                + walls.normal[:, 1, None, :, None] * late[:, :, None, :]
            )
            rows.add_at(walls.interval, -values, -walls.offset)
        return rows, hard

    def _attitude_rows(self, rows: Rows, aim: Aim) -> None:
        """Tilt and thrust."""
        limits, vehicle = self.aircraft.limits, self.aircraft.vehicle
        gravity = vehicle.gravity
        cosine, sine = np.cos(self.aircraft.heading), np.sin(self.aircraft.heading)
        push = self.basis.acceleration[:, :-1]
        pull = np.full(push.shape[:2], gravity)
        tangent = np.tan(limits.tilt * aim.tilt)
        theta = self.pitch[:, :-1]
        s, c = np.sin(theta)[..., None], np.cos(theta)[..., None]
        for sign in (1.0, -1.0):
            # |ahead| <= tan(tilt) up
            rows.add(
                sign * cosine * push,
                sign * sine * push,
                -tangent * push,
                tangent * pull,
            )
            # |left| <= tan(tilt) hypot(ahead, up), the convex right side by its tangent
            rows.add(
                (-sign * sine - tangent * s * cosine) * push,
                (sign * cosine - tangent * s * sine) * push,
                -tangent * c * push,
                tangent * c[..., 0] * pull,
            )
        # Thrust: |u| <= up / cos²(tilt), and at least up.
        most = min(limits.thrust_max, vehicle.thrust_max) / vehicle.mass * aim.power
        most *= max(np.cos(limits.tilt) ** 2, 0.5)
        least = max(limits.thrust_min / vehicle.mass, aim.floor * gravity)
        # Thrust need not end as hover: its last coefficient counts too.
        push = self.basis.acceleration
        rows.add(0.0, 0.0, push, np.full(push.shape[:2], most - gravity))
        rows.add(0.0, 0.0, -push, np.full(push.shape[:2], gravity - least))

    def _rate_rows(self, rows: Rows, aim: Aim) -> None:
        """Body rates, about pitch and roll of the iterate before."""
        gravity = self.aircraft.vehicle.gravity
        cosine, sine = np.cos(self.aircraft.heading), np.sin(self.aircraft.heading)
        chosen = slice(0, 3)
        push = self.basis.acceleration[:, chosen]
        jerk = self.basis.jerk[:, chosen]
        theta, phi = self.pitch[:, chosen], self.roll[:, chosen]
        s, c = np.sin(theta)[..., None], np.cos(theta)[..., None]
        sr, cr = np.sin(phi)[..., None], np.cos(phi)[..., None]
        rate_roll, rate_pitch = (
            rate * aim.rate for rate in self.aircraft.limits.body_rate[:2]
        )
        for sign in (1.0, -1.0):
            # |ahead' cos(pitch) - up' sin(pitch)| <= rate (ahead sin + up cos)
            along = sign * c * jerk - rate_pitch * s * push
            rows.add(
                cosine * along,
                sine * along,
                -sign * s * jerk - rate_pitch * c * push,
                rate_pitch * gravity * c[..., 0],
            )
            # |left' cos(roll) + plane' sin(roll)| <= rate |u|, with
            # plane' = ahead' sin(pitch) + up' cos(pitch), |u| = plane cos - left sin
            ahead = sign * sr * s * jerk - rate_roll * cr * s * push
            left = sign * cr * jerk + rate_roll * sr * push
            rows.add(
                cosine * ahead - sine * left,
                sine * ahead + cosine * left,
                sign * sr * c * jerk - rate_roll * cr * c * push,
                rate_roll * gravity * (cr * c)[..., 0],
            )

    def _round_rows(self, rows: Rows, aim: Aim) -> None:
        """Level speed and accelerations; discs by tangents about the iterate."""
        limits = self.aircraft.limits
        push = self.basis.acceleration
        if limits.acceleration:
            self._disc(rows, push, self.bearing, limits.acceleration * aim.acceleration)
        if limits.acceleration_up:
            rows.add_axis(2, push, limits.acceleration_up * aim.acceleration)
        if limits.acceleration_down:
            rows.add_axis(2, -push, limits.acceleration_down * aim.acceleration)
        if limits.rounds_speed:
            velocity = self.basis.velocity[:, :-1]
            bound = limits.level_speed * aim.acceleration
            self._disc(rows, velocity, self.course, bound)
        if limits.jerk:
            # The last coefficient of an interval is the first of the next.
            jerk = self.basis.jerk[:, :-1]
            most = np.full(jerk.shape[:2], limits.jerk * aim.acceleration)
            for toward in (*_TOWARD, self.change):
                parts = np.broadcast_to(toward, self.change.shape)[..., None]
                x, y, z = np.moveaxis(parts, 2, 0) * jerk
                rows.add(x, y, z, most)

    @staticmethod
    def _disc(rows: Rows, values: FloatArray, toward: FloatArray, bound: float) -> None:
        """Keep the level part of ``values`` within a disc, by ``_TANGENTS`` of it."""
        for number in range(_TANGENTS):
            angle = toward + 2.0 * np.pi * number / _TANGENTS
            x, y = np.cos(angle)[..., None], np.sin(angle)[..., None]
            rows.add(x * values, y * values, 0.0, np.full(values.shape[:2], bound))

    def _volume_rows(self, rows: Rows) -> None:
        """Walls of the flight volume that are near enough to matter."""
        limits = self.aircraft.limits
        span = float(np.linalg.norm(self.goal - self.start)) + 20.0
        position = self.basis.position[:, :-1]
        for axis in range(3):
            for sign, bound in (
                (1.0, limits.position_max[axis]),
                (-1.0, -limits.position_min[axis]),
            ):
                reach = max(sign * self.start[axis], sign * self.goal[axis])
                if bound - reach < span:
                    rows.add_axis(axis, sign * position, bound)

    def solve(self, aim: Aim) -> FloatArray | None:
        """Positions as Bernstein coefficients (K, 6, 3) [m], None if infeasible.

        Rows that the nearest spline of all is far from are left out until a solution
        passes them; what comes out in the end solves the program with all rows.

        Walls give way at a price: a crowd that is still tangled moves apart as far as
        it can, and the next round lays the walls anew.
        """
        rows, hard = self._rows(aim)
        system = System.of(rows, self.free, self.given, hard, WALL_DEGREE + 1)
        chosen = system.reached(self._nearest) > _NEAR * system.bounds
        chosen |= (system.bounds <= 0.0) | ~system.hard
        if self._counted is not None:
            chosen |= self._counted
        while True:
            answer = self._answer(system, chosen)
            if answer is None:
                return None
            found = self._whole(answer)
            if not (system.passed(found) & ~chosen & system.hard).any():
                break
            chosen |= (system.reached(found) > _NEARLY * system.bounds) & system.hard
        # What counts for this iterate will count for the next one.
        self._counted = chosen
        return self._positions(found)

    def nearest(self) -> FloatArray:
        """Positions (K, 6, 3) [m] of the spline nearest the way, beyond all limits."""
        return self._positions(self._nearest)

    def _positions(self, coefficients: FloatArray) -> FloatArray:
        """Bernstein coefficients (K, 6, 3) [m] of a spline's coefficients (3 n,)."""
        count = self.intervals + DEGREE
        local = coefficients.reshape(3, count)[
            :, np.arange(self.intervals)[:, None] + np.arange(LOCAL)
        ]
        position: FloatArray = np.einsum("kin,akn->kia", self.basis.position, local)
        position[0, :2], position[-1, -2:] = self.start, self.goal
        return position

    def _whole(self, answer: FloatArray) -> FloatArray:
        """All coefficients (3 n,), the given ones included."""
        found = self.given.copy()
        found[self.free] = answer[: self._linear.size]
        return found

    def _answer(self, system: System, chosen: BoolArray) -> FloatArray | None:
        import clarabel  # noqa: PLC0415 - only when solving

        slack = self.walls.interval.size
        matrix = system.matrix(chosen, slack)
        if matrix is None:
            return None
        left, right = matrix
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_iter = 60
        settings.max_threads = 1
        solver = clarabel.DefaultSolver(
            self._quadratic,
            np.concatenate([self._linear, np.full(slack, _PRICE)]),
            left,
            right,
            [clarabel.NonnegativeConeT(right.size)],
            settings,
        )
        answer = solver.solve()
        if answer.status not in (
            clarabel.SolverStatus.Solved,
            clarabel.SolverStatus.AlmostSolved,
        ):
            return None
        return np.asarray(answer.x)
