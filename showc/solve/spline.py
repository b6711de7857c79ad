"""Flights off the straight line: splines in the flat outputs by convex programs.

Positions are B-splines of degree 5 on even intervals (four times continuously
differentiable, so torques are continuous). The limits become linear in the spline's
coefficients once pitch and roll are known roughly: they are taken from the iterate
before, and the Bernstein coefficients of each interval keep them at every instant. The
program stays as near as it can to a reference. What it gives is judged by the true
limits afterwards, so the linearisation is never trusted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.solve.flat import FlatFlights, Use, fly, use_of_limits
from showc.trajectory import bernstein_basis, bernstein_basis_inverse, restrict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.solve.single import Aircraft
    from showc.trajectory import PiecewisePolynomial

    FloatArray = NDArray[np.float64]

DEGREE = 5
WALL_DEGREE = DEGREE + 1
_MARGIN = 0.995
_ITERATIONS = 6
_PRICE = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Moving half-spaces ``normal(t) . x(t) >= offset(t)``, each on one interval."""

    interval: NDArray[np.int64]
    """Shape (m,)."""
    normal: FloatArray
    """At the start and end of the interval, linear between; (m, 2, 3), show frame."""
    offset: FloatArray
    """Bernstein coefficients of the offset, shape (m, 7) [m]."""


NO_WALLS = Walls(np.zeros(0, dtype=np.int64), np.zeros((0, 2, 3)), np.zeros((0, 7)))


@dataclass(frozen=True, slots=True, eq=False)
class _Basis:
    """Matrices from B-spline coefficients to Bernstein coefficients, (K, ., n)."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    """Elevated to the degree of the acceleration."""


@lru_cache(maxsize=32)
def _basis(intervals: int, duration: float) -> _Basis:
    from scipy.interpolate import BSpline  # noqa: PLC0415 - scipy only when solving

    knots = np.concatenate(
        [np.zeros(DEGREE), np.linspace(0.0, 1.0, intervals + 1), np.ones(DEGREE)]
    )
    count = intervals + DEGREE
    inner = (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1)
    at = (np.arange(intervals)[:, None] + inner) / intervals
    values = BSpline.design_matrix(at.ravel(), knots, DEGREE).toarray()
    inverse = bernstein_basis_inverse(DEGREE, tuple(inner))
    position = np.einsum("ij,kjn->kin", inverse, values.reshape(intervals, -1, count))
    position[np.abs(position) < 1e-13] = 0.0
    width = duration / intervals
    velocity = DEGREE * np.diff(position, axis=1) / width
    acceleration = (DEGREE - 1) * np.diff(velocity, axis=1) / width
    jerk = (DEGREE - 2) * np.diff(acceleration, axis=1) / width
    elevation = np.array([[1, 0, 0], [1 / 3, 2 / 3, 0], [0, 2 / 3, 1 / 3], [0, 0, 1]])
    jerk = np.einsum("ij,kjn->kin", elevation, jerk)
    return _Basis(position, velocity, acceleration, jerk)


@dataclass(frozen=True, slots=True, eq=False)
class SplineFlight:
    """A flight found, as positions and as the states and controls they imply."""

    breaks: FloatArray
    """Even borders, shape (K + 1,) [s]."""
    position: FloatArray
    """Bernstein coefficients, shape (K, 6, 3) [m]."""
    flight: FlatFlights
    """Of this one drone; its intervals are halves of the spline's."""


def follow_spline(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    reference: PiecewisePolynomial,
    intervals: int,
    walls: Walls = NO_WALLS,
) -> SplineFlight | None:
    """Fly from hover to hover, near ``reference``, on the right side of ``walls``.

    Parameters
    ----------
    start, goal
        Shape (3,) [m].
    reference
        Share of the way by time, 1 component; its end is the duration.
    intervals
        Intervals of the spline, all of one length.

    Returns
    -------
    SplineFlight or None
        None if no such flight was found; otherwise all limits are kept at every
        instant, proved on Bernstein coefficients.
    """
    program = _Program(aircraft, start, goal, reference, intervals, walls)
    aim = _Aim()
    for _ in range(_ITERATIONS):
        position = program.solve(aim)
        if position is None:
            return None
        flight = _flown(aircraft, program.breaks, position)
        use = use_of_limits(aircraft.vehicle, aircraft.limits, flight)
        if use.greatest[0] <= 1.0:
            return SplineFlight(program.breaks, position, flight)
        aim = aim.corrected(use)
        program.relinearise(position)
    return None


