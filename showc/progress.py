"""What long work reports to its watcher: a protocol, and the silent one."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Receives the course of long work; the command line draws it."""

    def stage(self, title: str, total: int | None = None) -> None:
        """Begin a new stage, of ``total`` steps if that is known."""

    def advance(self, steps: int = 1) -> None:
        """Count steps of the present stage as done."""

    def note(self, text: str) -> None:
        """Say something worth a line of its own."""


class Silent:
    """Watches without a word."""

    def stage(self, title: str, total: int | None = None) -> None:
        """Ignore the stage."""

    def advance(self, steps: int = 1) -> None:
        """Ignore the steps."""

    def note(self, text: str) -> None:
        """Ignore the text."""
