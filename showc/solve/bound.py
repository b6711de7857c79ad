"""A rigorous lower bound on the time of one drone's move, with its proof.

Relaxation: velocity in its box, thrust acceleration in the set U(t) that thrust, tilt,
body rates and angular accelerations allow at time t after one hover and T - t before
the next. A time T is impossible if multipliers beta and lambda(t) with

    beta . d > integral over [0, T] of h_V(beta + lambda') + h_U(t)(lambda) - g lambda_z

exist (h: support functions; see :class:`showc.flight.DualWitness`). The multipliers
come from a linear program, the dual of which is the relaxed move on a coarse mesh; they
are then judged by an integral that is rounded upward, so the bound does not depend on
the program having been solved well. An impossible T makes every shorter time
impossible too, since a drone may hover.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from showc.flight import DualWitness

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.vehicle import Limits, Quadrotor

    FloatArray = NDArray[np.float64]

_SUBDIVISIONS = 32
_MARGIN = 1e-9
_INTERVALS = 36
_NEAR = 5e-4


@dataclass(frozen=True, slots=True)
class Relaxation:
    """What the bound lets a drone do: a superset of what it can do."""

    vehicle: Quadrotor
    limits: Limits
    yaw: Literal["held", "free"] = "held"
    heading: float = 0.0
    """Yaw at both hovers [rad]."""

    @property
    def specific_thrust(self) -> tuple[float, float]:
        """Least and greatest thrust over mass [m/s²]."""
        mass = self.vehicle.mass
        most = min(self.limits.thrust_max, self.vehicle.thrust_max)
        return self.limits.thrust_min / mass, most / mass

    @property
    def angular_acceleration(self) -> tuple[float, float]:
        """Greatest |p'| and |q'| [rad/s²], by torque and rotor limits."""
        ix, iy, iz = self.vehicle.inertia
        p, q, r = self.limits.body_rate
        gyroscopic = (abs(iy - iz) / ix * q * r, abs(iz - ix) / iy * p * r)
        torque = [
            min(self.limits.torque_max[axis], self.vehicle.torque_max[axis])
            * self.vehicle.torque_factor
            / self.vehicle.inertia[axis]
            for axis in (0, 1)
        ]
        if self.yaw == "held":
            return torque[0], torque[1]
        return torque[0] + gyroscopic[0], torque[1] + gyroscopic[1]

    def caps(self, since_hover: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Greatest |roll| and |pitch| [rad] at a time ``since_hover`` [s]."""
        rate, alpha = self.limits.body_rate, self.angular_acceleration
        roll, pitch = (
            np.minimum(
                self.limits.tilt,
                np.minimum(
                    rate[axis] * since_hover, 0.5 * alpha[axis] * since_hover**2
                ),
            )
            for axis in (0, 1)
        )
        return roll, pitch

    def turned(self, vectors: FloatArray) -> FloatArray:
        """Vectors (..., 3) of the show frame in the frame of the heading."""
        if self.yaw == "free":
            return vectors
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0, 0, 1]])
        return np.asarray(vectors @ rotation)

    def thrust_support(
        self, multiplier: FloatArray, roll: FloatArray, pitch: FloatArray
    ) -> FloatArray:
        """Greatest ``multiplier . u`` over U with the given caps, shape (...).

        Parameters
        ----------
        multiplier
            Shape (..., 3), show frame.
        roll, pitch
            Greatest |roll| and |pitch|, shape (...) [rad], below 90 degrees.
        """
        turned = self.turned(multiplier)
        lx, ly, lz = turned[..., 0], turned[..., 1], turned[..., 2]
        if self.yaw == "free":
            across = np.hypot(lx, ly)
            cone = np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0))
            most = _arc(lz, across, cone)
        else:
            most = _arc(_arc(lz, np.abs(lx), pitch), np.abs(ly), roll)
        least_thrust, most_thrust = self.specific_thrust
        return np.asarray(np.maximum(most_thrust * most, least_thrust * most))

    def velocity_support(self, multiplier: FloatArray) -> FloatArray:
        """Greatest ``multiplier . v`` over the velocity box, shape (...)."""
        return np.asarray(
            np.maximum(
                multiplier * np.asarray(self.limits.velocity_max),
                multiplier * np.asarray(self.limits.velocity_min),
            ).sum(axis=-1)
        )

    def vertices(self, roll: float, pitch: float, steps: int = 3) -> FloatArray:
        """Points of U, shape (m, 3) [m/s²], whose hull nearly fills U's."""
        least_thrust, most_thrust = self.specific_thrust
        grid = np.linspace(-1.0, 1.0, steps)
        if self.yaw == "free":
            cone = math.acos(math.cos(roll) * math.cos(pitch))
            turn = 2.0 * np.pi * np.arange(12) / 12
            rim = np.stack([np.cos(turn), np.sin(turn)], axis=1) * math.sin(cone)
            directions = np.column_stack([rim, np.full(12, math.cos(cone))])
            directions = np.vstack([directions, [[0.0, 0.0, 1.0]]])
        else:
            phi, theta = (
                part.ravel() for part in np.meshgrid(roll * grid, pitch * grid)
            )
            directions = np.column_stack(
                [np.cos(phi) * np.sin(theta), -np.sin(phi), np.cos(phi) * np.cos(theta)]
            )
            cosine, sine = math.cos(self.heading), math.sin(self.heading)
            rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
            directions = directions @ rotation.T
        return np.vstack([most_thrust * directions, least_thrust * directions])


