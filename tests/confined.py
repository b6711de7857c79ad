"""Commands in a process of their own, under limits of processor time and memory.

So a hang or a flood is a failure of one test, and not the end of all.
"""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

from repository import ROOT

SECONDS = 20
"""Processor time that a command is killed after [s]: a hang, whatever the machine."""
MEMORY = 300_000_000
"""Resident memory that it may take [bytes]."""

PROBE = """
import json, sys
from memory import peak
from showc.__main__ import run
code = run(sys.argv[1:])
print(json.dumps({"exit": code, "memory": peak()}))
"""


def run_confined(folder, *arguments):
    """Run a command of showc in a folder; its exit code and what it printed."""

    def limited():
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))

    done = subprocess.run(
        [sys.executable, "-c", PROBE, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limited,
        timeout=300,
        env={
            **os.environ,
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "PYTHONPATH": str(ROOT / "tests"),
        },
    )
    assert "Traceback" not in done.stderr
    assert done.returncode == 0, done.stderr[-2000:] + done.stdout[-500:]
    assert not (Path(folder) / "showc-crash.txt").exists()
    *printed, last = done.stdout.strip().splitlines()
    ended = json.loads(last)
    assert ended["memory"] < MEMORY
    return ended["exit"], "\n".join(printed)
