"""Differences of two documents or messages, in words."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from itertools import islice
from typing import TYPE_CHECKING, Any

from google.protobuf.json_format import MessageToDict

from showc.verify.decode import CAPS
from showc.verify.report import NAMED

if TYPE_CHECKING:
    from collections.abc import Iterator

    from google.protobuf.message import Message

TOLERANCE = 1e-9
"""How far two numbers may differ, as a fraction of their size; in lists never less than
of 1: another library of mathematics may have worked places near zero out [m]."""

_MORE = 10_000
"""Bytes beyond twice its own from which a message is not gone into: as text it would
take a hundred times as many."""


def read_json(content: bytes) -> Any:  # noqa: ANN401 - JSON
    """Return what a document says that all readers read alike.

    Raises
    ------
    ValueError
        If it is no JSON, holds a number that is none, or one key twice, or is larger
        than any of showc's.
    """
    if len(content) > CAPS["document"]:
        raise ValueError(f"it has {len(content):,} bytes")

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) != len(pairs):
            raise ValueError("a key stands there twice")
        return found

    def finite(text: str) -> float:
        raise ValueError(f"{text} is no number")

    try:
        text = content.decode("utf-8")
        return json.loads(text, parse_constant=finite, object_pairs_hook=once)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def differences(found: Message, wanted: Message) -> tuple[str, ...]:
    """Return what differs between two messages, at most a few lines."""
    if found.ByteSize() > 2 * wanted.ByteSize() + _MORE:
        return (f"{wanted.DESCRIPTOR.name} says far more than is asked for",)
    ways: dict[str, Any] = {"preserving_proto_field_name": True}
    ways |= {"always_print_fields_with_no_presence": True}
    one, other = (MessageToDict(message, **ways) for message in (found, wanted))
    return tuple(islice(unlike(one, other, wanted.DESCRIPTOR.name), NAMED))


def unlike(
    found: Any,  # noqa: ANN401 - JSON
    wanted: Any,  # noqa: ANN401 - JSON
    path: str,
    rounding: float = TOLERANCE,
    least: float = 0.0,
) -> Iterator[str]:
    """Yield where two JSON values differ, but for the rounding of numbers.

    Where only its form is known, a pattern stands for a text that is wanted. What is
    free is wanted as it was found: however deep it is, it is not gone into.
    """
    if found is wanted:
        return
    if isinstance(wanted, dict) and isinstance(found, dict):
        for key in sorted(wanted.keys() | found.keys()):
            if key not in found or key not in wanted:
                yield f"{path}.{key} {'is missing' if key in wanted else 'is unknown'}"
            else:
                yield from unlike(found[key], wanted[key], f"{path}.{key}", rounding)
    elif isinstance(wanted, list) and isinstance(found, list):
        if len(found) != len(wanted):
            yield f"{path} has {len(found)} entries, not {len(wanted)}"
        for at, pair in enumerate(zip(found, wanted, strict=False)):
            yield from unlike(*pair, f"{path}[{at}]", rounding, 1.0)
    elif not _agree(found, wanted, rounding, least):
        said = "a container" if isinstance(found, list | dict) else f"{found!r:.60}"
        yield f"{path} is {said}, not {getattr(wanted, 'pattern', wanted)!r}"


def _agree(found: Any, wanted: Any, rounding: float, least: float) -> bool:  # noqa: ANN401
    """Whether two values, not both containers, are one but for rounding."""
    if isinstance(wanted, re.Pattern):
        return isinstance(found, str) and wanted.fullmatch(found) is not None
    # True is no 1 here; 1 and 1.0 are one number, and whole ones may be huge.
    if {type(found), type(wanted)} <= {int, float}:
        with suppress(OverflowError):
            return bool(abs(found - wanted) <= rounding * max(least, abs(wanted)))
    return type(found) is type(wanted) and bool(found == wanted)
