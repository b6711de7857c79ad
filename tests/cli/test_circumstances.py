"""Commands under odd circumstances: right, or one clear sentence."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from fuzz.accidents import PAIR
from repository import ROOT

from showc import files
from showc.__main__ import _answer
from showc.errors import UsageError
from showc.files import scratch
from showc.fleet.execution import pool
from showc.script import read_show
from showc.script.render import render

SHOWC = [sys.executable, "-m", "showc"]
SETPRIV = shutil.which("setpriv")
STRANGER = [
    *("setpriv", "--reuid", "12345", "--regid", "12345", "--clear-groups"),
    *("--inh-caps", "+dac_read_search", "--ambient-caps", "+dac_read_search"),
]
"""A user without a name, who may read what the tests are made of."""
WEAK = ["setpriv", "--bounding-set=-dac_override,-dac_read_search,-fowner"]
"""The superuser, held to the permissions of files."""


def ran(command, folder, **environment):
    """Run a command; its exit code and what it said, no report left behind."""
    kept = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run(
        command,
        cwd=folder,
        env={name: value for name, value in kept.items() if value is not None},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert "Traceback" not in done.stderr
    assert not (folder / "showc-crash.txt").exists()
    return done.returncode, done.stdout + done.stderr


def compile_(log, *more):
    return [*SHOWC, "compile", "pair.yaml", "-o", str(log), "-q", "-j", "2", *more]


@pytest.fixture
def folder(tmp_path, cache, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    (tmp_path / "pair.yaml").write_text(PAIR)
    return tmp_path


def opened(folder):
    """Let a stranger in, up to the folder of all tests' folders."""
    for path in (folder, *folder.parents[:3]):
        path.chmod(0o755)
    folder.chmod(0o777)


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", "<&- >&- 2>&-"])
def test_streams_that_are_closed_are_no_fault(closed, folder):
    # A script with findings, so that there is something to say.
    (folder / "odd.yaml").write_text(PAIR + "nothing: 1\n")
    for script, code in (("pair.yaml", 0), ("odd.yaml", 1)):
        command = f'exec "$0" -m showc check {script} {closed}'
        assert ran(["sh", "-c", command, sys.executable], folder)[0] == code


def test_a_log_takes_the_place_of_no_stream_that_is_closed(folder):
    closed = "<&- >&- 2>&-"
    log = 'exec "$0" -m showc compile pair.yaml -o it.mcap -j 1'
    code, said = ran(["sh", "-c", f"{log} {closed}", sys.executable], folder)
    assert code == 0, said
    assert ran([*SHOWC, "verify", "it.mcap", "-q"], folder)[0] == 0


@pytest.mark.parametrize("place", ["absent", "long"])
def test_the_folder_for_temporary_files_may_be_odd(place, folder):
    there = folder / ("x" * 120 if place == "long" else "absent")
    if place == "long":
        there.mkdir()
    code, said = ran(compile_("it.mcap", "--no-cache"), folder, TMPDIR=str(there))
    assert code == 0, said
    assert place == "absent" or list(there.iterdir()) == []


@pytest.mark.skipif(
    SETPRIV is None or os.geteuid() != 0, reason="only the superuser changes users"
)
def test_a_user_without_home_and_name_compiles_and_verifies(folder):
    opened(folder)
    given = {"HOME": None, "XDG_CACHE_HOME": None, "USER": None}
    code, said = ran([*STRANGER, *compile_("it.mcap")], folder, **given)
    assert code == 0, said
    assert ran([*STRANGER, *SHOWC, "verify", "it.mcap"], folder, **given)[0] == 0


@pytest.mark.skipif(
    SETPRIV is None or os.geteuid() != 0, reason="only the superuser changes users"
)
def test_a_cache_serves_two_users_and_one_that_may_not_write(folder):
    opened(folder)
    cache = folder / "cache"
    cache.mkdir()
    cache.chmod(0o777)
    given = ["--cache-dir", str(cache)]
    logs = []
    for number, user in enumerate(([], STRANGER, WEAK)):
        if user is WEAK:
            # Nobody writes there any more, and what it lacks is solved.
            next(cache.rglob("*.leg")).unlink()
            for path in (cache, *cache.glob("*")):
                path.chmod(0o555)
        before = sorted(cache.rglob("*"))
        code, said = ran([*user, *compile_(f"{number}.mcap", *given)], folder)
        assert code == 0, said
        assert number == 0 or sorted(cache.rglob("*")) == before
        logs.append((folder / f"{number}.mcap").read_bytes())
    assert logs[0] == logs[1] == logs[2]


