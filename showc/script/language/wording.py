"""Wording: kinds, nodes and numbers in the words of messages and documents."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from showc.script.language import kinds
from showc.script.language.document import Mapping, Node, Sequence
from showc.script.language.fields import resolve

if TYPE_CHECKING:
    from collections.abc import Iterable

    from showc.arrays import FloatArray


_LONGEST = 600
"""Longest message [characters]: longer ones repeat what the script says there."""


def number_text(value: float) -> str:
    """Return a number as people write it: six significant digits, no dangling zeros."""
    if value == round(value) and abs(value) < 1e10:
        return str(int(value))
    return f"{value:.6g}"


def measured_text(value: float, limit: float = math.nan) -> str:
    """Return a number that was worked out: four significant digits.

    It has more where its side of a limit would not be seen.
    """
    for digits in (4, 6, 9):
        text = number_text(float(f"{value:.{digits}g}"))
        if math.isnan(limit) or (float(text) < limit) == (value < limit):
            return text
    return number_text(value)


def counted(count: int, what: str) -> str:
    """Return a number of things, as ``1 place`` and ``2 places``."""
    return f"{count} {what}" + "s" * (count != 1)


def point_text(point: FloatArray) -> str:
    """Return a place (3,) [m] as people write it, to a millimetre."""
    return "(" + ", ".join(number_text(round(float(part), 3)) for part in point) + ") m"


def shortened(text: str) -> str:
    """Return a message with its middle left out if it is too long to be read."""
    if len(text) <= _LONGEST:
        return text
    half = _LONGEST // 2
    return f"{text[:half]} … {text[-half:]}"


def words(items: Iterable[str]) -> str:
    """Join words with commas and a last ``or``."""
    names = list(items)
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} or {names[-1]}"


def form_of(node: Node) -> str:
    """Say what a node of the document looks like."""
    if isinstance(node, Mapping):
        return "a mapping"
    if isinstance(node, Sequence):
        return "a list"
    return f"`{node.text}`"


def section_text(name: str) -> str:
    """Say what a section is called."""
    return "the script" if name == "show" else f"`{name}`"


def range_text(kind: kinds.Quantity | kinds.Integer) -> str:
    """Say what range a number has, or nothing."""
    low, high = kind.minimum, kind.maximum
    if isinstance(kind, kinds.Quantity) and kind.positive and low in {0.0, None}:
        start = "above 0"
        return f"{start}, at most {number_text(high)}" if high is not None else start
    if low is not None and high is not None:
        return f"{number_text(low)} to {number_text(high)}"
    if low is not None:
        return f"at least {number_text(low)}"
    return f"at most {number_text(high)}" if high is not None else ""


def wanted_text(kind: kinds.Kind) -> str:  # noqa: C901, PLR0912 - one case a kind
    """Say what a kind wants, with its unit and range."""
    kind = resolve(kind)
    match kind:
        case kinds.Quantity() | kinds.Integer():
            text = _number_text(kind)
        case kinds.Text():
            text = kind.says or "a text"
        case kinds.Choice():
            text = words(f"`{option}`" for option in kind.options)
        case kinds.Flag():
            text = "`true` or `false`"
        case kinds.Moment():
            text = "a date and time"
        case kinds.Time():
            text = "a time"
        case kinds.Paint():
            text = "a colour"
        case kinds.File():
            text = f"a file ({words(kind.suffixes)})"
        case kinds.Reference():
            text = f"the name of a {kind.to}"
        case kinds.Items():
            text = _items_text(kind)
        case kinds.Section():
            named = f"a mapping of {kind.name} keys"
            field = kind.field(kind.short) if kind.short else None
            text = f"{wanted_text(field.kind)} or {named}" if field else named
        case kinds.Table():
            text = f"a mapping of {_several(kind.what)} by name"
        case kinds.Either():
            each = [
                [f"`{word}`" for word in option.options]
                if isinstance(option, kinds.Choice)
                else [wanted_text(option)]
                for option in kind.options
            ]
            text = words(part for parts in each for part in parts)
        case _:
            text = "something else"
    return text


def _several(what: str) -> str:
    """Return a noun in the plural, as ``groups of drones``."""
    noun, space, rest = what.partition(" ")
    return f"{noun}s{space}{rest}"


def _number_text(kind: kinds.Quantity | kinds.Integer) -> str:
    bounds = range_text(kind)
    if isinstance(kind, kinds.Integer):
        return f"a whole number, {bounds}"
    unit = f" in {kind.unit}" if kind.unit else ""
    return f"a number{unit}" + (f", {bounds}" if bounds else "")


def _items_text(kind: kinds.Items) -> str:
    inner = resolve(kind.item)
    if isinstance(inner, kinds.Section):
        of = f"{inner.name}s"
    elif isinstance(inner, kinds.Items):
        of = f"lists of {inner.least} numbers"
    elif isinstance(inner, kinds.Quantity | kinds.Integer):
        of = "numbers" + (
            f" in {inner.unit}"
            if isinstance(inner, kinds.Quantity) and inner.unit
            else ""
        )
    elif isinstance(inner, kinds.Paint):
        of = "colours"
    else:
        of = "elements"
    if kind.least == kind.most:
        return f"a list of {kind.least} {of}"
    if kind.least == 0:
        return f"a list of at most {kind.most} {of}"
    if kind.most >= 1000:
        return f"a list of {of}" + (f", at least {kind.least}" * (kind.least > 1))
    return f"a list of {kind.least} to {kind.most} {of}"
