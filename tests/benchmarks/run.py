"""Measure showc beside its peers and write the tables of the documentation.

Run from the root of the repository: ``make bench``, or this file with options. A full
run takes about an hour of CPU time, nearly all of it the peers'; ``--quick`` a fifth.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from benchmarks import cases, document  # noqa: E402
from benchmarks.environment import (  # noqa: E402
    HOME,
    PEERS,
    InstallationError,
    prepare,
    showc_python,
)
from benchmarks.measure import Effort, Row, measure  # noqa: E402

PAGE = ROOT / "showc" / "docs" / "benchmarks.md"
TABLES = ("optima", "quadrotor", "fleet")
WIDER = """\
One run each. The quadrotors at the end are of the consistent model (the arm counted
once in the torques) with the final yaw free; their least time lies below that of the
table above, and the two must not be compared.
"""
SCRIPT_LIMIT = 3600
QUICK_FLEETS = ["100", "swap-6", "swap-12"]
REPORTED = "What showc says of its own error, on these problems and more"
REPEATS = "One drone, yaw held, fixed time: built once, solved many times"
STORE = HOME / "rows.json"


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5, help="runs a row (5)")
    parser.add_argument("--quick", action="store_true", help="one run a row")
    parser.add_argument(
        "--limit", type=float, default=120.0, help="CPU seconds of one solve (120)"
    )
    parser.add_argument(
        "--budget", type=float, default=60.0,
        help="CPU seconds of a row after which no further run is started (60)",
    )  # fmt: skip
    parser.add_argument(
        "--only", nargs="+", metavar="WORD",
        help="rows whose name has one of these words; the page is not written",
    )  # fmt: skip
    parser.add_argument(
        "--peers", nargs="+", metavar="PEER", help="solvers to measure, showc included"
    )
    parser.add_argument(
        "--reuse",
        choices=("peers", "all"),
        help="take the rows of peers, or all that there are, from earlier runs; the "
        "page says so",
    )
    parser.add_argument(
        "--tables", nargs="+", choices=TABLES, default=TABLES, help="all",
    )  # fmt: skip
    parser.add_argument(
        "--fleet", nargs="+", metavar="SHOW", help="shows of fleet_table.py (all)"
    )
    return parser.parse_args()


def tell(text: str) -> None:
    """Report progress."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def prepare_all(names: set[str]) -> tuple[dict[str, Path], dict[str, str]]:
    """Make the environments; interpreters by peer, and reasons of failures."""
    pythons, missing = {"showc": showc_python()}, {}
    for peer in PEERS:
        if peer.name not in names:
            continue
        try:
            tell(f"environment of {peer.name} {peer.version} ...")
            pythons[peer.name] = prepare(peer)
        except InstallationError as fault:
            missing[peer.name] = str(fault)
            tell(f"{peer.name}: not installed: {fault}")
    return pythons, missing


def printed(title: str, script: str, *options: str) -> list[tuple[str, str]]:
    """Section that a script prints as Markdown; nothing if there is no such script."""
    path = Path(__file__).with_name(script)
    if not path.exists():
        return []
    tell(f"{title} ...")
    try:
        run = subprocess.run(
            [sys.executable, str(path), *options],
            stdout=subprocess.PIPE,
            timeout=SCRIPT_LIMIT,
            check=False,
        )
        text, fault = run.stdout, f"failed with status {run.returncode}"
        fault = fault if run.returncode else ""
    except subprocess.TimeoutExpired as late:
        text, fault = late.stdout or b"", f"was stopped after {SCRIPT_LIMIT} s"
    lines = [text.decode(), f"\n`{script}` {fault}." if fault else ""]
    return [(title, "\n".join(filter(None, lines)))]


def selected(chosen: argparse.Namespace) -> list[list[cases.Case]]:
    """Cases of the two tables that are measured here, less what is filtered out."""
    groups = [
        cases.classic() if "optima" in chosen.tables else [],
        cases.flights() if "quadrotor" in chosen.tables else [],
    ]
    return [
        [
            case
            for case in group
            if (not chosen.peers or case.peer in chosen.peers)
            and (not chosen.only or any(word in case.key for word in chosen.only))
        ]
        for group in groups
    ]


def sections(chosen: argparse.Namespace) -> list[tuple[str, str]]:
    """Sections about showc alone, each printed by a script of its own."""
    if chosen.only or (chosen.peers and "showc" not in chosen.peers):
        return []
    quick = ["--quick"] if chosen.quick else []
    fleets = chosen.fleet or (QUICK_FLEETS if chosen.quick else [])
    found = []
    if "optima" in chosen.tables:
        found += [
            (title, f"{WIDER}\n{text}")
            for title, text in printed(REPORTED, "ocp_table.py", "1")
        ]
    if "quadrotor" in chosen.tables:
        found += printed(REPEATS, "repeats.py", *quick)
    if "fleet" in chosen.tables:
        found += printed("Fleets", "fleet_table.py", *fleets)
    return found


def main() -> int:
    """Measure, print the page, and write it if nothing was left out."""
    chosen = arguments()
    runs = 1 if chosen.quick else chosen.runs
    effort = Effort(runs=runs, limit=chosen.limit, budget=chosen.budget)
    stored = json.loads(STORE.read_text()) if STORE.exists() else {}
    groups = selected(chosen)
    old = {
        case.key
        for group in groups
        for case in group
        if case.key in stored
        and (chosen.reuse == "all" or (chosen.reuse and case.peer != "showc"))
    }
    needed = {case.peer for group in groups for case in group if case.key not in old}
    tell(
        f"{sum(map(len, groups))} rows, {len(old)} of them from the last run, up to "
        f"{runs} runs each; all rows with five runs take about an hour of CPU time"
    )
    pythons, missing = prepare_all(needed)
    rows: list[list[Row]] = []
    for group in groups:
        rows.append([])
        for case in group:
            if case.key in old:
                rows[-1].append(Row(**stored[case.key]))
            elif case.peer in pythons:
                row = measure(case, pythons[case.peer], effort, tell)
                rows[-1].append(row)
                HOME.mkdir(parents=True, exist_ok=True)
                stored = json.loads(STORE.read_text()) if STORE.exists() else {}
                STORE.write_text(json.dumps({**stored, row.key: asdict(row)}, indent=1))
    extra = sections(chosen)
    text = document.page(effort, *rows, extra, missing, reused=chosen.reuse or "")
    sys.stdout.write(text)
    if chosen.only or chosen.peers or len(chosen.tables) < len(TABLES):
        tell("rows were left out: the documentation is not written")
    else:
        PAGE.write_text(text, encoding="utf-8")
        tell(f"written: {PAGE.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
