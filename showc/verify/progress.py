"""What the verification reports to its watcher: a protocol, and the silent one."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Receives the course of the work."""

    def stage(self, title: str, total: int | None = None) -> None:
        """Begin a new stage."""

    def advance(self, steps: int = 1) -> None:
        """Count steps as done."""


class Silent:
    """Watches without a word."""

    def stage(self, title: str, total: int | None = None) -> None:
        """Ignore the stage."""

    def advance(self, steps: int = 1) -> None:
        """Ignore the steps."""
