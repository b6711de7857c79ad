"""What every part that works in several processes needs."""

from __future__ import annotations

import atexit
import ctypes
import gc
import os
import signal
import subprocess
import sys
from contextlib import contextmanager, suppress
from threading import Lock, current_thread, main_thread
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from concurrent.futures import Future, ProcessPoolExecutor

    Result = TypeVar("Result")

_GUARD = ("/bin/sh", "-c", "read _; kill -KILL 0")
"""Waits until its input ends, which the death of the process that holds the other end
brings about, however it dies; then ends its whole process group."""


def usable_cores() -> int:
    """Count the processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def undisturbed() -> Iterator[None]:
    """Start processes that an interrupt from the keyboard does not reach.

    It reaches the whole group; a reader of this file hears of it and ends its workers.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class OutOfTimeError(BaseException):
    """Work takes more processor time than it was given.

    No ``Exception``, for libraries that take every exception for a damaged file would
    go on with what takes so long.
    """


@contextmanager
def processor_time(most: float) -> Iterator[None]:
    """Do work for a limited time.

    Only the main thread of a process can be held to it, on systems with timers of
    processor time; elsewhere, and inside another such limit, the work goes on.

    Parameters
    ----------
    most
        Processor time of the whole process from here on [s].

    Raises
    ------
    OutOfTimeError
        In the middle of the work, when its time is over.
    """
    limited = (
        hasattr(signal, "setitimer")
        and current_thread() is main_thread()
        and signal.getitimer(signal.ITIMER_PROF)[0] == 0.0
    )
    if not limited:
        yield
        return

    def end(number: int, frame: object) -> None:
        del number, frame
        raise OutOfTimeError

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, most)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


class _Guard:
    """The guard of this process: started when first needed, gone with it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def group(self) -> int:
        """Return the number of the guarded process group, starting the guard."""
        with self._lock:
            if self._process is None or self._process.poll() is not None:
                self._process = subprocess.Popen(  # noqa: S603 - a constant
                    _GUARD, stdin=subprocess.PIPE, process_group=0
                )
            return self._process.pid

    def leave(self) -> None:
        """Let the guard end, and all that is still in its group with it."""
        process, self._process = self._process, None
        if process is not None and process.stdin is not None:
            process.stdin.close()
            process.wait()

    def forget(self) -> None:
        """Close a copy's end of the pipe: the original alone keeps the group alive."""
        process, self._process = self._process, None
        self._lock = Lock()
        if process is not None and process.stdin is not None:
            process.stdin.close()
            process.returncode = 0  # the copy has no child to wait for


_guard = _Guard()
atexit.register(_guard.leave)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_guard.forget)


def guarded_group() -> int:
    """Return the number of a process group that ends when this process ends.

    Workers join it with :func:`join_group`. However this process dies, by ``kill -9``
    too, the system kills every process of the group within the time a shell takes to
    wake up. An interrupt from the keyboard does not reach the group.

    Returns
    -------
    int
        Number of the group; 0 on systems without process groups.

    Raises
    ------
    OSError
        If no process can be started.
    """
    return _guard.group() if os.name == "posix" else 0


def join_group(group: int) -> None:
    """Make this process a worker of a group: the first thing a worker does.

    Signals that ask for an end have their usual effect from here on, whatever the
    parent does with them.

    Parameters
    ----------
    group
        What :func:`guarded_group` returned in the process that the worker works for.
        If that process is dead already, this one ends at once.
    """
    if group == 0:
        return
    from multiprocessing import parent_process  # noqa: PLC0415 - workers only

    for name in ("SIGTERM", "SIGHUP"):
        signal.signal(getattr(signal, name), signal.SIG_DFL)
    try:
        os.setpgid(0, group)
    except OSError:
        os._exit(1)
    # A worker that joins after the guard's last deed is out of its reach. From here on
    # a death of the parent is followed by that deed; an earlier one shows here.
    parent = parent_process()
    if parent is not None and not parent.is_alive():
        os._exit(1)


def guarded_executor(jobs: int, method: str) -> ProcessPoolExecutor:
    """Make an executor whose processes end when this one ends, however it ends.

    Work is to be submitted under :func:`undisturbed`: the first of it starts processes.

    Parameters
    ----------
    jobs
        Number of processes.
    method
        How :mod:`multiprocessing` is to start them.
    """
    # Not needed for small shows, which are the most.
    from concurrent.futures import ProcessPoolExecutor  # noqa: PLC0415
    from multiprocessing import get_context  # noqa: PLC0415

    return ProcessPoolExecutor(
        jobs, get_context(method), initializer=join_group, initargs=(guarded_group(),)
    )


