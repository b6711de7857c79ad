"""Codes of the safety case's findings: stable names, causes, what to do."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from textwrap import fill
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class Code:
    """One kind of finding."""

    code: str
    """``SAF`` and three digits."""
    title: str
    """What is found, in a few words."""
    cause: str
    """What exactly is compared."""
    repair: str
    """What to do."""


@cache
def codes() -> Mapping[str, Code]:
    """Return every code, in order."""
    text = resources.files(__package__).joinpath("codes.toml").read_text("utf-8")
    return MappingProxyType(
        {code: Code(code, **entry) for code, entry in tomllib.loads(text).items()}
    )


def explain(code: str) -> str | None:
    """Return what a code means and what to do, or None if there is none such."""
    known = codes().get(code.strip().upper())
    if known is None:
        return None
    return (
        f"{known.code}: {known.title}\n\n{fill(known.cause, 80)}\n\n"
        f"{fill(f'What to do: {known.repair}', 80)}\n"
    )


def codes_reference() -> str:
    """Return the chapter of all codes, Markdown."""
    lines = ["# Findings of the safety case"]
    for code in codes().values():
        lines += ["", f"## {code.code}: {code.title}", "", code.cause, "", code.repair]
    return "\n".join(lines) + "\n"
