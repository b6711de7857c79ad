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
from functools import partial
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any, NoReturn, Self

from showc.processes import guarded_group, join_group, usable_cores

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Part = Callable[[], Any]

_NUMBER = struct.Struct("<H")
_MOST = 1000
"""Parts handed out at most; their numbers fit into the smallest of pipes."""


def _ignore() -> None:
    """Take no notice."""


class Ahead:
    """A part that a copy of this process does while this one goes on.

    It is a part like any other: who calls it does it here, and :func:`run_all` waits
    for the copy. To be used in a ``with`` statement, which leaves no copy behind.
    """

    def __init__(self, part: Part, jobs: int | None = None) -> None:
        self._part = part
        self.connection: Connection | None = None
        """Where the copy's report comes from; None if there is no copy."""
        self.process = 0
        """Number of the copy."""
        if _wanted(jobs) > 1 and sys.platform == "linux":
            self.connection, self.process = _copy(partial(_report, 0, part))

    def __call__(self) -> Any:  # noqa: ANN401 - as of all parts
        """Do the part here."""
        return self._part()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the copy if it still works: nobody will ask for what it finds."""
        if self.connection is not None:
            _end(self.connection, self.process)
            self.connection = None


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
        changes. What is an :class:`Ahead` has been begun already.
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
    wanted = min(_wanted(jobs), len(parts))
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


def _wanted(jobs: int | None) -> int:
    return usable_cores() if jobs is None else jobs


def _shared(
    parts: Sequence[Part], begin: Sequence[int], jobs: int, done: Callable[[], None]
) -> dict[int, tuple[bool, Any]]:
    """Whether each part went well, and what it gave; without those of the dead."""
    ahead = {
        part.connection: number
        for number, part in enumerate(parts)
        if isinstance(part, Ahead) and part.connection is not None
    }
    rest = [number for number in begin if number not in ahead.values()]
    orders, give = os.pipe()
    os.write(give, b"".join(_NUMBER.pack(number) for number in rest))
    os.close(give)
    copies: dict[Connection, int] = {}
    found: dict[int, tuple[bool, Any]] = {}
    waiting: list[Connection] = list(ahead)

    def one_more() -> None:
        connection, process = _copy(partial(_work, parts, orders))
        copies[connection] = process
        waiting.append(connection)

    try:
        for _ in range(min(max(jobs - len(ahead), 1), len(rest))):
            one_more()
        while waiting:
            for connection in wait(waiting):
                assert isinstance(connection, Connection)  # noqa: S101 - put in above
                try:
                    report = connection.recv_bytes()
                    number, good, value = pickle.loads(report)  # noqa: S301 - our own
                except (EOFError, OSError):
                    waiting.remove(connection)
                    continue
                if connection in ahead:
                    # Its copy ends here; another one helps with the rest.
                    number = ahead[connection]
                    waiting.remove(connection)
                    if len(found) + 1 < len(parts):
                        one_more()
                found[number] = good, value
                done()
        return found
    finally:
        os.close(orders)
        for connection, process in copies.items():
            _end(connection, process, kill=connection in waiting)


def _copy(work: Callable[[Connection], None]) -> tuple[Connection, int]:
    """Let a copy of this process ``work``; where it reports to, and its number."""
    group = guarded_group()
    receive, send = os.pipe()
    # A copy never hears an interrupt, not even in its first instant: it is ended.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        process = os.fork()
        if process == 0:
            _do(work, send, group)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    os.close(send)
    return Connection(receive, writable=False), process


def _do(work: Callable[[Connection], None], send: int, group: int) -> NoReturn:
    """Do ``work``; ends this process."""
    status = 1
    try:
        join_group(group)
        work(Connection(send, readable=False))
        status = 0
    finally:
        # Neither the parent's open files nor its clean-up are this copy's business.
        os._exit(status)


def _work(parts: Sequence[Part], orders: int, connection: Connection) -> None:
    """Do parts until none is left."""
    while order := os.read(orders, _NUMBER.size):
        (number,) = _NUMBER.unpack(order)
        _report(number, parts[number], connection)


def _report(number: int, part: Part, connection: Connection) -> None:
    """Do a part, and say what it gave."""
    try:
        report = number, True, part()
    except Exception as error:  # noqa: BLE001 - raised again by who asked
        report = number, False, error
    connection.send_bytes(pickle.dumps(report))


def _end(connection: Connection, process: int, *, kill: bool = True) -> None:
    """Take leave of a copy; if it still works, what it does is of no use."""
    if kill:
        with suppress(OSError):
            os.kill(process, signal.SIGKILL)
    connection.close()
    with suppress(OSError):
        os.waitpid(process, 0)
