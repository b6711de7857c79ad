"""Controls in path constraints: with which other values they may be compared.

With the constraints' multipliers the Hamiltonian tells what its constraints cost only
where it is convex, and a single control cannot leave an equation without the others.
There controls are compared with values that keep the constraints.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.arrays import BoolArray, FloatArray
    from showc.ocp.audit.residuals import PhaseAuditor
    from showc.ocp.transcription.collocation.statement import Table

    Arguments = tuple[FloatArray, ...]
    """States, controls, time, parameters and costates at n places, in columns."""
    Hamiltonian = Callable[..., Any]

_MOST_CORNERS = 6
"""Controls in path constraints up to which all corners of their box are looked at."""
_RETURNS = 4
"""Newton's steps back onto equations."""
_KEPT = 1e-7
"""Violation of a path constraint over its scale, beyond the present one, up to which a
control may be compared with."""


class ConstrainedControls:
    """Path constraints of a phase as functions of its controls.

    Parameters
    ----------
    path
        Column of the path constraints.
    symbols
        States, controls, time and parameters (statics last), each a column.
    auditor
        Of the same phase: its path constraints are used.
    """

    def __init__(
        self,
        path: Any,  # noqa: ANN401 - of casadi
        symbols: tuple[Any, Any, Any, Any],
        auditor: PhaseAuditor,
    ) -> None:
        self.auditor = auditor
        slopes = casadi.jacobian(path, symbols[1])
        rows, columns = slopes.sparsity().get_triplet()
        self.entries = np.zeros(slopes.shape, dtype=bool)
        """Which control enters which path constraint, shape (constraints, controls)."""
        self.entries[rows, columns] = True
        self.mixed = np.asarray(self.entries.any(axis=1))
        """For each path constraint: whether a control enters it."""
        self.bound = np.asarray(self.entries.any(axis=0))
        """For each control: whether a path constraint may determine it."""
        self._slopes = casadi.Function(
            "slopes", list(symbols), [casadi.densify(slopes)]
        )

    def pinned(self, u: FloatArray, bounds: Arguments) -> BoolArray:
        """Mark where every control of a path constraint is held at its bound, (n,).

        The multiplier of that constraint is not determined there.
        """
        lower, upper = bounds
        near = 1e-9 * (upper - lower)[:, None]
        held = (u <= lower[:, None] + near) | (u >= upper[:, None] - near)
        return np.asarray(held[self.bound].all(axis=0))

    def vertices(self, lower: FloatArray, upper: FloatArray) -> list[FloatArray]:
        """Corners of the box of the controls that path constraints may determine.

        None where there are no such controls, or too many, or one without bounds.
        """
        box = list(zip(lower[self.bound], upper[self.bound], strict=True))
        if not 0 < len(box) <= _MOST_CORNERS or not np.all(np.isfinite(box)):
            return []
        return [np.array(corner) for corner in product(*box)]

    def vertex_gap(
        self,
        vertices: list[FloatArray],
        at: Arguments,
        h: Hamiltonian,
        table: Table,
    ) -> FloatArray:
        """Gap against the corners that keep the path constraints, shape (n,)."""
        best = np.zeros(at[2].size)
        for vertex in vertices:
            trial = at[1].copy()
            trial[self.bound] = vertex[:, None]
            best = np.fmin(best, self._change(at, trial, h, table))
        return -best

    def restricts(self, j: int, table: Table, *, convex: bool) -> bool:
        """Whether values of control j count only if they keep the constraints.

        ``convex``: whether the Hamiltonian has one valley at most in that control.
        """
        equations = self._equations(table)[self.entries[:, j]].any()
        return bool(equations or (self.bound[j] and not convex))

    def change(
        self, j: int, at: Arguments, trial: FloatArray, h: Hamiltonian, table: Table
    ) -> FloatArray:
        """Change of the Hamiltonian if control j takes the values of ``trial``, (n,).

        The other controls follow by Newton's method, so that equations are kept;
        infinite where they cannot. ``trial``: all controls, shape (controls, n), in
        which the others are left as they end.
        """
        x, _, t, p, _ = at
        count, equal = t.size, np.flatnonzero(self._equations(table))
        target = self.auditor.path_bounds(table)[equal, :1]
        limits = np.stack(self.auditor.control_bounds(table))[:, :, None]
        for _ in range(_RETURNS if equal.size else 0):
            values = np.asarray(self.auditor.path.map(count)(x, trial, t, p))
            off = np.nan_to_num(values[equal] - target).T[:, :, None]
            slopes = np.asarray(self._slopes.map(count)(x, trial, t, p))
            slopes = slopes.reshape(self.mixed.size, count, -1)[equal]
            slopes = np.nan_to_num(slopes.transpose(1, 0, 2))
            slopes[:, :, j] = 0.0
            trial -= (np.linalg.pinv(slopes) @ off)[:, :, 0].T
            np.clip(trial, *limits, out=trial)
        return self._change(at, trial, h, table)

    def _equations(self, table: Table) -> BoolArray:
        """Mark path constraints that are equations with a control, (constraints,)."""
        low, high = self.auditor.path_bounds(table).T
        return np.asarray((low == high) & self.mixed)

    def _change(
        self, at: Arguments, trial: FloatArray, h: Hamiltonian, table: Table
    ) -> FloatArray:
        """Change of the Hamiltonian without multipliers; infinite where not kept."""
        x, u, t, p, costate = at
        path = self.auditor.path.map(t.size)
        bounds, scale = self.auditor.path_bounds(table), self.auditor.path_scales(table)

        def broken(control: FloatArray) -> FloatArray:
            values = np.asarray(path(x, control, t, p))
            over = np.maximum(bounds[:, :1] - values, values - bounds[:, 1:])
            return np.asarray((over / scale[:, None])[self.mixed].max(axis=0))

        free = costate.copy()
        free[x.shape[0] :][: scale.size][self.mixed] = 0.0
        change = np.asarray(h(x, trial, t, p, free) - h(x, u, t, p, free)).ravel()
        allowed = np.maximum(broken(u), 0.0) + _KEPT
        return np.where(broken(trial) <= allowed, change, np.inf)
