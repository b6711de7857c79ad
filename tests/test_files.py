"""What is read of a folder that others may have made."""

from showc.files import read_files, strangers


def test_files_are_read_whole_and_what_cannot_be_read_is_named(tmp_path):
    (tmp_path / "one").write_bytes(b"1234")
    (tmp_path / "two").mkdir()
    (tmp_path / "three").write_bytes(b"12345")
    contents, wrong = read_files(tmp_path, ["one", "two", "three", "four"], 4, 100)
    assert contents == {"one": b"1234", "two": b"", "three": b"", "four": b""}
    said = [
        "two: cannot be read: it is a folder; expected a regular file",
        "three: cannot be read: it has 5 bytes, at most 4 are read",
        "four: cannot be read: No such file or directory",
    ]
    assert wrong == said


def test_files_are_read_up_to_their_greatest_sum(tmp_path):
    for name in ("one", "two", "three"):
        (tmp_path / name).write_bytes(b"1234")
    contents, wrong = read_files(tmp_path, ["one", "two", "three"], 4, 8)
    assert (list(contents), wrong) == (
        ["one", "two"],
        ["three: the files up to here are too large in sum"],
    )
    assert read_files(tmp_path, ["one", "two"], 4, 8)[1] == []


def test_strangers_are_what_is_not_known_in_the_folders_that_are_looked_into(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "other" / "deep").mkdir(parents=True)
    for path in (tmp_path / "known", inner / "known", inner / "odd", tmp_path / "odd"):
        path.touch()
    found = strangers(tmp_path, ["inner"], ["known", "inner/known"])
    assert found == ["inner/odd", "odd", "other"]


def test_a_link_in_place_of_a_folder_is_a_stranger(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "show").mkdir()
    (tmp_path / "show" / "inner").symlink_to(tmp_path / "elsewhere")
    assert strangers(tmp_path / "show", ["inner"], []) == ["inner"]
