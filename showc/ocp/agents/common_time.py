"""Several systems of one kind in the least common time, apart from each other.

A joint program over all *agents* grows with every pair, and only the slowest agent
determines its unknowns. Here the time is found from the slowest agent alone; each
agent is then solved on its own at a time just above, with the least effort, and only
those that an audit in continuous time finds too near to each other are solved again.
These go in order of priority, the ones with least slack first: each keeps, on every
mesh interval, to its side of planes between it and those before it, by the Bernstein
coefficients of its position, hence at every instant (:mod:`showc.ocp.agents.walls`).
One that finds no way moves up in the order (van den Berg, Overmars 2005, Prioritized
motion planning for multiple robots). If no order works, the time grows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.agents.agent import LeastEffort, least_time, shiftable, shifted
from showc.ocp.agents.order import NOBODY, Orders, Plan
from showc.ocp.agents.walls import Apart, conflicts
from showc.ocp.outcome import Result

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from showc.ocp.agents.agent import Agent
    from showc.ocp.problem import Problem
    from showc.ocp.solution import Solution

    FloatArray = NDArray[np.float64]

_SAME = 1e-9


@dataclass(frozen=True, slots=True)
class AgentsOptions:
    """How several agents are solved."""

    gaps: tuple[float, ...] = (0.003, 0.008, 0.016, 0.03, 0.06)
    """By how much the common time exceeds the slowest agent's least time, tried in
    turn. Agents that all make the same move need no more than that time."""
    accuracy: float = 2e-5
    """Wanted error of the flown controls over each state's range."""
    orders: int = 15
    """Orders of priority tried for each group of agents and time."""
    passes: int = 4
    """Times that the planes of one agent are laid anew about its way."""
    together: int = 2
    """Groups of at most so many are solved in one problem where no order works: takes
    ten times as long as an order, but finds ways where both must give way at once."""
    round_up: float = 0.0
    """The common time is a multiple of this; 0: any."""
    progress: Callable[[str], None] | None = None
    """Called with a sentence on what is tried next."""


@dataclass(frozen=True, slots=True, eq=False)
class AgentsSolution:
    """What was found for several agents."""

    result: Result
    message: str
    duration: float
    """Common time."""
    bound: float
    """Least time of the slowest agent, solved alone: no common time is shorter."""
    solutions: tuple[Solution, ...]
    """One for each agent, in order, on one mesh; empty unless solved."""
    groups: tuple[tuple[int, ...], ...] = ()
    """Agents that had to be planned with regard to each other."""
    joined: tuple[tuple[int, ...], ...] = ()
    """Those groups among them that were solved in one problem."""
    solves: int = 0
    """Nonlinear programs solved at a given time."""

    @property
    def solved(self) -> bool:
        """Whether there are ways for all agents."""
        return self.result is Result.SOLVED


class _Work:
    """The state of one solve."""

    def __init__(
        self,
        problem: Problem,
        agents: Sequence[Agent],
        position: Sequence[str],
        apart: Apart,
        options: AgentsOptions,
    ) -> None:
        self.problem, self.agents = problem, agents
        self.position, self.apart = tuple(position), apart
        self.options = options
        self.solves = 0
        self.groups: tuple[tuple[int, ...], ...] = ()
        self.joined: tuple[tuple[int, ...], ...] = ()
        self.slowest: dict[int, Solution] = {}
        """Least-time solutions so far, by agent."""
        self.program: LeastEffort | None = None
        self.walled: LeastEffort | None = None
        self.message = ""

    # --- times ---------------------------------------------------------------------

    def way_of(self, k: int) -> FloatArray:
        """Vector from the start of an agent to its end."""
        agent = self.agents[k]
        return np.array([agent.ends[n] - agent.starts[n] for n in self.position])

    def bound(self) -> float:
        """Greatest least time known."""
        return max(solution.duration for solution in self.slowest.values())

    def solve_alone(self, k: int) -> bool:
        """Solve an agent's least time."""
        guess = max(
            self.slowest.values(), key=lambda solution: solution.duration, default=None
        )
        solution = least_time(self.problem, self.agents[k], None)
        if not solution.result.usable and guess is not None:
            solution = least_time(self.problem, self.agents[k], guess)
        if not solution.result.usable:
            self.message = f"Agent {k + 1}: {solution.message}"
            return False
        if not self.slowest or solution.duration > self.bound():
            self.program = self.walled = None
        self.slowest[k] = solution
        return True

    def moved_alike(self) -> list[Solution] | None:
        """Ways of all agents if they are one way shifted, in the least time."""
        ((first, solution),) = self.slowest.items()
        agent = self.agents[first]
        free = shiftable(self.problem)
        found = []
        for other in self.agents:
            offset = {n: other.starts[n] - agent.starts[n] for n in other.starts}
            ends = [other.ends[n] - agent.ends[n] - offset.get(n, 0.0)
                    for n in other.ends]  # fmt: skip
            moved = {n for n, value in offset.items() if abs(value) > _SAME}
            same = np.abs(ends).max(initial=0.0) <= _SAME and moved <= free
            if not same or dict(other.parameters) != dict(agent.parameters):
                return None
            found.append(shifted(solution, offset))
        return found

    # --- at one time ----------------------------------------------------------------

    def programs(self) -> tuple[LeastEffort, LeastEffort]:
        """Programs without and with walls, on the mesh of the slowest agent."""
        model = max(self.slowest.values(), key=lambda solution: solution.duration)
        if self.program is None or self.walled is None:
            rows = min(len(self.agents) - 1, 6)
            self.program = LeastEffort(self.problem, model, self.position, 0)
            self.walled = LeastEffort(self.problem, model, self.position, rows)
        return self.program, self.walled

    def alone(self, plan: Plan) -> int:
        """Solve each agent without regard to others; gives the one that fails."""
        program, _ = self.programs()
        model = max(self.slowest.values(), key=lambda solution: solution.duration)
        guess = model
        for k, agent in enumerate(self.agents):
            self.solves += 1
            solution = program.solve(agent, plan.duration, guess)
            if not solution.result.usable and guess is not model:
                self.solves += 1
                solution = program.solve(agent, plan.duration, model)
            if not solution.result.usable:
                self.message = f"Agent {k + 1} alone: {solution.message}"
                return k
            plan.found[k] = guess = solution
            plan.ways[k] = program.place(solution)
        return NOBODY

    def separate(self, plan: Plan) -> bool:
        """Plan those that come too near with regard to each other."""
        orders = Orders(self.programs(), self.agents, self.apart, plan)
        done = orders.separate(
            self.options.orders, self.options.passes, self.options.together
        )
        self.solves += orders.solves
        self.groups = tuple(sorted(orders.groups))
        self.joined = tuple(sorted(orders.joined))
        self.message = orders.message
        return done

    def flyable(self, plan: Plan) -> bool:
        """Whether the controls, flown, give the states."""
        program, _ = self.programs()
        worst = max(program.missed(solution) for solution in plan.found.values())
        return worst <= self.options.accuracy

    def finer(self) -> bool:
        """Refine both programs' meshes."""
        first, second = self.programs()
        # Both must have the same mesh, so neither is left out.
        return first.refine() & second.refine()

    def note(self, words: str) -> None:
        """Tell what is tried."""
        if self.options.progress is not None:
            self.options.progress(words)


