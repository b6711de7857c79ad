"""The gap in Pontryagin's minimum principle, integrated over each mesh interval.

With costate l and Hamiltonian H = L + l . f, the objective exceeds the optimum to first
order by

    sum over intervals of |l . (re-integrated - polynomial state)|          (dynamics)
    integral of H(x, u, l) - min over v in bounds of H(x, v, l)             (control)

The second is computed here, with costates between the points as
:mod:`showc.ocp.audit.costates` gives them.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.audit.constrained import ConstrainedControls
from showc.ocp.audit.costates import (
    best_approximation,
    degrees_of,
    interpolated,
    without_oscillation,
)
from showc.ocp.mesh import alike
from showc.ocp.nodes import collocation
from showc.ocp.quantity import column
from showc.trajectory import piece_values

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.ocp.audit.residuals import PhaseAuditor
    from showc.ocp.phase import Phase
    from showc.ocp.solution import PhaseSolution, Solution
    from showc.ocp.transcription.collocation.statement import Table


_CANCELLED = 1e-3
"""An objective below this share of what the states are worth is all but zero: its error
is judged over that share instead."""
_RESOLVED = 1e-5
"""Error of an interval's dynamics up to which it tells where its singular arc is."""
_TOLD = 1e-2
"""Error of any dynamics up to which costates tell it."""
_SCANNED = 8
"""Places of a control's range from which valleys of the Hamiltonian are looked for:
each turn of an angle has one, and bounds seldom leave more than two turns."""
_DESCENTS = 3
"""Newton's steps from each."""
_HALVES = np.array([0.0, 0.5, 1.0])
"""Ends and middle of an interval."""
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
        self.constrained = ConstrainedControls(path, symbols, auditor)
        """Controls in path constraints."""
        slope = casadi.gradient(hamiltonian, u)
        bend = casadi.diag(casadi.jacobian(slope, u))
        self._arguments = x, u, t, p, costate
        self._rates = f, -casadi.gradient(hamiltonian, x)
        self.quadratic = tuple(
            not casadi.depends_on(bend[j], u[j]) for j in range(u.numel())
        )
        """For each control: whether the Hamiltonian bends alike whatever its value, so
        that there is no second valley of it."""
        self.h = casadi.Function("h", [x, u, t, p, costate], [hamiltonian])
        self.h_slopes = casadi.Function("hs", [x, u, t, p, costate], [slope, bend])

    def gap(
        self, phase: PhaseSolution, p: FloatArray, table: Table, missed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Integral over each interval of the gap in the minimum principle.

        Parameters
        ----------
        phase, p, table
            The solution, values of parameters and statics, and bounds.
        missed
            Relative error of the dynamics on each interval, shape (K,).

        Returns
        -------
        tuple
            The gap by each control alone, then by controls in path constraints together
            where all of them are at bounds, then what other valleys of the Hamiltonian
            have more: shape (controls + 2, K). And the best values found, with their
            times as the first row: shape (1 + controls, n).
        """
        count = phase.states.intervals
        if not phase.control_names:
            return np.zeros((2, count)), np.zeros((1, 0))
        nodes, weights = collocation("gauss", max(phase.mesh.points) + 2)
        at = self._places(phase, p, table, nodes)
        x, u, t, parameters, costate = at
        blocked = self._blocked(phase, x, table)
        along = np.any(blocked != 0.0, axis=0).reshape(count, -1).mean(axis=1)
        settling = along > _MOSTLY
        widths = np.diff(phase.states.breaks)
        bounds = self.auditor.control_bounds(table)
        vertices = self.constrained.vertices(*bounds)
        pinned: BoolArray = np.zeros(t.size, dtype=bool)
        if vertices:
            pinned = self.constrained.pinned(u, bounds)
            mixed = np.ix_(self.constrained.mixed, pinned)
            costate[len(phase.state_names) :][mixed] = 0.0
        h = self.h.map(t.size)
        here = np.asarray(h(*at)).ravel()
        slope, _ = self._slopes(at)
        settled = np.repeat(settling, nodes.size)
        switching = self._switching(
            phase, np.flatnonzero(settling), p, tuple(map(float, nodes))
        )
        gap, better = np.zeros((u.shape[0] + 2, t.size)), np.vstack([t, u])
        reach = self._reach(at, slope, phase, missed)
        reach[:, settled | np.any(blocked != 0.0, axis=0)] = np.inf
        rate = np.asarray(self.auditor.f.map(t.size)(x, u, t, parameters))
        for j in range(u.shape[0]):
            best = here.copy()
            left = pinned & self.constrained.bound[j]
            near, far = self._candidates(j, at, bounds, count)
            for number, candidate in enumerate((*near, *far)):
                trial = u.copy()
                trial[j] = np.clip(candidate, u[j] - reach[j], u[j] + reach[j])
                value = np.asarray(h(x, trial, t, parameters, costate)).ravel()
                if self.constrained.restricts(j, table, convex=self.quadratic[j]):
                    value = here + self.constrained.change(j, at, trial, h, table)
                if self.affine[j]:
                    step = trial[j, settled] - u[j, settled]
                    value[settled] = here[settled] + switching[j] * step
                change = (
                    np.asarray(self.auditor.f.map(t.size)(x, trial, t, parameters))
                    - rate
                )
                # A change that drives a state through its bound is no candidate.
                value[left | np.any(blocked * change > 1e-12, axis=0)] = np.inf
                gain = np.fmax(best - value, 0.0)
                gap[j if number < len(near) else -1] += gain
                better[j + 1] = np.where(gain > 0.0, trial[j], better[j + 1])
                best -= gain
        if pinned.any():
            there = tuple(part[:, pinned] for part in at)
            h = self.h.map(int(np.count_nonzero(pinned)))
            gap[-2, pinned] = self.constrained.vertex_gap(vertices, there, h, table)
        total = widths * (gap.reshape(len(gap), count, -1) @ weights)
        total[: u.shape[0]] += self._junctions(phase, p, table, settling)
        return total, better

    def _junctions(
        self, phase: PhaseSolution, p: FloatArray, table: Table, settling: BoolArray
    ) -> FloatArray:
        """Estimate what is lost where a control jumps as a state comes to its bound.

        There, and where the state leaves it, the slope of the Hamiltonian is nought. If
        it is s and changes by s' a second, the control should jump s / s' later, and s²
        / 2 s' is lost for each unit of the jump. On the state's bound no candidate
        tells: they would drive it through.

        ``settling``: on which intervals a state is at its bound, (K,). Shape (controls,
        K).
        """
        count, widths = settling.size, np.diff(phase.states.breaks)
        controls = phase.controls.coefficients
        found = np.zeros((controls.shape[2], count))
        borders = np.flatnonzero(settling[1:] != settling[:-1])
        if not borders.size:
            return found
        slope, _ = self._slopes(self._places(phase, p, table, _HALVES))
        slope = slope.reshape(-1, count, _HALVES.size)
        on, off = borders + settling[borders + 1], borders + settling[borders]
        # From the state's bound: the near end of the other interval, and its middle.
        ends = np.where(on > off, _HALVES.size - 1, 0)
        near, middle = slope[:, off, ends], slope[:, off, _HALVES.size // 2]
        change = 2.0 * np.abs(near - middle) / widths[off]
        leap = np.abs(controls[borders + 1, 0] - controls[borders, -1]).T
        with np.errstate(divide="ignore", invalid="ignore"):
            later = np.fmin(np.abs(near) / change, widths[on])
        lost = 0.5 * np.abs(near) * later * leap * np.array(self.affine)[:, None]
        found[:, on] = np.nan_to_num(lost)
        return found

    def preferred(
        self, phase: PhaseSolution, p: FloatArray, table: Table, places: FloatArray
    ) -> FloatArray:
        """Return the bound that each control should be at where it enters linearly.

        -1 for the lower, 1 for the upper; 0 for others. At fractions of every interval:
        shape (controls, K * places).
        """
        slope, _ = self._slopes(self._places(phase, p, table, places))
        return np.asarray(-np.sign(slope) * np.array(self.affine)[:, None])

    def _places(
        self, phase: PhaseSolution, p: FloatArray, table: Table, places: FloatArray
    ) -> tuple[FloatArray, ...]:
        """Arguments of the Hamiltonian at fractions of every interval, in columns."""
        count = phase.states.intervals
        x = flat(piece_values(phase.states.coefficients, places))
        u = flat(piece_values(phase.controls.coefficients, places))
        near = np.any(self._blocked(phase, x, table) != 0.0, axis=0)
        settling = near.reshape(count, -1).mean(axis=1) > _MOSTLY
        costates = without_oscillation(self.phase, phase, settling)
        shares = tuple(map(float, places))
        pressures = interpolated(phase, shares, phase.path_multipliers)
        costate = np.vstack(
            [
                flat(interpolated(phase, shares, costates)),
                flat(self._pressures(pressures, table)),
                np.repeat(phase.integral_prices[:, None], count * places.size, axis=1),
            ]
        )
        widths = np.diff(phase.states.breaks)
        t = (phase.states.breaks[:-1, None] + widths[:, None] * places).reshape(1, -1)
        return x, u, t, np.repeat(p[:, None], t.size, axis=1), costate

    def _slopes(self, at: tuple[FloatArray, ...]) -> tuple[FloatArray, FloatArray]:
        """First and second derivatives of H by each control, shapes (controls, n)."""
        slope, bend = self.h_slopes.map(at[2].size)(*at)
        return np.asarray(slope), np.asarray(bend)

    def _candidates(
        self,
        j: int,
        at: tuple[FloatArray, ...],
        bounds: tuple[FloatArray, FloatArray],
        count: int,
    ) -> tuple[list[FloatArray], list[FloatArray]]:
        """Values of control j that may be better ones, each of shape (n,).

        Newton's step and the bounds; and where H may have several valleys what Newton's
        steps lead to from places all over the range.
        """
        x, u, *rest = at
        low, high = bounds[0][j], bounds[1][j]

        def descent(value: FloatArray) -> FloatArray:
            trial = u.copy()
            trial[j] = value
            slope, bend = (a[j] for a in self._slopes((x, trial, *rest)))
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.where(bend > 0.0, slope / bend, 0.0)
            return np.asarray(np.clip(value - step, low, high))

        near, far = [descent(u[j])], []
        near += [np.clip(end, low, high) for end in self._ends(j, u[j], count, bounds)]
        if not self.quadratic[j]:
            span = np.ptp(u[j]) or 1.0
            first = low if np.isfinite(low) else u[j].min() - span
            last = high if np.isfinite(high) else u[j].max() + span
            for share in (np.arange(_SCANNED) + 0.5) / _SCANNED:
                value = np.full(u.shape[1], first + share * (last - first))
                for _ in range(_DESCENTS):
                    value = np.nan_to_num(descent(value), nan=first)
                far.append(value)
        return [value for value in near if np.all(np.isfinite(value))], far

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
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = np.where(bend < 0.0, force / np.abs(bend), np.inf)
        step[:, np.repeat(missed > _RESOLVED, places)] = np.inf
        reach[affine] = np.nan_to_num(step, nan=np.inf)[affine]
        return reach

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
        degrees = [degrees_of(self.phase, phase, int(k)) for k in chosen]
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
                wanted = best_approximation(nodes, weights, degree, np.array(places))
                found[j, at] = slope[j].reshape(-1, n) @ wanted.T
        return found.reshape(found.shape[0], -1)

    def _blocked(self, phase: PhaseSolution, x: FloatArray, table: Table) -> FloatArray:
        """Sign of the direction in which each state may not move, else 0."""
        pairs = np.array([table["bounds", phase.name, n] for n in phase.state_names])
        near = 1e-5 * ranges(phase.states)[:, None]
        at_lower = x < pairs[:, :1] + near
        at_upper = x > pairs[:, 1:] - near
        return at_upper.astype(np.float64) - at_lower.astype(np.float64)


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
