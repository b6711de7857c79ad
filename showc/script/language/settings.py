"""Settings: the values of a section after reading, each with its place."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from datetime import datetime
from math import hypot
from typing import TYPE_CHECKING, Any, TypeVar

from showc.script.diagnostic import ScriptError
from showc.script.language.instants import Instant

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from showc.script.mark import Mark

    Vector = tuple[float, float, float]

T = TypeVar("T")
Made = TypeVar("Made", bound="DataclassInstance")

Value = object
"""Float, int, str, bool, datetime, :class:`Instant`, list of settings,
:class:`Settings`."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One value."""

    value: Value
    """In the unit its field stores."""
    mark: Mark
    """Where the value stands; the section's place for a default."""
    key_mark: Mark
    """Where its key stands."""
    written: bool = True
    """Whether the script says so, or it is a default."""

    @property
    def plain(self) -> Any:  # noqa: ANN401 - as its kind says
        """The value; of a list a tuple of values, without their places."""
        if not isinstance(self.value, list):
            return self.value
        return tuple(item.plain for item in self.value)


@dataclass(slots=True)
class Settings:
    """Keys and values of one section."""

    name: str
    """Which section."""
    mark: Mark
    """Where it stands."""
    values: dict[str, Setting] = field(default_factory=dict)
    """In the order written, defaults after them."""
    broken: bool = False
    """Whether something in it was refused."""

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def written(self, key: str) -> bool:
        """Tell whether the script itself gives the key."""
        return key in self.values and self.values[key].written

    def mark_of(self, key: str) -> Mark:
        """Return where the value of a key stands, or else the section."""
        return self.values[key].mark if key in self.values else self.mark

    def mark_within(self, key: str) -> Mark:
        """Return where the value of a key stands, in this section or in one inside."""
        inner = [one.value for one in self.values.values()]
        owners = [one for one in inner if isinstance(one, Settings) and key in one]
        return (self if key in self or not owners else owners[0]).mark_of(key)

    def _typed(self, key: str, kind: type[T]) -> T:
        value = self.values[key].value
        if not isinstance(value, kind):
            raise TypeError(f"{self.name}.{key} is {value!r}, expected {kind}")
        return value

    def number(self, key: str) -> float:
        """Return a quantity."""
        return float(self._typed(key, float))

    def optional(self, key: str) -> float | None:
        """Return a quantity, or None if there is none."""
        return self.number(key) if key in self.values else None

    def integer(self, key: str) -> int:
        """Return a whole number."""
        return self._typed(key, int)

    def text(self, key: str) -> str:
        """Return a text."""
        return self._typed(key, str)

    def word(self, key: str) -> str | None:
        """Return a text, or None if there is none."""
        return self.text(key) if key in self.values else None

    def flag(self, key: str) -> bool:
        """Return a truth value."""
        return self._typed(key, bool)

    def moment(self, key: str) -> datetime:
        """Return a date and time."""
        return self._typed(key, datetime)

    def instant(self, key: str) -> Instant:
        """Return a time as written."""
        return self._typed(key, Instant)

    def made(self, kind: type[Made], **given: Any) -> Made:  # noqa: ANN401 - any field
        """Return a dataclass whose fields have the values of the keys of their names.

        Fields without a key take their defaults; ``given`` comes before the keys.
        """
        return kind(**self.named(kind) | given)

    def over(self, base: Made) -> Made:
        """Return a dataclass in which the keys of its fields' names hold instead."""
        return replace(base, **self.named(type(base)))

    def named(self, kind: type[DataclassInstance]) -> dict[str, Any]:
        """Return the values of those keys that a dataclass has fields for."""
        names = [one.name for one in fields(kind) if one.name in self.values]
        return {name: self.values[name].plain for name in names}

    def section(self, key: str) -> Settings:
        """Return the settings of a section within."""
        return self._typed(key, Settings)

    def sections(self, key: str) -> list[Settings]:
        """Return the sections of a list; none where the key is missing."""
        items = self.items(key) if key in self.values else []
        return [item.value for item in items if isinstance(item.value, Settings)]

    def sound(self, key: str) -> list[Settings]:
        """Return those sections of a list that were read whole."""
        return [section for section in self.sections(key) if not section.broken]

    def items(self, key: str) -> list[Setting]:
        """Return the elements of a list."""
        return list(self._typed(key, list))

    def numbers(self, key: str) -> tuple[float, ...]:
        """Return a list of quantities."""
        return tuple(as_number(item) for item in self.items(key))

    def vector(self, key: str) -> Vector:
        """Return a list of three quantities."""
        x, y, z = self.numbers(key)
        return x, y, z

    def unit_vector(self, key: str) -> Vector:
        """Return a direction, three numbers or the letter of an axis, at length 1.

        Raises
        ------
        ScriptError
            If its length is zero.
        """
        value = self.values[key].value
        if isinstance(value, str):
            x, y, z = (float(axis == value) for axis in "xyz")
            return x, y, z
        direction = self.vector(key)
        largest = max(map(abs, direction))
        if largest == 0.0:
            raise ScriptError(
                "SHW104",
                f"`{key}` has length zero",
                key=key,
                help_text="write `x`, `y`, `z` or another direction",
            )
        # First by the largest: squares of small numbers may vanish.
        x, y, z = (part / largest for part in direction)
        length = hypot(x, y, z)
        return x / length, y / length, z / length


def as_number(setting: Setting) -> float:
    """Return the quantity a setting holds."""
    if not isinstance(setting.value, float):
        raise TypeError(f"{setting.value!r} is not a number")
    return setting.value


def as_numbers(setting: Setting) -> tuple[float, ...]:
    """Return the quantities of the list a setting holds."""
    if not isinstance(setting.value, list):
        raise TypeError(f"{setting.value!r} is not a list")
    return tuple(as_number(item) for item in setting.value)
