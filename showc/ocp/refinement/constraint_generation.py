"""Solve with couplings that are imposed only where an audit finds them violated.

The problem is solved without its couplings first. An audit in continuous time
(:mod:`showc.ocp.audit.couplings`) finds those that are violated; they are imposed on
the stretches concerned, and the next solve starts from the last. On a stretch a
coupling holds at the collocation points; where it is then still violated between
them, at those places too; and when little is left, it is tightened by what is left.
This ends when the audit finds nothing.

Where two subsystems meet exactly, the gradient of their squared distance vanishes: a
solver that starts there sees no direction in which the distance grows, and may stay
for ever. The coupling's curvature tells: along an eigenvector v of its second
derivatives with eigenvalue l, a step a v changes it by l a² / 2. Of those that help,
one across the motion is taken, so that the subsystems pass each other on one side.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import casadi
import numpy as np

from showc.ocp.audit.couplings import CouplingAuditor
from showc.ocp.coupling import Imposed, merged
from showc.ocp.fault import StatementError, check_type
from showc.ocp.guess import Curve, Guess, check_guess, curves_of
from showc.ocp.mesh import Mesh
from showc.ocp.outcome import Result
from showc.ocp.problem import Problem
from showc.ocp.refinement.loop import solve as refined
from showc.ocp.refinement.multistart import solve_from_many
from showc.ocp.refinement.options import Options
from showc.ocp.solution import Solution
from showc.ocp.transcription.collocation.limits import Overrides
from showc.ocp.transcription.collocation.statement import Statement

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from showc.arrays import FloatArray
    from showc.ocp.audit.couplings import Violation
    from showc.ocp.history import MeshRecord
    from showc.ocp.mesh import PhaseMesh
    from showc.ocp.quantity import Quantity
    from showc.ocp.solution import PhaseSolution

ROUNDS = 20
"""Greatest number of times that couplings are added or tightened."""
_LITTLE, _PLACES = 1e-3, 6
"""Share of the scale of a coupling that a violation must have, and most places, for one
more: beyond, chasing the greatest violation would never end."""
_HEAD_ON = 0.3
"""Share of what is lacking that the gradient gains on the way that the curvature
needs; below it the gradient is no guide."""
_LEVEL = 1e-6
"""Length of a direction below which it is rounding."""


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
    check_type(problem, Problem, "what is to be solved")
    check_type(options, Options, "what is given as options")
    check_type(overrides, Overrides, "what is given as overrides")
    chosen = options or Options()
    problem.check()
    if chosen.mesh and len(chosen.mesh.phases) != len(problem.phases):
        raise StatementError(
            f"the mesh of the options has {len(chosen.mesh.phases)} phases; the "
            f"problem has {len(problem.phases)}"
        )
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


def nudged(
    problem: Problem, solution: Solution, violations: Sequence[Violation]
) -> Guess | None:
    """Guess from ``solution`` with the violated couplings' subsystems moved aside.

    ``None`` where the gradients tell enough already.
    """
    curves: dict[str, Curve] = {}
    moved = False
    for index, (phase, part) in enumerate(
        zip(problem.phases, solution.phases, strict=True)
    ):
        names = list(phase.states)
        aside = np.zeros(len(names))
        place = 0.5
        for found in violations:
            if found.phase != index:
                continue
            coupling = next(c for c in phase.couplings if c.name == found.name)
            at = part.states(np.array(found.time))
            motion = part.states.derivative()(np.array(found.time))
            step = _step(problem, index, coupling, (at, motion, found.amount), solution)
            if step is not None:
                aside += step
                place = found.place
        for name, curve in curves_of(part).items():
            number = names.index(name) if name in names else -1
            if number >= 0 and aside[number] != 0.0:
                moved = True
                curves[f"{phase.name}.{name}"] = _bent(curve, aside[number], place)
            else:
                curves[f"{phase.name}.{name}"] = curve
    if not moved:
        return None
    return Guess(
        curves,
        {part.name: part.duration for part in solution.phases},
        {part.name: part.start for part in solution.phases},
        solution.statics,
    )


def _step(
    problem: Problem,
    index: int,
    coupling: Quantity,
    where: tuple[FloatArray, FloatArray, float],
    solution: Solution,
) -> FloatArray | None:
    """Step of the states that mends a coupling, ``None`` if its gradient is a guide."""
    at, motion, lack = where
    phase = problem.phases[index]
    (x, _), p = phase.members, problem.given
    hessian, gradient = casadi.hessian(coupling.symbol, x)
    values = np.array([*solution.parameters.values(), *solution.statics.values()])
    function = casadi.Function("bends", [x, p], [coupling.symbol, gradient, hessian])
    value, slope, bend = (np.asarray(part) for part in function(at, values))
    # A value that is too small wants positive curvature, one too great negative.
    low = coupling.lower if isinstance(coupling.lower, (int, float)) else -np.inf
    sign = 1.0 if float(value.item()) < low else -1.0
    sizes, vectors = np.linalg.eigh(sign * bend)
    helping = vectors[:, sizes > 0.5 * max(sizes[-1], 1e-300)]
    if sizes[-1] <= 0.0 or helping.shape[1] == 0:
        return None
    length = np.sqrt(2.0 * lack / sizes[-1])
    if float(np.linalg.norm(slope)) * length > _HEAD_ON * lack:
        return None
    helping = _ordered(helping)
    along = helping.T @ motion
    pace = float(np.linalg.norm(along))
    if pace > 0.0:
        along /= pace
    # To the right of the motion in the first two dimensions: pairs that all meet in
    # one place then turn about it together.
    across = np.zeros(along.size)
    if along.size > 1 and np.hypot(*along[:2]) > _LEVEL:
        across[:2] = along[1], -along[0]
    else:
        across[0] = 1.0
    return np.asarray(length * (helping @ across) / np.linalg.norm(across))


def _ordered(space: FloatArray) -> FloatArray:
    """Orthonormal basis of the same space that follows the order of the states."""
    basis: list[FloatArray] = []
    for column in space @ space.T:
        rest = column - sum((b @ column) * b for b in basis)
        size = float(np.linalg.norm(rest))
        if size > _LEVEL and len(basis) < space.shape[1]:
            basis.append(rest / size)
    return np.stack(basis, axis=1)


def _bent(curve: Curve, aside: float, place: float) -> Curve:
    """Curve moved by ``aside`` at the fraction ``place``, by nothing at the ends."""
    plain: Callable[[FloatArray], FloatArray] = curve  # type: ignore[assignment]
    place = min(max(place, 0.05), 0.95)
    sharp = np.log(0.5) / np.log(place)

    def moved(fraction: FloatArray) -> FloatArray:
        s = np.clip(fraction, 0.0, 1.0) ** sharp
        return np.asarray(plain(fraction) + 16.0 * aside * (s * (1.0 - s)) ** 2)

    return moved
