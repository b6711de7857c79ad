"""Solve a problem to a tolerance: mesh, audit, refine, place switches, repeat."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit import PhaseAudit, PhaseAuditor, ranges
from showc.ocp.guess import Guess
from showc.ocp.limits import Overrides, Statement
from showc.ocp.mesh import Mesh, PhaseMesh
from showc.ocp.refine import Rule, arc_mesh, refine
from showc.ocp.solution import ErrorEstimate, MeshRecord, Result, Solution
from showc.ocp.solver import SolverOptions
from showc.ocp.switches import Structure, detect
from showc.ocp.transcription import Transcription

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from showc.ocp.nodes import Scheme
    from showc.ocp.problem import Problem
    from showc.ocp.solution import PhaseSolution

    FloatArray = NDArray[np.float64]

import os

FIRST = int(os.environ.get("FIRST", "3"))
BOUNDARY = 0.6
LITTLE = 3e-4
CAUTION = 0.25
INNER = int(os.environ.get("INNER", "3"))


@dataclass(frozen=True, slots=True)
class Options:
    """How a problem is solved; the defaults are meant for every problem."""

    tolerance: float = 1e-6
    """Wanted relative error: of every state between the nodes over its range, of
    every path constraint over its scale, of the objective."""
    mesh: Mesh | None = None
    """First mesh; by default ten intervals of four points in each phase."""
    meshes: int = 14
    """Greatest number of meshes."""
    points: int = 1500
    """Greatest number of collocation points; refinement stops there."""
    scheme: Scheme = "gauss"
    """Collocation points."""
    rule: Rule = "decay"
    """How an interval is refined; see :mod:`showc.ocp.refine`."""
    switches: bool = True
    """Whether switch times may become unknowns."""
    scales: Mapping[str, float] = field(default_factory=dict)
    """Typical magnitudes by name, where bounds do not tell them."""
    solver: SolverOptions = field(default_factory=SolverOptions)
    """How each nonlinear program is solved."""
    progress: Callable[[MeshRecord], None] | None = None
    """Called after each mesh."""


@dataclass(slots=True)
class _Pass:
    """One solved and audited mesh."""

    solution: Solution
    audits: list[PhaseAudit]
    error: ErrorEstimate
    indicators: list[FloatArray]
    """Error over tolerance of each interval, phase by phase."""
    structures: list[Structure | None]
    """The arcs the mesh was made for, phase by phase."""
    moved: float
    """Relative change of the objective since the mesh before; 0 for a first one."""


class _Refinement:
    """The state of one adaptive solve."""

    def __init__(
        self,
        problem: Problem,
        options: Options,
        parameters: Mapping[str, float],
        overrides: Overrides,
    ) -> None:
        self.problem, self.options = problem, options
        self.parameters, self.overrides = parameters, overrides
        self.statement = Statement(problem)
        table = self.statement.table(self.statement.parameters(parameters))
        self.table = table.with_bounds(problem, overrides)
        self.auditors = [
            PhaseAuditor(problem, phase, i) for i, phase in enumerate(problem.phases)
        ]
        self.scales = dict(options.scales)
        self.records: list[MeshRecord] = []
        self.iterations = 0
        self.latest: Transcription | None = None
        """The transcription solved last."""
        self.former: Transcription | None = None
        """The transcription of the solution that the next mesh starts from."""
        self.sign = -1.0 if problem.maximises else 1.0

    # --- one mesh ----------------------------------------------------------------

    def attempt(
        self,
        mesh: Mesh,
        guess: Guess | Solution | None,
        *,
        arcs: list[FloatArray | None] | None = None,
        structures: list[Structure | None] | None = None,
        solver: SolverOptions | None = None,
    ) -> Solution:
        """Solve on one mesh."""
        mesh = self._with_ends(mesh)
        transcription = Transcription(
            self.problem,
            mesh,
            scheme=self.options.scheme,
            scales=self.scales,
            options=solver or self._solver(warm=isinstance(guess, Solution)),
        )
        solution = transcription.solve(
            parameters=self.parameters,
            overrides=self._fixed_at_bounds(mesh, structures),
            guess=guess,
            arcs=arcs,
            former=self.former if isinstance(guess, Solution) else None,
        )
        self.iterations += solution.iterations
        self.latest = transcription
        return solution

    def _with_ends(self, mesh: Mesh) -> Mesh:
        """Path constraints hold at the ends of intervals, which Gauss points miss."""
        return Mesh(
            tuple(
                replace(
                    part,
                    path_points=tuple(
                        tuple(sorted({0.0, 1.0, *places}))
                        for places in part.path_points
                    ),
                )
                if phase.path_constraints
                else part
                for phase, part in zip(self.problem.phases, mesh.phases, strict=True)
            )
        )

    def _solver(self, *, warm: bool) -> SolverOptions:
        """Options that keep the solver near a good guess."""
        base = self.options.solver
        if not warm or base.solver != "ipopt":
            return base
        near = eval(os.environ.get("WARM", "{}"))
        return replace(base, extra={**near, **base.extra})

    def _fixed_at_bounds(
        self, mesh: Mesh, structures: list[Structure | None] | None
    ) -> Overrides:
        """Overrides that hold controls at their bounds on the arcs found so."""
        bounds = dict(self.overrides.bounds)
        for i, phase in enumerate(self.problem.phases):
            structure = structures[i] if structures else None
            if structure is None:
                continue
            arcs = np.array(mesh.phases[i].arcs)
            for j, name in enumerate(phase.controls):
                kinds = structure.classes[arcs, j]
                low, high = self.table["bounds", phase.name, name]
                bounds.pop(name, None)
                bounds[f"{phase.name}.{name}"] = (
                    np.where(kinds == 1, high, low),
                    np.where(kinds == -1, low, high),
                )
        return replace(self.overrides, bounds=bounds)

    def inner_degree(self, phase: int, control: int) -> int:
        """Degree of a control between its bounds; -1 for the points' own.

        A control that enters the Hamiltonian linearly is badly determined there: a
        high degree would only oscillate.
        """
        return INNER if self.auditors[phase].affine[control] else -1

    def plain_mesh(self, intervals: int, points: int) -> Mesh:
        """Equal intervals, with the controls' degrees chosen here."""
        phases = []
        for i, phase in enumerate(self.problem.phases):
            mesh = PhaseMesh.uniform(intervals, points)
            degrees = {
                name: (min(FIRST, points - 1),) * intervals
                for j, (name, control) in enumerate(phase.controls.items())
                if control.degree is None and self.auditors[i].affine[j]
            }
            phases.append(replace(mesh, control_degrees=degrees))
        return Mesh(tuple(phases))

    def first(self, guess: Guess | Solution | None) -> Solution:
        """Solve the first mesh, by other ways where the plain one fails."""
        mesh = self.options.mesh or self.plain_mesh(10, 4)
        solution = self.attempt(mesh, guess)
        if solution.result.usable or solution.result is Result.CONTRADICTION:
            return solution
        best = solution
        base = self.options.solver
        for other, strategy in (
            (mesh, {"mu_strategy": "monotone"}),
            (self.plain_mesh(20, 3), {"mu_strategy": "adaptive"}),
            (self.plain_mesh(30, 3), {"mu_strategy": "monotone"}),
            (self.plain_mesh(6, 6), {"mu_strategy": "adaptive"}),
        ):
            self.note(best, None, "the solver failed; another way is tried")
            extra = {**strategy, **base.extra}
            solver = replace(base, extra=extra, iterations=2 * base.iterations)
            solution = self.attempt(other, guess, solver=solver)
            if solution.result.usable:
                return solution
        return best

    def note(
        self, solution: Solution, error: ErrorEstimate | None, action: str
    ) -> None:
        """Write one line of the history."""
        record = MeshRecord(
            solution.mesh.interval_count,
            solution.mesh.point_count,
            solution.objective,
            solution.iterations,
            solution.result,
            error,
            action,
        )
        self.records.append(record)
        if self.options.progress is not None:
            self.options.progress(record)

    def judge(
        self,
        solution: Solution,
        former: _Pass | None,
        structures: list[Structure | None],
    ) -> _Pass:
        """Audit a solution and turn the errors into indicators.

        The dual-weighted estimate of the objective's error is an upper bound in
        practice; where the flagged intervals have just been refined and the
        objective hardly moved, twice the greater of the last two moves is the better
        estimate.
        """
        tolerance = self.options.tolerance
        audits = [a.audit(solution, self.table) for a in self.auditors]
        size = max(abs(solution.objective), 1e-3)
        lost = [
            a.objective_dynamics + a.objective_control + p.bound_gaps.sum(axis=1)
            for a, p in zip(audits, solution.phases, strict=True)
        ]
        total = sum(float(part.sum()) for part in lost) / size
        weight, move = 1.0, 0.0
        if former is not None:
            move = abs(solution.objective - former.solution.objective) / size
            moved = 2.0 * max(move, former.moved)
            cut = len(former.solution.mesh.phases) and all(
                new.intervals > old.intervals or not limited.any()
                for new, old, limited in zip(
                    solution.mesh.phases,
                    former.solution.mesh.phases,
                    (self._limited(i, former) for i in range(len(audits))),
                    strict=True,
                )
            )
            if moved < total and cut:
                weight = moved / total
        indicators = []
        for a, part in zip(audits, lost, strict=True):
            share = weight * part / size * len(part) / (2.0 * CAUTION)
            # Where a constraint is active all along, more points of it would only
            # contradict each other: a finer polynomial keeps it better.
            along = np.where(a.path_active > BOUNDARY, a.path, 0.0)
            worst = np.maximum(np.maximum(a.dynamics, share), along)
            indicators.append(worst / tolerance)
        top = max(float(part.max()) for part in indicators)
        if weight * total > CAUTION * tolerance and 0.0 < top <= 1.0:
            # Many small shares add up to too much: the greatest are the ones to mend.
            indicators = [1.5 * part / top for part in indicators]
        error = ErrorEstimate(
            max(float(a.dynamics.max()) for a in audits),
            0.0,
            max(float(a.path.max()) for a in audits),
            weight * total,
        )
        return _Pass(solution, audits, error, indicators, structures, move)

    def same(self, mesh: Mesh, other: Mesh) -> bool:
        """Whether both give the same program."""
        return self._with_ends(mesh) == self._with_ends(other)

    def take(
        self, proposal: _Proposal, current: _Pass, *, switching: bool
    ) -> _Pass | None:
        """Solve and judge a proposal; ``None`` if it is no step forward."""
        solution = self.attempt(
            proposal.mesh,
            current.solution,
            arcs=proposal.arcs,
            structures=proposal.structures,
        )
        if not solution.result.usable and not switching:
            self.note(solution, None, "the solver failed; it starts afresh")
            base = self.options.solver
            extra = {"mu_strategy": "monotone", **base.extra}
            self.former = None
            solution = self.attempt(
                proposal.mesh,
                current.solution,
                arcs=proposal.arcs,
                structures=proposal.structures,
                solver=replace(base, extra=extra, iterations=2 * base.iterations),
            )
        fresh = None
        if solution.result.usable and not self.worse(solution, current):
            former = None if switching else current
            fresh = self.judge(solution, former, proposal.structures)
            rough = max(fresh.error.dynamics, fresh.error.path)
            if switching and rough > 3.0 * _greatest(current.error):
                fresh = None
        if fresh is None:
            self.note(solution, None, "no better; back to the mesh before")
            self.former = None
        else:
            self.former = self.latest
        return fresh

    def reached(self, passed: _Pass) -> bool:
        """Whether all errors are within the tolerance."""
        tolerance, error = self.options.tolerance, passed.error
        least = max(error.dynamics, error.path) <= tolerance
        return least and error.objective <= CAUTION * tolerance

    def worse(self, solution: Solution, former: _Pass) -> bool:
        """Whether the objective got worse than the former one's errors explain."""
        error = former.error
        if error.dynamics > 1e-3 or error.path > 1e-3:
            return False
        loss = self.sign * (solution.objective - former.solution.objective)
        size = max(abs(former.solution.objective), 1e-3)
        allowed = max(1e-5, 10.0 * error.dynamics, 3.0 * error.path)
        return loss / size > allowed

    def rescale(self, solution: Solution) -> None:
        """Take scales that bounds do not tell from a first trajectory."""
        size = 0.0
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
            value = np.abs(part.costates).max(axis=0, initial=0.0) * span
            size = max(size, float(value.max(initial=0.0)))
        if np.isfinite(size) and size > 0.0:
            self.scales["objective"] = size

    # --- the next mesh -----------------------------------------------------------

    def detect(self, passed: _Pass, index: int) -> Structure:
        """Arcs of one phase of a solution."""
        phase, auditor = self.problem.phases[index], self.auditors[index]
        state_bounds = np.array(
            [self.table["bounds", phase.name, name] for name in phase.states]
        )
        return detect(
            passed.solution.phases[index],
            auditor.control_bounds(self.table),
            (state_bounds[:, 0], state_bounds[:, 1]),
            (
                partial(auditor.path_values, passed.solution),
                auditor.path_bounds(self.table),
            ),
        )

    def place_switches(
        self, passed: _Pass, refused: list[Structure]
    ) -> _Proposal | None:
        """Mesh whose arcs are those seen in the solution; ``None`` if nothing new."""
        meshes: list[PhaseMesh] = []
        arcs: list[FloatArray | None] = []
        structures: list[Structure | None] = []
        placed = 0
        if passed.error.dynamics > 1e-2:
            return None
        for i, phase in enumerate(self.problem.phases):
            part, mesh = passed.solution.phases[i], passed.solution.mesh.phases[i]
            known = passed.structures[i]
            structure = self.detect(passed, i)
            least = 0 if known is None else known.times.size
            new = least <= structure.times.size <= mesh.intervals // 2
            if known is not None and structure.same_as(known):
                new = False
            if any(structure.same_as(former) for former in refused):
                new = False
            if not new or structure.times.size == 0:
                meshes.append(mesh)
                arcs.append(part.arc_durations)
                structures.append(known)
                continue
            free = [
                (j, name, self.inner_degree(i, j))
                for j, (name, control) in enumerate(phase.controls.items())
                if control.degree is None
            ]
            fresh, durations = arc_mesh(part, structure, free)
            meshes.append(fresh)
            arcs.append(durations)
            structures.append(structure)
            placed += structure.times.size
        if not placed:
            return None
        words = f"{placed} switch times placed"
        return _Proposal(Mesh(tuple(meshes)), arcs, structures, words)

    def _limited(self, index: int, passed: _Pass) -> NDArray[np.bool_]:
        """Intervals whose error is the control's, where its degree is given."""
        part, phase = passed.solution.phases[index], self.problem.phases[index]
        audit, chosen = passed.audits[index], part.mesh.control_degrees
        given = any(
            control.degree is not None or min(chosen.get(name, (-1,))) >= 0
            for name, control in phase.controls.items()
        )
        size = max(abs(passed.solution.objective), 1e-3)
        share = audit.objective_control / size * len(audit.dynamics) / 2.0
        mostly = share > np.maximum(audit.dynamics, self.options.tolerance)
        return np.asarray(mostly & given)

    def refine(self, passed: _Pass) -> _Proposal:
        """Mesh with the intervals refined whose errors are too great."""
        meshes: list[PhaseMesh] = []
        arcs: list[FloatArray | None] = []
        words = []
        for i, part in enumerate(passed.solution.phases):
            mesh = passed.solution.mesh.phases[i]
            indicator = passed.indicators[i]
            mesh = _with_path_points(mesh, passed.audits[i], self.options)
            new, action = refine(
                mesh,
                part,
                indicator,
                rule=self.options.rule,
                scale=ranges(part.states),
                must_cut=self._limited(i, passed),
            )
            audit = passed.audits[i]
            if audit.path.max() > self.options.tolerance:
                words.append("path constraints added where they were violated")
            words.append(action)
            arcs.append(part.arc_durations)
            meshes.append(new)
        return _Proposal(Mesh(tuple(meshes)), arcs, passed.structures, "; ".join(words))


