"""Findings as JUnit XML, for CI servers: one test case a file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from showc.script.diagnostic import Diagnostic, Severity
from showc.script.render.text import render_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


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
        case = TestCase(path, classname="showc", time=0)
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
