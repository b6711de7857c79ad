"""Findings as text for people: the line, carets under it, numbers and remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING
from unicodedata import east_asian_width

from showc.errors import escaped, printable
from showc.script.diagnostic import Diagnostic, Severity

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from showc.script.mark import Mark

_RESET, _BOLD, _BLUE = "\x1b[0m", "\x1b[1m", "\x1b[1;34m"
_COLOURS = {Severity.ERROR: "\x1b[1;31m", Severity.WARNING: "\x1b[1;33m"}
_WIDEST = 160
"""Columns of a source line that are shown."""
_CAP = 20
"""Findings of one code in one file that are written out."""


def render_text(
    diagnostics: Iterable[Diagnostic],
    sources: Mapping[str, str],
    *,
    colour: bool = False,
) -> str:
    """Return all findings as text, and a last line that counts them.

    Parameters
    ----------
    diagnostics
        What was found.
    sources
        Text of each file, by path.
    colour
        Whether to colour it for a terminal.
    """
    found = list(diagnostics)
    lines = {path: text.split("\n") for path, text in sources.items()}
    blocks, seen = [], dict[tuple[str, str], int]()
    for item in found:
        key = item.code, item.span.path if item.span else ""
        seen[key] = seen.get(key, 0) + 1
        if seen[key] <= _CAP:
            blocks.append(_block(item, lines, colour=colour))
    for (code, path), count in seen.items():
        if count > _CAP:
            blocks.append(f"{path}: {count - _CAP} more findings {code}\n")
    if found:
        blocks.append(count_text(found) + "\n")
    return "\n".join(blocks)


def count_text(found: Sequence[Diagnostic]) -> str:
    """Return how many errors and warnings there are."""
    parts = []
    for severity in Severity:
        count = sum(1 for item in found if item.severity is severity)
        if count:
            parts.append(f"{count} {severity}{'s' * (count > 1)}")
    return ", ".join(parts)


def _block(item: Diagnostic, lines: Mapping[str, list[str]], *, colour: bool) -> str:
    def paint(text: str, code: str) -> str:
        return f"{code}{text}{_RESET}" if colour and text else text

    tint = _COLOURS[item.severity]
    where = ""
    if item.span is not None:
        where = escaped(f"{item.span}: ")
    head = paint(f"{item.severity}[{item.code}]", tint)
    out = [f"{where}{head}{paint(': ' + printable(item.message), _BOLD)}"]
    spans = [(item.span, item.label, True)] if item.span is not None else []
    spans += [(label.span, label.text, False) for label in item.secondary]
    known = [entry for entry in spans if _line(entry[0], lines) is not None]
    width = max((len(str(entry[0].line)) for entry in known), default=1)
    margin = " " * width
    if known:
        out.append(f"{margin} {paint('|', _BLUE)}")
    here = (item.span.path, item.span.line) if item.span is not None else ("", 0)
    for span, label, primary in known:
        source = _line(span, lines) or ""
        text, carets = _pointer(span, source, "^" if primary else "-")
        if not primary and span.path != (item.span.path if item.span else ""):
            out.append(f"{margin} {paint('::: ' + escaped(span.path), _BLUE)}")
        number = str(span.line).rjust(width)
        if primary or (span.path, span.line) != here:
            out.append(f"{paint(f'{number} |', _BLUE)} {text}".rstrip())
        mark = paint(
            f"{carets} {printable(label)}".rstrip(), tint if primary else _BLUE
        )
        lead = len(mark) - len(mark.lstrip())
        out.append(f"{margin} {paint('|', _BLUE)} {' ' * lead}{mark.lstrip()}")
    remarks = [("note", note) for note in item.notes]
    remarks += [("help", item.help)] * bool(item.help)
    out += [
        f"{margin} {paint('=', _BLUE)} {paint(kind, _BOLD)}: {printable(text)}"
        for kind, text in remarks
    ]
    return "\n".join(out) + "\n"


def _line(span: Mark, lines: Mapping[str, list[str]]) -> str | None:
    known = lines.get(span.path)
    if known is None or not 1 <= span.line <= len(known):
        return None
    return known[span.line - 1].rstrip("\r")


def _columns(text: str) -> int:
    """Return how many columns of a terminal a text takes."""
    return sum(2 if east_asian_width(sign) in "WF" else 1 for sign in text)


def _pointer(span: Mark, source: str, sign: str) -> tuple[str, str]:
    """Return a source line without tabs, and the carets under a span of it."""
    start = min(span.column - 1, len(source))
    stop = span.end_column - 1 if span.end_line == span.line else len(source)
    stop = max(min(stop, len(source)), start)
    shown = printable(source.replace("\t", " "))
    if start > _WIDEST - 40:
        cut = start - 40
        shown, start, stop = "…" + shown[cut:], start - cut + 1, stop - cut + 1
    if len(shown) > _WIDEST:
        shown = shown[:_WIDEST] + "…"
        stop = min(stop, _WIDEST)
    count = max(_columns(shown[start:stop]), 1)
    return shown, " " * _columns(shown[:start]) + sign * count
