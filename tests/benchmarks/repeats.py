"""A program built once and solved many times: fixed-time moves with yaw held.

Prints a Markdown table. Each move is (30, 20, 10) m give or take a metre an axis
(seeded), in a given multiple of the least time of the unchanged move. The first solve,
which builds the program, is left out of the median and shown beside it.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from statistics import median

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.audit import limit_threads

limit_threads()

import numpy as np  # noqa: E402
from benchmarks.clock import cpu_time  # noqa: E402
from benchmarks.peers.showc import aircraft  # noqa: E402
from benchmarks.quadrotor import SHIFT  # noqa: E402
from benchmarks.table import length, markdown  # noqa: E402

from showc.fleet.single_drone.following import follow  # noqa: E402
from showc.fleet.single_drone.shortest import minimum_time  # noqa: E402

FACTORS = (1.05, 1.5)
ACCURACIES = (1e-2, 1e-3)


def rows(repeats: int) -> list[tuple[str, ...]]:
    """Measure every factor and accuracy."""
    craft = replace(aircraft(), yaw="held")
    start = np.zeros(3)
    least = minimum_time(craft, start, np.array(SHIFT)).duration
    lines = []
    for factor in FACTORS:
        for accuracy in ACCURACIES:
            generator = np.random.default_rng(1)
            times, worst, solved = [], 0.0, 0
            for _ in range(repeats + 1):
                goal = np.array(SHIFT) + generator.uniform(-1.0, 1.0, 3)
                begin = cpu_time()
                result = follow(craft, start, goal, factor * least, accuracy=accuracy)
                times.append(cpu_time() - begin)
                solved += result.solved
                worst = max(worst, result.position_error)
            lines.append(
                (
                    f"{factor:g} x {least:.3f} s",
                    length(accuracy),
                    f"{1000.0 * median(times[1:]):.0f} ms",
                    f"{1000.0 * times[0]:.0f} ms",
                    length(worst),
                    f"{solved} of {repeats + 1}",
                )
            )
    return lines


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="5 solves, not 20")
    quick = parser.parse_args().quick
    header = ("time", "wanted", "median", "first", "greatest error", "solved")
    sys.stdout.write(markdown(header, rows(5 if quick else 20)) + "\n")


if __name__ == "__main__":
    main()
