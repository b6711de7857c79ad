"""A problem on a mesh, built once and solved many times.

Between solves, parameters, bounds, end values, durations, half-spaces and the first
guess may change; only the mesh and the expressions are fixed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from showc.ocp import guess as guesses
from showc.ocp.discretisation import discretise
from showc.ocp.guess import Guess, curves_of, sample
from showc.ocp.limits import Box, Overrides, Statement, box, parameter_vector
from showc.ocp.nodes import bernstein_values, collocation, fitting_points
from showc.ocp.solution import (
    Multipliers,
    PhaseSolution,
    Result,
    Solution,
)
from showc.ocp.warmstart import transfer
from showc.ocp.solver import SolverOptions, make_solver, result_of
from showc.trajectory import PiecewisePolynomial, bernstein_basis_inverse

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from showc.ocp.limits import Table
    from showc.ocp.mesh import Mesh, PhaseMesh
    from showc.ocp.nodes import Scheme
    from showc.ocp.problem import Phase, Problem

    FloatArray = NDArray[np.float64]


class Transcription:
    """A problem discretised on a mesh, ready to be solved many times.

    Parameters
    ----------
    problem
        What is to be solved; not to be changed afterwards.
    mesh
        Intervals, arcs and points of each phase.
    scheme
        Collocation points: ``gauss`` (default), ``radau`` or ``lobatto``.
    scales
        Typical magnitudes by name (``"x"``, ``"phase.x"``, ``"phase.duration"``)
        where bounds and end values do not tell them.
    options
        How the nonlinear program is solved.

    Raises
    ------
    ValueError
        If the problem is not completely stated or the mesh has other phases.
    SolverMissingError
        If the solver asked for is not available.
    """

    def __init__(
        self,
        problem: Problem,
        mesh: Mesh,
        *,
        scheme: Scheme = "gauss",
        scales: Mapping[str, float] | None = None,
        options: SolverOptions | None = None,
    ) -> None:
        self.problem, self.mesh, self.scheme = problem, mesh, scheme
        self.options = options or SolverOptions()
        self._statement = Statement(problem)
        self.scales = self._statement.scales(scales or {})
        self.discretisation = discretise(problem, mesh, scheme, self.scales)
        self._solvers: dict[bool, Any] = {}

    def solve(
        self,
        *,
        parameters: Mapping[str, float] | None = None,
        overrides: Overrides | None = None,
        guess: Guess | Solution | None = None,
        warm: Multipliers | None = None,
        arcs: Sequence[FloatArray | None] | None = None,
        former: Transcription | None = None,
    ) -> Solution:
        """Solve once.

        Parameters
        ----------
        parameters
            Values of the problem's parameters, by name.
        overrides
            Bounds, end values, durations and half-spaces that differ this time.
        guess
            Where to start: functions or arrays, or a solution on any mesh.
        warm
            Multipliers (with their point) of an earlier solve of this transcription;
            replaces ``guess``.
        arcs
            First guess of the arcs' durations of each phase, for a mesh with several
            arcs.
        former
            The transcription, on another mesh, that ``guess`` is a solution of: its
            multipliers are carried over.

        Returns
        -------
        Solution
            Never raises for a problem without solution: see ``result``, ``message``.

        Raises
        ------
        ValueError
            If a name is unknown or a parameter has no value.
        """
        changes = overrides or Overrides()
        values = self._statement.parameters(parameters or {})
        table = self._statement.table(values)
        limits = box(self.problem, self.mesh, self.discretisation, table, changes)
        start = self._starting_point(guess, limits, table, changes, arcs)
        built = self.discretisation
        vector = parameter_vector(built, values, changes, built.program.parameters)
        scaled = {
            "p": vector,
            "lbx": limits.lower / built.unknown_scale,
            "ubx": limits.upper / built.unknown_scale,
            "lbg": limits.row_lower / built.row_scale,
            "ubg": limits.row_upper / built.row_scale,
            "x0": start / built.unknown_scale,
        }
        given = dict(zip(self._statement.names, values.tolist(), strict=True))
        if limits.contradictions:
            result, message = Result.CONTRADICTION, "; ".join(limits.contradictions)
            point = scaled["x0"]
            nothing = Multipliers(
                point, np.zeros(point.size), np.zeros(built.row_scale.size)
            )
            return self._solution(
                result, f"{result.value} {message}.", nothing, limits, 0, 0.0, given
            )
        if former is not None and isinstance(guess, Solution):
            warm = transfer(former, guess, self, scaled["x0"])
        if warm is not None:
            scaled |= {
                "x0": warm.unknowns,
                "lam_x0": warm.of_bounds,
                "lam_g0": warm.of_constraints,
            }
        solver = self._solver(warm=warm is not None)
        answer = solver(**scaled)
        statistics = solver.stats()
        result = result_of(statistics["return_status"])
        multipliers = Multipliers(
            np.asarray(answer["x"]).ravel(),
            np.asarray(answer["lam_x"]).ravel(),
            np.asarray(answer["lam_g"]).ravel(),
        )
        message = result.value
        if not result.usable:
            message = f"{message} {self._worst(multipliers, limits, vector)}"
        return self._solution(
            result,
            message,
            multipliers,
            limits,
            int(statistics["iter_count"]),
            float(answer["f"]) * self.scales.objective,
            given,
        )

    def _solver(self, *, warm: bool) -> Any:  # noqa: ANN401
        if warm not in self._solvers:
            self._solvers[warm] = make_solver(
                self.discretisation.program, self.options, warm=warm
            )
        return self._solvers[warm]

    # --- where the search starts -------------------------------------------------

    def _starting_point(
        self,
        guess: Guess | Solution | None,
        limits: Box,
        table: Table,
        changes: Overrides,
        arcs_given: Sequence[FloatArray | None] | None,
    ) -> FloatArray:
        point = np.zeros(self.discretisation.layout.size)
        given = Guess()
        if isinstance(guess, Guess):
            given = guess
        elif isinstance(guess, Solution):
            given = Guess(statics=guess.statics)
        time = 0.0
        for p, phase in enumerate(self.problem.phases):
            place, mesh = self.discretisation.layout.phases[p], self.mesh.phases[p]
            curves: Mapping[str, guesses.Curve] = {}
            arcs = None
            if isinstance(guess, Solution):
                former = guess.phases[p]
                curves, duration = curves_of(former), former.duration
                begin = former.start
                if former.mesh.arcs == mesh.arcs:
                    arcs = former.arc_durations
            else:
                begin = given.starts.get(phase.name, time)
                duration = given.durations.get(phase.name, 0.0)
                if duration <= 0.0:
                    duration = self._default_duration(p, phase, table, changes)
            low, high = limits.lower[place.start], limits.upper[place.start]
            point[place.start] = min(max(begin, low), high)
            if arcs_given is not None and arcs_given[p] is not None:
                arcs = arcs_given[p]
            if arcs is None:
                if mesh.arc_count == 1:
                    arcs = np.array([duration])
                    number = place.durations
                    arcs = np.clip(arcs, limits.lower[number], limits.upper[number])
                else:
                    arcs = np.full(mesh.arc_count, duration / mesh.arc_count)
            point[place.durations] = arcs
            self._place_curves(p, given, curves, arcs, limits, point)
            time = float(point[place.start] + arcs.sum())
        for number, static in zip(
            self.discretisation.layout.statics, self.problem.statics, strict=True
        ):
            low, high = limits.lower[number], limits.upper[number]
            value = given.statics.get(static.name, _middle(low, high))
            point[number] = min(max(value, low), high)
        return point

    def _default_duration(
        self, index: int, phase: Phase, table: Table, changes: Overrides
    ) -> float:
        low, high = table["duration", phase.name]
        if phase.name in changes.durations:
            new = changes.durations[phase.name]
            low, high = new if isinstance(new, tuple) else (new, new)
        if low == high:
            return float(low)
        return float(np.clip(self.scales.durations[index], low, high))

    def _place_curves(
        self,
        index: int,
        given: Guess,
        curves: Mapping[str, guesses.Curve],
        arcs: FloatArray,
        limits: Box,
        point: FloatArray,
    ) -> None:
        phase, mesh = self.problem.phases[index], self.mesh.phases[index]
        place = self.discretisation.layout.phases[index]
        breaks = np.concatenate([[0.0], np.cumsum(mesh.widths(arcs))])
        breaks = breaks / breaks[-1]

        def find(name: str) -> guesses.Curve | None:
            if name in curves:
                return curves[name]
            return given.curves.get(f"{phase.name}.{name}", given.curves.get(name))

        rows = [(name, place.state_row(i)) for i, name in enumerate(phase.states)]
        states = len(rows)
        rows += [(name, place.control_row(j)) for j, name in enumerate(phase.controls)]
        for number, (name, row) in enumerate(rows):
            curve = find(name)
            if curve is None and number < states:
                curve = _between(limits, row[0][0], row[-1][-1])
            for k, coefficients in enumerate(row):
                lower, upper = limits.lower[coefficients], limits.upper[coefficients]
                if curve is None:
                    point[coefficients] = [
                        _middle(a, b) for a, b in zip(lower, upper, strict=True)
                    ]
                    continue
                degree = coefficients.size - 1
                s = (
                    fitting_points(degree)
                    if number < states
                    else tuple(float(v) for v in collocation("gauss", degree + 1)[0])
                )
                fraction = breaks[k] + np.array(s) * (breaks[k + 1] - breaks[k])
                fitted = bernstein_basis_inverse(degree, s) @ sample(curve, fraction)
                point[coefficients] = np.clip(fitted, lower, upper)

    # --- what comes out ----------------------------------------------------------

    def _worst(self, point: Multipliers, limits: Box, vector: FloatArray) -> str:
        """Sentence on the constraint violated most, and where."""
        built = self.discretisation
        _, rows = built.program.values(point.unknowns, vector)
        value = np.asarray(rows).ravel()
        low = limits.row_lower / built.row_scale
        high = limits.row_upper / built.row_scale
        violation = np.maximum(np.maximum(low - value, value - high), 0.0)
        if not np.all(np.isfinite(value)):
            violation = np.where(np.isfinite(value), violation, np.inf)
        if value.size == 0 or violation.max() <= 10.0 * self.options.tolerance:
            return "All constraints are kept; the objective is not yet least."
        worst = int(np.argmax(violation))
        group = next(g for g in built.groups if g.rows[0] <= worst <= g.rows[-1])
        at = worst - int(group.rows[0])
        phase = self.problem.phases[group.phase]
        amount = violation[worst] * built.row_scale[worst]
        where = f"in phase {phase.name!r}"
        if group.interval[at] >= 0:
            place = built.layout.phases[group.phase]
            unknowns = point.unknowns * built.unknown_scale
            widths = self.mesh.phases[group.phase].widths(unknowns[place.durations])
            k = int(group.interval[at])
            time = (
                unknowns[place.start] + widths[:k].sum() + group.place[at] * widths[k]
            )
            where += f" at t = {time:.6g}"
        return (
            f"Violated most: {group.kind} of {group.name!r} {where}, by {amount:.3g}."
        )

    def _solution(
        self,
        result: Result,
        message: str,
        multipliers: Multipliers,
        limits: Box,
        iterations: int,
        objective: float,
        parameters: dict[str, float],
    ) -> Solution:
        built = self.discretisation
        unknowns = multipliers.unknowns * built.unknown_scale
        # The solver keeps bounds to its tolerance only; the answer keeps them.
        unknowns = np.clip(unknowns, limits.lower, limits.upper)
        phases = tuple(
            self._phase_solution(p, phase, unknowns, multipliers, limits)
            for p, phase in enumerate(self.problem.phases)
        )
        statics = {
            static.name: float(unknowns[number])
            for static, number in zip(
                self.problem.statics, built.layout.statics, strict=True
            )
        }
        return Solution(
            result,
            message,
            -objective if self.problem.maximises else objective,
            phases,
            statics,
            multipliers,
            iterations,
            self.mesh,
            parameters,
        )

    def _phase_solution(
        self,
        index: int,
        phase: Phase,
        unknowns: FloatArray,
        multipliers: Multipliers,
        limits: Box,
    ) -> PhaseSolution:
        built = self.discretisation
        place, mesh = built.layout.phases[index], self.mesh.phases[index]
        arcs = unknowns[place.durations]
        widths = mesh.widths(arcs)
        # A phase of no duration still needs increasing breaks.
        widths = np.maximum(widths, 1e-12 * max(float(widths.sum()), 1e-6))
        begin = unknowns[place.start]
        breaks = begin + np.concatenate([[0.0], np.cumsum(widths)])
        states = _join([unknowns[t] for t in place.states], breaks)
        controls = _join(
            [_same_degree([unknowns[c] for c in tables]) for tables in place.controls],
            breaks,
        )
        times, costates, pressures = self._costates(
            index, mesh, begin, widths, multipliers
        )
        return PhaseSolution(
            phase.name,
            mesh,
            arcs,
            tuple(phase.states),
            tuple(phase.controls),
            states,
            controls,
            times,
            costates,
            self.scheme,
            pressures,
            self._bound_gaps(index, unknowns, limits, multipliers),
        )

    def _bound_gaps(
        self,
        index: int,
        unknowns: FloatArray,
        limits: Box,
        multipliers: Multipliers,
    ) -> FloatArray:
        """Multipliers of the states' bounds times the distance that is left.

        A Bernstein coefficient at its bound leaves the polynomial a little off it;
        multiplier times that distance is what the objective could still gain.
        """
        place, mesh = self.discretisation.layout.phases[index], self.mesh.phases[index]
        pull = multipliers.of_bounds / self.discretisation.unknown_scale
        pull = pull * self.scales.objective
        rows = []
        for k in range(mesh.intervals):
            table, n = place.states[k], mesh.points[k]
            s = tuple(float(v) for v in np.arange(n + 1) / n)
            value = bernstein_values(n, s) @ unknowns[table]
            # A positive multiplier belongs to the upper bound, a negative one to the
            # lower; borders count half for each of their intervals.
            bound = np.where(
                pull[table] > 0.0, limits.upper[table], limits.lower[table]
            )
            with np.errstate(invalid="ignore"):
                loss = np.abs(pull[table] * (bound - value))
            loss[~np.isfinite(loss)] = 0.0
            rows.append(loss[1:-1].sum(axis=0))
        return np.stack(rows)

    def _costates(
        self,
        index: int,
        mesh: PhaseMesh,
        begin: float,
        widths: FloatArray,
        multipliers: Multipliers,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times of the points, costates and path multipliers there.

        The multipliers of the defects over the quadrature weights are costates, those
        of the path constraints over weight and width are densities in time.
        """
        nodes = [collocation(self.scheme, n) for n in mesh.points]
        ends = begin + np.cumsum(widths)
        times = np.concatenate(
            [
                end - h + h * s
                for end, h, (s, _) in zip(ends, widths, nodes, strict=True)
            ]
        )
        weights = np.concatenate([w for _, w in nodes])
        spans = np.repeat(np.maximum(widths, 1e-300), mesh.points) * weights
        costates, pressures = [np.zeros((times.size, 0))], [np.zeros((times.size, 0))]
        seen: list[str] = []
        first = np.concatenate([[0], np.cumsum(mesh.points)])
        for group in self.discretisation.groups:
            if group.phase != index or group.kind not in {"dynamics", "path"}:
                continue
            force = multipliers.of_constraints[group.rows] / group.scale
            force = (force * self.scales.objective)[:, None]
            if group.kind == "dynamics":
                costates.append(-force / weights[:, None])
            elif group.name not in seen:
                seen.append(group.name)
                pressures.append(force / spans[:, None])
            else:
                # A single point between the nodes acts on the polynomials as these
                # multipliers at the nodes do.
                at = 1 + seen.index(group.name)
                for k, s, weight in zip(
                    group.interval, group.place, force[:, 0], strict=True
                ):
                    n = mesh.points[k]
                    nodal = slice(first[k], first[k] + n)
                    share = np.linalg.solve(
                        bernstein_values(n - 1, tuple(map(float, nodes[k][0]))).T,
                        bernstein_values(n - 1, (float(s),))[0],
                    )
                    pressures[at][nodal, 0] += weight * share / spans[nodal]
        return times, np.hstack(costates), np.hstack(pressures)


