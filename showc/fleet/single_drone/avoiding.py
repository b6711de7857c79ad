"""One drone in a given time by optimal control, on its side of moving walls.

The walls are soft: the squared lack of distance behind them is priced in the
objective, at the nodes of the running cost. The program is then never without a
solution, however the walls lie, and what is left of a conflict shows in continuous
time afterwards. As few steps as can be: what comes out is judged by the true limits, so
the solver need not converge far.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.shared_profile.straight import followed
from showc.fleet.single_drone.assembly import trajectory_of
from showc.fleet.single_drone.convex_program import NO_WALLS, WALL_DEGREE
from showc.fleet.single_drone.guess import flat_guess, flown_guess
from showc.fleet.single_drone.intervals import (
    COUNTS,
    END_GRADING,
    graded_widths,
    interval_count,
)
from showc.fleet.single_drone.judgement import Flights, Verdict, judge
from showc.fleet.single_drone.model import POSITION, SIGNALS, add_drone, effort
from showc.fleet.single_drone.programs import Programs
from showc.ocp.refinement.strategy import refine
from showc.trajectory import bernstein_basis

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.fleet.single_drone.convex_program import Walls
    from showc.fleet.single_drone.model import Aircraft
    from showc.flight import Trajectory
    from showc.ocp.problem import Problem
    from showc.ocp.solution import Solution
    from showc.ocp.transcription.condensed.transcription import CondensedTranscription
    from showc.trajectory import PiecewisePolynomial


SLOTS = 4
"""Walls that count at any one instant: the nearest ones."""
EFFORT = 1e-2
"""Weight of effort beside the squared distances."""
NEARNESS = 10.0
"""Weight of the squared distance to the reference over the squared length."""
STIFFNESS = 100.0
"""Price of the squared lack of distance behind a wall [1/m²]."""
INTERVALS = 24
"""Intervals of the coarsest program: one serves a drone before and after walls are
laid, and building two takes longer."""
EASE, HEAVIEST = 0.25, 300.0
"""Time next to either end in which a drone cannot be far aside [s], and how much more
a lack may count there: of 23 tries between places at the separation 18 came out, not
13, for a fifth less work."""
LONGEST = 0.35
"""Longest interval along a wall [s]: drones turn aside within about a second."""
TOLERANCE, BARRIER, INSET = 1e-3, 0.1, 1e-5
"""The solver ends at this error, begins with this barrier parameter, and keeps so far
within its bounds, scaled: a flight is judged, and polished, afterwards."""

# What a program is given for each wall: its normal and its offset.
WALL_SIGNALS = tuple(
    f"wall_{slot}_{part}" for slot in range(SLOTS) for part in (*POSITION, "offset")
)


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """Walls on one side of which a drone passes."""

    walls: Walls
    """On even intervals of the flight, as many as ``way`` has."""
    way: PiecewisePolynomial | None = None
    """The way about which they were laid, 3 components [m]; None: no walls."""
    clearance: float = 0.0
    """How far behind them to aim [m]: soft walls give way a little."""


OPEN = Passage(NO_WALLS)
"""Without walls."""


def avoid(  # noqa: PLR0917 - tasks of workers are tuples
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    reference: PiecewisePolynomial,
    passage: Passage = OPEN,
    earlier: Trajectory | None = None,
    shortest: Trajectory | None = None,
) -> Trajectory | None:
    """Fly from end to end, near a reference, on the right side of walls.

    Parameters
    ----------
    start, goal
        Places to hover at, shape (3,) [m], or states and thrusts (13,).
    reference
        Share of the way by time (one component), or positions (three) [m]; its end
        is the duration.
    passage
        The walls.
    earlier
        A flight of the same drone in the same time, to start from, on its intervals.
    shortest
        Its flight in least time, if it is known: gives the intervals else.

    Returns
    -------
    Trajectory or None
        Keeps every limit at every instant; the walls as far as it can. None if
        none was found.
    """
    duration, walls = reference.end, passage.walls
    if earlier is not None:
        borders, why = earlier.state.breaks, "the mesh of the flight before"
    elif shortest is not None:
        borders = shortest.state.breaks * (duration / shortest.state.end)
        why = "the mesh of the flight in least time, stretched"
    else:
        count = interval_count(duration, INTERVALS)
        widths = graded_widths(duration, count, END_GRADING)
        borders = np.concatenate([[0.0], np.cumsum(widths)])
        why = "graded towards both ends"
    pieces = passage.way.intervals if passage.way else 1
    widths = _cut(borders, walls, duration, pieces)
    programs = Programs(aircraft, start, goal)
    guesses = [flat_guess(aircraft, start, goal, widths, reference)]
    if (flown := earlier or shortest) is not None:
        guesses.insert(0, flown_guess(aircraft, flown, widths))
        programs.meshes += flown.meshes
    if walls.interval.size:
        why += ", cut along the walls of other drones"
    program = _built(aircraft.canonical(), widths.size)
    breaks = np.concatenate([[0.0], np.cumsum(widths)])
    nodes = np.array(program.stage.cost_nodes)
    times = breaks[:-1, None] + widths[:, None] * nodes
    signals = np.zeros((*times.shape, len(SIGNALS) + len(WALL_SIGNALS)))
    signals[..., :3] = followed(reference, start[:3], goal[:3], times)
    laid = _laid(passage, times.ravel())
    signals[..., 3:] = laid.reshape(*times.shape, -1)
    length = max(float(np.linalg.norm(goal[:3] - start[:3])), 1.0)
    weights = {
        "effort": EFFORT,
        "nearness": NEARNESS / length**2,
        "stiffness": STIFFNESS if walls.interval.size else 0.0,
    }

    def judged(solution: Solution) -> Verdict:
        flight = trajectory_of(aircraft, solution, start, goal, duration)
        return judge(aircraft, flight)

    solutions = (
        programs.solve(program, widths, guess, weights, why=why, signals=signals)
        for guess in guesses
    )
    verdict = refine(Flights(programs, solutions, judged))
    return verdict.result(programs).trajectory if verdict else None


def _cut(
    borders: FloatArray, walls: Walls, duration: float, intervals: int
) -> FloatArray:
    """Widths of mesh intervals, short along walls, of a number that programs have."""
    walled = np.zeros(intervals + 1, dtype=np.int64)
    walled[np.unique(walls.interval) + 1] = 1
    before = np.cumsum(walled)
    first = np.floor(borders[:-1] / duration * intervals + 1e-9).astype(np.int64)
    last = np.ceil(borders[1:] / duration * intervals - 1e-9).astype(np.int64)
    touched = before[np.minimum(last, intervals)] > before[np.minimum(first, intervals)]
    widths = np.diff(borders)
    parts = np.where(touched, np.ceil(widths / LONGEST - 1e-9), 1.0).astype(np.int64)
    wanted = max(int(parts.sum()), INTERVALS)
    count = next((c for c in COUNTS if c >= wanted), None)
    if count is None:
        return widths
    while parts.sum() < count:
        parts[np.argmax(widths / parts)] += 1
    cut = np.repeat(widths / parts, parts)
    return np.asarray(cut * (duration / cut.sum()))


def _laid(passage: Passage, times: FloatArray) -> FloatArray:
    """Lay out the walls that count at each time: normals and offsets, (n, SLOTS, 4).

    Both are multiplied by what lacks count more there.
    Slots that are not needed hold a wall that is kept everywhere.
    """
    walls, present = passage.walls, passage.way
    laid = np.zeros((times.size, SLOTS, 4))
    laid[..., 3] = -1.0
    if present is None or not walls.interval.size:
        return laid
    place = times / present.end * present.intervals
    at = np.clip(place.astype(np.int64), 0, present.intervals - 1)
    wall, time = np.nonzero(walls.interval[:, None] == at)
    share = (place - at)[time]
    normal = (1.0 - share)[:, None] * walls.normal[wall, 0]
    normal += share[:, None] * walls.normal[wall, 1]
    basis = bernstein_basis(WALL_DEGREE, share)
    ahead = np.minimum(times, present.end - times)[time]
    clearance, weight = _cleared(passage, ahead)
    offset = np.einsum("nk,nk->n", basis, walls.offset[wall]) + clearance
    lack = offset - np.einsum("nc,nc->n", normal, present(times[time]))
    order = np.lexsort((wall, -lack, time))
    time, weight = time[order], weight[order]
    normal, offset = weight[:, None] * normal[order], weight * offset[order]
    slot = np.arange(time.size) - np.searchsorted(time, time)
    keep = slot < SLOTS
    laid[time[keep], slot[keep], :3] = normal[keep]
    laid[time[keep], slot[keep], 3] = offset[keep]
    return laid


def _cleared(passage: Passage, ahead: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ease the aim behind walls next to the ends, and raise the price of lacks.

    A drone leaves rest with its jerk, so it gets aside with the third power of time.
    Of neighbours that stand at the separation, micrometres are a conflict there.

    Parameters
    ----------
    ahead
        Times to the nearer end [s].

    Returns
    -------
    tuple
        How far behind walls to aim [m], and by what walls count more, each (n,).
    """
    eased = np.clip(ahead / EASE, 0.0, 1.0) ** 3
    return passage.clearance * eased, 1.0 / np.maximum(eased, 1.0 / HEAVIEST)


