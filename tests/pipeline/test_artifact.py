"""Results are placed all or nothing, whatever interrupts them."""

import os
import stat
from pathlib import Path

import pytest

from showc.errors import UsageError
from showc.pipeline.artifact import folder_of, place, write_file


def write(content):
    return lambda stream: stream.write(content)


def tree(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


FIRST = {"manifest.json": b"1", "missions/drone_0001.waypoints": b"one"}
SECOND = {"manifest.json": b"2", "missions/drone_0002.waypoints": b"two"}


def test_new_results_replace_all_of_the_former(tmp_path):
    log = tmp_path / "night.mcap"
    place(log, write(b"first"), FIRST)
    place(log, write(b"second"), SECOND)
    assert tree(tmp_path) == {
        "night.mcap": b"second",
        "night/manifest.json": b"2",
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


def test_a_folder_of_somebody_else_is_left_alone(tmp_path):
    (tmp_path / "night").mkdir()
    (tmp_path / "night" / "thesis.txt").write_text("important")
    with pytest.raises(UsageError, match="not a folder that showc wrote"):
        place(tmp_path / "night.mcap", write(b"first"), FIRST)
    assert tree(tmp_path) == {"night/thesis.txt": b"important"}


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
