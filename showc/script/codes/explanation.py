"""Explanations of codes as text and as a page."""

from __future__ import annotations

from textwrap import indent
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from showc.script.codes.code import Code

_CHAPTERS = {
    "0": "The file and its YAML",
    "1": "Keys, values, units and names",
    "2": "Kinematics and separation",
    "3": "Operation",
    "4": "Planning and solving",
    "5": "Fidelity of what is written",
    "9": "Faults of showc itself",
}


def explanation(code: Code) -> str:
    """Return cause, example, repair and a corrected example as plain text."""
    parts = [f"{code.code} ({code.severity}): {code.title}", code.cause]
    if code.example:
        parts.append("Example:\n\n" + indent(code.example, "    "))
    parts.append(f"What to do: {code.repair}")
    if code.instead:
        parts.append("Use instead:\n\n" + indent(code.instead, "    "))
    return "\n\n".join(parts) + "\n"


def reference(codes: Iterable[Code]) -> str:
    """Return one page on all codes, Markdown."""
    lines = [
        "# Findings",
        "",
        "<!-- Made from the program's own table; `make docs` writes it anew. -->",
        "",
        (
            "Every finding has a code that never changes its meaning. `showc explain "
            "SHW201` prints what stands here."
        ),
        "",
        (
            "Warnings can be passed over, with a reason, by a comment on their line or "
            "alone on the line before:"
        ),
        "",
        "```yaml",
        "separation: 1  # showc: ignore[SHW303] all drones fly with RTK",
        "```",
    ]
    chapter = ""
    for code in codes:
        if code.code[3] != chapter:
            chapter = code.code[3]
            lines += ["", f"## {_CHAPTERS[chapter]} (SHW{chapter}xx)"]
        lines += [
            "",
            f"### {code.code}: {code.title}",
            "",
            f"*{code.severity.capitalize()}.* {code.cause}",
        ]
        if code.example:
            lines += ["", "```text", code.example, "```"]
        lines += ["", code.repair]
        if code.instead:
            lines += ["", "*Use instead:*", "", "```text", code.instead, "```"]
    return "\n".join(lines) + "\n"
