"""A corpus of broken scripts, one for each code, with what showc says about them."""

import re
from pathlib import Path

import pytest

from showc.codes import explained
from showc.script import Severity, load_show
from showc.script.codes import codes
from showc.script.render import render

CODES = codes()
FOLDER = Path(__file__).parent / "broken"
SCRIPTS = sorted(FOLDER.glob("*.yaml"))
# Found before there is a file, and by later stages.
ELSEWHERE = {"SHW010"} | {code for code in CODES if code[3] >= "4"}


def findings(path, monkeypatch):
    monkeypatch.chdir(FOLDER)
    return load_show(path.name)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_what_is_said(path, monkeypatch):
    result = findings(path, monkeypatch)
    said = render(result.diagnostics, {result.path: result.text})
    assert said == path.with_suffix(".txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_the_code_the_script_is_for(path, monkeypatch):
    result = findings(path, monkeypatch)
    own = [item for item in result.diagnostics if item.code == path.stem]
    assert own
    assert all(item.severity == CODES[path.stem].severity for item in own)
    assert (result.show is None) == bool(result.errors)
    assert result.unreadable == (path.stem in {
        "SHW001", "SHW002", "SHW003", "SHW008", "SHW011"
    })  # fmt: skip


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_every_finding_points_into_its_line_and_helps(path, monkeypatch):
    result = findings(path, monkeypatch)
    lines = result.text.split("\n")
    for item in result.diagnostics:
        assert 1 <= item.span.line <= len(lines)
        assert 1 <= item.span.column <= len(lines[item.span.line - 1]) + 1
        assert (item.span.line, item.span.column) <= (
            item.span.end_line,
            item.span.end_column,
        )
        assert not item.message.endswith(".")
        assert item.severity in Severity
        assert item.code in CODES


def test_every_code_has_a_script():
    assert {path.stem for path in SCRIPTS} == set(CODES) - ELSEWHERE


@pytest.mark.parametrize("code", CODES)
def test_every_code_is_explained(code):
    text = explained(code.lower(), CODES)
    warning = " (warning)" * (CODES[code].severity == "warning")
    assert text.startswith(f"{code}{warning}: {CODES[code].title}\n")
    assert "Example:" in text
    assert "What to do: " in text
    assert re.fullmatch(r"SHW\d{3}", code)


def test_no_other_code_is_explained():
    assert explained("SHW999", CODES) is None


def test_a_file_that_is_not_there(tmp_path):
    result = load_show(tmp_path / "nowhere.yaml")
    assert [item.code for item in result.diagnostics] == ["SHW010"]
    assert result.unreadable
    assert result.exit_code() == 2
    assert "nowhere.yaml" in result.diagnostics[0].message


def test_a_folder_is_no_script(tmp_path):
    assert load_show(tmp_path).exit_code() == 2
