"""Music: the section of that name, and the times that transitions ask for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from showc.script.diagnostic import ScriptError
from showc.script.language.instants import music_time, read_cues
from showc.script.language.settings import Settings
from showc.script.show import Music

if TYPE_CHECKING:
    from showc.script.files import InputFiles
    from showc.script.language.instants import Instant
    from showc.script.language.reader import Reader
    from showc.script.mark import Mark


def music_of(settings: Settings, files: InputFiles, reader: Reader) -> Music | None:
    """Return the music of a script, as far as it is sound; None if it names none.

    Parameters
    ----------
    settings
        The whole script.
    files
        Where the recording and the cues are read.
    reader
        Takes the findings.
    """
    if "music" not in settings:
        return None
    section = settings.section("music")
    if section.broken:
        return Music(None, 0.0, None, 4, 0.0, {}, sound=False)
    file = section.word("file")
    cues: dict[str, float] = {}
    music = Music(
        file,
        section.number("offset"),
        section.optional("bpm"),
        section.integer("beats_per_bar"),
        section.number("first_beat"),
        cues,
    )
    try:
        if file is not None:
            files.read(file, "file")
    except ScriptError as fault:
        reader.refuse(fault, section.mark_of("file"))
    found = _cues(section, files, reader)
    if found is None:
        return replace(music, sound=False)
    waiting = {name: (instant, mark) for name, instant, mark in found}
    while waiting:
        # A cue may count from another, wherever that stands.
        name = next(
            (one for one, (at, _) in waiting.items() if at.cue not in waiting), ""
        )
        if not name:
            cues |= dict.fromkeys(waiting, math.nan)
            reader.say(
                "SHW107",
                f"the cues {', '.join(f'`{one}`' for one in waiting)} count from each "
                "other in a circle",
                next(iter(waiting.values()))[1],
                help_text="give one of them a time of its own",
            )
            break
        instant, mark = waiting.pop(name)
        try:
            cues[name] = music_time(instant, music)
        except ScriptError as fault:
            cues[name] = math.nan  # said once, here
            reader.refuse(fault.of(f"cue `{name}`"), mark)
    return music


def _cues(
    section: Settings, files: InputFiles, reader: Reader
) -> list[tuple[str, Instant, Mark]] | None:
    """Names and times of cues, and where each is written; None if not to be read."""
    mark = section.mark_of("cues")
    given = section.values["cues"].value
    if isinstance(given, Settings):
        return [
            (name, given.instant(name), setting.mark)
            for name, setting in given.values.items()
            if setting.value is not None
        ]
    name = section.text("cues")
    try:
        found = read_cues(files.read(name, "cues"), name)
    except ScriptError as fault:
        reader.refuse(fault, mark)
        return None
    return [(cue, instant, mark) for cue, instant in found]


LATEST = 86_400.0
"""Latest time that a transition may ask for [s]: a day, which no battery lasts."""


def asked_time(
    settings: Settings, key: str, music: Music | None, reader: Reader
) -> float | None:
    """Return the show time that a key of a transition asks for [s].

    None where there is no such key, or it cannot be worked out, which ``reader`` hears.
    Times are whole milliseconds: beats fall between them, by half of one at most.
    """
    if key not in settings:
        return None
    mark = settings.mark_of(key)
    try:
        time = music_time(settings.instant(key), music)
    except ScriptError as fault:
        reader.refuse(fault.of(f"`{key}`"), mark)
        return None
    if math.isnan(time):
        return None
    if time > LATEST:
        reader.say(
            "SHW104",
            f"`{key}` is {time:g} s; expected at most {LATEST:g} s after take-off",
            mark,
        )
        return None
    time = round(time + (music.offset if music is not None else 0.0), 3)
    if time <= 0.0:
        reader.say(
            "SHW104",
            f"`{key}` is {-time:g} s before take-off"
            if time
            else f"`{key}` is the moment of take-off",
            mark,
            help_text="give a later time, or a later music: its `offset` is the time "
            "from take-off to its beginning"
            if music is not None
            else "times count from take-off; give a later one",
        )
        return None
    return time
