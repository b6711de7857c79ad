"""Syntax: what is wrong where a script cannot be read as YAML, and what to do."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from showc.script.diagnostic import Diagnostic, Label
from showc.script.mark import Mark

if TYPE_CHECKING:
    from collections.abc import Sequence

    import yaml

_OTHERWISE = "check the indentation, the colons and the brackets up to here"
_COLOUR_COMMENT = re.compile(r"[:,[][ \t]+(#[0-9a-fA-F]{3,8})\b[ \t]*\S")
"""A colour that begins a comment, with what closes or goes on behind it."""


def syntax_fault(
    fault: yaml.MarkedYAMLError, lines: Sequence[str], path: str
) -> Diagnostic:
    """Return the finding for what the YAML parser refused (SHW001).

    Parameters
    ----------
    fault
        What the parser says. Its place is where it gave up, which is often behind the
        mistake.
    lines
        The script's lines.
    path
        Its path, for the marks.
    """
    # The fallback marks may be of libyaml's type, the stubs know the pure one.
    where: Any = fault.problem_mark or fault.context_mark
    context: Any = fault.context_mark
    span = _mark(where, path) if where is not None else Mark(path, 1, 1, 1, 2)
    begun = _mark(context, path) if context is not None else span
    problem = str(fault.problem or fault.context or "it cannot be read")
    line = lines[span.line - 1] if span.line <= len(lines) else ""
    sign = line[span.column - 1 : span.column]
    labels: tuple[Label, ...] = ()
    fix = ""
    if (colour := _commented(lines, begun, span)) is not None:
        span, fix = colour
        problem = "`#` begins a comment"
        advice = f"write `{fix}`, with the quotes"
    elif "cannot start any token" in problem and sign == "\t":
        problem, advice = "a tab between values", "separate values with spaces"
    elif "cannot start any token" in problem:
        problem = f"a text cannot begin with {'a backtick' if sign == '`' else sign}"
        advice = 'put the text in quotes: `"@chorus"`'
    elif "quoted scalar" in str(fault.context):
        span = begun
        problem, advice = "this quote is not closed", "close it on the same line"
    elif "simple key" in str(fault.context):
        span = begun
        problem, advice = "this line has no colon", "write `key: value`"
    elif "mapping values are not allowed" in problem:
        text = _value_on(line)
        problem = "a second colon in one line"
        advice = f'put the value in quotes: `"{text}"`' if text else _OTHERWISE
    elif "expected ',' or" in problem:
        problem, span, advice = _in_brackets(problem, line, span, begun)
    else:
        advice = _OTHERWISE
        block = "expected key" in problem or "block end" in problem
        if block:
            problem = "this line does not fit those above it"
            advice = "begin all keys of one block in the same column"
        if begun.line != span.line:
            labels = (Label(begun, "the block" if block else str(fault.context)),)
    return Diagnostic(
        "SHW001",
        f"not valid YAML: {problem}",
        span,
        secondary=labels,
        help=advice,
        fix=fix,
    )


def _commented(
    lines: Sequence[str], begun: Mark, until: Mark
) -> tuple[Mark, str] | None:
    """Find the colour that is a comment and hides the end of a bracket.

    Returns where it is, and how it is written.
    """
    # YAML breaks lines at signs that others do not: there may be fewer of them.
    around = lines[begun.line - 1 : until.line]
    if not around or around[0][begun.column - 1 : begun.column] not in {"{", "["}:
        return None
    for number, line in enumerate(around, start=begun.line):
        found = _COLOUR_COMMENT.search(line)
        if found is not None:
            first, end = found.start(1) + 1, found.end(1) + 1
            place = Mark(begun.path, number, first, number, end)
            return place, f'"{found.group(1)}"'
    return None


def _in_brackets(
    problem: str, line: str, span: Mark, begun: Mark
) -> tuple[str, Mark, str]:
    """Return what is wrong between brackets, where, and what to do."""
    bracket = problem[-2:-1]
    before, sign = line[: span.column - 1], line[span.column - 1 : span.column]
    word = re.search(r"\s([\w-]+)$", before)
    if span.line != begun.line:
        return "this bracket is not closed", begun, f"add `{bracket}`"
    if sign == ":" and word is not None:
        place = Mark(span.path, span.line, word.start(1) + 1, span.line, span.column)
        return "a comma is missing before this key", place, "put a comma there"
    return f"expected `,` or `{bracket}`", span, f"close the bracket with `{bracket}`"


def _mark(place: Any, path: str) -> Mark:  # noqa: ANN401 - a mark of either parser
    line, column = place.line + 1, place.column + 1
    return Mark(path, line, column, line, column + 1)


def _value_on(line: str) -> str:
    """Return the value on a line that has a key, a colon and a value; or nothing."""
    match = re.fullmatch(r"\s*(?:- )?[\w-]+:\s+([^\"'{\[].*?)\s*", line)
    return match.group(1) if match is not None else ""
