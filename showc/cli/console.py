"""The terminal: where progress goes, and whether there is colour."""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rich.progress import Progress as Bars
    from rich.progress import TaskID

    from showc.progress import Progress


def colour_wanted(stream: Any) -> bool:
    """Whether ``stream`` should be written in colour.

    NO_COLOR forbids it, FORCE_COLOR demands it, TERM=dumb and anything that is no
    terminal go without.
    """
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return bool(stream.isatty()) and os.environ.get("TERM") != "dumb"


def columns(rows: Sequence[Sequence[str]], words: tuple[int, ...] = (0,)) -> list[str]:
    """Lay cells out in columns: ``words`` to the left, figures to the right."""
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if at in words else cell.rjust(width)
            for at, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


class _Lines:
    """Progress in lines on standard error, at most one in an interval [s]."""

    def __init__(self, interval: float) -> None:
        self._interval = interval
        self._title, self._done = "", 0
        self._total: int | None = None
        self._spoken = self._begun = time.monotonic()


class PlainProgress(_Lines):
    """One line a stage, and now and then how far it is."""

    def stage(self, title: str, total: int | None = None) -> None:
        """Say the title."""
        self._title, self._total, self._done = title, total, 0
        self._spoken = self._begun = time.monotonic()
        click.echo(title, err=True)

    def advance(self, steps: int = 1) -> None:
        """Say how far the stage is, at most every few seconds."""
        self._done += steps
        now = time.monotonic()
        if now - self._spoken >= self._interval:
            self._spoken = now
            click.echo(f"  {self._title}: {self._figures(now)}", err=True)

    def note(self, text: str) -> None:
        """Say it."""
        click.echo(f"  {text}", err=True)

    def _figures(self, now: float) -> str:
        if not self._total:
            return f"{self._done} done"
        elapsed = now - self._begun
        left = elapsed * (self._total - self._done) / max(self._done, 1)
        return f"{self._done} of {self._total}, about {max(left, 0.0):.0f} s left"


class JsonProgress(_Lines):
    """One JSON object a line, for programs that wait."""

    def stage(self, title: str, total: int | None = None) -> None:
        """Say the title, and of how many steps it is."""
        self._title, self._total, self._done = title, total, 0
        self._say()

    def advance(self, steps: int = 1) -> None:
        """Say how far the stage is, at most every second."""
        self._done += steps
        if time.monotonic() - self._spoken >= self._interval:
            self._say()

    def note(self, text: str) -> None:
        """Say it."""
        self._say(note=text)

    def _say(self, **more: str) -> None:
        self._spoken = time.monotonic()
        line = {
            "elapsed": round(self._spoken - self._begun, 1),
            "stage": self._title,
            "done": self._done,
            "total": self._total,
            **more,
        }
        click.echo(json.dumps(line, ensure_ascii=False), err=True)


class BarProgress:
    """One bar on a terminal: that of the present stage."""

    def __init__(self, bars: Bars) -> None:
        self._bars = bars
        self._task: TaskID | None = None

    def stage(self, title: str, total: int | None = None) -> None:
        """Put a new bar in the place of the one before."""
        self.finish()
        self._task = self._bars.add_task(title, total=total)

    def advance(self, steps: int = 1) -> None:
        """Move the bar."""
        if self._task is not None:
            self._bars.advance(self._task, steps)

    def note(self, text: str) -> None:
        """Print above the bar."""
        self._bars.console.print(f"  {text}", highlight=False, markup=False)

    def finish(self) -> None:
        """Take the bar away; what was done shows in the result."""
        if self._task is not None:
            self._bars.remove_task(self._task)
            self._task = None


@contextmanager
def progress(*, quiet: bool, as_json: bool = False) -> Iterator[Progress]:
    """Give long work something to report to.

    Bars on a terminal, plain lines elsewhere, a JSON object a line if ``as_json``,
    silence if ``quiet``; always on standard error, so that standard output is the
    result alone.
    """
    from showc.progress import Silent

    if quiet:
        yield Silent()
    elif as_json:
        yield JsonProgress(1.0)
    elif colour_wanted(sys.stderr) and sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeRemainingColumn,
        )

        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        console = Console(stderr=True)
        with Progress(*columns, console=console, transient=True) as bars:
            watcher = BarProgress(bars)
            yield watcher
            watcher.finish()
    else:
        yield PlainProgress(5.0)