def give_back() -> None:
    """Give memory that is free, but between what is in use, back to the system.

    Of what was read and decoded, piece by piece, most is free in the end. A process
    would keep it, and so would every copy of it.
    """
    # Systems with another library of C keep it.
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)


_at_work: list[Sequence[Callable[[], Any]]] = []
"""Parts that copies made now will know; the last entry counts."""


def side_by_side(
    parts: Sequence[Callable[[], Result]],
    jobs: int | None = None,
    done: Callable[[], None] = lambda: None,
    here: int = 0,
) -> list[Result]:
    """Call every part, in copies of this process; return what they return, in order.

    A copy made by the system's ``fork`` has everything that was read already, without
    any of it being sent; what it finds comes back pickled. The number of copies changes
    nothing in what is found, and what one that died left undone is done here.

    Parameters
    ----------
    parts
        Functions without arguments that depend on nothing that changes.
    jobs
        Copies to share the work; None: one for each core. Where the system cannot copy
        a process safely (elsewhere than on Linux), and for one part, the work is done
        in this one.
    done
        Called as each part is finished.
    here
        How many of the last parts this process does meanwhile, as one of the copies:
        those that return so much that to send it takes as long as to work it out.

    Raises
    ------
    Exception
        What the first part (in their order) that failed has raised.
    """
    count = min(usable_cores() if jobs is None else jobs, len(parts))
    if count < 2 or sys.platform != "linux":
        return [_counted(part, done) for part in parts]
    from concurrent.futures import BrokenExecutor  # noqa: PLC0415 - see above

    futures = _in_copies(parts, max(count - (here > 0), 1), done, here)
    results = []
    for number, part in enumerate(parts):
        future = futures.get(number)
        if future is None or isinstance(future.exception(), BrokenExecutor):
            results.append(_counted(part, done))
        else:
            results.append(future.result())
    return results


def _counted(part: Callable[[], Result], done: Callable[[], None]) -> Result:
    found = part()
    done()
    return found


def _in_copies(
    parts: Sequence[Callable[[], Result]],
    count: int,
    done: Callable[[], None],
    here: int,
) -> dict[int, Future[Result]]:
    """Let copies do the parts but the last ones ``here``; return what each came to."""
    from concurrent.futures import BrokenExecutor, as_completed  # noqa: PLC0415
    from multiprocessing import active_children  # noqa: PLC0415

    before = set(active_children())
    give_back()
    # Copies that look for garbage leave alone, and shared, what was there before them.
    gc.freeze()
    executor = guarded_executor(count, "fork")
    futures: dict[int, Future[Result]] = {}
    _at_work.append(parts)
    try:
        # A copy may die while work is still being given out.
        with undisturbed(), suppress(BrokenExecutor):
            for number in range(len(parts) - here):
                futures[number] = executor.submit(_do, number)
        futures |= _here(parts, len(parts) - here)
        numbers = {future: number for number, future in futures.items()}
        for future in as_completed(numbers):
            if future.cancelled():
                continue
            if future.exception() is None:
                done()
            elif not isinstance(future.exception(), BrokenExecutor):
                # What the first that fails raises is what is raised: none after it.
                for later, number in numbers.items():
                    if number > numbers[future]:
                        later.cancel()
    except BaseException:
        for process in set(active_children()) - before:
            process.kill()
        raise
    finally:
        gc.unfreeze()
        _at_work.pop()
        executor.shutdown(cancel_futures=True)
    return futures


def _here(
    parts: Sequence[Callable[[], Result]], first: int
) -> dict[int, Future[Result]]:
    """Do the parts from the ``first`` on in this process, up to one that fails."""
    from concurrent.futures import Future  # noqa: PLC0415

    found: dict[int, Future[Result]] = {}
    for number in range(first, len(parts)):
        own = found[number] = Future()
        try:
            own.set_result(parts[number]())
        except Exception as error:  # noqa: BLE001 - raised in its turn
            own.set_exception(error)
            break
    return found


def _do(number: int) -> Any:  # noqa: ANN401 - whatever the part returns
    """Do one part, in a copy."""
    return _at_work[-1][number]()
