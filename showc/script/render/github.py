"""Findings as workflow commands, which GitHub shows on the lines of a pull request."""

from __future__ import annotations

from typing import TYPE_CHECKING

from showc.errors import printable

if TYPE_CHECKING:
    from collections.abc import Iterable

    from showc.script.diagnostic import Diagnostic


def render_github(diagnostics: Iterable[Diagnostic]) -> str:
    """Return one ``::error`` or ``::warning`` command a line."""
    return "".join(_command(item) + "\n" for item in diagnostics)


def _command(item: Diagnostic) -> str:
    properties = []
    if item.span is not None:
        span = item.span
        properties = [
            f"file={_property(span.path)}",
            f"line={span.line}",
            f"endLine={span.end_line}",
        ]
        if span.line == span.end_line:
            # Columns are only allowed where the annotation is on one line.
            properties += [f"col={span.column}", f"endColumn={span.end_column}"]
    properties.append(f"title={item.code}")
    parts = [item.message, *(f"note: {note}" for note in item.notes)]
    if item.help:
        parts.append(f"help: {item.help}")
    return f"::{item.severity} {','.join(properties)}::{_data(chr(10).join(parts))}"


def _data(text: str) -> str:
    return printable(text).replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
