"""Proof of a solution between its nodes: dynamics, path constraints, optimality.

Dynamics: the controls, clipped to their bounds, are integrated implicitly
(:mod:`showc.ocp.audit.integration`) from the start of every interval, and once through
from the start of the phase; both are compared with the polynomials of the states.

Optimality: the dual-weighted residual |l . (re-integrated - polynomial state)| of every
interval, integrals of the phase among the states, with costate l (Becker, Rannacher
2001), and the gap in the minimum principle (:mod:`showc.ocp.audit.optimality`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.audit.costates import interpolated
from showc.ocp.audit.integration import Flight, Integrator
from showc.ocp.audit.optimality import MinimumPrinciple, flat, ranges
from showc.ocp.mesh import alike
from showc.ocp.nodes import collocation
from showc.ocp.quantity import column
from showc.trajectory import bernstein_basis, piece_values

if TYPE_CHECKING:
    from showc.arrays import BoolArray, FloatArray
    from showc.ocp.phase import Phase
    from showc.ocp.problem import Problem
    from showc.ocp.solution import PhaseSolution, Solution
    from showc.ocp.transcription.collocation.statement import Table


_PLACES = 0.5 - 0.5 * np.cos(np.pi * np.arange(97) / 96.0)
"""Places on each interval where path constraints are looked at: closer at the ends,
where the polynomials of neighbours meet and a constraint is left."""
_FINE, _ALONG, _LOOKS = 65, 1000, 20_000
"""Places on each interval, over the length of a phase, and on all intervals at most,
where rates and integrands are looked at for what points step over."""
_OUTSTANDS = 20.0
"""Greatest residual, or change of rates from place to place, over the median one, from
which on something is there that points step over; for polynomials it is below 10."""
_UNSEEN = 100.0
"""Integral of a residual over the distance that an integration finds, from which on the
integration has stepped over something."""
_ALONE = 3.0
"""The greatest change of rates over the second one, if it is a jump and no slope."""
_EVEN = 1e-3
"""Change of rates over their size that is none to speak of."""
_CLOSE = 0.02
"""Share of an interval beside its ends in which no cut is made."""
_AT_BOUND = 1e-6
"""Share of a state's range within which a coefficient is at its bound."""
_SHARES = 0.5 * np.diff(_PLACES, prepend=0.0) + 0.5 * np.diff(_PLACES, append=1.0)
"""Share of the interval that each place stands for."""


@dataclass(frozen=True, slots=True, eq=False)
class PhaseAudit:
    """Errors of one phase, interval by interval."""

    dynamics: FloatArray
    """Greatest error of a state over its range, shape (K,)."""
    jumps: tuple[tuple[float, ...], ...]
    """Fractions of each interval between which the dynamics jump; empty if nowhere."""
    objective_dynamics: FloatArray
    """Dual-weighted residual, in units of the objective, shape (K,)."""
    quadrature: FloatArray
    """Part of it by which the points misjudge integrals, whatever the costates, shape
    (K,)."""
    by_control: FloatArray
    """Gap in the minimum principle, in units of the objective: by each control alone,
    then by those in path constraints together, then by other valleys of the
    Hamiltonian, shape (controls + 2, K)."""
    better: FloatArray
    """Times, and controls of the least Hamiltonian: shape (1 + controls, n)."""
    beside: FloatArray
    """What path constraints press beside the places where they are at their bounds, in
    units of the objective, shape (K,)."""
    contacts: tuple[tuple[float, ...], ...]
    """Fraction of each interval at which what presses so is nearest to its bound."""
    path: FloatArray
    """Greatest violation of a path constraint over its scale, shape (K,)."""
    path_places: tuple[tuple[float, ...], ...]
    """Fractions of each interval with a local maximum of a violation."""
    path_names: tuple[str, ...]
    """Path constraint that is violated most on each interval; empty if none is."""
    path_active: FloatArray
    """Share of each interval on which a path constraint is about at its bound."""
    worst_path: str
    """Which path constraint is violated most, and when; empty if none."""
    clear: BoolArray
    """Where no state and no path constraint comes to its bound, so that costates are
    smooth, shape (K,)."""
    shooting: float = 0.0
    """Greatest error over range of one integration through the phase, once made."""
    shooting_end: FloatArray | None = None
    """State where that integration ends, shape (states,)."""

    @property
    def objective_control(self) -> FloatArray:
        """Gap in the minimum principle, in units of the objective, shape (K,)."""
        return np.asarray(self.by_control.sum(axis=0))

    def without_objective(self) -> PhaseAudit:
        """Return the audit of a phase that is worth nothing to the objective."""
        none = np.zeros_like(self.objective_dynamics)
        return replace(
            self,
            objective_dynamics=none,
            quadrature=none,
            beside=none,
            by_control=np.zeros_like(self.by_control),
        )