def solve_agents(
    problem: Problem,
    agents: Sequence[Agent],
    *,
    position: Sequence[str],
    distance: float,
    metric: Sequence[float] | None = None,
    options: AgentsOptions | None = None,
) -> AgentsSolution:
    """Find ways for several agents in a common time near the least, apart throughout.

    Parameters
    ----------
    problem
        One phase, the duration as objective; what all agents have in common.
    agents
        Their ends and parameters.
    position
        States that make up the position.
    distance
        Every two agents are at least so far apart at every instant.
    metric
        Factors on the components of a difference before its length is taken; by
        default 1.

    Returns
    -------
    AgentsSolution
        ``SOLVED`` only if the clipped controls, integrated, keep to the states within
        the accuracy, and all agents are apart at every instant, by an audit of the
        polynomials. Its ``bound`` says how much shorter the common time could be at
        most.
    """
    chosen = options or AgentsOptions()
    scale = (1.0,) * len(position) if metric is None else tuple(metric)
    apart = Apart(distance, scale)
    work = _Work(problem, agents, position, apart, chosen)
    lengths = [float(np.abs(work.way_of(k)).max()) for k in range(len(agents))]
    if not work.solve_alone(int(np.argmax(lengths))):
        return _failed(work)
    alike = work.moved_alike()
    if alike is not None and _rounded(work.bound(), chosen) == work.bound():
        ways = {k: _places(s, work.position) for k, s in enumerate(alike)}
        if not conflicts(ways, apart):
            return AgentsSolution(
                Result.SOLVED, "", work.bound(), work.bound(), tuple(alike)
            )
    for gap in chosen.gaps:
        plan = _attempt(work, gap)
        if plan is not None:
            return AgentsSolution(
                Result.SOLVED,
                "",
                plan.duration,
                work.bound(),
                tuple(plan.found[k] for k in range(len(agents))),
                work.groups,
                work.joined,
                work.solves,
            )
    return _failed(work)


def _attempt(work: _Work, gap: float) -> Plan | None:
    """Plan all agents in the slowest one's least time and a little more."""
    while True:
        plan = Plan(_rounded(work.bound() * (1.0 + gap), work.options))
        work.note(f"{len(work.agents)} agents in {plan.duration:.6g}")
        failed = work.alone(plan)
        if failed != NOBODY:
            # It may be slower than the one that was thought to be the slowest.
            if failed in work.slowest or not work.solve_alone(failed):
                return None
            if work.slowest[failed].duration <= work.bound() * (1.0 - gap):
                return None
            continue
        if not work.separate(plan):
            return None
        if work.flyable(plan):
            return plan
        if not work.finer():
            work.message = "The controls, flown, miss the states."
            return None


def _places(solution: Solution, position: tuple[str, ...]) -> FloatArray:
    (part,) = solution.phases
    chosen = [part.state_names.index(name) for name in position]
    return np.asarray(part.states.coefficients[:, :, chosen])


def _rounded(duration: float, options: AgentsOptions) -> float:
    if options.round_up <= 0.0:
        return duration
    return float(np.ceil(duration / options.round_up - 1e-9) * options.round_up)


def _failed(work: _Work) -> AgentsSolution:
    bound = work.bound() if work.slowest else float("nan")
    message = f"{Result.INFEASIBLE.value} {work.message}"
    return AgentsSolution(
        Result.INFEASIBLE, message, float("nan"), bound, (), solves=work.solves
    )
