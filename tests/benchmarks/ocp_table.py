# ruff: noqa: E402, T201 -- a script: it sets its paths first, and it prints
"""Print the table of classic optimal control problems, solved with default settings.

One process, one thread; CPU time includes building, all meshes and all audits. Run
``python tests/benchmarks/ocp_table.py [repeats] [--docs]``; each figure of time is the
median. A relative error below the digits to which the optimum is known is given as
less than those.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from statistics import median
from time import process_time
from typing import TYPE_CHECKING

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1])]

import casadi as ca
import numpy as np
from benchmarks.ocp_apart import APART
from benchmarks.ocp_collected import COLLECTED
from benchmarks.ocp_further import FURTHER
from benchmarks.ocp_hard import HARD
from benchmarks.ocp_problems import BENCHMARKS, Benchmark
from benchmarks.ocp_quadrotor import quadrotor, solve_quadrotor
from benchmarks.ocp_textbook import TEXTBOOK

from showc import ocp
from showc.ocp.audit.residuals import PhaseAuditor
from showc.ocp.transcription.collocation.statement import Statement

if TYPE_CHECKING:
    from collections.abc import Iterator


def bound_violation(problem: ocp.Problem, solution: ocp.Solution) -> float:
    """Greatest violation of a bound or path limit on a 1 kHz grid, over its range.

    At least 20,000 instants a phase, so that problems whose unit of time is long are
    looked at as closely.
    """
    worst = 0.0
    for phase, part in zip(problem.phases, solution.phases, strict=True):
        count = max(20_000, int(1000.0 * part.duration)) + 1
        times = np.linspace(part.start, part.end, min(count, 400_000))
        states, controls = part.states(times), part.controls(times)
        values = [*states.T, *controls.T]
        members = [*phase.states.values(), *phase.controls.values()]
        limits = [member.quantity for member in members]
        if phase.path_constraints:
            x = ca.vertcat(*[s.quantity.symbol for s in phase.states.values()])
            u = ca.vertcat(*[c.quantity.symbol for c in phase.controls.values()])
            path = ca.vertcat(*[c.symbol for c in phase.path_constraints])
            function = ca.Function("path", [x, u, phase.time], [path])
            values += list(np.asarray(function(states.T, controls.T, times[None, :])))
            limits += phase.path_constraints
        for value, limit in zip(values, limits, strict=True):
            lower, upper = float(limit.lower), float(limit.upper)
            span = upper - lower
            if not np.isfinite(span):
                span = max(float(np.ptp(value)), 1e-12)
            elif span == 0.0:
                span = abs(lower) or 1.0
            over = max(lower - value.min(), value.max() - upper)
            worst = max(worst, over / span)
    return worst


def row(benchmark: Benchmark, repeats: int) -> str:
    """One line of the table."""
    spent = []
    for _ in range(repeats):
        began = process_time()
        solution = ocp.solve(benchmark.build())
        spent.append(process_time() - began)
    problem = benchmark.build()
    error = solution.error
    if error is None:
        return f"| {benchmark.name} | {solution.result.name} | | | | | | | |"
    off = "-"
    if benchmark.optimum != 0.0:
        miss = abs(solution.objective - benchmark.optimum) / abs(benchmark.optimum)
        digits = benchmark.digits
        off = f"{miss:.0e}" if miss > digits or digits == 0.0 else f"< {digits:.0e}"
    coarse = "" if solution.result is ocp.Result.SOLVED else " (coarse)"
    return (
        f"| {benchmark.name}{coarse} | {solution.objective:.10g} | "
        f"{off} | "
        f"{max(error.objective, error.dynamics):.0e} | {median(spent):.2f} | "
        f"{len(solution.history)} | {solution.mesh.point_count} | "
        f"{bound_violation(problem, solution):.0e} | {error.shooting:.0e} |"
    )


def quadrotor_row(repeats: int, *, yaw_free: bool) -> str:
    """One solve on a mesh that is fine where the vehicle pitches, and no adaptation."""
    spent = []
    for _ in range(repeats):
        began = process_time()
        solution = solve_quadrotor(yaw_free=yaw_free)
        spent.append(process_time() - began)
    problem = quadrotor(yaw_free=yaw_free)
    part = solution.phases[0]
    auditor = PhaseAuditor(problem, problem.phases[0], 0)
    table = Statement(problem).table(np.zeros(0))
    audit = auditor.shot(auditor.audit(solution, table), solution, table)
    missed = np.abs(audit.shooting_end[:3] - part.states.coefficients[-1, -1, :3])
    return (
        f"| quadrotor (30, 20, 10) m, yaw {'free' if yaw_free else 'held'}, fixed mesh "
        f"| {solution.objective:.4f} | - | - | {median(spent):.2f} | 1 | "
        f"{solution.mesh.point_count} | {bound_violation(problem, solution):.0e} | "
        f"{1e3 * missed.max():.2f} mm |"
    )


def adaptive_row(repeats: int, *, yaw_free: bool) -> str:
    """The same vehicle, the mesh left to the core."""
    spent = []
    for _ in range(repeats):
        began = process_time()
        solution = ocp.solve(quadrotor(yaw_free=yaw_free))
        spent.append(process_time() - began)
    error = solution.error
    if error is None:
        raise RuntimeError(solution.message)
    violation = bound_violation(quadrotor(yaw_free=yaw_free), solution)
    coarse = "" if solution.result is ocp.Result.SOLVED else " (coarse)"
    return (
        f"| quadrotor (30, 20, 10) m, yaw {'free' if yaw_free else 'held'}{coarse} "
        f"| {solution.objective:.5f} | - | {error.objective:.0e} | "
        f"{median(spent):.2f} | {len(solution.history)} | "
        f"{solution.mesh.point_count} | {violation:.0e} | {error.shooting:.0e} |"
    )


def lines(repeats: int) -> Iterator[str]:
    """Lines of the table."""
    yield (
        "| problem | objective | relative error | reported error | CPU [s] | meshes | "
        "points | bound violation | clipped re-integration |"
    )
    yield "| --- " * 9 + "|"
    for benchmark in (*BENCHMARKS, *FURTHER, *TEXTBOOK, *APART, *COLLECTED, *HARD):
        yield row(benchmark, repeats)
    for yaw_free in (True, False):
        yield quadrotor_row(repeats, yaw_free=yaw_free)
    for yaw_free in (True, False):
        yield adaptive_row(repeats, yaw_free=yaw_free)


def main() -> None:
    """Print the table; with ``--docs`` also put it into the documentation."""
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    table = []
    for line in lines(numbers[0] if numbers else 1):
        print(line, flush=True)
        table.append(line)
    if "--docs" in sys.argv:
        page = Path(__file__).parents[2] / "showc" / "docs" / "ocp.md"
        before, rest = page.read_text().split("<!-- table -->")
        after = rest[rest.index("## References") :]
        body = "\n".join(table)
        page.write_text(f"{before}<!-- table -->\n\n{body}\n\n{after}")


if __name__ == "__main__":
    main()
