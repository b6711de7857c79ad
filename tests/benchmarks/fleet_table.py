"""Fleets in minimum time: the table of cases, beside what others would fly.

Run ``python tests/benchmarks/fleet_table.py --help``. Each case solves one transition
from scratch (no cache) and prints: drones, wall-clock and processor time, peak memory,
the common time, how much that is over the greatest single-drone minimum and over the
rigorous bound, the nearest pair, and how the drones are flown. From the same run:

- ``ruckig``: one shared straight-line profile by ruckig (Berscheid and Kroeger 2021)
  under the same velocity limits, the acceleration of level flight at the greatest tilt
  and the jerk of the greatest body rate; and how many drones it takes beyond a limit of
  the full dynamics.
- ``law``: T = max(1.5 d / v, sqrt(6 d / a)) for the longest way, the duration law of
  common show tools.
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from showc.errors import ShowError
from showc.plan.assignment import assign
from showc.plan.itinerary import Leg
from showc.progress import Silent
from showc.solve import SolveOptions, solve_leg
from showc.solve.flat import attitude
from showc.solve.pool import workers
from showc.solve.replay import replay
from showc.vehicle import DEFAULT_PRESET, PRESETS, Separation

PRESET = PRESETS[DEFAULT_PRESET]
LIMITS = replace(
    PRESET.limits,
    position_min=(-1000.0, -1000.0, -1.0),
    position_max=(1000.0, 1000.0, 1000.0),
)


def grid(drones: int, spacing: float) -> np.ndarray:
    """Level square grid, 10 m up."""
    side = math.ceil(math.sqrt(drones))
    index = np.arange(drones)
    places = np.column_stack([index % side, index // side]) - (side - 1) / 2.0
    return np.column_stack([spacing * places, np.full(drones, 10.0)])


def spaced(points: np.ndarray, spacing: float, height: float) -> np.ndarray:
    """Scale so that the nearest pair is ``spacing`` apart, lowest place at height."""
    from scipy.spatial import cKDTree

    nearest = cKDTree(points).query(points, k=2)[0][:, 1].min()
    scaled = points * (spacing / nearest)
    return scaled - [0.0, 0.0, scaled[:, 2].min() - height]


def sphere(drones: int, spacing: float) -> np.ndarray:
    """Golden-angle spiral on a sphere."""
    index = np.arange(drones) + 0.5
    polar = np.arccos(1.0 - 2.0 * index / drones)
    turn = np.pi * (1.0 + math.sqrt(5.0)) * index
    unit = np.column_stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)]
    )
    return spaced(unit, spacing, 15.0)


def wall(drones: int, spacing: float) -> np.ndarray:
    """Upright picture, four times as wide as high, as a line of text is."""
    high = math.ceil(math.sqrt(drones / 4.0))
    index = np.arange(drones)
    across = index // high - drones / high / 2.0
    upright = np.column_stack([across, np.zeros(drones), index % high])
    return spaced(upright, spacing, 15.0)


def helix(drones: int, spacing: float) -> np.ndarray:
    """Double helix."""
    index = np.arange(drones)
    turn = 0.35 * (index // 2) + np.pi * (index % 2)
    points = np.column_stack([6.0 * np.cos(turn), 6.0 * np.sin(turn), 0.12 * index])
    return spaced(points, spacing, 12.0)


def cube(drones: int, spacing: float) -> np.ndarray:
    """Solid cube."""
    side = math.ceil(drones ** (1.0 / 3.0))
    index = np.arange(drones)
    points = np.column_stack([index % side, index // side % side, index // side**2])
    return spaced(points - [(side - 1) / 2.0, (side - 1) / 2.0, 0.0], spacing, 12.0)


def matched(start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Give out the places as the planner does."""
    return goal[assign(start, goal, Separation(1.0)).places]


def swap(drones: int) -> tuple[np.ndarray, np.ndarray]:
    """Everyone to the opposite place of a circle, neighbours 6 m apart."""
    angle = 2.0 * np.pi * np.arange(drones) / drones
    radius = 3.0 / np.sin(np.pi / drones)
    places = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    high = np.full(drones, 20.0)
    return np.column_stack([places, high]), np.column_stack([-places, high])


def shuffled(drones: int) -> tuple[np.ndarray, np.ndarray]:
    """Grid to sphere, places given out at random."""
    order = np.random.default_rng(1).permutation(drones)
    return grid(drones, 2.0), sphere(drones, 2.0)[order]


def pair(first, second, drones: int, spacing: float = 2.0):
    """Two formations, optimally assigned."""
    start = first(drones, spacing)
    return start, matched(start, second(drones, spacing))


