"""Findings for programs: JSON, GitHub's workflow commands, JUnit XML."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from showc.errors import escaped, printable
from showc.script.diagnostic import Diagnostic, Severity
from showc.script.render.text import render_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from showc.script.mark import Mark

FORMAT_VERSION = "1.0"
"""Version of this JSON; the second number counts additions, the first breaks."""

Plain = dict[str, object]


def render_json(diagnostics: Iterable[Diagnostic], sources: Mapping[str, str]) -> str:
    """Return findings as one JSON object.

    Keys: ``format_version``, ``valid``, ``error_count``, ``warning_count``, ``files``
    (all that were checked) and ``diagnostics``; each of those has ``severity``,
    ``code``, ``summary``, ``detail``, ``notes``, ``help``, ``fix``, ``range`` and
    ``related``. Lines and columns count from 1, ``byte`` from 0 in UTF-8.
    """
    found = list(diagnostics)
    lines = {path: text.split("\n") for path, text in sources.items()}
    errors = sum(1 for item in found if item.severity is Severity.ERROR)
    report = {
        "format_version": FORMAT_VERSION,
        "valid": errors == 0,
        "error_count": errors,
        "warning_count": len(found) - errors,
        "files": sorted(sources),
        "diagnostics": [_diagnostic(item, lines) for item in found],
    }
    return json.dumps(report, indent=2, ensure_ascii=False) + "\n"


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


def render_junit(diagnostics: Iterable[Diagnostic], sources: Mapping[str, str]) -> str:
    """Return findings as JUnit XML.

    A file with errors is a failed case with one failure an error; warnings stand in
    the case's output.
    """
    from junitparser import (  # noqa: PLC0415 - only this format needs it
        Failure,
        JUnitXml,
        TestCase,
        TestSuite,
    )

    found = list(diagnostics)
    suite = TestSuite("showc check")
    paths = sorted({*sources, *(item.span.path for item in found if item.span)})
    for path in paths:
        case = TestCase(escaped(path), classname="showc", time=0)
        own = [item for item in found if (item.span.path if item.span else "") == path]
        case.result = [
            _failure(Failure, item, sources)
            for item in own
            if item.severity is Severity.ERROR
        ]
        warnings = [item for item in own if item.severity is Severity.WARNING]
        if warnings:
            case.system_out = _printable(render_text(warnings, sources))
        suite.add_testcase(case)
    nowhere = [item for item in found if item.span is None]
    if nowhere:
        case = TestCase("files", classname="showc", time=0)
        case.result = [_failure(Failure, item, sources) for item in nowhere]
        suite.add_testcase(case)
    report = JUnitXml("showc")
    report.add_testsuite(suite)
    return str(report.tostring().decode("utf-8")) + "\n"


def _failure(kind: Any, item: Diagnostic, sources: Mapping[str, str]) -> Any:  # noqa: ANN401 - junitparser has no types
    """Return a finding as a failure."""
    failure = kind(_printable(item.message), item.code)
    failure.text = _printable(render_text([item], sources))
    return failure


def _printable(text: str) -> str:
    """Leave out control characters, which XML cannot hold."""
    return "".join(sign for sign in text if sign in "\n\t" or ord(sign) >= 32)