@dataclass(slots=True)
class _Proposal:
    """The next mesh to try."""

    mesh: Mesh
    arcs: list[FloatArray | None]
    structures: list[Structure | None]
    words: str


def _merit(error: ErrorEstimate) -> float:
    """Order of solutions: the greatest error, the objective's with caution."""
    return max(error.dynamics, error.path, error.objective / CAUTION)


def _greatest(error: ErrorEstimate) -> float:
    return max(error.dynamics, error.path, error.objective)


def _with_path_points(
    mesh: PhaseMesh, audit: PhaseAudit, options: Options
) -> PhaseMesh:
    """Let path constraints hold where they are violated between the nodes too.

    A new place replaces old ones next to it. Where places have been added before
    and little is left, the constraint is tightened by what is left: chasing the
    place of the greatest violation would never end.
    """
    points = [list(places) for places in mesh.path_points]
    margins = list(mesh.path_margins)
    for k in range(mesh.intervals):
        violation = float(audit.path[k])
        if violation <= options.tolerance or audit.path_active[k] > BOUNDARY:
            continue
        if violation < LITTLE and len(points[k]) > 2:
            margins[k] += 1.5 * violation
            continue
        for place in audit.path_places[k]:
            points[k] = [s for s in points[k] if abs(s - place) > 0.03]
            points[k].append(float(np.clip(place, 0.0, 1.0)))
    return replace(
        mesh,
        path_points=tuple(tuple(sorted(p)) for p in points),
        path_margins=tuple(margins),
    )


