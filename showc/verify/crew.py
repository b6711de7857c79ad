"""Independent parts of the proof, done side by side in copies of this process.

A copy made by the system's ``fork`` has everything that was read already, without any
of it being sent; what it finds comes back through a pipe. The parts are handed out one
by one through a second pipe, which all copies share. Who works changes nothing in what
is found: results come back in the order of the parts, and what a copy that died left
undone is done here.
"""

from __future__ import annotations

import os
import pickle
import signal
import struct
import sys
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Part = Callable[[], Any]

_NUMBER = struct.Struct("<H")
_MOST = 1000
"""Parts handed out at most; their numbers fit into the smallest of pipes."""


def cores() -> int:
    """Count the processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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
        Numbers of all parts in the order in which copies are to begin them: what takes
        long comes first, lest one copy do it when the others are idle. None: as they
        are.

    Raises
    ------
    Exception
        Whatever the first part (in their order) that failed raised.
    """
    wanted = min(cores() if jobs is None else jobs, len(parts))
    found: dict[int, tuple[bool, Any]] = {}
    if wanted > 1 and len(parts) <= _MOST and sys.platform == "linux":
        numbers = range(len(parts)) if begin is None else begin
        found = _shared(parts, numbers, wanted, done)
    results = []
    for number, part in enumerate(parts):
        if number in found:
            good, value = found[number]
            if not good:
                raise value
            results.append(value)
        else:
            results.append(part())
            done()
    return results


def _shared(
    parts: Sequence[Part], begin: Sequence[int], jobs: int, done: Callable[[], None]
) -> dict[int, tuple[bool, Any]]:
    """Whether each part went well, and what it gave; without those of the dead."""
    orders, give = os.pipe()
    os.write(give, b"".join(_NUMBER.pack(number) for number in begin))
    os.close(give)
    copies: dict[Connection, int] = {}
    found: dict[int, tuple[bool, Any]] = {}
    waiting: list[Connection] = []
    try:
        for _ in range(jobs):
            receive, send = os.pipe()
            process = os.fork()
            if process == 0:
                _work(parts, orders, send)
            os.close(send)
            copies[Connection(receive, writable=False)] = process
        waiting = list(copies)
        while waiting:
            for connection in wait(waiting):
                assert isinstance(connection, Connection)  # noqa: S101 - put in above
                try:
                    report = connection.recv_bytes()
                    number, good, value = pickle.loads(report)  # noqa: S301 - our own
                except (EOFError, OSError):
                    waiting.remove(connection)
                    continue
                found[number] = good, value
                done()
        return found
    finally:
        os.close(orders)
        for connection, process in copies.items():
            if connection in waiting:  # interrupted: what it still does is of no use
                with suppress(OSError):
                    os.kill(process, signal.SIGKILL)
            connection.close()
            with suppress(OSError):
                os.waitpid(process, 0)


def _work(parts: Sequence[Part], orders: int, send: int) -> NoReturn:
    """Do parts until none is left; ends this process."""
    status = 1
    try:
        connection = Connection(send, readable=False)
        while order := os.read(orders, _NUMBER.size):
            (number,) = _NUMBER.unpack(order)
            try:
                report = number, True, parts[number]()
            except Exception as error:  # noqa: BLE001 - raised again by who asked
                report = number, False, error
            connection.send_bytes(pickle.dumps(report))
        status = 0
    finally:
        # Neither the parent's open files nor its clean-up are this copy's business.
        os._exit(status)
