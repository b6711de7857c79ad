"""Integration of a phase's dynamics interval by interval, stiff or not.

On every interval the stages of the Radau IIA method (Hairer, Wanner 1996, Solving
ordinary differential equations II, section IV.5) are solved for, with three stages
more than the state's polynomial has points. The method is L-stable: what decays within
a fraction of an interval does decay, however fast, where explicit steps would grow.

The polynomial to be judged is where the iteration starts, so fixed-point steps find the
stages in a few evaluations where the dynamics are not stiff. Elsewhere Newton's method
with the interval's mean slopes does: with these the stages decouple (Hairer, Wanner
1996, section IV.8). Newton's method with the slopes of every stage finds what is left.

Dynamics need not exist beyond the bounds of the states (a table ends, a root has no
value), where an integrated state may come by rounding. There they are those of the
nearest state within the bounds.

Error control: the Legendre coefficients of the stages tell how well an interval is
resolved. Where they do not fall it is integrated again in three parts, and what they
leave open then counts as error.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np
from numpy.polynomial import legendre

from showc.ocp.nodes import collocation
from showc.trajectory import piece_values

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from showc.arrays import BoolArray, FloatArray, IntArray

    ComplexArray = NDArray[np.complex128]
    from showc.ocp.solution import PhaseSolution


_MORE = 3
"""Stages beyond the points of the polynomial that is judged."""
_PARTS = 3
"""Parts in which an interval is integrated that one step does not resolve."""
_FIXED_POINT = 6
"""Fixed-point steps before Newton's method takes over."""
_SIMPLE = 8
"""Newton's steps with mean slopes before those with the slopes of every stage."""
_CONTRACTS = 0.3
"""Ratio of one change to the last up to which an iteration is worth going on with."""
_NEWTON = 12
"""Newton's steps after which an interval counts as not integrable."""
_SETTLED = 1e-2
"""Last change of the stages over their distance to the polynomial, when they count as
found: the distance is then known to about a hundredth."""
_ROUNDING = 1e-13
"""Change of the stages over the states' ranges that is rounding."""
_UNRESOLVED = 0.1
"""Size of the last two Legendre coefficients over the distance, above which a step does
not resolve its interval."""
_SMALL = 1e-9
"""Size of these coefficients over the states' ranges that is always small enough."""
_LOST = 1e9
"""Error of an interval that cannot be integrated."""
_SWEEPS = 6
"""Newton's steps on the starts of all intervals at once, before they are integrated one
after the other."""


