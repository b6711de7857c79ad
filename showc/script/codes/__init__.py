"""Codes of findings: stable names, causes, examples and repairs."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING

from showc.script.codes import geometry, operations, schema, solving, syntax
from showc.script.codes.code import Code
from showc.script.codes.explanation import explanation, reference

if TYPE_CHECKING:
    from collections.abc import Mapping

CODES: Mapping[str, Code] = MappingProxyType(
    {
        code.code: code
        for module in (syntax, schema, geometry, operations, solving)
        for code in module.CODES
    }
)
"""Every code, in order."""


def explain(code: str) -> str | None:
    """Return cause, example and repair of a code, or None if there is none such."""
    known = CODES.get(code.strip().upper())
    return explanation(known) if known is not None else None


def codes_reference() -> str:
    """Return the page of all codes, Markdown."""
    return reference(CODES.values())


__all__ = ["CODES", "Code", "codes_reference", "explain"]
