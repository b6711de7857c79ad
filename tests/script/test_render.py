"""The formats of findings, held against the tools that read them."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from junitparser import JUnitXml
from lxml import etree

from showc.script import Diagnostic, Label, Severity, load_show, read_show
from showc.script.diagnostic import select_diagnostics
from showc.script.mark import Mark
from showc.script.render import FORMATS, render

BROKEN = Path(__file__).parent / "broken"


@pytest.fixture
def corpus(monkeypatch):
    monkeypatch.chdir(BROKEN)
    results = [load_show(path.name) for path in sorted(BROKEN.glob("*.yaml"))]
    found = [item for result in results for item in result.diagnostics]
    return found, {result.path: result.text for result in results}


def test_json_counts_and_points(corpus):
    found, sources = corpus
    report = json.loads(render(found, sources, "json"))
    severities = Counter(item["severity"] for item in report["diagnostics"])
    assert report["error_count"] == severities["error"] > 30
    assert report["warning_count"] == severities["warning"] > 10
    assert report["valid"] is False
    assert report["files"] == sorted(sources)
    for item in report["diagnostics"]:
        start, end = item["range"]["start"], item["range"]["end"]
        lines = sources[item["range"]["filename"]].split("\n")
        text = "\n".join(lines).encode()
        before = text[: start["byte"]].decode()
        assert before.count("\n") + 1 == start["line"]
        assert len(before) - (before.rfind("\n") + 1) + 1 == start["column"]
        assert start["byte"] <= end["byte"]


def test_json_of_a_right_script_is_valid():
    assert json.loads(render([], {"a.yaml": "showc: 1\n"}, "json")) == {
        "format_version": "1.0",
        "valid": True,
        "error_count": 0,
        "warning_count": 0,
        "files": ["a.yaml"],
        "diagnostics": [],
    }


def test_json_fixes_mend_the_script():
    text = (
        "showc: 1\ndrones: 4\nseperation: 2\nformations:\n"
        "  ring: {type: cirle, raduis: 8, colour: glod}\ntransitions: [rign]\n"
    )
    for _ in range(4):
        result = read_show(text.encode())
        if result.show is not None:
            break
        report = json.loads(render(result.diagnostics, {result.path: text}, "json"))
        content = text.encode()
        for item in reversed(report["diagnostics"]):
            if item["fix"] is not None:
                at = item["range"]
                content = (
                    content[: at["start"]["byte"]]
                    + item["fix"].encode()
                    + content[at["end"]["byte"] :]
                )
        text = content.decode()
    assert result.show is not None
    assert result.show.separation.distance == 2.0


def test_sarif_is_accepted_by_its_own_validator(corpus, npm, tmp_path):
    modules = npm("@microsoft/sarif-multitool")
    programs = list((modules / "@microsoft").glob("sarif-multitool-*/Sarif.Multitool"))
    if not programs:
        pytest.skip("sarif-multitool has no program for this system")
    programs[0].chmod(0o755)
    log, verdict = tmp_path / "showc.sarif", tmp_path / "verdict.sarif"
    log.write_text(render(*corpus, "sarif"), encoding="utf-8")
    subprocess.run(
        [
            programs[0],
            "validate",
            log,
            "--output",
            verdict,
            "--rule-kind",
            "Sarif;Ghas",
        ],
        check=False,
        capture_output=True,
        env={"DOTNET_SYSTEM_GLOBALIZATION_INVARIANT": "1", "HOME": str(tmp_path)},
    )
    run = json.loads(verdict.read_text(encoding="utf-8-sig"))["runs"][0]
    assert run["invocations"][0]["executionSuccessful"] is True
    rules = run["tool"]["driver"].get("rules", [])
    errors = [
        item
        for item in run.get("results", [])
        if item.get("level", _level(rules, item)) == "error"
    ]
    assert errors == []


def _level(rules, item):
    rule = next((rule for rule in rules if rule["id"] == item["ruleId"]), {})
    return rule.get("defaultConfiguration", {}).get("level", "warning")


def test_sarif_points_and_fixes(corpus):
    found, sources = corpus
    log = json.loads(render(found, sources, "sarif"))
    run = log["runs"][0]
    assert log["version"] == "2.1.0"
    assert len(run["results"]) == len(found)
    rules = [rule["id"] for rule in run["tool"]["driver"]["rules"]]
    prints = [
        item["partialFingerprints"]["primaryLocationLineHash"]
        for item in run["results"]
    ]
    assert len(set(prints)) == len(prints)
    for item, diagnostic in zip(run["results"], found, strict=True):
        assert rules[item["ruleIndex"]] == item["ruleId"] == diagnostic.code
        region = item["locations"][0]["physicalLocation"]["region"]
        assert region["startLine"] == diagnostic.span.line
        assert region["startColumn"] == diagnostic.span.column
        assert ("fixes" in item) == bool(diagnostic.fix)


def test_sarif_fingerprints_stay_when_lines_move():
    text = (
        "showc: 1\ndrones: 4\nseperation: 2\nformations: {a: {type: circle}}\n"
        "transitions: [a]\n"
    )

    def prints(script):
        result = read_show(script.encode())
        log = json.loads(render(result.diagnostics, {result.path: script}, "sarif"))
        return [item["partialFingerprints"] for item in log["runs"][0]["results"]]

    assert prints(text) == prints("# a new first line\n\n" + text)


def test_junit_is_read_by_junitparser(corpus, tmp_path):
    found, sources = corpus
    path = tmp_path / "report.xml"
    path.write_text(render(found, sources, "junit"), encoding="utf-8")
    suite = next(iter(JUnitXml.fromfile(str(path))))
    assert suite.tests == len(sources)
    failures = [(case.name, item.type) for case in suite for item in case.result]
    errors = [item for item in found if item.severity is Severity.ERROR]
    assert Counter(failures) == Counter((i.span.path, i.code) for i in errors)
    tree = etree.parse(str(path))
    assert int(tree.getroot()[0].get("failures")) == len(errors)


def test_junit_of_right_scripts_passes():
    suite = next(iter(JUnitXml.fromstring(render([], {"a.yaml": ""}, "junit"))))
    assert [case.name for case in suite] == ["a.yaml"]
    assert suite.failures == 0


def test_github_commands_hold_one_line_each(corpus):
    found, sources = corpus
    lines = render(found, sources, "github").splitlines()
    assert len(lines) == len(found)
    for line, item in zip(lines, found, strict=True):
        assert line.startswith(f"::{item.severity} file={item.span.path},")
        assert f"line={item.span.line}," in line


def test_github_escapes():
    item = Diagnostic(
        "SHW101", "100 %: a, b", Mark("a,b:c.yaml", 1, 1, 1, 2),
        notes=("second",),
    )  # fmt: skip
    assert render([item], {}, "github") == (
        "::error file=a%2Cb%3Ac.yaml,line=1,endLine=1,col=1,endColumn=2,title=SHW101"
        "::100 %25: a, b%0Anote: second\n"
    )


def test_text_draws_carets_and_colour():
    text = "a: 1\nsize: wide\n"
    item = Diagnostic(
        "SHW103", "not a number", Mark("x.yaml", 2, 7, 2, 11),
        label="here", secondary=(Label(Mark("x.yaml", 1, 4, 1, 5), "not there"),),
        notes=("a note",), help="do this",
    )  # fmt: skip
    assert render([item], {"x.yaml": text}, "text") == (
        "x.yaml:2:7: error[SHW103]: not a number\n"
        "  |\n"
        "2 | size: wide\n"
        "  |       ^^^^ here\n"
        "1 | a: 1\n"
        "  |    - not there\n"
        "  = note: a note\n"
        "  = help: do this\n"
        "\n"
        "1 error\n"
    )
    coloured = render([item], {"x.yaml": text}, "text", colour=True)
    assert "\x1b[1;31merror[SHW103]\x1b[0m" in coloured


def test_text_caps_a_flood():
    items = [
        Diagnostic("SHW101", f"fault {n}", Mark("x.yaml", 1, 1, 1, 2))
        for n in range(50)
    ]
    said = render(items, {"x.yaml": "abc"}, "text")
    assert said.count("error[SHW101]") == 20
    assert "x.yaml: 30 more findings SHW101" in said
    assert said.endswith("50 errors\n")


spans = st.builds(
    Mark, st.just("x.yaml"), st.integers(1, 6), st.integers(1, 30),
    st.integers(1, 6), st.integers(1, 30),
)  # fmt: skip


@given(st.text(max_size=60), spans, st.text(max_size=20), st.sampled_from(FORMATS))
def test_any_finding_in_any_text_is_drawn(text, span, message, form):
    item = Diagnostic(
        "SHW101", message, span, notes=(message,), severity=Severity.WARNING
    )
    said = render([item], {"x.yaml": text}, form)
    assert said
    if form == "junit":
        etree.fromstring(said.encode())


def test_selecting_keeps_errors_and_raises_warnings():
    error = Diagnostic("SHW201", "e", None)
    warning = Diagnostic("SHW303", "w", None, severity=Severity.WARNING)
    other = Diagnostic("SHW118", "o", None, severity=Severity.WARNING)
    found = (error, warning, other)
    assert select_diagnostics(found) == found
    assert select_diagnostics(found, ignore=["SHW3", "SHW2"]) == (error, other)
    assert select_diagnostics(found, select=["SHW3"]) == (error, warning)
    strict = select_diagnostics(found, strict=True)
    assert [item.severity for item in strict] == [Severity.ERROR] * 3


def test_rendering_text_needs_no_heavy_library():
    code = (
        "import sys\nfrom showc.script import read_show\n"
        "from showc.script.render import render\n"
        "r = read_show(b'showc: 1\\ndrones: 4\\nformations: {a: {type: circle}}\\n"
        "transitions: [a]\\n')\nassert r.show, r.diagnostics\n"
        "for form in ('text', 'json', 'github', 'sarif'):\n"
        "    render(r.diagnostics, {r.path: r.text}, form)\n"
        "heavy = {'scipy', 'casadi', 'trimesh', 'PIL', 'fontTools', 'svgelements', "
        "'junitparser', 'rich', 'jsonschema'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
