import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from showc.script.diagnostic import ScriptError
from showc.script.language.quantity import UNITS, parse_quantity, units_of


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("20 deg", "deg", math.radians(20)),
        ("20", "deg", math.radians(20)),
        ("0.35 rad", "deg", 0.35),
        ("5 m/s", "m/s", 5.0),
        ("18 km/h", "m/s", 5.0),
        ("250 g", "kg", 0.25),
        ("1.7 rad/s", "deg/s", 1.7),
        ("60 rpm", "deg/s", 2 * math.pi),
        ("1.5 min", "s", 90.0),
        ("30ft", "m", 9.144),
        ("50 %", "", 0.5),
        ("1e-3", "m", 0.001),
        (" 2 m ", "m", 2.0),
        (".5", "m", 0.5),
        ("+3.", "m", 3.0),
        ("2.1e-6 N s^2/rad^2", "N s²/rad²", 2.1e-6),
    ],
)
def test_what_it_stands_for(text, unit, value):
    assert parse_quantity(text, unit, plain=True) == pytest.approx(value, rel=1e-15)


def test_decimal_units_round_once():
    assert parse_quantity("700 g", "kg", plain=True) == 0.7
    assert parse_quantity("18 km/h", "m/s", plain=True) == 5.0
    assert parse_quantity("30 cm", "m", plain=True) == 0.3
    assert parse_quantity("1e-999999999 cm", "m", plain=True) == 0.0


def test_degrees_may_be_kept():
    assert parse_quantity("47.397742", "deg", plain=True, store="deg") == 47.397742
    turned = parse_quantity("0.5 turn", "deg", plain=True, store="deg")
    assert turned == pytest.approx(180.0)


@pytest.mark.parametrize(
    ("text", "unit", "code", "words"),
    [
        ("5 kg", "m", "SHW105", "is a mass; expected a length in m"),
        ("5 deg", "m/s", "SHW105", "is an angle; expected a speed in m/s"),
        ("5 m", "", "SHW105", "is a length; expected a number without a unit"),
        ("5 parsec", "m", "SHW105", "unknown unit `parsec`"),
        ("wide", "m", "SHW103", "not a number"),
        ("", "m", "SHW103", "not a number"),
        ("1 2 m", "m", "SHW103", "not a number"),
        (".nan", "m", "SHW005", "finite"),
        ("-.inf", "m", "SHW005", "finite"),
        ("1e999", "m", "SHW005", "finite"),
        ("010", "m", "SHW007", "disagree"),
        ("1:30", "s", "SHW007", "disagree"),
        ("1_000", "m", "SHW007", "disagree"),
        ("0x10", "m", "SHW007", "disagree"),
    ],
)
def test_what_is_refused(text, unit, code, words):
    with pytest.raises(ScriptError, match=words) as caught:
        parse_quantity(text, unit, plain=True)
    assert caught.value.code == code


@given(
    st.floats(-1e9, 1e9, allow_nan=False, allow_infinity=False),
    st.sampled_from(sorted(UNITS)),
)
def test_every_unit_there_and_back(value, unit):
    si = next(
        name for name in units_of(unit) if UNITS[name].factor == 1.0
    ) if UNITS[unit].dimension != "share" else ""  # fmt: skip
    stored = parse_quantity(f"{value!r} {unit}", si, plain=False)
    assert stored == pytest.approx(value * UNITS[unit].factor, rel=1e-14, abs=1e-300)


@given(st.text(max_size=30), st.sampled_from(["", "m", "deg", "s"]), st.booleans())
def test_any_text_is_a_finite_number_or_refused(text, unit, plain):
    try:
        value = parse_quantity(text, unit, plain=plain)
    except ScriptError as fault:
        assert fault.code.startswith("SHW")  # noqa: PT017 - either outcome is right
    else:
        assert math.isfinite(value)
