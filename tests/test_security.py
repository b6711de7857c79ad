"""What the page on security says is what the code does."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest
import yaml
from repository import ROOT

from showc.cli import showc
from showc.script import files, load
from showc.script.formations import csv_file, image, mesh, svg
from showc.script.language import document, kinds
from showc.script.sections import gallery

PAGE = (ROOT / "showc" / "docs" / "security.md").read_text(encoding="utf-8")
WORKFLOW = ROOT / ".github" / "workflows" / "check-shows.yaml"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


MB = 10**6
MOST = files.MOST_BYTES
SAID = (
    f"{document.MAX_BYTES // MB} MB, {document.MAX_NODES:,} keys and values",
    f"written out, {document.MAX_DEPTH} deep |",
    f"| {kinds.Table(kinds.Flag(), '').most:,}; {gallery.MAX_PLACES:,}; ",
    f"; {gallery.MAX_DRAWN:,} |",
    f"| drones times transitions | {gallery.MAX_FLOWN:,} |",
    f"| {gallery.MAX_CHAIN} |",
    f"{MOST['.csv'] // MB} MB, {csv_file.MAX_LINES:,} lines",
    f"{MOST['.svg'] // MB} MB, {svg.MAX_ELEMENTS:,} elements with copies written out",
    f"written out, {svg.MAX_DEPTH} deep |",
    f"{MOST['.png'] // MB} MB, {image.MAX_PIXELS // MB} million pixels",
    f"{files.MESH_BYTES // MB} MB, {mesh.MAX_TRIANGLES:,} triangles",
    f"{MOST['.ttf'] // MB} MB; letters",
    f"| {files.TOTAL_BYTES // MB} MB |",
    f"| findings shown | {document.MAX_FOUND} |",
    f"| {load.MAX_SECONDS:.0f} s |",
    f"within {gallery.FARTHEST / 1000:,.0f} km",
)


@pytest.mark.parametrize("said", SAID)
def test_the_page_has_the_limits_of_the_code(said):
    assert said in " ".join(PAGE.split())


def test_every_command_says_what_it_reads_and_writes():
    table = PAGE.split("## What each command reads")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (`.*?) \|", table, flags=re.MULTILINE)
    said = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    assert sorted(said) == sorted(showc.list_commands(click.Context(showc)))


def test_every_dependency_is_explained():
    extras = PROJECT["optional-dependencies"]
    wanted = [*PROJECT["dependencies"], *extras["link"], *extras["cluster"]]
    section = PAGE[PAGE.index("## What it is built on") :]
    missing = [
        name
        for name in (re.split(r"[<>=]", wish)[0] for wish in wanted)
        if name not in section
    ]
    assert missing == []


def test_the_workflow_runs_what_is_pinned_and_little_else():
    workflow = yaml.safe_load(WORKFLOW.read_text())
    (job,) = workflow["jobs"].values()
    assert workflow["permissions"] == job["permissions"] == {"contents": "read"}
    assert 0 < job["timeout-minutes"] <= 30
    for step in job["steps"]:
        assert re.fullmatch(r"\S+@[0-9a-f]{40}", step.get("uses", "a@" + "0" * 40))
        # What callers give comes by the environment, never into the shell's text.
        assert "${{" not in step.get("run", "")
    installs = [step["run"] for step in job["steps"] if "pip" in step.get("run", "")]
    assert len(installs) == 1
    assert (
        f"{PROJECT['name']} @ git+https://github.com/$REPOSITORY@$COMMIT"
        in (installs[0])
    )


def test_the_workflow_trusts_the_script_that_lies_there(tmp_path):
    """Its own commands, in a shell: the log is held against the script, not itself."""
    (job,) = yaml.safe_load(WORKFLOW.read_text())["jobs"].values()
    named = {step.get("name"): step.get("run") for step in job["steps"]}
    run = named["Compile and verify"]
    show = tmp_path / "shows" / "first.yaml"
    show.parent.mkdir()
    show.write_bytes((ROOT / "shows" / "first.yaml").read_bytes())
    folder = Path(sys.executable).parent
    means = {"SCRIPTS": "shows/*.yaml", "PATH": f"{folder}:{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-e", "-c", run],
        cwd=tmp_path,
        env=os.environ | means,
        capture_output=True,
        text=True,
        check=True,
    )
    assert re.search(r"^PROVED: ", done.stdout, flags=re.MULTILINE)
    assert ": given with --script, and compared with the one in the log" in done.stdout


def test_the_package_is_not_called_as_somebody_elses():
    assert PROJECT["name"] == "showc-compiler"
    assert PROJECT["scripts"] == {"showc": "showc.__main__:main"}


def test_a_package_that_few_need_is_asked_for_in_one_sentence(tmp_path):
    code = (
        "import sys\nsys.modules['pymavlink'] = None\n"
        "from showc.__main__ import run\n"
        "sys.exit(run(['upload', sys.argv[1], '--connect', 'udpin:127.0.0.1:1']))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "pip install 'showc-compiler[link]'" in done.stderr
