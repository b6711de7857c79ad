"""Calling a solver that may never return, in a child that can be stopped.

fatrop's search for a regularisation has been seen to go on for ever on a degenerate
iterate, inside native code that no signal handler of Python reaches. The call
therefore runs in a forked child with a limit on its processor time; the limit counts
the child's own work, so a busy machine does not change the outcome.
"""

from __future__ import annotations

import os
import select
import signal
import sys
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

AVAILABLE = sys.platform == "linux" and hasattr(os, "fork")
"""Whether this platform can fork a process with native libraries loaded."""
PATIENCE = 30.0
"""Wall time over processor time after which the child counts as stuck."""


def call_guarded(
    solver: Any,  # noqa: ANN401 - a CasADi function
    arguments: Mapping[str, FloatArray],
    sizes: tuple[int, int],
    seconds: float,
) -> tuple[FloatArray, FloatArray, float, dict[str, float]] | None:
    """Call a CasADi solver in a child process.

    Parameters
    ----------
    solver
        Function as made by ``casadi.nlpsol``.
    arguments
        Its numeric arguments.
    sizes
        Numbers of unknowns and of constraint rows.
    seconds
        Processor time granted [s].

    Returns
    -------
    tuple or None
        Unknowns, rows, objective, and ``success`` and ``iter_count``; ``None`` if the
        child had to be stopped.
    """
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        # The child runs native code and leaves by _exit; no lock of ours is held.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        os.close(reading)
        _answer(writing, solver, arguments, seconds)
    os.close(writing)
    wanted = 8 * (3 + sum(sizes))
    received = _receive(reading, PATIENCE * (1.0 + seconds))
    os.close(reading)
    if len(received) != wanted:
        os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    if len(received) != wanted:
        return None
    values = np.frombuffer(received, dtype=np.float64)
    unknowns, rows = values[3 : 3 + sizes[0]], values[3 + sizes[0] :]
    statistics = {"success": float(values[0]), "iter_count": float(values[1])}
    return unknowns.copy(), rows.copy(), float(values[2]), statistics


def _answer(
    writing: int,
    solver: Any,  # noqa: ANN401
    arguments: Mapping[str, FloatArray],
    seconds: float,
) -> None:
    """Solve, send the numbers, and leave; never returns."""
    try:
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, seconds)
        answer = solver(**arguments)
        statistics = solver.stats()
        head = [
            float(statistics["success"]),
            float(statistics["iter_count"]),
            float(answer["f"]),
        ]
        payload = np.concatenate(
            [head, np.array(answer["x"]).ravel(), np.array(answer["g"]).ravel()]
        ).tobytes()
        sent = 0
        while sent < len(payload):
            sent += os.write(writing, payload[sent:])
    finally:
        os._exit(0)


def _receive(reading: int, patience: float) -> bytes:
    """Read until the other end closes, or nothing comes for ``patience`` [s]."""
    parts: list[bytes] = []
    while select.select([reading], [], [], patience)[0]:
        part = os.read(reading, 1 << 16)
        if not part:
            break
        parts.append(part)
    return b"".join(parts)
