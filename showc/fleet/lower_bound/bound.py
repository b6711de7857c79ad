"""A rigorous lower bound on the time of one drone's move, with its proof.

Relaxation: velocity in its box, thrust acceleration in the set U(t) that thrust, tilt,
body rates and angular accelerations allow at time t after one end and T - t before the
other. A time T is impossible if multipliers beta and lambda(t) with

    beta . d + lambda(T) . v(T) - lambda(0) . v(0)
        > integral over [0, T] of h_V(beta + lambda') + h_U(t)(lambda) - g lambda_z

exist (h: support functions; see :class:`showc.flight.DualWitness`, with mu for jerk).
The multipliers
come from a linear program, the dual of which is the relaxed move on a coarse mesh; they
are then judged by an integral that is rounded upward, so the bound does not depend on
the program having been solved well. An impossible T makes every shorter time theta T
impossible too, theta between 0 and 1: with lambda times theta on the same fractions of
the time, the left side less the right one is at least beta . d + theta a - theta² b
with constants a and b, b the bound of the integral of h_U(lambda) - g lambda_z. Where
that is not below 0 it is concave in theta, and positive at 0 and 1 where beta . d is;
so it is with mu times theta², whose part grows with theta³.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.lower_bound.relaxation import HOVERS, hovering
from showc.flight import DualWitness

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.lower_bound.relaxation import Relaxation


_SUBDIVISIONS = 32
"""Parts of a knot interval on which the thrust is bounded: twice as many sharpened the
bounds of ten random moves by 2e-5 to 3e-4 of the time."""
_MARGIN = 1e-9
"""What rounding may have changed of a surplus, as a share of its terms."""
_INTERVALS = 36
"""Even knots of the multipliers: twice as many sharpened these bounds by 1e-4 to 2e-3,
that of a flight of 22 s by 5e-3, and make the linear programs take twice as long."""
_NEAR = 5e-4
_WORTH_A_PROOF = 0.03
"""Shares of the reach: so near one the search ends, and so near it a proof is tried."""
_NONE = 1e-3
"""Share of the way that is as little as none: the time doubles for less than 0.4."""
_RESOLUTION = 1e-6
"""To what the greatest impossible time is found [s]."""


def surplus(  # noqa: PLR0917 - the names of the inequality
    relaxation: Relaxation,
    displacement: FloatArray,
    time: float,
    beta: FloatArray,
    knots: FloatArray,
    multipliers: FloatArray,
    ends: FloatArray = HOVERS,
) -> float:
    """Left minus an upper bound of the right side: above 0 proves ``time`` wrong.

    On each part of a knot interval the caps on tilt are taken at their greatest; then
    h_U is convex in lambda, lambda is linear, and the trapezoid rule errs upward.

    Parameters
    ----------
    displacement
        Shape (3,) [m].
    time
        T [s].
    beta, knots, multipliers
        As in :class:`showc.flight.DualWitness`; shapes (3,), (k,), (k, 3 or 6).
    ends
        States at the start and at the goal, shape (2, 12 or more).
    """
    instants = knots * time
    widths = np.diff(instants)
    multipliers, turns = multipliers[:, :3], multipliers[:, 3:]
    shift, turning = np.zeros((widths.size, 3)), 0.0
    if turns.size:
        shift = np.diff(turns, axis=0) / widths[:, None]
        # The length of mu is convex: the trapezoid rule errs upward.
        size = np.linalg.norm(turns, axis=1)
        if np.any(size[[0, -1]][~hovering(ends)]):
            return -np.inf
        turning = relaxation.limits.jerk * float(0.5 * (size[:-1] + size[1:]) @ widths)
    slopes = np.diff(multipliers, axis=0) / widths[:, None]
    cruise = float(relaxation.velocity_support(beta + slopes) @ widths)
    part = np.arange(_SUBDIVISIONS + 1) / _SUBDIVISIONS
    at = instants[:-1, None] + widths[:, None] * part
    value = (multipliers[:-1] + shift)[:, None] + (
        np.diff(multipliers, axis=0)[:, None] * part[:, None]
    )
    left, right = at[:, :-1], at[:, 1:]
    roll, pitch = relaxation.caps(right, time - left, ends)
    # Each support function is convex, their least is not: the least comes last.
    sides = zip(
        relaxation.thrust_supports(value[:, :-1], roll, pitch),
        relaxation.thrust_supports(value[:, 1:], roll, pitch),
        strict=True,
    )
    heights = np.min([0.5 * (before + after) for before, after in sides], axis=0)
    thrust = float((heights * (right - left)).sum())
    gravity = relaxation.vehicle.gravity
    weight = gravity * float(
        (0.5 * (multipliers[:-1, 2] + multipliers[1:, 2]) + shift[:, 2]) @ widths
    )
    gain = float(beta @ displacement)
    swing = float(multipliers[-1] @ ends[1, 3:6] - multipliers[0] @ ends[0, 3:6])
    loss = cruise + thrust - weight + turning
    magnitude = abs(gain) + abs(swing) + abs(cruise) + abs(thrust) + abs(weight)
    left_over = gain + swing - loss - _MARGIN * (magnitude + turning)
    # Without the others, shorter times would not be impossible as well.
    return min(left_over, gain - _MARGIN * magnitude, thrust - weight)


def lower_bound(  # noqa: PLR0917 - tasks of workers are tuples
    relaxation: Relaxation,
    drone: int,
    displacement: FloatArray,
    guess: float,
    rounds: int = 8,
    ends: FloatArray = HOVERS,
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
    ends
        States at the start and at the goal, shape (2, 12 or more).

    Returns
    -------
    DualWitness
        Its ``time`` is proved by :func:`surplus`.
    """
    # HiGHS is loaded only where something is solved.
    from showc.fleet.lower_bound.relaxed_move import RelaxedMove  # noqa: PLC0415

    move = RelaxedMove(relaxation, displacement, ends)
    best: tuple[float, FloatArray, FloatArray, FloatArray] | None = None
    before: tuple[float, float] | None = None
    time, power = guess, 1.25
    for number in range(rounds):
        beta, knots, multipliers, reach = move.multipliers(
            time, _knots(relaxation, time)
        )
        last = number == rounds - 1 or abs(reach - 1.0) < _NEAR
        if last or abs(reach - 1.0) < _WORTH_A_PROOF:
            proof = relaxation, displacement, beta, knots, multipliers, time
            longest = _longest(*proof, ends)
            if best is None or longest > best[0]:
                best = longest, beta, knots, _stretched(multipliers, longest / time)
        if last:
            break
        # Of moves below a micrometre the program says that none is made.
        reach = max(reach, _NONE)
        # The reach grows between linearly (cruise) and with the square of the time;
        # two programs tell the power.
        if before is not None and abs(math.log(time / before[0])) > 1e-6:
            slope = math.log(reach / before[1]) / math.log(time / before[0])
            power = min(2.5, max(0.8, slope))
        before = time, reach
        time *= min(2.0, max(0.5, reach ** (-1.0 / power)))
    assert best is not None  # noqa: S101 - rounds >= 1
    longest, beta, knots, multipliers = best
    return DualWitness(
        drone=drone,
        time=longest,
        beta=(float(beta[0]), float(beta[1]), float(beta[2])),
        knots=tuple(float(knot) for knot in knots),
        multipliers=tuple(tuple(row) for row in multipliers.tolist()),
    )


