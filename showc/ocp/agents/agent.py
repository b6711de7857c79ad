"""One of several systems of one kind: its ends, its least time, its easiest way.

All are stated by one problem of one phase whose objective is the duration; they differ
in the values of states at both ends, and in parameters.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from showc.ocp.audit.residuals import PhaseAuditor
from showc.ocp.collocation.limits import Overrides, Statement
from showc.ocp.collocation.solver import SolverOptions
from showc.ocp.collocation.transcription import Transcription
from showc.ocp.graded.grading import linear_mesh
from showc.ocp.graded.loop import solve_graded
from showc.ocp.mesh import Mesh
from showc.ocp.problem import Problem
from showc.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from showc.ocp.solution import Solution

    FloatArray = NDArray[np.float64]

BARRIER = 1e-2
"""Barrier parameter that is kept: solutions stay off their limits by what that costs,
which leaves room for the next solve, and ends it early."""
ITERATIONS = 40
"""Iterations of a solve; one that finds no way in these is given up."""
COARSEST = 24
"""No mesh interval is longer than the duration over this."""
_REPAIRS = 3
QUICK = {
    "mu_strategy": "monotone",
    "mu_init": 0.1,
    "mu_target": BARRIER,
    # As for graded meshes: scaled already, long and thin.
    "mumps_permuting_scaling": 0,
    "mumps_scaling": 0,
    "mumps_pivot_order": 2,
    "constr_viol_tol": 1e-8,
}
"""Options of the solver."""
WALLS = "apart"
"""Name of the half-spaces on the positions."""


@dataclass(frozen=True, slots=True)
class Agent:
    """What is special about one agent."""

    starts: Mapping[str, float]
    """Values of states at the start, by name, that differ from the problem's."""
    ends: Mapping[str, float]
    """The same at the end."""
    parameters: Mapping[str, float] = field(default_factory=dict)

    def overrides(self) -> Overrides:
        """Put these ends over the problem's own."""
        return Overrides(starts=self.starts, ends=self.ends)


def shiftable(problem: Problem) -> set[str]:
    """States that may all be moved by a constant: nothing depends on them.

    They enter no derivative and no constraint, and have no bounds.
    """
    (phase,) = problem.phases
    expressions = [
        *phase.derivatives.values(),
        *[c.symbol for c in phase.path_constraints],
        *[integrand for _, integrand in phase.integrals],
        *[c.symbol for c in problem.boundary_constraints],
        casadi.SX(problem.objective),
    ]
    y = casadi.vertcat(*expressions)
    free = set()
    for name, state in phase.states.items():
        low, high = state.quantity.lower, state.quantity.upper
        bound = not (low == -np.inf and high == np.inf)
        symbols = casadi.vertcat(state.quantity.symbol, state.initial, state.final)
        if not bound and not casadi.depends_on(y, symbols):
            free.add(name)
    return free


def shifted(solution: Solution, offset: Mapping[str, float]) -> Solution:
    """Move states of a solution by constants."""
    (part,) = solution.phases
    moves = np.array([offset.get(name, 0.0) for name in part.state_names])
    states = PiecewisePolynomial(part.states.breaks, part.states.coefficients + moves)
    return replace(solution, phases=(replace(part, states=states),))


def least_time(problem: Problem, agent: Agent, guess: Solution | None) -> Solution:
    """Solve one agent in its least time, on graded meshes."""
    return solve_graded(
        problem,
        guess=guess,
        parameters=agent.parameters,
        overrides=agent.overrides(),
    )


