"""Codes of checks: stable names, what each proves, why it fails, what to do.

Each file beside this module is one range of codes: ``container.toml`` 1xx,
``script.toml`` 2xx, ``kernel.toml`` 3xx, ``missions.toml`` 4xx, ``foreign.toml`` 5xx.
"""

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

ROOMS = {
    "container": "The bytes of the log, and the samples in it (VRF1xx)",
    "script": "What the script asks for (VRF2xx)",
    "kernel": "The flight (VRF3xx)",
    "missions": "The missions (VRF4xx)",
    "foreign": "Shows in other formats (VRF5xx)",
}
"""Files of codes, with the heading of each."""


GROUPS = {
    "VRF10": "integrity",
    "VRF12": "samples",
    "VRF2": "script",
    "VRF30": "physics",
    "VRF31": "limits",
    "VRF32": "separation",
    "VRF33": "choreography",
    "VRF34": "certificates",
    "VRF4": "missions",
}
"""Heading of the checks of one log, by what their codes begin with."""


@dataclass(frozen=True, slots=True)
class Code:
    """One kind of check."""

    code: str
    """``VRF`` and three digits."""
    room: str
    """Which of ``ROOMS`` it belongs to."""
    title: str
    """What is proved, in a few words."""
    cause: str
    """What exactly is compared, and why it fails."""
    repair: str
    """What to do when it fails."""


@cache
def codes() -> Mapping[str, Code]:
    """Return every code of a check, in order."""
    found: dict[str, Code] = {}
    folder = resources.files(__package__)
    for room in ROOMS:
        text = (folder / f"{room}.toml").read_text(encoding="utf-8")
        for code, entry in tomllib.loads(text).items():
            found[code] = Code(code, room, **entry)
    return MappingProxyType(found)


def explain(code: str) -> str | None:
    """Return what a code proves and what to do, or None if there is none such."""
    known = codes().get(code.strip().upper())
    if known is None:
        return None
    return (
        f"{known.code}: {known.title}\n\n{fill(known.cause, 80)}\n\n"
        f"{fill(f'What to do: {known.repair}', 80)}\n"
    )


def codes_reference() -> str:
    """Return the chapter of all codes of checks, Markdown."""
    lines = [
        "# Checks of verify",
        "",
        "Every check of `showc verify` has a code that never changes its meaning.",
    ]
    for room, heading in ROOMS.items():
        lines += ["", f"## {heading}"]
        for code in codes().values():
            if code.room == room:
                lines += ["", f"### {code.code}: {code.title}", "", code.cause]
                lines += ["", code.repair]
    return "\n".join(lines) + "\n"
