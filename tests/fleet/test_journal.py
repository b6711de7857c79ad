"""What is said side by side is heard while the work goes on."""

from fleet.handmade import Listening

from showc.fleet.execution import journal as module
from showc.fleet.execution.journal import Journal, Journals, journals


def test_the_last_new_line_of_each_task_is_passed_on(tmp_path):
    listening = Listening()
    kept = Journals(tmp_path, ["one", "two"], listening)
    first, second = (Journal(path) for path in kept.paths)
    kept.listen()
    assert listening.notes == []
    first.note("one: conflicts left: 3")
    first.note("one: conflicts left: 2")
    second.note("two: found 3.5 s")
    kept.listen()
    kept.listen()
    assert listening.notes == [
        "one: conflicts left: 2 (0 s)",
        "two: found 3.5 s (0 s)",
    ]


def test_those_at_work_are_named_where_nothing_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_QUIET", 0.0)
    listening = Listening()
    kept = Journals(tmp_path, ["one", "two", "three"], listening)
    for path in kept.paths[:2]:
        Journal(path)
    kept.close(0)
    kept.listen()
    assert listening.notes == ["after 0 s still solving: two"]


def test_a_task_without_a_file_or_whose_file_is_gone_says_nothing():
    Journal(None).note("unheard")
    with journals(["one"], Listening()) as kept:
        late = Journal(kept.paths[0])
    late.note("too late")
    assert not kept.paths[0].exists()
