"""Integration of a phase's dynamics interval by interval, stiff or not.

On every interval the stages of the Radau IIA method (Hairer, Wanner 1996, Solving
ordinary differential equations II, section IV.5) are solved for, with three stages
more than the state's polynomial has points. The method is L-stable: what decays within
a fraction of an interval does decay, however fast, where explicit steps would grow.

The polynomial to be judged is where the iteration starts, so fixed-point steps find the
stages in a few evaluations where the dynamics are not stiff; Newton's method finds the
others. Error control: the Legendre coefficients of the stages tell how well an interval
is resolved. Where they do not fall it is integrated again in three parts, and what they
leave open then counts as error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np
from numpy.polynomial import legendre

from showc.ocp.nodes import collocation
from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.arrays import BoolArray, FloatArray
    from showc.ocp.solution import PhaseSolution


_MORE = 3
"""Stages beyond the points of the polynomial that is judged."""
_PARTS = 3
"""Parts in which an interval is integrated that one step does not resolve."""
_FIXED_POINT = 6
"""Fixed-point steps before Newton's method takes over."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """What is integrated."""

    phase: PhaseSolution
    """Polynomials of states and controls on K intervals."""
    bounds: tuple[FloatArray, FloatArray]
    """Lower and upper bounds of the controls, to which they are clipped."""
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


class Integrator:
    """Dynamics of one phase with their slopes; made once per problem.

    Parameters
    ----------
    dynamics
        CasADi function (x, u, t, p) -> dx/dt.
    """

    def __init__(self, dynamics: Any) -> None:  # noqa: ANN401 - a CasADi function
        self.f = dynamics
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
        points = np.asarray(flight.phase.mesh.points)
        for n in np.unique(points):
            chosen = np.flatnonzero(points == n)
            work = _Batch(self, flight, chosen, int(n) + _MORE)
            far, open_, end = work.step(starts[chosen], 1)
            coarse = open_ > np.maximum(_UNRESOLVED * far, _SMALL)
            if coarse.any():
                again = _Batch(self, flight, chosen[coarse], int(n) + _MORE)
                finer = again.step(starts[chosen[coarse]], _PARTS)
                far[coarse], open_[coarse], end[coarse] = finer
            deviation[chosen] = far + np.where(open_ > _UNRESOLVED * far, open_, 0.0)
            ends[chosen] = end
        return Flown(deviation, ends)

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
            x = _Batch(self, flight, np.array([k]), n + _MORE).step(x, _PARTS)[2]
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


