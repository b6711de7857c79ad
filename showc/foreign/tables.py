"""Flights as columns of numbers: Skybrush's CSV, polynomial pieces (poly7).

Skybrush's CSV has one file a drone: ``Time [msec],x [m],y [m],z [m],Red,Green,Blue``;
places are joined by straight lines, columns found by their names and units. A poly7
file has one line a piece: its duration and eight ascending coefficients of x, y, z and
yaw in the time since the piece's start.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import comb
from typing import TYPE_CHECKING
from warnings import catch_warnings, simplefilter

import numpy as np

from showc.documents.archive import LARGEST_ENTRY, Archive
from showc.documents.numbers import places, rising
from showc.errors import DamagedFileError
from showc.files import read_file
from showc.foreign.show import Course, Courses, ForeignShow, LightTrack, polyline
from showc.processes import side_by_side

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from showc.arrays import FloatArray


MOST_ROWS = 50_000
"""Lines of one drone: a quarter of an hour at 50 a second."""

MOST_DRONES = 5000
"""Tables in an archive."""

DEGREE = 7
"""Degree of the pieces of a poly7 file."""

COLUMNS = 1 + 4 * (DEGREE + 1)
"""Numbers on a line of a poly7 file."""

_POLY7 = "duration"
_FIRST = 2000
"""How much of a file is looked at for its first line [bytes]."""


def is_poly7(content: bytes) -> bool:
    """Whether a file begins like polynomial pieces, by its heading or its columns."""
    begun = content[:_FIRST].lstrip().split(b"\n", 1)[0]
    named = begun.lower().startswith(_POLY7.encode())
    return named or begun.count(b",") == COLUMNS - 1


def table(content: bytes, name: str) -> tuple[list[str], FloatArray]:
    """Read a table of numbers: cells of its heading, and values (rows, columns).

    Spreadsheets write what they like: commas, semicolons or tabs between cells, commas
    in numbers, quotes, any end of line, a mark of the encoding, comments, empty cells
    at the end of each line.

    Raises
    ------
    DamagedFileError
        If a line has other numbers of columns, or what is no number.
    """
    if max(content.count(b"\n"), content.count(b"\r")) > MOST_ROWS + 2:
        raise DamagedFileError(
            f"{name}: has more than {MOST_ROWS:,} lines of numbers; no drone has"
        )
    coding = "utf-16" if content[:2] in {b"\xff\xfe", b"\xfe\xff"} else "utf-8-sig"
    try:
        text = content.decode(coding).replace('"', "")
    except UnicodeDecodeError as error:
        raise DamagedFileError(f"{name}: is no text ({error.reason})") from None
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    lines = [line for line in lines if line.strip()[:1] not in {"", "#"}]
    if lines:
        between = next((one for one in ";\t" if one in lines[-1]), ",")
        if between != ",":
            lines = [line.replace(",", ".").replace(between, ",") for line in lines]
        if all(line.rstrip().endswith(",") for line in lines):
            lines = [line.rstrip()[:-1] for line in lines]
    head = lines[0].split(",") if lines and _worded(lines[0]) else []
    lines = lines[1:] if head else lines
    first = 2 if head else 1
    if not 1 <= len(lines) <= MOST_ROWS:
        raise DamagedFileError(
            f"{name}: has {len(lines):,} lines of numbers; wanted 1 to {MOST_ROWS:,}"
        )
    count = lines[0].count(",") + 1
    uneven = [index for index, line in enumerate(lines) if line.count(",") + 1 != count]
    if uneven:
        raise DamagedFileError(
            f"{name}: line {first + uneven[0]} has "
            f"{lines[uneven[0]].count(',') + 1} columns; the first has {count}"
        )
    return head, _numbers(",".join(lines), name).reshape(len(lines), count)


def _numbers(cells: str, name: str) -> FloatArray:
    """Read numbers between commas; what is wrong is found cell by cell."""
    with suppress(DeprecationWarning, ValueError), catch_warnings():
        simplefilter("error")
        values = np.fromstring(cells, sep=",")
        if values.size == cells.count(",") + 1:
            return values
    try:
        if "_" in cells:
            raise ValueError("'_'")  # noqa: TRY301 - digits that only Python reads
        return np.array(cells.split(","), dtype=np.float64)
    except ValueError as error:
        raise DamagedFileError(f"{name}: holds what is no number ({error})") from None


def _worded(line: str) -> bool:
    """Whether a line is a heading; NaN and infinity are numbers, if bad ones."""
    cell = line.split(",", maxsplit=1)[0].strip().lower()
    if cell in {"nan", "inf", "-inf", "infinity"}:
        return False
    return any(letter.isalpha() for letter in cell.replace("e", ""))


_NAMES = {
    "time": "t",
    "timestamp": "t",
    "red": "r",
    "green": "g",
    "blue": "b",
}
"""Short names of columns; others are their own."""

_TIMES = {"msec": 1e-3, "ms": 1e-3, "s": 1.0, "sec": 1.0, "seconds": 1.0}
_LENGTHS = {"": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048}
_SHARES = {"": 1.0}
_UNITS = {
    "t": {"": 1e-3, **_TIMES},
    **dict.fromkeys("xyz", _LENGTHS),
    **dict.fromkeys("rgb", _SHARES),
}
"""Units that a column may have, in those of its quantity [s, m]."""
_CELL = re.compile(r"(?:pos(?:ition)?[ _]?)?([a-z]+)[ _]*(?:[\[(]? *([a-z]*) *[\])]?)")
"""A cell of a heading, in small letters: name, and unit in whatever brackets."""

_QUICKEST = 5.0
"""Least time between two rows of a table whose unit is not said [ms]: numbers that are
nearer are seconds, for no table has two hundred rows a second."""


def skybrush_columns(head: list[str], values: FloatArray, name: str) -> FloatArray:
    """Return the columns t [s], x, y, z [m] and, where there are colours, r, g, b.

    Colours of which none is greater than 1 are shares of full light.

    Raises
    ------
    DamagedFileError
        If the heading names none of them, one twice, or a unit that is not known.
    """
    if not head:
        if values.shape[1] not in {4, COLOURED}:
            raise DamagedFileError(
                f"{name}: has {values.shape[1]} columns and no heading; wanted 4 or 7"
            )
        head = ["t", "x", "y", "z", "r", "g", "b"][: values.shape[1]]
    if len(head) != values.shape[1]:
        raise DamagedFileError(
            f"{name}: has {values.shape[1]} columns; its heading has {len(head)}"
        )
    found: dict[str, FloatArray] = {}
    for cell, column in zip(head, values.T, strict=True):
        key, unit = _named(cell)
        if key not in _UNITS:
            continue
        if key in found or unit not in _UNITS[key]:
            raise DamagedFileError(
                f"{name}: the column {cell.strip()[:40]!r} of the heading is there "
                f"twice, or in a unit that is not known; wanted {WANTED!r}"
            )
        factor = _UNITS[key][unit]
        if key == "t" and not unit and _in_seconds(column):
            factor = 1.0
        found[key] = column * factor
    missing = [key for key in "txyz" if key not in found]
    if missing:
        raise DamagedFileError(
            f"{name}: the heading {','.join(head)[:60]!r} has no column "
            f"{', '.join(missing)}; wanted {WANTED!r}"
        )
    result = [found[key] for key in "txyz"]
    if all(key in found for key in "rgb"):
        colours = np.stack([found[key] for key in "rgb"])
        result += list(colours * (255.0 if 0.0 < colours.max() <= 1.0 else 1.0))
    return np.stack(result, axis=1)


def _named(cell: str) -> tuple[str, str]:
    """Return the short name of a column and its unit, both in small letters."""
    match = _CELL.fullmatch(cell.strip().lower())
    if match is None:
        return "", ""
    return _NAMES.get(match[1], match[1]), match[2]


def _in_seconds(times: FloatArray) -> bool:
    return times.size > 1 and float(np.median(np.diff(times))) < _QUICKEST


WANTED = "Time [msec],x [m],y [m],z [m],Red,Green,Blue"
"""The heading as Skybrush writes it."""


def skybrush_course(content: bytes, name: str) -> tuple[Course, LightTrack | None]:
    """Read one drone's table of places and colours."""
    values = skybrush_columns(*table(content, name), name)
    # A part of the table would keep all of it.
    times = rising(values[:, 0].copy(), name)
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
    # Whole numbers, as they are written, take an eighth as bytes.
    short = colours.astype(np.uint8)
    return course, LightTrack(
        times, short if np.array_equal(short, colours) else colours
    )


