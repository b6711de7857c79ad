"""Codes of findings and checks that lie in tables: what each means, what to do."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources
from textwrap import fill
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


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


def read_codes(package: str, name: str) -> dict[str, Code]:
    """Return the codes of a TOML file beside the modules of a package, in its order."""
    text = resources.files(package).joinpath(name).read_text(encoding="utf-8")
    return {code: Code(code, **entry) for code, entry in tomllib.loads(text).items()}


def explained(code: str, known: Mapping[str, Code]) -> str | None:
    """Return what a code means and what to do, or None if there is none such."""
    found = known.get(code.strip().upper())
    if found is None:
        return None
    return (
        f"{found.code}: {found.title}\n\n{fill(found.cause, 80)}\n\n"
        f"{fill(f'What to do: {found.repair}', 80)}\n"
    )


def entries(codes: Iterable[Code], level: int) -> list[str]:
    """Return the lines of codes in a Markdown chapter, headings of that level."""
    return [
        line
        for one in codes
        for line in (
            *("", f"{'#' * level} {one.code}: {one.title}"),
            *("", one.cause, "", one.repair),
        )
    ]