def solve(
    problem: Problem,
    *,
    guess: Guess | Solution | None = None,
    parameters: Mapping[str, float] | None = None,
    overrides: Overrides | None = None,
    options: Options | None = None,
) -> Solution:
    """Solve ``problem`` to a tolerance.

    Parameters
    ----------
    problem
        What is to be solved.
    guess
        Where to start; by default straight lines between the end values.
    parameters
        Values of the problem's parameters.
    overrides
        Bounds and end values that differ from the problem's own.
    options
        Tolerance and limits of effort.

    Returns
    -------
    Solution
        With the history of its meshes and its error estimate. ``result`` is
        ``SOLVED`` only if all errors are within the tolerance; ``COARSE`` if the best
        mesh misses it; else what went wrong, with the constraint and place in
        ``message``.

    Raises
    ------
    ValueError
        If the problem is not completely stated or a name is unknown.
    """
    chosen = options or Options()
    work = _Refinement(problem, chosen, parameters or {}, overrides or Overrides())
    solution = work.first(guess)
    if not solution.result.usable:
        work.note(solution, None, "no solution on any first mesh")
        return replace(
            solution, iterations=work.iterations, history=tuple(work.records)
        )
    none: list[Structure | None] = [None] * len(problem.phases)
    work.former = work.latest
    best = current = work.judge(solution, None, none)
    work.rescale(solution)
    tries = 4 if chosen.switches else 0
    refused: list[Structure] = []
    while len(work.records) < chosen.meshes - 1 and not work.reached(current):
        proposal = work.place_switches(current, refused) if tries > 0 else None
        switching = proposal is not None
        tries -= switching
        proposal = proposal or work.refine(current)
        if not switching and work.same(proposal.mesh, current.solution.mesh):
            break
        if proposal.mesh.point_count > chosen.points:
            break
        work.note(current.solution, current.error, proposal.words)
        fresh = work.take(proposal, current, switching=switching)
        if fresh is None and switching:
            refused += [s for s in proposal.structures if s is not None]
            fresh = work.take(work.refine(current), current, switching=False)
        if fresh is None:
            break
        current = fresh
        if _merit(current.error) < _merit(best.error) or switching:
            best = current
    best = min(best, current, key=lambda passed: _merit(passed.error))
    done = _greatest(best.error) <= chosen.tolerance
    work.note(best.solution, best.error, "tolerance reached" if done else "stopped")
    return _finished(work, best, done=done)


def _finished(work: _Refinement, best: _Pass, *, done: bool) -> Solution:
    result = Result.SOLVED if done else Result.COARSE
    audits = [a.audit(best.solution, work.table, shoot=True) for a in work.auditors]
    error = replace(best.error, shooting=max(a.shooting for a in audits))
    message = result.value
    if not done:
        message += (
            f" Dynamics {error.dynamics:.1e}, path constraints {error.path:.1e}, "
            f"objective {error.objective:.1e}; wanted {work.options.tolerance:.0e}."
        )
        worst = next((a.worst_path for a in audits if a.worst_path), "")
        if worst and error.path > work.options.tolerance:
            message += f" Violated most between the nodes: {worst}."
    return replace(
        best.solution,
        result=result,
        message=message,
        iterations=work.iterations,
        error=error,
        history=tuple(work.records),
    )
