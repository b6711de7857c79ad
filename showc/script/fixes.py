"""Fixes: findings with one right answer, applied to the script."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from showc.script.diagnostic import Diagnostic
    from showc.script.load import LoadResult

ROUNDS = 20
"""How often a fixed script is read again: one fix may show the next mistake."""
_LINE = re.compile("\r\n|[\n\r\x85\u2028\u2029]")
"""What ends a line of YAML."""
_MARK = b"\xef\xbb\xbf"
"""Bytes that some editors put before a text in UTF-8."""


@dataclass(frozen=True, slots=True)
class Fixed:
    """A script without the mistakes that have one right answer."""

    content: bytes
    """The script."""
    done: tuple[Diagnostic, ...]
    """What was fixed, with its place before that."""


def apply_fixes(content: bytes, read: Callable[[bytes], LoadResult]) -> Fixed:
    """Apply fixes that have one right answer, and nothing else.

    Parameters
    ----------
    content
        The script.
    read
        Judges a script.

    Returns
    -------
    Fixed
        The script, unchanged where nothing is certain. A change that does not take its
        finding away is not made.
    """
    done: list[Diagnostic] = []
    for _ in range(ROUNDS):
        found = read(content).diagnostics
        wanted = _apart([item for item in found if item.fix and item.span is not None])
        if not wanted:
            break
        fixed = _written(content, wanted)
        before = {(item.code, item.message) for item in wanted}
        left = {(item.code, item.message) for item in read(fixed).diagnostics}
        if before & left:
            break
        content = fixed
        done += wanted
    return Fixed(content, tuple(done))


def _apart(found: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Leave out what overlaps with what comes before."""
    kept: list[Diagnostic] = []
    for item in sorted(found, key=_span):
        if not kept or _span(item)[0] >= _span(kept[-1])[1]:
            kept.append(item)
    return kept


def _span(item: Diagnostic) -> tuple[tuple[int, int], tuple[int, int]]:
    span = item.span
    assert span is not None  # noqa: S101 - those without were left out
    return (span.line, span.column), (span.end_line, span.end_column)


def _written(content: bytes, wanted: Sequence[Diagnostic]) -> bytes:
    """Return a script with each finding's text replaced by its fix."""
    mark = _MARK if content.startswith(_MARK) else b""
    text = content.removeprefix(_MARK).decode()
    starts = [0, *(found.end() for found in _LINE.finditer(text))]
    for item in reversed(wanted):
        (line, column), (end_line, end_column) = _span(item)
        first = starts[line - 1] + column - 1
        last = starts[end_line - 1] + end_column - 1
        text = text[:first] + item.fix + text[last:]
    return mark + text.encode()
