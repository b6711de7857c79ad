"""JSON of unknown origin: read within bounds, and compared."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from itertools import chain
from math import isfinite
from typing import TYPE_CHECKING, Any

from showc.errors import DamagedFileError, escaped

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TOLERANCE = 1e-9
"""How far two numbers may differ, as a fraction of their size; in lists never less than
of 1: another library of mathematics may have worked places near zero out [m]."""

MOST_MEMORY = 1 << 28
"""What a parsed document may take [bytes]: twice the longest text of one."""

_PER_CONTAINER, _PER_VALUE = 72, 32
"""What a list and a number in it take at least in memory [bytes]."""

DEEPEST = 100
"""Containers within each other at most: ten times what showc writes. Python's own limit
of 1,000 calls is met at half of it where a document goes to another process."""

_PER_BYTE = 8
"""What one byte of a document that is gathered as it is read may take in memory
[bytes]: numbers in objects with names take five, numbers alone sixteen."""


def parse_json(
    content: bytes,
    name: str,
    gathered: Callable[[dict[str, Any]], dict[str, Any]] | None = None,
) -> Any:  # noqa: ANN401 - any JSON
    """Parse JSON.

    Parameters
    ----------
    content
        The document.
    name
        Of it, for the error.
    gathered
        Makes arrays of the long lists of an object as soon as it is read, so that a
        document never is in memory as objects.

    Raises
    ------
    DamagedFileError
        If it is none, is nested beyond all reason, or would take too much memory.
    """
    needed, most = _memory(content), MOST_MEMORY
    if gathered is not None:
        most = max(most, _PER_BYTE * len(content))
    if needed > most:
        raise DamagedFileError(
            f"{name}: would take {needed >> 20:,} MB of memory as one document; wanted "
            f"at most {most >> 20:,} MB: one file a drone reads well"
        )
    try:
        return json.loads(content, object_hook=gathered)
    except RecursionError:
        raise DamagedFileError(f"{name}: JSON is nested too deeply") from None
    except ValueError as error:
        raise DamagedFileError(f"{name}: is no JSON ({error})") from None


def _memory(content: bytes) -> int:
    """Return what a document takes in memory at least [bytes]."""
    containers = content.count(b"[") + content.count(b"{")
    return _PER_CONTAINER * containers + _PER_VALUE * content.count(b",")


def read_json(content: bytes, most: int) -> Any:  # noqa: ANN401 - JSON
    """Return what a document of at most ``most`` bytes says to all readers alike.

    Raises
    ------
    ValueError
        If it is no JSON, holds a number that is none, or one key twice, has more
        bytes, would take more memory than :data:`MOST_MEMORY`, or is nested deeper than
        :data:`DEEPEST`.
    """
    if len(content) > most:
        raise ValueError(f"it has {len(content):,} bytes")
    # As text, and as the texts in it: one wide letter makes all of them wide.
    needed = _memory(content) + len(content) * (2 if content.isascii() else 8)
    if needed > MOST_MEMORY:
        raise ValueError(f"it would take {needed >> 20:,} MB of memory")

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) != len(pairs):
            raise ValueError("a key stands there twice")
        return found

    def finite(text: str) -> float:
        number = float(text)
        if not isfinite(number):
            raise ValueError(f"{text} is no number")
        return number

    try:
        text = content.decode("utf-8")
        found = json.loads(
            text, parse_constant=finite, parse_float=finite, object_pairs_hook=once
        )
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    level = [found]
    for _ in range(DEEPEST + 1):
        level = [one for one in level if isinstance(one, (dict, list))]
        if not level:
            return found
        both = (one.values() if isinstance(one, dict) else one for one in level)
        level = [*chain.from_iterable(both)]
    raise ValueError("it is nested too deeply")


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
            elif not _identical(found[key], wanted[key]):
                yield from unlike(found[key], wanted[key], f"{path}.{key}", rounding)
    elif isinstance(wanted, list) and isinstance(found, list):
        if len(found) != len(wanted):
            yield f"{path} has {len(found)} entries, not {len(wanted)}"
        both = enumerate(zip(found, wanted, strict=False))
        for at, pair in [(n, pair) for n, pair in both if not _identical(*pair)]:
            yield from unlike(*pair, f"{path}[{at}]", rounding, 1.0)
    elif not _agree(found, wanted, rounding, least):
        said = "a container" if isinstance(found, list | dict) else f"{found!r:.60}"
        yield f"{path} is {said}, not {getattr(wanted, 'pattern', wanted)!r}"


def _identical(found: Any, wanted: Any) -> bool:  # noqa: ANN401 - JSON
    """Whether two values are one, to the types in them; most are, and cost little."""
    if found is wanted:
        return True
    return type(found) is type(wanted) and found == wanted and _alike(found, wanted)


def _alike(found: Any, wanted: Any) -> bool:  # noqa: ANN401 - JSON
    """Whether equal values have equal types in them: True may be a 1."""
    if isinstance(found, dict):
        found, wanted = [*found.values()], [wanted[key] for key in found]
    if not isinstance(found, list):
        return True
    same = [*map(type, found)] == [*map(type, wanted)]
    inner = [n for n, one in enumerate(found) if isinstance(one, (dict, list))]
    return same and all(_alike(found[n], wanted[n]) for n in inner)


def _agree(found: Any, wanted: Any, rounding: float, least: float) -> bool:  # noqa: ANN401
    """Whether two values, not both containers, are one but for rounding."""
    if _identical(found, wanted):
        return True
    if isinstance(wanted, re.Pattern):
        return isinstance(found, str) and wanted.fullmatch(found) is not None
    # True is no 1 here; 1 and 1.0 are one number, and whole ones may be huge.
    if {type(found), type(wanted)} <= {int, float}:
        with suppress(OverflowError):
            return bool(abs(found - wanted) <= rounding * max(least, abs(wanted)))
    return False


def figures(value: float, digits: int) -> str:
    """Return a number with up to ``digits`` significant digits; whole ones in full."""
    if not isfinite(value):
        return "unbounded"
    if float(value).is_integer() and abs(value) < 1e9:
        return f"{int(value)}"
    return f"{value:.{digits}g}"


def plain(value: Any) -> Any:  # noqa: ANN401 - whatever there is
    """Value that JSON can hold: texts printable, numbers finite or None."""
    if isinstance(value, str):
        return escaped(value)
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(one) for one in value]
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
