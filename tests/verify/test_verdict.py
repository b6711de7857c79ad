"""The verdict says what is proved and what is not, and nothing in it can pretend."""

import json

import pytest

from showc.cli.findings import render_text
from showc.errors import escaped
from showc.verify import Check, Place, Verification, verify_log

GOOD = Check("VRF321", "separation", "apart", "pass", 1.5, 1.0, "m")
MISSION = Check("VRF411", "missions", "apart", "pass", 1.2, 0.97, "m")


def verification(*checks, title="Show"):
    return Verification("output.mcap", title, 2, 10.0, "script “a.yaml”", checks)


def with_verdict(check, verdict):
    return Check(check.code, check.group, check.name, verdict, notes=("why",))


@pytest.mark.parametrize(
    ("flight", "missions", "proved", "code"),
    [
        ("pass", "pass", True, 0),
        ("pass", "skipped", True, 0),
        ("pass", "accepted", False, 0),
        ("pass", "unproved", False, 1),
        ("pass", "fail", False, 1),
        ("unproved", "pass", False, 1),
        ("fail", "pass", False, 1),
        ("accepted", "pass", False, 1),
    ],
)
def test_only_what_is_proved_or_accepted_ends_with_zero(flight, missions, proved, code):
    found = verification(with_verdict(GOOD, flight), with_verdict(MISSION, missions))
    assert found.proved == proved
    assert found.to_json()["exit_code"] == code
    assert found.to_json()["proved"] == proved
    assert found.verdict.startswith("PROVED: ") == proved


def test_the_verdict_names_both_sides_with_their_worst_figures():
    found = verification(GOOD, MISSION).verdict
    assert found == (
        "PROVED: trajectories proved (closest pair 1.5 m, limit 1); "
        "missions proved (closest pair 1.2 m, limit 0.97)."
    )


def test_what_the_script_accepts_stays_visible():
    found = verification(GOOD, with_verdict(MISSION, "accepted"))
    assert "missions NOT PROVED, as the script accepts (VRF411: why)" in found.verdict
    assert render_text(found).splitlines()[0] == found.verdict


def test_a_failure_without_a_figure_is_named_with_what_it_notes():
    note = "prediction.clock_lag is 0.0, not 0.17"
    bad = Check("VRF414", "missions", "as claimed", "fail", notes=(note,))
    assert f"VRF414: as claimed: {note})" in verification(GOOD, bad).verdict


def test_a_failure_is_named_with_its_figure():
    bad = Check("VRF411", "missions", "apart", "fail", 0.19, 0.97, "m")
    found = verification(GOOD, bad).verdict
    assert found.startswith("NOT PROVED: trajectories proved")
    assert "1 of 1 checks; VRF411: apart 0.19 m, limit 0.97" in found


@pytest.mark.parametrize(
    "text", ["a\x1b[2Jb", "a\n::error::b", "a\r\x9b1mb", "a\u202eb\u2028c", "a\udc80b"]
)
def test_names_cannot_move_the_cursor_or_begin_a_line(text):
    place = Place(segment=text, file=text)
    bad = Check("VRF411", "missions", text, "fail", where=place, notes=(text,))
    found = verification(GOOD, bad, title=text)
    shown = render_text(found)
    assert not any(line.startswith("::") for line in shown.splitlines())
    for letter in text:
        assert letter.isprintable() or letter not in shown.replace("\n", "")
    for letter in json.dumps(found.to_json(), ensure_ascii=False):
        assert letter.isprintable()


def test_what_is_printable_stays_as_it_is():
    assert escaped("Grüße – “Ring” 東京") == "Grüße – “Ring” 東京"


def test_a_proof_does_not_depend_on_the_number_of_processes(log_path):
    alone = verify_log(log_path, missions=False, jobs=1)
    shared = verify_log(log_path, missions=False, jobs=3)
    assert alone.passed
    assert shared.to_json() == alone.to_json()
