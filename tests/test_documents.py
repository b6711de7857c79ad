"""Every command in the documents runs, and every link leads somewhere."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from generate import GENERATED

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([ROOT / "README.md", *(ROOT / "showc" / "docs").glob("*.md")])
BLOCK = re.compile(
    r"(?:<!-- file: (?P<file>\S+) -->\n)?```(?P<kind>\w*)\n(?P<text>.*?)```", re.DOTALL
)
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)")


def blocks(document):
    return list(BLOCK.finditer(document.read_text(encoding="utf-8")))


def commands(document):
    return [
        line
        for block in blocks(document)
        if block["kind"] == "sh"
        for line in block["text"].splitlines()
        if line.strip() and not line.startswith("#")
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    "document",
    [document for document in DOCUMENTS if commands(document)],
    ids=lambda document: document.name,
)
def test_commands_run(document, tmp_path, cache):
    # A script is not read through a link that leads out of the working folder.
    shutil.copytree(ROOT / "shows", tmp_path / "shows")
    for name in ("Makefile", "pyproject.toml", "tests", "schemas", "showc"):
        (tmp_path / name).symlink_to(ROOT / name)
    for block in blocks(document):
        if block["file"]:
            (tmp_path / block["file"]).write_text(block["text"], encoding="utf-8")
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "XDG_CACHE_HOME": str(cache),
    }
    for line in commands(document):
        words = shlex.split(line)
        if words[0] == "make":  # building the environment again would prove little
            words.insert(1, "--dry-run")
        run = subprocess.run(
            words, cwd=tmp_path, env=environment, capture_output=True, text=True,
            timeout=600, check=False,
        )  # fmt: skip
        assert run.returncode == 0, f"$ {line}\n{run.stdout}\n{run.stderr}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda document: document.name)
def test_links_lead_somewhere(document):
    text = document.read_text(encoding="utf-8")
    missing = [
        link for link in LINK.findall(text) if not (document.parent / link).exists()
    ]
    assert missing == []


def test_bash_can_read_every_shell_block():
    bash = shutil.which("bash")
    assert bash
    for document in DOCUMENTS:
        for line in commands(document):
            subprocess.run([bash, "-n", "-c", line], check=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    "document",
    [
        document
        for document in DOCUMENTS
        if any(block["kind"] == "python" for block in blocks(document))
    ],
    ids=lambda document: document.name,
)
def test_python_examples_run(document, tmp_path, cache, compiled):
    shutil.copytree(ROOT / "shows", tmp_path / "shows")
    log = compiled("grid")
    shutil.copy(log, tmp_path / "output.mcap")
    shutil.copytree(log.with_suffix(""), tmp_path / "output")
    code = "".join(
        block["text"] for block in blocks(document) if block["kind"] == "python"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "XDG_CACHE_HOME": str(cache)},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert run.returncode == 0, run.stderr


def test_the_readme_shows_the_first_show():
    written = next(
        block["text"] for block in blocks(ROOT / "README.md") if block["file"]
    )
    kept = (ROOT / "shows" / "first.yaml").read_text(encoding="utf-8")
    assert kept.split("\n", 1)[1] == written


def test_what_is_generated_is_as_the_program_says():
    stale = [
        path.relative_to(ROOT).as_posix()
        for path, text in GENERATED.items()
        # Drawings take seconds each.
        if path.suffix != ".svg" and path.read_text(encoding="utf-8") != text()
    ]
    assert stale == [], "run make docs"
