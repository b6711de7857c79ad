"""A few drones in one optimal control problem, kept apart from each other.

The squared distance of a pair is a polynomial on each interval; its Bernstein
coefficients are kept above the squared separation, so the pair is apart at every
instant. Pairs are added only when an audit finds them too near: idle pairs cost many
times the solve. The start is bent sideways, each drone to its own right.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from showc.solve.assembly import trajectory_of
from showc.solve.guess import flat_guess
from showc.solve.intervals import END_GRADING, finer, graded_widths, interval_count
from showc.solve.judgement import POSITION_ACCURACY, judge, refusal
from showc.solve.model import (
    POSITION,
    Aircraft,
    Bounds,
    add_drone,
    effort,
    limit_bounds,
)
from showc.trajectory import bernstein_basis, bernstein_basis_inverse

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from showc.flight import Trajectory
    from showc.ocp.staged import (
        StagedGuess,
        StagedSolution,
        StagedSolver,
        StagedTranscription,
    )
    from showc.solve.result import Status
    from showc.vehicle import Separation

    FloatArray = NDArray[np.float64]

EFFORT = 1e-3
SIDEWAYS = 0.8
"""Bend of the start, over the separation."""
APART = 1e-9
"""Violation of the separation that counts as rounding [m]."""
ROUNDS = 6
"""Greatest number of rounds in which pairs are added."""


@dataclass(frozen=True, slots=True, eq=False)
class JointResult:
    """How solving several drones together ended."""

    status: Status
    duration: float
    """Common time [s]."""
    trajectories: tuple[Trajectory, ...]
    """One for each drone, in order; empty unless solved."""
    pairs: tuple[tuple[int, int], ...]
    """Pairs whose separation had to be constrained."""
    message: str
    """Which constraint stood in the way, and where; empty if solved."""
    iterations: int
    solves: int

    @property
    def solved(self) -> bool:
        """Whether there are trajectories to fly."""
        return self.status == "solved"


def joint(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    separation: Separation,
    duration: float,
    *,
    accuracy: float = POSITION_ACCURACY,
) -> JointResult:
    """Fly two to six drones from hover to hover in a given common time, apart.

    Parameters
    ----------
    start, goal
        Positions, shape (n, 3) [m].
    separation
        Sphere or ellipsoid.
    duration
        Common time [s].
    accuracy
        Greatest distance between the controls integrated and a trajectory [m].
    """
    start, goal = np.array(start, dtype=np.float64), np.array(goal, dtype=np.float64)
    if separation.shape not in {"sphere", "ellipsoid"}:
        reason = f"the joint problem knows no separation {separation.shape!r}"
        return JointResult("limit", duration, (), (), reason, 0, 0)
    for drone, (a, b) in enumerate(zip(start, goal, strict=True)):
        if reason := refusal(aircraft, a, b):
            return JointResult(
                "limit", duration, (), (), f"drone {drone + 1}: {reason}", 0, 0
            )
    count: int | None = interval_count(duration, 16)
    solver: StagedSolver = "fatrop"
    pairs: tuple[tuple[int, int], ...] = ()
    iterations = solves = 0
    status: Status = "infeasible"
    message = ""
    for _ in range(ROUNDS):
        widths = graded_widths(duration, count or 16, END_GRADING)
        solution = _solve(aircraft, (start, goal), separation, pairs, (widths, solver))
        iterations, solves = iterations + solution.iterations, solves + 1
        if not solution.result.usable:
            status, message = "infeasible", solution.message
            if solver == "ipopt":
                break
            solver = "ipopt"
            continue
        flights = tuple(
            trajectory_of(aircraft, solution, a, b, duration, tag=f"_{k}")
            for k, (a, b) in enumerate(zip(start, goal, strict=True))
        )
        near = tuple(
            (i, j)
            for i, j in combinations(range(start.shape[0]), 2)
            if pair_distance_bound(flights[i], flights[j], separation)
            < separation.distance - APART
        )
        if missing := tuple(pair for pair in near if pair not in pairs):
            pairs += missing
            status = "infeasible"
            message = (
                f"drones {missing[0][0] + 1} and {missing[0][1] + 1} come too near"
            )
            continue
        verdicts = [judge(aircraft, flight, (), accuracy) for flight in flights]
        bad = next((v for v in verdicts if v.status != "solved"), None)
        if bad is None and not near:
            return JointResult(
                "solved", duration, flights, pairs, "", iterations, solves
            )
        if bad is not None:
            status, message = bad.status, bad.message
        count = finer(count or 16)
    return JointResult(status, duration, (), pairs, message, iterations, solves)


def pair_distance_bound(
    first: Trajectory, second: Trajectory, separation: Separation
) -> float:
    """Lower bound on the distance of two flights with equal breaks [m].

    In the separation's metric, from the Bernstein coefficients of the squared
    distance; never above the true least distance.
    """
    difference = (
        first.state.coefficients[:, :, :3] - second.state.coefficients[:, :, :3]
    ) * np.array(separation.metric_scale)
    degree = 2 * (difference.shape[1] - 1)
    nodes = tuple(float(s) for s in np.linspace(0.0, 1.0, degree + 1))
    values = np.einsum(
        "sk,ikc->isc", bernstein_basis(difference.shape[1] - 1, nodes), difference
    )
    squared = np.sum(values**2, axis=2) @ bernstein_basis_inverse(degree, nodes).T
    return float(np.sqrt(max(float(squared.min()), 0.0)))


@lru_cache(maxsize=8)
def _built(
    aircraft: Aircraft,
    drones: int,
    separation: Separation,
    pairs: tuple[tuple[int, int], ...],
    mesh: tuple[int, StagedSolver],
) -> StagedTranscription:
    # The core loads casadi, which checking a script must not.
    from showc.ocp.problem import Problem  # noqa: PLC0415
    from showc.ocp.staged import StagedOptions, StagedTranscription  # noqa: PLC0415

    problem = Problem("joint")
    phase = problem.phase("leg", duration=(0.05, 10_000.0))
    running: Any = 0
    for drone in range(drones):
        add_drone(phase, problem, aircraft, f"_{drone}")
        running += effort(phase, aircraft, f"_{drone}")
    for i, j in pairs:
        squared = sum(
            (
                factor
                * (
                    phase.states[f"{axis}_{i}"].quantity.symbol
                    - phase.states[f"{axis}_{j}"].quantity.symbol
                )
            )
            ** 2
            for axis, factor in zip(POSITION, separation.metric_scale, strict=True)
        )
        phase.constrain(squared, 0.0, None, name=f"separation {i} {j}", scale=10.0)
    problem.minimise(phase.integral(EFFORT * running))
    intervals, solver = mesh
    return StagedTranscription(
        problem, intervals, options=StagedOptions(solver=solver, iterations=300)
    )


def _solve(
    aircraft: Aircraft,
    ends: tuple[FloatArray, FloatArray],
    separation: Separation,
    pairs: tuple[tuple[int, int], ...],
    mesh: tuple[FloatArray, StagedSolver],
) -> StagedSolution:
    """Solve all drones together with the given pairs constrained."""
    (start, goal), (widths, solver) = ends, mesh
    drones = start.shape[0]
    program = _built(
        aircraft.canonical(),
        drones,
        separation,
        pairs,
        (widths.size, solver),
    )
    parameters = {
        f"{name}_{axis}_{drone}": float(places[drone, k])
        for name, places in (("start", start), ("goal", goal))
        for drone in range(drones)
        for k, axis in enumerate(POSITION)
    }
    bounds: Bounds = {}
    for drone in range(drones):
        bounds |= limit_bounds(aircraft, f"_{drone}")
    least = separation.distance**2
    for i, j in pairs:
        bounds["path", f"separation {i} {j}"] = least, np.inf
    involved = {drone for pair in pairs for drone in pair}
    guesses = [
        _bent(
            flat_guess(aircraft, start[drone], goal[drone], widths),
            goal[drone] - start[drone],
            widths,
            SIDEWAYS * separation.distance if drone in involved else 0.0,
        )
        for drone in range(drones)
    ]
    from showc.ocp.staged import StagedGuess  # noqa: PLC0415 - loads casadi

    return program.solve(
        widths=widths,
        guess=StagedGuess(
            np.hstack([guess.states for guess in guesses]),
            np.hstack([guess.controls for guess in guesses]),
        ),
        parameters=parameters,
        bounds=bounds,
    )


def _bent(
    guess: StagedGuess, way: FloatArray, widths: FloatArray, aside: float
) -> StagedGuess:
    """Push a guess ``aside`` [m] in the middle, to the drone's own right."""
    across = np.array([way[1], -way[0], 0.0])
    length = float(np.linalg.norm(across))
    if aside == 0.0 or length < 1e-9:
        return guess
    times = np.concatenate([[0.0], np.cumsum(widths)])
    fraction = times / times[-1]
    bump = 16.0 * (fraction * (1.0 - fraction)) ** 2
    slope = 32.0 * fraction * (1.0 - fraction) * (1.0 - 2.0 * fraction) / times[-1]
    states = guess.states.copy()
    states[:, 0:3] += aside * np.outer(bump, across / length)
    states[:, 3:6] += aside * np.outer(slope, across / length)
    return type(guess)(states, guess.controls)
