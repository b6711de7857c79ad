"""Where work is done: in this process, in processes of this machine, on a cluster.

The same work gives the same results everywhere: a task is a function of its arguments
alone, and results come back in the order of the tasks.
"""

from __future__ import annotations

import importlib
import os
import tempfile
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from itertools import accumulate
from multiprocessing import active_children, get_context, resource_tracker
from multiprocessing.util import Finalize, get_temp_dir
from pathlib import Path
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, Protocol

from showc.errors import UsageError
from showc.files import scratch
from showc.processes import guarded_executor, undisturbed, usable_cores

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

_THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
PATIENCE = "20s"
"""For which a scheduler is waited for: it may be starting."""
_DEATHS = 3
"""How often workers may die before the work is given up: once more than by chance."""
_PRELOAD = (
    "showc.fleet.single_drone.common_time",
    "showc.fleet.lower_bound.limiting",
    "showc.ocp.transcription.condensed.transcription",
    "showc.fleet.lower_bound.relaxed_move",
    "clarabel",
)
"""What workers need sooner or later: imported once, by the server that they are forked
from."""


class Workers(Protocol):
    """Does many like tasks."""

    def prepare(self) -> None:
        """Say that work will come soon, so that it need not wait for a start."""

    def run(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple[Any, ...]],
        done: Callable[[int], None] = ...,
        found: Callable[[int, Any], None] = ...,
    ) -> list[Any]:
        """Call ``function(*task)`` for every task; results in the tasks' order.

        ``done`` hears how many more tasks have been finished, ``found`` the number of
        a task and its result as soon as it is known.
        """


def _ignore(steps: int) -> None:
    del steps


def _pass_over(number: int, value: object) -> None:
    del number, value


def _several(function: Callable[..., Any], tasks: list[tuple[Any, ...]]) -> list[Any]:
    return [function(*task) for task in tasks]


def chunks(tasks: Sequence[Any]) -> list[list[Any]]:
    """Cut tasks into chunks by their number alone, never by the workers."""
    size = 1 if len(tasks) < 32 else 2 if len(tasks) < 128 else 6
    return [list(tasks[top : top + size]) for top in range(0, len(tasks), size)]


def _firsts(parts: Sequence[Sequence[Any]]) -> list[int]:
    """Return the number of the first task of each chunk."""
    return [0, *accumulate(len(part) for part in parts)]


def _tell(found: Callable[[int, Any], None], first: int, values: list[Any]) -> None:
    for number, value in enumerate(values, first):
        found(number, value)


class InProcess:
    """Works in the calling process."""

    def prepare(self) -> None:
        """See :class:`Workers`; there is nothing to start."""

    def run(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple[Any, ...]],
        done: Callable[[int], None] = _ignore,
        found: Callable[[int, Any], None] = _pass_over,
    ) -> list[Any]:
        """See :class:`Workers`."""
        results = []
        for number, task in enumerate(tasks):
            results.append(function(*task))
            found(number, results[-1])
            done(1)
        return results


