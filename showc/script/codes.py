"""Codes of findings about a script: stable names, causes, examples and repairs."""

from __future__ import annotations

from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from showc.codes import read_codes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.codes import Code


@cache
def codes() -> Mapping[str, Code]:
    """Return every code, ``SHW`` and three digits, in order."""
    return MappingProxyType(read_codes(__package__, "codes.toml"))
