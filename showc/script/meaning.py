"""Meaning: what people write, and what they mean by it."""

from __future__ import annotations

import re
from dataclasses import replace

from showc.script.diagnostic import Diagnostic
from showc.script.document import Entry, Mapping, Node, Scalar, Sequence
from showc.script.fields import resolve
from showc.script.kinds import Either, Items, Section
from showc.script.quantity import NUMBER, comma_fault
from showc.script.scalars import suggestion

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
    "time": "duration",
    "wait": "hold",
    "pause": "hold",
    "pace": "prefer",
    "shape": "type",
    "kind": "type",
}
"""Keys as people write them, and how scripts do, where there is such a key."""
_FEW_KINDS = 3
"""Types that a message proposes at most: more are no help."""


def decimal_comma(entry: Entry, node: Mapping) -> Diagnostic | None:
    """Find the number that a key is the decimals of, as in ``{hold: 2,5}``."""
    before = node.before(entry)
    value = None if before is None else before.value
    if before is None or not isinstance(value, Scalar) or not entry.key.isdecimal():
        return None
    first, behind = value.mark, entry.mark
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
    if not isinstance(item, Items) or len(texts) != len(node.items) or kind.least > 1:
        return ""
    numbers = all(re.fullmatch(NUMBER, text) for text in texts)
    if not numbers or not item.least <= len(texts) <= item.most:
        return ""
    return f"[[{', '.join(texts)}]]"


def about_braces(section: Section, node: Node) -> str:
    """Say how the keys of a section are written."""
    word = node.text if isinstance(node, Scalar) else ""
    key = word if word in section.one_of else section.fields[0].key
    return f"its keys stand in braces, or indented below: `{{{key}: …}}`"


def about_brackets(kind: Items, node: Node) -> str:
    """Say how a list of one is written, where that is what was meant."""
    item = resolve(kind.item)
    words = not (isinstance(item, Section) and not item.short)
    if isinstance(node, Scalar) and words:
        one, more = f"a list of one is written `[{node.text}]`", f"`[{node.text}, …]`"
        return one if kind.least <= 1 else f"a list is written {more}"
    if isinstance(node, Mapping) and isinstance(item, Section | Either):
        keys = ", ".join(f"{entry.key}: …" for entry in list(node)[:2])
        return f"a list of one is written `[{{{keys}}}]`"
    return "a list is written `[…, …]`, or each element behind a dash: `- …`"


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


def whole_colours(node: Node) -> Node:
    """Return a collection in which ``rgb(255, 128, 0)`` is one value again.

    In braces and brackets YAML parts it at its commas.
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
    return replace(node, entries={one.key: one for one in entries})


def _continued(first: Node, rest: Node) -> Scalar | None:
    """Return a colour that goes on behind a comma; None if it does not."""
    if not (isinstance(first, Scalar) and isinstance(rest, Scalar) and first.plain):
        return None
    if not re.fullmatch(r"rgba?\([ \d,]+", first.text) or not rest.plain:
        return None
    if not re.fullmatch(r"\d+\)?", rest.text):
        return None
    end = rest.mark
    mark = replace(first.mark, end_line=end.end_line, end_column=end.end_column)
    return replace(first, text=f"{first.text}, {rest.text}", mark=mark)


def _numbers_in(node: Node) -> tuple[list[str], int]:
    """Return the numbers that a value's words are, and of how many values; or none."""
    items = node.items if isinstance(node, Sequence) else (node,)
    written = [item for item in items if isinstance(item, Scalar)]
    words = [word for item in written for word in item.text.replace(",", " ").split()]
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
        return "commas separate elements; a decimal point is a point: `[1.5, 0, 20]`"
    return ""


def about_variants(section: Section, node: Mapping) -> str:
    """Say which types the given keys belong to; empty: none, or more than three."""
    shared = {field.key for field in section.fields}
    own = [entry.key for entry in node if entry.key not in shared]
    kinds = [
        f"`{section.tag}: {variant.name}`"
        for variant in section.variants
        if own and {field.key for field in variant.fields}.issuperset(own)
    ]
    if not kinds or len(kinds) > _FEW_KINDS:
        return ""
    keys = " and ".join(f"`{key}`" for key in own)
    return f"add {' or '.join(kinds)}: {keys} can stand there"
