"""Meaning: what people write, and what they mean by it."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import groupby

from showc.script.diagnostic import Diagnostic
from showc.script.language.document import Entry, Mapping, Node, Scalar, Sequence
from showc.script.language.fields import SECTIONS, resolve
from showc.script.language.kinds import (
    Either,
    Field,
    File,
    Items,
    Quantity,
    Section,
    Table,
    Text,
)
from showc.script.language.quantity import NUMBER, comma_fault
from showc.script.language.scalars import suggestion
from showc.script.language.wording import wanted_text

MEANT = {
    "lat": "latitude",
    "lon": "longitude",
    "lng": "longitude",
    "long": "longitude",
    "alt": "altitude",
    "elevation": "altitude",
    "color": "colour",
    "colors": "colour",
    "center": "centre",
    "position": "centre",
    "at": "centre",
    "offset": "centre",
    "velocity": "speed",
    "move": "shift",
    "translate": "shift",
    "flip": "mirror",
    "time": "duration",
    "wait": "hold",
    "pause": "hold",
    "pace": "prefer",
    "shape": "type",
    "kind": "type",
    "type": "kind",
    "height": "altitude",
    "takeoff": "launch",
    "title": "name",
    "tempo": "bpm",
    "scenes": "transitions",
    "sequence": "transitions",
    "steps": "transitions",
    "moves": "transitions",
    "pictures": "formations",
    "shapes": "formations",
    "spin": "rotate",
    "turn": "rotate",
}
"""Keys as people write them, and how scripts do, where there is such a key."""
_HALF = "write half of it as `radius`"
_HEIGHT = "write `height`; the width follows from it"
_RAISED = "`centre: [0, 0, 30]` puts it 30 m high"
_INSTEAD = {
    "diameter": {"radius": _HALF},
    "size": {"radius": _HALF, "height": _HEIGHT},
    "width": {"height": _HEIGHT},
    "height": {"centre": _RAISED},
    "altitude": {"centre": _RAISED},
    "z": {"centre": _RAISED},
    "speed": {"period": "write the time of one cycle as `period`"},
    "time_signature": {"beats_per_bar": "`beats_per_bar: 4` is a 4/4 bar"},
}
"""Keys as people write them, the key that does the same in another way, and how."""
_AXES = 3
"""Numbers of a place, at most."""
_FEW_KINDS = 3
"""Types that a message proposes at most: more are no help."""


def torn(entry: Entry, node: Mapping) -> Diagnostic | None:
    """Find the value that a key is the rest of.

    A comma tears it in two, as in ``{hold: 2,5 s}`` and ``{at: bar 12, beat 3}``.
    """
    before = node.before(entry)
    value = None if before is None else before.value
    if before is None or not isinstance(value, Scalar):
        return None
    first, behind = value.mark, entry.mark
    if re.fullmatch(r"beat\s+[\d.]+", entry.key) and value.text.startswith("bar"):
        right = f"{value.text} {entry.key}"
        return Diagnostic(
            "SHW103",
            f"`{before.key}`: `{value.text}, {entry.key}` has a comma",
            replace(first, end_line=behind.end_line, end_column=behind.end_column),
            help=f"write `{right}`",
            fix=right,
        )
    # Decimals, and perhaps a unit.
    if not re.fullmatch(r"\d+(\s*[^\d\s].*)?", entry.key):
        return None
    beside = (first.end_line, first.end_column + 1) == (behind.line, behind.column)
    if not beside or not re.fullmatch(r"[-+]?\d+", value.text):
        return None
    fault = comma_fault(f"{value.text},{entry.key}")
    return Diagnostic(
        fault.code,
        f"`{before.key}`: {fault}",
        replace(first, end_line=behind.end_line, end_column=behind.end_column),
        help=fault.help,
        fix=fault.fix,
    )


def spaced(entry: Entry) -> str:
    """Return a key and its value with the space that lacks between them, or nothing.

    YAML takes ``radius:9`` in braces, or one with a no-break space, for a key alone.
    """
    match = re.fullmatch(r"([\w-]+):\s*(\S.*)", entry.key)
    value = entry.value
    alone = isinstance(value, Scalar) and value.plain and not value.text
    if match is None or not alone:
        return ""
    return f"{match.group(1)}: {match.group(2)}"


def about_colours(node: Node) -> str:
    """Say how a list of levels, or of colours, is written."""
    words, written = _numbers_in(node)
    if len(words) == written == 3:
        return "red, green and blue are whole numbers from 0 to 255: `[255, 128, 0]`"
    return "a list of colours, one for each place, is written `{each: [red, white]}`"


def meant(word: str, keys: list[str]) -> bool:
    """Tell whether an unknown key is one of some others, mistyped."""
    colon = word.split(":", maxsplit=1)[0]
    return MEANT.get(word.lower()) in keys or bool(suggestion(colon, keys))


def flat(kind: Items, node: Sequence) -> str:
    """Return a list of lists that was written as one of numbers, or nothing."""
    item = resolve(kind.item)
    texts = [one.text for one in node.items if isinstance(one, Scalar)]
    if not isinstance(item, Items) or len(texts) != len(node.items) or not texts:
        return ""
    numbers = all(re.fullmatch(NUMBER, text) for text in texts)
    width = item.least
    lists = len(texts) // width
    if not numbers or len(texts) % width or not kind.least <= lists <= kind.most:
        return ""
    rows = [", ".join(texts[k : k + width]) for k in range(0, len(texts), width)]
    return f"[{', '.join(f'[{row}]' for row in rows)}]"


def instead_of(key: str, section: str, absent: list[str]) -> str:
    """Say how to write what an unknown key asks for; empty: not known."""
    for other, advice in _INSTEAD.get(key.lower(), {}).items():
        if other in absent:
            return advice
    inner = {"formation": ("transform", "colour"), "transition": ("colour",)}
    for name in inner.get(section, ()):
        if key in SECTIONS[name].one_of:
            listed = f"[{{{key}: …}}]" if name == "transform" else f"{{{key}: …}}"
            return f"it belongs inside `{name}`: `{name}: {listed}`"
    return ""


def about_missing(field: Field) -> str:
    """Say how a required key is written."""
    example = str(field.examples[0]) if field.examples else "…"
    return f"add `{field.key}: {example}` ({wanted_text(field.kind)})"


def about_names(table: Table) -> str:
    """Say how what has names is written."""
    return f"write each {table.what} after its name: `name: …`"


def about_one_of(section: Section) -> str:
    """Say what to do where keys stand together of which there can be one."""
    first, second = section.one_of[:2]
    if len(section.one_of) == len(section.fields):
        return f"put each in its own braces: `{{{first}: …}}, {{{second}: …}}`"
    return "keep one of them"


def about_braces(section: Section, node: Node) -> str:
    """Say how the keys of a section are written."""
    given = node.items if isinstance(node, Sequence) else (node,)
    texts = [one.text for one in given if isinstance(one, Scalar)]
    keys = [field.key for field in section.fields]
    if texts and texts[0] in section.one_of:
        return f"write its value in braces: `{{{texts[0]}: …}}`"
    first = resolve(section.fields[0].kind)
    alone = isinstance(node, Scalar) and not isinstance(first, Section | Text | Items)
    shown = [f"{key}: {text}" for key, text in zip(keys, texts, strict=False)]
    if not texts or not (alone or len(texts) == len(given) == len(keys)):
        shown = [f"{key}: …" for key in (section.one_of or keys)[:2]]
        shown = shown[:1] if section.one_of else shown
    return f"write its keys in braces, or indented below: `{{{', '.join(shown)}}}`"


def about_brackets(kind: Items, node: Node) -> str:
    """Say how a list of one is written, where that is what was meant."""
    item = resolve(kind.item)
    keyed = isinstance(item, Section) and not item.short
    if isinstance(node, Scalar) and re.match(r"-[^\W\d]", node.text):
        return f"put a space after each dash: `- {node.text[1:].split()[0]}`"
    if isinstance(node, Scalar) and isinstance(item, Section) and keyed:
        if node.text in item.one_of:
            return f"a list of one is written `[{{{node.text}: …}}]`"
    elif isinstance(node, Scalar):
        one, more = f"a list of one is written `[{node.text}]`", f"`[{node.text}, …]`"
        return one if kind.least <= 1 else f"a list is written {more}"
    if isinstance(node, Mapping) and isinstance(item, Section | Either):
        keys = ", ".join(f"{entry.key}: …" for entry in list(node)[:2])
        return f"a list of one is written `[{{{keys}}}]`"
    return "a list is written `[…, …]`, or with each element after a dash: `- …`"


def mixed_colour(node: Sequence) -> Node:
    """Return a list of red, green and blue as the text of one colour; others as is."""
    parts = [item.text for item in node.items if isinstance(item, Scalar)]
    numbers = len(parts) == len(node.items) == 3 and all(
        part.isdecimal() for part in parts
    )
    return (
        Scalar(f"rgb({', '.join(parts)})", plain=False, mark=node.mark)
        if numbers
        else node
    )


def whole_values(node: Node) -> Node:
    """Return a collection in which ``rgb(255, 128, 0)`` is one value again.

    In braces and brackets YAML parts it at its commas, as it does a list of numbers
    without brackets.
    """
    if isinstance(node, Sequence):
        items: list[Node] = []
        for item in node.items:
            joined = _continued(items[-1], item) if items else None
            items[-1 if joined else len(items) :] = [joined or item]
        return replace(node, items=tuple(items))
    if not isinstance(node, Mapping):
        return node
    entries: list[Entry] = []
    for entry in node:
        joined = None
        if entries and isinstance(entry.value, Scalar) and not entry.value.text:
            rest = Scalar(entry.key, plain=True, mark=entry.mark)
            joined = _continued(entries[-1].value, rest)
        if joined is not None:
            entries[-1] = replace(entries[-1], value=joined)
        else:
            entries.append(entry)
    return replace(node, entries={one.key: one for one in _listed(entries)})


def _listed(entries: list[Entry]) -> list[Entry]:
    """Return entries in which the numbers of ``centre: 0, 5, 20`` are one value again.

    One number behind a comma may be the decimals of the one before it.
    """
    result: list[Entry] = []
    for rest, run in groupby(entries, _is_number):
        behind = list(run)
        first = result[-1].value if result else None
        if not (rest and len(behind) > 1 and isinstance(first, Scalar)):
            result += behind
            continue
        end = behind[-1].mark
        mark = replace(first.mark, end_line=end.end_line, end_column=end.end_column)
        text = ", ".join([first.text, *(one.key for one in behind)])
        result[-1] = replace(result[-1], value=replace(first, text=text, mark=mark))
    return result


def _is_number(entry: Entry) -> bool:
    """Tell whether a key without a value is a number."""
    empty = isinstance(entry.value, Scalar) and not entry.value.text
    return empty and re.fullmatch(NUMBER, entry.key) is not None


def _continued(first: Node, rest: Node) -> Scalar | None:
    """Return a value in parentheses that goes on after a comma; None if none does."""
    if not (isinstance(first, Scalar) and isinstance(rest, Scalar) and first.plain):
        return None
    if not re.fullmatch(r"(?:rgba?)?\([ \d,.+-]+", first.text) or not rest.plain:
        return None
    if not re.fullmatch(r"[-+]?[\d.]+\)?", rest.text):
        return None
    end = rest.mark
    mark = replace(first.mark, end_line=end.end_line, end_column=end.end_column)
    return replace(first, text=f"{first.text}, {rest.text}", mark=mark)


def _numbers_in(node: Node) -> tuple[list[str], int]:
    """Return the numbers that a value's words are, and of how many values; or none."""
    items = node.items if isinstance(node, Sequence) else (node,)
    written = [item for item in items if isinstance(item, Scalar)]
    parts = [re.sub("[,;()]", " ", item.text) for item in written]
    words = [word for part in parts for word in part.split()]
    sound = all(re.fullmatch(NUMBER, word) for word in words)
    return (words if sound else []), len(written)


