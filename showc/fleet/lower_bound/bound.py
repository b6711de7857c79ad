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
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from showc.fleet.lower_bound.relaxation import HOVERS, hovering
from showc.flight import DualWitness

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import FloatArray
    from showc.fleet.lower_bound.relaxation import Relaxation
    from showc.fleet.lower_bound.relaxed_move import Multipliers


_SUBDIVISIONS = 32
"""Parts of a knot interval on which the thrust is bounded: twice as many sharpened the
bounds of ten random moves by 2e-5 to 3e-4 of the time."""
_MARGIN = 1e-9
"""What rounding may have changed of a surplus, as a share of its terms."""
_INTERVALS = 36
"""Even knots of the multipliers: twice as many sharpened these bounds by 1e-4 to 2e-3,
that of a flight of 22 s by 5e-3, and make the linear programs take twice as long."""
_NEAR, _WORTH_A_PROOF = 5e-4, 0.03
"""Shares of the reach: so near one the search ends, and so near it a proof is tried."""
_NONE = 1e-3
"""Share of the way that is as little as none: the time doubles for less than 0.4."""
_RESOLUTION = 1e-6
"""To what the greatest impossible time of one drone is found [s]."""


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
    betas = np.broadcast_to(beta, (knots.size - 1, 3))
    spent = spending(relaxation, time, betas, knots, multipliers, ends)
    gain = float(beta @ displacement)
    swing = float(
        multipliers[-1, :3] @ ends[1, 3:6] - multipliers[0, :3] @ ends[0, 3:6]
    )
    size = abs(gain) + abs(swing) + spent.size
    left_over = rounded_down(gain + swing - spent.most, size)
    # Without the others, shorter times would not be impossible as well.
    return min(left_over, rounded_down(gain, size), spent.pushing)


@dataclass(frozen=True, slots=True)
class Spending:
    """An upper bound of the right side of the inequality, and of its rounding."""

    most: float
    """The bound itself."""
    pushing: float
    """What of it thrust and weight make."""
    size: float
    """Sum of the sizes of its terms."""


def rounded_down(surplus: float, size: float) -> float:
    """Take from a surplus what rounding of terms of some size may have added."""
    return surplus - _MARGIN * size


def spending(  # noqa: PLR0917 - the names of the inequality
    relaxation: Relaxation,
    time: float,
    betas: FloatArray,
    knots: FloatArray,
    multipliers: FloatArray,
    ends: FloatArray = HOVERS,
    parts: int = _SUBDIVISIONS,
) -> Spending:
    """Bound the integral of the inequality from above.

    On each part of a knot interval the caps on tilt are taken at their greatest; then
    h_U is convex in lambda, lambda is linear, and the trapezoid rule errs upward.

    Parameters
    ----------
    betas
        beta on each knot interval, shape (..., k - 1, 3).
    time, knots, multipliers, ends
        As of :func:`surplus`; of several drones without mu the multipliers have shape
        (..., k, 3), and the sum of all integrals is bounded.
    parts
        Of each knot interval, on which the thrust is bounded.
    """
    instants = knots * time
    widths = np.diff(instants)
    multipliers, turns = multipliers[..., :3], multipliers[..., 3:]
    shift, turning = np.zeros((widths.size, 3)), 0.0
    if turns.size:
        shift = np.diff(turns, axis=0) / widths[:, None]
        # The length of mu is convex: the trapezoid rule errs upward.
        size = np.linalg.norm(turns, axis=1)
        if np.any(size[[0, -1]][~hovering(ends)]):
            return Spending(np.inf, 0.0, 0.0)
        turning = relaxation.limits.jerk * float(0.5 * (size[:-1] + size[1:]) @ widths)
    steps = np.diff(multipliers, axis=-2)
    slopes = steps / widths[:, None]
    cruise = float((relaxation.velocity_support(betas + slopes) @ widths).sum())
    part = np.arange(parts + 1) / parts
    at = instants[:-1, None] + widths[:, None] * part
    begin = multipliers[..., :-1, :] + shift
    value = begin[..., None, :] + steps[..., None, :] * part[:, None]
    left, right = at[:, :-1], at[:, 1:]
    roll, pitch = relaxation.caps(right, time - left, ends)
    # Each support function is convex, their least is not: the least comes last.
    sides = np.stack([value[..., :-1, :], value[..., 1:, :]])
    means = [
        0.5 * (before + after)
        for before, after in relaxation.thrust_supports(sides, roll, pitch)
    ]
    thrust = float((np.min(means, axis=0) * (right - left)).sum())
    lifted = 0.5 * (multipliers[..., :-1, 2] + multipliers[..., 1:, 2]) + shift[:, 2]
    weight = relaxation.vehicle.gravity * float((lifted @ widths).sum())
    size = abs(cruise) + abs(thrust) + abs(weight) + turning
    return Spending(cruise + thrust - weight + turning, thrust - weight, size)


