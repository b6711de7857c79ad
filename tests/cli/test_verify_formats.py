"""What ``showc verify`` found, in the formats of CI servers and code scanning."""

import json
import shutil

import pytest
import yaml
from click.testing import CliRunner
from junitparser import JUnitXml
from repository import ROOT

from showc.cli.verify import command


@pytest.fixture(scope="module")
def close(tmp_path_factory):
    """Two drones that pass each other at 0.4 m: a folder of tables."""
    folder = tmp_path_factory.mktemp("tables")
    head = "Time [msec],x [m],y [m],z [m],Red,Green,Blue\n"
    for name, x in (("one", 0.0), ("two", 0.4)):
        rows = [f"{t},{x},0,{z},0,0,0" for t, z in ((0, 0), (5000, 5), (10000, 0))]
        (folder / f"{name}.csv").write_text(head + "\n".join(rows) + "\n")
    return folder


def said(path, form):
    arguments = [str(path), "--separation", "1", "--format", form]
    return CliRunner().invoke(command, arguments, standalone_mode=False)


def test_sarif_names_the_rule_the_file_and_the_place(close):
    run = said(close, "sarif")
    assert run.return_value == 1, run.output
    (report,) = json.loads(run.output)["runs"]
    codes = {result["ruleId"] for result in report["results"]}
    rules = {rule["id"]: rule for rule in report["tool"]["driver"]["rules"]}
    assert codes == set(rules)
    for result in report["results"]:
        (place,) = result["locations"]
        uri = place["physicalLocation"]["artifactLocation"]["uri"]
        assert uri == close.as_posix()
    assert all(rule["fullDescription"]["text"] for rule in rules.values())
    apart = [
        result["message"]["text"]
        for result in report["results"]
        if "0.4 against 1 m" in result["message"]["text"]
    ]
    assert "drones 1 and 2" in apart[0]


def test_junit_has_a_failure_for_every_fault(close):
    run = said(close, "junit")
    faults = [
        check
        for check in json.loads(said(close, "json").output)["checks"]
        if check["verdict"] in {"fail", "unproved"}
    ]
    (suite,) = JUnitXml.fromstring(run.output.encode())
    (case,) = suite
    assert run.return_value == 1
    assert sorted(one.type for one in case.result) == sorted(c["code"] for c in faults)


def test_no_name_writes_a_line_of_its_own_in_junit(close, tmp_path):
    """Machines of CI take lines that begin with two colons for commands."""
    odd = tmp_path / "a\n::error::forged\x1b[31m"
    shutil.copytree(close, odd)
    run = said(odd, "junit")
    assert run.return_value == 1, run.output
    assert JUnitXml.fromstring(run.output.encode())
    assert not any(line.startswith("::") for line in run.output.splitlines())
    assert "\x1b" not in run.output


def test_annotations_stand_at_the_file(close):
    lines = said(close, "github").output.splitlines()
    assert lines[0].startswith(("::error file=", "::warning file="))


def test_the_workflow_checks_shows_of_others_by_the_same_pins():
    folder = ROOT / ".github" / "workflows"
    ours, others = (
        yaml.safe_load((folder / name).read_text())
        for name in ("check-shows.yaml", "check-skyc.yaml")
    )

    def pins(workflow):
        (job,) = workflow["jobs"].values()
        return {step["uses"] for step in job["steps"] if "uses" in step}

    assert pins(others) == pins(ours)
    assert others["permissions"] == {"contents": "read"}
    (job,) = others["jobs"].values()
    command = next(step["run"] for step in job["steps"] if step.get("name") == "Check")
    assert 'showc verify --format "$FORMAT"' in command
