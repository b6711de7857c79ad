"""Protobuf's wire format, for messages that are too many or too large for objects.

Source: Protocol Buffers documentation, Encoding. Only what showc's own messages need:
variable-length integers, doubles, and runs of doubles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from showc.verify.damage import Damage

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]

_VARINT, _FIXED64, _LENGTH, _FIXED32 = 0, 1, 2, 5


def varint(data: bytes, position: int, stop: int) -> tuple[int, int]:
    """Integer at ``position`` and where the next field begins."""
    if position < stop and data[position] < 0x80:  # most are of one byte
        return data[position], position + 1
    result = shift = 0
    while position < stop and shift < 64:
        byte = data[position]
        position += 1
        result |= (byte & 0x7F) << shift
        if byte < 0x80:
            return result, position
        shift += 7
    raise Damage(position, "a message holds an integer that does not end")


def numbers_and_runs(
    data: bytes, start: int, stop: int
) -> tuple[dict[int, int], dict[int, list[tuple[int, int]]]]:
    """Integers and runs of doubles of the message in ``data[start:stop]``.

    Returns
    -------
    dict, dict
        By field number: the last integer, and where runs of doubles begin and end in
        ``data``, in order.

    Raises
    ------
    Damage
        If the bytes are no such message.
    """
    integers: dict[int, int] = {}
    runs: dict[int, list[tuple[int, int]]] = {}
    position = start
    while position < stop:
        tag, position = varint(data, position, stop)
        number, kind = tag >> 3, tag & 7
        if kind == _VARINT:
            integers[number], position = varint(data, position, stop)
            continue
        if kind == _LENGTH:
            size, position = varint(data, position, stop)
        elif kind == _FIXED64:
            size = 8
        else:
            raise Damage(position, f"a message holds a field of kind {kind}")
        if size > stop - position or size % 8:
            raise Damage(position, "a message holds a run of numbers that is cut")
        runs.setdefault(number, []).append((position, position + size))
        position += size
    return integers, runs


Path = tuple[int, ...]


def layout(data: bytes, fields: dict[Path, str]) -> tuple[dict[str, int], list[int]]:
    """Where the doubles of one message stand, and which bytes say so.

    Parameters
    ----------
    data
        The message.
    fields
        Names of the doubles wanted by their path of field numbers.

    Returns
    -------
    dict
        Offset of each double that is present, by name.
    list
        Offsets of all bytes that are no such double: two messages of one length that
        agree in them have the same layout.
    """
    found: dict[str, int] = {}
    fixed: list[int] = []
    descent = _Descent(data, fields, found, fixed)
    descent.run(0, len(data), ())
    return found, fixed


@dataclass(frozen=True, slots=True)
class _Descent:
    """Goes through a message, and into its parts that hold wanted doubles."""

    data: bytes
    fields: dict[Path, str]
    found: dict[str, int]
    fixed: list[int]

    def run(self, position: int, stop: int, path: Path) -> None:
        while position < stop:
            begin = position
            tag, position = varint(self.data, position, stop)
            here, kind = (*path, tag >> 3), tag & 7
            size = 0
            if kind == _VARINT:
                _, position = varint(self.data, position, stop)
            elif kind == _LENGTH:
                size, position = varint(self.data, position, stop)
            elif kind in {_FIXED64, _FIXED32}:
                size = 8 if kind == _FIXED64 else 4
            else:
                raise Damage(position, f"a message holds a field of kind {kind}")
            if size > stop - position:
                raise Damage(position, "a message holds a field that is cut")
            self.fixed.extend(range(begin, position))
            if kind == _FIXED64 and here in self.fields:
                self.found[self.fields[here]] = position
            elif kind == _LENGTH and self._leads_on(here):
                self.run(position, position + size, here)
            else:
                self.fixed.extend(range(position, position + size))
            position += size

    def _leads_on(self, path: Path) -> bool:
        return any(key[: len(path)] == path for key in self.fields)


def columns(
    data: bytes,
    starts: NDArray[np.int64],
    sizes: NDArray[np.int64],
    fields: dict[Path, str],
) -> dict[str, FloatArray]:
    """Doubles of many messages of one type, decoded without an object for each.

    Messages of equal length and layout are decoded together; where the layout differs
    (a zero is left out, say) in as many groups as there are layouts.

    Parameters
    ----------
    data
        Bytes that hold all messages.
    starts, sizes
        Where each begins and its length, shape (n,).
    fields
        Names of the doubles by their path of field numbers.

    Returns
    -------
    dict
        One array of shape (n,) for each name; absent doubles are zero.
    """
    raw = np.frombuffer(data, dtype=np.uint8)
    result = {name: np.zeros(starts.size) for name in fields.values()}
    for size in np.unique(sizes).tolist():
        rest = np.flatnonzero(sizes == size)
        while rest.size:
            rows = raw[starts[rest][:, None] + np.arange(size)]
            places, fixed = layout(rows[0].tobytes(), fields)
            same = np.all(rows[:, fixed] == rows[0, fixed], axis=1)
            chosen = rows[same]
            for name, place in places.items():
                value = np.ascontiguousarray(chosen[:, place : place + 8])
                result[name][rest[same]] = value.view("<f8")[:, 0]
            rest = rest[~same]
    return result
