"""CSV: places, and colours if there are any, from a table."""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.formations.shape import Drawing, Request, Shape
from showc.script.language.kinds import Field, File, Section
from showc.script.language.timed import (
    cells_of,
    head_of,
    heads_of,
    refuse_shares,
    separator_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from showc.script.language.settings import Settings

_LARGEST = 10_000.0
"""Farthest place from the origin [m]: as far as any site reaches."""
_AROUND = ' \t\r"'
"""What may surround a cell."""
MAX_LINES = 20_000
"""Lines of a table: the largest fleet, and as many comments."""

SECTION = Section(
    "csv",
    "Places from a CSV file, show frame: columns x, y, z in metres, and optionally "
    "red, green, blue from 0 to 255. Without colours, the head line may be missing. "
    "Columns are separated by commas, semicolons or tabs.",
    (Field("file", File((".csv", ".tsv", ".txt")), "The table.", required=True),),
)


@lru_cache(maxsize=4)
def rows_of(content: bytes, name: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Return places, shape (n, 3) [m], and sRGB colours 0 to 1, (n, 3) or None.

    Raises
    ------
    ScriptError
        Naming the first faulty line, and how many there are.
    """
    lines_there = content.count(b"\n") + 1
    if lines_there > MAX_LINES:
        raise ScriptError(
            "SHW119",
            f"`{name}` has {lines_there} lines; at most {MAX_LINES} are read",
            key="file",
        )
    try:
        lines = content.decode("utf-8-sig").split("\n")
    except UnicodeDecodeError:
        raise ScriptError("SHW110", f"`{name}` is not UTF-8", key="file") from None
    kept = (line for line in lines if line.strip() and not line.startswith("#"))
    separator = separator_of(next(kept, ""))
    table = [
        (number, [cell.strip(_AROUND) for cell in cells_of(line, separator)])
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not table:
        raise ScriptError("SHW110", f"`{name}` has no lines", key="file")
    wide = len(table[0][1])
    columns = _columns(table[0][1], name)
    if columns is not None:
        table = table[1:]
    else:
        columns = {"x": 0, "y": 1, "z": 2}
        if all(len(cells) >= 6 for _, cells in table):
            columns |= {"red": 3, "green": 4, "blue": 5}
    values, faults = _values(table, columns, wide)
    if faults:
        more = (f"{len(faults)} lines are faulty",) if len(faults) > 1 else ()
        raise ScriptError(
            "SHW110",
            f"`{name}`, line {faults[0][0]}: {faults[0][1]}",
            key="file",
            notes=more,
            help_text="x, y and z are numbers in metres with a decimal point, colours "
            "0 to 255",
        )
    if not values:
        raise ScriptError("SHW110", f"`{name}` has no places", key="file")
    rows = np.array(values, dtype=np.float64)
    rows.setflags(write=False)
    refuse_shares(rows[:, 3:6], name, "file")
    colours = rows[:, 3:6] / 255.0 if rows.shape[1] >= 6 else None
    return rows[:, :3], colours


def _columns(cells: list[str], file: str) -> dict[str, int] | None:
    """Return where the columns are, if a line names them.

    Raises
    ------
    ScriptError
        If it names others than a table of places has.
    """
    names = [head_of(cell)[0] for cell in cells]
    if "time" in names and {"x", "y", "z"} <= set(names):
        raise ScriptError(
            "SHW110",
            f"`{file}` has a column of times: its rows are the path of one drone, and "
            "not the places of several",
            key="file",
            help_text="give one row for each drone, with the columns x, y and z; or "
            "use `type: frames`, with a column `place`",
        )
    if not {"x", "y", "z"} <= set(names):
        lacking = sorted({"x", "y", "z"} - set(names))
        if len(lacking) < 3:
            raise ScriptError(
                "SHW110",
                f"`{file}` has no column {lacking[0]}",
                key="file",
                help_text="x and y are across the ground, z is the height, in metres",
            )
        return None
    heads_of(cells, file, "file")
    wanted = ["x", "y", "z"]
    if {"red", "green", "blue"} <= set(names):
        wanted += ["red", "green", "blue"]
    return {name: names.index(name) for name in wanted}


def _values(
    table: list[tuple[int, list[str]]], columns: dict[str, int], wide: int
) -> tuple[list[list[float]], list[tuple[int, str]]]:
    """Read the numbers of all rows, of which none has more cells than the first one."""
    values, faults = [], []
    for number, cells in table:
        if any(cells[wide:]):
            found = f"has {len(cells)} cells; the first line has {wide}"
            faults.append((number, found))
            continue
        row = []
        for name, column in columns.items():
            cell = cells[column] if column < len(cells) else ""
            try:
                value = float(cell)
            except ValueError:
                faults.append((number, f"{name} is {_form(cell)}; expected a number"))
                break
            largest = 255.0 if name in {"red", "green", "blue"} else _LARGEST
            least = 0.0 if name in {"red", "green", "blue"} else -_LARGEST
            if not math.isfinite(value) or not least <= value <= largest:
                text = f"{name} is {value:g}; expected {least:g} to {largest:g}"
                faults.append((number, text))
                break
            row.append(value)
        else:
            values.append(row)
    return values, faults


def _form(cell: str) -> str:
    """Say what a cell that is no number looks like, and nothing of what it holds."""
    if not cell:
        return "empty"
    if re.fullmatch(r"[-+]?\d+,\d+", cell):
        return "written with a decimal comma"
    return "text"


def own_count(settings: Settings, read: Callable[[str, str], bytes]) -> int | None:
    """Return the number of lines with places."""
    name = settings.text("file")
    return len(rows_of(read(name, "file"), name)[0])


def draw(settings: Settings, request: Request) -> Drawing:
    """Return the first ``count`` places as they are."""
    name = settings.text("file")
    points, colours = rows_of(request.read(name, "file"), name)
    if len(points) < request.count:
        raise ScriptError(
            "SHW205",
            f"`{name}` has {len(points)} places; {request.count} are needed",
            key="file",
        )
    cut = request.count
    return Drawing(points[:cut], colours[:cut] if colours is not None else None)


SHAPE = Shape(SECTION, own_count, draw, absolute=True)
