"""The short form of the campaign, and everything that the long one has found."""

import errno
import multiprocessing
import os
import random
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest
from fuzz.accidents import SIGNALS, Compile, Upload, Verify, campaign, filling
from fuzz.run import CORPUS
from fuzz.subjects import SUBJECTS, tried
from repository import ROOT

from showc.errors import UsageError
from showc.pipeline.artifact import place

CASES = {
    "scripts": 60,
    "inputs": 80,
    "logs": 6,
    "missions": 4,
    "caches": 40,
    "shows": 40,
}
FOUND = sorted(path for path in CORPUS.glob("*/*") if path.is_dir())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("campaign")


@pytest.fixture(scope="module")
def small():
    """A process that is small: copies of it count no memory that tests have taken."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
        yield process


def tried_afresh(name, folder, case):
    subject = SUBJECTS[name]()
    subject.prepare(folder)
    return tried(subject, folder, case)


@pytest.mark.parametrize("name", SUBJECTS)
def test_mutations_are_answered(name, folder):
    subject = SUBJECTS[name]()
    subject.prepare(folder)
    for number in range(CASES.get(name, 100)):
        case = subject.case(random.Random(f"short {name} {number}"))
        ending = tried(subject, folder, case)
        assert not ending.fault, f"case {number}: {ending.fault}"
        assert ending.memory < 1e9


@pytest.mark.parametrize("path", FOUND, ids=lambda path: "-".join(path.parts[-2:]))
def test_what_was_found_stays_mended(path, folder, small):
    case = {
        file.relative_to(path).as_posix(): file.read_bytes()
        for file in path.rglob("*")
        if file.is_file()
    }
    ending = small.submit(tried_afresh, path.parent.name, folder, case).result(60.0)
    assert not ending.fault, ending.fault
    assert ending.memory < 3e8


@pytest.mark.parametrize("kind", [Compile, Verify, Upload])
def test_commands_that_are_ended_leave_nothing_behind(kind, tmp_path):
    if not Path("/proc/self/environ").exists():
        pytest.skip("processes are found by /proc")
    assert list(campaign(kind(tmp_path / "it"), tuple(SIGNALS), 6)) == []


@pytest.mark.parametrize(("kind", "steps"), [(Verify, 4), (Upload, 3)])
def test_commands_whose_disk_fills_up_say_so_and_keep_the_former(kind, steps, tmp_path):
    if not Path("/proc/self/environ").exists():
        pytest.skip("processes are found by /proc")
    assert list(filling(kind(tmp_path / "it"), steps)) == []


@pytest.mark.parametrize("step", range(30))
def test_a_disk_that_fills_up_at_any_instant_leaves_the_former(
    step, tmp_path, monkeypatch
):
    def result(word):
        manifest = f'{{"fleet": "x", "versions": {{"showc": "{word}"}}, '
        manifest += '"missions": {"files": {"missions/1": "", "missions/2": ""}}}'
        return {
            "manifest.json": manifest.encode(),
            "missions/1": word.encode(),
            "missions/2": word.encode(),
        }

    def write(stream):
        for _ in range(10):
            stream.write(b"x" * 100_000)

    log = tmp_path / "night.mcap"
    place(log, write, result("first"))
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    steps = iter(range(1000))
    full = []

    def counted(real):
        def call(*given, **named):
            if next(steps) == step:
                full.append(step)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return real(*given, **named)

        return call

    monkeypatch.setattr("showc.pipeline.artifact.WRITERS", 1)
    monkeypatch.setattr(os, "fsync", counted(os.fsync))
    for name in ("open", "mkdir", "rename", "replace", "touch"):
        monkeypatch.setattr(Path, name, counted(getattr(Path, name)))
    said = ""
    try:
        place(log, write, result("second"))
    except UsageError as error:
        said = str(error)
    monkeypatch.undo()
    after = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert (after == before) == bool(full)
    assert bool(said) == bool(full)
    assert not said or "No space left on device; former files are whole" in said
    assert len(after) == len(before)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device")
@pytest.mark.parametrize("form", ["text", "json"])
def test_output_to_a_full_disk_is_one_sentence(form):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "showc",
                "check",
                "shows/swap.yaml",
                "--format",
                form,
            ],
            cwd=ROOT,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "No space left on device" in done.stderr
