"""Work on several legs at once, in copies of this process.

A copy made by the system's ``fork`` has the whole show already; only what it finds is
sent back. The number of workers changes nothing in what is found.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TypeVar

from showc.processes import guarded_group, join_group, undisturbed, usable_cores

if TYPE_CHECKING:
    from collections.abc import Callable

    Result = TypeVar("Result")

_work: list[Callable[[int], Any]] = []
"""What copies are to do: they inherit it."""


def _ignore() -> None:
    """Take no notice."""


def side_by_side(
    work: Callable[[int], Result],
    count: int,
    jobs: int | None,
    done: Callable[[], None] = _ignore,
) -> list[Result]:
    """Return what ``work`` gives for 0, 1, ... ``count`` - 1.

    Parameters
    ----------
    work
        Depends on nothing that changes; what it gives, or raises, can be pickled.
    count
        How many pieces there are.
    jobs
        Processes; None: one for each core. Where the system cannot copy a process
        safely (elsewhere than on Linux), and for one piece, this one does all.
    done
        Told of each piece that is finished, in their order.

    Raises
    ------
    Exception
        What the first piece that failed, in their order, has raised.
    """
    wanted = min(usable_cores() if jobs is None else jobs, count)
    found: list[Result] = []
    if wanted > 1 and sys.platform == "linux":
        _in_copies(work, count, wanted, found, done)
    # What copies that died left undone is done here.
    for number in range(len(found), count):
        found.append(work(number))
        done()
    return found


def _in_copies(
    work: Callable[[int], Result],
    count: int,
    jobs: int,
    found: list[Result],
    done: Callable[[], None],
) -> None:
    """Add what copies find to ``found``, in order, up to the first that died."""
    # Not needed for small shows, which are the most.
    from concurrent.futures import ProcessPoolExecutor  # noqa: PLC0415
    from concurrent.futures.process import BrokenProcessPool  # noqa: PLC0415
    from multiprocessing import active_children, get_context  # noqa: PLC0415

    before = set(active_children())
    _work.append(work)
    crew = ProcessPoolExecutor(
        jobs, get_context("fork"), initializer=join_group, initargs=(guarded_group(),)
    )
    try:
        # From their first instruction on: the process that was copied ends them.
        with undisturbed():
            futures = [crew.submit(_do, number) for number in range(count)]
        for future in futures:
            found.append(future.result())
            done()
    except BrokenProcessPool:
        pass
    except BaseException:
        for process in set(active_children()) - before:
            process.terminate()
        raise
    finally:
        crew.shutdown(cancel_futures=True)
        _work.pop()


def _do(number: int) -> Any:  # noqa: ANN401 - whatever the work gives
    return _work[-1](number)
