"""A problem on a mesh, built once and solved many times.

Between solves, parameters, bounds, end values, durations, half-spaces and the first
guess may change; only the mesh and the expressions are fixed.
"""

from __future__ import annotations

from contextlib import ExitStack, redirect_stderr
from dataclasses import replace
from io import StringIO
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.ocp import scaling
from showc.ocp.outcome import Result
from showc.ocp.solution import Multipliers, Solution
from showc.ocp.transcription.collocation.limits import Overrides, box, parameter_vector
from showc.ocp.transcription.collocation.readout import phase_solution, worst_violation
from showc.ocp.transcription.collocation.rows import discretise
from showc.ocp.transcription.collocation.start import starting_point
from showc.ocp.transcription.collocation.statement import Statement
from showc.ocp.transcription.collocation.warmstart import transfer
from showc.ocp.transcription.solver import (
    SolverOptions,
    make_solver,
    result_of,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from showc.arrays import BoolArray, FloatArray, IntArray
    from showc.ocp.coupling import Imposed
    from showc.ocp.guess import Guess
    from showc.ocp.mesh import Mesh
    from showc.ocp.nodes import Scheme
    from showc.ocp.problem import Problem
    from showc.ocp.transcription.collocation.limits import Box


def _slack(given: Mapping[str, FloatArray], answer: Mapping[str, Any]) -> float:
    """Sum of multipliers times distances to what they belong to, scaled."""
    total = 0.0
    for values, low, high, force in (
        ("x", "lbx", "ubx", "lam_x"),
        ("g", "lbg", "ubg", "lam_g"),
    ):
        at, pull = (np.asarray(answer[name]).ravel() for name in (values, force))
        # A positive multiplier belongs to the upper bound, a negative one to the lower.
        gap = np.abs(np.where(pull > 0.0, given[high], given[low]) - at)
        total += float(np.abs(pull[np.isfinite(gap)]) @ gap[np.isfinite(gap)])
    return total if np.isfinite(total) else 0.0


UNLIMITED = 1e6
"""Size, over their scales, of an objective and an unknown that grow without limit."""
SHARE = 0.1
"""Share of the change found that the objective is divided by. Its slopes are then some
tens at the start, as IPOPT's own scaling has them, and the search goes by the objective
from the first step; measured to end in fewer wrong places than with 1."""
RELAXED = 1e-8
"""What bounds are relaxed by, over the greater of themselves and their quantities'
scales: an arc on which one is kept with equality would else have no inside."""
_JUMP = 1e-3
"""Change of a row over its scale, on the way out through a relaxed bound, from which on
the model ends at that bound."""
_MILLIONTH = 1e-6
"""Share of a state's range that is the usual tolerance of states."""


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
    couplings
        Couplings of the problem that are imposed, and where; by default none.
    ends
        For the lower (0) and upper (1) bounds of states and controls, by number of the
        phase and name: whether the model ends there. What is missing is looked up and
        added, so that transcriptions of one problem may share it.

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
        couplings: Sequence[Imposed] = (),
        ends: dict[tuple[int, str, int], bool] | None = None,
    ) -> None:
        self.problem, self.mesh, self.scheme = problem, mesh, scheme
        self.options = options or SolverOptions()
        self._statement = Statement(problem, scales)
        self.scales = self._statement.scales(scales or {})
        self.discretisation = discretise(problem, mesh, scheme, self.scales, couplings)
        self._solvers: dict[bool, Any] = {}
        self._ends = {} if ends is None else ends

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
        start = starting_point(
            self, guess, limits, table=table, changes=changes, arcs=arcs
        )
        built = self.discretisation
        vector = parameter_vector(built, values, changes, built.program.parameters)
        self._guess_integrals(start, vector)
        unit = self._objective_scale(start / built.unknown_scale, limits, vector, warm)
        vector[-1] = 1.0 / unit
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
                point, np.zeros(point.size), np.zeros(built.row_scale.size), unit
            )
            message = f"{result.value} {message}."
            return self._solution(result, message, nothing, limits, given)
        if former is not None and isinstance(guess, Solution):
            warm = transfer(former, guess, self, scaled["x0"], unit)
        if warm is not None:
            scaled |= {
                "x0": warm.unknowns,
                "lam_x0": warm.of_bounds,
                "lam_g0": warm.of_constraints,
            }
        solver = self._solver(warm=warm is not None)
        free = np.count_nonzero(scaled["lbx"] < scaled["ubx"])
        equations = np.count_nonzero(scaled["lbg"] == scaled["ubg"])
        with ExitStack() as held:
            if equations > free:
                # More equations than unknowns may agree: CasADi only warns, for itself.
                held.enter_context(redirect_stderr(StringIO()))
            answer = solver(**scaled | self._relaxed(scaled))
        statistics = solver.stats()
        result = result_of(statistics["return_status"])
        multipliers = Multipliers(
            np.asarray(answer["x"]).ravel(),
            np.asarray(answer["lam_x"]).ravel(),
            np.asarray(answer["lam_g"]).ravel(),
            unit,
        )
        growing = None if result.usable else self._growing(multipliers, limits, vector)
        message = result.value
        if growing is not None:
            result = Result.UNBOUNDED
            message = f"{result.value} {growing}"
        elif result is Result.INVALID_NUMBER and (lost := self._undefined(scaled)):
            message = f"{message} {lost}"
        elif not result.usable:
            message = f"{message} {worst_violation(self, multipliers, limits, vector)}"
        solution = self._solution(result, message, multipliers, limits, given)
        objective = float(answer["f"]) * unit
        return replace(
            solution,
            objective=-objective if self.problem.maximises else objective,
            slack=unit * _slack(scaled, answer),
            blur=unit * self._blur(solution, vector),
            iterations=int(statistics["iter_count"]),
        )

    def _blur(self, solution: Solution, vector: FloatArray) -> float:
        """Change of the scaled objective by a millionth of every state's range."""
        built, point = self.discretisation, solution.multipliers.unknowns
        moved = point.copy()
        for part, place in zip(solution.phases, built.layout.phases, strict=True):
            low, high = part.states.bounds()
            for table in place.states:
                moved[table] = point[table] + (
                    _MILLIONTH * (high - low) / built.unknown_scale[table]
                )
        before, after = (built.program.values(x, vector)[0] for x in (point, moved))
        change = abs(float(after) - float(before))
        return change if np.isfinite(change) else 0.0

    def lagrangian(
        self, point: Multipliers, parameters: FloatArray, overrides: Overrides
    ) -> float:
        """Return the minimised objective plus multipliers times violations.

        Parameters
        ----------
        point
            A primal-dual point of this program.
        parameters
            Values of the problem's parameters, in order.
        overrides
            As :meth:`solve` takes them.

        Returns
        -------
        float
            In the unit of the objective. Its derivative by a parameter, all else kept,
            is that of the optimum (Fiacco 1983, theorem 3.4.1).
        """
        built, unit = self.discretisation, point.objective_scale
        table = self._statement.table(parameters)
        limits = box(self.problem, self.mesh, built, table, overrides)
        vector = parameter_vector(
            built, parameters, overrides, built.program.parameters
        )
        vector[-1] = 1.0 / unit
        objective, rows = built.program.values(point.unknowns, vector)
        total = float(objective)
        for value, force, low, high, scale in (
            (
                point.unknowns,
                point.of_bounds,
                limits.lower,
                limits.upper,
                built.unknown_scale,
            ),
            (
                np.asarray(rows).ravel(),
                point.of_constraints,
                limits.row_lower,
                limits.row_upper,
                built.row_scale,
            ),
        ):
            away = value - np.where(force > 0.0, high, low) / scale
            held = np.isfinite(away)
            total += float(force[held] @ away[held])
        return unit * total

    def _guess_integrals(self, point: FloatArray, vector: FloatArray) -> None:
        """Start integrals from their values along the guess, not from zero."""
        built = self.discretisation
        if not any(table.size for table in built.layout.integrals):
            return
        _, rows = built.program.values(point / built.unknown_scale, vector)
        value = np.nan_to_num(np.asarray(rows).ravel())
        for group in built.groups:
            if group.kind == "integral":
                number = int(group.name.split()[-1])
                unknown = built.layout.integrals[group.phase][number]
                # Roots and logarithms of an integral do not start at zero.
                point[unknown] = -value[group.rows[0]] or 1.0

    def _objective_scale(
        self,
        point: FloatArray,
        limits: Box,
        vector: FloatArray,
        warm: Multipliers | None,
    ) -> float:
        """Return the scale of the objective, in which the solver's tolerance is meant.

        The scale given, or that of the multipliers to start with; else by how much the
        objective would change if every unknown moved by its scale, as the slopes at the
        start and at places around it tell (the start alone may be flat).
        """
        if self.scales.objective is not None:
            return self.scales.objective
        if warm is not None:
            return warm.objective_scale
        built = self.discretisation
        low = limits.lower / built.unknown_scale
        high = limits.upper / built.unknown_scale
        plain = vector.copy()
        plain[-1] = 1.0
        sizes = []
        for number, aside in enumerate(scaling.places(point.size)):
            place = np.clip(point + (number > 0) * aside, low, high)
            slopes = built.program.objective_gradient(place, plain)[1]
            size = float(np.abs(np.asarray(slopes)).sum())
            if np.isfinite(size) and size > 0.0:
                sizes.append(size)
        return float(SHARE * np.median(sizes)) if sizes else 1.0

    def _relaxed(self, scaled: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Bounds of unknowns and rows that are a little wider, where they may be."""
        ends = self._model_ends(scaled)
        relaxed = {}
        for low, high, hard in (("lbx", "ubx", ends), ("lbg", "ubg", None)):
            free = scaled[low] < scaled[high]
            for name, side in ((low, 0), (high, 1)):
                bound = scaled[name]
                may = free & np.isfinite(bound)
                if hard is not None:
                    may &= ~hard[side]
                width = RELAXED * np.maximum(1.0, np.abs(bound))
                away = -width if side == 0 else width
                relaxed[name] = bound + np.where(may, away, 0.0)
        return relaxed

    def _model_ends(self, scaled: Mapping[str, FloatArray]) -> BoolArray:
        """Mark lower and upper bounds, (2, n), beyond which the model has no values.

        A table ends there, or a root: the rows jump, or are not numbers.
        """
        ends = np.zeros((2, scaled["x0"].size), dtype=bool)
        free = scaled["lbx"] < scaled["ubx"]
        for index, name, table in self._members():
            members = np.concatenate([np.ravel(part) for part in table])
            for side, limit in enumerate(("lbx", "ubx")):
                bound = scaled[limit][members]
                chosen = members[np.isfinite(bound) & free[members]]
                if not chosen.size:
                    continue
                key = index, name, side
                if key not in self._ends:
                    self._ends[key] = self._ends_at(scaled, chosen, side)
                ends[side][chosen] = self._ends[key]
        return ends

    def _members(self) -> Iterator[tuple[int, str, list[Any]]]:
        """Yield phase, name and unknowns of every state and control."""
        both = zip(self.problem.phases, self.discretisation.layout.phases, strict=True)
        for index, (phase, place) in enumerate(both):
            for i, name in enumerate(phase.states):
                yield index, name, place.state_row(i)
            for j, name in enumerate(phase.controls):
                yield index, name, place.control_row(j)

    def _ends_at(
        self, scaled: Mapping[str, FloatArray], chosen: IntArray, side: int
    ) -> bool:
        """Whether the model ends at the bounds of the ``chosen`` unknowns."""
        at, beyond = scaled["x0"].copy(), scaled["x0"].copy()
        at[chosen] = scaled["ubx" if side else "lbx"][chosen]
        width = RELAXED * np.maximum(1.0, np.abs(at[chosen]))
        beyond[chosen] = at[chosen] + (width if side else -width)
        rows = [
            np.asarray(self.discretisation.program.values(point, scaled["p"])[1])
            for point in (at, beyond)
        ]
        with np.errstate(invalid="ignore"):
            jump = np.abs(rows[1] - rows[0])
            same = jump <= _JUMP * (1.0 + np.abs(rows[0]))
        return not bool(np.all(same))

    def _growing(
        self, found: Multipliers, limits: Box, vector: FloatArray
    ) -> str | None:
        """Name the unbounded quantity with which an objective grows, if one does."""
        built = self.discretisation
        value = float(built.program.values(found.unknowns, vector)[0])
        free = ~(np.isfinite(limits.lower) & np.isfinite(limits.upper))
        size = np.where(free, np.abs(found.unknowns), 0.0)
        if not (value < -UNLIMITED or np.isnan(value)) or size.max() < UNLIMITED:
            return None
        worst = int(np.argmax(size))
        reached = f"reaches {found.unknowns[worst] * built.unknown_scale[worst]:.3g}"
        return f"{self._owner(worst) or 'A static'} {reached}; bound it."

    def _undefined(self, scaled: Mapping[str, FloatArray]) -> str | None:
        """Name what has no value, or no slope, where the search starts."""
        built, start, given = self.discretisation, scaled["x0"], scaled["p"]
        rows, slopes = built.program.constraint_jacobian(start, given)
        curved = built.program.lagrangian_hessian(
            start, given, 1.0, np.ones(rows.size1())
        )
        where = "where the search starts: give a guess elsewhere, or bounds"
        for what, found, of_row in (
            ("value", rows, True),
            ("slope", slopes, True),
            ("curvature", curved, False),
        ):
            entries = np.asarray(found.nonzeros(), dtype=np.float64)
            lost = np.flatnonzero(~np.isfinite(entries))
            if not lost.size:
                continue
            row, column = (np.array(i)[lost] for i in found.sparsity().get_triplet())
            # Of curvatures those by one quantity alone say most.
            at = int(row[int(np.argmax(row == column)) if not of_row else 0])
            if of_row:
                group = next(g for g in built.groups if at in g.rows)
                phase = self.problem.phases[group.phase].name
                name = f"The {group.kind} of {group.name!r} in phase {phase!r}"
                return f"{name} has no {what} {where}."
            name = self._owner(at) or "a static"
            return f"Something has no {what} with respect to {name} {where}."
        return None

    def _owner(self, unknown: int) -> str | None:
        """Name of the quantity and phase that an unknown belongs to; statics: none."""
        phases = enumerate(self.discretisation.layout.phases)
        times = [(p, "duration", [place.durations]) for p, place in phases]
        for p, name, tables in [*self._members(), *times]:
            if any(unknown in table for table in tables):
                return f"{name!r} of phase {self.problem.phases[p].name!r}"
        return None

    def _solver(self, *, warm: bool) -> Any:  # noqa: ANN401
        if warm not in self._solvers:
            self._solvers[warm] = make_solver(
                self.discretisation.program, self.options, warm=warm
            )
        return self._solvers[warm]

    def _solution(
        self,
        result: Result,
        message: str,
        multipliers: Multipliers,
        limits: Box,
        parameters: dict[str, float],
    ) -> Solution:
        """Read a point of the program; its objective is not yet known."""
        built = self.discretisation
        unknowns = multipliers.unknowns * built.unknown_scale
        # The solver keeps bounds to its tolerance only; the answer keeps them.
        unknowns = np.clip(unknowns, limits.lower, limits.upper)
        values = np.array(list(parameters.values()), dtype=np.float64)
        phases = tuple(
            phase_solution(self, p, unknowns, multipliers, values)
            for p in range(len(self.problem.phases))
        )
        numbers = zip(self.problem.statics, built.layout.statics, strict=True)
        statics = {static.name: float(unknowns[number]) for static, number in numbers}
        return Solution(
            result,
            message,
            float("nan"),
            phases,
            statics,
            multipliers,
            0,
            self.mesh,
            parameters,
        )
