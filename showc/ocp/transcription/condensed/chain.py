"""The nonlinear program of a chain of stages, its derivatives written once for a stage.

With z_k = (x_k, u_k), data q_k and parameters p, all stages share the functions

    a(z, q, p) = (-next state, limits),    c(z, q, p) = share of the objective.

The unknowns are w = (z_0, ..., z_{K-1}, x_K), the objective f is the sum of c and of
what the end costs, and the rows are

    g = L w + S (a_0, ..., a_{K-1}),

L and S picking entries of the unknowns and of the stages' values. So the Jacobian is
made of ones and of the entries of da/dz, and the Hessian of the Lagrangian with
multipliers s of f and m of g of those of the matrices d²(s c + (S'm)_k a)/dz², of which
the upper triangles are worked out: neither has to be derived anew for every stage, and
the work of building a program does not grow with their number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.transcription.condensed.stages import Row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.ocp.transcription.condensed.stages import Stage, TimeKind
    from showc.ocp.transcription.solver import SolverName


Symbol = Any

CLOSED = 1e-11
"""Greatest gap that counts as rounding: scaled unknowns are of the order of one."""
NEAR = 1e-4
"""Gap beyond which a point is no solution and is left alone."""
STEPS = 2
"""Steps of Newton: from gaps of 1e-4, the second ends in rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Which row is what, and where its entries come from."""

    rows: tuple[Row, ...]
    """What each row is."""
    interval: IntArray
    """Interval that each row belongs to; the end of the phase counts as one more."""
    picked: IntArray
    """(row, entry of w) of every entry of L, shape (entries, 2)."""
    places: IntArray
    """Row in which a stage's value stands, or -1 if in none, shape (K, values)."""


def lay_out(stage: Stage, intervals: int, time: TimeKind) -> Layout:
    """Order the rows: of each stage its dynamics, the start, its limits; then the end.

    Rows that the start or the end alone decides are left out on the first and the last
    interval.
    """
    size = stage.states + stage.inputs
    names = (*stage.state_names, *(["duration"] if time == "free" else []))
    named = range(len(stage.state_names))
    rows: list[Row] = []
    interval: list[int] = []
    picked: list[tuple[int, int]] = []
    places = np.full((intervals, stage.states + len(stage.rows)), -1)

    def ends(kind: str, first: int) -> None:
        """State the rows of an end of the phase whose states begin at ``first``."""
        picked.extend((len(rows) + k, first + k) for k in named)
        rows.extend(Row((kind, names[k]), stage.state_scales[k]) for k in named)

    for k in range(intervals):
        places[k, : stage.states] = len(rows) + np.arange(stage.states)
        following = (k + 1) * size
        picked += [(len(rows) + i, following + i) for i in range(stage.states)]
        rows += [Row(("dynamics", name), 1.0) for name in names]
        if k == 0:
            ends("start", 0)
        for r, row in enumerate(stage.rows):
            if (k == 0 and row.at_start) or (k == intervals - 1 and row.at_end):
                continue
            places[k, stage.states + r] = len(rows)
            rows.append(row)
        interval += [k] * (len(rows) - len(interval))
    ends("end", intervals * size)
    if time == "free":
        picked.append((len(rows), intervals * size + stage.states - 1))
        rows.append(Row(("duration",), 1.0))
    interval += [intervals] * (len(rows) - len(interval))
    return Layout(tuple(rows), np.array(interval), np.array(picked), places)