def lower_bound(  # noqa: PLR0917 - tasks of workers are tuples
    relaxation: Relaxation,
    drone: int,
    displacement: FloatArray,
    guess: float,
    rounds: int = 8,
    ends: FloatArray = HOVERS,
    beyond: bool = False,  # noqa: FBT001, FBT002 - as above
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
    beyond
        Whether only a bound beyond the guess is of use. The search ends with the first
        program if that makes the whole move in it: no greater bound is there then.

    Returns
    -------
    DualWitness
        Its ``time`` is proved by :func:`surplus`.
    """
    # HiGHS is loaded only where something is solved.
    from showc.fleet.lower_bound.relaxed_move import RelaxedMove  # noqa: PLC0415

    move = RelaxedMove(relaxation, displacement, ends)

    def proof(time: float) -> _ProofOfOne:
        found = move.multipliers(time, knots_of(relaxation, time, _INTERVALS))
        return _ProofOfOne(time, relaxation, displacement, ends, found)

    longest, found = greatest_proved(proof, guess, rounds, beyond=beyond)
    beta, knots = found.by.beta, found.by.knots
    multipliers = _stretched(found.by.at_knots, longest / found.time)
    return DualWitness(
        drone=drone,
        time=longest,
        beta=(float(beta[0]), float(beta[1]), float(beta[2])),
        knots=tuple(float(knot) for knot in knots),
        multipliers=tuple(tuple(row) for row in multipliers.tolist()),
    )


class Proof(Protocol):
    """Multipliers of the program of a time."""

    @property
    def time(self) -> float:
        """The time [s]."""

    @property
    def reach(self) -> float:
        """Share of the way that the relaxed drone makes in it."""

    def over(self, time: float) -> float:
        """Surplus with which the multipliers, stretched, prove a time [s] wrong."""


P = TypeVar("P", bound=Proof)


@dataclass(frozen=True, slots=True, eq=False)
class _ProofOfOne:
    time: float
    relaxation: Relaxation
    displacement: FloatArray
    ends: FloatArray
    by: Multipliers

    @property
    def reach(self) -> float:
        """Say what :class:`Proof` asks for."""
        return self.by.share

    def over(self, time: float) -> float:
        """Say what :class:`Proof` asks for."""
        way, by = self.displacement, self.by
        scaled = _stretched(by.at_knots, time / self.time)
        proof = self.relaxation, way, time, by.beta, by.knots, scaled
        return surplus(*proof, ends=self.ends)


def greatest_proved(
    proof: Callable[[float], P],
    guess: float,
    rounds: int,
    resolution: float = _RESOLUTION,
    *,
    beyond: bool = False,
) -> tuple[float, P]:
    """Prove the greatest time impossible, from program to program.

    Parameters
    ----------
    proof
        Solves the program of a time [s].
    guess
        A time near the least possible one [s].
    rounds
        Programs solved at most.
    resolution
        To what the time is found [s].
    beyond
        Whether only a time beyond the guess is of use: where the program of the guess
        makes the whole move, there is none.

    Returns
    -------
    tuple
        The time [s], 0 if none is proved, and the multipliers that prove it.
    """
    best: tuple[float, P] | None = None
    before: P | None = None
    time, power = guess, 1.25
    for number in range(rounds):
        found = proof(time)
        last = number == rounds - 1 or abs(found.reach - 1.0) < _NEAR
        last |= beyond and number == 0 and found.reach >= 1.0
        if last or abs(found.reach - 1.0) < _WORTH_A_PROOF:
            longest = _longest(found, resolution)
            if best is None or longest > best[0]:
                best = longest, found
        if last:
            break
        # Of moves below a micrometre the program says that none is made.
        reach = max(found.reach, _NONE)
        # The reach grows between linearly (cruise) and with the square of the time;
        # two programs tell the power.
        if before is not None and abs(math.log(time / before.time)) > 1e-6:
            slope = math.log(reach / max(before.reach, _NONE))
            slope /= math.log(time / before.time)
            power = min(2.5, max(0.8, slope))
        before = found
        time *= min(2.0, max(0.5, reach ** (-1.0 / power)))
    assert best is not None  # noqa: S101 - rounds >= 1
    return best


def _stretched(multipliers: FloatArray, scale: float) -> FloatArray:
    """Multipliers for another time: the same lambda' and the same mu' over lambda."""
    powers = np.repeat([1.0, 2.0], 3)[: multipliers.shape[1]]
    return np.asarray(multipliers * scale**powers)


def knots_of(relaxation: Relaxation, time: float, intervals: int) -> FloatArray:
    """Fractions of a time [s]: even, with more of them while the tilt builds up."""
    even = np.linspace(0.0, 1.0, intervals + 1)
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


def _longest(proof: Proof, resolution: float) -> float:
    """Greatest time that multipliers prove impossible [s]; 0 if they do none.

    Where the surplus changes its sign, by false position (Illinois).
    """
    time, over = proof.time, proof.over
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
    while high - low > resolution:
        share = weight_low / (weight_low - weight_high)
        candidate = low + share * (high - low)
        # Once one end is that near, the other one is fetched.
        candidate = min(max(candidate, low + 0.4 * resolution), high)
        candidate = max(min(candidate, high - 0.4 * resolution), low)
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
