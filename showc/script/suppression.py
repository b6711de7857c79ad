"""Suppression: findings that a script passes over, with a reason.

A comment ``# showc: ignore[SHW303] the field is fenced`` passes over findings of that
code on its own line, or on the next line if it stands alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from showc.script.diagnostic import Diagnostic, Severity, Suppressed, position
from showc.script.show import Mark

if TYPE_CHECKING:
    from collections.abc import Iterable

_COMMENT = re.compile(r"#\s*showc:\s*ignore\b(?:\[([^\]]*)\])?[ \t]*(.*)")


@dataclass(frozen=True, slots=True)
class _Request:
    code: str
    line: int
    """Line whose findings are meant."""
    mark: Mark
    reason: str


def apply_suppressions(
    text: str, path: str, found: Iterable[Diagnostic]
) -> tuple[tuple[Diagnostic, ...], tuple[Suppressed, ...]]:
    """Take out what the script passes over.

    Only warnings can be passed over: a script with an error is no show. Comments
    without a code or a reason, with an unknown code, or to no effect are reported
    themselves (SHW117).

    Returns
    -------
    tuple
        What is left, in order of place, and what was taken out.
    """
    requests, kept = _requests(text, path)
    used: set[_Request] = set()
    suppressed = []
    for diagnostic in found:
        request = _match(diagnostic, requests)
        if request is None:
            kept.append(diagnostic)
        elif diagnostic.severity is Severity.ERROR:
            used.add(request)
            kept += (diagnostic, _faulty(f"{request.code} is an error here and "
                     "cannot be passed over", request.mark))  # fmt: skip
        else:
            used.add(request)
            suppressed.append(Suppressed(diagnostic, request.reason))
    kept += [
        _faulty(f"there is no {request.code} to pass over on this line", request.mark)
        for request in requests
        if request not in used
    ]
    return tuple(sorted(kept, key=position)), tuple(suppressed)


def _match(diagnostic: Diagnostic, requests: list[_Request]) -> _Request | None:
    span = diagnostic.span
    if span is None:
        return None
    for request in requests:
        if request.code == diagnostic.code and request.line == span.line:
            return request
    return None


def _requests(text: str, path: str) -> tuple[list[_Request], list[Diagnostic]]:
    requests: list[_Request] = []
    faults: list[Diagnostic] = []
    if "showc:" not in text or "ignore" not in text:
        return requests, faults
    from showc.script.codes import CODES  # noqa: PLC0415 - start-up counts

    for number, line in enumerate(text.split("\n"), start=1):
        match = _COMMENT.search(line)
        if match is None:
            continue
        mark = Mark(path, number, match.start() + 1, number, len(line.rstrip()) + 1)
        target = number + 1 if not line[: match.start()].strip() else number
        codes = [code.strip() for code in (match.group(1) or "").split(",")]
        reason = match.group(2).strip()
        if codes == [""]:
            faults.append(_faulty("the comment names no code", mark))
        elif not reason:
            faults.append(_faulty("the comment gives no reason", mark))
        else:
            for code in codes:
                if code in CODES:
                    requests.append(_Request(code, target, mark, reason))
                else:
                    faults.append(_faulty(f"there is no code `{code}`", mark))
    return requests, faults


def _faulty(message: str, mark: Mark) -> Diagnostic:
    return Diagnostic(
        "SHW117",
        Severity.WARNING,
        message,
        mark,
        help="write `# showc: ignore[SHW303] why it is right here`, on the line of the "
        "finding or alone on the line before",
    )
