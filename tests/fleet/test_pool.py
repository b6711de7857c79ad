"""Workers: same results everywhere, and a death in the crew does not lose the work."""

import os
import signal
import threading
import time
from multiprocessing import active_children
from pathlib import Path

import pytest

from showc.errors import UsageError
from showc.fleet.execution.pool import InProcess, Processes, chunks, workers


def square(value):
    return value * value


def process_of(value):
    time.sleep(0.05)
    return value, os.getpid()


def die_once(value, folder):
    """Kill the process that works on the fifth task, the first time."""
    mark = Path(folder) / "died"
    if value == 5 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return value + 100


def fail(value):
    raise ValueError(f"no {value}")


@pytest.mark.parametrize("count", [0, 1, 2, 31, 32, 200])
def test_chunks_keep_the_order_and_lose_nothing(count):
    parts = chunks(list(range(count)))
    assert [value for part in parts for value in part] == list(range(count))


def test_results_come_in_the_order_of_the_tasks():
    tasks = [(value,) for value in range(50)]
    steps = []
    with workers(1, None) as alone:
        assert isinstance(alone, InProcess)
        expected = alone.run(square, tasks, steps.append)
    with workers(2, None) as crew:
        assert isinstance(crew, Processes)
        assert crew.run(square, tasks, steps.append) == expected
    assert expected == [value * value for value in range(50)]
    assert sum(steps) == 100


def test_the_crew_works_in_other_processes():
    with workers(2, None) as crew:
        results = crew.run(process_of, [(value,) for value in range(12)])
    assert os.getpid() not in {process for _, process in results}


def test_a_worker_that_dies_does_not_lose_the_work(tmp_path):
    tasks = [(value, str(tmp_path)) for value in range(12)]
    with workers(2, None) as crew:
        assert crew.run(die_once, tasks) == [value + 100 for value in range(12)]
    assert (tmp_path / "died").exists()


def test_faults_of_a_task_come_through():
    with workers(2, None) as crew, pytest.raises(ValueError, match=r"no [01]"):
        crew.run(fail, [(0,), (1,)])


def test_no_jobs_is_a_fault_of_usage():
    with pytest.raises(UsageError, match="0 jobs"), workers(0, None):
        pass


def test_no_scheduler_is_a_fault_of_usage():
    pytest.importorskip("distributed")
    with (
        pytest.raises(UsageError, match="scheduler"),
        workers(None, "nonsense://127.0.0.1:1"),
    ):
        pass


def test_an_interrupt_does_not_wait_for_work_under_way():
    def interrupted(_):
        raise KeyboardInterrupt

    tasks = [(0.0,)] + [(60.0,)] * 5
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt), workers(2, None) as crew:
        crew.run(time.sleep, tasks, interrupted)
    assert time.monotonic() - begun < 45.0
    assert active_children() == []


def test_workers_do_not_hear_the_keyboard():
    with workers(2, None) as crew:
        masks = crew.run(signal.pthread_sigmask, [(signal.SIG_BLOCK, [])] * 2)
    assert all(signal.SIGINT in mask for mask in masks)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_who_was_let_go_while_starting_starts_nothing_afterwards():
    before = set(threading.enumerate())
    crew = Processes(2)
    for _ in range(3):
        crew.prepare()
    crew.stop()
    crew.close()
    for thread in set(threading.enumerate()) - before:
        thread.join(60.0)
    assert active_children() == []
    with pytest.raises(RuntimeError, match="for good"):
        crew.run(abs, [(-1,), (-2,)])


def test_threads_whose_work_has_not_begun_hear_of_an_end():
    """What one thread asked for keeps the processes busy; the others wait behind it."""
    crew = Processes(2)

    def ask():
        with pytest.raises(RuntimeError, match="for good"):
            crew.run(time.sleep, [(60.0,)] * 2)

    threads = [threading.Thread(target=ask, daemon=True) for _ in range(8)]
    for thread in threads:
        thread.start()
    begun = time.monotonic()
    while len(active_children()) < 2 and time.monotonic() - begun < 60.0:
        time.sleep(0.05)
    crew.stop()
    crew.close()
    for thread in threads:
        thread.join(30.0)
    assert not any(thread.is_alive() for thread in threads)
    assert active_children() == []