@dataclass(frozen=True, slots=True)
class _Aim:
    """Shares of the limits that the linearised program aims at."""

    tilt: float = _MARGIN
    rate: float = _MARGIN
    power: float = _MARGIN
    floor: float = 0.2
    """Least vertical thrust over the weight: rotors need some to make torques."""

    def corrected(self, use: Use) -> _Aim:
        """Aim lower where the true use was too great."""

        def lower(share: float, found: float) -> float:
            return share * max(0.85, 0.997 / found) if found > 1.0 else share

        return _Aim(
            lower(self.tilt, float(use.tilt[0])),
            lower(self.rate, float(use.rate[0])),
            lower(self.power, float(use.power[0])),
            1.4 * self.floor if use.weak[0] else self.floor,
        )


def _flown(
    aircraft: Aircraft, breaks: FloatArray, position: FloatArray
) -> FlatFlights:
    """States and controls; intervals halved, for attitudes are no polynomials."""
    half = np.full((position.shape[0], 1, 1), 0.5)
    parts = np.stack(
        [
            restrict(position, 0.0 * half, half),
            restrict(position, half, 2.0 * half),
        ],
        axis=1,
    ).reshape(1, -1, DEGREE + 1, 3)
    fine = np.linspace(0.0, breaks[-1], 2 * position.shape[0] + 1)
    return fly(aircraft.vehicle, aircraft.heading, fine, parts)