def with_commas(kind: Items, node: Node) -> str:
    """Return a list with the commas that it lacks, where that is what went wrong."""
    words, written = _numbers_in(node)
    if len(words) > written and kind.least <= len(words) <= kind.most:
        return f"[{', '.join(words)}]"
    return ""


def about_commas(kind: Items, node: Node) -> str:
    """Say how numbers are separated, where that is what went wrong."""
    if mended := with_commas(kind, node):
        return f"separate with commas: `{mended}`"
    words, _ = _numbers_in(node)
    if len(words) > kind.most:
        return "commas separate elements; write decimals with a point: `[1.5, 0, 20]`"
    item, size = resolve(kind.item), kind.most
    if isinstance(item, Quantity) and kind.least == size <= _AXES and item.unit == "m":
        return f"write `[{', '.join('xyz'[:size])}]`"
    return ""


def about_variants(section: Section, node: Mapping) -> str:
    """Say which types the given keys belong to; empty: none, or more than three."""
    shared = {field.key for field in section.fields}
    own = [entry.key for entry in node if entry.key not in shared]
    kinds = [
        f"`{section.tag}: {variant.name}`"
        for variant in section.variants
        if own
        and all(
            _takes(variant.field(entry.key), entry.value)
            for entry in node
            if entry.key in own
        )
    ]
    if not kinds or len(kinds) > _FEW_KINDS:
        return ""
    keys = " and ".join(f"`{key}`" for key in own)
    return f"add {' or '.join(kinds)}, which can have {keys}"


def _takes(field: Field | None, node: Node) -> bool:
    """Tell whether a key of a type takes a value; of files only the ending counts."""
    kind = None if field is None else field.kind
    if not isinstance(kind, File) or not isinstance(node, Scalar):
        return field is not None
    return node.text.lower().endswith(kind.suffixes)