class LeastEffort:
    """The program of one agent at a given time, built once for all agents.

    The effort is the integral of the squared controls, from the middle of their
    bounds (or from the middle of what ``model`` uses) and over their range.

    Parameters
    ----------
    problem
        One phase.
    model
        A solution in the least time: where its mesh is fine, this one is.
    position
        Names of the states that make up the position.
    walls
        Half-spaces on the position for each mesh interval.
    """

    def __init__(
        self, problem: Problem, model: Solution, position: Sequence[str], walls: int
    ) -> None:
        self.stated = problem
        self.name = problem.phases[0].name
        self.position = tuple(position)
        self.walls = walls
        (part,) = model.phases
        breaks = _divided((part.states.breaks - part.start) / part.duration)
        self._breaks = breaks
        self._points = int(np.median(part.mesh.points))
        self._build(part.duration, model)

    def _build(self, duration: float, model: Solution) -> None:
        self._duration, self._model = duration, model
        (original,) = self.stated.phases
        phase: Any = copy.copy(original)
        phase.half_spaces = []
        phase.integrals = []
        effort = casadi.SX(0)
        statement = Statement(self.stated)
        defaults = [v or 0.0 for _, v in self.stated.parameters.values()]
        table = statement.table(np.array(defaults, dtype=np.float64))
        (part,) = model.phases
        least, most = part.controls.bounds()
        for number, (name, control) in enumerate(phase.controls.items()):
            low, high = table["bounds", phase.name, name]
            if not np.isfinite(high - low):
                low, high = float(least[number]), float(most[number])
            half = 0.5 * (high - low) or 1.0
            usual = float(np.median(part.controls.coefficients[:, :, number]))
            effort += ((control.quantity.symbol - usual) / half) ** 2
        self.problem = Problem(
            self.stated.name,
            [phase],
            self.stated.parameters,
            self.stated.statics,
            self.stated.boundary_constraints,
        )
        self.problem.minimise(phase.integral(effort / duration))
        places = [phase.states[name].quantity.symbol for name in self.position]
        if self.walls:
            phase.half_space(WALLS, places, self.walls)
        free = tuple(n for n, c in phase.controls.items() if c.degree is None)
        count = self._breaks.size - 1
        mesh = linear_mesh(self._breaks, [self._points] * count, free, 1e-6)
        self.mesh = Mesh((mesh,))
        self._built = Transcription(
            self.problem,
            self.mesh,
            scales={f"{phase.name}.duration": duration},
            options=SolverOptions(tolerance=1e-6, iterations=ITERATIONS, extra=QUICK),
        )
        self._auditor = PhaseAuditor(self.problem, phase, 0)
        self._table = table

    @property
    def intervals(self) -> int:
        """Number of mesh intervals."""
        return int(self._breaks.size) - 1

    def refine(self) -> bool:
        """Give every interval one more point; False if that has been done enough."""
        if self._points >= int(np.median(self._model.mesh.phases[0].points)) + _REPAIRS:
            return False
        self._points += 1
        self._build(self._duration, self._model)
        return True

    def solve(
        self,
        agent: Agent,
        duration: float,
        guess: Solution,
        walls: tuple[FloatArray, FloatArray] | None = None,
    ) -> Solution:
        """Solve one agent; ``walls``: normals (K, rows, n) and lower bounds (K, rows).

        Rows without a finite bound are off.
        """
        spaces = {}
        if walls is not None:
            normals, lower = walls
            spaces[WALLS] = (normals, lower, np.full(lower.shape, np.inf))
        overrides = replace(
            agent.overrides(), durations={self.name: duration}, half_spaces=spaces
        )
        return self._built.solve(
            parameters=agent.parameters, overrides=overrides, guess=guess
        )

    def missed(self, solution: Solution) -> float:
        """Error of the flown controls over each state's range, or of a constraint.

        One integration of the controls, clipped to their bounds, from start to end;
        and the greatest violation of path constraints between the points.
        """
        audit = self._auditor.audit(solution, self._table, shoot=True)
        return max(audit.shooting, float(audit.path.max(initial=0.0)))

    def place(self, solution: Solution) -> FloatArray:
        """Bernstein coefficients of the position, shape (K, degree + 1, n)."""
        (part,) = solution.phases
        chosen = [part.state_names.index(name) for name in self.position]
        return np.asarray(part.states.coefficients[:, :, chosen])


def _divided(breaks: FloatArray) -> FloatArray:
    """Cut intervals that are too long."""
    parts = [
        np.linspace(low, high, max(1, int(np.ceil((high - low) * COARSEST))) + 1)[:-1]
        for low, high in pairwise(breaks)
    ]
    return np.concatenate([*parts, breaks[-1:]])