def _arc(ahead: FloatArray, across: FloatArray, cap: FloatArray) -> FloatArray:
    """Greatest ``ahead cos(x) + across sin(x)`` over 0 <= x <= cap, across >= 0."""
    inside = np.arctan2(across, ahead) <= cap
    return np.asarray(
        np.where(
            inside,
            np.hypot(ahead, across),
            ahead * np.cos(cap) + across * np.sin(cap),
        )
    )


def surplus(  # noqa: PLR0917 - the names of the inequality
    relaxation: Relaxation,
    displacement: FloatArray,
    time: float,
    beta: FloatArray,
    knots: FloatArray,
    multipliers: FloatArray,
    subdivisions: int = _SUBDIVISIONS,
) -> float:
    """``beta . d`` minus an upper bound of the integral: above 0 proves ``time`` wrong.

    On each part of a knot interval the caps on tilt are taken at their greatest; then
    h_U is convex in lambda, lambda is linear, and the trapezoid rule errs upward.

    Parameters
    ----------
    displacement
        Shape (3,) [m].
    time
        T [s].
    beta, knots, multipliers
        As in :class:`showc.flight.DualWitness`; shapes (3,), (k,), (k, 3).
    """
    instants = knots * time
    widths = np.diff(instants)
    slopes = np.diff(multipliers, axis=0) / widths[:, None]
    cruise = float(relaxation.velocity_support(beta + slopes) @ widths)
    part = np.arange(subdivisions + 1) / subdivisions
    at = instants[:-1, None] + widths[:, None] * part
    value = multipliers[:-1, None] + (
        np.diff(multipliers, axis=0)[:, None] * part[:, None]
    )
    left, right = at[:, :-1], at[:, 1:]
    since = np.minimum(np.minimum(right, time - left), 0.5 * time)
    roll, pitch = relaxation.caps(since)
    heights = 0.5 * (
        relaxation.thrust_support(value[:, :-1], roll, pitch)
        + relaxation.thrust_support(value[:, 1:], roll, pitch)
    )
    thrust = float((heights * (right - left)).sum())
    gravity = relaxation.vehicle.gravity
    weight = gravity * float(
        (0.5 * (multipliers[:-1, 2] + multipliers[1:, 2])) @ widths
    )
    gain = float(beta @ displacement)
    magnitude = abs(gain) + abs(cruise) + abs(thrust) + abs(weight)
    return gain - (cruise + thrust - weight) - _MARGIN * magnitude


def lower_bound(
    relaxation: Relaxation,
    drone: int,
    displacement: FloatArray,
    guess: float,
    rounds: int = 8,
) -> DualWitness:
    """Prove that ``displacement`` takes at least some time.

    Parameters
    ----------
    drone
        Number put into the witness.
    displacement
        Shape (3,) [m], not zero.
    guess
        A time near the least possible one [s]; only a start for the search.
    rounds
        Linear programs solved at most.

    Returns
    -------
    DualWitness
        Its ``time`` is proved by :func:`surplus`.
    """
    best: tuple[float, FloatArray, FloatArray, FloatArray] | None = None
    before: tuple[float, float] | None = None
    time, power = guess, 1.25
    for _ in range(rounds):
        knots = _knots(relaxation, time)
        beta, multipliers, reach = _multipliers(relaxation, displacement, time, knots)
        proved = _longest(relaxation, displacement, beta, knots, multipliers, time)
        if best is None or proved > best[0]:
            best = proved, beta, knots, multipliers
        if abs(reach - 1.0) < _NEAR:
            break
        # The reach grows between linearly (cruise) and with the square of the time;
        # two programs tell the power.
        if before is not None and abs(math.log(time / before[0])) > 1e-6:
            slope = math.log(reach / before[1]) / math.log(time / before[0])
            power = min(2.5, max(0.8, slope))
        before = time, reach
        time *= min(2.0, max(0.5, reach ** (-1.0 / power)))
    assert best is not None  # noqa: S101 - rounds >= 1
    time, beta, knots, multipliers = best
    return DualWitness(
        drone=drone,
        time=time,
        beta=(float(beta[0]), float(beta[1]), float(beta[2])),
        knots=tuple(float(knot) for knot in knots),
        multipliers=tuple(
            (float(row[0]), float(row[1]), float(row[2])) for row in multipliers
        ),
    )