def _middle(lower: float, upper: float) -> float:
    if np.isfinite(lower) and np.isfinite(upper):
        return 0.5 * (lower + upper)
    return float(np.clip(0.0, lower, upper))


def _between(limits: Box, first: int, last: int) -> guesses.Curve:
    """Straight line from the start value to the end value, where they are known."""
    ends = []
    for number in (first, last):
        low, high = limits.lower[number], limits.upper[number]
        ends.append(low if low == high else None)
    start, end = ends
    if start is None and end is None:
        start = end = _middle(limits.lower[first], limits.upper[first])
    start = end if start is None else start
    end = start if end is None else end
    return np.array([start, end], dtype=np.float64)


def _same_degree(rows: list[FloatArray]) -> FloatArray:
    """Stack coefficient vectors of several controls, elevated to one degree."""
    if not rows:
        return np.zeros((1, 0))
    degree = max(row.size for row in rows) - 1
    columns = []
    for row in rows:
        s = fitting_points(degree)
        values = bernstein_values(row.size - 1, s) @ row
        columns.append(
            row
            if row.size == degree + 1
            else bernstein_basis_inverse(degree, s) @ values
        )
    return np.stack(columns, axis=-1)


def _join(tables: list[FloatArray], breaks: FloatArray) -> PiecewisePolynomial:
    """One piecewise polynomial from tables (degree + 1, components)."""
    degree = max(table.shape[0] for table in tables) - 1
    unit = np.array([0.0, 1.0])
    raised = [
        PiecewisePolynomial(unit, table[None]).elevated(degree).coefficients[0]
        for table in tables
    ]
    return PiecewisePolynomial(breaks, np.stack(raised))
