"""Work shared among copies of the process: same results, whoever does it."""

import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.verify import verify_log
from showc.verify.crew import run_all
from showc.verify.damage import Damage

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="copies by fork")


def square(number):
    return number * number


def fail(number):
    raise Damage(number, f"part {number}")


def children():
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


@given(st.lists(st.integers(), max_size=12), st.integers(1, 4))
@settings(deadline=None, max_examples=15)
def test_results_come_in_the_order_of_the_parts(numbers, jobs):
    told = []
    parts = [partial(square, number) for number in numbers]
    found = run_all(parts, jobs, lambda: told.append(1))
    assert found == [number * number for number in numbers]
    assert len(told) == len(numbers)


def test_parts_are_begun_as_asked_and_told_in_their_order(tmp_path):
    log = tmp_path / "begun"

    def work(number):
        with log.open("a") as stream:
            stream.write(f"{number}\n")
        time.sleep(0.05)
        return number

    begin = [4, 2, 5, 0, 1, 3]
    found = run_all([partial(work, number) for number in range(6)], 2, begin=begin)
    assert found == list(range(6))
    begun = [int(line) for line in log.read_text().split()]
    assert sorted(begun) == sorted(begin)
    assert set(begun[:2]) == set(begin[:2])


def test_the_work_is_done_by_others():
    before = children()
    parts = [os.getpid] * 8
    assert os.getpid() not in run_all(parts, 2)
    assert run_all(parts, 1) == [os.getpid()] * 8
    assert children() == before


@pytest.mark.parametrize("jobs", [1, 2, 3])
def test_the_first_part_that_fails_says_why(jobs):
    parts = [partial(square, 2), partial(fail, 7), partial(fail, 8)]
    with pytest.raises(Damage, match="part 7") as caught:
        run_all(parts, jobs)
    assert caught.value.offset == 7


def test_what_a_dead_copy_left_undone_is_done():
    here = os.getpid()

    def die(number):
        if os.getpid() != here and number % 3 == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return number

    assert run_all([partial(die, number) for number in range(7)], 2) == list(range(7))


def test_large_results_come_whole():
    def large(seed):
        return np.random.default_rng(seed).normal(size=300_000)

    found = run_all([partial(large, seed) for seed in range(4)], 2)
    for seed, values in enumerate(found):
        np.testing.assert_array_equal(values, large(seed))


def test_an_interrupt_leaves_no_copy_behind():
    before = children()

    def interrupted():
        raise KeyboardInterrupt

    begun = time.monotonic()
    slow = [lambda: 1, partial(time.sleep, 60.0), partial(time.sleep, 60.0)]
    with pytest.raises(KeyboardInterrupt):
        run_all(slow, 2, interrupted)
    assert time.monotonic() - begun < 30.0
    assert children() == before


def test_a_proof_does_not_depend_on_who_makes_it(log_path):
    alone = verify_log(log_path, missions=False, jobs=1)
    shared = verify_log(log_path, missions=False, jobs=3)
    assert alone.passed
    assert shared.to_json() == alone.to_json()
