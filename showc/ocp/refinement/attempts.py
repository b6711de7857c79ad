"""One nonlinear program after another for the same problem, on mesh after mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit.optimality import objective_size, ranges
from showc.ocp.refinement.options import CHEAP, EFFORT, Options
from showc.ocp.refinement.proposal import with_ends
from showc.ocp.solution import Solution
from showc.ocp.transcription.collocation.statement import Statement
from showc.ocp.transcription.collocation.transcription import Transcription

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from showc.arrays import FloatArray
    from showc.ocp.guess import Guess
    from showc.ocp.mesh import Mesh
    from showc.ocp.problem import Problem
    from showc.ocp.refinement.judgement import Judgement
    from showc.ocp.refinement.switches import Structure
    from showc.ocp.transcription.collocation.limits import Overrides
    from showc.ocp.transcription.collocation.statement import Table
    from showc.ocp.transcription.solver import SolverOptions

_STEP = 1e-4
"""Step of a parameter over its size: what a central difference errs by, its square,
is as small as the solver's tolerance."""


class Attempts:
    """Solves one problem on any mesh, and remembers scales and the last program.

    Parameters
    ----------
    problem, options, parameters, overrides
        As :func:`showc.ocp.solve` takes them.
    """

    def __init__(
        self,
        problem: Problem,
        options: Options,
        parameters: Mapping[str, float],
        overrides: Overrides,
    ) -> None:
        self.problem, self.options = problem, options
        self.parameters, self.overrides = parameters, overrides
        self.scales = dict(options.scales)
        self.table = self._table()
        """Bounds as numbers."""
        self.iterations = 0
        """Of all programs so far."""
        self.effort = 0.0
        """Unknowns times iterations of all programs so far that are not cheap."""
        self.latest: Transcription | None = None
        """The transcription solved last."""
        self._ends: dict[tuple[int, str, int], bool] = {}
        self.former: Transcription | None = None
        """The transcription of the solution that the next mesh starts from."""

    def _table(self) -> Table:
        """Bounds as numbers, with the scales known so far."""
        statement = Statement(self.problem, self.scales)
        table = statement.table(statement.parameters(self.parameters))
        return self.overrides.in_place(table, self.problem)

    def attempt(
        self,
        mesh: Mesh,
        guess: Guess | Solution | None,
        *,
        arcs: Sequence[FloatArray] | None = None,
        structures: Sequence[Structure | None] | None = None,
        solver: SolverOptions | None = None,
    ) -> Solution:
        """Solve on one mesh."""
        mesh = with_ends(self.problem, mesh)
        transcription = Transcription(
            self.problem,
            mesh,
            scheme=self.options.scheme,
            scales=self.scales,
            options=self._limited(solver or self.options.solver, mesh),
            couplings=self.options.couplings,
            ends=self._ends,
        )
        solution = transcription.solve(
            parameters=self.parameters,
            overrides=self._fixed_at_bounds(mesh, structures, self.table),
            guess=guess,
            arcs=arcs,
            former=self.former if isinstance(guess, Solution) else None,
        )
        self.iterations += solution.iterations
        unknowns = self.unknowns(mesh)
        self.effort += solution.iterations * unknowns if unknowns > CHEAP else 0.0
        self.latest = transcription
        return solution

    def sensitivities(self, judgement: Judgement) -> dict[str, float]:
        """Differentiate the optimum by each parameter, by central differences."""
        solution, transcription = judgement.solution, judgement.program
        if transcription is None or not self.problem.parameters:
            return {}
        structures = judgement.structures
        statement = Statement(self.problem)
        values = statement.parameters(self.parameters)
        sign = -1.0 if self.problem.maximises else 1.0
        slopes: dict[str, float] = {}
        for number, name in enumerate(statement.names):
            step = _STEP * max(abs(values[number]), _STEP)
            sides = []
            for way in (-1.0, 1.0):
                moved = values.copy()
                moved[number] += way * step
                table = self.overrides.in_place(statement.table(moved), self.problem)
                held = self._fixed_at_bounds(solution.mesh, structures, table)
                sides.append(
                    transcription.lagrangian(solution.multipliers, moved, held)
                )
            slopes[name] = sign * (sides[1] - sides[0]) / (2.0 * step)
        return slopes

    def _limited(self, solver: SolverOptions, mesh: Mesh) -> SolverOptions:
        """Fewer iterations for a large program: a good start needs few."""
        if self.options.grading:
            return solver
        least = max(100, int(EFFORT / self.unknowns(mesh)))
        return replace(solver, iterations=min(solver.iterations, least))

    def unknowns(self, mesh: Mesh) -> int:
        """About how many unknowns a program on ``mesh`` has."""
        return sum(
            part.point_count * (len(phase.states) + len(phase.controls))
            for part, phase in zip(mesh.phases, self.problem.phases, strict=True)
        )

    def _fixed_at_bounds(
        self,
        mesh: Mesh,
        structures: Sequence[Structure | None] | None,
        table: Table,
    ) -> Overrides:
        """Hold controls at their bounds on the arcs found so.

        Where such a control keeps a state at that state's bound, holding it would leave
        the bound's multiplier undetermined, and the costate with it: there it is
        bounded only, and its own multiplier has the sign that it should.
        """
        bounds = dict(self.overrides.bounds)
        for i, phase in enumerate(self.problem.phases):
            structure = structures[i] if structures else None
            if structure is None:
                continue
            arcs = np.array(mesh.phases[i].arcs)
            for j, name in enumerate(phase.controls):
                kinds = np.where(structure.fixed, structure.classes, 0)[arcs, j]
                low, high = table["bounds", phase.name, name]
                bounds.pop(name, None)
                bounds[f"{phase.name}.{name}"] = (
                    np.where(kinds == 1, high, low),
                    np.where(kinds == -1, low, high),
                )
        return replace(self.overrides, bounds=bounds)

    def rescale(self, solution: Solution) -> None:
        """Take scales that bounds do not tell from a first trajectory."""
        for phase, part in zip(self.problem.phases, solution.phases, strict=True):
            span = ranges(part.states)
            for i, (name, state) in enumerate(phase.states.items()):
                key = f"{phase.name}.{name}"
                bounds = self.table["bounds", phase.name, name]
                told = np.all(np.isfinite(bounds)) or state.quantity.scale is not None
                if not told and name not in self.options.scales:
                    self.scales[key] = float(span[i])
            size_of = np.abs(part.controls.coefficients).max(axis=(0, 1), initial=0.0)
            for j, (name, control) in enumerate(phase.controls.items()):
                bounds = self.table["bounds", phase.name, name]
                told = np.all(np.isfinite(bounds)) or control.quantity.scale is not None
                if not told and name not in self.options.scales and size_of[j] > 0.0:
                    self.scales[f"{phase.name}.{name}"] = float(size_of[j])
            key = f"{phase.name}.duration"
            if key not in self.options.scales:
                self.scales[key] = max(part.duration, 1e-12)
        self.table = self._table()
        self.weigh(solution)

    def weigh(self, solution: Solution) -> float:
        """Take the objective's scale from a solution.

        Returns
        -------
        float
            What it was divided by when that was found, over this scale: this many times
            looser was the solver's tolerance.
        """
        size = objective_size(solution)
        if "objective" not in self.options.scales:
            self.scales["objective"] = size
        return solution.multipliers.objective_scale / size
