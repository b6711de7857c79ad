"""The code of a kind of finding, and what ``showc explain`` says about it."""

from __future__ import annotations

from dataclasses import dataclass

from showc.script.diagnostic import Severity


@dataclass(frozen=True, slots=True)
class Code:
    """One kind of finding."""

    code: str
    """``SHW`` and three digits."""
    title: str
    """What it is, in a few words."""
    cause: str
    """Why it is reported."""
    repair: str
    """What to do."""
    example: str = ""
    """Part of a script, or a situation, that causes it."""
    severity: Severity = Severity.ERROR
    """How bad it is unless a caller is strict."""
    instead: str = ""
    """Part of a script that says the same without the finding."""
