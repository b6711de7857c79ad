"""Quantities: numbers with units, and the numbers they stand for.

A script writes a plain number in the unit its key documents, or a text with a unit:
``"20 deg"``, ``"0.35 rad"``, ``"18 km/h"``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

from showc.script.diagnostic import ScriptError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from fractions import Fraction


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of measure."""

    symbol: str
    """As scripts write it."""
    dimension: str
    """What it measures."""
    factor: float
    """How many SI units one of it is."""

    @property
    def exact(self) -> Fraction | None:
        """The same as a fraction of small numbers, where it is one."""
        return _exact(self.factor)


@cache
def _exact(factor: float) -> Fraction | None:
    from fractions import Fraction  # noqa: PLC0415 - start-up counts

    fraction = Fraction(factor).limit_denominator(10**9)
    return fraction if float(fraction) == factor else None


def _units(dimension: str, **factors: float) -> dict[str, Unit]:
    return {name: Unit(name, dimension, factor) for name, factor in factors.items()}


def _named(dimension: str, factors: dict[str, float]) -> dict[str, Unit]:
    return {name: Unit(name, dimension, factor) for name, factor in factors.items()}


UNITS: Mapping[str, Unit] = MappingProxyType(
    _units("length", m=1.0, mm=1e-3, cm=1e-2, km=1e3, ft=0.3048)
    | _units("time", s=1.0, ms=1e-3, us=1e-6, min=60.0, h=3600.0)
    | _units("mass", kg=1.0, g=1e-3, lb=0.45359237)
    | _units("force", N=1.0, mN=1e-3, kN=1e3)
    | _units("frequency", Hz=1.0, kHz=1e3)
    | _named("angle", {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180})
    | _named("angle", {"turn": 2 * math.pi})
    | _named(
        "speed",
        {
            "m/s": 1.0,
            "km/h": 1 / 3.6,
            "cm/s": 1e-2,
            "ft/s": 0.3048,
            "mph": 0.44704,
            "kn": 1852 / 3600,
        },
    )
    | _named(
        "angular speed",
        {
            "rad/s": 1.0,
            "deg/s": math.pi / 180,
            "°/s": math.pi / 180,
            "rpm": 2 * math.pi / 60,
        },
    )
    | _named("torque", {"N m": 1.0, "Nm": 1.0, "mN m": 1e-3, "mNm": 1e-3})
    | _named("acceleration", {"m/s²": 1.0, "m/s2": 1.0, "m/s^2": 1.0})
    | _named("jerk", {"m/s³": 1.0, "m/s3": 1.0, "m/s^3": 1.0})
    | _named("area", {"m²": 1.0, "m2": 1.0, "m^2": 1.0, "cm²": 1e-4, "cm2": 1e-4})
    | _named("charge", {"C": 1.0, "Ah": 3600.0, "mAh": 3.6})
    | _units("voltage", V=1.0, mV=1e-3)
    | _units("power", W=1.0, mW=1e-3, kW=1e3)
    | _named("resistance", {"ohm": 1.0, "mohm": 1e-3, "Ω": 1.0, "mΩ": 1e-3})
    | _named("moment of inertia", {"kg m²": 1.0, "kg m2": 1.0, "kg m^2": 1.0})
    | _named(
        "thrust over squared rotor speed",
        {"N s²/rad²": 1.0, "N s2/rad2": 1.0, "N s^2/rad^2": 1.0},
    )
    | _named(
        "torque over squared rotor speed",
        {"N m s²/rad²": 1.0, "N m s2/rad2": 1.0, "N m s^2/rad^2": 1.0},
    )
    | _named("share", {"%": 1e-2})
)
"""Every unit a script may write."""

_ONE = Unit("", "share", 1.0)

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
"""A number as scripts write it (a regular expression)."""
_NUMBER = re.compile(NUMBER)
_QUANTITY = re.compile(rf"({NUMBER})\s*([^\d\s].*?)\s*")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?![\d,])")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}(?!\d)")
_MINUS = re.compile(r"[\u2010-\u2015\u2212]\s*[\d.]")
"""Dashes, and the minus sign of typesetters, before a number."""
_MEANT = {
    word: unit
    for unit, words in {
        "m": "meter meters metre metres",
        "cm": "centimeter centimeters centimetre centimetres",
        "ft": "feet foot",
        "s": "sec secs second seconds",
        "ms": "msec millisecond milliseconds",
        "min": "mins minute minutes",
        "h": "hour hours hr",
        "deg": "degree degrees",
        "rad": "radian radians",
        "m/s": "mps m/sec ms-1",
        "km/h": "kmh kph kmph",
        "kg": "kilo kilos kilogram kilograms",
        "g": "gram grams",
        "Hz": "hz hertz",
    }.items()
    for word in words.split()
}
"""Units as people write them, and how scripts do."""
_NOT_FINITE = re.compile(r"[-+]?\.?(?:nan|inf|infinity)", re.IGNORECASE)
_AMBIGUOUS = re.compile(
    r"[-+]?0\d+|[-+]?\d[\d_]*_[\d_]*(\.\d*)?|[-+]?\d+(:\d+)+(\.\d*)?|0x[\da-fA-F]+|0o\d+"
)


_LONGEST = 100
"""Longest text that is looked at [characters]: a number of 64 bits has 24."""


