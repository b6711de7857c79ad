"""Solve with couplings that are imposed only where an audit finds them violated.

The problem is solved without its couplings first. An audit in continuous time
(:mod:`showc.ocp.audit.couplings`) finds those that are violated; they are imposed on
the stretches concerned, and the next solve starts from the last. On a stretch a
coupling holds at the collocation points; where it is then still violated between
them, at those places too; and when little is left, it is tightened by what is left.
This ends when the audit finds nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.audit.couplings import CouplingAuditor
from showc.ocp.coupling import Imposed, merged
from showc.ocp.fault import StatementError
from showc.ocp.guess import check_guess
from showc.ocp.mesh import Mesh
from showc.ocp.outcome import Result
from showc.ocp.problem import Problem
from showc.ocp.refinement.loop import solve as refined
from showc.ocp.refinement.multistart import solve_from_many
from showc.ocp.refinement.nudge import nudged
from showc.ocp.refinement.options import Options
from showc.ocp.solution import Solution
from showc.ocp.transcription.collocation.limits import Overrides, Statement

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from showc.ocp.audit.couplings import Violation
    from showc.ocp.guess import Guess
    from showc.ocp.history import MeshRecord
    from showc.ocp.mesh import PhaseMesh
    from showc.ocp.solution import PhaseSolution

ROUNDS = 20
"""Greatest number of times that couplings are added or tightened."""
_LITTLE = 1e-3
_PLACES = 6
"""Share of the scale of a coupling that a violation must have, and most places, for one
more: beyond, chasing the greatest violation would never end."""


@dataclass(frozen=True, slots=True)
class _Tightened:
    """A coupling that is imposed, and how often it has been tightened."""

    imposed: Imposed
    tries: int = 0


@dataclass(slots=True)
class Couplings:
    """Which couplings of a problem are imposed; grows as audits find more."""

    problem: Problem
    parameters: Mapping[str, float] = field(default_factory=dict)
    fresh: list[Violation] = field(default_factory=list)
    """Violations of couplings that were imposed for the first time just now."""
    _known: dict[tuple[int, str], _Tightened] = field(default_factory=dict)

    @property
    def imposed(self) -> tuple[Imposed, ...]:
        """What constrains the next solve."""
        return tuple(entry.imposed for entry in self._known.values())

    def violations(self, solution: Solution) -> list[Violation]:
        """Audit all couplings, imposed or not, at every instant of a solution."""
        statement = Statement(self.problem)
        table = statement.table(statement.parameters(self.parameters))
        return [
            violation
            for index, phase in enumerate(self.problem.phases)
            if phase.couplings
            for violation in CouplingAuditor(self.problem, phase, index).violations(
                solution, table
            )
        ]

    def impose(self, violations: Sequence[Violation]) -> None:
        """Add what an audit has found to what is imposed."""
        self.fresh = [v for v in violations if (v.phase, v.name) not in self._known]
        for found in violations:
            key = found.phase, found.name
            entry = self._known.get(key)
            if entry is None:
                imposed = Imposed(found.phase, found.name, found.stretches)
                self._known[key] = _Tightened(imposed)
                continue
            old = entry.imposed
            stretches = merged([*old.stretches, *found.stretches])
            if stretches != old.stretches:
                imposed = replace(old, stretches=stretches)
            elif len(old.places) < _PLACES and found.amount > _LITTLE * self._scale(
                found
            ):
                apart = [s for s in old.places if abs(s - found.place) > 1e-3]
                imposed = replace(old, places=(*apart, found.place))
            else:
                # Chasing the place of the greatest violation would never end.
                growth = 1.02 * 1.5 ** min(entry.tries, 8)
                margin = old.margin + growth * found.amount
                self._known[key] = _Tightened(
                    replace(old, margin=margin), entry.tries + 1
                )
                continue
            self._known[key] = replace(entry, imposed=imposed)

    def _scale(self, found: Violation) -> float:
        couplings = self.problem.phases[found.phase].couplings
        coupling = next(c for c in couplings if c.name == found.name)
        known = [
            abs(bound)
            for bound in (coupling.lower, coupling.upper)
            if isinstance(bound, (int, float)) and 0.0 < abs(bound) < np.inf
        ]
        return coupling.scale or max(known, default=1.0)


def enforce(
    couplings: Couplings,
    solve: Callable[[tuple[Imposed, ...], Solution | None], Solution],
    *,
    rounds: int = ROUNDS,
) -> Solution:
    """Solve again and again, until every coupling holds at every instant.

    Parameters
    ----------
    couplings
        Of the problem; says afterwards which had to be imposed, and where.
    solve
        Solves with given couplings imposed, starting from an earlier solution.
    rounds
        Greatest number of times that couplings are added or tightened.

    Returns
    -------
    Solution
        The last one. If couplings are violated still, its result is ``INFEASIBLE``
        and its message names the worst.
    """
    solution = solve(couplings.imposed, None)
    for _ in range(rounds):
        if not solution.result.usable:
            return _with_names(solution, couplings)
        violations = couplings.violations(solution)
        if not violations:
            return solution
        couplings.impose(violations)
        solution = solve(couplings.imposed, solution)
    violations = couplings.violations(solution)
    if not violations or not solution.result.usable:
        return solution
    worst = max(violations, key=lambda found: found.amount)
    message = (
        f"{Result.INFEASIBLE.value} Coupling {worst.name!r} is violated by "
        f"{worst.amount:.3g} at t = {worst.time:.6g}."
    )
    return replace(solution, result=Result.INFEASIBLE, message=message)


def _with_names(solution: Solution, couplings: Couplings) -> Solution:
    """Name the couplings that were imposed when a solve failed."""
    names = ", ".join(repr(entry.name) for entry in couplings.imposed)
    if not names:
        return solution
    return replace(solution, message=f"{solution.message} Couplings imposed: {names}.")


def solve(
    problem: Problem,
    *,
    guess: Guess | Solution | None = None,
    parameters: Mapping[str, float] | None = None,
    overrides: Overrides | None = None,
    options: Options | None = None,
) -> Solution:
    """Solve ``problem`` to a tolerance; couplings are imposed where they are needed.

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
        ``message``. Its couplings hold at every instant, to rounding.

    Raises
    ------
    ValueError
        If the problem is not completely stated or a name is unknown.
    """
    if not isinstance(problem, Problem):
        kind = type(problem).__name__
        raise StatementError(f"what is to be solved is of type {kind}; wanted Problem")
    chosen = options or Options()
    if not isinstance(chosen, Options):
        kind = type(chosen).__name__
        raise StatementError(f"the options are of type {kind}; wanted ocp.Options")
    problem.check()
    check_guess(problem, guess)
    if chosen.starts > 1:

        def from_start(start: Guess | Solution | None, quick: bool) -> Solution:  # noqa: FBT001
            one = replace(chosen, starts=1, meshes=1 if quick else chosen.meshes)
            if not quick and isinstance(start, Solution):
                one = replace(one, mesh=_same_mesh(start))
            return solve(
                problem,
                guess=start,
                parameters=parameters,
                overrides=overrides,
                options=one,
            )

        return solve_from_many(
            problem,
            guess,
            parameters or {},
            from_start,
            starts=chosen.starts,
            jobs=chosen.jobs,
        )
    couplings = Couplings(problem, parameters or {})
    iterations = 0
    history: list[MeshRecord] = []

    def once(imposed: tuple[Imposed, ...], former: Solution | None) -> Solution:
        nonlocal iterations
        start: Guess | Solution | None = guess
        settings = replace(chosen, couplings=(*chosen.couplings, *imposed))
        if former is not None:
            settings = replace(settings, mesh=_same_mesh(former))
            start = nudged(problem, former, couplings.fresh) or former
        solution = refined(
            problem,
            guess=start,
            parameters=parameters,
            overrides=overrides,
            options=settings,
        )
        iterations += solution.iterations
        history.extend(solution.history)
        return replace(solution, iterations=iterations, history=tuple(history))

    return enforce(couplings, once)


def _same_mesh(solution: Solution) -> Mesh:
    """Mesh of a solution, with borders that were found by switch times now fixed."""

    def fixed(part: PhaseSolution) -> PhaseMesh:
        widths = np.diff(part.states.breaks)
        shares = tuple(float(w) for w in widths / widths.sum())
        return replace(part.mesh, fractions=shares, arcs=(0,) * len(shares))

    return Mesh(tuple(fixed(part) for part in solution.phases))
