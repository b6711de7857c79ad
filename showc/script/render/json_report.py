"""Findings as JSON for programs; the fields follow ``terraform validate -json``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from showc.script.diagnostic import Diagnostic, Severity

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from showc.script.show import Mark

FORMAT_VERSION = "1.0"
"""Version of this JSON; the second number counts additions, the first breaks."""

Plain = dict[str, object]


def render_json(diagnostics: Iterable[Diagnostic], sources: Mapping[str, str]) -> str:
    """Return findings as one JSON object; see :func:`report_object`."""
    return (
        json.dumps(report_object(diagnostics, sources), indent=2, ensure_ascii=False)
        + "\n"
    )


def report_object(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, str]
) -> Plain:
    """Return findings as what JSON can hold.

    Keys: ``format_version``, ``valid``, ``error_count``, ``warning_count``, ``files``
    (all that were checked) and ``diagnostics``; each of those has ``severity``,
    ``code``, ``summary``, ``detail``, ``notes``, ``help``, ``fix``, ``range`` and
    ``related``. Lines and columns count from 1, ``byte`` from 0 in UTF-8.
    """
    found = list(diagnostics)
    lines = {path: text.split("\n") for path, text in sources.items()}
    errors = sum(1 for item in found if item.severity is Severity.ERROR)
    return {
        "format_version": FORMAT_VERSION,
        "valid": errors == 0,
        "error_count": errors,
        "warning_count": len(found) - errors,
        "files": sorted(sources),
        "diagnostics": [_diagnostic(item, lines) for item in found],
    }


def _diagnostic(item: Diagnostic, lines: Mapping[str, list[str]]) -> Plain:
    detail = " ".join(f"{note}." for note in item.notes)
    return {
        "severity": str(item.severity),
        "code": item.code,
        "summary": item.message,
        "detail": detail,
        "notes": list(item.notes),
        "help": item.help,
        "fix": item.fix or None,
        "range": _range(item.span, lines) if item.span is not None else None,
        "related": [
            {"message": label.text, "range": _range(label.span, lines)}
            for label in item.secondary
        ],
    }


def _range(span: Mark, lines: Mapping[str, list[str]]) -> Plain:
    return {
        "filename": span.path,
        "start": _position(span.path, span.line, span.column, lines),
        "end": _position(span.path, span.end_line, span.end_column, lines),
    }


def _position(
    path: str, line: int, column: int, lines: Mapping[str, list[str]]
) -> Plain:
    text = lines.get(path, [])
    before = sum(len(item.encode()) + 1 for item in text[: line - 1])
    inside = text[line - 1][: column - 1] if line <= len(text) else ""
    return {"line": line, "column": column, "byte": before + len(inside.encode())}
