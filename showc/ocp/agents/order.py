"""Agents that come too near each other, planned in order of priority at a given time.

Each keeps to its side of planes between it and those planned before it; one that finds
no way moves up in the order (van den Berg, Overmars 2005, Prioritized motion planning
for multiple robots). If none of the orders works, those before leave room for those
after them; in the end small groups are solved in one problem
(:mod:`showc.ocp.agents.joined`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from showc.ocp.agents.joined import solve_joined
from showc.ocp.agents.walls import ASIDE, Walls, bent, clusters, conflicts, sampled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from showc.ocp.agents.agent import Agent, LeastEffort
    from showc.ocp.agents.walls import Apart, Side
    from showc.ocp.solution import Solution

    FloatArray = NDArray[np.float64]

NOBODY = -1
"""No agent failed."""
_ROUNDABOUT = 0.6
"""Radius of a circle on which n agents are apart, over the distance, by sin(pi / n)."""


@dataclass(slots=True)
class Plan:
    """Ways of all agents at one common time."""

    duration: float
    found: dict[int, Solution] = field(default_factory=dict)
    ways: dict[int, FloatArray] = field(default_factory=dict)
    """Bernstein coefficients of the positions, shape (K, degree + 1, n)."""


class Orders:
    """Changes a plan until all agents are apart.

    Parameters
    ----------
    programs
        The program of one agent, without and with half-spaces.
    agents
        All of them.
    apart
        What is to be kept.
    plan
        Ways without regard to each other; changed where that is needed.
    """

    def __init__(
        self,
        programs: tuple[LeastEffort, LeastEffort],
        agents: Sequence[Agent],
        apart: Apart,
        plan: Plan,
    ) -> None:
        self.program, self.walled = programs
        self.agents, self.apart, self.plan = agents, apart, plan
        self.free = dict(plan.found)
        self.solves = 0
        self.groups: set[tuple[int, ...]] = set()
        """Agents planned with regard to each other."""
        self.joined: set[tuple[int, ...]] = set()
        """Groups solved in one problem."""
        self.message = ""

    def separate(self, orders: int, passes: int, together: int) -> bool:
        """Plan those that come too near, until none do.

        Parameters
        ----------
        orders
            Orders of priority tried for each group.
        passes
            Times that the planes of one agent are laid anew about its way.
        together
            Greatest size of a group that is solved in one problem.
        """
        plan = self.plan
        free = dict(plan.ways)
        pairs = conflicts(plan.ways, self.apart)
        known: set[tuple[int, int]] = set()
        while pairs:
            if known >= set(pairs):
                return False
            known |= set(pairs)
            for group in clusters(known):
                if not any(set(pair) <= set(group) for pair in pairs):
                    continue
                self.groups = {g for g in self.groups if not set(g) <= set(group)}
                self.groups.add(group)
                if not self._group(group, free, orders, passes, together):
                    return False
            pairs = conflicts(plan.ways, self.apart)
        return True

    def _group(
        self,
        group: tuple[int, ...],
        free: dict[int, FloatArray],
        orders: int,
        passes: int,
        together: int,
    ) -> bool:
        """Plan one group: bent aside in several ways, without and with room.

        ``free``: the ways without regard to each other.
        """
        breaks = self.plan.found[0].phases[0].states.breaks
        fractions = (breaks - breaks[0]) / (breaks[-1] - breaks[0])
        wide = max(ASIDE, _ROUNDABOUT / np.sin(np.pi / len(group)))
        bends: list[tuple[Side, float, bool]] = [
            ("right", ASIDE, False),
            ("right", wide, True),
        ]
        if len(self.apart.metric) > 2:
            bends = [
                ("ring", wide, False),
                bends[0],
                ("over", ASIDE, False),
                ("ring", wide, True),
                bends[1],
            ]
        first = bent(free, fractions, group, self.apart)
        for side, aside, room in bends:
            start = bent(free, fractions, group, self.apart, side=side, aside=aside)
            if self._in_order(group, start, max(orders // len(bends), 1), passes, room):
                return True
        if len(group) <= together and self._in_one_problem(group, first):
            return True
        self.message = (
            f"Agents {', '.join(str(k + 1) for k in group)} find no ways past each "
            f"other in {self.plan.duration:.6g}."
        )
        return False

    def _in_order(
        self,
        group: tuple[int, ...],
        start: dict[int, FloatArray],
        orders: int,
        passes: int,
        room: bool,  # noqa: FBT001 - handed on
    ) -> bool:
        """Plan a group in order of priority; who finds no way moves up."""
        order = sorted(group, key=lambda k: (-self.free[k].objective, k))
        seen: set[tuple[int, ...]] = set()
        for tries in range(orders):
            if tuple(order) in seen:
                break
            seen.add(tuple(order))
            failed = self._one_order(order, start, passes, room=room)
            if failed == NOBODY:
                return True
            order.remove(failed)
            order.insert(0 if 2 * tries > orders else 1, failed)
        return False

    def _in_one_problem(
        self, group: tuple[int, ...], start: dict[int, FloatArray]
    ) -> bool:
        """Solve a group together, its pairs imposed where they come too near."""
        self.solves += 1
        found = solve_joined(
            self.program,
            [self.agents[k] for k in group],
            self.plan.duration,
            alone=[self.free[k] for k in group],
            start=[start[k] for k in group],
            apart=self.apart,
        )
        if found is None:
            return False
        self.plan.found |= dict(zip(group, found, strict=True))
        places = map(self.program.place, found)
        self.plan.ways |= dict(zip(group, places, strict=True))
        self.joined.add(group)
        return True

    def _one_order(
        self,
        order: list[int],
        start: dict[int, FloatArray],
        passes: int,
        *,
        room: bool,
    ) -> int:
        """Plan a group in one order; gives the agent that finds no way."""
        program, plan = self.walled, self.plan
        done: dict[int, FloatArray] = {}
        found: dict[int, Solution] = {}
        for number, k in enumerate(order):
            later = [start[other] for other in order[number + 1 :]] if room else []
            walls = Walls(list(done.values()), self.apart, program.walls, later)
            place, guess = start[k], plan.found[k]
            for _ in range(passes):
                laid = walls.about(place)
                self.solves += 1
                solution = program.solve(self.agents[k], plan.duration, guess, laid)
                if not solution.result.usable:
                    return k
                guess, way = solution, program.place(solution)
                if not any(self.apart.lacking(way, o) > 0.0 for o in done.values()):
                    break
                place = sampled(way)
            else:
                return k
            done[k], found[k] = way, guess
        plan.ways |= done
        plan.found |= found
        return NOBODY
