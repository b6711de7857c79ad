"""Codes of checks: stable names, what each proves, why it fails, what to do.

Each file beside this module is one range of codes: ``container.toml`` 1xx,
``script.toml`` 2xx, ``kernel.toml`` 3xx, ``missions.toml`` 4xx, ``foreign.toml`` 5xx.
"""

from __future__ import annotations

from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from showc.codes import Code, read_codes, read_table

if TYPE_CHECKING:
    from collections.abc import Mapping

_TABLES = read_table(__package__ or "", "rooms.toml")

ROOMS: dict[str, str] = _TABLES["rooms"]
"""Files of codes, with the heading of each; theirs are the hundreds, in this order."""

GROUPS: dict[str, str] = _TABLES["groups"]
"""Heading of the checks of one log, by what their codes begin with."""


@cache
def codes() -> Mapping[str, Code]:
    """Return every code of a check, ``VRF`` and three digits, in order."""
    found = [read_codes(__package__, f"{room}.toml") for room in ROOMS]
    return MappingProxyType({code: one for some in found for code, one in some.items()})
