"""The slowest drones of a leg: their minimum times, and the proof of a lower bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.fleet.lower_bound.bound import lower_bound
from showc.fleet.lower_bound.relaxation import HOVERS, Relaxation
from showc.fleet.shared_profile.estimate import minimum_time_estimate
from showc.fleet.shared_profile.synchronise import ROUGHLY, SHAPES, least_times
from showc.fleet.single_drone.shortest import minimum_time
from showc.fleet.single_drone.symmetry import images, kinds
from showc.plan.itinerary import STILL

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from showc.arrays import FloatArray, IntArray
    from showc.fleet.execution.pool import Workers
    from showc.fleet.single_drone.model import Aircraft
    from showc.fleet.single_drone.result import Result
    from showc.flight import DualWitness
    from showc.progress import Progress
    from showc.script.fence import Fence


_CANDIDATES = 12
"""Moves of a leg that may be its slowest: half by straight distance, half by axes."""
_STRAIGHT_ERROR = 1.01
"""How much longer a straight flight may take than its first look says, at most."""
_SOLVED_AT_LEAST, _SOLVED_AT_MOST = 1, 2
"""Straight flights solved of a leg: the second, where the bounds hardly differ."""
_ROUNDS = 8
"""Linear programs of a bound at most."""
_SCATTER = 0.01
"""Straight flights are solved whose bounds differ by less than this share, one or two:
which drone is the slowest, bounds cannot tell closer."""


@dataclass(frozen=True, slots=True, eq=False)
class Limiting:
    """What bounds the common time of a leg from below."""

    time: float
    """Greatest minimum time found of any single drone [s]."""
    drone: int
    """Row of that drone in the leg."""
    distance: float
    """Length of its way [m]."""
    witness: DualWitness
    """Proof of the greatest rigorous bound; ``drone`` in it is a row of the leg."""
    solves: int
    """Minimum-time problems solved."""
    bounds: int
    """Moves for which a bound was proved."""
    flights: dict[int, Result]
    """Minimum-time flights by row."""


def limiting_time(
    aircraft: Aircraft,
    start: FloatArray,
    goal: FloatArray,
    workers: Workers,
    progress: Progress,
    *,
    name: str = "",
    solve: bool = True,
) -> Limiting:
    """Find the drones that need the longest, and prove how long they need.

    The first candidates are the moves with the longest straight flights and the longest
    single-axis times; each gets a rigorous bound. So does every corner of the hull of
    all moves whose straight flight takes longer than the greatest of these: no other
    move can have a greater bound (see :mod:`showc.fleet.lower_bound.extremes`).
    Minimum times are solved for those with the greatest bounds. A drone that is slower
    still would only make the reported gap look larger than it is, never smaller.

    Parameters
    ----------
    start, goal
        Shape (n, 3) [m]; at least one drone moves.
    name
        Of the leg, for people.
    solve
        Whether to solve minimum times at all; else the greatest rigorous bound of the
        first candidates stands for them: where the script gives the time, no gap is
        reported that the others could widen.
    """
    displacement = goal - start
    moving = np.flatnonzero(np.linalg.norm(displacement, axis=1) > STILL)
    # Moves that differ by rounding alone, or as mirror images do, are one.
    distinct, rows = np.unique(
        kinds(aircraft, displacement[moving])[0], axis=0, return_index=True
    )
    rows = moving[rows]
    straight = _straight(aircraft, distinct)
    relaxation = Relaxation(
        aircraft.vehicle, aircraft.limits, aircraft.yaw, aircraft.heading
    )

    def bounded(chosen: IntArray, least: float) -> list[DualWitness]:
        """Prove bounds, as great as can be where they are beyond the ``least`` [s]."""
        progress.stage(f"{name}: lower bounds", chosen.size)
        tasks = []
        for row in rows[chosen].tolist():
            guess = least or _guess(relaxation, displacement[row])
            move = relaxation, row, displacement[row], guess
            tasks.append((*move, _ROUNDS, HOVERS, least > 0.0))
        return workers.run(lower_bound, tasks, progress.advance)

    candidates = _candidates(aircraft, distinct, straight)
    candidates = candidates[np.argsort(-straight[candidates], kind="stable")]
    # The first has the longest straight flight: few of the others take longer.
    witnesses = bounded(candidates[:1], 0.0)
    witnesses += bounded(candidates[1:], witnesses[0].time)
    greatest = max(witness.time for witness in witnesses)
    rest = np.empty(0, dtype=np.int64)
    if solve:
        slower = np.flatnonzero(straight * _STRAIGHT_ERROR > greatest)
        rest = _corners(aircraft, distinct, np.setdiff1d(slower, candidates))
    if rest.size:
        candidates = np.concatenate([candidates, rest])
        witnesses += bounded(rest, greatest)
    proved = np.array([witness.time for witness in witnesses])
    order = np.lexsort((candidates, -proved))
    near = proved[order] > proved[order[0]] * (1.0 - _SCATTER)
    wanted = int(np.clip(near.sum(), _SOLVED_AT_LEAST, _SOLVED_AT_MOST))
    chosen = [int(rows[candidates[index]]) for index in order[:wanted]]
    best = witnesses[int(order[0])]
    if not solve:
        length = float(np.linalg.norm(displacement[chosen[0]]))
        return Limiting(best.time, chosen[0], length, best, 0, len(witnesses), {})
    flights = _flown(
        {row: (aircraft, start[row], goal[row]) for row in chosen},
        workers,
        progress,
        name,
    )
    if flights:
        slowest, time = _slowest(flights)
    else:
        # The straight flight is always there; the gap is then measured against it.
        times = least_times(
            aircraft.vehicle,
            aircraft.limits,
            aircraft.heading,
            displacement[chosen],
            SHAPES,
        ).min(axis=1)
        slowest, time = chosen[int(np.argmax(times))], float(times.max())
    return Limiting(
        max(time, best.time),
        slowest,
        float(np.linalg.norm(displacement[slowest])),
        best,
        len(chosen),
        len(witnesses),
        flights,
    )


def limiting_in_motion(
    aircraft: Aircraft,
    ends: Sequence[tuple[FloatArray, FloatArray]],
    workers: Workers,
    progress: Progress,
    *,
    name: str = "",
    solve: bool = True,
) -> Limiting:
    """Do the same where drones do not hover at both ends.

    Bounds are proved for the moves that an estimate calls the longest. A slower drone
    that was left out shows when it finds no flight in the common time.

    Parameters
    ----------
    ends
        Start and goal of each drone: a place (3,) to hover at, or a state (13,).
    """
    both = np.array([[aircraft.end(end) for end in pair] for pair in ends])
    way = both[:, 1, :3] - both[:, 0, :3]
    estimate = minimum_time_estimate(aircraft, both[:, 0], both[:, 1])[1]
    candidates = np.argsort(-estimate, kind="stable")[:_CANDIDATES]
    # Drones that hover among others in motion bound nothing.
    moving = np.count_nonzero(estimate[candidates] > 0.0)
    candidates = candidates[: max(moving, 1)]
    relaxation = Relaxation(
        aircraft.vehicle, aircraft.limits, aircraft.yaw, aircraft.heading
    )
    progress.stage(f"{name}: lower bounds", candidates.size)
    witnesses: list[DualWitness] = workers.run(
        lower_bound,
        [
            (relaxation, row, way[row], float(estimate[row]), _ROUNDS, both[row])
            for row in candidates.tolist()
        ],
        progress.advance,
    )
    proved = np.array([witness.time for witness in witnesses])
    order = np.argsort(-proved, kind="stable")
    best = witnesses[int(order[0])]
    slowest, time = int(candidates[order[0]]), best.time
    flights: dict[int, Result] = {}
    if solve:
        chosen = candidates[order[:_SOLVED_AT_MOST]].tolist()
        flights = _flown(
            {row: (aircraft, *ends[row]) for row in chosen}, workers, progress, name
        )
        if flights:
            slowest, longest = _slowest(flights)
            time = max(time, longest)
    return Limiting(
        time,
        slowest,
        float(np.linalg.norm(way[slowest])),
        best,
        _SOLVED_AT_MOST if solve else 0,
        len(witnesses),
        flights,
    )


def _flown(
    moves: Mapping[int, tuple[Any, ...]],
    workers: Workers,
    progress: Progress,
    name: str,
) -> dict[int, Result]:
    """Solve the minimum times of some moves, by drone; leave out those without one."""
    progress.stage(f"{name}: minimum times", len(moves))
    results: list[Result] = workers.run(
        minimum_time, list(moves.values()), progress.advance
    )
    return {
        row: result for row, result in zip(moves, results, strict=True) if result.solved
    }


def _slowest(flights: Mapping[int, Result]) -> tuple[int, float]:
    """Return the drone with the longest flight, the first of several, and its time."""
    slowest = max(flights, key=lambda row: (flights[row].duration, -row))
    return slowest, flights[slowest].duration


def _straight(aircraft: Aircraft, displacement: FloatArray) -> FloatArray:
    """Return times (n,) in which the moves can be flown straight, to a percent [s]."""
    times = least_times(
        aircraft.vehicle,
        aircraft.limits,
        aircraft.heading,
        displacement,
        SHAPES[::29],
        ROUGHLY,
    )
    return np.asarray(times.min(axis=1))


def _corners(
    aircraft: Aircraft, displacement: FloatArray, wanted: IntArray
) -> IntArray:
    """Rows of those of the ``wanted`` moves that may have the greatest bound of all."""
    if not wanted.size:
        return wanted
    # HiGHS is loaded only where something is solved.
    from showc.fleet.lower_bound.extremes import extreme_moves  # noqa: PLC0415

    signs = images(aircraft)
    every = (displacement[:, None] * signs).reshape(-1, 3)
    # What holds of a move holds of its images.
    corners = extreme_moves(every, wanted * len(signs)) // len(signs)
    return np.intersect1d(wanted, corners)


def _candidates(
    aircraft: Aircraft, displacement: FloatArray, straight: FloatArray
) -> IntArray:
    """Choose moves that may be the slowest, by two cheap measures."""
    if displacement.shape[0] <= _CANDIDATES:
        return np.arange(displacement.shape[0])
    velocity = np.where(
        displacement > 0.0,
        np.asarray(aircraft.limits.velocity_max),
        np.asarray(aircraft.limits.velocity_min),
    )
    axis = (displacement / velocity).max(axis=1)
    half = _CANDIDATES // 2
    return np.union1d(
        np.argsort(-straight, kind="stable")[:half],
        np.argsort(-axis, kind="stable")[:half],
    )


def _guess(relaxation: Relaxation, displacement: FloatArray) -> float:
    """Guess a time near the least one: the slowest axis, speeding up at half a g."""
    limits = relaxation.limits
    velocity = np.where(
        displacement > 0.0,
        np.asarray(limits.velocity_max),
        np.abs(np.asarray(limits.velocity_min)),
    )
    way = np.abs(displacement)
    pull = 0.5 * relaxation.vehicle.gravity
    ramp = np.minimum(velocity / pull, np.sqrt(way / pull))
    return float((way / velocity + ramp).max())


def least_time_within(
    aircraft: Aircraft, fence: Fence, start: FloatArray, goal: FloatArray
) -> float:
    """Time that no way over ground within a fence falls short of, rest to rest [s].

    However a way turns, speed along it changes by the level acceleration at most, and
    stays below the greatest level speed. So does its share of the greatest speed in its
    direction, which is a norm of the velocity.

    Parameters
    ----------
    start, goal
        Shape (2,) [m].
    """
    limits, vehicle = aircraft.limits, aircraft.vehicle
    box = np.maximum(limits.velocity_max, np.abs(limits.velocity_min))[:2]
    level = limits.level_speed or np.inf
    thrust = min(limits.thrust_max, vehicle.thrust_max) / vehicle.mass
    pull = min(thrust * np.sin(limits.tilt), limits.acceleration or np.inf)

    def cruised(ways: FloatArray) -> FloatArray:
        size = np.hypot(ways[:, 0], ways[:, 1])
        return np.asarray(np.maximum((np.abs(ways) / box).max(axis=1), size / level))

    fastest = min(float(np.hypot(box[0], box[1])), level)
    slowest = min(float(box.min()), level)
    return max(
        _from_rest(fence.least_length(start, goal), fastest, pull),
        _from_rest(fence.least_length(start, goal, cruised) * slowest, slowest, pull),
    )


def _from_rest(length: float, speed: float, pull: float) -> float:
    """Least time from rest to rest over a length [m], at a speed [m/s] at most [s]."""
    if length >= speed**2 / pull:
        return float(length / speed + speed / pull)
    return float(2.0 * np.sqrt(length / pull))