@lru_cache(maxsize=16)
def _built(aircraft: Aircraft, intervals: int) -> CondensedTranscription:
    # The core loads casadi, which checking a script must not.
    from showc.ocp.transcription.condensed.transcription import (  # noqa: PLC0415
        CondensedOptions,
        CondensedTranscription,
    )
    from showc.ocp.transcription.solver import SolverOptions  # noqa: PLC0415

    return CondensedTranscription(
        _problem(aircraft),
        intervals,
        signals=(*SIGNALS, *WALL_SIGNALS),
        options=CondensedOptions(
            SolverOptions(
                "fatrop", tolerance=TOLERANCE, iterations=120, barrier=BARRIER
            ),
            inset=INSET,
        ),
    )


def _problem(aircraft: Aircraft) -> Problem:
    """State the problem; its parameters are the ends, weights and signals."""
    import casadi  # noqa: PLC0415 - as above

    from showc.ocp.problem import Problem  # noqa: PLC0415 - as above

    problem = Problem("avoiding drone")
    phase = problem.phase("leg", duration=(0.05, 10_000.0))
    add_drone(phase, problem, aircraft)
    position = [phase.states[axis].quantity.symbol for axis in POSITION]
    running = problem.parameter("effort", EFFORT) * effort(phase, aircraft)
    wanted = [problem.parameter(name) for name in SIGNALS]
    nearness = problem.parameter("nearness", 0.0)
    running += nearness * sum(
        (a - b) ** 2 for a, b in zip(position, wanted, strict=True)
    )
    stiffness = problem.parameter("stiffness", 0.0)
    for slot in range(SLOTS):
        normal = [problem.parameter(f"wall_{slot}_{axis}") for axis in POSITION]
        along = sum(a * b for a, b in zip(normal, position, strict=True))
        lack = problem.parameter(f"wall_{slot}_offset") - along
        running += stiffness * casadi.fmax(lack, 0.0) ** 2
    problem.minimise(phase.integral(running))
    return problem
