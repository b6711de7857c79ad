"""What works for a process ends with it, however it ends."""

import gc
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from repository import ROOT, running

from showc.processes import side_by_side

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
from showc.processes import side_by_side
side_by_side([lambda: time.sleep(60.0)] * 4, 2)
"""
BUSY = """
import math
from showc.processes import side_by_side
# One call that never lets another thread of the worker run.
side_by_side([lambda: math.factorial(10_000_000)] * 4, 2)
"""


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
@pytest.mark.parametrize("code", [POOL, COPIES, BUSY])
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
        groups = [group_of(process) for process in running(word)]
        return any(groups.count(group) >= 3 for group in groups if group != begun.pid)

    assert awaited(working, 60.0)
    begun.send_signal(ending)
    begun.wait(30.0)
    assert awaited(lambda: not running(word), PATIENCE), running(word)


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


def square(number):
    return number * number


def fail(number):
    raise ArithmeticError(number, f"part {number}")


def own_children():
    """Processes whose parent this one is, zombies included."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == os.getpid():
            found.append(int(folder.name))
    return set(found)


@given(st.lists(st.integers(), max_size=12), st.integers(1, 4), st.integers(0, 12))
@settings(deadline=None, max_examples=15)
def test_results_come_in_the_order_of_the_parts(numbers, jobs, here):
    told = []
    parts = [partial(square, number) for number in numbers]
    here = min(here, len(parts))
    found = side_by_side(parts, jobs, lambda: told.append(1), here)
    assert found == [number * number for number in numbers]
    assert len(told) == len(numbers)


def test_the_work_is_done_by_others():
    before = own_children()
    parts = [os.getpid] * 8
    assert os.getpid() not in side_by_side(parts, 2)
    assert side_by_side(parts, 1) == [os.getpid()] * 8
    assert own_children() == before


def test_what_there_was_is_no_garbage_to_copies_and_is_again_here():
    before = gc.get_freeze_count()
    frozen = side_by_side([gc.get_freeze_count] * 2, 2)
    assert min(frozen) > before + 10_000
    assert gc.get_freeze_count() == before


def test_the_last_parts_are_done_here_if_that_is_asked():
    parts = [os.getpid] * 4
    assert [one == os.getpid() for one in side_by_side(parts, 2, here=3)] == [
        False, True, True, True,
    ]  # fmt: skip


@pytest.mark.parametrize("here", [0, 1, 2, 3])
@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_the_first_part_that_fails_says_why(jobs, here):
    parts = [partial(square, 2), partial(fail, 7), partial(fail, 8)]
    with pytest.raises(ArithmeticError, match="part 7") as caught:
        side_by_side(parts, jobs, here=here)
    assert caught.value.args[0] == 7


def test_nothing_is_begun_after_a_part_that_failed(tmp_path):
    def late(number):
        (tmp_path / str(number)).touch()
        time.sleep(0.05)

    parts = [partial(fail, 7), *(partial(late, number) for number in range(200))]
    with pytest.raises(ArithmeticError, match="part 7"):
        side_by_side(parts, 2)
    assert len(list(tmp_path.iterdir())) < 50


def test_what_a_dead_copy_left_undone_is_done():
    here = os.getpid()

    def die(number):
        if os.getpid() != here and number % 3 == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return number

    assert side_by_side([partial(die, number) for number in range(7)], 2) == list(
        range(7)
    )


def test_large_results_come_whole():
    def large(seed):
        return np.random.default_rng(seed).normal(size=300_000)

    found = side_by_side([partial(large, seed) for seed in range(4)], 2)
    for seed, values in enumerate(found):
        np.testing.assert_array_equal(values, large(seed))


def test_an_interrupt_leaves_no_copy_behind():
    before = own_children()

    def interrupted():
        raise KeyboardInterrupt

    begun = time.monotonic()
    slow = [lambda: 1, partial(time.sleep, 60.0), partial(time.sleep, 60.0)]
    with pytest.raises(KeyboardInterrupt):
        side_by_side(slow, 2, interrupted)
    assert time.monotonic() - begun < 30.0
    assert own_children() == before


SLEEPERS = """
import time
from showc.processes import side_by_side


parts = [lambda: 0] + [lambda: time.sleep(60.0)] * 3
side_by_side(parts, 2, lambda: print("begun", flush=True))
"""


def test_an_interrupt_ends_the_copies_at_once_and_in_silence():
    with subprocess.Popen(
        [sys.executable, "-c", SLEEPERS],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    ) as process:
        assert process.stdout.readline() == "begun\n"
        # As a keyboard does: to the process and all of its copies.
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=30.0)
        assert process.returncode != 0
        assert said.count("Traceback") == 1
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