CASES = {
    "100 grid-sphere": lambda: pair(grid, sphere, 100),
    "1000 grid-sphere": lambda: pair(grid, sphere, 1000),
    "1000 sphere-text": lambda: pair(sphere, wall, 1000),
    "1000 text-helix": lambda: pair(wall, helix, 1000),
    "1000 helix-cube": lambda: pair(helix, cube, 1000),
    "1000 random": lambda: shuffled(1000),
    "1000 spacing 1.2": lambda: pair(grid, sphere, 1000, 1.2),
    "5000 grid-sphere": lambda: pair(grid, sphere, 5000),
    "200 random": lambda: shuffled(200),
    "6 swap": lambda: swap(6),
    "12 swap": lambda: swap(12),
    "24 swap": lambda: swap(24),
}


def ruckig_profile(way: np.ndarray) -> tuple[float, int, float]:
    """Time of ruckig's shared profile, drones beyond a limit, and the worst use."""
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    gravity = PRESET.vehicle.gravity
    pull = gravity * math.tan(LIMITS.tilt)
    longest = float(np.linalg.norm(way, axis=1).max())
    wanted = InputParameter(1)
    wanted.current_position, wanted.target_position = [0.0], [1.0]
    axis = np.abs(way).max()
    wanted.max_velocity = [LIMITS.velocity_max[0] / axis]
    wanted.max_acceleration = [pull / longest]
    wanted.max_jerk = [gravity * LIMITS.body_rate[0] / longest]
    flight = Trajectory(1)
    if Ruckig(1).calculate(wanted, flight) not in (Result.Working, Result.Finished):
        raise RuntimeError("ruckig found no profile")
    times = np.linspace(0.0, flight.duration, 400)
    second = np.array([flight.at_time(float(t))[2][0] for t in times])
    third = np.gradient(second, times)
    thrust = way[:, None, :] * second[:, None]
    thrust[..., 2] += gravity
    turning = way[:, None, :] * third[:, None]
    flown = attitude(thrust, turning, np.zeros_like(turning), 0.0)
    use = np.maximum(
        np.abs([flown.roll[0], flown.pitch[0]]).max(axis=(0, 2)) / LIMITS.tilt,
        np.abs([flown.roll[1], flown.pitch[1]]).max(axis=(0, 2)) / LIMITS.body_rate[0],
    )
    return flight.duration, int((use > 1.001).sum()), float(use.max())


def duration_law(way: np.ndarray) -> float:
    """T = max(1.5 d / v, sqrt(6 d / a)) for the longest way [s]."""
    longest = float(np.linalg.norm(way, axis=1).max())
    pull = PRESET.vehicle.gravity * math.tan(LIMITS.tilt)
    return max(1.5 * longest / LIMITS.velocity_max[0], math.sqrt(6 * longest / pull))


def measure(name: str, jobs: int | None) -> str:
    """Solve one case; a row of the table."""
    start, goal = CASES[name]()
    drones = start.shape[0]
    show = SimpleNamespace(
        vehicle=PRESET.vehicle, separation=Separation(1.0), yaw="held", heading=0.0
    )
    leg = Leg(
        0, name, "transition", np.arange(drones), start, goal, "a", "b",
        np.arange(drones), LIMITS, None, (), None,
    )  # fmt: skip
    wall_clock, processor = time.perf_counter(), _processor()
    with workers(jobs, None) as crew:
        flight = solve_leg(leg, show, SolveOptions(use_cache=False), crew, Silent())
    wall_clock = time.perf_counter() - wall_clock
    processor = _processor() - processor
    error = float(replay(PRESET.vehicle, flight.trajectories).position.max())
    certificate = flight.certificate
    peer, broken, use = ruckig_profile(goal - start)
    memory = max(
        resource.getrusage(who).ru_maxrss
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return (
        f"| {name} | {wall_clock:.1f} | {processor:.1f} | {memory / 1024:.0f} "
        f"| {flight.duration:.3f} | {100 * certificate.gap:.2f} "
        f"| {100 * (flight.duration / certificate.dual_bound - 1):.2f} "
        f"| {certificate.closest.distance:.3f} | {1000 * error:.3f} "
        f"| {peer:.2f} ({broken} beyond, {use:.2f}) | {duration_law(goal - start):.2f} "
        f"| {certificate.method} |"
    )


def _processor() -> float:
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(
            resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        )
    )


def say(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", help=f"of: {', '.join(CASES)}")
    parser.add_argument("--jobs", type=int, default=None)
    arguments = parser.parse_args()
    say(
        "| case | wall [s] | cpu [s] | peak [MiB] | t_f [s] | over minimum [%] "
        "| over bound [%] | nearest [m] | replay [mm] | ruckig [s] | law [s] | how |"
    )
    say("| --- " * 12 + "|")
    for name in arguments.cases or CASES:
        try:
            say(measure(name, arguments.jobs))
        except ShowError as fault:
            say(f"| {name} | {fault} |")


if __name__ == "__main__":
    main()
