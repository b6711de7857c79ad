"""What a verification found, in the formats of CI servers and code scanning."""

from __future__ import annotations

from typing import TYPE_CHECKING

from showc.script.codes import Code
from showc.script.diagnostic import Diagnostic, Severity
from showc.script.render import render
from showc.script.show import Mark
from showc.verify.codes import codes

if TYPE_CHECKING:
    from showc.verify.report import Check, Verification

FAULTS = {"fail": Severity.ERROR, "unproved": Severity.ERROR}
"""Verdicts that end a command with 1."""


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
    rules = {
        code: Code(code, known.title, known.cause, known.repair)
        for code, known in codes().items()
    }
    return render(found, {path: ""}, form, rules=rules)


def _finding(check: Check, path: str) -> Diagnostic:
    measured = ""
    if check.value is not None:
        measured = f": {check.value:.6g}"
        if check.limit is not None:
            measured += f" against {check.limit:.6g}"
        measured = f"{measured} {check.unit}".rstrip()
    where = str(check.where)
    known = codes().get(check.code)
    return Diagnostic(
        check.code,
        FAULTS.get(check.verdict, Severity.WARNING),
        f"{check.group}: {check.name}{measured}" + (f" ({where})" if where else ""),
        Mark(path, 1, 1, 1, 2),
        notes=check.notes,
        help=known.repair.rstrip(".") if known is not None else "",
    )
