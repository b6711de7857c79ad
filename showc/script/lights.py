"""Lights: colours at moments of a hold, from the script or a table."""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING

import numpy as np

from showc.script.colours import linear_light
from showc.script.formation_fields import COLOUR
from showc.script.formations.csv_file import MAX_LINES
from showc.script.formations.shape import FormationError
from showc.script.instants import InstantError, music_time
from showc.script.kinds import (
    Choice,
    Either,
    Field,
    File,
    Items,
    Quantity,
    Section,
    Time,
)
from showc.script.placing import paint
from showc.script.settings import Settings
from showc.script.show import LightKey

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.script.files import InputFiles
    from showc.script.reader import Reader
    from showc.script.show import Formation, Music

LIGHT = Section(
    "light",
    "Colours at one moment of a hold. Between moments they change evenly in light.",
    (
        Field(
            "after",
            Quantity("s", minimum=0.0, maximum=3600.0),
            "Time since the formation stands.",
        ),
        Field(
            "at",
            Time(),
            "Time of the show or of the music; what lies before the hold has happened "
            "when it begins.",
            examples=("bar 13", "@drop"),
        ),
        Field("colour", COLOUR, "Colours of the places from there on.", required=True),
        Field(
            "fade",
            Choice(("linear", "end")),
            "`linear` changes evenly since the moment before, `end` at the moment "
            "itself.",
            default="linear",
        ),
    ),
    one_of=("after", "at"),
)
LIGHTS = Either((File((".csv", ".tsv", ".txt")), Items(LIGHT, 1, 1000)))
"""A table with the columns time, place, red, green, blue; or moments."""
_COLUMNS = ("time", "place", "red", "green", "blue")
_SHORT = {"r": "red", "g": "green", "b": "blue", "t": "time", "drone": "place"}
_LONGEST = 3600.0
"""Latest moment of a table [s]."""
_MOST = 3_000_000
"""Moments times places of one hold: an hour of steps for a thousand."""


def lights_of(
    settings: Settings,
    formation: Formation,
    music: Music | None,
    files: InputFiles,
    reader: Reader,
) -> tuple[LightKey, ...]:
    """Return the moments of a transition's hold, in the order written.

    Parameters
    ----------
    settings
        Of the transition.
    formation
        What is held.
    music
        What times count in.
    files
        Where a table is read.
    reader
        Takes the findings.
    """
    if "lights" not in settings:
        return ()
    given = settings.values["lights"]
    if isinstance(given.value, str):
        try:
            content = files.read(given.value, "lights")
            return _table(content, given.value, len(formation.points))
        except FormationError as fault:
            reader.say(fault.code, str(fault), given.mark, help_text=fault.help)
            return ()
    found = []
    for item in settings.items("lights"):
        own = item.value
        if not isinstance(own, Settings) or own.broken:
            continue
        try:
            time, absolute = _moment(own, music)
            colours = linear_light(paint(own.section("colour"), formation.points))
        except InstantError as fault:
            reader.say(fault.code, f"`at`: {fault}", own.mark_of("at"),
                       help_text=fault.help)  # fmt: skip
            continue
        except FormationError as fault:
            reader.say(fault.code, str(fault), own.mark_of("colour"))
            continue
        colours.setflags(write=False)
        found.append(LightKey(time, absolute, colours, own.text("fade") == "end"))
    return tuple(found)


def _moment(settings: Settings, music: Music | None) -> tuple[float, bool]:
    """Return the time of a moment [s], and whether it is one of the show."""
    if "after" in settings:
        return settings.number("after"), False
    offset = 0.0 if music is None else music.offset
    return music_time(settings.instant("at"), music) + offset, True


def _table(content: bytes, name: str, places: int) -> tuple[LightKey, ...]:
    """Read colours of places over time.

    Raises
    ------
    FormationError
        Naming the first faulty line.
    """
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FormationError("SHW110", f"`{name}` is not UTF-8", "lights") from None
    if len(lines) > MAX_LINES:
        raise FormationError(
            "SHW119",
            f"`{name}` has {len(lines)} lines, at most {MAX_LINES} are read",
            "lights",
        )
    separator = max(";\t,", key=lines[0].count if lines else "".count)
    rows = list(csv.reader(lines, delimiter=separator))
    heads = [cell.lower().split("[")[0].strip() for cell in (rows[0] if rows else [])]
    heads = [_SHORT.get(one, one) for one in heads]
    lacking = [one for one in _COLUMNS if one not in heads]
    if lacking:
        raise FormationError(
            "SHW110",
            f"`{name}` has no column {lacking[0]}",
            "lights",
            help_text="the first line names the columns time [s], place (from 1), red, "
            "green and blue (0 to 255)",
        )
    where = [heads.index(one) for one in _COLUMNS]
    values = np.array(
        [
            _row(row, where, f"`{name}`, line {number}", places)
            for number, row in enumerate(rows[1:], start=2)
            if any(cell.strip() for cell in row) and not row[0].startswith("#")
        ]
    ).reshape(-1, len(_COLUMNS))
    return _keys(values, places, name)


def _row(cells: list[str], where: list[int], at: str, places: int) -> list[float]:
    found = []
    for column, key in zip(where, _COLUMNS, strict=True):
        text = cells[column].strip() if column < len(cells) else ""
        low, high = {"time": (0.0, _LONGEST), "place": (1.0, float(places))}.get(
            key, (0.0, 255.0)
        )
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high or (key == "place" and value % 1.0):
            raise FormationError(
                "SHW110",
                f"{at}: {key} is no number from {low:g} to {high:g}",
                "lights",
                help_text="times are seconds since the formation stands, places count "
                "from 1, colours go from 0 to 255",
            )
        found.append(value)
    return found


def _keys(values: FloatArray, places: int, name: str) -> tuple[LightKey, ...]:
    """Return one key for each time, with what is not known yet not a number."""
    times = np.unique(values[:, 0])
    if times.size * places > _MOST:
        raise FormationError(
            "SHW119",
            f"`{name}` has {times.size} times for {places} places, at most {_MOST} "
            "values are read",
            "lights",
        )
    colours = np.full((times.size, places, 3), np.nan)
    own = values[:, 1].astype(int) - 1
    light = linear_light(values[:, 2:] / 255.0)
    colours[np.searchsorted(times, values[:, 0]), own] = light
    for place in np.unique(own):
        known = np.flatnonzero(~np.isnan(colours[:, place, 0]))
        later = np.arange(times.size) >= known[0]
        for channel in range(3):
            colours[later, place, channel] = np.interp(
                times[later], times[known], colours[known, place, channel]
            )
    colours.setflags(write=False)
    return tuple(
        LightKey(float(time), False, one, False)
        for time, one in zip(times, colours, strict=True)
    )
