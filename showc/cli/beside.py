"""Files beside a log that hold for this log alone: they name its hash."""

from __future__ import annotations

import json
from hashlib import sha256
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    Found = TypeVar("Found")

LARGEST = 16_000_000
"""Size from which a file is refused [bytes]."""
ABORT = "abort"
"""Ending of the abort table's name."""
WIND = "wind"
"""Ending of the name of what was flown in wind."""


def place_of(log: Path, ending: str) -> Path:
    """Return where a file of a log lies unless a user says otherwise."""
    return log.with_name(f"{log.stem}-{ending}.json")


def write_beside(log: Path, place: Path, content: Mapping[str, Any]) -> None:
    """Write a file of a log, whole or not at all."""
    from showc.files import write_file

    named = {"log": log.name, "sha256": sha256(log.read_bytes()).hexdigest()}
    write_file(place, (json.dumps(named | dict(content), indent=1) + "\n").encode())


def read_beside(
    log: Path, ending: str, build: Callable[[Any], Found], otherwise: Found
) -> Found:
    """Return what ``build`` makes of a log's file.

    ``otherwise`` if there is none, it is of another log, or it holds something else.
    """
    from showc.files import UnreadableFileError, read_file

    try:
        content = json.loads(read_file(place_of(log, ending), LARGEST))
        if content["sha256"] == sha256(log.read_bytes()).hexdigest():
            return build(content)
    except (
        UnreadableFileError, ValueError, LookupError, TypeError, AttributeError,
        RecursionError,
    ):  # fmt: skip
        pass
    return otherwise
