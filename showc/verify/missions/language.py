"""The language of missions: every row that may stand in a file, and in which order.

A mission is a sentence of a small language, and whatever is no word of it, or stands
where its grammar does not have it, is refused: what an autopilot makes of other items
is not known here, so nothing about them can be proved. The words are in ``WORDS``,
and the sentences, with lights (V) before, half way (D) or after a leg:

    ArduPilot   H T V* S* W (S* C F? (V* W V* | D V+ W | V+))* P V* L
    PX4         T V* S* W (S* (F|G)? (V* W V* | V+))* P V* L

Rows are written in one way only: numbers in their shortest form, places with eight
decimals, heights with three. So the bytes of a file follow from what it says.
"""

from __future__ import annotations

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

LARGEST_FILE = 1 << 20
"""More than the items of any board, in either format [bytes]."""

MOST_ITEMS = 1306
"""Of the largest board."""

DECIMALS = 4
"""Of parameters."""

ZERO, NONE = range(1), range(-1, 0)
YAW = (0.0, 359.9999)
"""Of a waypoint [deg]: PX4 turns to it, ArduPilot's missions leave it at zero."""
PAUSE = (1.0, 7200.0)
"""A wait that is no slot: a second at least, two holds of an hour at most [s]."""
PART = (0.0001, 0.9999)
"""What a slot may lie behind a whole second [s]."""
DURING = (0.0001, 600.0)
"""When lights change during a leg [s]."""
SPEEDS = (0.1, 20.0)
"""Speeds that autopilots accept, above those of any drone of a show [m/s]."""

WORDS: dict[str, tuple[int, int, tuple[range | tuple[float, float], ...]]] = {
    "H": (GLOBAL, WAYPOINT, (ZERO, ZERO, ZERO, ZERO)),
    "T": (RELATIVE, TAKEOFF, (ZERO, ZERO, ZERO, YAW)),
    "W": (RELATIVE, WAYPOINT, (ZERO, ZERO, ZERO, YAW)),
    "L": (RELATIVE, LAND, (ZERO, ZERO, ZERO, YAW)),
    "C": (MISSION, DELAY, (NONE, range(-1, 24), range(60), range(60))),
    "F": (MISSION, DELAY, (PART, NONE, NONE, NONE)),
    "G": (MISSION, DELAY, (PAUSE, NONE, NONE, NONE)),
    "P": (MISSION, DELAY, (PAUSE, ZERO, ZERO, ZERO)),
    "S": (MISSION, SPEED, (range(1, 4), SPEEDS, NONE, ZERO)),
    "V": (MISSION, SERVO, (range(1, 17), range(500, 2501), ZERO, ZERO)),
    "D": (MISSION, CONDITION_DELAY, (DURING, ZERO, ZERO, ZERO)),
}
"""Frame, command, and what each parameter may be (whole numbers, or between two): the
planned home, take-off, waypoint, landing; a slot (hour, minute, second; hour -1: any),
a part of a second behind it, the same wait for PX4, a pause; a speed (level, up, down);
an output's pulse width [us]; a wait during the leg that follows."""

_GRAMMARS = {
    "ardupilot": re.compile("HTV*S*W(?:S*CF?(?:V*WV*|DV+W|V+))*PV*L"),
    "px4": re.compile("TV*S*W(?:S*[FG]?(?:V*WV*|V+))*PV*L"),
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
    """Return the mission that the bytes of a ``.waypoints`` file hold.

    The grammar is that of ``autopilot``: ``ardupilot`` or ``px4``.

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
    try:
        _, frame, command = (int(field) for field in fields[:3])
        one, two, three, four, latitude, longitude, height = map(float, fields[3:10])
        degrees = round(latitude * 1e7), round(longitude * 1e7)
    except (ValueError, OverflowError) as error:
        raise MissionFormatError(f"holds no 12 numbers ({error})") from None
    parameters = one, two, three, four
    word = _word(frame, command, parameters)
    item = Item(word, frame, command, parameters, *degrees, height)
    if _text(item, first) != text:
        raise MissionFormatError("is not written as showc writes it")
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0 and abs(height) < 1e5):
        raise MissionFormatError("names a place that is nowhere on the globe")
    if frame == MISSION and (*degrees, height) != (0, 0, 0.0):
        raise MissionFormatError("names a place, and its command has none")
    if word == "T" and not 0.0 < height <= GREATEST_TAKEOFF + 0.002:
        raise MissionFormatError(
            f"takes off to {height:g} m; more than {GREATEST_TAKEOFF:g} m is not known"
        )
    if frame == RELATIVE and not _stored(height):
        raise MissionFormatError(f"height {height:.3f} m is not a stored one")
    return item


def _word(
    frame: int, command: int, parameters: tuple[float, float, float, float]
) -> str:
    """Return the letter of a row; the place aside."""
    for word, (own_frame, own_command, allowed) in WORDS.items():
        if (frame, command) == (own_frame, own_command) and all(
            value in one if isinstance(one, range) else one[0] <= value <= one[1]
            for value, one in zip(parameters, allowed, strict=True)
        ):
            return word
    name = _NAMES.get(command, f"command {command}")
    numbers = ", ".join(f"{value:g}" for value in parameters)
    raise MissionFormatError(
        f"{name} in frame {frame} with parameters {numbers} is nothing that showc "
        "writes"
    )


def _stored(height: float) -> bool:
    """Whether a height stands 2 mm further from zero than a whole centimetre."""
    centimetres = round(abs(height) * 100.0 - 0.2)
    wanted = 0.01 * centimetres + 0.002 if centimetres else 0.0
    return abs(abs(height) - wanted) < 1e-6


def _text(item: Item, first: bool) -> str:  # noqa: FBT001 - which of two rows
    """Write a row, without its number, as showc writes it."""
    numbers = [
        # Zero has no sign.
        f"{one + 0.0:.{DECIMALS}f}".rstrip("0").rstrip(".")
        for one in item.parameters
    ]
    places = [_degrees(item.latitude), _degrees(item.longitude), f"{item.height:.3f}"]
    # The last field: go on with the next row.
    row = [int(first), item.frame, item.command, *numbers, *places, 1]
    return "\t".join(map(str, row))


def _degrees(value: int) -> str:
    whole, part = divmod(abs(value), 10**7)
    return f"{'-' if value < 0 else ''}{whole}.{part:07d}0"
