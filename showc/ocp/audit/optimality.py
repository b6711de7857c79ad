"""The gap in Pontryagin's minimum principle, integrated over each mesh interval.

With costate l and Hamiltonian H = L + l . f, the objective exceeds the optimum to first
order by

    sum over intervals of |l . (re-integrated - polynomial state)|          (dynamics)
    integral of H(x, u, l) - min over v in bounds of H(x, v, l)             (control)

The second is computed here. Where a state is at its bound the costates of a discrete
program are determined only as far as its controls can tell them apart. What is left
oscillates; there they are replaced by their best approximation by polynomials of the
controls' degree.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np
from numpy.polynomial import legendre

from showc.ocp.mesh import alike
from showc.ocp.nodes import bernstein_values, collocation
from showc.ocp.quantity import column
from showc.trajectory import bernstein_basis, piece_values

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.ocp.audit.residuals import PhaseAuditor
    from showc.ocp.phase import Phase
    from showc.ocp.solution import PhaseSolution, Solution
    from showc.ocp.transcription.collocation.statement import Table


_MOST_CORNERS = 6
"""Controls in path constraints up to which all corners of their box are looked at."""
_CANCELLED = 1e-3
"""An objective below this share of what the states are worth is all but zero: its error
is judged over that share instead."""
_RESOLVED = 1e-5
"""Error of an interval's dynamics up to which it tells where its singular arc is."""
_TOLD = 1e-2
"""Error of any dynamics up to which costates tell it."""
_MOSTLY = 0.5
"""Share of an interval from which a state counts as being at its bound on it."""


