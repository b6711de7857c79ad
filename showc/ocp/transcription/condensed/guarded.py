"""Calling a solver that may never return, in a child that can be stopped.

fatrop's search for a regularisation has been seen to go on for ever on a degenerate
iterate, inside native code that no signal handler of Python reaches. The calls
therefore run in a forked child with a limit on its processor time; the limit counts
the child's own work, so a busy machine does not change the outcome. The child is kept
for the next call and ends with its parent, or when too many others were used since.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import warnings
import weakref
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from showc.arrays import FloatArray


AVAILABLE = sys.platform == "linux" and hasattr(os, "fork")
"""Whether this platform can fork a process with native libraries loaded."""
PATIENCE = 30.0
"""Wall time over processor time after which the child counts as stuck."""
KEPT = 2
"""Children kept alive by one process: each has some 80 MB of its own. More save a
twentieth of the processor time of a leg at most."""

_alive: dict[int, weakref.ref[Guarded]] = {}
"""Those that have a child, by ``id``, the longest unused first."""


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What the solver gave: a point of the scaled program."""

    unknowns: FloatArray
    rows: FloatArray
    """Values of the constraint rows at that point."""
    objective: float
    success: bool
    iterations: int


class Guarded:
    """A CasADi solver behind a child process.

    Parameters
    ----------
    solver
        Function as made by ``casadi.nlpsol``.
    names, sizes
        Names and lengths of its arguments, in the order in which they are sent.
    answer
        Numbers of unknowns and of constraint rows.
    seconds
        Processor time granted to one call [s].
    """

    def __init__(
        self,
        solver: Any,  # noqa: ANN401 - a CasADi function
        names: Sequence[str],
        sizes: Sequence[int],
        answer: tuple[int, int],
        seconds: float,
    ) -> None:
        self._solver = solver
        self._names, self._sizes = tuple(names), tuple(sizes)
        self._answer, self._seconds = answer, seconds
        self._owner = self._child = 0
        self._to = self._back = -1

    def __call__(self, arguments: Sequence[FloatArray]) -> Answer | None:
        """Solve once; None if the child had to be stopped."""
        if self._child == 0 or self._owner != os.getpid():
            self._start()
        _alive[id(self)] = _alive.pop(id(self), weakref.ref(self))
        wanted = 8 * (3 + sum(self._answer))
        try:
            _send(self._to, np.concatenate(arguments).astype(np.float64).tobytes())
            received = _receive(self._back, wanted, PATIENCE * (1.0 + self._seconds))
        except OSError:
            received = b""
        if len(received) != wanted:
            self._stop()
            return None
        values = np.frombuffer(received, dtype=np.float64)
        unknowns, rows = np.split(values[3:], [self._answer[0]])
        success, iterations, objective = values[:3].tolist()
        return Answer(
            unknowns.copy(), rows.copy(), objective, bool(success), int(iterations)
        )

    def _start(self) -> None:
        for key, reference in list(_alive.items()):
            other = reference()
            if other is None or other._owner != os.getpid():  # noqa: SLF001
                del _alive[key]  # inherited by fork: its child is not ours
            elif len(_alive) >= KEPT:
                other._stop()  # noqa: SLF001 - of its own kind
        from_parent, self._to = os.pipe()
        self._back, to_parent = os.pipe()
        with warnings.catch_warnings():
            # The child runs native code and leaves by _exit; it needs no lock of ours.
            warnings.simplefilter("ignore", DeprecationWarning)
            child = os.fork()
        if child == 0:
            _close_all_but(from_parent, to_parent)
            self._serve(from_parent, to_parent)
        os.close(from_parent)
        os.close(to_parent)
        self._child, self._owner = child, os.getpid()

    def _stop(self) -> None:
        _alive.pop(id(self), None)
        os.close(self._to)
        os.close(self._back)
        os.kill(self._child, signal.SIGKILL)
        os.waitpid(self._child, 0)
        self._child = 0

    def __del__(self) -> None:
        if sys is None or sys.is_finalizing():
            # Modules are being taken apart; the child ends with our end of its pipe.
            return
        # A process forked later has copies of our pipes, but the child is not its own.
        if self._child and self._owner == os.getpid():
            self._stop()

    def _serve(self, reading: int, writing: int) -> NoReturn:
        """Answer calls until the parent is gone."""
        try:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.signal(signal.SIGPROF, signal.SIG_DFL)
            borders = np.cumsum(self._sizes)[:-1]
            wanted = 8 * sum(self._sizes)
            while len(received := _receive(reading, wanted, None)) == wanted:
                values = np.frombuffer(received, dtype=np.float64)
                parts = np.split(values, borders)
                signal.setitimer(signal.ITIMER_PROF, self._seconds)
                answer = self._solver(**dict(zip(self._names, parts, strict=True)))
                statistics = self._solver.stats()
                head = [
                    float(statistics["success"]),
                    float(statistics["iter_count"]),
                    float(answer["f"]),
                ]
                found = [np.array(answer[name]).ravel() for name in ("x", "g")]
                signal.setitimer(signal.ITIMER_PROF, 0.0)
                _send(writing, np.concatenate([head, *found]).tobytes())
        finally:
            os._exit(0)


def _close_all_but(reading: int, writing: int) -> None:
    """Close what a child has inherited besides these and the standard streams.

    It would keep pipes and locks of the parent open: a process pool that ends while it
    writes to workers waits for ever for the last reader to go.
    """
    first, last = sorted((reading, writing))
    os.closerange(3, first)
    os.closerange(first + 1, last)
    os.closerange(last + 1, os.sysconf("SC_OPEN_MAX"))


def _send(writing: int, payload: bytes) -> None:
    sent = 0
    while sent < len(payload):
        sent += os.write(writing, payload[sent : sent + (1 << 16)])


def _receive(reading: int, wanted: int, patience: float | None) -> bytes:
    """Read some bytes, fewer if the other end closes or ``patience`` [s] ends."""
    parts: list[bytes] = []
    missing = wanted
    while missing and select.select([reading], [], [], patience)[0]:
        part = os.read(reading, min(missing, 1 << 16))
        if not part:
            break
        parts.append(part)
        missing -= len(part)
    return b"".join(parts)
