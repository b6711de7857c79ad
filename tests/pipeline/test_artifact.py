"""Results are placed all or nothing, whatever interrupts them."""

import json
import multiprocessing
import os
import signal
import stat
from pathlib import Path

import pytest

from showc.errors import UsageError
from showc.files import write_file
from showc.pipeline.artifact import folder_of, place, prepare


def write(content):
    return lambda stream: stream.write(content)


def tree(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def result(mission, content):
    """Content of the folder beside the log, listed in its manifest."""
    manifest = {"fleet": "x", "versions": {"showc": "1"}}
    manifest["missions"] = {"files": {mission: "hash"}}
    return {"manifest.json": json.dumps(manifest).encode(), mission: content}


FIRST = result("missions/drone_0001.waypoints", b"one")
SECOND = result("missions/drone_0002.waypoints", b"two")


def test_new_results_replace_all_of_the_former(tmp_path):
    log = tmp_path / "night.mcap"
    place(log, write(b"first"), FIRST)
    place(log, write(b"second"), SECOND)
    assert tree(tmp_path) == {
        "night.mcap": b"second",
        "night/manifest.json": SECOND["manifest.json"],
        "night/missions/drone_0002.waypoints": b"two",
    }


class Interruption(BaseException):
    pass


def test_an_interrupted_log_leaves_the_former_whole(tmp_path):
    log = tmp_path / "night.mcap"
    place(log, write(b"first"), FIRST)
    before = tree(tmp_path)

    def cut(stream):
        stream.write(b"half")
        raise Interruption

    with pytest.raises(Interruption):
        place(log, cut, SECOND)
    assert tree(tmp_path) == before


@pytest.mark.parametrize("failing", range(3))
def test_an_interrupted_exchange_is_undone(tmp_path, monkeypatch, failing):
    log = tmp_path / "night.mcap"
    place(log, write(b"first"), FIRST)
    before = tree(tmp_path)
    count = 0
    real_rename, real_replace = Path.rename, Path.replace

    def counted(real):
        def move(self, target):
            nonlocal count
            count += 1
            if count == failing + 1:
                raise Interruption
            return real(self, target)

        return move

    monkeypatch.setattr(Path, "rename", counted(real_rename))
    monkeypatch.setattr(Path, "replace", counted(real_replace))
    with pytest.raises(Interruption):
        place(log, write(b"second"), SECOND)
    assert tree(tmp_path) == before


def test_a_full_or_forbidden_folder_is_a_message(tmp_path):
    if os.geteuid() == 0:
        target = tmp_path / "file"
        target.write_bytes(b"in the way")
        log = target / "night.mcap"
    else:
        tmp_path.chmod(0o500)
        log = tmp_path / "night.mcap"
    with pytest.raises(UsageError, match="cannot write"):
        place(log, write(b"first"), FIRST)


FOREIGN = {
    "no manifest": {"thesis.txt": b"important"},
    "another manifest": {"manifest.json": b'{"name": "app"}', "app.js": b"1"},
    "a manifest that is a list": {"manifest.json": b"[]"},
    "a manifest nested deep": {"manifest.json": b"[" * 100_000},
    "a manifest of noise": {"manifest.json": bytes(range(256))},
    "a file among ours": {**FIRST, "thesis.txt": b"important"},
    "a file among the missions": {**FIRST, "missions/notes.txt": b"important"},
}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_folder_of_somebody_else_is_left_alone(name, tmp_path):
    for path, content in FOREIGN[name].items():
        target = tmp_path / "night" / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
    before = tree(tmp_path)
    log = tmp_path / "night.mcap"
    for attempt in (lambda: place(log, write(b"new"), SECOND), lambda: prepare(log)):
        with pytest.raises(UsageError, match="not a folder that showc wrote"):
            attempt()
        assert tree(tmp_path) == before


def killed_at(log, step):
    """Place a result in a process that is killed at a step of the exchange."""
    if os.fork():
        _, status = os.wait()
        assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL
        return
    steps = iter(range(100))
    for name in ("rename", "replace", "touch"):
        real = getattr(Path, name)

        def counted(self, *given, real=real):
            if next(steps) == step:
                os.kill(os.getpid(), signal.SIGKILL)
            return real(self, *given)

        setattr(Path, name, counted)
    place(log, write(b"second"), SECOND)
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("before", [True, False])
@pytest.mark.parametrize("step", range(5))
def test_what_a_kill_left_is_whole_after_the_next_run(tmp_path, step, before):
    log = tmp_path / "night.mcap"
    if before:
        place(log, write(b"first"), FIRST)
    former = tree(tmp_path)
    place(tmp_path / "new" / "night.mcap", write(b"second"), SECOND)
    new = tree(tmp_path / "new")
    (tmp_path / "out").mkdir()
    for path in list(tmp_path.iterdir()):
        if path.name not in {"out", "new"}:
            path.rename(tmp_path / "out" / path.name)
    killed_at(tmp_path / "out" / "night.mcap", step)
    prepare(tmp_path / "out" / "night.mcap")
    assert tree(tmp_path / "out") in (former, new)
    assert not [item for item in (tmp_path / "out").iterdir() if item.name[0] == "."]


def test_stages_of_others_that_still_work_are_left_alone(tmp_path):
    log = tmp_path / "night.mcap"

    def both(stream):
        stream.write(b"slow")
        place(log, write(b"quick"), SECOND)
        assert tree(tmp_path)["night.mcap"] == b"quick"

    place(log, both, FIRST)
    assert tree(tmp_path) == {
        "night.mcap": b"slow",
        **{f"night/{name}": content for name, content in FIRST.items()},
    }


def _place_often(log, number):
    for _ in range(20):
        content = result(f"missions/{number}.waypoints", b"%d" % number)
        place(log, write(b"%d" % number), content)


def test_two_processes_with_one_output_leave_one_whole_result(tmp_path):
    log = tmp_path / "night.mcap"
    context = multiprocessing.get_context("fork")
    crew = [
        context.Process(target=_place_often, args=(log, number)) for number in (1, 2)
    ]
    for process in crew:
        process.start()
    for process in crew:
        process.join()
        assert process.exitcode == 0
    number = log.read_bytes()
    (mission,) = (tmp_path / "night" / "missions").iterdir()
    assert mission.read_bytes() == number
    assert sorted(path.name for path in tmp_path.iterdir()) == ["night", "night.mcap"]


def test_a_link_with_the_name_of_a_stage_is_not_followed(tmp_path):
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.txt").write_text("important")
    link = tmp_path / ".night.mcap.abcdefgh.showc-part"
    link.symlink_to(precious)
    place(tmp_path / "night.mcap", write(b"first"), FIRST)
    assert (precious / "thesis.txt").read_text() == "important"


def test_a_device_is_not_replaced_by_a_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UsageError, match="no regular file"):
        write_file(tmp_path / "pipe", b"1")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


@pytest.mark.parametrize("name", ["night", "night.bag", ".mcap"])
def test_the_output_must_be_a_log(name):
    with pytest.raises(UsageError, match=r"does not end in \.mcap"):
        folder_of(Path(name))


def test_a_single_file_is_whole_and_readable_by_others(tmp_path):
    path = tmp_path / "deep" / "show.yaml"
    write_file(path, b"showc: 1")
    assert path.read_bytes() == b"showc: 1"
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask
    assert [item.name for item in path.parent.iterdir()] == ["show.yaml"]
