"""A command with all its descendants: time, processor time and memory they need."""

from __future__ import annotations

import ctypes
import os
import resource
import subprocess
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.clock import descendants

if TYPE_CHECKING:
    from collections.abc import Sequence

_ADOPT = 36
"""PR_SET_CHILD_SUBREAPER: orphans of the command become children of this process."""

_EVERY = 0.5
"""Time between two looks at the memory [s]."""


@dataclass(frozen=True, slots=True)
class Needed:
    """What a command and its descendants needed together."""

    code: int
    """Exit code; -1 if it was stopped."""
    output: str
    """What it wrote to both standard streams."""
    wall: float
    """Time from start to end [s]."""
    processor: float
    """Processor time of all, those that outlived their parents included [s]."""
    memory: float
    """Greatest memory of all at one time, shared pages counted once [MiB]."""


def run(
    command: Sequence[str],
    folder: Path,
    *,
    limit: float = 3600.0,
    environment: dict[str, str] | None = None,
) -> Needed:
    """Run ``command`` in ``folder`` and watch over its family; Linux only.

    It is stopped, with all its descendants, after ``limit`` seconds.
    """
    ctypes.CDLL(None).prctl(_ADOPT, 1, 0, 0, 0)
    output = folder / "output.txt"
    others = set(descendants())  # children of this process that are none of its
    before = _ended()
    begun = time.perf_counter()
    memory = 0.0
    with output.open("w") as stream:
        process = subprocess.Popen(
            list(command),
            cwd=folder,
            stdout=stream,
            stderr=subprocess.STDOUT,
            env={**os.environ, **(environment or {})},
        )
        stopped, wall = False, None
        while True:
            family = set(descendants()) - others
            memory = max(memory, sum(map(_memory, family)))
            if wall is None and process.poll() is not None:
                wall = time.perf_counter() - begun
            if wall is None and time.perf_counter() - begun > limit:
                stopped = True
                for member in family:
                    with suppress(OSError):
                        os.kill(member, 9)
            # Orphans that were adopted count when they have ended.
            orphans = family - {process.pid}
            for member in orphans:
                with suppress(ChildProcessError):
                    os.waitpid(member, os.WNOHANG)
            if wall is None:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(_EVERY)
            elif orphans:
                time.sleep(0.1 * _EVERY)
            else:
                break
    code = -1 if stopped else process.returncode
    return Needed(
        code, output.read_text(errors="replace"), wall, _ended() - before, memory
    )


def _ended() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _memory(process: int) -> float:
    """Proportional share of a process [MiB]: a page of two processes counts half."""
    with suppress(OSError, ValueError, IndexError):
        rollup = Path(f"/proc/{process}/smaps_rollup").read_text()
        for line in rollup.splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) / 1024.0
    return 0.0