class PhaseAuditor:
    """Compiled functions of a phase for audits; made once per problem."""

    def __init__(self, problem: Problem, phase: Phase, index: int) -> None:
        self.problem, self.phase, self.index = problem, phase, index
        self.least_range: FloatArray | float = 0.0
        """Range from which on errors of a state are relative to its own range."""
        (x, u), p, t, f = phase.members, problem.given, phase.time, phase.dynamics
        self.f = casadi.Function("f", [x, u, t, p], [f])
        by_state = _entries(casadi.jacobian(f, x))
        self.drives = _entries(casadi.jacobian(f, u))
        """Which control reaches which state, also by way of others, shape (states,
        controls)."""
        for _ in phase.states:
            self.drives |= by_state @ self.drives
        path = column(c.symbol for c in phase.path_constraints)
        self.path = casadi.Function("path", [x, u, t, p], [path])
        self.principle = MinimumPrinciple(phase, (x, u, t, p), self)
        integrands = column(e for _, e in phase.integrals)
        self.running = casadi.Function("running", [x, u, t, p], [integrands])
        self.integrator = Integrator(self.f, self.running)

    def _flight(self, solution: Solution, table: Table) -> Flight:
        """Return what is integrated of one phase of ``solution``."""
        phase = solution.phases[self.index]
        p = given(solution)
        reference = np.maximum(ranges(phase.states), self.least_range)
        bounds, domain = self.control_bounds(table), self.state_bounds(table)
        return Flight(phase, bounds, domain, p, np.asarray(reference))

    def shot(self, audit: PhaseAudit, solution: Solution, table: Table) -> PhaseAudit:
        """Complete an audit of ``solution`` by one integration through the phase."""
        flight = self._flight(solution, table)
        ends = self.integrator.shoot(flight)
        last = flight.phase.states.coefficients[:, -1]
        far = np.nan_to_num(np.abs(ends - last) / flight.scale, nan=1e9)
        return replace(audit, shooting=float(far.max()), shooting_end=ends[-1])

    def audit(self, solution: Solution, table: Table) -> PhaseAudit:
        """Audit one phase of ``solution``; :meth:`shot` completes it."""
        flight = self._flight(solution, table)
        phase, p, reference = flight.phase, flight.parameters, flight.scale
        starts = phase.states.coefficients[:, 0]
        flown = self.integrator.fly(flight, starts)
        missed = flown.ends - phase.states.coefficients[:, -1]
        missed = np.nan_to_num(missed, nan=1e9, posinf=1e9, neginf=1e9)
        costate_end = interpolated(phase, (1.0,), phase.costates)
        residual = np.einsum("kc,kc->k", costate_end[:, 0], missed)
        # Integrals are states as others, with costates that do not change.
        misjudged = np.nan_to_num(flown.integrals, nan=1e9) @ phase.integral_prices
        unseen = self._unseen_integrals(phase, p)
        over = unseen > _UNSEEN * np.abs(misjudged)
        misjudged = np.where(over, unseen, misjudged)
        residual += misjudged
        values = self._path_values(phase, p)
        path, path_places, path_names, active, worst = self._path(phase, values, table)
        beside, contacts = self._beside(phase, values, table)
        unseen, jumps = self._features(phase, p, reference)
        gap, better = self.principle.gap(phase, p, table, flown.deviation)
        return PhaseAudit(
            np.where(unseen > _UNSEEN * flown.deviation, unseen, flown.deviation),
            jumps,
            np.abs(residual),
            np.abs(misjudged),
            gap,
            better,
            beside,
            contacts,
            path,
            path_places,
            path_names,
            active,
            worst,
            (active == 0.0) & self._clear(phase, table),
        )

    def control_bounds(self, table: Table) -> tuple[FloatArray, FloatArray]:
        """Bounds of the controls, each of shape (controls,)."""
        pairs = [table["bounds", self.phase.name, name] for name in self.phase.controls]
        bounds = np.array(pairs).reshape(-1, 2)
        return bounds[:, 0], bounds[:, 1]

    def state_bounds(self, table: Table) -> tuple[FloatArray, FloatArray]:
        """Bounds of the states, each of shape (states,)."""
        pairs = [table["bounds", self.phase.name, name] for name in self.phase.states]
        bounds = np.array(pairs).reshape(-1, 2)
        return bounds[:, 0], bounds[:, 1]

    def _clear(self, phase: PhaseSolution, table: Table) -> BoolArray:
        """Mark intervals on which no state comes to its bound, given ends aside."""
        lower, upper = self.state_bounds(table)
        points = phase.states.coefficients
        near = _AT_BOUND * ranges(phase.states)
        held = (points < lower + near) | (points > upper - near)
        held[0, 0] = held[-1, -1] = False
        return np.asarray(~held.any(axis=(1, 2)))

    def path_values(self, solution: Solution, times: FloatArray) -> FloatArray:
        """Values of the path constraints at ``times``: (constraints, n)."""
        phase = solution.phases[self.index]
        p = given(solution)
        return np.asarray(
            self.path.map(times.size)(
                phase.states(times).T,
                phase.controls(times).T,
                times[None, :],
                np.repeat(p[:, None], times.size, axis=1),
            )
        )

    def _features(
        self, phase: PhaseSolution, p: FloatArray, reference: FloatArray
    ) -> tuple[FloatArray, tuple[tuple[float, ...], ...]]:
        """Look closely for what points and integrators step over.

        Returns
        -------
        tuple
            Integral of the residual over the states' ranges on intervals where it is
            far greater somewhere than elsewhere, shape (K,), 0 on others; and the
            fractions of each interval between which the rates jump with the time.
        """
        places, widths = _closely(phase), np.diff(phase.states.breaks)
        x, u, t, parameters = _sampled(phase, p, places)
        shape = (x.shape[0], widths.size, places.size)
        rates = np.asarray(self.f.map(t.size)(x, u, t, parameters))
        rates = np.nan_to_num(rates).reshape(shape)
        slopes = flat(piece_values(phase.states.derivative().coefficients, places))
        over = np.abs(slopes.reshape(shape) - rates) / reference[:, None, None]
        residual = over.max(axis=0) * widths[:, None]
        usual = _OUTSTANDS * np.median(residual, axis=1)
        missed = np.where(residual.max(axis=1) > usual, residual.mean(axis=1), 0.0)
        # What jumps with the time stays where it is on the next mesh; what jumps with
        # a state moves with that.
        later = np.roll(t.reshape(shape[1:]), -1, axis=1).reshape(1, -1)
        after = np.asarray(self.f.map(t.size)(x, u, later, parameters))
        steps = np.abs(np.nan_to_num(after).reshape(shape) - rates)[:, :, :-1]
        sizes = np.maximum(np.abs(rates).max(axis=(1, 2)), 1e-300)[:, None, None]
        steps = np.max(steps / sizes, axis=0)
        second, greatest = np.sort(steps, axis=1)[:, -2:].T
        usual = _OUTSTANDS * np.median(steps, axis=1) + _EVEN
        jump = (greatest > usual) & (greatest > _ALONE * second)
        between = tuple(
            tuple(float(s) for s in places[at : at + 2] if 0.0 < s < 1.0) if yes else ()
            for at, yes in zip(steps.argmax(axis=1), jump, strict=True)
        )
        return missed, between

    def _unseen_integrals(self, phase: PhaseSolution, p: FloatArray) -> FloatArray:
        """Look closely at integrands for what points step over, as at the rates.

        Returns
        -------
        ndarray
            Integral of how far they are from the polynomial through their values at
            the points, where that is far greater somewhere than elsewhere, in units of
            the objective, shape (K,); 0 on other intervals.
        """
        missed = np.zeros(phase.mesh.intervals)
        if not phase.integral_prices.any():
            return missed
        places = _closely(phase)
        fine = self._running(phase, p, places)
        for n, chosen in alike(phase.mesh.points):
            nodes = np.asarray(collocation(phase.scheme, n)[0])
            known = self._running(phase, p, nodes)[chosen]
            through = bernstein_basis(n - 1, nodes)
            between = bernstein_basis(n - 1, places) @ np.linalg.inv(through)
            far = np.abs(fine[chosen] - known @ between.T)
            seen = far.max(axis=1) > _OUTSTANDS * np.median(far, axis=1)
            missed[chosen] = np.where(seen, far.mean(axis=1), 0.0)
        return missed * np.diff(phase.states.breaks)

    def _running(
        self, phase: PhaseSolution, p: FloatArray, places: FloatArray
    ) -> FloatArray:
        """Sum of the integrands by their prices at places of all intervals, (K, n)."""
        x, u, t, parameters = _sampled(phase, p, places)
        values = self.running.map(t.size)(x, u, t, parameters)
        # An integrand may be infinite at an end, and its integral have a value.
        known = np.nan_to_num(np.asarray(values), posinf=0.0, neginf=0.0)
        return np.asarray((phase.integral_prices @ known).reshape(-1, places.size))

    def path_scales(self, table: Table) -> FloatArray:
        """Scales in which the path constraints' violations count, (constraints,)."""
        names = [c.name for c in self.phase.path_constraints]
        return np.array([table.path_scale(self.phase.name, name) for name in names])

    def path_bounds(self, table: Table) -> FloatArray:
        """Bounds of the path constraints, shape (constraints, 2)."""
        constraints = self.phase.path_constraints
        pairs = [table["path", self.phase.name, c.name] for c in constraints]
        return np.array(pairs).reshape(-1, 2)

    def _path_values(self, phase: PhaseSolution, p: FloatArray) -> FloatArray:
        """Values of path constraints on all intervals, (constraints, K, places)."""
        count, constraints = phase.states.intervals, self.phase.path_constraints
        if not constraints:
            return np.zeros((0, count, _PLACES.size))
        x, u, t, parameters = _sampled(phase, p, _PLACES)
        values = self.path.map(t.size)(x, u, t, parameters)
        return np.asarray(values).reshape(len(constraints), count, _PLACES.size)

    def _beside(
        self, phase: PhaseSolution, values: FloatArray, table: Table
    ) -> tuple[FloatArray, tuple[tuple[float, ...], ...]]:
        """Integrate multipliers times the room to the bounds: 0 where they touch.

        A constraint that is touched within an interval makes costates jump there, which
        no polynomial does: what presses is spread over the interval, and the minimum
        principle holds with such costates. By weak duality the objective may be as much
        greater than the least as the integral says.
        """
        count = phase.states.intervals
        if not np.any(phase.inner_multipliers):
            return np.zeros(count), ((),) * count
        bounds = self.path_bounds(table)[:, :, None, None]
        room = np.minimum(values - bounds[:, 0], bounds[:, 1] - values)
        room = np.maximum(room, 0.0)
        pressure = interpolated(phase, tuple(_PLACES), phase.inner_multipliers)
        lost = (np.abs(pressure).transpose(2, 0, 1) * room) @ _SHARES
        nearest = _PLACES[room[lost.argmax(axis=0), np.arange(count)].argmin(axis=1)]
        contacts = tuple(
            (float(s),) if _CLOSE < s < 1.0 - _CLOSE else () for s in nearest
        )
        return np.diff(phase.states.breaks) * lost.sum(axis=0), contacts

    def _path(
        self, phase: PhaseSolution, values: FloatArray, table: Table
    ) -> tuple[
        FloatArray, tuple[tuple[float, ...], ...], tuple[str, ...], FloatArray, str
    ]:
        count = phase.states.intervals
        constraints = self.phase.path_constraints
        if not constraints:
            return np.zeros(count), ((),) * count, ("",) * count, np.zeros(count), ""
        bounds = self.path_bounds(table)
        scale = self.path_scales(table)[:, None, None]
        violation = (
            np.maximum(
                bounds[:, 0, None, None] - values, values - bounds[:, 1, None, None]
            )
            / scale
        )
        top = violation.max(axis=0)
        found = [_peaks(_PLACES, top[k]) for k in range(count)]
        worst = ""
        if violation.max() > 0.0:
            at = np.unravel_index(int(np.argmax(violation)), violation.shape)
            c, k, s = (int(number) for number in at)
            breaks = phase.states.breaks
            time = breaks[k] + (breaks[k + 1] - breaks[k]) * _PLACES[s]
            worst = (
                f"{constraints[c].name!r} at t = {time:.6g} in phase "
                f"{phase.name!r}, by {violation.max() * scale[c, 0, 0]:.3g}"
            )
        greatest = np.maximum(top.max(axis=1), 0.0)
        near = top > -np.maximum(greatest, 1e-4)[:, None]
        most = np.argmax(violation.max(axis=2), axis=0)
        names = tuple(
            constraints[int(c)].name if over > 0.0 else ""
            for c, over in zip(most, greatest, strict=True)
        )
        return greatest, tuple(found), names, near @ _SHARES, worst


