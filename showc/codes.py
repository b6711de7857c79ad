"""Codes of findings and checks that lie in tables: what each means, what to do."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources
from textwrap import fill, indent
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

_WIDTH = 80
"""Columns of an explanation in the terminal."""


@dataclass(frozen=True, slots=True)
class Code:
    """One kind of finding, or of check."""

    code: str
    """Three letters and three digits, which never change their meaning."""
    title: str
    """What is found or proved, in a few words."""
    cause: str
    """What exactly is compared, and why it fails."""
    repair: str
    """What to do when it fails."""
    severity: str = "error"
    """``error`` or ``warning``."""
    example: str = ""
    """Part of a script, or a situation, that causes it."""
    instead: str = ""
    """Part of a script that says the same without the finding."""


def read_table(package: str, name: str) -> dict[str, Any]:
    """Return what a TOML file beside the modules of a package says, in its order."""
    text = resources.files(package).joinpath(name).read_text(encoding="utf-8")
    return tomllib.loads(text)


def read_codes(package: str, name: str) -> dict[str, Code]:
    """Return the codes of such a file."""
    found = read_table(package, name)
    return {code: Code(code, **entry) for code, entry in found.items()}


def explained(code: str, known: Mapping[str, Code]) -> str | None:
    """Return what a code means and what to do, or None if there is none such."""
    found = known.get(code.strip().upper())
    if found is None:
        return None
    warning = " (warning)" if found.severity == "warning" else ""
    parts = [f"{found.code}{warning}: {found.title}", fill(found.cause, _WIDTH)]
    if found.example:
        parts.append("Example:\n\n" + indent(found.example, "    "))
    parts.append(fill(f"What to do: {found.repair}", _WIDTH))
    if found.instead:
        parts.append("Use instead:\n\n" + indent(found.instead, "    "))
    return "\n\n".join(parts) + "\n"