class Processes:
    """Works in processes of this machine, started when first needed.

    A worker that dies takes the others of its pool along; the unfinished tasks are
    then given to a new pool, a few times. Several threads may share the processes.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._executor: ProcessPoolExecutor | None = None
        self._starting = Lock()
        self._prepared = self._closed = False

    def prepare(self) -> None:
        """See :class:`Workers`; the processes start while the caller goes on."""
        if not self._prepared:
            self._prepared = True
            # Two threads that name their first folder at once can leave the lock of
            # tempfile taken for good when an interrupt comes.
            with suppress(OSError):
                _place_sockets()
            Thread(target=self._try, daemon=True).start()

    def _try(self) -> None:
        # What stands in the way is said when work is submitted next.
        with suppress(Exception):
            self._pool()

    def run(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple[Any, ...]],
        done: Callable[[int], None] = _ignore,
        found: Callable[[int, Any], None] = _pass_over,
    ) -> list[Any]:
        """See :class:`Workers`."""
        if len(tasks) < 2 and not self._prepared:
            return InProcess().run(function, tasks, done, found)
        parts = chunks(tasks)
        first = _firsts(parts)
        results: list[list[Any] | None] = [None] * len(parts)
        deaths = 0
        while any(result is None for result in results):
            waiting: dict[Future[list[Any]], int] = {}
            pool = self._pool()
            try:
                waiting.update(
                    (pool.submit(_several, function, part), index)
                    for index, part in enumerate(parts)
                    if results[index] is None
                )
                while waiting:
                    ready, _ = wait(waiting, return_when=FIRST_COMPLETED)
                    for future in ready:
                        values = future.result()
                        index = waiting.pop(future)
                        results[index] = values
                        _tell(found, first[index], values)
                        done(len(values))
            except BrokenProcessPool:
                deaths += 1
                self._let_go(pool)
                if deaths > _DEATHS:
                    raise UsageError(
                        f"worker processes died {deaths} times, perhaps for want of "
                        "memory; ask for fewer with --jobs"
                    ) from None
            except RuntimeError:
                # Between taking the pool and asking it, another thread may end it.
                self._raise_if_closed()
                raise
        return [value for result in results if result is not None for value in result]

    def _raise_if_closed(self) -> None:
        if self._closed:
            raise RuntimeError("the processes have been let go for good") from None

    def _pool(self) -> ProcessPoolExecutor:
        # A first submission waits until the server of the processes has imported what
        # they need; ``prepare`` lets a thread wait for it.
        with self._starting:
            self._raise_if_closed()
            if self._executor is None:
                self._executor = _started(self._jobs)
            return self._executor

    def stop(self) -> None:
        """End the processes at once, whatever they are doing."""
        self._closed = True
        with self._starting:
            if self._executor is not None:
                for process in active_children():
                    process.terminate()
                # Every thread that waits for a result hears of a broken pool. Of work
                # that is cancelled it would hear nothing, and wait for good.
                self._executor.shutdown(wait=True)
                self._executor = None

    def close(self) -> None:
        """Let the processes go; none is started any more."""
        # A thread that waits to start some finds this when it is its turn.
        self._closed = True
        self._let_go()

    def _let_go(self, broken: ProcessPoolExecutor | None = None) -> None:
        with self._starting:
            # Another thread may have let go what is broken, and started the next.
            if self._executor is not None and broken in {None, self._executor}:
                self._executor.shutdown(wait=True, cancel_futures=True)
                self._executor = None


_LONGEST_PLACE = 60
"""Length of a folder's name up to which sockets in folders in it can be named: the
shortest limit of any system is 104, some 40 are added [bytes]."""


@cache
def _place_sockets() -> None:
    """Let what :mod:`multiprocessing` puts into a folder lie where it is cleared."""
    usual = tempfile.gettempdir()
    short = usual if len(os.fsencode(usual)) <= _LONGEST_PLACE else "/tmp"  # noqa: S108
    held = ExitStack()
    before, tempfile.tempdir = (
        tempfile.tempdir,
        str(held.enter_context(scratch(Path(short)))),
    )
    # After what multiprocessing itself removes at the end, of priority -100.
    Finalize(None, held.close, exitpriority=-200)
    try:
        get_temp_dir()
    finally:
        tempfile.tempdir = before


def _started(jobs: int) -> ProcessPoolExecutor:
    """Start ``jobs`` processes, each with one thread."""
    method = "forkserver" if os.name == "posix" else "spawn"
    if method == "forkserver":
        _place_sockets()
        get_context(method).set_forkserver_preload(list(_PRELOAD))
        # Starting it later would let interrupts through again.
        resource_tracker.ensure_running()
    with _single_threaded(), undisturbed():
        executor = guarded_executor(jobs, method)
        # The server and its workers inherit the environment of this moment; that they
        # import what they need is not waited for.
        for _ in range(jobs):
            executor.submit(_warm)
    return executor


class Cluster:
    """Works on a Dask cluster; needs the ``distributed`` package."""

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client  # noqa: PLC0415 - optional dependency
        except ImportError as error:
            raise UsageError(
                "working on a cluster needs the package 'distributed': "
                "pip install 'showc-compiler[cluster]'"
            ) from error
        try:
            self._client = Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:
            raise UsageError(
                f"no Dask scheduler answers at {address!r} ({error}); "
                "wanted an address such as tls://host:8786"
            ) from error
        except (TypeError, RuntimeError) as error:
            # What Dask raises for an address of TLS without a certificate, and for
            # one without TLS where its configuration requires encryption.
            raise UsageError(
                f"Dask's configuration does not fit {address!r} ({error}); TLS wants "
                "the certificate of an authority, and a certificate and key of our "
                "own: see security.md"
            ) from error

    def prepare(self) -> None:
        """See :class:`Workers`; the cluster runs already."""

    def run(
        self,
        function: Callable[..., Any],
        tasks: Sequence[tuple[Any, ...]],
        done: Callable[[int], None] = _ignore,
        found: Callable[[int, Any], None] = _pass_over,
    ) -> list[Any]:
        """See :class:`Workers`.

        The scheduler gives tasks of a worker that died to another one.
        """
        from distributed import as_completed  # noqa: PLC0415 - optional dependency

        parts = chunks(tasks)
        first = _firsts(parts)
        futures = self._client.map(
            _several,
            [function] * len(parts),
            parts,
            pure=False,
            retries=_DEATHS,
        )
        numbers = {future.key: index for index, future in enumerate(futures)}
        results: dict[int, list[Any]] = {}
        completed = as_completed(futures, loop=self._client.loop, with_results=True)
        for future, values in completed:
            index = numbers[future.key]
            results[index] = values
            _tell(found, first[index], values)
            done(len(values))
        return [value for index in sorted(results) for value in results[index]]

    def close(self) -> None:
        """Leave the cluster; it goes on without us."""
        self._client.close()


@contextmanager
def workers(jobs: int | None, cluster: str | None) -> Iterator[Workers]:
    """Provide workers as the options ask for, and let them go afterwards.

    Parameters
    ----------
    jobs
        Processes; None: one for every core this process may use.
    cluster
        Address of a Dask scheduler; takes precedence.

    Raises
    ------
    UsageError
        If ``jobs`` is not positive or the cluster cannot be reached.
    """
    if cluster is not None:
        remote = Cluster(cluster)
        try:
            yield remote
        finally:
            remote.close()
        return
    count = usable_cores() if jobs is None else jobs
    if count < 1:
        raise UsageError(f"{count} jobs asked for; wanted 1 or more")
    if count == 1:
        yield InProcess()
        return
    local = Processes(count)
    try:
        yield local
    except BaseException:
        local.stop()
        raise
    finally:
        local.close()


@contextmanager
def _single_threaded() -> Iterator[None]:
    """One thread a solver: the processes share the cores already."""
    before = {name: os.environ.get(name) for name in _THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(_THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _warm() -> None:
    """Import what the work needs before it arrives."""
    for name in _PRELOAD:
        importlib.import_module(name)