@pytest.mark.parametrize("where", ["show-vviz", "show.mcap"])
def test_what_is_in_the_way_is_said_before_anything_is_solved(folder, where):
    (folder / "pair.yaml").write_text(PAIR + "exports: [{to: vviz}]\n")
    (folder / where).mkdir()
    (folder / where / "mine.txt").write_text("mine")
    command = [*SHOWC, "compile", "pair.yaml", "-o", "show.mcap"]
    code, said = ran(command, folder)
    assert code == 2, said
    assert f"'{where}' " in said and "with -o" in said
    assert "solving" not in said
    assert {path.name for path in folder.iterdir()} == {"pair.yaml", where}


def test_two_compiles_to_one_output_leave_one_of_them_whole(folder):
    (folder / "other.yaml").write_text(PAIR.replace("0, 3, 5", "0, 3, 6"))
    both = [
        subprocess.Popen(
            [*SHOWC, "compile", script, "-o", "it.mcap", "-q", "-j", "1"],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        for script in ("pair.yaml", "other.yaml")
    ]
    for process in both:
        _, said = process.communicate(timeout=300)
        assert process.returncode == 0, said
    assert ran([*SHOWC, "verify", "it.mcap", "-q"], folder)[0] == 0
    assert {path.name for path in folder.iterdir()} == {
        *("pair.yaml", "other.yaml", "it.mcap", "it"),
    }


def test_scratch_folders_of_the_dead_are_cleared_and_those_of_the_living_kept(
    tmp_path,
):
    (tmp_path / ".showc-abcdefgh" / "inner").mkdir(parents=True)
    (tmp_path / ".showc-abcdefgh" / "inner" / "file").write_text("x")
    strange = tmp_path / ".showc-of-others"
    strange.mkdir()
    with scratch(tmp_path) as one:
        (one / "kept").write_text("x")
        with scratch(tmp_path) as other:
            assert (one / "kept").exists()
            assert set(tmp_path.iterdir()) == {one, other, strange}
    assert list(tmp_path.iterdir()) == [strange]


def test_a_copy_of_a_process_leaves_its_scratch_folder_alone(tmp_path):
    context = scratch(tmp_path)
    folder = context.__enter__()
    copy = os.fork()
    if copy == 0:
        del context
        os._exit(0)
    os.waitpid(copy, 0)
    assert folder.exists()
    context.__exit__(None, None, None)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_another_process_keeps_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "_LONGEST_CHANGE", 0.1)
    with (
        files.alone(tmp_path),
        pytest.raises(UsageError, match=r"another process holds .* locked; former"),
    ):
        files.write_file(tmp_path / "it", b"new")
    files.write_file(tmp_path / "it", b"new")
    assert (tmp_path / "it").read_bytes() == b"new"


def test_what_is_half_written_in_a_cache_is_cleared(tmp_path):
    for name in (
        "ab/.x.leg.abcdefgh.showc-part",
        "ab/y.parts/.z.part.12345678.showc-part",
    ):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "ab" / "x.leg").write_text("")
    files.clear_all(tmp_path / "ab")
    files.clear_all(tmp_path / "ab" / "y.parts")
    files.clear_all(tmp_path / "not there")
    left = {path.name for path in tmp_path.rglob("*")}
    assert left == {"ab", "x.leg", "y.parts"}


def die(number):
    os._exit(number)


def test_workers_that_die_again_and_again_are_one_sentence(monkeypatch):
    monkeypatch.setattr(pool, "_DEATHS", 0)
    crew = pool.Processes(2)
    try:
        with pytest.raises(UsageError, match=r"processes died 1 times.*--jobs"):
            crew.run(die, [(1,), (2,)])
    finally:
        crew.close()


def test_a_system_without_more_threads_is_one_sentence(capfd):
    assert _answer(RuntimeError("can't start new thread"), []) == 2
    said = capfd.readouterr().err
    assert "no more threads" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("style", ["text", "github"])
@pytest.mark.parametrize(
    "line",
    [
        b'"\\e]0;me\\a": 1',
        b'drones: "\\e[31m7"',
        b"name: \x1b[31mred",
        b"\xe2\x80\xaeeman: 1",
        b"name: \xc2\x9b31m",
    ],
)
def test_findings_do_not_steer_terminals(style, line):
    result = read_show(PAIR.encode() + line + b"\n")
    said = render(result.diagnostics, {result.path: result.text}, style)
    assert result.diagnostics
    assert all(sign.isprintable() or sign == "\n" for sign in said)
    assert Path("showc-crash.txt").exists() is False


def test_a_control_character_is_named_by_its_code():
    result = read_show(PAIR.encode() + b"name: \x1b[31mred\n")
    assert "code 0x1b" in result.diagnostics[0].message


@pytest.mark.parametrize("time", ["1e308", "86401", "1e9"])
def test_times_beyond_any_show_are_findings(time):
    text = PAIR.replace("[it]", f"[{{to: it, at: {time}}}]")
    (found,) = read_show(text.encode()).errors
    assert found.code == "SHW104"
    assert "at most 86400 s" in found.message
