"""The language of missions: every row that may stand in a file, and in which order.

A mission is a sentence of a small language, and whatever is no word of it, or stands
where its grammar does not have it, is refused: what an autopilot makes of other items
is not known here, so nothing about them can be proved. The words:

====  ==================  =====  ====================================================
word  command             frame  parameters 1 to 4
====  ==================  =====  ====================================================
H     NAV_WAYPOINT        0      zero; row 0, the planned home
T     NAV_TAKEOFF         3      zero; above home, at most 2.5 m
W     NAV_WAYPOINT        3      zero (PX4: yaw)
L     NAV_LAND            3      zero (PX4: yaw)
C     NAV_DELAY           2      -1, hour (-1: any), minute, second
F     NAV_DELAY           2      below one second, -1, -1, -1
G     NAV_DELAY           2      one second or more, -1, -1, -1 (PX4)
P     NAV_DELAY           2      at least one second, zero
S     DO_CHANGE_SPEED     2      1, 2 or 3 (level, up, down), speed, -1, zero
V     DO_SET_SERVO        2      output, pulse width, zero
D     CONDITION_DELAY     2      seconds, zero
====  ==================  =====  ====================================================

and the sentences, with lights (V) before, half way (D) or after a leg:

    ArduPilot   H T V* S* W (S* C F? (V* W V* | D V+ W | V+))* P L
    PX4         T V* S* W (S* (F|G)? (V* W V* | V+))* P L

Rows are written in one way only: numbers in their shortest form, places with eight
decimals, heights with three. So the bytes of a file follow from what it says.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from showc.errors import ShowError

HEADER = "QGC WPL 110"

WAYPOINT, LAND, TAKEOFF, DELAY = 16, 21, 22, 93
CONDITION_DELAY, SPEED, SERVO = 112, 178, 183
"""MAV_CMD values of the words."""

GLOBAL, MISSION, RELATIVE = 0, 2, 3
"""MAV_FRAME: altitude above mean sea level, no place, height above home."""

GREATEST_TAKEOFF = 2.5
"""What is above is flown by a waypoint, at a known speed [m]."""

SLOWEST, FASTEST = 0.1, 20.0
"""Speeds that autopilots accept, above those of any drone of a show [m/s]."""

LONGEST_PAUSE = 600.0
"""Longest wait that is no slot [s]."""

LARGEST_FILE = 1 << 20
"""More than the items of any board [bytes]."""

MOST_ITEMS = 1306
"""Of the largest board."""

DECIMALS = 4
"""Of parameters."""

_GRAMMARS = {
    "ardupilot": re.compile("HTV*S*W(?:S*CF?(?:V*WV*|DV+W|V+))*PL"),
    "px4": re.compile("TV*S*W(?:S*[FG]?(?:V*WV*|V+))*PL"),
}

_NAMES = {
    WAYPOINT: "NAV_WAYPOINT",
    LAND: "NAV_LAND",
    TAKEOFF: "NAV_TAKEOFF",
    DELAY: "NAV_DELAY",
    CONDITION_DELAY: "CONDITION_DELAY",
    SPEED: "DO_CHANGE_SPEED",
    SERVO: "DO_SET_SERVO",
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


def read_mission(content: bytes, autopilot: str = "ardupilot") -> Mission:
    """Return the mission that a ``.waypoints`` file holds.

    Parameters
    ----------
    content
        The file's bytes.
    autopilot
        ``ardupilot`` or ``px4``: whose grammar holds.

    Raises
    ------
    MissionFormatError
        If a row is no word of the language, or the rows are no sentence of it; names
        the line.
    """
    if len(content) > LARGEST_FILE:
        raise MissionFormatError(
            f"has {len(content):,} bytes, and no mission has more than {LARGEST_FILE:,}"
        )
    if autopilot not in _GRAMMARS:
        raise MissionFormatError(f"is for an unknown autopilot {autopilot!r}")
    try:
        text = content.decode("ascii")
    except UnicodeDecodeError:
        raise MissionFormatError("is not ASCII text") from None
    lines = text.split("\n")
    if lines[0] != HEADER:
        raise MissionFormatError(f"does not begin with {HEADER!r}")
    if not 3 <= len(lines) <= MOST_ITEMS + 2 or lines[-1]:
        raise MissionFormatError(f"is not 1 to {MOST_ITEMS} rows, each with its end")
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
        raise MissionFormatError(_first_misplaced(items, _GRAMMARS[autopilot]))
    home = items[0] if autopilot == "ardupilot" else None
    mission = Mission(home, tuple(items[home is not None :]))
    _check_take_off(mission)
    return mission


def _first_misplaced(items: list[Item], grammar: re.Pattern[str]) -> str:
    """Name the first row with which the sentence can no longer be one."""
    sentence = "".join(item.word for item in items)
    # A beginning can be completed if some short ending makes a sentence of it.
    endings = ("", "PL", "L", "WPL", "VWPL", "CWPL", "GWPL", "TWPL", "VPL")
    good = 0
    for length in range(1, len(sentence) + 1):
        if any(grammar.fullmatch(sentence[:length] + ending) for ending in endings):
            good = length
    if good == len(sentence):
        return "ends too soon: after the last leg come a pause and NAV_LAND"
    command = _NAMES[items[good].command]
    return f"line {good + 2}: {command} does not belong here"


def _check_take_off(mission: Mission) -> None:
    takeoff, *rest = mission.items
    home = mission.home
    if home is not None and (takeoff.latitude, takeoff.longitude) != (
        home.latitude,
        home.longitude,
    ):
        raise MissionFormatError("line 3: takes off elsewhere than from its home")
    # The first item after a take-off is lost if it sets a speed: it is said twice.
    if home is not None and rest[0].word == "S" and rest[1] != rest[0]:
        raise MissionFormatError(
            "line 4: a speed straight after the take-off is not heeded, and is not "
            "said again"
        )


@lru_cache(maxsize=1 << 16)
def _item(text: str, first: bool) -> Item:  # noqa: FBT001 - which of two rows
    """Read a row without its number: many drones have the same."""
    fields = text.split("\t")
    if len(fields) != 11:
        raise MissionFormatError(f"has {len(fields) + 1} fields, not 12")
    try:
        current, frame, command = (int(field) for field in fields[:3])
        values = [float(field) for field in fields[3:10]]
        proceed = int(fields[10])
    except ValueError as error:
        raise MissionFormatError(f"holds no number ({error})") from None
    if not all(map(math.isfinite, values)):
        raise MissionFormatError("holds a number that is not finite")
    if current != first or proceed != 1:
        raise MissionFormatError("is marked wrongly as current, or does not go on")
    one, two, three, four, latitude, longitude, height = values
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and abs(height) < 1e5):
        raise MissionFormatError("names a place that is nowhere on the globe")
    word = _word(command, frame, (one, two, three, four), first=first)
    if frame == MISSION and (latitude, longitude, height) != (0.0, 0.0, 0.0):
        raise MissionFormatError("names a place, and its command has none")
    if word == "T" and not 0.0 < height <= GREATEST_TAKEOFF + 0.002:
        raise MissionFormatError(
            f"takes off to {height:g} m; more than {GREATEST_TAKEOFF:g} m is not known"
        )
    if frame == RELATIVE and not _stored(height):
        raise MissionFormatError(f"height {height:.3f} m is not a stored one")
    item = Item(
        word,
        frame,
        command,
        (one, two, three, four),
        round(latitude * 1e7),
        round(longitude * 1e7),
        height,
    )
    if _text(item, current) != text:
        raise MissionFormatError("is not written as showc writes it")
    return item


def _word(
    command: int, frame: int, values: tuple[float, float, float, float], *, first: bool
) -> str:
    """Return the letter of a row; the place aside."""
    one, two, three, four = values
    placed = (one, two, three) == (0.0, 0.0, 0.0) and 0.0 <= four < 360.0
    found = ""
    if command == WAYPOINT and first and frame == GLOBAL:
        found = "H" if placed and four == 0.0 else ""
    elif command in {WAYPOINT, LAND, TAKEOFF} and frame == RELATIVE:
        found = {WAYPOINT: "W", LAND: "L", TAKEOFF: "T"}[command] if placed else ""
    elif frame == MISSION and command == DELAY:
        found = _delay(values)
    elif frame == MISSION and command == CONDITION_DELAY:
        found = "D" if 0.0 < one <= LONGEST_PAUSE and values[1:] == (0, 0, 0) else ""
    elif frame == MISSION and command == SPEED:
        heeded = one in {1.0, 2.0, 3.0} and SLOWEST <= two <= FASTEST
        found = "S" if heeded and (three, four) == (-1.0, 0.0) else ""
    elif frame == MISSION and command == SERVO:
        output = one.is_integer() and 1.0 <= one <= 16.0
        pulse = two.is_integer() and 500.0 <= two <= 2500.0
        found = "V" if output and pulse and (three, four) == (0.0, 0.0) else ""
    if not found:
        name = _NAMES.get(command, f"command {command}")
        numbers = ", ".join(f"{value:g}" for value in values)
        raise MissionFormatError(
            f"{name} in frame {frame} with parameters {numbers} is nothing that showc "
            "writes"
        )
    return found


def _delay(values: tuple[float, float, float, float]) -> str:
    one, hour, minute, second = values
    if one == -1.0:
        clock = all(value.is_integer() for value in values)
        shown = -1.0 <= hour < 24.0 and 0.0 <= minute < 60.0 and 0.0 <= second < 60.0
        return "C" if clock and shown else ""
    if values[1:] == (-1.0, -1.0, -1.0) and 0.0 < one <= LONGEST_PAUSE:
        return "F" if one < 1.0 else "G"
    if values[1:] == (0.0, 0.0, 0.0) and 1.0 <= one <= LONGEST_PAUSE:
        return "P"
    return ""


def _stored(height: float) -> bool:
    """Whether a height stands 2 mm further from zero than a whole centimetre."""
    centimetres = round(abs(height) * 100.0 - 0.2)
    wanted = 0.01 * centimetres + 0.002 if centimetres else 0.0
    return abs(abs(height) - wanted) < 1e-6


def _text(item: Item, current: int) -> str:
    """Write a row, without its number, as showc writes it."""
    numbers = [shortest(value) for value in item.parameters]
    places = [_degrees(item.latitude), _degrees(item.longitude), f"{item.height:.3f}"]
    return "\t".join(
        [str(current), str(item.frame), str(item.command), *numbers, *places, "1"]
    )


def shortest(value: float) -> str:
    """Text of a number with up to four decimals."""
    text = f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text in {"", "-0"} else text


def _degrees(value: int) -> str:
    whole, part = divmod(abs(value), 10**7)
    return f"{'-' if value < 0 else ''}{whole}.{part:07d}0"
