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
from typing import TYPE_CHECKING, Any

import highspy
import numpy as np

from showc.fleet.lower_bound.relaxation import hovering

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray
    from showc.fleet.lower_bound.relaxation import Relaxation


_LEAST = 1e-6
"""Stands for no acceleration [m/s²] and no way [m²]."""


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
        self._solver = highspy.Highs()  # type: ignore[no-untyped-call]
        for option, value in (
            ("output_flag", False),
            ("threads", 1),
            ("solver", "simplex"),
        ):
            self._solver.setOptionValue(option, value)
        self._columns = 0

    def multipliers(
        self, time: float, knots: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Return beta (3,), knots, multipliers and the share sigma made in ``time``.

        Parameters
        ----------
        time
            Of the whole move [s].
        knots
            Fractions of it, from 0 to 1, shape (k,).

        Returns
        -------
        tuple
            Multipliers (m, 3 or 6) at their knots (m,), as
            :class:`showc.flight.DualWitness` has them, scaled so that ``beta . (d -
            c)`` is 1; where the program has no answer, beta along the way, no others,
            and 1.
        """
        lp = self._program(time, knots)
        basis = self._solver.getBasis() if self._columns == lp.num_col_ else None
        self._solver.passModel(lp)
        if basis is not None and basis.valid:
            self._solver.setBasis(basis)
        self._columns = lp.num_col_
        self._solver.run()
        if self._solver.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            self._columns = 0
            none = np.zeros((knots.size, 6 if self._jerk else 3))
            return self._toward(), knots, none, 1.0
        marginal = np.array(self._solver.getSolution().row_dual)
        beta = -marginal[:3]
        multipliers = marginal[3 : 3 + 3 * knots.size].reshape(-1, 3)
        share = -float(self._solver.getObjectiveValue())
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
        return beta, knots, multipliers, share

    def _program(self, time: float, knots: FloatArray) -> Any:  # noqa: ANN401 - HiGHS
        relaxation, limits = self._relaxation, self._relaxation.limits
        widths = np.diff(knots) * time
        intervals, nodes = widths.size, knots.size
        instants = knots * time
        roll, pitch = relaxation.caps(instants, time - instants, self._ends)
        corners = relaxation.vertices(
            roll,
            pitch,
            displacement=self._displacement,
            straight=not self._offset.any(),
        )
        size = corners.shape[1]
        weight = np.zeros(nodes)
        weight[:-1] += 0.5 * widths
        weight[1:] += 0.5 * widths
        # Columns after each other: the share, velocities (interval, axis) with three
        # entries each, weights (knot, corner) with four.
        axis = np.tile(np.arange(3), intervals)
        interval = np.repeat(np.arange(intervals), 3)
        knot = np.repeat(np.arange(nodes), size)
        rows_of_velocity = np.stack(
            [axis, 3 + 3 * interval + axis, 6 + 3 * interval + axis], axis=1
        )
        one = np.ones(axis.size)
        velocity = np.stack([widths[interval], one, -one], axis=1)
        rows_of_weight = np.column_stack(
            [3 + 3 * knot, 4 + 3 * knot, 5 + 3 * knot, 3 + 3 * nodes + knot]
        )
        thrust = -weight[knot, None] * corners.reshape(-1, 3)
        thrust = np.column_stack([thrust, np.ones(knot.size)])
        lp = highspy.HighsLp()
        lp.num_col_ = 1 + axis.size + knot.size
        lp.num_row_ = 3 + 4 * nodes
        lp.col_cost_ = np.concatenate([[-1.0], np.zeros(axis.size + knot.size)])
        lp.col_lower_ = np.concatenate(
            [[0.0], np.tile(limits.velocity_min, intervals), np.zeros(knot.size)]
        )
        lp.col_upper_ = np.concatenate(
            [
                [np.inf],
                np.tile(limits.velocity_max, intervals),
                np.full(knot.size, np.inf),
            ]
        )
        if limits.rounds_speed:
            # Along the move the level speed counts, not the box.
            level = self._displacement * np.array([1.0, 1.0, 0.0])
            level /= max(float(np.linalg.norm(level)), 1e-12)
            lp.num_row_ += intervals
            rows_of_velocity = np.column_stack(
                [rows_of_velocity, 3 + 4 * nodes + interval]
            )
            velocity = np.column_stack([velocity, level[axis]])
        low, high = self._steps(widths)
        if low.size:
            # Each knot's thrust ends one step and begins the next.
            first = lp.num_row_ + 3 * knot[:, None] + np.arange(3)
            rows_of_weight = np.column_stack([rows_of_weight, first, first + 3])
            turned = corners.reshape(-1, 3) @ self._frame.T
            thrust = np.column_stack([thrust, turned, -turned])
        right = np.zeros(lp.num_row_)
        right[:3] = self._offset
        right[5 : 3 + 3 * nodes : 3] = -weight * relaxation.vehicle.gravity
        right[3:6] += self._ends[0, 3:6]
        right[3 * nodes : 3 + 3 * nodes] -= self._ends[1, 3:6]
        right[3 + 3 * nodes : 3 + 4 * nodes] = 1.0
        left = right.copy()
        right[3 + 4 * nodes :] = limits.level_speed
        left[3 + 4 * nodes :] = -np.inf
        lp.num_row_ += low.size
        lp.row_lower_ = np.concatenate([left, low])
        lp.row_upper_ = np.concatenate([right, high])
        _fill(
            lp.a_matrix_,
            (np.arange(3)[None], -self._displacement[None]),
            (rows_of_velocity, velocity),
            (rows_of_weight, thrust),
        )
        return lp

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


def _fill(matrix: Any, *parts: tuple[IntArray, FloatArray]) -> None:  # noqa: ANN401
    """Write columns after each other, from rows and values (columns, entries)."""
    matrix.format_ = highspy.MatrixFormat.kColwise
    each = [np.full(rows.shape[0], rows.shape[1]) for rows, _ in parts]
    matrix.start_ = np.concatenate([[0], np.cumsum(np.concatenate(each))])
    matrix.index_ = np.concatenate([rows.ravel() for rows, _ in parts])
    matrix.value_ = np.concatenate([values.ravel() for _, values in parts])