class MinimumPrinciple:
    """Hamiltonian of one phase as compiled functions; made once per problem.

    Parameters
    ----------
    phase
        Whose Hamiltonian.
    symbols
        States, controls, time and parameters (statics last), each a column.
    auditor
        Of the same phase: its dynamics and path constraints are used.
    """

    def __init__(
        self,
        phase: Phase,
        symbols: tuple[Any, Any, Any, Any],
        auditor: PhaseAuditor,
    ) -> None:
        self.phase, self.auditor = phase, auditor
        x, u, t, p = symbols
        f = phase.dynamics
        costate = casadi.SX.sym("l", x.numel())
        integrands = column(e for _, e in phase.integrals)
        price = casadi.SX.sym("w", integrands.numel())
        path = column(c.symbol for c in phase.path_constraints)
        pressure = casadi.SX.sym("m", path.numel())
        hamiltonian = casadi.dot(costate, f)
        if phase.integrals:
            hamiltonian += casadi.dot(price, integrands)
        if phase.path_constraints:
            hamiltonian += casadi.dot(pressure, path)
        costate = casadi.vertcat(costate, pressure, price)
        # Whatever states and integrals are worth to objective and constraints.
        parts = casadi.vertcat(f, integrands)
        prices = casadi.SX.sym("price", parts.numel())
        bends = casadi.jacobian(casadi.gradient(casadi.dot(prices, parts), u), u)
        limits = casadi.jacobian(casadi.jacobian(path, u).T, u)
        self.affine = tuple(
            bends[j, :].nnz() == 0 and limits[:, j].nnz() == 0 for j in range(u.numel())
        )
        """For each control: whether it enters the Hamiltonian linearly, so that an
        arc off its bounds is singular or bound by a state."""
        self.path_bound = tuple(
            casadi.jacobian(path, u)[:, j].nnz() > 0 for j in range(u.numel())
        )
        """For each control: whether a path constraint may determine it."""
        slopes = casadi.jacobian(path, u)
        rows, columns = slopes.sparsity().get_triplet()
        self.entries = np.zeros(slopes.shape, dtype=bool)
        """Which control enters which path constraint, shape (constraints, controls)."""
        self.entries[rows, columns] = True
        self.mixed = np.asarray(self.entries.any(axis=1))
        """For each path constraint: whether a control enters it."""
        slope = casadi.gradient(hamiltonian, u)
        bend = casadi.diag(casadi.jacobian(slope, u))
        self._arguments = x, u, t, p, costate
        self._rates = f, -casadi.gradient(hamiltonian, x)
        self.h = casadi.Function("h", [x, u, t, p, costate], [hamiltonian])
        self.h_slopes = casadi.Function("hs", [x, u, t, p, costate], [slope, bend])

    def gap(
        self, phase: PhaseSolution, p: FloatArray, table: Table, missed: FloatArray
    ) -> FloatArray:
        """Integral over each interval of the gap in the minimum principle.

        ``missed``: relative error of the dynamics on each interval, shape (K,).
        """
        count = phase.states.intervals
        if not phase.control_names:
            return np.zeros(count)
        nodes, weights = collocation("gauss", max(phase.mesh.points) + 2)
        x = flat(piece_values(phase.states.coefficients, nodes))
        u = flat(piece_values(phase.controls.coefficients, nodes))
        places = tuple(map(float, nodes))
        blocked = self._blocked(phase, x, table)
        along = np.any(blocked != 0.0, axis=0).reshape(count, -1).mean(axis=1)
        settling = along > _MOSTLY
        costates = self._settled(phase, settling)
        costate = np.vstack(
            [
                flat(interpolated(phase, places, costates)),
                flat(
                    self._pressures(
                        interpolated(phase, places, phase.path_multipliers), table
                    )
                ),
                np.repeat(phase.integral_prices[:, None], count * nodes.size, axis=1),
            ]
        )
        widths = np.diff(phase.states.breaks)
        t = (phase.states.breaks[:-1, None] + widths[:, None] * nodes).reshape(1, -1)
        parameters = np.repeat(p[:, None], t.size, axis=1)
        lower, upper = self.auditor.control_bounds(table)
        vertices = self._vertices(lower, upper)
        pinned: BoolArray = np.zeros(t.size, dtype=bool)
        if vertices:
            pinned = self._pinned(u, (lower, upper))
            costate[len(phase.state_names) :][np.ix_(self.mixed, pinned)] = 0.0
        h = self.h.map(t.size)
        here = np.asarray(h(x, u, t, parameters, costate)).ravel()
        slope, bend = (
            np.asarray(a)
            for a in self.h_slopes.map(t.size)(x, u, t, parameters, costate)
        )
        settled = np.repeat(settling, nodes.size)
        switching = self._switching(phase, np.flatnonzero(settling), p, places)
        gap = np.zeros(t.size)
        reach = self._reach((x, u, t, parameters, costate), slope, phase, missed)
        reach[:, settled | np.any(blocked != 0.0, axis=0)] = np.inf
        rate = np.asarray(self.auditor.f.map(t.size)(x, u, t, parameters))
        for j in range(u.shape[0]):
            with np.errstate(divide="ignore", invalid="ignore"):
                newton = np.where(bend[j] > 0.0, u[j] - slope[j] / bend[j], u[j])
            best = here.copy()
            for candidate in (newton, *self._ends(j, u[j], count, (lower, upper))):
                if not np.all(np.isfinite(candidate)):
                    continue
                trial = u.copy()
                trial[j] = np.clip(candidate, lower[j], upper[j])
                trial[j] = np.clip(trial[j], u[j] - reach[j], u[j] + reach[j])
                value = np.asarray(h(x, trial, t, parameters, costate)).ravel()
                if self.affine[j]:
                    step = trial[j, settled] - u[j, settled]
                    value[settled] = here[settled] + switching[j] * step
                change = (
                    np.asarray(self.auditor.f.map(t.size)(x, trial, t, parameters))
                    - rate
                )
                # A change that drives a state through its bound is no candidate.
                value[np.any(blocked * change > 1e-12, axis=0)] = np.inf
                best = np.fmin(best, value)
            gap += np.where(pinned & self.path_bound[j], 0.0, here - best)
        if pinned.any():
            at = (x[:, pinned], t[:, pinned], parameters[:, pinned])
            gap[pinned] += self._vertex_gap(
                vertices, u[:, pinned], at, costate[:, pinned], table
            )
        return np.asarray(widths * (gap.reshape(count, -1) @ weights))

    @cached_property
    def _singular(self) -> Any:  # noqa: ANN401 - a CasADi function
        """Second time derivative of each control's slope of H, and its own slope.

        Arguments as :attr:`h_slopes`; results of shape (controls,), the second one
        by the same control.
        """
        x, u, t, p, costate = self._arguments
        own = costate[: x.numel()]

        def along(e: Any) -> Any:  # noqa: ANN401 - of casadi
            rates = casadi.jtimes(e, x, self._rates[0]), casadi.jtimes(e, t, 1.0)
            return rates[0] + rates[1] + casadi.jtimes(e, costate, padded)

        rest = costate.numel() - own.numel()
        padded = casadi.vertcat(self._rates[1], casadi.SX.zeros(rest))
        second = along(along(self.h_slopes(x, u, t, p, costate)[0]))
        bend = casadi.diag(casadi.jacobian(second, u))
        return casadi.Function("singular", [x, u, t, p, costate], [second, bend])

    def _reach(
        self,
        at: tuple[FloatArray, ...],
        slope: FloatArray,
        phase: PhaseSolution,
        missed: FloatArray,
    ) -> FloatArray:
        """How far controls are from those of a singular arc, shape (controls, n).

        Where a control enters linearly and strengthens the Legendre-Clebsch condition
        in its general form (Kelley, Kopp, Moyer 1967, order 1), its arc off the bounds
        is where the second derivative of its slope vanishes. A Newton step leads there;
        a farther one is no gain, whatever the slope. Infinite elsewhere.
        """
        reach = np.full(slope.shape, np.inf)
        affine = list(self.affine)
        told = missed.max() < _TOLD and missed.min() <= _RESOLVED
        if not (told and any(affine)) or self.phase.path_constraints:
            return reach
        places = slope.shape[1] // missed.size
        second, bend = (np.asarray(a) for a in self._singular.map(slope.shape[1])(*at))
        rate = 2.0 * np.asarray(phase.mesh.points) / np.diff(phase.states.breaks)
        force = np.abs(second) + np.abs(slope) * np.repeat(rate, places) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(bend < 0.0, force / np.abs(bend), np.inf)
        step[:, np.repeat(missed > _RESOLVED, places)] = np.inf
        reach[affine] = np.nan_to_num(step, nan=np.inf)[affine]
        return reach

    def _pinned(
        self, u: FloatArray, bounds: tuple[FloatArray, FloatArray]
    ) -> BoolArray:
        """Mark where every control of a path constraint is held at its bound, (n,).

        The multiplier of that constraint is not determined there.
        """
        lower, upper = bounds
        near = 1e-9 * (upper - lower)[:, None]
        held = (u <= lower[:, None] + near) | (u >= upper[:, None] - near)
        return np.asarray(held[list(self.path_bound)].all(axis=0))

    def _ends(
        self, j: int, u: FloatArray, count: int, bounds: tuple[FloatArray, FloatArray]
    ) -> list[FloatArray]:
        """Bounds of control j; without one, what an interval's ``u`` differs by.

        A control that enters linearly has no other best value; ``u`` has ``count``
        intervals, one after the other.
        """
        reach = np.repeat(np.ptp(u.reshape(count, -1), axis=1), u.size // count)
        return [
            u + way * reach if self.affine[j] and np.isinf(bound[j]) else bound[j]
            for way, bound in zip((-1.0, 1.0), bounds, strict=True)
        ]

    def _pressures(self, pressures: FloatArray, table: Table) -> FloatArray:
        """Multipliers of path constraints with the signs that they may have.

        On an arc where a constraint is held as an equation its multiplier may push the
        wrong way: the trajectory would be better off without it. It counts as none, so
        that what would be gained shows as a gap.
        """
        low, high = self.auditor.path_bounds(table).T
        least = np.where(np.isinf(low), 0.0, -np.inf)
        most = np.where(np.isinf(high), 0.0, np.inf)
        return np.asarray(np.clip(pressures, least, most))

    def _degrees(self, phase: PhaseSolution, k: int) -> tuple[int, ...]:
        """Degree of each control on interval k."""
        given, least = phase.mesh.control_degrees, phase.mesh.points[k] - 1
        degrees = [
            given[name][k] if name in given else control.degree
            for name, control in self.phase.controls.items()
        ]
        return tuple(least if d is None or d < 0 else min(d, least) for d in degrees)

    def _switching(
        self,
        phase: PhaseSolution,
        chosen: IntArray,
        p: FloatArray,
        places: tuple[float, ...],
    ) -> FloatArray:
        """Slopes of the Hamiltonian by the controls, without their oscillation.

        Parameters
        ----------
        phase, p
            The solution, and values of parameters and statics.
        chosen
            Intervals on which a state is at its bound. Free coefficients of a control
            of degree d make the quadrature of its slope times any polynomial of degree
            d what it should be, and no more: the best approximation of that degree is
            all that is determined.
        places
            Fractions of the intervals where the slopes are wanted.

        Returns
        -------
        ndarray
            Shape (controls, chosen * places).
        """
        points = np.asarray(phase.mesh.points)
        first = np.cumsum(points) - points
        breaks = phase.states.breaks
        found = np.zeros((len(phase.control_names), chosen.size, len(places)))
        degrees = [self._degrees(phase, int(k)) for k in chosen]
        for (n, own), at in alike(zip(points[chosen].tolist(), degrees, strict=True)):
            k = chosen[at]
            nodes, weights = collocation(phase.scheme, n)
            x, u = (
                flat(piece_values(part.coefficients[k], nodes))
                for part in (phase.states, phase.controls)
            )
            t = breaks[k, None] + (breaks[k + 1] - breaks[k])[:, None] * nodes
            here = (first[k, None] + np.arange(n)).ravel()
            prices = np.repeat(phase.integral_prices[None], here.size, axis=0)
            costate = np.hstack(
                [phase.costates[here], phase.path_multipliers[here], prices]
            ).T
            parameters = np.repeat(p[:, None], here.size, axis=1)
            slope = np.asarray(
                self.h_slopes.map(here.size)(
                    x, u, t.reshape(1, -1), parameters, costate
                )[0]
            )
            for j, degree in enumerate(own):
                wanted = _best(nodes, weights, degree, np.array(places))
                found[j, at] = slope[j].reshape(-1, n) @ wanted.T
        return found.reshape(found.shape[0], -1)

    def _settled(self, phase: PhaseSolution, along: BoolArray) -> FloatArray:
        """Costates at the points, shape (points, states), without their oscillation.

        ``along``: on which intervals a state is at its bound, shape (K,); on these the
        best approximation of the greatest degree of a control is taken, as
        :meth:`_switching` does for slopes.
        """
        settled = phase.costates.copy()
        points = np.asarray(phase.mesh.points)
        first = np.cumsum(points) - points
        chosen = np.flatnonzero(along)
        degrees = [max(1, *self._degrees(phase, int(k))) for k in chosen]
        for (n, degree), at in alike(
            zip(points[chosen].tolist(), degrees, strict=True)
        ):
            if degree < n - 1:
                nodes, weights = collocation(phase.scheme, n)
                here = first[chosen[at], None] + np.arange(n)
                wanted = _best(nodes, weights, degree, nodes)
                settled[here] = wanted @ settled[here]
        return settled

    def _vertices(self, lower: FloatArray, upper: FloatArray) -> list[FloatArray]:
        """Corners of the box of the controls that path constraints may determine.

        None where there are no such controls, or too many, or one without bounds.
        """
        chosen = list(self.path_bound)
        box = list(zip(lower[chosen], upper[chosen], strict=True))
        if not 0 < len(box) <= _MOST_CORNERS or not np.all(np.isfinite(box)):
            return []
        return [np.array(corner) for corner in product(*box)]

    def _vertex_gap(
        self,
        vertices: list[FloatArray],
        u: FloatArray,
        at: tuple[FloatArray, FloatArray, FloatArray],
        costate: FloatArray,
        table: Table,
    ) -> FloatArray:
        """Gap against the corners that keep the path constraints, shape (n,).

        ``at``: states, times and parameters, with ``u`` all of n columns.
        """
        x, t, p = at
        count = t.size
        h, path = self.h.map(count), self.auditor.path.map(count)
        bounds = self.auditor.path_bounds(table)
        scale = self.auditor.path_scales(table)[:, None]

        def broken(control: FloatArray) -> FloatArray:
            values = np.asarray(path(x, control, t, p))
            over = np.maximum(bounds[:, :1] - values, values - bounds[:, 1:])
            return np.asarray((over / scale)[self.mixed].max(axis=0))

        here = np.asarray(h(x, u, t, p, costate)).ravel()
        allowed = np.maximum(broken(u), 0.0) + 1e-7
        best = here.copy()
        for vertex in vertices:
            trial = u.copy()
            trial[list(self.path_bound)] = vertex[:, None]
            value = np.asarray(h(x, trial, t, p, costate)).ravel()
            best = np.fmin(best, np.where(broken(trial) <= allowed, value, np.inf))
        return np.asarray(here - best)

    def _blocked(self, phase: PhaseSolution, x: FloatArray, table: Table) -> FloatArray:
        """Sign of the direction in which each state may not move, else 0."""
        pairs = np.array([table["bounds", phase.name, n] for n in phase.state_names])
        near = 1e-5 * ranges(phase.states)[:, None]
        at_lower = x < pairs[:, :1] + near
        at_upper = x > pairs[:, 1:] - near
        return at_upper.astype(np.float64) - at_lower.astype(np.float64)


def _best(
    nodes: FloatArray, weights: FloatArray, degree: int, places: FloatArray
) -> FloatArray:
    """Matrix from values at ``nodes`` to the best approximation at ``places``.

    The polynomial of that degree with the least squares weighted by the quadrature.
    """
    basis = legendre.legvander(2.0 * nodes - 1.0, degree)
    weighted = basis.T * weights
    fitted = np.linalg.solve(weighted @ basis, weighted)
    return np.asarray(legendre.legvander(2.0 * places - 1.0, degree) @ fitted)


def interpolated(
    phase: PhaseSolution, places: tuple[float, ...], nodal: FloatArray
) -> FloatArray:
    """Values at fractions of each interval from values at the points."""
    points = phase.mesh.points
    first = np.cumsum(points) - points
    out = np.zeros((len(points), len(places), nodal.shape[1]))
    for n, chosen in alike(points):
        from_nodes = np.linalg.inv(
            bernstein_basis(n - 1, collocation(phase.scheme, n)[0])
        )
        matrix = bernstein_values(n - 1, places) @ from_nodes
        out[chosen] = matrix @ nodal[first[chosen, None] + np.arange(n)]
    return out


def ranges(states: Any) -> FloatArray:  # noqa: ANN401
    """Range of each state over the phase; its magnitude, or 1, where constant."""
    low, high = states.bounds()
    size = np.maximum(np.abs(low), np.abs(high))
    span = high - low
    span = np.where(span > 1e-6 * size, span, size)
    return np.where(span > 0.0, span, 1.0)


def worth(solution: Solution) -> float:
    """Return what motion is worth to the objective: integral of abs(costates . rates).

    A factor of the objective multiplies it as it does the objective itself, and no unit
    of time or of a state changes it. The costates of single states may be large without
    end where an optimum hangs on exact end values; their sum over all states is not.
    """
    size = 0.0
    for part in solution.phases:
        rates = part.states.derivative()(part.costate_times)
        shares = np.repeat(np.diff(part.states.breaks), part.mesh.points)
        shares = shares / np.repeat(part.mesh.points, part.mesh.points)
        size += float(shares @ np.abs(np.sum(part.costates * rates, axis=1)))
    return size if np.isfinite(size) else 0.0


def objective_size(solution: Solution) -> float:
    """Return what errors of the objective are relative to."""
    least = max(solution.blur, _CANCELLED * worth(solution))
    size = max(abs(solution.objective), least)
    return size if size > 0.0 else 1.0


def flat(values: FloatArray) -> FloatArray:
    """Columns for a mapped function: (components, K * places)."""
    count = values.shape[0] * values.shape[1]
    return values.reshape(count, values.shape[2]).T
