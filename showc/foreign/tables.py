"""Flights as columns of numbers: Skybrush's CSV, polynomial pieces (poly7).

Skybrush's CSV has one file a drone: ``Time [msec],x [m],y [m],z [m],Red,Green,Blue``;
places are joined by straight lines. A poly7 file has one line a piece: its duration and
eight ascending coefficients of x, y, z and yaw in the time since the piece's start.
"""

from __future__ import annotations

from functools import partial
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from showc.errors import DamagedFileError
from showc.files import read_file
from showc.foreign.document import LARGEST_ENTRY, Archive
from showc.foreign.numbers import places, rising
from showc.foreign.show import Course, Courses, ForeignShow, LightTrack, polyline

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from showc.arrays import FloatArray


MOST_ROWS = 50_000
"""Lines of one drone: a quarter of an hour at 50 a second."""

DEGREE = 7
"""Degree of the pieces of a poly7 file."""

COLUMNS = 1 + 4 * (DEGREE + 1)
"""Numbers on a line of a poly7 file."""

_POLY7 = "duration"


def is_poly7(content: bytes) -> bool:
    """Whether a file begins like polynomial pieces."""
    return content[:40].lstrip().lower().startswith(_POLY7.encode())


def numbers(content: bytes, name: str, columns: Sequence[int]) -> FloatArray:
    """Read the numbers of a comma-separated file without its heading, (rows, columns).

    Raises
    ------
    DamagedFileError
        If a line has other numbers of columns, or what is no number.
    """
    if content.count(b"\n") > MOST_ROWS + 2:
        raise DamagedFileError(
            f"{name}: has more than {MOST_ROWS:,} lines of numbers; no drone has"
        )
    try:
        lines = content.decode("utf-8-sig").split("\n")
    except UnicodeDecodeError as error:
        raise DamagedFileError(f"{name}: is no text ({error.reason})") from None
    lines = [line for line in lines if line.strip()]
    first = 1 if lines and any(letter.isalpha() for letter in _cell(lines[0])) else 0
    lines = lines[first:]
    if not 1 <= len(lines) <= MOST_ROWS:
        raise DamagedFileError(
            f"{name}: has {len(lines):,} lines of numbers; wanted 1 to {MOST_ROWS:,}"
        )
    count = lines[0].count(",") + 1
    if count not in columns:
        raise DamagedFileError(
            f"{name}: line {first + 1} has {count} columns; wanted "
            + " or ".join(str(wanted) for wanted in columns)
        )
    uneven = [index for index, line in enumerate(lines) if line.count(",") + 1 != count]
    if uneven:
        raise DamagedFileError(
            f"{name}: line {first + 1 + uneven[0]} has "
            f"{lines[uneven[0]].count(',') + 1} columns; the first has {count}"
        )
    try:
        values = np.array(",".join(lines).split(","), dtype=np.float64)
    except ValueError as error:
        raise DamagedFileError(f"{name}: holds what is no number ({error})") from None
    return np.asarray(values.reshape(len(lines), count))


def _cell(line: str) -> str:
    """First cell of a line; NaN and infinity are numbers, if bad ones."""
    cell = line.split(",", maxsplit=1)[0].strip().lower()
    return "" if cell in {"nan", "inf", "-inf", "infinity"} else cell.replace("e", "")


def skybrush_course(content: bytes, name: str) -> tuple[Course, LightTrack | None]:
    """Read one drone's table of places and colours."""
    values = numbers(content, name, (4, 7))
    times = rising(values[:, 0] / 1000.0, name)
    course = polyline(times, places(values[:, 1:4], name))
    if values.shape[1] < COLOURED:
        return course, None
    colours = values[:, 4:7]
    if not np.all((colours >= 0.0) & (colours <= 255.0)):
        row = int(np.flatnonzero(~((colours >= 0) & (colours <= 255)).all(axis=1))[0])
        raise DamagedFileError(
            f"{name}: the colour of row {row + 1} is {colours[row].tolist()}; wanted "
            "three numbers from 0 to 255"
        )
    return course, LightTrack(times, colours)


COLOURED = 7
"""Columns of a table that has colours."""


def poly7_course(content: bytes, name: str) -> Course:
    """Read one drone's polynomial pieces."""
    values = numbers(content, name, (COLUMNS,))
    durations = values[:, 0]
    times = rising(np.concatenate([[0.0], np.cumsum(durations)]), name)
    ascending = values[:, 1:].reshape(-1, 4, DEGREE + 1)[:, :3]
    if not np.all(np.isfinite(ascending)):
        raise DamagedFileError(f"{name}: a coefficient is not finite")
    powers = durations[:, None, None] ** np.arange(DEGREE + 1)
    points = np.einsum("jk,rak->rja", bernstein_of_powers(DEGREE), ascending * powers)
    return Course(times, places(points, name))


def bernstein_of_powers(degree: int) -> FloatArray:
    """Matrix from coefficients of powers of the fraction to Bernstein coefficients.

    Entry (j, k) is C(j, k) / C(n, k) (Farouki 2012, equation 29).
    """
    return np.array(
        [
            [comb(j, k) / comb(degree, k) for k in range(degree + 1)]
            for j in range(degree + 1)
        ]
    )


def read_tables(path: Path, contents: dict[str, Callable[[], bytes]]) -> ForeignShow:
    """Read the tables of a whole fleet, by the name of each drone, one after the other.

    Raises
    ------
    DamagedFileError
        If one is not what its format wants, or the fleet mixes two.
    """
    courses, lights = Courses(path), []
    kinds = set()
    for name, read in contents.items():
        content, light = read(), None
        kinds.add(is_poly7(content))
        if len(kinds) > 1:
            raise DamagedFileError(
                f"{path}: mixes polynomial pieces and tables of places"
            )
        if is_poly7(content):
            course = poly7_course(content, name)
        else:
            course, light = skybrush_course(content, name)
        courses.add(course)
        lights.append(light)
    poly7 = kinds.pop()
    return ForeignShow(
        str(path),
        "poly7 .csv" if poly7 else "Skybrush .csv",
        path.stem,
        tuple(contents),
        courses.tracks(),
        lights=() if poly7 else tuple(lights),
    )


def read_csv_zip(path: Path) -> ForeignShow:
    """Read a zip of tables, one a drone.

    Raises
    ------
    DamagedFileError
        If it is not that.
    """
    archive = Archive(path)
    members = [name for name in archive.names if name.lower().endswith(".csv")]
    if not members:
        raise DamagedFileError(f"{path}: has no .csv files in it")
    contents: dict[str, Callable[[], bytes]] = {}
    for member in members:
        stem = member.rsplit("/", 1)[-1][: -len(".csv")]
        if stem in contents:
            raise DamagedFileError(f"{path}: has two drones named {stem!r}")
        contents[stem] = partial(archive.read, member)
    return read_tables(path, contents)


def read_csv_files(path: Path, files: Sequence[Path]) -> ForeignShow:
    """Read a folder of tables, one a drone."""
    return read_tables(
        path, {file.stem: partial(read_file, file, LARGEST_ENTRY) for file in files}
    )
