"""Codes of checks: every one is explained, and none is explained that no check has."""

import re
from pathlib import Path

import showc.export
import showc.foreign
import showc.verify
from showc.codes import explained, read_codes
from showc.verify.codes import ROOMS, codes

ROOMS_WITH_CHECKS = (showc.verify, showc.foreign, showc.export)
SOURCES = [Path(room.__file__).parent for room in ROOMS_WITH_CHECKS]


def test_the_table_holds_exactly_the_codes_of_the_checks():
    used = {
        code
        for source in SOURCES
        for path in source.rglob("*.py")
        for code in re.findall(r'"(VRF\d{3})"', path.read_text(encoding="utf-8"))
    }
    assert used == set(codes())


def test_every_room_has_its_hundred():
    for hundred, room in enumerate(ROOMS, 1):
        for code in read_codes("showc.verify.codes", f"{room}.toml"):
            assert code[3] == str(hundred)


def test_a_code_is_explained_in_any_case():
    assert "separation" in explained("vrf321", codes())
    assert explained("VRF999", codes()) is None
