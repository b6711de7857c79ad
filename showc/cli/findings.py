"""What a verification found, as a table and in the formats of CI servers."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from showc.errors import escaped
from showc.script.diagnostic import Diagnostic, Severity
from showc.script.language.wording import counted
from showc.script.mark import Mark
from showc.script.render import render
from showc.verify.codes import codes

if TYPE_CHECKING:
    from showc.verify.report import Check, Verdict, Verification

FAULTS = {"fail": Severity.ERROR, "unproved": Severity.ERROR}
"""Verdicts that end a command with 1."""


_WIDTH = 96
"""Columns of the notes under a check."""

_SIGNS: dict[Verdict, tuple[str, str]] = {
    "pass": ("ok", "32"),
    "fail": ("FAIL", "1;31"),
    "unproved": ("OPEN", "1;31"),
    "accepted": ("open", "33"),
    "warning": ("warn", "33"),
    "skipped": ("-", "2"),
}
"""Word of a verdict, and the ANSI colour of the word."""


def render_findings(verification: Verification, form: str) -> str:
    """Return what is not proved, and remarks, as ``sarif``, ``github`` or ``junit``.

    Binary files have no lines: every finding stands at the first, and says in words
    which drone and which instant it is about.
    """
    path = verification.path
    found = [
        _finding(check, path)
        for check in verification.checks
        if check.verdict in {*FAULTS, "warning"}
    ]
    return render(found, {path: ""}, form, rules=codes())


def _finding(check: Check, path: str) -> Diagnostic:
    measured = ""
    if check.value is not None:
        measured = f": {check.value:.6g}"
        if check.limit is not None:
            measured += f" against {check.limit:.6g}"
        measured = f"{measured} {check.unit}".rstrip()
    where = escaped(str(check.where))
    known = codes().get(check.code)
    return Diagnostic(
        check.code,
        f"{check.group}: {check.name}{measured}" + (f" ({where})" if where else ""),
        Mark(path, 1, 1, 1, 2),
        notes=tuple(map(escaped, check.notes)),
        help=known.repair.rstrip(".") if known is not None else "",
        severity=FAULTS.get(check.verdict, Severity.WARNING),
    )


def render_text(verification: Verification, *, colour: bool = False) -> str:
    """Return the result as a table for people.

    Parameters
    ----------
    verification
        What was found.
    colour
        Whether to mark verdicts with ANSI colours.
    """
    title, path = escaped(verification.title), escaped(verification.path)
    size = f"{counted(verification.drones, 'drone')}, {verification.duration:.3f} s"
    lines = [
        escaped(verification.verdict),
        f"{path}: “{title}”, {size}",
        escaped(verification.anchor),
    ]
    names = max((len(escaped(c.name)) for c in verification.checks), default=0)
    found = [check.figures() for check in verification.checks]
    middle = max((len(value) for value, _ in found), default=0)
    group = ""
    for check, (value, limit) in zip(verification.checks, found, strict=True):
        if check.group != group:
            group = check.group
            lines += ["", group.capitalize()]
        word, shade = _SIGNS[check.verdict]
        word = word.ljust(4)
        if colour:
            word = f"\x1b[{shade}m{word}\x1b[0m"
        name = escaped(check.name).ljust(names)
        line = f"  {word}  {check.code}  {name}  {value.rjust(middle)}  {limit}"
        lines.append(line.rstrip())
        lines += _details(check)
    lines += ["", escaped(verification.verdict)]
    return "\n".join(lines)


def _details(check: Check) -> list[str]:
    """Place, unless nothing but zero was found there, and notes."""
    texts = list(check.notes)
    where = str(check.where)
    if where and (check.value != 0.0 or check.verdict != "pass"):
        texts.insert(0, where)
    return [line for text in texts for line in _wrapped(escaped(text))]


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(
        text, _WIDTH, initial_indent=" " * 8, subsequent_indent=" " * 8
    )
