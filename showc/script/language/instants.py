"""Instants: times as choreographers write them, and the music they count from.

A time is seconds (``24.5``, ``1 min``), minutes and seconds (``01:20.5``), a time code
of SMPTE ST 12-1 (``00:01:20:12@25``, ``00:01:20;12@29.97``), a bar or a beat counted
from 1 (``bar 12``, ``bar 12 beat 3``, ``beat 3.5``), or a cue (``@chorus``). A length
may be added: ``@chorus + 2 beats``, ``bar 9 - 0.5 s``. A length is seconds, minutes and
seconds, a time code, or ``2 bars``, ``3 beats``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from showc.script.diagnostic import ScriptError
from showc.script.language.quantity import NUMBER, parse_quantity

if TYPE_CHECKING:
    from collections.abc import Mapping

    from showc.script.show import Music

Base = Literal["seconds", "bar", "beat", "cue"]

FORMS = (
    "write it like `24.5`, `01:20.5`, `00:01:20:12@25`, `bar 12`, `beat 3.5` or "
    '`"@chorus"`'
)
"""Advice where a time cannot be read."""

LENGTHS = "write it like `4.5`, `800 ms`, `00:04.5`, `2 bars` or `3 beats`"
"""Advice where a length is wanted."""

RATES = {"24": 24, "25": 25, "30": 30, "50": 50, "60": 60}
"""Frames per second of time codes that count every frame."""
DROP = "29.97"
"""The rate of drop-frame time code, 30000/1001 frames per second."""

_LONGEST = 120
"""Longest text that is looked at [characters]."""
_CLOCK = re.compile(r"(?:(\d{1,2}):)?(\d{1,3}):([0-5]?\d(?:\.\d+)?)")
_CODE = re.compile(r"(\d\d):([0-5]\d):([0-5]\d)([:;])(\d\d)(?:@([\d.]+))?")
_BAR = re.compile(rf"bar\s+({NUMBER})(?:\s+beat\s+({NUMBER}))?")
_BEAT = re.compile(rf"beat\s+({NUMBER})")
_CUE = re.compile(r"@\s*([^\W\d][\w-]*)")
_COUNTED = re.compile(r"(bar|beat)\s*-\s*\d+")
_RUN = re.compile(rf"(bars?|beats?)\s*({NUMBER})")
"""A bar or a beat without the space, or in the plural."""
_SHIFTED = re.compile(r"(?!(?:bar|beat)\s+[+-])(.*[\w\s])\s([+-])\s*(\S.*)")
LENGTH = rf"({NUMBER})\s*(beats?|bars?)"
"""A length that the tempo measures (a regular expression)."""
_LENGTH = re.compile(LENGTH)


@dataclass(frozen=True, slots=True)
class Instant:
    """A time as written: what it counts from is known later."""

    text: str
    """As the script has it."""
    base: Base
    """What it counts."""
    value: float = 0.0
    """Seconds [s], or the number of the bar or beat from 1."""
    beat: float = 1.0
    """Beat of the bar, from 1."""
    cue: str = ""
    """Name of the cue."""
    shift: float = 0.0
    """What is added, in ``unit``."""
    unit: Literal["s", "beats", "bars"] = "s"
    """Unit of ``shift``."""

    @property
    def musical(self) -> bool:
        """Whether the tempo of the music is needed."""
        return self.base in {"bar", "beat"} or (self.unit != "s" and self.shift != 0.0)

    @property
    def needs_music(self) -> bool:
        """Whether the tempo or a cue of the music is needed."""
        return self.musical or self.base == "cue"


@dataclass(frozen=True, slots=True)
class Tempo:
    """How long the parts of the music take."""

    beat: float
    """[s]."""
    bar: float
    """[s]."""


def parse_length(text: str, tempo: Tempo | None) -> float | None:
    """Read a length of time that is no quantity [s]; None if it may be one.

    Raises
    ------
    ScriptError
        If it counts beats and there is no tempo, or is a time and no length.
    """
    whole = text.strip()[:_LONGEST]
    match = _LENGTH.fullmatch(whole)
    if match is None:
        if _BAR.fullmatch(whole) or _BEAT.fullmatch(whole) or _CUE.fullmatch(whole):
            raise _no_length(whole)
        return _clocked(whole)
    if tempo is None:
        raise _no_tempo(whole)
    return float(match.group(1)) * (
        tempo.bar if "bar" in match.group(2) else tempo.beat
    )


def _no_length(text: str) -> ScriptError:
    why = f"`{text}` is a point in time; expected a length of time"
    return ScriptError("SHW103", why, help_text=LENGTHS)


def _no_tempo(text: str) -> ScriptError:
    return ScriptError(
        "SHW121",
        f"`{text}` counts beats, but the music has no tempo",
        help_text="add `music: {bpm: 120}`",
    )


def parse_instant(text: str) -> Instant:
    """Read a time.

    Raises
    ------
    ScriptError
        If it is none; the message says why.
    """
    whole = text.strip()
    if len(whole) > _LONGEST:
        raise ScriptError(
            "SHW103", f"{len(whole)} characters are not a time", help_text=FORMS
        )
    head, shift, unit = whole, 0.0, "s"
    match = _SHIFTED.fullmatch(whole)
    if match is not None:
        head = match.group(1).strip()
        shift, unit = _length(match.group(3).strip())
        shift = -shift if match.group(2) == "-" else shift
    base, value, beat, cue = _term(head)
    checked: Literal["s", "beats", "bars"] = (
        "beats" if unit == "beats" else "bars" if unit == "bars" else "s"
    )
    return Instant(whole, base, value, beat, cue, shift, checked)


def _length(text: str) -> tuple[float, str]:
    match = _LENGTH.fullmatch(text)
    if match is not None:
        return float(match.group(1)), "bars" if "bar" in match.group(2) else "beats"
    if _BAR.fullmatch(text) or _BEAT.fullmatch(text):
        raise _no_length(text)
    clocked = _clocked(text)
    return (_seconds(text) if clocked is None else clocked), "s"


def _seconds(text: str) -> float:
    try:
        return parse_quantity(text, "s", plain=False)
    except ScriptError as fault:
        counted = _LENGTH.fullmatch(text) or _RUN.fullmatch(text)
        if counted is not None:
            number, word = sorted(counted.groups())
            why = f"`{text}` is not a point in time"
            advice = f"write `{word.rstrip('s')} {number}`"
            raise ScriptError("SHW103", why, help_text=advice) from None
        if fault.code == "SHW105" and ":" not in text:
            raise
        said = _COUNTED.fullmatch(text)
        if said is not None:
            why = f"`{text}`: {said.group(1)}s count from 1"
        elif text.startswith("@") and not re.search("[+-]", text):
            why = f"`{text}` is no name of a cue"
            advice = f"write `_` for what is no letter or digit: `@{_name(text)}`"
            raise ScriptError("SHW103", why, help_text=advice) from None
        elif re.fullmatch(r"[\d:;.]+(@[\d.]+)?", text):
            why = f"`{text}` is not a time: minutes and seconds end at 59"
        else:
            why = f"`{text}` is not a time"
        word = _CUE.fullmatch(f"@{text}") and not re.match("bar|beat", text)
        cue = f'a cue is written `"@{text}"`; ' if word else ""
        raise ScriptError("SHW103", why, help_text=cue + FORMS) from None


def _term(text: str) -> tuple[Base, float, float, str]:
    """Return base, value, beat and cue of a time without a shift."""
    clocked = _clocked(text)
    if clocked is not None:
        return "seconds", clocked, 1.0, ""
    match = _BAR.fullmatch(text)
    if match is not None:
        bar, beat = float(match.group(1)), float(match.group(2) or 1.0)
        if not bar.is_integer():
            whole, _, part = match.group(1).partition(".")
            raise ScriptError(
                "SHW103",
                f"`{text}`: a bar is a whole number",
                help_text=f"write the beat separately: `bar {whole} beat {part}`",
            )
        return "bar", bar, beat, ""
    match = _BEAT.fullmatch(text)
    if match is not None:
        return "beat", float(match.group(1)), 1.0, ""
    match = _CUE.fullmatch(text)
    if match is not None:
        return "cue", 0.0, 1.0, match.group(1)
    return "seconds", _seconds(text), 1.0, ""


def _clocked(text: str) -> float | None:
    """Seconds of minutes and seconds, or of a time code; None if it is neither."""
    match = _CODE.fullmatch(text)
    if match is not None:
        return _time_code(match)
    match = _CLOCK.fullmatch(text)
    if match is None:
        return None
    hours, minutes, seconds = match.groups()
    if hours is not None and int(minutes) > 59:
        why = f"`{text}` is not a time: minutes and seconds end at 59"
        raise ScriptError("SHW103", why, help_text=FORMS)
    return 3600.0 * int(hours or 0) + 60.0 * int(minutes) + float(seconds)


def _time_code(match: re.Match[str]) -> float:
    """Seconds of a time code; drop-frame ones leave out two numbers a minute.

    At the start of each minute that is no multiple of ten the numbers 0 and 1 are left
    out (SMPTE ST 12-1). So the count keeps up with 30000/1001 frames per second.
    """
    hours, minutes, seconds, frames = (int(match.group(at)) for at in (1, 2, 3, 5))
    rate = match.group(6)
    count = 3600 * hours + 60 * minutes + seconds
    if match.group(4) == ";":
        if rate not in {None, DROP}:
            raise ScriptError(
                "SHW103",
                f"`{match.group()}`: a `;` is drop-frame time code, which runs at "
                f"{DROP} frames per second",
                help_text=f"write `@{DROP}`, or `:` before the frames",
            )
        whole = 60 * hours + minutes
        if frames >= 30 or (frames < 2 and seconds == 0 and minutes % 10):
            raise ScriptError(
                "SHW103",
                f"`{match.group()}`: there is no such frame",
                help_text="frames go from 0 to 29; a minute begins with frame 2, "
                "unless it is a multiple of ten",
            )
        number = 30 * count + frames - 2 * (whole - whole // 10)
        return number * 1001.0 / 30000.0
    if rate not in RATES:
        known = ", ".join(f"`@{one}`" for one in RATES)
        raise ScriptError(
            "SHW103",
            f"`{match.group()}`: a time code needs its frame rate",
            help_text=f"end it with one of {known}, or write `00:01:20;12@{DROP}`",
        )
    if frames >= RATES[rate]:
        raise ScriptError(
            "SHW103",
            f"`{match.group()}`: frames go from 0 to {RATES[rate] - 1}",
            help_text=FORMS,
        )
    return count + frames / RATES[rate]


def music_time(instant: Instant, music: Music | None) -> float:
    """Return the time of the music that an instant stands for [s].

    Parameters
    ----------
    instant
        As written.
    music
        Its tempo and cues; None: there is none, and only seconds can be meant.

    Returns
    -------
    float
        Not a number where the music that it needs could not be read.

    Raises
    ------
    ScriptError
        If it needs a tempo or a cue that is not there.
    """
    if music is not None and not music.sound and instant.needs_music:
        return math.nan
    if instant.musical and (music is None or music.bpm is None):
        raise _no_tempo(instant.text)
    if music is not None and not 1.0 <= instant.beat < music.beats_per_bar + 1:
        raise ScriptError(
            "SHW103",
            f"`{instant.text}`: the beats of a bar are 1 to {music.beats_per_bar}",
            help_text="count in the next bar, or change `beats_per_bar`",
        )
    beat = 60.0 / music.bpm if music is not None and music.bpm is not None else 0.0
    bar = beat * (music.beats_per_bar if music is not None else 0)
    first = music.first_beat if music is not None else 0.0
    match instant.base:
        case "bar":
            time = first + (instant.value - 1.0) * bar + (instant.beat - 1.0) * beat
        case "beat":
            time = first + (instant.value - 1.0) * beat
        case "cue":
            time = _cue(instant.cue, {} if music is None else music.cues)
        case _:
            time = instant.value
    return time + instant.shift * {"s": 1.0, "beats": beat, "bars": bar}[instant.unit]


def _cue(name: str, cues: Mapping[str, float]) -> float:
    if name in cues:
        return cues[name]
    alike = [known for known in cues if known.lower() == name.lower()]
    if len(alike) == 1:
        return cues[alike[0]]
    from showc.script.language.scalars import suggestion  # noqa: PLC0415 - scalars read these

    near = suggestion(name, cues)
    shown = ", ".join(list(cues)[:12]) or "none"
    raise ScriptError(
        "SHW107",
        f"there is no cue `{name}`",
        help_text=f"did you mean `@{near}`?" if near else f"cues: {shown}",
    )


def read_cues(content: bytes, name: str) -> list[tuple[str, Instant]]:
    """Read names and times of cues from a file.

    Audacity's labels (start, end and name, with tabs), Reaper's list of markers and
    regions (a CSV with the columns Name and Start), and any CSV with a name and a time
    in each line, in either order.

    Raises
    ------
    ScriptError
        If a line has no name or no time; the message names it.
    """
    import csv  # noqa: PLC0415 - start-up counts

    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ScriptError("SHW110", f"`{name}` is not UTF-8 text") from None
    lines = text.splitlines()
    if any("\t" in line for line in lines[:1]):
        rows = [line.split("\t") for line in lines]
    else:
        delimiter = ";" if lines and ";" in lines[0] else ","
        rows = list(csv.reader(lines, delimiter=delimiter))
    found: list[tuple[str, Instant]] = []
    taken: dict[str, int] = {}
    columns: tuple[int, int] | None = None
    for number, row in enumerate(rows, start=1):
        cells = [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("\\"):
            continue  # Audacity's second line of a label holds its frequencies
        if columns is None:
            columns, header = _columns(cells)
            if header:
                continue
        found.append(_row(cells, columns, taken, f"`{name}`, line {number}"))
    if not found:
        raise ScriptError("SHW110", f"`{name}` has no cues")
    return found


def _columns(cells: list[str]) -> tuple[tuple[int, int], bool]:
    """Return the columns of name and time, and whether the row is a header."""
    heads = [cell.lower() for cell in cells]
    names = [at for at, cell in enumerate(heads) if cell in {"name", "cue", "label"}]
    times = [at for at, cell in enumerate(heads) if cell in {"start", "time", "at"}]
    if names and times:
        return (names[0], times[0]), True
    if _timed(cells[0]):
        return (2 if len(cells) > 2 and _timed(cells[1]) else 1, 0), False
    return (0, 1), False


def _timed(text: str) -> bool:
    try:
        _file_instant(text)
    except ScriptError:
        return False
    return True


_MEASURE = re.compile(r"(\d+)\.(\d+)\.(\d\d)")
"""Reaper's bars and beats: bar, beat and hundredths of a beat."""


def _file_instant(text: str) -> Instant:
    match = _MEASURE.fullmatch(text)
    if match is not None:
        beat = int(match.group(2)) + int(match.group(3)) / 100.0
        return Instant(text, "bar", float(match.group(1)), beat)
    return parse_instant(text)


def _name(label: str) -> str:
    """Return the name of the cue that a label stands for."""
    name = re.sub(r"\W+", "_", label).strip("_") or "cue"
    return f"cue_{name}" if name[0].isdigit() else name


def _row(
    cells: list[str], columns: tuple[int, int], taken: dict[str, int], where: str
) -> tuple[str, Instant]:
    if len(cells) <= max(columns):
        raise ScriptError("SHW110", f"{where}: expected a name and a time")
    label, written = cells[columns[0]], cells[columns[1]]
    name = _name(label)
    taken[name] = taken.get(name, 0) + 1
    if taken[name] > 1:
        name = f"{name}_{taken[name]}"
    try:
        return name, _file_instant(written)
    except ScriptError as fault:
        raise fault.of(where, "SHW110") from None
