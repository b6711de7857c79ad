"""Scalars: single values read by their kind."""

from __future__ import annotations

import math
import re
import unicodedata
from contextlib import suppress
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from showc.script.diagnostic import ScriptError
from showc.script.formations import SHAPES
from showc.script.language import kinds
from showc.script.language.colours import COLOUR_NAMES, parse_colour
from showc.script.language.document import Mapping, Scalar
from showc.script.language.instants import Instant, Tempo, parse_instant, parse_length
from showc.script.language.quantity import NUMBER, parse_quantity, units_of
from showc.script.language.wording import form_of, number_text, wanted_text

if TYPE_CHECKING:
    from collections.abc import Iterable

    from showc.script.language.settings import Value

WORDS = {
    "ring": "circle",
    "ball": "sphere",
    "box": "cube",
    "spiral": "helix",
    "square": "grid",
    "rectangle": "grid",
    "row": "line",
    "picture": "image",
    "photo": "image",
    "png": "image",
    "jpg": "image",
    "jpeg": "image",
    "obj": "mesh",
    "stl": "mesh",
    "glb": "mesh",
    "model": "mesh",
    "vertical": "front",
    "upright": "front",
    "xz": "front",
    "flat": "horizontal",
    "xy": "horizontal",
    "yz": "side",
    "blink": "strobe",
    "flash": "strobe",
    "twinkling": "twinkle",
    "breathe": "pulse",
}
"""Words as people write them, and how scripts do, where a choice has such a word."""
_YES_NO = {"yes", "no", "on", "off", "y", "n"}
_TRUTH = {"true": True, "false": False}


