"""Lights: colours at moments of a hold, from the script or a table."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from showc.script.diagnostic import ScriptError
from showc.script.language.colours import linear_light
from showc.script.language.instants import music_time
from showc.script.language.timed import LONGEST, timed_rows
from showc.script.sections.placing import paint
from showc.script.show import LightKey

if TYPE_CHECKING:
    from showc.arrays import FloatArray
    from showc.script.files import InputFiles
    from showc.script.language.reader import Reader
    from showc.script.language.settings import Settings
    from showc.script.show import Formation, Music

_HELP = (
    "times are seconds since the formation stands, places count from 1, colours go "
    "from 0 to 255"
)
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
            count = len(formation.points)
            rows = timed_rows(content, given.value, "lights", _ranges(count), _HELP)
            return _keys(rows, count, given.value)
        except ScriptError as fault:
            reader.refuse(fault, given.mark)
            return ()
    found = []
    for own in settings.sound("lights"):
        try:
            time, absolute = _moment(own, music)
        except ScriptError as fault:
            reader.refuse(fault.of("`at`"), own.mark_of("at"))
            continue
        try:
            colours = linear_light(paint(own.section("colour"), formation.points))
        except ScriptError as fault:
            reader.refuse(fault, own.mark_of("colour"))
            continue
        if math.isnan(time):
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


def _ranges(places: int) -> dict[str, tuple[float, float]]:
    shares = dict.fromkeys(("red", "green", "blue"), (0.0, 255.0))
    return {"time": (0.0, LONGEST), "place": (1.0, float(places)), **shares}


def _keys(values: FloatArray, places: int, name: str) -> tuple[LightKey, ...]:
    """Return one key for each time, with what is not known yet not a number."""
    times = np.unique(values[:, 0])
    if times.size * places > _MOST:
        raise ScriptError(
            "SHW119",
            f"`{name}` has {times.size} times for {places} places, at most {_MOST} "
            "values are read",
            key="lights",
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