class _Batch:
    """Some intervals of one phase, integrated side by side."""

    def __init__(
        self, owner: Integrator, flight: Flight, chosen: NDArray[np.intp], stages: int
    ) -> None:
        phase = flight.phase
        self.owner, self.scale, self.stages = owner, flight.scale, stages
        self.bounds, self.p = flight.bounds, flight.parameters
        self.states = phase.states.coefficients[chosen]
        self.controls = phase.controls.coefficients[chosen]
        self.begin = phase.states.breaks[chosen]
        self.width = np.diff(phase.states.breaks)[chosen]

    def step(
        self, starts: FloatArray, parts: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Integrate in equal parts.

        Returns
        -------
        tuple of ndarray
            Greatest distance to the polynomial and size of the last two Legendre
            coefficients, both over the ranges, shape (B,); states at the ends.
        """
        count = self.width.size
        far, open_, x = np.zeros(count), np.zeros(count), starts
        c, _, spectrum = _radau(self.stages)
        for part in range(parts):
            at = (part + c) / parts
            guess = self._values(self.states, at)
            offset = (x - self._values(self.states, np.array([part / parts]))[:, 0])[
                :, None
            ]
            found = self._stages(x, guess + offset, guess, at, self.width / parts)
            distance = np.abs(found - guess) / self.scale
            distance = np.nan_to_num(distance, nan=_LOST, posinf=_LOST)
            far = np.maximum(far, distance.max(axis=(1, 2)))
            nodes = np.concatenate([x[:, None], found], axis=1)
            tail = np.abs(np.einsum("ds,bsx->bdx", spectrum, nodes)) / self.scale
            tail = np.nan_to_num(tail, nan=_LOST, posinf=_LOST)
            open_ = np.maximum(open_, tail.max(axis=(1, 2)))
            x = found[:, -1]
        return np.minimum(far, _LOST), np.minimum(open_, _LOST), x

    def flow(self) -> FloatArray:
        """Slopes of the ends by the starts, shape (B, states, states)."""
        c, matrix, _ = _radau(self.stages)
        count, size = self.width.size, self.states.shape[2]
        x = self._values(self.states, c)
        u = np.clip(self._values(self.controls, c), *self.bounds)
        t = self.begin[:, None] + self.width[:, None] * c
        system = self._system(
            [
                x.reshape(count * self.stages, size).T,
                u.reshape(count * self.stages, u.shape[2]).T,
                t.reshape(1, -1),
                np.repeat(self.p[:, None], count * self.stages, axis=1),
            ],
            self.width,
            matrix,
        )
        right = np.tile(np.eye(size), (self.stages, 1))[None]
        if not np.all(np.isfinite(system)):
            return np.full((count, size, size), np.nan)
        return np.asarray(np.linalg.solve(system, right)[:, -size:])

    def _system(
        self, arguments: list[FloatArray], width: FloatArray, matrix: FloatArray
    ) -> FloatArray:
        """Slopes I - h A (x) df/dx of the stages' equations, shape (B, s n, s n)."""
        count, stages, size = width.size, matrix.shape[0], self.states.shape[2]
        rows, columns = self.owner.pattern
        entries = np.asarray(self.owner.slopes.map(count * stages)(*arguments))
        slopes = np.zeros((count, stages, size, size))
        slopes[:, :, rows, columns] = entries.T.reshape(count, stages, -1)
        system = -np.einsum("b,ij,bjxy->bixjy", width, matrix, slopes)
        system = system.reshape(count, stages * size, stages * size)
        system += np.eye(stages * size)
        return np.asarray(system)

    @staticmethod
    def _values(coefficients: FloatArray, places: FloatArray) -> FloatArray:
        basis = bernstein_basis(coefficients.shape[1] - 1, places)
        return np.asarray(np.einsum("sj,kjc->ksc", basis, coefficients))

    def _stages(
        self,
        start: FloatArray,
        first: FloatArray,
        reference: FloatArray,
        at: FloatArray,
        width: FloatArray,
    ) -> FloatArray:
        """States at the stages, shape (B, s, states); not numbers where none exist."""
        count, stages, size = first.shape
        _, matrix, _ = _radau(stages)
        u = np.clip(self._values(self.controls, at), *self.bounds)
        t = self.begin[:, None] + self.width[:, None] * at
        x, base, h = first.copy(), start[:, None], width[:, None, None]

        def arguments(here: NDArray[np.intp]) -> list[FloatArray]:
            return [
                x[here].reshape(here.size * stages, size).T,
                u[here].reshape(here.size * stages, u.shape[2]).T,
                t[here].reshape(1, -1),
                np.repeat(self.p[:, None], here.size * stages, axis=1),
            ]

        def rate(here: NDArray[np.intp]) -> FloatArray:
            f = self.owner.f.map(here.size * stages)(*arguments(here))
            return np.asarray(f).T.reshape(here.size, stages, size)

        def settled(here: NDArray[np.intp], change: FloatArray) -> BoolArray:
            moved = (np.abs(change) / self.scale).max(axis=(1, 2))
            far = (np.abs(x[here] - reference[here]) / self.scale).max(axis=(1, 2))
            return np.asarray(moved <= np.maximum(_SETTLED * far, _ROUNDING))

        left = np.arange(count)
        before = np.full(count, np.inf)
        stiff: list[NDArray[np.intp]] = []
        with np.errstate(all="ignore"):
            for _ in range(_FIXED_POINT):
                new = base[left] + h[left] * _weighted(matrix, rate(left))
                change = new - x[left]
                moved = (np.abs(change) / self.scale).max(axis=(1, 2))
                good = moved < 0.3 * before[left]
                stiff.append(left[~good])
                x[left[good]] = new[good]
                before[left] = moved
                left = left[good & ~settled(left, change)]
                if not left.size:
                    break
            stiff.append(left)
            left = np.concatenate(stiff)
            x[left] = first[left]
            for _ in range(_NEWTON):
                if not left.size:
                    break
                residual = base[left] + h[left] * _weighted(matrix, rate(left))
                change = _newton(
                    residual - x[left],
                    self._system(arguments(left), width[left], matrix),
                )
                x[left] += change
                left = left[~settled(left, change)]
            x[left] = np.nan
        return x


def _weighted(matrix: FloatArray, rate: FloatArray) -> FloatArray:
    """Products A f of the stages' rates, shape (B, s, states)."""
    return np.asarray(np.einsum("ij,bjx->bix", matrix, rate))


def _newton(residual: FloatArray, system: FloatArray) -> FloatArray:
    """Newton's step for the stages; not numbers where there is none."""
    right = residual.reshape(residual.shape[0], -1, 1)
    finite = np.isfinite(system).all(axis=(1, 2)) & np.isfinite(right).all(axis=(1, 2))
    change = np.full(right.shape[:2], np.nan)
    if finite.any():
        try:
            change[finite] = np.linalg.solve(system[finite], right[finite])[:, :, 0]
        except np.linalg.LinAlgError:
            return np.full(residual.shape, np.nan)
    return change.reshape(residual.shape)
