"""The command line's contract: exit codes, streams, no traceback for a user's fault."""

import json
import os
import shutil
import signal
import subprocess
import sys

import pytest
from repository import ROOT

GRID = ROOT / "shows" / "grid.yaml"
VERBS = (
    "init", "check", "plan", "compile", "verify", "view", "report", "diff", "upload",
    "stream", "compare", "explain", "schema", "completion",
)  # fmt: skip


def test_codes_that_no_finding_has_are_refused(run_showc):
    run = run_showc("check", GRID, "--select", "SHW9")
    assert run.code == 2
    assert "--select SHW9: no finding's code begins so" in run.err
    assert run_showc("check", GRID, "--ignore", "SHW3").code == 0


def test_help_names_every_verb(run_showc):
    run = run_showc("--help")
    assert run.code == 0
    for verb in VERBS:
        assert f"\n  {verb} " in run.out


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help(run_showc, verb):
    run = run_showc(verb, "--help")
    assert run.code == 0
    assert f"showc {verb}" in run.out
    assert len(run.out) > 200


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["chekc", "x.yaml"], "did you mean 'check'"),
        (["check"], "Missing argument"),
        (["check", "nowhere.yaml"], "nowhere.yaml"),
        (["compile", "nowhere.yaml"], "nowhere.yaml"),
        (["compile", str(GRID), "-o", "night.bag"], "does not end in .mcap"),
        (["compile", str(GRID), "--start", "tomorrow"], "is no time"),
        (["compile", str(GRID), "--start", "2026-06-01T20:00"], "no time zone"),
        (["compile", str(GRID), "--jobs", "0"], "jobs"),
        (["safety", "nowhere.mcap", "--wind", "nan"], "not a finite number"),
        (["verify", "nowhere.skyc", "--separation", "nan"], "not a finite number"),
        (["import", "x.skyc", "-o", "a.yaml", "--at", "nan"], "no list of seconds"),
        (["import", "x.skyc", "-o", "a.yaml", "--moving", "1-inf"], "no stretch"),
        (["simulate", "nowhere.mcap", "--runs", "x"], "not a valid whole number"),
        (["verify", str(GRID), "--separation", "9"], "proved against its script"),
        (["verify", "nowhere.mcap"], "nowhere.mcap"),
        (["view", "nowhere.mcap"], "nowhere.mcap"),
        (["explain", "SHW999"], "no code"),
        (["completion", "tcsh"], "tcsh"),
    ],
)
def test_wrong_usage_is_two_and_says_why(run_showc, tmp_path, arguments, words):
    run = run_showc(*arguments, cwd=tmp_path)
    assert run.code == 2
    assert words in run.err + run.out
    assert "Traceback" not in run.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "content",
    [b"", b"\x89MCAP0\r\n", b"not a log at all", bytes(4096)],
    ids=["empty", "magic", "text", "zeros"],
)
@pytest.mark.parametrize("verb", ["verify", "view", "report"])
def test_damaged_logs_are_two(run_showc, tmp_path, verb, content):
    log = tmp_path / "damaged.mcap"
    log.write_bytes(content)
    run = run_showc(verb, log)
    assert run.code == 2
    assert "damaged.mcap" in run.err + run.out
    assert "Traceback" not in run.err


def test_a_script_with_findings_is_one(run_showc, tmp_path):
    script = tmp_path / "bad.yaml"
    script.write_text(GRID.read_text().replace("columns:", "colums:"))
    for verb in ("check", "compile", "plan"):
        run = run_showc(verb, script, cwd=tmp_path)
        assert run.code == 1
        said = run.out + run.err
        assert "colums" in said and "did you mean" in said and "bad.yaml:" in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.yaml"]


def test_no_colour_in_a_pipe_and_none_where_refused(run_showc, tmp_path):
    script = tmp_path / "bad.yaml"
    script.write_text(GRID.read_text().replace("columns:", "colums:"))
    assert "\x1b[" not in run_showc("check", script).out
    forced = run_showc("check", script, env={"FORCE_COLOR": "1"})
    assert "\x1b[" in forced.out
    refused = run_showc("check", script, env={"FORCE_COLOR": "1", "NO_COLOR": "1"})
    assert "\x1b[" not in refused.out


def test_init_writes_a_script_that_checks(run_showc, tmp_path):
    assert run_showc("init", "mine.yaml", cwd=tmp_path).code == 0
    assert run_showc("check", "--strict", "mine.yaml", cwd=tmp_path).code == 0
    again = run_showc("init", "mine.yaml", cwd=tmp_path)
    assert again.code == 2 and "exists" in again.err


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_name_showc(run_showc, shell):
    assert "_SHOWC_COMPLETE" in run_showc("completion", shell).out


@pytest.mark.slow
def test_results_go_to_stdout_and_progress_to_stderr(run_showc, tmp_path):
    """Also what libraries would print while they solve."""
    log = tmp_path / "grid.mcap"
    run = run_showc("compile", GRID, "-o", log, "--json", "--no-cache")
    assert run.code == 0
    assert json.loads(run.out)["manifest"]["drones"] == 6
    lines = [json.loads(line) for line in run.err.splitlines()]
    assert lines and all({"elapsed", "stage", "done", "total"} <= set(x) for x in lines)
    plain = run_showc("compile", GRID, "-o", tmp_path / "grid.mcap")
    assert "next: showc verify" in plain.out
    assert "log" in plain.err and "log\n" not in plain.out.splitlines()[0]


@pytest.mark.slow
def test_an_interrupted_compile_leaves_the_former_files(run_showc, compiled, tmp_path):
    log = tmp_path / "grid.mcap"
    compiled("grid")
    assert run_showc("compile", GRID, "-o", log).code == 0
    before = {
        path.relative_to(tmp_path): path.read_bytes()
        for path in tmp_path.rglob("*")
        if path.is_file()
    }
    process = subprocess.Popen(
        [sys.executable, "-m", "showc", "compile", str(GRID), "-o", str(log),
         "--no-cache"],
        stderr=subprocess.PIPE, env=os.environ, start_new_session=True, text=True,
    )  # fmt: skip
    for line in process.stderr:
        if "in parallel" in line:  # its legs are under way
            break
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    after = {
        path.relative_to(tmp_path): path.read_bytes()
        for path in tmp_path.rglob("*")
        if path.is_file()
    }
    assert after == before


def test_a_leg_is_drawn_into_the_page_that_the_help_names(
    compiled, run_showc, tmp_path
):
    shutil.copy(compiled("lanes"), tmp_path / "lanes.mcap")
    run = run_showc("report", "lanes.mcap", "--leg", 1, "--drone", 2, cwd=tmp_path)
    assert run.code == 0, run.err
    assert (tmp_path / "lanes-leg-1-drone-2.html").is_file()
    said = "".join(run_showc("report", "--help").out.split())
    assert "OUTPUT-leg-N-drone-N.html" in said
