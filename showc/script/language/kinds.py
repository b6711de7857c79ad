"""Kinds of values in the field table: what a key of the script may hold.

A kind is plain data. The reader, the schema and the reference each walk the same
table, so what an editor accepts, what the documents say and what showc accepts are
one thing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number, or a text with a unit."""

    unit: str = ""
    """Unit of plain numbers; empty: without dimension."""
    minimum: float | None = None
    """Least value, in ``unit``."""
    maximum: float | None = None
    """Greatest value, in ``unit``."""
    positive: bool = False
    """Whether zero is refused too (``minimum`` is then 0)."""
    store: str = ""
    """Unit of the value handed on; empty: SI."""


@dataclass(frozen=True, slots=True)
class Integer:
    """A whole number."""

    minimum: int = 0
    maximum: int = 1_000_000


@dataclass(frozen=True, slots=True)
class Text:
    """A text."""

    max_length: int = 200
    pattern: str = ""
    """Regular expression of the whole text; empty: any."""
    says: str = ""
    """The pattern in words."""
    lines: bool = False
    """Whether it may have several lines."""


@dataclass(frozen=True, slots=True)
class Choice:
    """One of a few words."""

    options: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Flag:
    """``true`` or ``false``."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A date and time of day, ISO 8601; without an offset it is UTC."""

    earliest: int = 1970
    """First year: a log counts from its beginning."""
    latest: int = 2200
    """Last year: 64 bits of nanoseconds end in 2262."""


@dataclass(frozen=True, slots=True)
class Time:
    """A time in the show or its music: seconds, time code, bar, beat or cue."""


@dataclass(frozen=True, slots=True)
class Paint:
    """A colour: a CSS name or hexadecimal."""


@dataclass(frozen=True, slots=True)
class File:
    """A file, relative to the script's folder."""

    suffixes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Reference:
    """The name of something the script defines."""

    to: Literal["formation", "group"]


@dataclass(frozen=True, slots=True)
class Items:
    """A list."""

    item: Kind
    least: int = 1
    most: int = 100_000


@dataclass(frozen=True, slots=True)
class Section:
    """A mapping with known keys."""

    name: str
    """For messages and the schema's definitions."""
    description: str
    fields: tuple[Field, ...]
    one_of: tuple[str, ...] = ()
    """Keys of which exactly one is given."""
    short: str = ""
    """Key that a bare value stands for; empty: only a mapping will do."""
    tag: str = ""
    """Key whose word adds the keys of a variant; empty: no variants."""
    variants: tuple[Section, ...] = ()
    """Sections by whose names the tag chooses."""

    def variant(self, word: str) -> Section | None:
        """Return the variant of a word of the tag, if there is one."""
        return next((item for item in self.variants if item.name == word), None)

    def field(self, key: str) -> Field | None:
        """Return the field of a key, if there is one."""
        return next((field for field in self.fields if field.key == key), None)


@dataclass(frozen=True, slots=True)
class Table:
    """A mapping whose keys are names the author chooses."""

    item: Kind
    what: str
    """What the keys name."""
    most: int = 2000
    """Entries at most: twice as many as there are transitions to fly to them."""


@dataclass(frozen=True, slots=True)
class Either:
    """One of several kinds, each known by its form."""

    options: tuple[Kind, ...]


@dataclass(frozen=True, slots=True)
class Named:
    """A section by name, where a section holds others of its own kind."""

    name: str


Kind = (
    Quantity
    | Integer
    | Text
    | Choice
    | Flag
    | Moment
    | Time
    | Paint
    | File
    | Reference
    | Items
    | Section
    | Table
    | Either
    | Named
)

Plain = None | bool | int | float | str | list["Plain"] | dict[str, "Plain"]
"""A value as YAML or JSON writes it."""


@dataclass(frozen=True, slots=True)
class Field:
    """One key of a section."""

    key: str
    kind: Kind
    description: str
    """One or two sentences; the first says what it is."""
    default: Plain = None
    """What holds when the key is missing, as a script would write it."""
    default_text: str = ""
    """The default in words, where it is not one fixed value."""
    required: bool = False
    examples: tuple[Plain, ...] = ()


NAME = Text(60, r"[A-Za-z_][A-Za-z0-9_-]*", "a letter, then letters, digits, - and _")
"""What formations and groups are called."""