@lru_cache(maxsize=64)
def _radau(stages: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Abscissae (s,), matrix A (s, s) and stages to Legendre coefficients of degree s.

    The last maps the values at 0 and at the stages, (s + 1,), to the coefficients of
    the two highest degrees, (2, s + 1).
    """
    c, _ = collocation("radau", stages)
    vandermonde = legendre.legvander(2.0 * c - 1.0, stages - 1)
    integrals = np.zeros((stages, stages))
    for degree in range(stages):
        primitive = legendre.legint(np.eye(stages)[degree], lbnd=-1)
        integrals[:, degree] = 0.5 * legendre.legval(2.0 * c - 1.0, primitive)
    matrix = np.linalg.solve(vandermonde.T, integrals.T).T
    nodes = np.concatenate([[0.0], c])
    spectrum = np.linalg.inv(legendre.legvander(2.0 * nodes - 1.0, stages))[-2:]
    return c, np.asarray(matrix, float), np.asarray(spectrum, float)


@lru_cache(maxsize=64)
def _modes(stages: int) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Eigenvalues (m,) of matrix A, eigenvectors (s, m), rows of their inverse (m, s).

    Of two conjugate ones that with the positive imaginary part stands for both, its
    eigenvector doubled: the real part of its product is what both contribute.
    """
    values, vectors = np.linalg.eig(_radau(stages)[1])
    inverse = np.linalg.inv(vectors)
    kept = values.imag >= 0.0
    share = np.where(values.imag > 0.0, 2.0, 1.0)
    return values[kept], (vectors * share)[:, kept], inverse[kept]


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """What is integrated."""

    phase: PhaseSolution
    """Polynomials of states and controls on K intervals."""
    bounds: tuple[FloatArray, FloatArray]
    """Lower and upper bounds of the controls, to which they are clipped."""
    domain: tuple[FloatArray, FloatArray]
    """Lower and upper bounds of the states, within which the dynamics are asked for."""
    parameters: FloatArray
    """Values of parameters and statics."""
    scale: FloatArray
    """Range of each state, shape (states,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """What integrating every interval from a given start gives."""

    deviation: FloatArray
    """Greatest distance to the polynomials over each state's range, shape (K,)."""
    ends: FloatArray
    """States at the ends of the intervals, shape (K, states)."""
    integrals: FloatArray
    """Integrals along what is flown less those by the collocation's own quadrature,
    shape (K, integrals)."""


class Integrator:
    """Dynamics of one phase with their slopes; made once per problem.

    Parameters
    ----------
    dynamics
        CasADi function (x, u, t, p) -> dx/dt.
    running
        CasADi function (x, u, t, p) -> integrands of the phase.
    """

    def __init__(self, dynamics: Any, running: Any) -> None:  # noqa: ANN401
        self.f, self.running = dynamics, running
        self.integrals = int(running.size1_out(0))
        x, u, t, p = (dynamics.sx_in(i) for i in range(4))
        slopes = casadi.sparsify(casadi.jacobian(dynamics(x, u, t, p), x))
        rows, columns = slopes.sparsity().get_triplet()
        self.pattern = np.asarray(rows, dtype=int), np.asarray(columns, dtype=int)
        entries = casadi.vertcat(casadi.SX(0, 1), *slopes.nonzeros())
        self.slopes = casadi.Function("slopes", [x, u, t, p], [entries])

    def fly(self, flight: Flight, starts: FloatArray) -> Flown:
        """Integrate the clipped controls over every interval.

        ``starts``: states at the start of each interval, shape (K, states).
        """
        count, size = starts.shape
        deviation, ends = np.zeros(count), np.zeros((count, size))
        integrals = np.zeros((count, self.integrals))
        points = np.asarray(flight.phase.mesh.points)
        for n in np.unique(points):
            chosen = np.flatnonzero(points == n)
            work = _Batch(self, flight, chosen, int(n) + _MORE)
            step = work.step(starts[chosen], 1)
            coarse = step.unresolved > np.maximum(_UNRESOLVED * step.far, _SMALL)
            if coarse.any():
                again = _Batch(self, flight, chosen[coarse], int(n) + _MORE)
                finer = again.step(starts[chosen[coarse]], _PARTS)
                for one in fields(finer):
                    getattr(step, one.name)[coarse] = getattr(finer, one.name)
            lost = np.where(
                step.unresolved > _UNRESOLVED * step.far, step.unresolved, 0.0
            )
            deviation[chosen] = step.far + lost
            ends[chosen] = step.ends
            integrals[chosen] = step.integrals - work.quadrature(int(n))
        return Flown(deviation, ends, integrals)

    def shoot(self, flight: Flight) -> FloatArray:
        """Integrate once from the start of the phase to its end.

        All intervals are integrated side by side; Newton's method on the states at
        their borders joins them. Where it fails they follow one after the other.

        Returns
        -------
        ndarray
            States at the ends of the intervals, shape (K, states).
        """
        scale, borders = flight.scale, flight.phase.states.coefficients[:, 0]
        starts, flow = borders.copy(), self._flow(flight)
        for _ in range(_SWEEPS):
            ends = self.fly(flight, starts).ends
            gap = ends[:-1] - starts[1:]
            move = np.zeros_like(starts)
            for k in range(gap.shape[0]):
                move[k + 1] = flow[k] @ move[k] + gap[k]
            if not np.all(np.isfinite(move)):
                break
            starts += move
            moved = float((np.abs(move) / scale).max())
            far = float((np.abs(starts - borders) / scale).max())
            if moved <= max(_SETTLED * far, 1e-12):
                return np.vstack([starts[1:], ends[-1:]])
            if moved > 1.0:
                break
        return self._one_by_one(flight)

    def _one_by_one(self, flight: Flight) -> FloatArray:
        """Integrate every interval from where the one before ended."""
        phase = flight.phase
        ends = np.full((phase.states.intervals, flight.scale.size), np.nan)
        x = phase.states.coefficients[:1, 0]
        for k, n in enumerate(phase.mesh.points):
            x = _Batch(self, flight, np.array([k]), n + _MORE).step(x, _PARTS).ends
            if not np.all(np.isfinite(x)):
                break
            ends[k] = x[0]
        return ends

    def _flow(self, flight: Flight) -> FloatArray:
        """Slopes of the states at the end of each interval by those at its start."""
        size = flight.scale.size
        points = np.asarray(flight.phase.mesh.points)
        flow = np.zeros((points.size, size, size))
        for n in np.unique(points):
            chosen = np.flatnonzero(points == n)
            flow[chosen] = _Batch(self, flight, chosen, int(n) + _MORE).flow()
        return flow


@dataclass(frozen=True, slots=True, eq=False)
class _Integrated:
    """Where a batch of B intervals is led."""

    far: FloatArray
    """Greatest distance to the polynomial over the ranges, shape (B,)."""
    unresolved: FloatArray
    """Size of the last two Legendre coefficients over the ranges, shape (B,)."""
    ends: FloatArray
    """States, shape (B, states)."""
    integrals: FloatArray
    """Shape (B, integrals)."""


class _Batch:
    """Some intervals of one phase, integrated side by side."""

    def __init__(
        self, owner: Integrator, flight: Flight, chosen: NDArray[np.intp], stages: int
    ) -> None:
        phase = flight.phase
        self.owner, self.scale, self.stages = owner, flight.scale, stages
        self.bounds, self.p = flight.bounds, flight.parameters
        self.scheme = phase.scheme
        self.domain = flight.domain
        self.states = phase.states.coefficients[chosen]
        self.controls = phase.controls.coefficients[chosen]
        self.begin = phase.states.breaks[chosen]
        self.width = np.diff(phase.states.breaks)[chosen]

    def step(self, starts: FloatArray, parts: int) -> _Integrated:
        """Integrate in equal parts."""
        count = self.width.size
        gained = np.zeros((count, self.owner.integrals))
        far, open_, x = np.zeros(count), np.zeros(count), starts
        c, matrix, spectrum = _radau(self.stages)
        for part in range(parts):
            at = (part + c) / parts
            guess = piece_values(self.states, at)
            offset = (x - piece_values(self.states, np.array([part / parts]))[:, 0])[
                :, None
            ]
            step = _Step(self, guess + offset, guess, at, self.width / parts)
            found = step.stages(x)
            gained += self._integral(found, step.u, step.t, matrix[-1] / parts)
            distance = np.abs(found - guess) / self.scale
            distance = np.nan_to_num(distance, nan=_LOST, posinf=_LOST)
            far = np.maximum(far, distance.max(axis=(1, 2)))
            nodes = np.concatenate([x[:, None], found], axis=1)
            tail = np.abs(np.einsum("ds,bsx->bdx", spectrum, nodes)) / self.scale
            tail = np.nan_to_num(tail, nan=_LOST, posinf=_LOST)
            open_ = np.maximum(open_, tail.max(axis=(1, 2)))
            x = found[:, -1]
        far, open_ = np.minimum(far, _LOST), np.minimum(open_, _LOST)
        return _Integrated(far, open_, x, gained)

    def quadrature(self, points: int) -> FloatArray:
        """Integrals of the polynomials by ``points`` of the scheme, (B, integrals)."""
        nodes, weights = collocation(self.scheme, points)
        u = piece_values(self.controls, nodes)
        t = self.begin[:, None] + self.width[:, None] * nodes
        return self._integral(piece_values(self.states, nodes), u, t, weights)

    def _integral(
        self, x: FloatArray, u: FloatArray, t: FloatArray, weights: FloatArray
    ) -> FloatArray:
        """Weighted sums of the integrands at (B, places), shape (B, integrals)."""
        count = t.size
        if not self.owner.integrals:
            return np.zeros((t.shape[0], 0))
        values = self.owner.running.map(count)(
            x.reshape(count, -1).T,
            u.reshape(count, u.shape[2]).T,
            t.reshape(1, -1),
            np.repeat(self.p[:, None], count, axis=1),
        )
        table = np.asarray(values).T.reshape(*t.shape, -1)
        return np.asarray(np.einsum("b,s,bsi->bi", self.width, weights, table))

    def flow(self) -> FloatArray:
        """Slopes of the ends by the starts, shape (B, states, states)."""
        c, matrix, _ = _radau(self.stages)
        count, size = self.width.size, self.states.shape[2]
        x = piece_values(self.states, c)
        step = _Step(self, x, x, c, self.width)
        system = _system(step.slopes(np.arange(count)), self.width, matrix)
        right = np.tile(np.eye(size), (self.stages, 1))[None]
        if not np.all(np.isfinite(system)):
            return np.full((count, size, size), np.nan)
        return np.asarray(np.linalg.solve(system, right)[:, -size:])


class _Step:
    """The stages' equations of one step in each interval of a batch.

    Parameters
    ----------
    batch
        The intervals.
    first
        Where the search for the stages starts, shape (B, s, states).
    reference
        Values of the polynomials to be judged at the stages, of that shape.
    at
        Places of the stages as fractions of the intervals, shape (s,).
    width
        Width of each step, shape (B,).
    """

    def __init__(
        self,
        batch: _Batch,
        first: FloatArray,
        reference: FloatArray,
        at: FloatArray,
        width: FloatArray,
    ) -> None:
        self.owner, self.scale, self.domain = batch.owner, batch.scale, batch.domain
        self.first, self.x, self.reference = first, first.copy(), reference
        self.u = np.clip(piece_values(batch.controls, at), *batch.bounds)
        self.t = batch.begin[:, None] + batch.width[:, None] * at
        self.p, self.width, self.matrix = batch.p, width, _radau(first.shape[1])[1]

    def stages(self, start: FloatArray) -> FloatArray:
        """States at the stages, shape (B, s, states); not numbers where none exist.

        ``start``: states at the start of the step, shape (B, states).
        """
        base, h = start[:, None], self.width[:, None, None]

        def residual(here: IntArray) -> FloatArray:
            rise = np.einsum("ij,bjx->bix", self.matrix, self._rate(here))
            return np.asarray(base[here] + h[here] * rise - self.x[here])

        with np.errstate(all="ignore"):
            left = np.arange(start.shape[0])
            left = self._iterated(left, _FIXED_POINT, residual)
            if left.size:
                slopes = np.zeros((start.shape[0], *2 * start.shape[1:]))
                slopes[left] = self.slopes(left).mean(axis=1)
                left = self._iterated(
                    left,
                    _SIMPLE,
                    lambda here: _decoupled(
                        residual(here), slopes[here], self.width[here]
                    ),
                )
            for _ in range(_NEWTON):
                if not left.size:
                    break
                system = _system(self.slopes(left), self.width[left], self.matrix)
                change = _newton(residual(left), system)
                self.x[left] += change
                left = left[~self._settled(left, change)]
            self.x[left] = np.nan
        return self.x

    def slopes(self, here: IntArray) -> FloatArray:
        """Slopes of the dynamics by the states at the stages, (B, s, n, n)."""
        x = self.x[here]
        count, stages, size = x.shape
        rows, columns = self.owner.pattern
        entries = self.owner.slopes.map(count * stages)(*self._arguments(here))
        slopes = np.zeros((count, stages, size, size))
        slopes[:, :, rows, columns] = np.asarray(entries).T.reshape(count, stages, -1)
        inside = (x >= self.domain[0]) & (x <= self.domain[1])
        return np.asarray(slopes * inside[:, :, None, :])

    def _iterated(
        self, left: IntArray, most: int, change_of: Callable[[IntArray], FloatArray]
    ) -> IntArray:
        """Iterate where it contracts; give back where it does not, as before."""
        failed: list[IntArray] = []
        before = np.full(self.width.size, np.inf)
        for _ in range(most):
            if not left.size:
                break
            change = change_of(left)
            moved = (np.abs(change) / self.scale).max(axis=(1, 2))
            good = moved < _CONTRACTS * before[left]
            failed.append(left[~good])
            self.x[left[good]] += change[good]
            before[left] = moved
            left = left[good & ~self._settled(left, change)]
        failed.append(left)
        left = np.concatenate(failed)
        self.x[left] = self.first[left]
        return left

    def _arguments(self, here: IntArray) -> list[FloatArray]:
        """States, controls, times and parameters of all stages, as columns."""
        u, count = self.u[here], self.t[here].size
        x = np.clip(self.x[here], *self.domain)
        return [
            x.reshape(count, -1).T,
            u.reshape(count, u.shape[2]).T,
            self.t[here].reshape(1, -1),
            np.repeat(self.p[:, None], count, axis=1),
        ]

    def _rate(self, here: IntArray) -> FloatArray:
        """Dynamics at the stages, shape (B, s, states)."""
        rate = self.owner.f.map(self.t[here].size)(*self._arguments(here))
        return np.asarray(rate).T.reshape(self.x[here].shape)

    def _settled(self, here: IntArray, change: FloatArray) -> BoolArray:
        """Whether the stages are known well enough to judge the polynomial."""
        moved = (np.abs(change) / self.scale).max(axis=(1, 2))
        far = np.abs(self.x[here] - self.reference[here]) / self.scale
        return np.asarray(
            moved <= np.maximum(_SETTLED * far.max(axis=(1, 2)), _ROUNDING)
        )


def _system(slopes: FloatArray, width: FloatArray, matrix: FloatArray) -> FloatArray:
    """Slopes I - h A (x) df/dx of the stages' equations, shape (B, s n, s n)."""
    count, stages, size, _ = slopes.shape
    system = -np.einsum("b,ij,bjxy->bixjy", width, matrix, slopes)
    system = system.reshape(count, stages * size, stages * size)
    system += np.eye(stages * size)
    return np.asarray(system)


def _decoupled(
    residual: FloatArray, slopes: FloatArray, width: FloatArray
) -> FloatArray:
    """Newton's step with the same slopes (B, n, n) at all stages; (B, s, n)."""
    values, vectors, inverse = _modes(residual.shape[1])
    right = np.einsum("ms,bsx->bmx", inverse, residual)
    system = -np.einsum("b,m,bxy->bmxy", width, values, slopes)
    system += np.eye(residual.shape[2])
    step = _solved(system, right[..., None])[..., 0]
    return np.asarray(np.einsum("sm,bmx->bsx", vectors, step).real)


def _newton(residual: FloatArray, system: FloatArray) -> FloatArray:
    """Newton's step for the stages; not numbers where there is none."""
    right = residual.reshape(residual.shape[0], -1, 1)
    return _solved(system, right).reshape(residual.shape)


def _solved(system: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Solutions of stacked linear systems; not numbers where there is none."""
    finite = np.isfinite(system).all(axis=(-2, -1)) & np.isfinite(right).all(
        axis=(-2, -1)
    )
    found = np.full(right.shape, np.nan, dtype=right.dtype)
    if finite.any():
        try:
            found[finite] = np.linalg.solve(system[finite], right[finite])
        except np.linalg.LinAlgError:
            return np.full(right.shape, np.nan, dtype=right.dtype)
    return found
