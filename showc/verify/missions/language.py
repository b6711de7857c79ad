"""The language of missions: every row that may stand in a file, and in which order.

A mission is a sentence of a small language, and whatever is no word of it, or stands
where its grammar does not have it, is refused: what an autopilot makes of other items
is not known here, so nothing about them can be proved. Words and sentences are listed
in ``language.toml``. Rows are written in one way only: numbers in their shortest form,
places with eight decimals, heights with three. So the bytes follow from what is said.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

from showc.codes import read_table
from showc.errors import ShowError

RULES: dict[str, Any] = read_table(__package__ or "", "language.toml")
"""What ``language.toml`` says."""

MISSION, RELATIVE = 2, 3  # MAV_FRAME: no place, height above home

_ROW = re.compile(
    # Whether it is the first, frame, command; parameters; latitude and longitude.
    r"([01])" + 2 * r"\t(0|[1-9]\d{0,4})"
    + 4 * r"\t(?!-0\t)(-?(?:0|[1-9]\d{0,6})(?:\.\d{0,3}[1-9])?)"
    + 2 * r"\t(?!-0\.0*\t)(-?(?:0|[1-9]\d{0,2})\.\d{7})0"
    # Height; go on with the next row.
    + r"\t(?!-0\.0*\t)(-?(?:0|[1-9]\d{0,6})\.\d{3})\t1"
)  # fmt: skip
"""A row without its number: each number in the one form in which showc writes it."""

_GRAMMARS = {
    name: re.compile(text, re.VERBOSE) for name, text in RULES["sentences"].items()
}


class MissionFormatError(ShowError):
    """A file beside the log says something that showc never writes."""


class Item(NamedTuple):
    """One row of a mission."""

    word: str
    """Its letter in the grammar."""
    frame: int
    command: int
    parameters: tuple[float, float, float, float]
    latitude: int
    """[1e-7 deg]"""
    longitude: int
    """[1e-7 deg]"""
    height: float
    """In the item's frame [m]."""


@dataclass(frozen=True, slots=True)
class Mission:
    """One drone's mission, every row of it known."""

    home: Item | None
    """The planned home; None for PX4, whose missions have none."""
    items: tuple[Item, ...]
    """What follows it."""


def read_mission(
    content: bytes, autopilot: str = "ardupilot", most: int = RULES["most_items"]
) -> Mission:
    """Return the mission that the bytes of a ``.waypoints`` file hold.

    The grammar is that of ``autopilot``, ``ardupilot`` or ``px4``. It has ``most``
    items at most, home among them. MissionFormatError, naming the line, if a row is no
    word of the language; or if the rows are no sentence of it.
    """
    if autopilot not in _GRAMMARS:
        raise MissionFormatError(f"is for an unknown autopilot {autopilot!r}")
    if not content.isascii():
        raise MissionFormatError("is not ASCII text")
    lines = content.decode("ascii").split("\n")
    if lines[0] != RULES["header"]:
        raise MissionFormatError(f"does not begin with {RULES['header']!r}")
    if not 3 <= len(lines) <= most + 2 or lines[-1]:
        raise MissionFormatError(f"is not 1 to {most} rows, each with its end")
    items = []
    for number, line in enumerate(lines[1:-1]):
        index, _, rest = line.partition("\t")
        try:
            items.append(_item(rest, number == 0))
        except MissionFormatError as error:
            raise MissionFormatError(f"line {number + 2}: {error}") from None
        if index != str(number):
            raise MissionFormatError(f"line {number + 2}: is numbered {index[:9]!r}")
    sentence = "".join(item.word for item in items)
    if not _GRAMMARS[autopilot].fullmatch(sentence):
        raise MissionFormatError(f"its rows are no mission, but {sentence:.80}")
    home = items[0] if autopilot == "ardupilot" else None
    if home is not None and items[1][4:6] != home[4:6]:
        raise MissionFormatError("line 3: takes off elsewhere than from its home")
    return Mission(home, tuple(items[home is not None :]))


@lru_cache(maxsize=1 << 16)
def _item(text: str, first: bool) -> Item:  # noqa: FBT001 - which of two rows
    """Read a row without its number: many drones have the same."""
    row = _ROW.fullmatch(text)
    if row is None or row[1] != str(int(first)):
        raise MissionFormatError("is not written as showc writes it")
    frame, command = int(row[2]), int(row[3])
    one, two, three, four, latitude, longitude, height = map(float, row.groups()[3:])
    degrees = round(latitude * 1e7), round(longitude * 1e7)
    parameters = one, two, three, four
    word = _word(frame, command, parameters)
    item = Item(word, frame, command, parameters, *degrees, height)
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and abs(height) < 1e5):
        raise MissionFormatError("names a place that is nowhere on the globe")
    if frame == MISSION and (*degrees, height) != (0, 0, 0.0):
        raise MissionFormatError("names a place, and its command has none")
    low, high = RULES["takeoff"]
    if word == "T" and not low <= height <= high + 0.002:
        raise MissionFormatError(f"takes off to {height:g} m, not {low:g} to {high:g}")
    # Stored is a height that is 2 mm further from zero than a whole centimetre.
    centimetres = round(abs(height) * 100.0 - 0.2)
    stored = 0.01 * centimetres + 0.002 * bool(centimetres)
    if frame == RELATIVE and not abs(abs(height) - stored) < 1e-6:
        raise MissionFormatError(f"height {height:.3f} m is not a stored one")
    return item


@lru_cache(maxsize=1 << 12)
def _word(
    frame: int, command: int, parameters: tuple[float, float, float, float]
) -> str:
    """Return the letter of a row; the place aside."""
    name = f"command {command}"
    for word, row in RULES["words"].items():
        if row["command"][1] != command:
            continue
        name = row["command"][0]
        if frame == row["frame"] and all(
            low <= value <= high and (isinstance(low, float) or value.is_integer())
            for value, (low, high) in zip(parameters, row["parameters"], strict=True)
        ):
            return str(word)
    text = f"{name} in frame {frame} with parameters "
    text += ", ".join(f"{value:g}" for value in parameters)
    raise MissionFormatError(f"{text} is nothing that showc writes")
