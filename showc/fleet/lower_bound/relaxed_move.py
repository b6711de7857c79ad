"""The linear program whose dual solution proves a lower bound on the time of a move.

Unknowns are the share sigma of the way that the relaxed drone makes in a time, its mean
velocities v_j on mesh intervals and the weights w_ik of corners of the thrust set at
the knots between them:

    c + sigma (d - c) = sum of v_j dt_j,
    v_k - v_{k-1} = weight_k (sum of w_ik u_ik - g e_z),  sum of w_ik = 1,

with the trapezoid rule's weights and the velocities of the ends before and after. The
way c is about that of stopping, and of gaining the velocity of the end: where any way
can be made in a time, it can, so that sigma is 1 or more where the move can be made.
The multipliers of the first equations are beta, those of the second lambda. Where jerk
is at most j,

    |R (u_k - u_{k-1})| <= j dt_k, axis by axis, u = g e_z before and after a hover,

R turning the first axis into the move. The multipliers, turned back, are mu in the
middles of the intervals, and at both ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import highspy
import numpy as np

from showc.fleet.lower_bound.relaxation import hovering

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.lower_bound.relaxation import Push, Relaxation


_LEAST = 1e-6
"""Stands for no acceleration [m/s²] and no way [m²]."""


@dataclass(frozen=True, slots=True, eq=False)
class Multipliers:
    """What proves a time, as :class:`showc.flight.DualWitness` has it."""

    beta: FloatArray
    """Of the way, shape (3,), scaled so that ``beta . (d - c)`` is 1."""
    knots: FloatArray
    """Fractions of the time, shape (m,)."""
    at_knots: FloatArray
    """Of thrust, and of turns where jerk is limited, shape (m, 3 or 6)."""
    share: float
    """Of the way, made in the time."""


class RelaxedMove:
    """Solves the program of one move for one time after the other.

    Each starts from the last one's basis: for a time near by few steps are needed.

    Parameters
    ----------
    displacement
        The move, shape (3,) [m].
    ends
        States at its start and goal, shape (2, 12 or more).
    """

    def __init__(
        self, relaxation: Relaxation, displacement: FloatArray, ends: FloatArray
    ) -> None:
        self._relaxation, self._ends = relaxation, ends
        pull = relaxation.vehicle.gravity * math.tan(relaxation.limits.tilt)
        pull = min(pull, relaxation.limits.acceleration or math.inf)
        speeds = ends[:, 3:6]
        size = np.linalg.norm(speeds, axis=1, keepdims=True)
        self._offset = (speeds * size).sum(axis=0) / (2.0 * max(pull, _LEAST))
        self._displacement = displacement - self._offset
        self._jerk = relaxation.limits.jerk
        # Rows: the move's direction, and two across it.
        self._frame = np.linalg.svd(self._displacement[None])[2]
        self._solver = Solver()

    def multipliers(self, time: float, knots: FloatArray) -> Multipliers:
        """Return the multipliers of the program of a ``time``.

        Parameters
        ----------
        time
            Of the whole move [s].
        knots
            Fractions of it, from 0 to 1, shape (k,).

        Returns
        -------
        Multipliers
            Where the program has no answer, beta along the way, no others, and 1.
        """
        found = self._solver.solve(self._program(time, knots))
        if found is None:
            none = np.zeros((knots.size, 6 if self._jerk else 3))
            return Multipliers(self._toward(), knots, none, 1.0)
        marginal, share = found
        beta = -marginal[:3]
        multipliers = marginal[3 : 3 + 3 * knots.size].reshape(-1, 3)
        if self._jerk:
            turns = marginal[-3 * (knots.size + 1) :].reshape(-1, 3) @ self._frame
            middles = 0.5 * (knots[:-1] + knots[1:])
            places = np.concatenate([[0.0], middles, [1.0]])
            both = np.union1d(knots, middles)
            multipliers = np.column_stack(
                [np.interp(both, knots, column) for column in multipliers.T]
                + [np.interp(both, places, column) for column in turns.T]
            )
            knots = both
        beta, multipliers = self._signed(beta, multipliers)
        return Multipliers(beta, knots, multipliers, share)

    def _program(self, time: float, knots: FloatArray) -> Any:  # noqa: ANN401 - HiGHS
        widths = np.diff(knots) * time
        push: Push = "round" if self._offset.any() else "along"
        part = Columns.of(
            self._relaxation, self._displacement, time, knots, self._ends, push=push
        )
        part.bounds[:, :3] += self._offset
        rows, thrust = part.weight_rows, part.weights
        low, high = self._steps(widths)
        if low.size:
            # Each knot's thrust ends one step and begins the next.
            first = part.rows + 3 * part.knot[:, None] + np.arange(3)
            rows = np.column_stack([rows, first, first + 3])
            turned = part.corners @ self._frame.T
            thrust = np.column_stack([thrust, turned, -turned])
        share = np.arange(3)[None], -self._displacement[None]
        return program(
            self._relaxation,
            np.column_stack([part.bounds, [low, high]]),
            [share, (part.velocity_rows, part.velocities), (rows, thrust)],
        )

    def _steps(self, widths: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds of the rows that jerk has: of each step of the thrust, end to end."""
        if not self._jerk:
            return np.zeros(0), np.zeros(0)
        hover = self._relaxation.vehicle.gravity * self._frame[:, 2]
        most = np.repeat(self._jerk * widths, 3)
        # An end that moves has a thrust of its own: nothing is said of it here.
        free = np.where(hovering(self._ends)[:, None], 0.0, np.inf)
        return (
            np.concatenate([hover - free[0], -most, -hover - free[1]]),
            np.concatenate([hover + free[0], most, -hover + free[1]]),
        )

    def _signed(
        self, beta: FloatArray, multipliers: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Turn both so that ``beta . (d - c)`` is 1, as the program's scaling does."""
        gain = float(beta @ self._displacement)
        if gain < 0.0:
            beta, multipliers, gain = -beta, -multipliers, -gain
        if gain < 1e-9:
            return self._toward(), np.zeros_like(multipliers)
        return beta / gain, multipliers / gain

    def _toward(self) -> FloatArray:
        way = self._displacement
        return np.asarray(way / max(float(way @ way), _LEAST))


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """What one drone's unknowns add to the rows of a program, counted from its own.

    Rows are 3 of the whole way, 3 for each knot, one for each knot's weights and, where
    level speed is limited, one for each interval.
    """

    velocity_rows: IntArray
    """Shape (3 intervals, e), interval by interval."""
    velocities: FloatArray
    """Entries of these."""
    weight_rows: IntArray
    """Shape (weights, e), knot by knot."""
    weights: FloatArray
    """Entries of these."""
    corners: FloatArray
    """Thrust over mass of each weight, shape (weights, 3) [m/s²]."""
    knot: IntArray
    """Knot of each weight, shape (weights,)."""
    bounds: FloatArray
    """Least and greatest values of the rows, shape (2, rows)."""

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return int(self.bounds.shape[1])

    @classmethod
    def of(
        cls,
        relaxation: Relaxation,
        displacement: FloatArray,
        time: float,
        knots: FloatArray,
        ends: FloatArray,
        *,
        push: Push,
    ) -> Columns:
        """Return what a drone on its move adds, and where it pushes."""
        limits = relaxation.limits
        widths = np.diff(knots) * time
        intervals, nodes = widths.size, knots.size
        instants = knots * time
        roll, pitch = relaxation.caps(instants, time - instants, ends)
        corners = relaxation.vertices(roll, pitch, displacement=displacement, push=push)
        knot = np.repeat(np.arange(nodes), corners.shape[1])
        corners = corners.reshape(-1, 3)
        weight = np.zeros(nodes)
        weight[:-1] += 0.5 * widths
        weight[1:] += 0.5 * widths
        axis = np.tile(np.arange(3), intervals)
        interval = np.repeat(np.arange(intervals), 3)
        velocity_rows = np.stack(
            [axis, 3 + 3 * interval + axis, 6 + 3 * interval + axis], axis=1
        )
        one = np.ones(axis.size)
        velocities = np.stack([widths[interval], one, -one], axis=1)
        weight_rows = np.column_stack(
            [3 + 3 * knot, 4 + 3 * knot, 5 + 3 * knot, 3 + 3 * nodes + knot]
        )
        thrust = np.column_stack([-weight[knot, None] * corners, np.ones(knot.size)])
        right = np.zeros(3 + 4 * nodes)
        right[5 : 3 + 3 * nodes : 3] = -weight * relaxation.vehicle.gravity
        right[3:6] += ends[0, 3:6]
        right[3 * nodes : 3 + 3 * nodes] -= ends[1, 3:6]
        right[3 + 3 * nodes :] = 1.0
        bounds = np.stack([right, right])
        if limits.rounds_speed:
            # Along the move the level speed counts, not the box.
            level = displacement * np.array([1.0, 1.0, 0.0])
            level /= max(float(np.linalg.norm(level)), 1e-12)
            velocity_rows = np.column_stack([velocity_rows, 3 + 4 * nodes + interval])
            velocities = np.column_stack([velocities, level[axis]])
            most = np.full(intervals, limits.level_speed)
            bounds = np.column_stack([bounds, [np.full(intervals, -np.inf), most]])
        return cls(
            velocity_rows, velocities, weight_rows, thrust, corners, knot, bounds
        )


Part = tuple["IntArray", "FloatArray"]
"""Rows and entries of columns, both of shape (columns, e)."""


def program(relaxation: Relaxation, bounds: FloatArray, parts: Sequence[Part]) -> Any:  # noqa: ANN401 - HiGHS
    """Return the program of a share, then velocities and weights of drone by drone.

    Parameters
    ----------
    bounds
        Least and greatest values of all rows, shape (2, rows).
    parts
        Columns of the share, then of the velocities and of the weights of each drone.
    """
    lp, limits = highspy.HighsLp(), relaxation.limits
    low, high = [np.zeros(1)], [np.full(1, np.inf)]
    for velocities, weights in zip(parts[1::2], parts[2::2], strict=True):
        each = velocities[0].shape[0] // 3
        low += [np.tile(limits.velocity_min, each), np.zeros(weights[0].shape[0])]
        high += [np.tile(limits.velocity_max, each)]
        high += [np.full(weights[0].shape[0], np.inf)]
    lp.col_lower_, lp.col_upper_ = np.concatenate(low), np.concatenate(high)
    columns = sum(rows.shape[0] for rows, _ in parts)
    lp.num_col_, lp.num_row_ = columns, bounds.shape[1]
    lp.col_cost_ = np.append(-1.0, np.zeros(columns - 1))
    lp.row_lower_, lp.row_upper_ = bounds
    matrix = lp.a_matrix_
    matrix.format_ = highspy.MatrixFormat.kColwise
    each = [np.full(rows.shape[0], rows.shape[1]) for rows, _ in parts]
    matrix.start_ = np.concatenate([[0], np.cumsum(np.concatenate(each))])
    matrix.index_ = np.concatenate([rows.ravel() for rows, _ in parts])
    matrix.value_ = np.concatenate([values.ravel() for _, values in parts])
    return lp


class Solver:
    """Solves programs one after the other, each from the last one's basis.

    For a time near by few steps are needed.
    """

    def __init__(self) -> None:
        self._highs = highspy.Highs()  # type: ignore[no-untyped-call]
        for option, value in (
            ("output_flag", False),
            ("threads", 1),
            ("solver", "simplex"),
        ):
            self._highs.setOptionValue(option, value)
        self._columns = 0

    def solve(self, lp: Any) -> tuple[FloatArray, float] | None:  # noqa: ANN401 - HiGHS
        """Return the multipliers of the rows and the share; None without an answer."""
        basis = self._highs.getBasis() if self._columns == lp.num_col_ else None
        self._highs.passModel(lp)
        if basis is not None and basis.valid:
            self._highs.setBasis(basis)
        self._columns = lp.num_col_
        self._highs.run()
        if self._highs.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            self._columns = 0
            return None
        marginal = np.array(self._highs.getSolution().row_dual)
        return marginal, -float(self._highs.getObjectiveValue())