class Chain:
    """A program of a number of stages, for a solver that CasADi brings.

    Parameters
    ----------
    stage
        Functions of one stage.
    layout
        Rows of the program, from :func:`lay_out`.
    parameters
        Number of parameters of the problem.

    Attributes
    ----------
    program : dict
        Expressions x (w), p (parameters, then the data of all stages), f and g.
    slopes : casadi.Function
        (x, p) -> (g, dg/dx).
    """

    def __init__(self, stage: Stage, layout: Layout, parameters: int) -> None:
        self._stage, self._layout = stage, layout
        count = layout.places.shape[0]
        self._size = stage.states + stage.inputs
        self._unknowns = count * self._size + stage.states
        w = casadi.MX.sym("x", self._unknowns)
        given = casadi.MX.sym("p", parameters + count * stage.data)
        p = given[:parameters]
        self._variables = w, given
        # Columns of z, q and p, one for each stage, as the stages' functions take them.
        self._columns = (
            casadi.reshape(w[: count * self._size], self._size, count),
            casadi.reshape(given[parameters:], stage.data, count),
            casadi.repmat(p, 1, count),
        )
        self._end = w[count * self._size :], p
        self._write_stage()
        self._linear = _ones(layout.picked, (len(layout.rows), self._unknowns))
        flat = layout.places.ravel()
        chosen = np.flatnonzero(flat >= 0)
        self._chosen = _ones(
            np.stack([flat[chosen], chosen], axis=1), (len(layout.rows), flat.size)
        )
        values, shares = self._values.map(count)(*self._columns)
        cost = casadi.sum2(shares) + self._ending(*self._end)[0]
        self.program = {"x": w, "p": given, "f": cost, "g": self._rows(values)}
        self.slopes = self._write_slopes()

    def _write_stage(self) -> None:
        """Write a, c and their derivatives for one stage, and for the end."""
        stage, lifting = self._stage, self._stage.lifting
        x, u, q, p = stage.variables
        z = casadi.vertcat(x, u)
        s = casadi.SX.sym("s")
        m = casadi.SX.sym("m", stage.states + len(stage.rows))
        following, limits, share = stage.expressions
        values = casadi.vertcat(-following, limits)
        curvature, slope = lifting.curvature(s * share + casadi.dot(m, values), z)
        curvature = casadi.triu(curvature)
        values, share, slope, bends = lifting.restored(
            values, share, casadi.densify(slope), _entries(curvature)
        )
        slopes = casadi.jacobian(values, z)
        gradient = casadi.gradient(share, z)

        def written(name: str, given: list[Symbol], *outputs: Symbol) -> Symbol:
            return casadi.Function(name, [z, q, p, *given], casadi.cse([*outputs]))

        self._values = written("values", [], values, share)
        self._slopes = written("slopes", [], values, _entries(slopes))
        self._slopes_at = _places(slopes)
        self._gradient = written("gradient", [], share, casadi.densify(gradient))
        self._curvature = written("curvature", [s, m], slope, bends)
        self._curvature_at = _places(curvature)
        x = casadi.SX.sym("x", stage.states)
        ending = stage.terminal(x, p)
        bend, slope = casadi.hessian(ending, x)
        bend = casadi.triu(bend)
        outputs = [ending, casadi.densify(slope), _entries(bend)]
        self._ending = casadi.Function("ending", [x, p], outputs)
        self._ending_at = _places(bend)

    def _rows(self, values: Symbol) -> Symbol:
        """Return g, given the values of all stages, a column each."""
        linear = casadi.mtimes(self._linear, self._variables[0])
        return linear + casadi.mtimes(self._chosen, casadi.vec(values))

    def _write_slopes(self) -> Any:  # noqa: ANN401 - a CasADi function
        places, picked = self._layout.places, self._layout.picked
        count, (row, column) = places.shape[0], self._slopes_at
        first = np.arange(count)[:, None]
        rows, columns = places[:, row], first * self._size + column
        kept = rows >= 0
        values, entries = self._slopes.map(count)(*self._columns)
        source = casadi.vertcat(casadi.DM.ones(len(picked)), casadi.vec(entries))
        numbers = len(picked) + np.flatnonzero(kept)
        matrix = _scattered(
            source,
            np.concatenate([np.arange(len(picked)), numbers]),
            np.concatenate([picked[:, 0], rows[kept]]),
            np.concatenate([picked[:, 1], columns[kept]]),
            (len(self._layout.rows), self._unknowns),
        )
        return casadi.Function(
            "nlp_jac_g",
            [*self._variables],
            [self._rows(values), matrix],
            ["x", "p"],
            ["g", "jac_g_x"],
        )

    def derivatives(self, solver: SolverName) -> dict[str, Any]:
        """Return derivatives by the names under which the solver's interface asks.

        Given to ``casadi.nlpsol`` as ``cache``, they spare it deriving its own.
        """
        return {
            "nlp_grad_f": self._write_gradient(with_cost=solver == "ipopt"),
            "nlp_jac_g": self.slopes,
            "nlp_hess_l": self._write_hessian(triangle=solver == "ipopt"),
        }

    def _write_gradient(self, *, with_cost: bool) -> Any:  # noqa: ANN401
        shares, slopes = self._gradient.map(self._layout.places.shape[0])(
            *self._columns
        )
        ending, slope, _ = self._ending(*self._end)
        outputs = [casadi.vertcat(casadi.vec(slopes), slope)]
        names = ["grad_f_x"]
        if with_cost:
            outputs.insert(0, casadi.sum2(shares) + ending)
            names.insert(0, "f")
        given = [*self._variables]
        return casadi.Function("nlp_grad_f", given, outputs, ["x", "p"], names)

    def _write_hessian(self, *, triangle: bool) -> Any:  # noqa: ANN401
        count = self._layout.places.shape[0]
        s = casadi.MX.sym("lam_f")
        m = casadi.MX.sym("lam_g", len(self._layout.rows))
        stages = casadi.reshape(casadi.mtimes(self._chosen.T, m), -1, count)
        slopes, entries = self._curvature.map(count)(
            *self._columns, casadi.repmat(s, 1, count), stages
        )
        _, slope, bend = self._ending(*self._end)
        first = np.arange(count)[:, None] * self._size
        rows, columns = (
            np.concatenate([(first + inner).ravel(), count * self._size + last])
            for inner, last in zip(self._curvature_at, self._ending_at, strict=True)
        )
        numbers = np.arange(rows.size)
        if not triangle:
            # What is below the diagonal is what is above it.
            above = np.flatnonzero(rows < columns)
            numbers = np.append(numbers, above)
            rows, columns = (
                np.append(rows, columns[above]),
                np.append(columns, rows[above]),
            )
        matrix = _scattered(
            casadi.vertcat(casadi.vec(entries), s * bend),
            numbers,
            rows,
            columns,
            (self._unknowns, self._unknowns),
        )
        names = ["x", "p", "lam_f", "lam_g"]
        given = [*self._variables, s, m]
        if triangle:
            return casadi.Function(
                "nlp_hess_l", given, [matrix], names, ["triu_hess_gamma_x_x"]
            )
        gradient = casadi.vertcat(casadi.vec(slopes), s * slope)
        gradient += casadi.mtimes(self._linear.T, m)
        outputs = ["grad_gamma_x", "hess_gamma_x_x"]
        return casadi.Function("nlp_hess_l", given, [gradient, matrix], names, outputs)


