"""What the page on security says is what the code does."""

import re
import subprocess
import sys
import tomllib

import pytest
import yaml
from repository import ROOT

from showc.script import document, files, gallery, kinds, load
from showc.script.formations import csv_file, image, mesh, svg

PAGE = (ROOT / "showc" / "docs" / "security.md").read_text(encoding="utf-8")
WORKFLOW = ROOT / ".github" / "workflows" / "check-shows.yaml"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.mark.parametrize(
    "said",
    [
        (
            f"{document.MAX_BYTES // 10**6} MB, {document.MAX_NODES:,} values with aliases "
            f"written out, {document.MAX_DEPTH} deep"
        ),
        (
            f"| {kinds.Table(kinds.Flag(), '').most:,}; {gallery.MAX_PLACES:,}; "
            f"{gallery.MAX_DRAWN:,} |"
        ),
        f"| {gallery.MAX_CHAIN} |",
        f"{files.MOST_BYTES['.csv'] // 10**6} MB, {csv_file.MAX_LINES:,} lines",
        (
            f"{files.MOST_BYTES['.svg'] // 10**6} MB, {svg.MAX_ELEMENTS:,} elements with "
            f"copies written out, {svg.MAX_DEPTH} deep"
        ),
        (
            f"{files.MOST_BYTES['.png'] // 10**6} MB, {image.MAX_PIXELS // 10**6} million "
            "pixels"
        ),
        f"{files.MESH_BYTES // 10**6} MB, {mesh.MAX_TRIANGLES:,} triangles",
        f"{files.MOST_BYTES['.ttf'] // 10**6} MB; letters",
        f"| {files.TOTAL_BYTES // 10**6} MB |",
        f"| findings shown | {document.MAX_FOUND} |",
        f"| {load.MAX_SECONDS:.0f} s |",
        f"more than {gallery.FARTHEST / 1000:,.0f} km".replace("more", "farther"),
    ],
)
def test_the_page_has_the_limits_of_the_code(said):
    assert said in " ".join(PAGE.split())


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
