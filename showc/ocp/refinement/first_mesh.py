"""A first solution on a coarse mesh, by other ways where the plain one fails.

Where durations are free, a search from a poor start may shrink them to nothing and end
infeasible. A trajectory of the least effort in a given time is found far more often: it
then starts the search for the objective itself.

Where all states start from given values, controls can be flown. What the integrator's
steps tell of fast beginnings and layers makes the mesh.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.guess import Guess
from showc.ocp.outcome import Result
from showc.ocp.refinement.attempts import Attempts
from showc.ocp.refinement.multistart import flown, stationary, uneven, unmoved, varied
from showc.ocp.refinement.options import INNER_DEGREE, LOOSELY, UNEVENNESS, WEIGHINGS
from showc.ocp.refinement.proposal import plain_mesh
from showc.ocp.scaling import middle
from showc.ocp.solution import Solution
from showc.ocp.transcription.collocation.statement import Statement

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from showc.ocp.audit.residuals import PhaseAuditor
    from showc.ocp.guess import Curve
    from showc.ocp.mesh import Mesh
    from showc.ocp.problem import Problem
    from showc.ocp.refinement.recorder import Recorder
    from showc.ocp.transcription.collocation.statement import Table

    _Way = tuple[str, Callable[[], Solution]]
    """What is tried, and how."""

_ABOUT = 3.0
"""Ratio by which a duration may differ from one that is given about: the next tries are
ten times as long."""
_OTHERS = 2
"""Other starts where a search may be caught at a saddle: waves of either kind."""
_FIRST = 2
"""Calm tries before the search itself is tried from other orders of magnitude."""
_MAGNITUDES = (1e2, 1e4, 1e-2, 1e6)
"""Durations over their scale from which the search itself is tried."""
_LENGTHS = (10.0, 1.0, 100.0, 1e4, 0.1, 1e-2, 1e6)
"""Durations over their scale in which a calm trajectory is looked for, likely ones
first: a search fails in too short a time, and seldom in a long one."""


class FirstMesh:
    """Finds a first solution of a problem.

    Parameters
    ----------
    attempts
        Solves on any mesh; left with the scales that led to the solution.
    auditors
        Of the phases.
    history
        Hears of every failure.
    """

    def __init__(
        self, attempts: Attempts, auditors: Sequence[PhaseAuditor], history: Recorder
    ) -> None:
        self.attempts, self.auditors, self.history = attempts, auditors, history
        self.problem, self.options = attempts.problem, attempts.options

    def solve(self, guess: Guess | Solution | None) -> Solution:
        """Return the first usable solution, or what the plain way came to."""
        mesh = self.options.mesh or plain_mesh(self.auditors, 10, 4)
        solution = first = self.attempts.attempt(mesh, guess)
        if solution.result is Result.CONTRADICTION:
            return solution
        if solution.result.usable:
            return self._unsymmetric(self._weighed(solution), guess)
        known, ways = self.attempts.scales, self._other_ways(mesh, guess)
        if solution.result is Result.ITERATION_LIMIT:
            ways = chain(self._uneven_ways(solution, guess), ways)
        for words, way in ways:
            self.history.note(solution, None, f"the solver failed; {words} is tried")
            solution = way()
            if solution.result.usable:
                return self._weighed(solution)
            if solution.result is first.result is Result.UNBOUNDED:
                break
            self.attempts.scales = known
        self.history.note(solution, None, "the solver failed; no other way is left")
        return first

    def _other_ways(self, mesh: Mesh, guess: Guess | Solution | None) -> Iterator[_Way]:
        """Ways to a first solution, those that help most often first."""
        solve = self.attempts.attempt
        if guess is None:
            yield from self._calm_ways(mesh, 0, _LENGTHS[:_FIRST])
            for factor in _MAGNITUDES if self._unknown_durations() else ():
                words = f"a duration {factor:g} times as long"
                yield words, partial(self._stretched, mesh, factor)
            yield from self._calm_ways(mesh, _FIRST, _LENGTHS[_FIRST:])
        free = partial(plain_mesh, self.auditors, degree=INNER_DEGREE)
        base = self.options.solver
        for other, strategy in (
            (mesh, "monotone"),
            (free(20, 3), "adaptive"),
            (free(30, 3), "monotone"),
            (free(6, 6), "adaptive"),
        ):
            extra = {"mu_strategy": strategy, **base.extra}
            solver = replace(base, extra=extra, iterations=2 * base.iterations)
            words = f"another way, on {other.interval_count} intervals,"
            yield words, partial(solve, other, guess, solver=solver)
        if isinstance(guess, Solution):
            return
        table, parameters = self.attempts.table, self.attempts.parameters
        # Where all slopes vanish, or have no value, other places have some.
        for number in (1, 2):
            start = varied(self.problem, guess, parameters, number)
            yield "a start with waves", partial(solve, mesh, start)
        if found := flown(self.problem, guess or Guess(), table, parameters):
            yield "what the guessed controls fly", partial(solve, *found)
        # A full tank at half throttle: where the middle leads beyond a bound.
        for side, words in enumerate(("least", "greatest") if guess is None else ()):
            if found := flown(self.problem, self._extreme(side), table, parameters):
                yield f"what the {words} controls fly", partial(solve, *found)

    def _extreme(self, side: int) -> Guess:
        """Guess every control at its lower (0) or upper (1) bound, where it has one."""
        curves: dict[str, Curve] = {}
        for phase in self.problem.phases:
            for name in phase.controls:
                bound = self.attempts.table["bounds", phase.name, name][side]
                if np.isfinite(bound):
                    curves[f"{phase.name}.{name}"] = bound
        return Guess(curves=curves)

    def _calm_ways(
        self, mesh: Mesh, number: int, factors: tuple[float, ...]
    ) -> Iterator[_Way]:
        """Start from the least effort in durations of several lengths."""
        for other, durations in enumerate(self._other_durations(factors)):
            longest = max(durations.values())
            words = f"the least effort in about {longest:g}, to start from,"
            yield words, partial(self._from_calm, mesh, durations, number + other)

    def _unknown_durations(self) -> list[str]:
        """Names of the scales of durations of whose length nothing is known."""
        return [
            name
            for name, (_, high) in self._free_durations().items()
            if not np.isfinite(high) and name not in self.options.scales
        ]

    def _stretched(self, mesh: Mesh, factor: float) -> Solution:
        """Solve with other scales, and starts, of durations of unknown length."""
        bounds = self._free_durations()
        scales = {
            name: max(bounds[name][0], 1.0) * factor
            for name in self._unknown_durations()
        }
        self.attempts.scales = self.attempts.scales | scales
        return self.attempts.attempt(mesh, None)

    def _free_durations(self) -> dict[str, tuple[float, float]]:
        """Bounds of the durations that are free, by the names of their scales."""
        table = self.attempts.table
        bounds = {p.name: table["duration", p.name] for p in self.problem.phases}
        return {
            f"{name}.duration": (low, high)
            for name, (low, high) in bounds.items()
            if low < high
        }

    def _other_durations(
        self, factors: tuple[float, ...]
    ) -> Iterator[dict[str, float]]:
        """Durations for calm trajectories, by the names of their scales."""
        bounds, seen = self._free_durations(), set()
        scales = Statement(self.problem).scales(self.attempts.scales).durations
        base = {
            f"{p.name}.duration": size
            for p, size in zip(self.problem.phases, scales, strict=True)
        }
        for factor in factors:
            found = {
                name: float(np.clip(base[name] * factor, *pair))
                for name, pair in bounds.items()
            }
            if found and tuple(found.values()) not in seen:
                seen.add(tuple(found.values()))
                yield found

    def _from_calm(
        self, mesh: Mesh, durations: dict[str, float], number: int
    ) -> Solution:
        """Solve from a trajectory of the least effort in about these ``durations``.

        That starts with waves, another ``number`` with others: straight lines would be
        where all slopes of a product vanish.
        """
        attempts, bounds = self.attempts, self._free_durations()
        given = {
            name.removesuffix(".duration"): (
                max(about / _ABOUT, bounds[name][0]),
                min(about * _ABOUT, bounds[name][1]),
            )
            for name, about in durations.items()
        }
        quiet = Attempts(
            calm(self.problem, attempts.table),
            replace(self.options, couplings=()),
            attempts.parameters,
            replace(attempts.overrides, durations=given),
        )
        quiet.scales = attempts.scales | durations
        waves = varied(self.problem, None, attempts.parameters, number + 1)
        lengths = {name.removesuffix(".duration"): d for name, d in durations.items()}
        waves = replace(waves, durations={**waves.durations, **lengths})
        start = quiet.attempt(mesh, waves)
        attempts.iterations += start.iterations
        if not start.result.usable:
            return start
        attempts.scales = attempts.scales | durations
        return attempts.attempt(mesh, start)

    def _weighed(self, solution: Solution) -> Solution:
        """Solve again where the solver's tolerance was loose for what it found.

        The first scale of the objective is a guess. A solver that stops at 1e-8 of a
        scale that is far too great has not reached anything.
        """
        for _ in range(WEIGHINGS):
            loose = self.attempts.weigh(solution)
            if loose < LOOSELY:
                break
            words = f"the objective's scale was {loose:.1e} times too great; again"
            self.history.note(solution, None, words)
            better = self.attempts.attempt(solution.mesh, solution)
            if not better.result.usable:
                break
            solution = better
        return solution

    def _unsymmetric(
        self, solution: Solution, guess: Guess | Solution | None
    ) -> Solution:
        """Start again without symmetry where the first search may be caught in one."""
        sign = -1.0 if self.problem.maximises else 1.0
        best, built = solution, self.attempts.latest
        for words, way in self._uneven_ways(solution, guess):
            self.history.note(solution, None, f"{words} is tried")
            solution = way()
            if solution.result is Result.UNBOUNDED:
                return solution
            gain = sign * (best.objective - solution.objective)
            if solution.result.usable and gain > 1e-6 * abs(best.objective):
                best, built = solution, self.attempts.latest
        self.attempts.latest = built
        return best

    def _uneven_ways(
        self, solution: Solution, guess: Guess | Solution | None
    ) -> Iterator[_Way]:
        """Give starts without symmetry, where a search may be caught in one."""
        if isinstance(guess, Solution):
            return
        table, parameters = self.attempts.table, self.attempts.parameters
        stuck = stationary(self.problem, solution, table)
        for number in range(1, 1 + _OTHERS) if stuck else ():
            start = varied(self.problem, guess, parameters, number)
            words = f"{stuck!r} stayed at its guess; a start with waves"
            yield words, partial(self.attempts.attempt, solution.mesh, start)
        still = unmoved(self.problem, solution, table)
        if not still:
            return
        # Controls of few coefficients would smooth most of the unevenness away.
        free = plain_mesh(self.auditors, 10, 4, degree=INNER_DEGREE)
        mesh = self.options.mesh or free
        names = ", ".join(repr(name) for name, _ in still)
        for share in UNEVENNESS:
            start = uneven(guess or Guess(), still, table, share)
            words = f"{names} stayed at its guess; a start without symmetry"
            yield words, partial(self.attempts.attempt, mesh, start)


def calm(problem: Problem, table: Table) -> Problem:
    """Return the same problem with the least effort of its controls as objective.

    Parameters
    ----------
    problem
        Its phases are left as they are.
    table
        Its bounds: effort is counted from the middle between them, over their distance.
    """
    phases, total = [], 0.0
    for phase in problem.phases:
        quiet, effort = copy(phase), 0.0
        quiet.integrals = list(phase.integrals)
        for name, control in phase.controls.items():
            low, high = table["bounds", phase.name, name]
            size = 0.5 * (high - low)
            unit = size if np.isfinite(size) and size > 0.0 else 1.0
            effort += ((control.quantity.symbol - middle(low, high)) / unit) ** 2
        phases.append(quiet)
        total += quiet.integral(effort)
    return replace(problem, phases=phases, objective=total, maximises=False)
