"""Suppression: findings that a script passes over, with a reason.

A comment ``# showc: ignore[SHW303] the field is fenced`` passes over findings of that
code on its own line, or on the next line if it stands alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from showc.script.diagnostic import Diagnostic, Severity, Suppressed, position
from showc.script.mark import Mark

if TYPE_CHECKING:
    from collections.abc import Iterable

_MOST = 1000
"""Comments that are looked at."""
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
    wanted: dict[tuple[str, int], _Request] = {}
    for request in requests:
        wanted.setdefault((request.code, request.line), request)
    used: set[_Request] = set()
    suppressed = []
    for diagnostic in found:
        line = diagnostic.span.line if diagnostic.span is not None else 0
        found_by = wanted.get((diagnostic.code, line))
        if found_by is None:
            kept.append(diagnostic)
        elif diagnostic.severity is Severity.ERROR:
            used.add(found_by)
            kept += (diagnostic, _faulty(f"{found_by.code} is an error here and "
                     "cannot be passed over", found_by.mark))  # fmt: skip
        else:
            used.add(found_by)
            suppressed.append(Suppressed(diagnostic, found_by.reason))
    kept += [
        _faulty(f"there is no {request.code} to ignore on this line", request.mark)
        for request in requests
        if request not in used
    ]
    return tuple(sorted(kept, key=position)), tuple(suppressed)


def _requests(text: str, path: str) -> tuple[list[_Request], list[Diagnostic]]:
    requests: list[_Request] = []
    faults: list[Diagnostic] = []
    if "showc:" not in text or "ignore" not in text:
        return requests, faults
    from showc.script.codes import codes as known_codes  # noqa: PLC0415 - start-up counts

    for number, line in enumerate(text.split("\n"), start=1):
        match = _COMMENT.search(line)
        if match is None:
            continue
        if len(requests) + len(faults) > _MOST:
            faults.append(
                _faulty(
                    f"only the first {_MOST} ignore comments count",
                    Mark(path, number, 1, number, 2),
                )
            )
            break
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
                if code in known_codes():
                    requests.append(_Request(code, target, mark, reason))
                else:
                    faults.append(_faulty(f"there is no code `{code}`", mark))
    return requests, faults


def _faulty(message: str, mark: Mark) -> Diagnostic:
    return Diagnostic(
        "SHW117",
        message,
        mark,
        help="write `# showc: ignore[SHW303] why it is right here`, on the line of the "
        "finding or alone on the line before",
        severity=Severity.WARNING,
    )
