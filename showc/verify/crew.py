"""Independent parts of the proof, done side by side in copies of this process.

A copy made by the system's ``fork`` has everything that was read already, without any
of it being sent; what it finds comes back pickled. The number of workers changes
nothing in what is found: results come back in the order of the parts, and what a copy
that died left undone is done here.
"""

from __future__ import annotations

import multiprocessing
import sys
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, as_completed
from typing import TYPE_CHECKING, Any

from showc.processes import guarded_group, join_group, undisturbed, usable_cores

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Part = Callable[[], Any]

_at_work: list[Sequence[Part]] = [()]
"""Parts that copies made now will know; the last entry counts."""


def _ignore() -> None:
    """Take no notice."""


def run_all(
    parts: Sequence[Part],
    jobs: int | None = None,
    done: Callable[[], None] = _ignore,
    *,
    begin: Sequence[int] | None = None,
) -> list[Any]:
    """Call every part; return what they return, in their order.

    Parameters
    ----------
    parts
        Functions without arguments that change nothing and depend on nothing that
        changes.
    jobs
        Processes to share the work; None: one for each core. Where the system cannot
        copy a process safely (elsewhere than on Linux), the work is done in this one.
    done
        Told of each part that is finished.
    begin
        Numbers of all parts in the order in which copies are to begin them: with what
        takes long first, no copy works alone at the end. None: as they are.

    Raises
    ------
    Exception
        Whatever the first part (in their order) that failed raised.
    """
    count = min(usable_cores() if jobs is None else jobs, len(parts))
    futures: dict[int, Future[Any]] = {}
    if count > 1 and sys.platform == "linux":
        futures = _shared(parts, begin or range(len(parts)), count, done)
    results = []
    for number, part in enumerate(parts):
        future = futures.get(number)
        if future is not None and not isinstance(future.exception(), BrokenExecutor):
            results.append(future.result())
            continue
        results.append(part())
        done()
    return results


def _shared(
    parts: Sequence[Part], begin: Sequence[int], count: int, done: Callable[[], None]
) -> dict[int, Future[Any]]:
    """Let copies do the parts; return what each came to."""
    executor = ProcessPoolExecutor(
        count,
        multiprocessing.get_context("fork"),
        initializer=join_group,
        initargs=(guarded_group(),),
    )
    _at_work.append(parts)
    try:
        # The first order makes the copies.
        with undisturbed():
            futures = {number: executor.submit(_call, number) for number in begin}
        for future in as_completed(futures.values()):
            if not isinstance(future.exception(), BrokenExecutor):
                done()
    except BaseException:
        for process in list((getattr(executor, "_processes", None) or {}).values()):
            process.kill()
        raise
    finally:
        _at_work.pop()
        executor.shutdown(cancel_futures=True)
    return futures


def _call(number: int) -> Any:  # noqa: ANN401 - whatever the part returns
    """Do one part, in a copy."""
    return _at_work[-1][number]()
