"""Run cases as processes of their own and keep the median of their CPU times."""

from __future__ import annotations

import json
import os
import resource
import subprocess
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.cases import Case

WORKER = Path(__file__).with_name("worker.py")
WALL_FACTOR = 6
"""A process that waits is stopped after so many times its limit of CPU time."""


@dataclass(frozen=True, slots=True)
class Row:
    """What came of a case."""

    key: str
    problem: str
    peer: str
    label: str
    runs: int
    cpu_seconds: float | None
    """Median over the runs; None without a result."""
    figures: dict[str, Any]
    """The report of the audit; ``failure`` where there is none."""

    @property
    def failure(self) -> str | None:
        """Why there is no result, or None."""
        return self.figures.get("failure")


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is measured."""

    runs: int = 5
    limit: float = 120.0
    """CPU time after which a process is stopped [s]."""
    budget: float = 60.0
    """CPU time of a row after which no further run is started [s]."""


def run_once(case: Case, python: Path, limit: float) -> dict[str, Any]:
    """Solve one case in a fresh process; the report, or a ``failure``."""
    message = json.dumps(
        {
            "problem": case.problem.to_dict(),
            "module": case.peer,
            "settings": case.settings,
        }
    )
    seconds = int(limit) + 10  # the audit and the imports come on top

    def restrain() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))

    environment = {
        **os.environ,
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "NUMBA_NUM_THREADS": "1",
        "MPLBACKEND": "Agg",
    }
    stopped = {"failure": f"no result in {limit:g} s of CPU time"}
    try:
        run = subprocess.run(
            [str(python), str(WORKER)],
            input=message,
            capture_output=True,
            text=True,
            timeout=seconds * WALL_FACTOR,
            env=environment,
            preexec_fn=restrain,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return stopped
    lines = run.stdout.strip().splitlines()
    if lines:
        result = json.loads(lines[-1])
        if result.get("cpu_seconds", 0.0) > limit:
            return stopped
        return result
    if run.returncode < 0 and -run.returncode in {9, 24}:  # killed, CPU limit
        return stopped
    last = (run.stderr.strip().splitlines() or [f"exit status {run.returncode}"])[-1]
    return {"failure": last[:300]}


def measure(
    case: Case, python: Path, effort: Effort, tell: Callable[[str], None]
) -> Row:
    """Run a case as often as the effort allows; figures of the first, median time."""
    results: list[dict[str, Any]] = []
    spent = 0.0
    for _ in range(effort.runs):
        result = run_once(case, python, effort.limit)
        results.append(result)
        if "failure" in result:
            break
        spent += result["cpu_seconds"]
        if spent > effort.budget:
            break
    good = [result for result in results if "failure" not in result]
    if len(good) < len(results):
        figures, time = results[-1], None
    else:
        figures, time = good[0], median(result["cpu_seconds"] for result in good)
    tell(
        f"{case.key}: "
        + (
            figures["failure"]
            if time is None
            else f"{figures['objective']:.9g} in {time:.3g} s of CPU time"
        )
    )
    return Row(
        case.key,
        case.problem.name,
        case.peer,
        case.label,
        len(results),
        time,
        figures,
    )
