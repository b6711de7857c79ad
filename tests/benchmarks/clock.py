"""CPU time of this process and of all its children, those still at work included."""

from __future__ import annotations

import contextlib
import os
import resource
import time
from pathlib import Path


def cpu_time() -> float:
    """CPU time used so far by this process and its descendants [s].

    Children that have ended are counted by the system; for those still alive (a solver
    in a process of its own, say) their scheduler's counters are read, which exist on
    Linux only. Without them such children count when they have ended.
    """
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    total = time.process_time() + ended.ru_utime + ended.ru_stime
    return total + sum(_alive(child) for child in descendants())


def descendants() -> list[int]:
    """Processes that are children of this one, or theirs, and alive."""
    parents: dict[int, int] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        # A process may end while it is looked at.
        with contextlib.suppress(OSError, ValueError, IndexError):
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            parents[int(folder.name)] = int(fields[1])
    family = {os.getpid()}
    while True:
        more = {child for child, parent in parents.items() if parent in family}
        if more <= family:
            return sorted(family - {os.getpid()})
        family |= more


def _alive(process: int) -> float:
    nanoseconds = 0
    for task in Path(f"/proc/{process}/task").glob("*/schedstat"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            nanoseconds += int(task.read_text().split()[0])
    with contextlib.suppress(OSError, ValueError, IndexError):
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        ticks = int(fields[13]) + int(fields[14])  # its own children that have ended
        nanoseconds += ticks * 1_000_000_000 // os.sysconf("SC_CLK_TCK")
    return nanoseconds * 1e-9