class Gaps:
    """The equations of a program, with their slopes.

    A gap of 1e-7 rad between two intervals is metres after a minute. Gauss-Newton steps
    of least norm bring it to rounding and move nothing else visibly.

    Parameters
    ----------
    slopes
        CasADi function (x, p) -> (g, dg/dx).
    equal
        Which rows of g are equations.
    """

    def __init__(self, slopes: Any, equal: BoolArray) -> None:  # noqa: ANN401
        self._slopes, self._equal = slopes, equal
        rows = np.flatnonzero(equal).tolist()
        self._chosen = casadi.DM.triplet(
            list(range(len(rows))),
            rows,
            casadi.DM.ones(len(rows)),
            len(rows),
            equal.size,
        )

    def closed(
        self,
        unknowns: FloatArray,
        rows: FloatArray,
        parameters: FloatArray,
        wanted: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return unknowns and rows after the least change that closes the equations.

        Parameters
        ----------
        unknowns, rows
            The solver's answer.
        parameters
            Values of p.
        wanted
            Right-hand side of the equations.
        """
        for _ in range(STEPS):
            gap = rows[self._equal] - wanted
            if not CLOSED < np.abs(gap).max() < NEAR:
                break
            slopes = casadi.mtimes(self._chosen, self._slopes(unknowns, parameters)[1])
            normal = casadi.mtimes(slopes, slopes.T)
            change = casadi.mtimes(slopes.T, casadi.solve(normal, gap, "ldl"))
            unknowns = unknowns - np.array(change).ravel()
            rows = np.array(self._slopes(unknowns, parameters)[0]).ravel()
        return unknowns, rows


def _ones(places: IntArray, shape: tuple[int, int]) -> Any:  # noqa: ANN401
    """Return a sparse matrix with ones at (row, column)."""
    rows, columns = places.T.tolist()
    return casadi.DM(casadi.Sparsity.triplet(*shape, rows, columns), 1.0)


def _entries(matrix: Symbol) -> Symbol:
    """Entries of a sparse matrix as a dense column."""
    return casadi.SX(casadi.Sparsity.dense(matrix.nnz(), 1), matrix.nz[:])


def _places(matrix: Symbol) -> tuple[IntArray, IntArray]:
    """Rows and columns of the entries of a sparse matrix."""
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _scattered(
    source: Symbol,
    numbers: Sequence[int] | IntArray,
    rows: IntArray,
    columns: IntArray,
    shape: tuple[int, int],
) -> Symbol:
    """Sparse matrix that has entry ``numbers[i]`` of a column at row i, column i."""
    order = np.lexsort((rows, columns))
    begins = np.searchsorted(columns[order], np.arange(shape[1] + 1))
    pattern = casadi.Sparsity(*shape, begins.tolist(), rows[order].tolist())
    chosen = np.asarray(numbers)[order]
    return casadi.sparsity_cast(source[chosen.tolist()], pattern)
