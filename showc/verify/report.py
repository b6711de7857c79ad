"""What verification found: checks, the verdict, a table for people and JSON."""

from __future__ import annotations

import json
import math
import textwrap
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Sequence

Verdict = Literal["pass", "fail", "warning", "skipped"]

FORMAT_VERSION = 1
"""Version of the JSON result."""

_WIDTH = 96
"""Columns of the notes under a check."""

_COLOURS = {"pass": "32", "fail": "1;31", "warning": "33", "skipped": "2"}
_WORDS = {"pass": "ok", "fail": "FAIL", "warning": "warn", "skipped": "-"}


@dataclass(frozen=True, slots=True)
class Place:
    """Where in the show, or in the file, something was found; unknown parts None."""

    drone: int | None = None
    """Drone, counting from 1."""
    pair: tuple[int, int] | None = None
    """Pair of drones, counting from 1."""
    segment: str | None = None
    """Name of the segment."""
    time: float | None = None
    """Show time [s]."""
    offset: int | None = None
    """Byte offset in the file."""
    file: str | None = None
    """Name of another file than the log."""

    def __str__(self) -> str:
        parts = []
        if self.file is not None:
            parts.append(self.file)
        if self.pair is not None:
            parts.append(f"drones {self.pair[0]} and {self.pair[1]}")
        if self.drone is not None:
            parts.append(f"drone {self.drone}")
        if self.segment is not None:
            parts.append(f"“{self.segment}”")
        if self.time is not None:
            parts.append(f"at {self.time:.3f} s")
        if self.offset is not None:
            parts.append(f"byte {self.offset:,}")
        return ", ".join(parts)

    def to_json(self) -> dict[str, Any]:
        """Return only what is known."""
        known = {
            "drone": self.drone,
            "pair": None if self.pair is None else list(self.pair),
            "segment": self.segment,
            "time": self.time,
            "offset": self.offset,
            "file": self.file,
        }
        return {key: value for key, value in known.items() if value is not None}


@dataclass(frozen=True, slots=True)
class Check:
    """One statement about the show, and whether it holds."""

    code: str
    """``VRF`` and three digits; what it means is in ``codes``."""
    group: str
    """Heading it stands under: integrity, physics, limits, ..."""
    name: str
    """What is proved, in words."""
    verdict: Verdict
    """Whether it holds; ``skipped``: not looked at, the notes say why."""
    value: float | None = None
    """What was found, in ``unit``."""
    limit: float | None = None
    """What was allowed, in ``unit``."""
    unit: str = ""
    """Unit of value and limit."""
    where: Place = field(default_factory=Place)
    """Where the value was found."""
    notes: tuple[str, ...] = ()
    """What else there is to say: tolerances, further findings."""

    def to_json(self) -> dict[str, Any]:
        """Return a dictionary that JSON can hold."""
        return {
            "code": self.code,
            "group": self.group,
            "name": self.name,
            "verdict": self.verdict,
            "value": _finite(self.value),
            "limit": _finite(self.limit),
            "unit": self.unit,
            "where": self.where.to_json(),
            "notes": list(self.notes),
        }


@dataclass(frozen=True, slots=True)
class Verification:
    """The whole result."""

    path: str
    """The log, as it was named."""
    title: str
    """Name of the show."""
    drones: int
    """Size of the fleet."""
    duration: float
    """Time of the show [s]."""
    anchor: str
    """What is trusted: the script with its hash, and where it came from."""
    checks: tuple[Check, ...]
    """In the order in which they were made."""

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(check.verdict != "fail" for check in self.checks)

    @property
    def exit_code(self) -> int:
        """0 if all is proved, 1 if a check failed."""
        return 0 if self.passed else 1

    def check(self, code: str) -> Check:
        """Return the first check of that code; KeyError if there is none."""
        for check in self.checks:
            if check.code == code:
                return check
        raise KeyError(code)

    def failures(self) -> frozenset[str]:
        """Return the codes of all checks that failed."""
        return frozenset(c.code for c in self.checks if c.verdict == "fail")

    def to_json(self) -> dict[str, Any]:
        """Return the whole result as a dictionary that JSON can hold."""
        return {
            "format_version": FORMAT_VERSION,
            "log": self.path,
            "show": self.title,
            "drones": self.drones,
            "duration": self.duration,
            "anchor": self.anchor,
            "passed": self.passed,
            "exit_code": self.exit_code,
            "checks": [check.to_json() for check in self.checks],
        }

    def __str__(self) -> str:
        return json.dumps(self.to_json(), indent=1)


def render_text(verification: Verification, *, colour: bool = False) -> str:
    """Return the result as a table for people.

    Parameters
    ----------
    verification
        What was found.
    colour
        Whether to mark verdicts with ANSI colours.
    """
    head = f"{verification.path}: “{verification.title}”, {verification.drones} drones"
    lines = [f"{head}, {verification.duration:.3f} s", verification.anchor]
    names = max((len(check.name) for check in verification.checks), default=0)
    found = [_found(check) for check in verification.checks]
    middle = max((len(value) for value, _ in found), default=0)
    group = ""
    for check, (value, limit) in zip(verification.checks, found, strict=True):
        if check.group != group:
            group = check.group
            lines += ["", group.capitalize()]
        word = _WORDS[check.verdict].ljust(4)
        if colour:
            word = f"\x1b[{_COLOURS[check.verdict]}m{word}\x1b[0m"
        line = f"  {word}  {check.name.ljust(names)}  {value.rjust(middle)}  {limit}"
        lines.append(line.rstrip())
        lines += _details(check)
    lines += ["", _summary(verification.checks)]
    return "\n".join(lines)


def _found(check: Check) -> tuple[str, str]:
    """Value and limit as text; more digits where they decide."""
    if check.value is None:
        return "", ""
    digits = 9 if check.verdict == "fail" else 4
    value = f"{format_number(check.value, digits)} {check.unit}".rstrip()
    if check.limit is None:
        return value, ""
    return value, f"limit {format_number(check.limit, digits)}"


def _details(check: Check) -> list[str]:
    """Place, unless nothing but zero was found there, and notes."""
    texts = list(check.notes)
    where = str(check.where)
    if where and (check.value != 0.0 or check.verdict != "pass"):
        texts.insert(0, where)
    return [line for text in texts for line in _wrapped(text)]


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(
        text, _WIDTH, initial_indent=" " * 8, subsequent_indent=" " * 8
    )


def format_number(value: float, digits: int = 6) -> str:
    """Up to ``digits`` significant digits; whole numbers in full."""
    if not math.isfinite(value):
        return "unbounded"
    if float(value).is_integer() and abs(value) < 1e9:
        return f"{int(value)}"
    return f"{value:.{digits}g}"


def _summary(checks: Sequence[Check]) -> str:
    count = {word: sum(c.verdict == word for c in checks) for word in _WORDS}
    failed, warned, skipped = count["fail"], count["warning"], count["skipped"]
    text = f"{count['pass']} proved"
    if warned:
        text += f", {warned} with a warning"
    if skipped:
        text += f", {skipped} left out"
    return f"NOT PROVED: {failed} failed, {text}." if failed else f"PROVED: {text}."


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