def _knots(relaxation: Relaxation, time: float) -> FloatArray:
    """Fractions of the time: even, with more of them while the tilt builds up."""
    even = np.linspace(0.0, 1.0, _INTERVALS + 1)
    rate = max(relaxation.limits.body_rate[:2])
    build_up = min(relaxation.limits.tilt / rate / time, 0.25)
    early = build_up * np.array([0.25, 0.5, 0.75, 1.0])
    return np.unique(np.round(np.concatenate([even, early, 1.0 - early]), 9))


def _longest(  # noqa: PLR0917 - same
    relaxation: Relaxation,
    displacement: FloatArray,
    beta: FloatArray,
    knots: FloatArray,
    multipliers: FloatArray,
    time: float,
) -> float:
    """Greatest time that the multipliers prove impossible, to 1e-6 [s]."""

    def proved(candidate: float) -> bool:
        # A longer time makes the same multipliers less steep; scale them along.
        scaled = multipliers * (candidate / time)
        return surplus(relaxation, displacement, candidate, beta, knots, scaled) > 0.0

    low, high = 0.0, time
    while proved(high) and high < 4.0 * time:
        low, high = high, 1.1 * high
    step = 0.97
    while low == 0.0 and high > 1e-3 * time:
        if proved(step * high):
            low = step * high
        else:
            high *= step
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if proved(middle) else (low, middle)
    multipliers *= low / time
    return low


def _multipliers(
    relaxation: Relaxation,
    displacement: FloatArray,
    time: float,
    knots: FloatArray,
) -> tuple[FloatArray, FloatArray, float]:
    """Beta (3,), lambda (k, 3) and the share of the way the relaxed move makes.

    Linear program over the share sigma, mean velocities v_j and corner weights w_ik of
    the thrust set: sigma d = sum v_j dt_j; the thrust impulse at knots up to interval j
    gives v_j (trapezoid weights). Its constraint multipliers are beta and lambda.
    """
    from scipy.optimize import linprog  # noqa: PLC0415 - scipy only when solving
    from scipy.sparse import block_diag, bmat, csr_matrix, identity, kron  # noqa: PLC0415

    widths = np.diff(knots) * time
    intervals = widths.size
    nodes = intervals + 1
    instants = knots * time
    roll, pitch = relaxation.caps(np.minimum(instants, time - instants))
    corners = [
        relaxation.vertices(float(roll[k]), float(pitch[k])) for k in range(nodes)
    ]
    size = corners[0].shape[0]
    weight = np.zeros(nodes)
    weight[:-1] += 0.5 * widths
    weight[1:] += 0.5 * widths
    # Knot k: v_{k} - v_{k-1} = weight_k (u_k - g e_z), v before the first and after
    # the last interval being zero.
    difference = csr_matrix(
        (
            np.concatenate([np.ones(intervals), -np.ones(intervals)]),
            (
                np.concatenate([np.arange(intervals), np.arange(1, nodes)]),
                np.concatenate([np.arange(intervals), np.arange(intervals)]),
            ),
        ),
        shape=(nodes, intervals),
    )
    thrust = block_diag([-weight[k] * corners[k].T for k in range(nodes)], format="csr")
    motion = kron(difference, identity(3), format="csr")
    way = kron(csr_matrix(widths[None, :]), identity(3), format="csr")
    convex = kron(identity(nodes), csr_matrix(np.ones((1, size))), format="csr")
    share = csr_matrix(-displacement[:, None])
    equations = bmat(
        [[share, way, None], [None, motion, thrust], [None, None, convex]],
        format="csc",
    )
    right = np.zeros(equations.shape[0])
    right[5 : 3 + 3 * nodes : 3] = -weight * relaxation.vehicle.gravity
    right[3 + 3 * nodes :] = 1.0
    limits = relaxation.limits
    lower = np.concatenate(
        [[0.0], np.tile(limits.velocity_min, intervals), np.zeros(nodes * size)]
    )
    upper = np.concatenate(
        [
            [np.inf],
            np.tile(limits.velocity_max, intervals),
            np.full(nodes * size, np.inf),
        ]
    )
    cost = np.zeros(lower.size)
    cost[0] = -1.0
    answer = linprog(
        cost,
        A_eq=equations,
        b_eq=right,
        bounds=np.column_stack([lower, upper]),
        method="highs-ds",
    )
    if answer.status != 0:
        return _toward(displacement), np.zeros((nodes, 3)), 1.0
    marginal = np.asarray(answer.eqlin.marginals)
    beta, multipliers = -marginal[:3], marginal[3 : 3 + 3 * nodes].reshape(nodes, 3)
    return *_signed(beta, multipliers, displacement), float(-answer.fun)


def _signed(
    beta: FloatArray, multipliers: FloatArray, displacement: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Turn both so that ``beta . d`` is 1, which the program's scaling makes of it."""
    gain = float(beta @ displacement)
    if gain < 0.0:
        beta, multipliers, gain = -beta, -multipliers, -gain
    if gain < 1e-9:
        return _toward(displacement), np.zeros_like(multipliers)
    return beta / gain, multipliers / gain


def _toward(displacement: FloatArray) -> FloatArray:
    return np.asarray(displacement / float(displacement @ displacement))
