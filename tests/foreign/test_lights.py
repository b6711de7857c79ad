"""Light programs that are made to take long, and honest ones that are long."""

from __future__ import annotations

import numpy as np
import pytest

from showc.errors import DamagedFileError
from showc.foreign.firmware import Firmware, what_it_becomes
from showc.foreign.lights import MOST_COMMANDS, Budget, read_lights
from showc.foreign.script import colours_at
from showc.foreign.show import Course, ForeignShow, fleet

FOR_EVER, AGAIN = bytes([12, 0]), bytes([13, 0])
GREY = bytes([5, 9, 1])
"""One frame of grey."""


def standing(*programs):
    course = Course(np.array([0.0, 60.0]), np.zeros((1, 1, 3)))
    names = tuple(f"d{number}" for number in range(len(programs)))
    tracks = fleet([course] * len(programs))
    return ForeignShow("x.skyc", ".skyc", "x", names, tracks, lights=programs)


def test_a_flood_of_colours_within_one_instant_is_a_finding():
    flood = FOR_EVER + bytes([4, 1, 2, 3, 0]) * 250 + bytes([2, 1]) + AGAIN
    found = what_it_becomes(standing(flood), Firmware())
    lights = next(check for check in found if check.code == "VRF547")
    assert lights.verdict == "fail" and "with one colour an instant" in lights.notes[0]


def test_the_programs_of_a_show_have_one_budget():
    loop = FOR_EVER + GREY + AGAIN
    budget = Budget(700)
    for _ in range(3):
        read_lights(loop, "d1", 2.0, budget)
    with pytest.raises(DamagedFileError, match=r"d4: .* more than 700 commands"):
        read_lights(loop, "d4", 2.0, budget)


def test_programs_without_loops_never_exceed_their_budget():
    programs = [GREY[:1] + bytes([number, 1]) * 2 for number in range(9)]
    assert Budget.of([*programs, None]).most == MOST_COMMANDS
    long = bytes([6, 1]) * (MOST_COMMANDS // 2)
    assert Budget.of([long, long, long]).most == MOST_COMMANDS * 3 // 2


def test_a_show_is_played_once_however_often_its_colours_are_asked(monkeypatch):
    played = []
    monkeypatch.setattr(
        "showc.foreign.script.read_lights",
        lambda *given: played.append(given) or read_lights(*given),
    )
    show = standing(GREY + b"\0", None)
    for _ in range(3):
        assert colours_at(show, np.array([0.0])).shape == (1, 2, 3)
    assert len(played) == 1
