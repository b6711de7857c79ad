"""What processes side by side say of their work, heard while they are at it.

Each task appends its lines to a file of its own; a thread of the watching process reads
them. A file needs no connection that a dying worker could break.
"""

from __future__ import annotations

import time
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import TYPE_CHECKING

from showc.files import scratch
from showc.progress import Silent

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from showc.progress import Progress

_PAUSE = 1.0
"""Time between two looks at the files [s]; of what a task says meanwhile only the last
line is worth reading."""
_QUIET = 10.0
"""Time without a line after which those at work are named [s]."""


class Journal(Silent):
    """Writes what is worth a line into a file, with the time since the task began."""

    def __init__(self, path: Path | None) -> None:
        self._path, self._begun = path, time.monotonic()
        self.note("begun")

    def note(self, text: str) -> None:
        """Append a line; nothing happens without a file, or where the disk is full."""
        if self._path is None or not self._path.parent.is_dir():
            return
        elapsed = time.monotonic() - self._begun
        with suppress(OSError), self._path.open("a", encoding="utf-8") as file:
            file.write(f"{text} ({elapsed:.0f} s)\n")


class Journals:
    """The files of some tasks, read while they grow."""

    def __init__(self, folder: Path, names: Sequence[str], progress: Progress) -> None:
        self.paths = [folder / f"{number}.txt" for number in range(len(names))]
        self._names, self._progress = names, progress
        self._read = [0] * len(names)
        self._done: set[int] = set()
        self._begun = self._heard = time.monotonic()

    def close(self, number: int) -> None:
        """Hear no more of a task: its result is there."""
        self._done.add(number)
        self._heard = time.monotonic()

    def listen(self) -> None:
        """Pass the last new line of each task on, or name those at work."""
        working = []
        for number, path in enumerate(self.paths):
            if number in self._done or not path.is_file():
                continue
            working.append(self._names[number])
            lines = path.read_text(encoding="utf-8").splitlines()
            # The first one only says that the task has begun.
            fresh = lines[max(self._read[number], 1) :]
            self._read[number] = len(lines)
            if fresh:
                self._progress.note(fresh[-1])
                self._heard = time.monotonic()
        now = time.monotonic()
        if working and now - self._heard >= _QUIET:
            self._heard = now
            self._progress.note(
                f"after {now - self._begun:.0f} s still solving: {', '.join(working)}"
            )


@contextmanager
def journals(names: Sequence[str], progress: Progress) -> Iterator[Journals]:
    """Provide a file for each of the named tasks, and listen to them meanwhile."""
    over = Event()
    with scratch() as folder:
        kept = Journals(folder, names, progress)

        def listen() -> None:
            while not over.wait(_PAUSE):
                kept.listen()

        thread = Thread(target=listen, daemon=True)
        thread.start()
        try:
            yield kept
        finally:
            over.set()
            thread.join()
