"""Solve one problem with one peer, in the peer's own environment.

Reads a case as JSON from standard input, writes one line of JSON to standard output.
CPU time is that of this process and its children from the start of building the
problem to the end of the last solve; imports come before, the audit comes after.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import sys
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.audit import limit_threads, report
from benchmarks.clock import cpu_time
from benchmarks.problem import Problem


def work(case: dict) -> dict[str, object]:
    """Solve one case and report on it."""
    problem = Problem.from_dict(case["problem"])
    peer = importlib.import_module(f"benchmarks.peers.{case['module']}")
    begin = cpu_time()
    answer = peer.solve(problem, case["settings"])
    seconds = cpu_time() - begin
    return {
        "problem": problem.name,
        "peer": case["module"],
        "version": peer.version(),
        "cpu_seconds": seconds,
        **report(problem, answer),
    }


def main() -> None:
    """Read the case, solve it, print the report or the fault."""
    limit_threads()
    case = json.load(sys.stdin)
    # Libraries print banners and progress: only the report goes to standard output.
    channel = os.dup(1)
    os.dup2(2, 1)
    with contextlib.redirect_stdout(sys.stderr):
        try:
            result = work(case)
        except Exception as fault:  # noqa: BLE001 - the harness reports every failure
            traceback.print_exc()
            text = f"{type(fault).__name__}: {fault}".splitlines()
            result = {"failure": " ".join(text)[:300]}
    os.write(channel, (json.dumps(result) + "\n").encode())


if __name__ == "__main__":
    main()