COLOURED = 7
"""Columns of a table that has colours."""


def poly7_course(content: bytes, name: str) -> Course:
    """Read one drone's polynomial pieces."""
    _, values = table(content, name)
    if values.shape[1] != COLUMNS:
        raise DamagedFileError(
            f"{name}: has {values.shape[1]} columns; wanted {COLUMNS}"
        )
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


@dataclass(frozen=True, slots=True, eq=False)
class _Flown:
    """What the table of one drone says."""

    course: Course
    light: LightTrack | None
    poly7: bool


Opened = Callable[[str], bytes]
"""Gives the content of a member by its name."""


def read_tables(
    path: Path, members: dict[str, str], opened: Callable[[], Opened]
) -> ForeignShow:
    """Read the tables of a whole fleet, those of a great one side by side.

    Parameters
    ----------
    path
        Of the show.
    members
        Which member has the table of a drone, by the drone's name.
    opened
        Opens the show, once for each copy of this process: two must not share a file.

    Raises
    ------
    DamagedFileError
        If one is not what its format wants, or the fleet mixes two.
    """

    def some(names: Sequence[str]) -> list[_Flown]:
        read, found, counted = opened(), list[_Flown](), Courses(path)
        for member in (members[name] for name in names):
            content = read(member)
            what = str(path) if member == path.name else f"{path}: {member}"
            if is_poly7(content):
                found.append(_Flown(poly7_course(content, what), None, poly7=True))
            else:
                found.append(_Flown(*skybrush_course(content, what), poly7=False))
            counted.add(found[-1].course)
        return found

    names = list(members)
    most = len(names) if len(names) < GREAT else -(-len(names) // PARTS)
    parts = [
        partial(some, names[low : low + most]) for low in range(0, len(names), most)
    ]
    fleet = [one for part in side_by_side(parts) for one in part]
    if len({one.poly7 for one in fleet}) > 1:
        raise DamagedFileError(f"{path}: mixes polynomial pieces and tables of places")
    courses = Courses(path)
    for one in fleet:
        courses.add(one.course)
    poly7 = fleet[0].poly7
    return ForeignShow(
        str(path),
        "poly7 .csv" if poly7 else "Skybrush .csv",
        path.stem,
        tuple(names),
        courses.tracks(),
        lights=() if poly7 else tuple(one.light for one in fleet),
    )


GREAT = 100
"""Drones from which on a fleet is read in parts."""

PARTS = 4
"""Parts of a great fleet that are read side by side."""


def read_csv_zip(path: Path) -> ForeignShow:
    """Read a zip of tables, one a drone.

    Raises
    ------
    DamagedFileError
        If it is not that.
    """
    # What macOS packs beside each file is no table.
    members = [
        name
        for name in Archive(path).names
        if name.lower().endswith(".csv") and not name.rsplit("/", 1)[-1].startswith(".")
    ]
    if not 1 <= len(members) <= MOST_DRONES:
        raise DamagedFileError(
            f"{path}: has {len(members):,} .csv files; wanted 1 to {MOST_DRONES:,}"
        )
    named: dict[str, str] = {}
    for member in members:
        stem = member.rsplit("/", 1)[-1][: -len(".csv")]
        if stem in named:
            raise DamagedFileError(f"{path}: has two drones named {stem!r}")
        named[stem] = member
    return read_tables(path, named, lambda: Archive(path).read)


def read_csv_files(path: Path, files: Sequence[Path]) -> ForeignShow:
    """Read a folder of tables, one a drone."""
    folder = path if path.is_dir() else path.parent
    return read_tables(
        path,
        {file.stem: file.name for file in files},
        lambda: lambda name: read_file(folder / name, LARGEST_ENTRY),
    )