_TURNS = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}
"""Kinds of signs that turn the direction of what follows them (Unicode, UAX 9)."""
_LONGEST_WORD = 60
"""Longest name there is [characters]."""
_MOST_NAMES = 300
"""Names compared with a word."""
_SURELY = 0.75
"""How like one a word must be to be sure of it: two letters swapped in four."""
_CLEARLY = 0.1
"""By how much more a word must be like one than like the next, as difflib's ratio
measures it: one letter more of ten in common."""


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return the known word that was probably meant, or an empty text."""
    # Comparing takes long; what is longer than any name is none of them.
    names = list(known)[:_MOST_NAMES]
    if len(word) > _LONGEST_WORD:
        return ""
    lower = {name.lower(): name for name in names}
    if word.lower() in lower:
        return lower[word.lower()]
    near = _near(word, lower)
    return lower[near[0]] if near else ""


def certain(word: str, known: Iterable[str]) -> str:
    """Return the known word that was surely meant: far nearer than any other."""
    names = list(known)[:_MOST_NAMES]
    if len(word) > _LONGEST_WORD:
        return ""
    from difflib import SequenceMatcher  # noqa: PLC0415 - start-up counts

    near = _near(word, [name.lower() for name in names])
    likeness = [SequenceMatcher(None, one, word.lower()).ratio() for one in near]
    if not near or likeness[0] < _SURELY:
        return ""
    if len(near) > 1 and likeness[0] - likeness[1] < _CLEARLY:
        return ""
    return suggestion(word, names)


def no_such(what: str, name: str, known: Iterable[str]) -> ScriptError:
    """Return what is wrong where a script names something that it does not define."""
    names = list(known)
    near, listed = suggestion(name, names), ", ".join(names) or "none"
    shaped = what == "formation" and not near and name in SHAPES
    if shaped:
        listed += f"; for a shape write `{{type: {name}, …}}`"
    return ScriptError(
        "SHW107",
        f"there is no {what} `{name}`",
        help_text=f"did you mean `{near}`?" if near else f"{what}s: {listed}",
        fix=certain(name, names),
    )


def no_word(key: str, word: str, known: Iterable[str], otherwise: str) -> ScriptError:
    """Return what is wrong where a word is none of a choice."""
    names = list(known)
    meant = WORDS.get(word.lower(), "")
    near = meant if meant in names else suggestion(word, names)
    return ScriptError(
        "SHW106",
        f"`{key}` cannot be `{word}`",
        help_text=(f"did you mean `{near}`? " if near else "") + otherwise,
        fix=certain(word, names),
    )


def _near(word: str, lower: Iterable[str]) -> list[str]:
    """Return the words of small letters that are like another, best first."""
    from difflib import get_close_matches  # noqa: PLC0415 - start-up counts

    return get_close_matches(word.lower(), list(lower), n=2, cutoff=0.6)


def tempo_of(script: Mapping) -> Tempo | None:
    """Return the tempo of a script's music, before the script is read; None: none.

    One that cannot be read counts as any other: that is said where it stands.
    """
    from showc.script.language.fields import SECTIONS  # noqa: PLC0415 - fields read these

    entry = script.get("music")
    music = entry.value if entry is not None else None
    if not isinstance(music, Mapping) or music.get("bpm") is None:
        return None
    found = {"bpm": 120.0, "beats_per_bar": 4.0}
    for key in found:
        field, given = SECTIONS["music"].field(key), music.get(key)
        if field is not None and given is not None and isinstance(given.value, Scalar):
            with suppress(ScriptError):
                found[key] = float(str(read_scalar(field.kind, given.value, key)))
    beat = 60.0 / found["bpm"]
    return Tempo(beat, found["beats_per_bar"] * beat)


def read_scalar(  # noqa: C901 - one case a kind
    kind: kinds.Kind, node: Scalar, key: str, tempo: Tempo | None = None
) -> Value:
    """Read a single value.

    Parameters
    ----------
    kind
        What is wanted; not a collection.
    node
        What is written.
    key
        Its key, for the messages.
    tempo
        Of the music; None: there is none.

    Raises
    ------
    ScriptError
        If it is not what is wanted.
    """
    _yes_or_no(kind, node, key)
    _curly(node)
    value: Value = None
    match kind:
        case kinds.Quantity():
            value = _quantity(kind, node, key, tempo)
        case kinds.Integer():
            value = _integer(kind, node, key)
        case kinds.Text():
            value = _text(kind, node, key)
        case kinds.Choice():
            value = _choice(kind, node, key)
        case kinds.Moment():
            value = _moment(kind, node, key)
        case kinds.Time():
            value = _time(node, key)
        case kinds.Paint():
            value = _paint(node)
        case kinds.Flag():
            value = _TRUTH.get(node.text.lower()) if node.plain else None
        case kinds.File() | kinds.Reference():
            value = node.text if node.text.strip() else None
        case _:
            pass
    if value is None:
        raise ScriptError(
            "SHW103", f"`{key}` is {form_of(node)}; expected {wanted_text(kind)}"
        )
    return value


def _yes_or_no(kind: kinds.Kind, node: Scalar, key: str) -> None:
    """Refuse a plain yes, no, on or off, unless it is a word of a choice."""
    if not node.plain or node.text.lower() not in _YES_NO:
        return
    if isinstance(kind, kinds.Choice) and node.text in kind.options:
        return
    if isinstance(kind, kinds.Quantity | kinds.Integer | kinds.Moment | kinds.Time):
        raise ScriptError(
            "SHW103",
            f"`{key}` is `{node.text}`; expected {wanted_text(kind)}",
            help_text="write a number for it, or leave the key out",
        )
    truth = "true" if node.text.lower() in {"yes", "on", "y"} else "false"
    fix = truth if isinstance(kind, kinds.Flag) else f'"{node.text}"'
    raise ScriptError(
        "SHW006",
        f"YAML readers disagree whether `{node.text}` is a truth value or a word",
        help_text=f"write {fix}",
        fix=fix,
    )


def _curly(node: Scalar) -> None:
    """Refuse a text in the quotes of typesetters, which are no quotes to YAML."""
    if node.plain and re.fullmatch("[“”„«»‘’].*[“”«»‘’]", node.text):
        right = f'"{node.text[1:-1]}"'
        raise ScriptError(
            "SHW103",
            f"{node.text} is in typographic quotes, which would be part of the text",
            help_text=f"write `{right}`",
            fix=right,
        )


def _quantity(
    kind: kinds.Quantity, node: Scalar, key: str, tempo: Tempo | None
) -> float:
    try:
        length = parse_length(node.text, tempo) if kind.unit == "s" else None
        written, stored = (
            parse_quantity(node.text, kind.unit, plain=node.plain, store=store)
            if length is None
            else length
            for store in (kind.unit, kind.store)
        )
    except ScriptError as fault:
        raise fault.of(f"`{key}`") from None
    below = kind.minimum is not None and written < kind.minimum
    above = kind.maximum is not None and written > kind.maximum
    if below or above or (kind.positive and written <= 0.0):
        unit = f" {kind.unit}" if kind.unit else ""
        raise ScriptError(
            "SHW104",
            f"`{key}` is {number_text(written)}{unit}; expected {wanted_text(kind)}",
            help_text=_other_unit(kind, node.text.strip()),
        )
    return stored


def _other_unit(kind: kinds.Quantity, text: str) -> str:
    """Say how to write a plain number out of range in another unit; empty: in none."""
    if not re.fullmatch(NUMBER, text) or float(text) == 0.0:
        return ""
    low = -math.inf if kind.minimum is None else kind.minimum
    high = math.inf if kind.maximum is None else kind.maximum
    plain = kind.unit
    for unit in units_of(plain) if plain else ():
        other = parse_quantity(f"{text} {unit}", plain, plain=False, store=plain)
        if low <= other <= high and unit != plain:
            right = f"`{text} {unit}`"
            return f"a plain number is in {plain}; if {unit} is meant, write {right}"
    return ""


def _integer(kind: kinds.Integer, node: Scalar, key: str) -> int:
    try:
        value = parse_quantity(node.text, "", plain=node.plain)
    except ScriptError as fault:
        code = "SHW103" if fault.code == "SHW105" else fault.code
        raise fault.of(f"`{key}`", code) from None
    if not value.is_integer():
        raise ScriptError("SHW103", f"`{key}` is {node.text}; expected a whole number")
    if not kind.minimum <= value <= kind.maximum:
        raise ScriptError(
            "SHW104", f"`{key}` is {number_text(value)}; expected {wanted_text(kind)}"
        )
    return int(value)


def _text(kind: kinds.Text, node: Scalar, key: str) -> str:
    if len(node.text) > kind.max_length:
        raise ScriptError(
            "SHW104",
            f"`{key}` has {len(node.text)} characters; at most {kind.max_length} are "
            "allowed",
        )
    steering = [sign for sign in node.text if _steers(sign)]
    if steering and not (kind.lines and set(steering) == {"\n"}):
        raise ScriptError(
            "SHW103",
            f"`{key}` has the control character U+{ord(steering[0]):04X}; expected "
            "letters that can be printed",
        )
    if kind.pattern and re.fullmatch(kind.pattern, node.text) is None:
        right = _range(node.text)
        sound = right and (right[0] == "[" or re.fullmatch(kind.pattern, right))
        raise ScriptError(
            "SHW103",
            f"`{key}` is `{node.text}`; expected {kind.says}",
            help_text=f"write `{right}`" if sound else "drones are numbered from 1",
            fix=right if sound else "",
        )
    return node.text


def _steers(sign: str) -> bool:
    """Whether a sign moves a terminal's cursor or turns a line's direction round."""
    turns = unicodedata.bidirectional(sign) in _TURNS
    return turns or unicodedata.category(sign) == "Cc"


def _range(text: str) -> str:
    """Return a range or list of numbers as scripts write them; empty: it is none."""
    right = re.sub(r"(?<=\d)\s*(?:\.{2,}|[:\u2010-\u2015]|to)\s*(?=\d)", "-", text)
    if re.fullmatch(r"\d+(?:\s*[,;]\s*\d+)+", right):
        return f"[{', '.join(re.split(r'[^0-9]+', right))}]"
    return right if right != text else ""


def _choice(kind: kinds.Choice, node: Scalar, key: str) -> str:
    if node.text in kind.options:
        return node.text
    words = f"words: {', '.join(kind.options)}"
    raise no_word(key, node.text, kind.options, words)


def _moment(kind: kinds.Moment, node: Scalar, key: str) -> datetime:
    try:
        moment = datetime.fromisoformat(node.text.strip())
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        moment = moment.astimezone(UTC)
    except (ValueError, OverflowError):
        raise ScriptError(
            "SHW103",
            f"`{key}` is `{node.text}`; expected a date and time",
            help_text="write it like 2025-06-01T21:30:00Z",
        ) from None
    if not kind.earliest <= moment.year <= kind.latest:
        raise ScriptError(
            "SHW104",
            f"`{key}` is in the year {moment.year}; a log covers the years "
            f"{kind.earliest} to {kind.latest}",
        )
    return moment


def _time(node: Scalar, key: str) -> Instant:
    try:
        return parse_instant(node.text)
    except ScriptError as fault:
        raise fault.of(f"`{key}`") from None


def _paint(node: Scalar) -> tuple[float, float, float]:
    colour = parse_colour(node.text)
    if colour is None:
        near = suggestion(node.text.strip(), COLOUR_NAMES)
        raise ScriptError(
            "SHW114",
            f"`{node.text}` is not a colour",
            help_text="a rainbow is `effect: rainbow`"
            if node.text.strip().lower() == "rainbow"
            else (f"did you mean `{near}`? " if near else "")
            + 'write a CSS name, `[255, 136, 0]`, or "#ff8800" in quotes',
            fix=certain(node.text.strip(), COLOUR_NAMES),
        )
    return colour
