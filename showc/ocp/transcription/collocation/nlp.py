"""A partially separable nonlinear program with exact sparse derivatives.

Unknowns w, parameters p. The program is a sum of blocks; a block maps one small
scalar-expression function y = phi(z, q) over n columns:

    z_i = A_i w,  q_i = P_i p,  g(w) = L w + sum R vec(phi),  f(w) = e sum r . vec(phi)

with constant sparse A, P, R, L; the factor e of the objective is the last parameter.
Hence, with J and H of phi taken symbolically once,

    dg/dw = L + R blockdiag(J_i) A,    d2/dw2 = A' blockdiag(H_i) A,

and both are one constant sparse matrix times the mapped non-zeros of phi's own
derivatives. Nothing is coloured, traced or expanded when a mesh changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np
from scipy import sparse

if TYPE_CHECKING:
    from showc.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Kernel:
    """The small function of a block with its derivatives."""

    value: Any
    """Function (z, q) -> y."""
    jacobian: Any
    """Function (z, q) -> non-zeros of dy/dz."""
    jacobian_pattern: tuple[IntArray, IntArray]
    """Rows (of y) and columns (of z) of those non-zeros."""
    hessian: Any
    """Function (z, q, m) -> non-zeros of the upper triangle of d2(m . y)/dz2."""
    hessian_pattern: tuple[IntArray, IntArray]

    @classmethod
    def of(cls, name: str, z: Any, q: Any, y: Any) -> Kernel:  # noqa: ANN401
        """Differentiate ``y`` (SX column) by ``z``."""
        jacobian = casadi.jacobian(y, z)
        multiplier = casadi.SX.sym("m", y.numel())
        gradient = casadi.jtimes(y, z, multiplier, True)
        hessian = casadi.triu(casadi.jacobian(gradient, z, {"symmetric": True}))
        jacobian = casadi.sparsify(jacobian)
        hessian = casadi.sparsify(hessian)
        return cls(
            casadi.Function(name, [z, q], [y]),
            casadi.Function(f"{name}_j", [z, q], [_nonzeros(jacobian)]),
            _pattern(jacobian),
            casadi.Function(f"{name}_h", [z, q, multiplier], [_nonzeros(hessian)]),
            _pattern(hessian),
        )


@dataclass(frozen=True, slots=True)
class Block:
    """A kernel mapped over ``count`` columns of the program."""

    kernel: Kernel
    count: int
    inputs: sparse.csr_matrix
    """A, shape (count * nz, unknowns)."""
    parameters: sparse.csr_matrix
    """P, shape (count * nq, parameters)."""
    rows: sparse.csc_matrix
    """R, shape (constraints, count * ny)."""
    objective: FloatArray
    """r, shape (count * ny,)."""


def _nonzeros(matrix: Any) -> Any:  # noqa: ANN401
    return casadi.vertcat(*matrix.nonzeros()) if matrix.nnz() else casadi.SX(0, 1)


def _pattern(matrix: Any) -> tuple[IntArray, IntArray]:  # noqa: ANN401
    rows, columns = matrix.sparsity().get_triplet()
    return np.asarray(rows, dtype=np.int64), np.asarray(columns, dtype=np.int64)


def to_casadi(matrix: sparse.spmatrix) -> Any:  # noqa: ANN401
    """Give a SciPy sparse matrix as a CasADi ``DM`` with the same pattern."""
    csc = sparse.csc_matrix(matrix)
    csc.sort_indices()
    pattern = casadi.Sparsity(
        csc.shape[0], csc.shape[1], csc.indptr.tolist(), csc.indices.tolist()
    )
    return casadi.DM(pattern, csc.data)


def _products(
    left: sparse.csr_matrix,
    left_rows: IntArray,
    right: sparse.csr_matrix,
    right_rows: IntArray,
) -> tuple[IntArray, IntArray, FloatArray, IntArray]:
    """Outer products of row pairs: (row, column, value, pair) of every entry."""
    left_count = np.diff(left.indptr)[left_rows]
    right_count = np.diff(right.indptr)[right_rows]
    total = left_count * right_count
    pair = np.repeat(np.arange(total.size), total)
    within = np.arange(total.sum()) - np.repeat(np.cumsum(total) - total, total)
    width = right_count[pair]
    at_left = left.indptr[left_rows[pair]] + within // width
    at_right = right.indptr[right_rows[pair]] + within % width
    return (
        left.indices[at_left].astype(np.int64),
        right.indices[at_right].astype(np.int64),
        left.data[at_left] * right.data[at_right],
        pair,
    )


@dataclass(slots=True)
class _Scatter:
    """Gathers (row, column, value, source) into one sparse pattern."""

    shape: tuple[int, int]
    entries: list[tuple[IntArray, IntArray, FloatArray, IntArray]]
    sources: int = 0

    def add(
        self,
        rows: IntArray,
        columns: IntArray,
        values: FloatArray,
        source: IntArray,
        *,
        count: int,
    ) -> None:
        self.entries.append((rows, columns, values, source + self.sources))
        self.sources += count

    def pattern(self) -> tuple[Any, sparse.csc_matrix]:
        """Sparsity of the sum, and the matrix from sources to its non-zeros."""
        rows = np.concatenate([entry[0] for entry in self.entries])
        columns = np.concatenate([entry[1] for entry in self.entries])
        values = np.concatenate([entry[2] for entry in self.entries])
        source = np.concatenate([entry[3] for entry in self.entries])
        key, place = np.unique(columns * self.shape[0] + rows, return_inverse=True)
        pattern = casadi.Sparsity.triplet(
            *self.shape,
            (key % self.shape[0]).tolist(),
            (key // self.shape[0]).tolist(),
        )
        matrix = sparse.csc_matrix(
            (values, (place.ravel(), source)), shape=(key.size, self.sources)
        )
        return pattern, matrix


def _pairs(
    count: int, height: int, width: int, pattern: tuple[IntArray, IntArray]
) -> tuple[IntArray, IntArray]:
    """Global row and column numbers of a pattern repeated down a block diagonal."""
    step = np.arange(count)[:, None]
    rows = (step * height + pattern[0]).ravel()
    columns = (step * width + pattern[1]).ravel()
    return rows, columns


@dataclass(frozen=True, slots=True)
class Program:
    """The functions a solver needs: values and exact sparse derivatives."""

    unknowns: int
    constraints: int
    parameters: int
    """Number of parameters; the last is the factor of the objective."""
    oracle: dict[str, Any]
    """CasADi expressions x, p, f, g."""
    objective_gradient: Any
    constraint_jacobian: Any
    lagrangian_hessian: Any
    values: Any
    """Function (w, p) -> (f, g)."""


def assemble(
    blocks: list[Block], linear: sparse.csr_matrix, parameters: int
) -> Program:
    """Put ``blocks`` and the linear part L together into one program."""
    constraints, unknowns = linear.shape
    w, given = casadi.MX.sym("w", unknowns), casadi.MX.sym("p", parameters + 1)
    p, factor = casadi.vertsplit(given, [0, parameters, parameters + 1])
    weight, dual = casadi.MX.sym("s"), casadi.MX.sym("l", constraints)

    jacobian = _Scatter((constraints, unknowns), [])
    gradient = _Scatter((unknowns, 1), [])
    hessian = _Scatter((unknowns, unknowns), [])
    constant = linear.tocoo()
    jacobian.add(
        constant.row.astype(np.int64),
        constant.col.astype(np.int64),
        constant.data,
        np.zeros(constant.nnz, dtype=np.int64),
        count=1,
    )
    f, g = casadi.MX(0), casadi.mtimes(to_casadi(linear), w)
    jacobian_sources, gradient_sources = [casadi.MX(1)], []
    hessian_sources: list[Any] = []

    for block in blocks:
        kernel, n = block.kernel, block.count
        nz, nq = kernel.value.size1_in(0), kernel.value.size1_in(1)
        ny = kernel.value.size1_out(0)
        z = casadi.reshape(casadi.mtimes(to_casadi(block.inputs), w), nz, n)
        q = casadi.reshape(casadi.mtimes(to_casadi(block.parameters), p), nq, n)
        by_output = block.rows.T.tocsr()
        y = casadi.vec(kernel.value.map(n)(z, q))
        g += casadi.mtimes(to_casadi(block.rows), y)

        slopes = casadi.vec(kernel.jacobian.map(n)(z, q))
        rows, columns = _pairs(n, ny, nz, kernel.jacobian_pattern)
        jacobian.add(
            *_products(by_output, rows, block.inputs, columns), count=rows.size
        )
        jacobian_sources.append(slopes)
        objective = sparse.csr_matrix(block.objective[:, None])
        if objective.nnz:
            f += casadi.dot(casadi.DM(block.objective), y)
            _, at, value, source = _products(objective, rows, block.inputs, columns)
            gradient.add(at, np.zeros_like(at), value, source, count=rows.size)
            gradient_sources.append(slopes)

        if kernel.hessian_pattern[0].size:
            multiplier = casadi.mtimes(to_casadi(by_output), dual)
            if objective.nnz:
                multiplier += weight * factor * casadi.DM(block.objective)
            bends = kernel.hessian.map(n)(z, q, casadi.reshape(multiplier, ny, n))
            hessian_sources.append(casadi.vec(bends))
            rows, columns = _pairs(n, nz, nz, kernel.hessian_pattern)
            upper = _products(block.inputs, rows, block.inputs, columns)
            other = _products(block.inputs, columns, block.inputs, rows)
            mirrored = rows[other[3]] != columns[other[3]]
            merged = [
                np.concatenate([a, b[mirrored]])
                for a, b in zip(upper, other, strict=True)
            ]
            keep = merged[0] <= merged[1]
            hessian.add(*(part[keep] for part in merged), count=rows.size)

    f *= factor

    def gather(scatter: _Scatter, sources: list[Any]) -> Any:  # noqa: ANN401
        if not scatter.entries:
            return casadi.MX(*scatter.shape)
        pattern, matrix = scatter.pattern()
        values = casadi.mtimes(to_casadi(matrix), casadi.vertcat(*sources))
        return casadi.sparsity_cast(casadi.densify(values), pattern)

    return Program(
        unknowns,
        constraints,
        parameters + 1,
        {"x": w, "p": given, "f": f, "g": g},
        casadi.Function(
            "nlp_grad_f",
            [w, given],
            [f, factor * casadi.densify(gather(gradient, gradient_sources))],
            ["x", "p"],
            ["f", "grad_f_x"],
        ),
        casadi.Function(
            "nlp_jac_g",
            [w, given],
            [g, gather(jacobian, jacobian_sources)],
            ["x", "p"],
            ["g", "jac_g_x"],
        ),
        casadi.Function(
            "nlp_hess_l",
            [w, given, weight, dual],
            [gather(hessian, hessian_sources)],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
        casadi.Function("nlp_values", [w, given], [f, g]),
    )
