"""Tables over time: in each row a moment, a place, and what the place has then."""

from __future__ import annotations

import csv
import math
import re
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.arrays import FloatArray

MOST_LINES = 120_000
"""Lines of a table: more than its bytes allow with numbers of five digits."""
LONGEST = 3600.0
"""Latest moment of a table [s]."""
_AROUND = ' \t\r"'
_NAMES = {
    "r": "red", "g": "green", "b": "blue", "t": "time", "drone": "place", "id": "place",
}  # fmt: skip
_UNITS = {
    "time": ("seconds", {"s", "sec", "second", "seconds"}),
    **dict.fromkeys("xyz", ("metres", {"m", "metre", "meter", "metres", "meters"})),
}
"""Units that columns are in, and how tables write them."""
_COLOURS = ["red", "green", "blue"]


def timed_rows(
    content: bytes,
    name: str,
    key: str,
    ranges: Mapping[str, tuple[float, float]],
    help_text: str,
) -> FloatArray:
    """Return rows of time [s], place (from 1) and columns of its own.

    Parameters
    ----------
    content
        The file.
    name
        As the script names it.
    key
        The script's key that names it.
    ranges
        Least and greatest number of each column, ``time`` and ``place`` first.
    help_text
        What the table must hold.

    Returns
    -------
    FloatArray
        Shape (rows, columns), in the file's order.

    Raises
    ------
    ScriptError
        Naming the first faulty line.
    """
    try:
        lines = content.decode("utf-8-sig").split("\n")
    except UnicodeDecodeError:
        raise ScriptError("SHW110", f"`{name}` is not UTF-8", key=key) from None
    if len(lines) > MOST_LINES:
        raise ScriptError(
            "SHW119",
            f"`{name}` has {len(lines)} lines; at most {MOST_LINES} are read",
            key=key,
        )
    numbers = [
        number
        for number, line in enumerate(lines)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    first = lines[numbers[0]] if numbers else ""
    separator = separator_of(first)
    heads = heads_of(cells_of(first, separator), name, key)
    lacking = [one for one in ranges if one not in heads]
    if lacking:
        raise ScriptError(
            "SHW110",
            f"`{name}` has no column {lacking[0]}",
            key=key,
            help_text=f"the first line names the columns {', '.join(ranges)}; "
            f"{help_text}",
        )
    where = [heads.index(one) for one in ranges]
    rows = [_row(cells_of(lines[number], separator), where) for number in numbers[1:]]
    values = np.array(rows).reshape(-1, len(where))
    for (column, (low, high)), found in zip(ranges.items(), values.T, strict=True):
        good = (found >= low) & (found <= high)
        if column == "place":
            good &= found % 1.0 == 0.0
        if not good.all():
            row = int(np.argmin(good))
            raise ScriptError(
                "SHW110",
                f"`{name}`, line {numbers[row + 1] + 1}: {column} is not a number from "
                f"{low:g} to {high:g}",
                key=key,
                help_text=help_text,
            )
    shares = [at for at, one in enumerate(ranges) if one in _COLOURS]
    refuse_shares(values[:, shares], name, key)
    return values


def separator_of(line: str) -> str:
    """Return what separates the columns of a table, by its first line."""
    return max(";\t,", key=re.sub('"[^"]*"', "", line).count)


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line, of which quotes may hold any sign (RFC 4180)."""
    if '"' not in line:
        return line.split(separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error:
        return [line]


def heads_of(cells: list[str], file: str, key: str) -> list[str]:
    """Names of columns, without units, quotes or capitals.

    Raises
    ------
    ScriptError
        If a unit is not the one that the column is in.
    """
    found = []
    for cell in cells:
        name, unit = head_of(cell)
        wanted, units = _UNITS.get(name, ("", {unit}))
        if unit and unit not in units:
            raise ScriptError(
                "SHW110",
                f"`{file}` has the column {name} in {unit}; expected {wanted}",
                key=key,
                help_text=f"convert its numbers to {wanted}, and change its head line",
            )
        found.append(name)
    return found


def head_of(cell: str) -> tuple[str, str]:
    """Name and unit of a column, without quotes or capitals."""
    name, _, unit = cell.strip(_AROUND).lower().replace("(", "[").partition("[")
    name = name.strip(_AROUND)
    return _NAMES.get(name, name), unit.strip(_AROUND + "])")


def refuse_shares(colours: FloatArray, file: str, key: str) -> None:
    """Refuse colours that go from 0 to 1: taken from 0 to 255 they would be dark.

    Raises
    ------
    ScriptError
        If there is a fraction among them, and none above 1.
    """
    if colours.size and colours.max() <= 1.0 and (colours % 1.0).any():
        raise ScriptError(
            "SHW110",
            f"`{file}` has colours from 0 to 1; expected 0 to 255",
            key=key,
            help_text="multiply red, green and blue by 255",
        )


def _row(cells: list[str], where: list[int]) -> list[float]:
    """Return the numbers of a line; not a number where there is none."""
    try:
        return [float(cells[column].strip(_AROUND)) for column in where]
    except (ValueError, IndexError):
        return [_number(cells[column : column + 1]) for column in where]


def _number(cell: list[str]) -> float:
    try:
        return float(cell[0].strip(_AROUND)) if cell else math.nan
    except ValueError:
        return math.nan
