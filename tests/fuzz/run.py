"""The long campaign: ``python tests/fuzz/run.py [--cases N] [--seed N] [SUBJECT ...]``.

Every case runs under limits of processor time and memory. What fails is written to
``tests/fuzz/corpus``, which the tests try again from then on.
"""

import argparse
import random
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from fuzz.seeds import FILES, SCRIPTS, show_with
from fuzz.subjects import SUBJECTS, tried

CORPUS = Path(__file__).parent / "corpus"
SECONDS = {"scripts": 1.0, "inputs": 1.0}
"""Processor time that a case may take [s]; others: thirty."""
MEMORY = {"scripts": 300e6, "inputs": 300e6}
"""Memory that a case may take [bytes]; others: two gigabytes."""
CASES = {
    "scripts": 10_000,
    "inputs": 10_000,
    "logs": 500,
    "missions": 300,
    "caches": 2_000,
    "messages": 20_000,
    "shows": 2_000,
}
"""How many cases a long campaign has."""


def keep(subject, number, case):
    """Put a case into the corpus."""
    for name, content in case.items():
        path = CORPUS / subject / f"{number}" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def warm():
    """Import once, in the process that is copied, what readers import late."""
    from showc.script import read_show

    with tempfile.TemporaryDirectory() as place:
        for name, make in FILES.items():
            (Path(place) / name).write_bytes(make())
            read_show(show_with(name), folder=Path(place))
            for script in SCRIPTS:
                read_show(script.encode(), folder=Path(place))


def campaign(name, cases, seed):
    """Try the cases of one subject; return the number of faults."""
    subject = SUBJECTS[name]()
    slow = 0
    faults, slowest, largest, total = 0, (0.0, 0), (0.0, 0), 0.0
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        subject.prepare(folder)
        warm()
        for number in range(seed, seed + cases):
            case = subject.case(random.Random(f"{name} {number}"))
            ending = tried(subject, folder, case)
            slowest = max(slowest, (ending.seconds, number))
            largest = max(largest, (ending.memory, number))
            total += ending.seconds
            fault = ending.fault
            if not fault and ending.seconds > SECONDS.get(name, 30.0):
                # Fleets of thousands, drawn from files, are sound and take long.
                slow += 1
                print(f"{name} {number}: takes {ending.seconds:.2f} s", flush=True)
            if not fault and ending.memory > MEMORY.get(name, 2e9):
                fault = f"takes {ending.memory / 1e6:.0f} MB"
            if fault:
                faults += 1
                keep(name, number, case)
                print(f"{name} {number}: {fault}", flush=True)
    print(
        f"{name}: {cases} cases, {faults} faults, {slow} slow; "
        f"{total / max(cases, 1):.3f} s each, "
        f"at most {slowest[0]:.2f} s (case {slowest[1]}) and {largest[0] / 1e6:.0f} MB "
        f"(case {largest[1]}); {time.monotonic() - begun:.0f} s in all",
        flush=True,
    )
    return faults


def main():
    """Run the campaigns that are asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("subjects", nargs="*", choices=[*SUBJECTS, []])
    parser.add_argument("--cases", type=int)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    faults = sum(
        campaign(name, given.cases or CASES[name], given.seed)
        for name in given.subjects or SUBJECTS
    )
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