def _stretched(multipliers: FloatArray, scale: float) -> FloatArray:
    """Multipliers for another time: the same lambda' and the same mu' over lambda."""
    powers = np.repeat([1.0, 2.0], 3)[: multipliers.shape[1]]
    return np.asarray(multipliers * scale**powers)


def _knots(relaxation: Relaxation, time: float) -> FloatArray:
    """Fractions of the time: even, with more of them while the tilt builds up."""
    even = np.linspace(0.0, 1.0, _INTERVALS + 1)
    rate = max(relaxation.limits.body_rate[:2])
    build_up = min(relaxation.limits.tilt / rate / time, 0.25)
    early = build_up * np.array([0.25, 0.5, 0.75, 1.0])
    if relaxation.limits.tilt == 0.0:
        early = np.minimum(_ramps(relaxation) / time, 0.5)
    return np.unique(np.round(np.concatenate([even, early, 1.0 - early]), 9))


def _ramps(relaxation: Relaxation) -> FloatArray:
    """Return how long an upright drone takes to gain, and to lose, its speed [s]."""
    limits, gravity = relaxation.limits, relaxation.vehicle.gravity
    low, high = relaxation.vertical(np.zeros(1), np.zeros(1))
    speed = max(-limits.velocity_min[2], limits.velocity_max[2])
    return np.concatenate([speed / (high - gravity), speed / (gravity - low)])


def _longest(  # noqa: PLR0917 - same
    relaxation: Relaxation,
    displacement: FloatArray,
    beta: FloatArray,
    knots: FloatArray,
    multipliers: FloatArray,
    time: float,
    ends: FloatArray,
) -> float:
    """Greatest time that the multipliers prove impossible, to 1e-6 [s].

    Where the surplus changes its sign, by false position (Illinois).
    """

    def over(candidate: float) -> float:
        scaled = _stretched(multipliers, candidate / time)
        proof = relaxation, displacement, candidate, beta, knots, scaled
        return surplus(*proof, ends=ends)

    low = high = time
    value_low = value_high = over(time)
    width = 1e-3
    while value_high > 0.0 and high < 4.0 * time:
        low, value_low = high, value_high
        high = time * (1.0 + width)
        value_high = over(high)
        width *= 4.0
    while value_low <= 0.0 and low > 1e-3 * time:
        high, value_high = low, value_low
        low = time * max(1.0 - width, 1e-3)
        value_low = over(low)
        width *= 4.0
    if value_low <= 0.0 or value_high > 0.0:
        return low if value_low > 0.0 else 0.0
    weight_low, weight_high = value_low, value_high
    rose = fell = False
    while high - low > _RESOLUTION:
        share = weight_low / (weight_low - weight_high)
        candidate = low + share * (high - low)
        # Once one end is that near, the other one is fetched.
        candidate = min(max(candidate, low + 0.4 * _RESOLUTION), high)
        candidate = max(min(candidate, high - 0.4 * _RESOLUTION), low)
        value = over(candidate)
        # An end that stays where it is twice in a row counts for less.
        if value > 0.0:
            low, weight_low = candidate, value
            weight_high *= 0.5 if rose else 1.0
        else:
            high, weight_high = candidate, value
            weight_low *= 0.5 if fell else 1.0
        rose, fell = value > 0.0, value <= 0.0
    return low
