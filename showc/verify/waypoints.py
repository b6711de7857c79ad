"""Mission files as text: QGC WPL 110, every field checked."""

from __future__ import annotations

import math
from typing import NamedTuple

from showc.errors import ShowError

HEADER = "QGC WPL 110"

WAYPOINT, LAND, TAKEOFF = 16, 21, 22
"""MAV_CMD of the items that fly somewhere."""

GLOBAL, RELATIVE = 0, 3
"""MAV_FRAME: altitude above mean sea level, height above home."""

_FIELDS = 12


class MissionFormatError(ShowError):
    """A mission file is not QGC WPL 110."""


class Item(NamedTuple):
    """One row of a mission."""

    frame: int
    command: int
    parameters: tuple[float, float, float, float]
    latitude: float
    """[deg]"""
    longitude: float
    """[deg]"""
    height: float
    """In the item's frame [m]."""


def parse(content: bytes) -> list[Item]:
    """Return all rows, row 0 included.

    Raises
    ------
    MissionFormatError
        If header, number of fields, numbering or a number is wrong; names the line.
    """
    try:
        lines = content.decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise MissionFormatError("is not ASCII text") from error
    if not lines or lines[0].strip() != HEADER:
        raise MissionFormatError(f"does not begin with {HEADER!r}")
    items = _well_formed(lines[1:])
    return _careful(lines[1:]) if items is None else items


def _well_formed(lines: list[str]) -> list[Item] | None:
    """Return all rows, column by column; None if anything is wrong with them."""
    if any(line.count("\t") != _FIELDS - 1 for line in lines):
        return None
    fields = "\t".join(lines).split("\t") if lines else []
    try:
        index, current, frame, command, proceed = (
            list(map(int, fields[column::_FIELDS])) for column in (0, 1, 2, 3, 11)
        )
        values = [list(map(float, fields[column::_FIELDS])) for column in range(4, 11)]
    except ValueError:
        return None
    count = len(lines)
    numbered = index == list(range(count)) and current == [1, *[0] * (count - 1)]
    # A sum is finite only if all its numbers are.
    finite = all(math.isfinite(sum(column)) for column in values)
    if not (numbered and proceed == [1] * count and finite):
        return None
    return list(map(Item, frame, command, zip(*values[:4], strict=True), *values[4:]))


def _careful(lines: list[str]) -> list[Item]:
    """Return all rows, line by line, and name the first that is wrong."""
    items = []
    for number, line in enumerate(lines, start=2):
        fields = line.split("\t")
        if len(fields) != _FIELDS:
            raise MissionFormatError(f"line {number} has {len(fields)} fields, not 12")
        try:
            index, current, frame, command = (int(field) for field in fields[:4])
            values = [float(field) for field in fields[4:11]]
            proceed = int(fields[11])
        except ValueError as error:
            raise MissionFormatError(
                f"line {number} holds no number ({error})"
            ) from error
        if index != number - 2 or current != (index == 0) or proceed != 1:
            raise MissionFormatError(f"line {number} is numbered or marked wrongly")
        if not all(map(math.isfinite, values)):
            raise MissionFormatError(f"line {number} holds a number that is not finite")
        items.append(
            Item(
                frame,
                command,
                (values[0], values[1], values[2], values[3]),
                *values[4:],
            )
        )
    return items