def parse_quantity(text: str, unit: str, *, plain: bool, store: str = "") -> float:
    """Read a number, with or without a unit.

    Parameters
    ----------
    text
        What the script says.
    unit
        Unit of plain numbers; empty for numbers without dimension.
    plain
        Whether the text stands without quotes.
    store
        Unit of the result; empty: the SI unit of the same dimension.

    Returns
    -------
    float
        The value, finite, in ``store``.

    Raises
    ------
    ScriptError
        If it is no number, not finite, ambiguous in YAML, or has a unit of another
        dimension or an unknown one.
    """
    stripped = text.strip()
    if len(stripped) > _LONGEST:
        raise ScriptError(
            "SHW103",
            f"{len(stripped)} characters are not a number",
            help_text=f"give a number in {unit}" if unit else "give a number",
        )
    if _NOT_FINITE.fullmatch(stripped):
        raise ScriptError(
            "SHW005",
            f"`{stripped}` is not a finite number",
            help_text=f"give a number in {unit}" if unit else "give a number",
        )
    if plain and _AMBIGUOUS.fullmatch(stripped):
        raise ScriptError(
            "SHW007",
            f"YAML readers disagree about `{stripped}`",
            help_text="write an ordinary decimal number",
        )
    _other_signs(stripped)
    if _NUMBER.fullmatch(stripped):
        value, written = float(stripped), unit
    else:
        match = _QUANTITY.fullmatch(stripped)
        if match is None:
            wanted = f"a number in {unit}" if unit else "a number"
            raise ScriptError(
                "SHW103", f"`{text}` is not a number", help_text=f"give {wanted}"
            )
        value, written = float(match.group(1)), match.group(2)
    found = _unit(written, unit, stripped)
    result = value
    if written != store:
        target = UNITS[store] if store else _ONE
        result = _converted(match_number(stripped), found, target)
    if not math.isfinite(result):
        raise ScriptError("SHW005", f"`{stripped}` is not a finite number")
    return result


def _other_signs(stripped: str) -> None:
    """Refuse dashes for minus signs, and commas in numbers.

    Raises
    ------
    ScriptError
        If there are any.
    """
    if _MINUS.match(stripped):
        right = f"-{stripped[1:]}"
        raise ScriptError(
            "SHW103",
            f"`{stripped}` begins with a dash that is not a minus sign",
            help_text=f"write `{right}`",
            fix=right,
        )
    if _DECIMAL_COMMA.match(stripped):
        raise comma_fault(stripped)


def comma_fault(text: str) -> ScriptError:
    """Say what is wrong with a number that has one comma: of decimals, or thousands."""
    right = text.replace(",", ".", 1)
    if _THOUSANDS.match(text):
        return ScriptError(
            "SHW103",
            f"`{text}` has a comma, for decimals or for thousands",
            help_text=f"write `{right}` or `{text.replace(',', '', 1)}`",
        )
    message = f"`{text}` has a decimal comma"
    return ScriptError("SHW103", message, help_text=f"write `{right}`", fix=right)


def match_number(text: str) -> str:
    """Return the number at the beginning of a text that has one."""
    match = _NUMBER.match(text)
    return match.group() if match is not None else ""


def _converted(number: str, source: Unit, target: Unit) -> float:
    """Return a number in another unit, correctly rounded where units are decimal."""
    value = float(number)
    if source.factor == target.factor:
        return value
    top, bottom = source.exact, target.exact
    if top is None or bottom is None or not math.isfinite(value) or value == 0.0:
        return value * source.factor / target.factor
    try:
        return float(type(top)(number) * top / bottom)
    except OverflowError:
        return math.inf


def _unit(written: str, unit: str, text: str) -> Unit:
    """Return a written unit, checked against the wanted one."""
    if written == unit:
        return UNITS[unit] if unit else _ONE
    found = UNITS.get(" ".join(written.split()))
    wanted = UNITS[unit].dimension if unit else "share"
    meant = _MEANT.get(written.lower().rstrip("."), "")
    if found is None and meant in units_of(unit):
        right = f"{match_number(text)} {meant}"
        raise ScriptError(
            "SHW105",
            f"unknown unit `{written}` in `{text}`",
            help_text=f"write `{right}`",
            fix=right,
        )
    if found is None:
        raise ScriptError(
            "SHW105",
            f"unknown unit `{written}` in `{text}`",
            help_text=f"units here: {_listed(unit)}"
            if unit
            else "give a number without a unit",
        )
    if found.dimension != wanted:
        what = f"{_article(wanted)} in {unit}" if unit else "a number without a unit"
        raise ScriptError(
            "SHW105",
            f"`{text}` is {_article(found.dimension)}; expected {what}",
            help_text=f"units here: {_listed(unit)}",
        )
    return found


def units_of(unit: str) -> tuple[str, ...]:
    """Return the symbols of every unit of the same dimension as ``unit``."""
    wanted = UNITS[unit].dimension if unit else "share"
    return tuple(name for name, item in UNITS.items() if item.dimension == wanted)


def _listed(unit: str) -> str:
    beats = ("beats", "bars") if unit == "s" else ()
    return ", ".join(units_of(unit) + beats)


def _article(dimension: str) -> str:
    return f"{'an' if dimension[0] in 'aeiou' else 'a'} {dimension}"