def _closely(phase: PhaseSolution) -> FloatArray:
    """Places of each interval that are near enough to each other in the widest one."""
    widest = float(np.diff(phase.states.breaks).max()) / phase.duration
    count = min(int(_ALONG * widest), _LOOKS // phase.mesh.intervals)
    return np.linspace(0.0, 1.0, max(_FINE, count))


def _sampled(
    phase: PhaseSolution, p: FloatArray, places: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """States, controls, times and parameters at places of all intervals, by column."""
    widths = np.diff(phase.states.breaks)
    t = (phase.states.breaks[:-1, None] + widths[:, None] * places).reshape(1, -1)
    return (
        flat(piece_values(phase.states.coefficients, places)),
        flat(piece_values(phase.controls.coefficients, places)),
        t,
        np.repeat(p[:, None], t.size, axis=1),
    )


def given(solution: Solution) -> FloatArray:
    """Values of the parameters and statics of a solution, in one row."""
    return np.array([*solution.parameters.values(), *solution.statics.values()])


def _entries(slopes: Any) -> BoolArray:  # noqa: ANN401 - of casadi
    """Mark the entries of a matrix of expressions that are not always zero."""
    found = np.zeros(slopes.shape, dtype=bool)
    rows, columns = slopes.sparsity().get_triplet()
    found[rows, columns] = True
    return found


def _peaks(places: FloatArray, violation: FloatArray) -> tuple[float, ...]:
    """Places of the local maxima of a positive violation, by a parabola's vertex."""
    row = np.concatenate([[-np.inf], violation, [-np.inf]])
    peak = (violation > 0.0) & (violation >= row[:-2]) & (violation >= row[2:])
    found = []
    for at in np.flatnonzero(peak):
        place = float(places[at])
        if 0 < at < places.size - 1:
            before, after = places[at] - places[at - 1], places[at + 1] - places[at]
            falls = (violation[at] - violation[at - 1]) / before
            rises = (violation[at + 1] - violation[at]) / after
            if rises < falls:
                # Where the slope of the parabola through the three is zero.
                slope = (falls * after + rises * before) / (before + after)
                place += 0.5 * slope * (before + after) / (falls - rises)
        found.append(place)
    return tuple(found)
