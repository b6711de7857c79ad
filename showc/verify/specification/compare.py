"""Differences of two messages, field by field, in words."""

from __future__ import annotations

import math
from itertools import islice
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from google.protobuf.message import Message

TOLERANCE = 1e-9
"""How far two numbers may differ, as a fraction of their size and never less than of 1:
another library of mathematics may have worked the places of a formation out."""

_MOST = 5
"""Differences that are named."""


def same(found: float, wanted: float) -> bool:
    """Whether two numbers are one but for rounding."""
    return bool(abs(found - wanted) <= TOLERANCE * max(1.0, abs(wanted)))


def differences(found: Message, wanted: Message) -> tuple[str, ...]:
    """Return what differs, at most a few lines; empty if nothing does."""
    if found == wanted:
        return ()
    lines = list(islice(_differences(found, wanted, ""), _MOST))
    return tuple(lines) or _unknown(found, wanted)


def _unknown(found: Message, wanted: Message) -> tuple[str, ...]:
    """Numbers that differ by rounding are fine; fields that are not known are not."""
    known = type(found)()
    known.CopyFrom(found)
    known.DiscardUnknownFields()
    if known.ByteSize() != found.ByteSize():
        return (f"{wanted.DESCRIPTOR.name} holds fields that are not known",)
    return ()


def _differences(found: Message, wanted: Message, path: str) -> Iterator[str]:
    for field in wanted.DESCRIPTOR.fields:
        where = f"{path}{field.name}"
        one, other = getattr(found, field.name), getattr(wanted, field.name)
        if field.is_repeated:
            if len(one) != len(other):
                yield f"{where}: the log has {len(one)}, the script {len(other)}"
                continue
            pairs = [
                (f"{where}[{at}]", *pair)
                for at, pair in enumerate(zip(one, other, strict=True))
            ]
        else:
            pairs = [(where, one, other)]
        for name, left, right in pairs:
            if field.message_type is not None:
                yield from _differences(left, right, f"{name}.")
            elif not _equal(left, right):
                yield f"{name}: the log says {left!r}, the script {right!r}"


def _equal(found: Any, wanted: Any) -> bool:  # noqa: ANN401 - whatever a field holds
    if isinstance(wanted, float):
        return math.isfinite(found) and same(found, wanted)
    return bool(found == wanted)
