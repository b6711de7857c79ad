"""What works for a process ends with it, however it ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from repository import ROOT

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/environ").exists(), reason="processes are found by /proc"
)

PATIENCE = 2.0
"""What is left over must be gone by then [s]."""

POOL = """
import time
from showc.fleet.execution.pool import workers
with workers(2, None) as crew:
    crew.run(time.sleep, [(60.0,)] * 4)
"""
COPIES = """
import time
from showc.verify.crew import run_all
run_all([lambda: time.sleep(60.0)] * 4, 2)
"""
CREW = """
import time
from showc.processes import side_by_side
side_by_side(lambda number: time.sleep(60.0), 4, 2)
"""
BUSY = """
import math
from showc.processes import side_by_side
# One call that never lets another thread of the worker run.
side_by_side(lambda number: math.factorial(10_000_000), 4, 2)
"""


def marked(word):
    """Numbers of the processes that carry a word in their environment."""
    found = set()
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            state = (folder / "stat").read_text().rpartition(")")[2].split()[0]
            if state != "Z" and word in (folder / "environ").read_bytes():
                found.add(int(folder.name))
        except OSError:
            continue
    return found


def awaited(condition, patience):
    end = time.monotonic() + patience
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return condition()


def group_of(process):
    return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[2])


@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("code", [POOL, COPIES, CREW, BUSY])
def test_nothing_is_left_of_a_process_that_is_ended(code, ending, tmp_path):
    word = f"SHOWC_MARK={tmp_path}".encode()
    begun = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, "SHOWC_MARK": str(tmp_path)},
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )

    def working():
        """Both workers have joined the group of the guard."""
        groups = [group_of(process) for process in marked(word)]
        return any(groups.count(group) >= 3 for group in groups if group != begun.pid)

    assert awaited(working, 60.0)
    begun.send_signal(ending)
    begun.wait(30.0)
    assert awaited(lambda: not marked(word), PATIENCE), marked(word)


@pytest.mark.parametrize("alive", [True, False])
def test_a_worker_that_joins_after_its_parent_died_does_not_begin(alive):
    code = (
        "import multiprocessing, os\n"
        "from showc.processes import join_group\n"
        "os.setpgid(0, 0)\n"
        f"parent = type('Parent', (), {{'is_alive': lambda self: {alive}}})()\n"
        "multiprocessing.parent_process = lambda: parent\n"
        "join_group(os.getpid())\n"
        "print('began')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == ((0, "began\n") if alive else (1, ""))


def test_a_worker_whose_parent_is_dead_does_not_begin():
    code = (
        "from showc.processes import join_group\n"
        "join_group(2**22 - 1)\n"
        "print('began')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (1, "")