class _Program:
    """The convex program of one drone, linearised about an iterate."""

    def __init__(
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
        basis = _basis(intervals, duration)
        self.basis = basis
        count = intervals + DEGREE
        # Hover at both ends: tilt and body rates vanish, so horizontally velocity,
        # acceleration and jerk do; vertically only the velocity, thrust may jump.
        fixed = np.zeros((count, 3), dtype=bool)
        fixed[:4, :2] = fixed[-4:, :2] = True
        fixed[:2, 2] = fixed[-2:, 2] = True
        self.free = ~fixed.T.ravel()
        ends = np.zeros((count, 3))
        ends[: count // 2], ends[count // 2 :] = start, goal
        self.given = np.where(fixed, ends, 0.0).T.ravel()
        self.start, self.goal = start, goal
        self.pitch = np.zeros(4 * intervals)
        self.roll = np.zeros(4 * intervals)
        inner = (np.arange(4) + 0.5) / 4
        at = (self.breaks[:-1, None] + inner * np.diff(self.breaks)[:, None]).ravel()
        wanted = start + reference(at) * (goal - start)
        values = np.einsum(
            "jk,ikn->ijn", bernstein_basis(DEGREE, inner), basis.position
        ).reshape(-1, count)
        weight = 1.0 / at.size
        # A little weight on jerk keeps the program strictly convex and the flight calm.
        jerk = basis.jerk.reshape(-1, count)
        gram = weight * values.T @ values + 1e-4 * jerk.T @ jerk / jerk.shape[0]
        self.quadratic = np.kron(np.eye(3), gram)
        self.linear = -(weight * values.T @ wanted).T.ravel()

    def relinearise(self, position: FloatArray) -> None:
        """Take pitch and roll at each coefficient from an iterate."""
        width = self.breaks[1] - self.breaks[0]
        second = np.diff(position, 2, axis=1).reshape(-1, 3) * 20.0 / width**2
        second[:, 2] += self.aircraft.vehicle.gravity
        cosine, sine = np.cos(self.aircraft.heading), np.sin(self.aircraft.heading)
        ahead = cosine * second[:, 0] + sine * second[:, 1]
        left = cosine * second[:, 1] - sine * second[:, 0]
        self.pitch = np.arctan2(ahead, second[:, 2])
        self.roll = -np.arctan2(left, np.hypot(ahead, second[:, 2]))

    def rows(self, aim: _Aim) -> tuple[FloatArray, FloatArray]:
        """All rows ``a . c <= b``, with c the coefficients x, y, z after each other."""
        limits, vehicle = self.aircraft.limits, self.aircraft.vehicle
        basis, count = self.basis, self.intervals + DEGREE
        gravity = vehicle.gravity
        zero = np.zeros((1, count))
        parts: list[tuple[FloatArray, FloatArray]] = []

        def add(x: FloatArray, y: FloatArray, z: FloatArray, bound: FloatArray) -> None:
            size = bound.size
            blocks = [np.broadcast_to(part, (size, count)) for part in (x, y, z)]
            parts.append((np.concatenate(blocks, axis=1), bound))

        def shared(matrix: FloatArray) -> FloatArray:
            # The last coefficient of an interval is the first of the next.
            return np.concatenate([matrix[:, :-1].reshape(-1, count), matrix[-1, -1:]])

        velocity = shared(basis.velocity)
        size = velocity.shape[0]
        for axis in range(3):
            blocks = [zero, zero, zero]
            blocks[axis] = velocity
            add(*blocks, np.full(size, limits.velocity_max[axis]))
            blocks[axis] = -velocity
            add(*blocks, np.full(size, -limits.velocity_min[axis]))

        cosine, sine = np.cos(self.aircraft.heading), np.sin(self.aircraft.heading)
        push = basis.acceleration.reshape(-1, count)
        tangent = np.tan(limits.tilt * aim.tilt)
        pull = np.full(push.shape[0], gravity)
        theta, phi = self.pitch[:, None], self.roll[:, None]
        for sign in (1.0, -1.0):
            # |ahead| <= tan(tilt) up
            add(
                sign * cosine * push,
                sign * sine * push,
                -tangent * push,
                tangent * pull,
            )
            # |left| <= tan(tilt) hypot(ahead, up), the convex right side by its tangent
            s, c = np.sin(theta), np.cos(theta)
            add(
                (-sign * sine - tangent * s * cosine) * push,
                (sign * cosine - tangent * s * sine) * push,
                -tangent * c * push,
                tangent * c[:, 0] * pull,
            )
        # Thrust: |u| <= up / cos²(tilt), and at least up.
        most = min(limits.thrust_max, vehicle.thrust_max) / vehicle.mass * aim.power
        least = max(limits.thrust_min / vehicle.mass, aim.floor * gravity)
        most *= max(np.cos(limits.tilt) ** 2, 0.5)
        add(zero, zero, push, np.full(push.shape[0], most - gravity))
        add(zero, zero, -push, np.full(push.shape[0], gravity - least))

        jerk = basis.jerk.reshape(-1, count)
        s, c = np.sin(theta), np.cos(theta)
        sr, cr = np.sin(phi), np.cos(phi)
        rate_roll, rate_pitch = (
            rate * aim.rate for rate in limits.body_rate[:2]
        )
        for sign in (1.0, -1.0):
            # |ahead' cos(pitch) - up' sin(pitch)| <= rate (ahead sin + up cos)
            along = sign * c * jerk - rate_pitch * s * push
            add(
                cosine * along,
                sine * along,
                -sign * s * jerk - rate_pitch * c * push,
                rate_pitch * c[:, 0] * pull,
            )
            # |left' cos(roll) + plane' sin(roll)| <= rate |u|, with
            # plane' = ahead' sin(pitch) + up' cos(pitch), |u| = plane cos - left sin
            ahead = sign * sr * s * jerk - rate_roll * cr * s * push
            left = sign * cr * jerk + rate_roll * sr * push
            up = sign * sr * c * jerk - rate_roll * cr * c * push
            add(
                cosine * ahead - sine * left,
                sine * ahead + cosine * left,
                up,
                rate_roll * (cr * c)[:, 0] * pull,
            )
        self._volume(add, zero)
        self.hard = sum(bound.size for _, bound in parts)
        if self.walls.interval.size:
            at = self.basis.position[self.walls.interval]
            # Bernstein coefficients of (linear) x (degree 5).
            share = np.arange(WALL_DEGREE + 1) / WALL_DEGREE
            padding = np.zeros_like(at[:, :1])
            early = (1.0 - share)[:, None] * np.concatenate([at, padding], axis=1)
            late = share[:, None] * np.concatenate([padding, at], axis=1)
            normal = self.walls.normal[..., None, None]
            rows = [
                -(normal[:, 0, axis] * early + normal[:, 1, axis] * late).reshape(
                    -1, count
                )
                for axis in range(3)
            ]
            add(*rows, -self.walls.offset.ravel())
        matrices, bounds = zip(*parts, strict=True)
        return np.concatenate(matrices), np.concatenate(bounds)

    def _volume(self, add: object, zero: FloatArray) -> None:
        limits = self.aircraft.limits
        identity = np.eye(self.intervals + DEGREE)
        for axis in range(3):
            for sign, bound in (
                (1.0, limits.position_max[axis]),
                (-1.0, -limits.position_min[axis]),
            ):
                reach = max(sign * self.start[axis], sign * self.goal[axis])
                span = float(np.linalg.norm(self.goal - self.start))
                if bound - reach < span + 20.0:
                    blocks = [zero, zero, zero]
                    blocks[axis] = sign * identity
                    add(*blocks, np.full(identity.shape[0], bound))  # type: ignore[operator]

    def solve(self, aim: _Aim) -> FloatArray | None:
        """Positions as Bernstein coefficients (K, 6, 3), None if infeasible."""
        import clarabel  # noqa: PLC0415 - only when solving
        from scipy.sparse import csc_matrix, vstack  # noqa: PLC0415

        rows, bounds = self.rows(aim)
        right = bounds - rows @ self.given
        left = rows[:, self.free]
        size = np.linalg.norm(left, axis=1)
        busy = size > 1e-9
        soft = np.arange(size.size) >= self.hard
        if np.any(right[~busy & ~soft] < -1e-9):
            return None
        # Walls give way at a price: a crowd that is still tangled moves apart as far
        # as it can, and the next round lays the walls anew.
        give = np.zeros((size.size, self.walls.interval.size))
        per = WALL_DEGREE + 1
        give[self.hard :] = -np.repeat(np.eye(give.shape[1]), per, axis=0)
        left, right, give = left[busy], right[busy], give[busy]
        scale = np.where(soft[busy], 1.0, size[busy])[:, None]
        slack = give.shape[1]
        matrix = vstack(
            [
                csc_matrix(np.concatenate([left, give], axis=1) / scale),
                csc_matrix(
                    np.concatenate([np.zeros((slack, left.shape[1])), -np.eye(slack)], 1)
                ),
            ],
            format="csc",
        )
        right = np.concatenate([right / scale[:, 0], np.zeros(slack)])
        quadratic = np.zeros((left.shape[1] + slack,) * 2)
        quadratic[: left.shape[1], : left.shape[1]] = self.quadratic[
            np.ix_(self.free, self.free)
        ]
        linear = np.concatenate(
            [
                (self.quadratic @ self.given + self.linear)[self.free],
                np.full(slack, _PRICE),
            ]
        )
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_iter = 60
        settings.max_threads = 1
        solver = clarabel.DefaultSolver(
            csc_matrix(np.triu(quadratic)),
            linear,
            matrix,
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
        values = self.given.copy()
        values[self.free] = np.asarray(answer.x)[: left.shape[1]]
        count = self.intervals + DEGREE
        position = np.einsum(
            "kin,an->kia", self.basis.position, values.reshape(3, count)
        )
        position[0, :2], position[-1, -2:] = self.start, self.goal
        return position

