"""An interrupted compile goes on where it stopped, within a leg, too."""

import os
import pickle
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from fleet.handmade import make_leg, make_options, make_show

from showc.fleet import solve_itinerary
from showc.fleet.execution.checkpoints import Checkpointing, _read
from showc.fleet.execution.pool import InProcess, Processes
from showc.flight import Trajectory
from showc.plan.itinerary import Itinerary
from showc.progress import Silent
from showc.trajectory import PiecewisePolynomial

KEY = "ab" * 32


def flight(number, scale):
    """Something like a result, and a note that the work was done."""
    with Path(scale[1]).open("a", encoding="ascii") as log:
        log.write(f"{number}\n")
    breaks = np.array([0.0, 1.0])
    state = np.full((1, 2, 12), number * scale[0])
    return (
        "straight",
        Trajectory(
            PiecewisePolynomial(breaks, state),
            PiecewisePolynomial(breaks, state[:, :, :4]),
        ),
        "",
    )


@dataclass
class Interrupted:
    """Workers that are stopped after some tasks."""

    after: int

    def prepare(self):
        """Nothing to start."""

    def run(self, function, tasks, _, found):
        for number, task in enumerate(tasks):
            if self.after == 0:
                raise KeyboardInterrupt
            self.after -= 1
            found(number, function(*task))
        return InProcess().run(function, tasks)


def same(one, other):
    return (
        one[0] == other[0]
        and np.array_equal(one[1].state.coefficients, other[1].state.coefficients)
        and np.array_equal(one[1].control.breaks, other[1].control.breaks)
    )


def test_what_was_found_before_the_interrupt_is_not_done_again(tmp_path):
    log, folder = tmp_path / "log", tmp_path / "parts"
    tasks = [(number, (0.1, str(log))) for number in range(7)]
    with pytest.raises(KeyboardInterrupt):
        Checkpointing(Interrupted(3), folder, KEY).run(flight, tasks)
    assert len(list(folder.iterdir())) == 3
    again = Checkpointing(InProcess(), folder, KEY)
    told = []
    results = again.run(flight, tasks, told.append)
    assert log.read_text().split() == [str(number) for number in range(7)]
    assert sum(told) == 7
    for result, task in zip(results, tasks, strict=True):
        assert same(result, flight(*task))
    again.forget()
    assert not folder.exists()


def test_other_legs_and_other_tasks_have_parts_of_their_own(tmp_path):
    log = tmp_path / "log"
    for key, scale in ((KEY, 0.1), ("cd" * 32, 0.1), (KEY, 0.2)):
        pool = Checkpointing(InProcess(), tmp_path / "parts", key)
        (result,) = pool.run(flight, [(1, (scale, str(log)))])
        assert result[1].state.coefficients[0, 0, 0] == scale
    assert len(log.read_text().split()) == 3


def test_what_a_function_was_given_beforehand_counts(tmp_path):
    log = tmp_path / "log"
    for scale in (0.1, 0.2, 0.1):
        pool = Checkpointing(InProcess(), tmp_path / "parts", KEY)
        (result,) = pool.run(partial(flight, scale=(scale, str(log))), [(1,)])
        assert result[1].state.coefficients[0, 0, 0] == scale
    assert len(log.read_text().split()) == 2
    # What has no name is done, and not kept.
    (found,) = pool.run(Nameless(), [(7,)])
    assert found == 8


class Nameless:
    """Something that can be called and has no name of its own."""

    def __call__(self, number):
        return number + 1


def test_processes_tell_every_result_by_its_number():
    found = {}
    pool = Processes(2)
    try:
        results = pool.run(
            divmod, [(n, 7) for n in range(40)], lambda _: None, found.__setitem__
        )
    finally:
        pool.close()
    assert [found[number] for number in range(40)] == results


@pytest.mark.parametrize("damage", ["cut", "flip", "foreign"])
def test_a_strange_part_counts_as_absent_and_goes(tmp_path, damage):
    folder = tmp_path / "parts"
    tasks = [(1, (0.1, str(tmp_path / "log")))]
    Checkpointing(InProcess(), folder, KEY).run(flight, tasks)
    (path,) = folder.iterdir()
    content = path.read_bytes()
    if damage == "cut":
        path.write_bytes(content[:-1])
    elif damage == "flip":
        path.write_bytes(content[:-9] + bytes([content[-9] ^ 1]) + content[-8:])
    else:
        from showc.fleet.execution import checkpoints

        made = tmp_path / "made"
        checkpoints._write(path, Maker(str(made)))
        assert _read(path) is None
        assert not made.exists()
    assert _read(path) is None
    assert not path.exists()


@dataclass
class Maker:
    """A pickle that would make a folder when it is read."""

    place: str

    def __reduce__(self):
        return os.mkdir, (self.place,)


def test_the_foreign_part_is_a_real_threat(tmp_path):
    pickle.loads(pickle.dumps(Maker(str(tmp_path / "made"))))  # noqa: S301
    assert (tmp_path / "made").exists()


@pytest.mark.slow
def test_an_interrupted_leg_leaves_parts_and_a_finished_one_none(tmp_path, monkeypatch):
    start = np.array([[0.0, 0.0, 10.0], [3.0, 0.0, 10.0], [6.0, 0.0, 10.0]])
    goal = start + [[0.0, 6.0, 1.0], [0.0, 5.0, 0.5], [0.0, 7.0, 2.0]]
    leg = make_leg(start, goal)
    itinerary = Itinerary(make_show(3), (leg,))
    options = make_options(use_cache=True, cache=tmp_path, jobs=1)
    calls = []
    run = InProcess.run

    def counted(self, function, tasks, done, found=lambda _, __: None):
        def stop(number, value):
            found(number, value)
            calls.append(function.__name__)
            if len(calls) == 2:
                raise KeyboardInterrupt

        return run(self, function, tasks, done, stop)

    monkeypatch.setattr(InProcess, "run", counted)
    with pytest.raises(KeyboardInterrupt):
        solve_itinerary(itinerary, options, Silent())
    assert len(list(tmp_path.rglob("*.part"))) == 2
    resumed = solve_itinerary(itinerary, options, Silent())
    total = len(calls)
    assert list(tmp_path.rglob("*.part")) == []
    assert len(list(tmp_path.rglob("*.leg"))) == 1
    calls[:] = [""] * 10
    fresh = solve_itinerary(itinerary, make_options(use_cache=False, jobs=1), Silent())
    assert total == len(calls) - 10  # nothing was done twice
    for one, other in zip(
        resumed.legs[0].trajectories, fresh.legs[0].trajectories, strict=True
    ):
        assert np.array_equal(one.state.coefficients, other.state.coefficients)
