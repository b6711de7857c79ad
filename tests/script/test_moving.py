"""Motions of formations: smooth, at rest at both ends, and where they should end."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_reference import held

from showc.script.mark import Mark
from showc.script.moving import moving_places
from showc.script.show import (
    Breathe,
    Follow,
    Formation,
    Morph,
    Orbit,
    Rotate,
    Transition,
    Travel,
    Wave,
)

MARK = Mark("show.yaml", 1, 1, 1, 2)
PLACES = np.array([(8.0, 0, 20), (0, 8, 21), (-8, 0, 22), (0, -8, 23)])
SHAPES = {
    "ring": Formation("ring", PLACES, np.ones((4, 3)), MARK),
    "big": Formation("big", 1.5 * PLACES, np.ones((4, 3)), MARK),
}
X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
MOTIONS = {
    "rotate": Rotate(2.0, (0.6, 0.0, 0.8), None, 3.0),
    "about a point": Rotate(-1.0, Z, (5.0, 5.0, 0.0), 30.0),
    "breathe": Breathe(1.4, 5.0, None, 2.0),
    "wave": Wave(1.0, Z, 4.0, X, 12.0, 3.0),
    "orbit": Orbit(1.5, (0.0, 0.6, 0.8), 6.0, X, float("inf"), 3.0),
    "travel": Travel(((3.0, 0, 0), (3.0, 4, 0), (0.0, 0, 0))),
    "morph": Morph(("big", "ring", "big")),
}
TIME = 20.0
DANCE = PLACES + np.cumsum(
    np.random.default_rng(3).normal(0.0, 0.4, (60, 4, 3)), axis=0
)
MOTIONS["follow"] = Follow("dance.csv", DANCE, 18.0, 2.0)


EVERYONE = np.arange(4)


def asking(*motions, under_way=(False, False)):
    given = {"motion": motions, "under_way": under_way}
    return Transition("to the ring", "ring", TIME, "fixed", MARK, **given)


def placed(transition):
    return moving_places(EVERYONE, EVERYONE, SHAPES["ring"], transition, SHAPES)


def moving(*names, under_way=(False, False)):
    motions = (MOTIONS[name] for name in names)
    return placed(asking(*motions, under_way=under_way))


@given(
    st.lists(st.sampled_from(sorted(MOTIONS)), min_size=1, max_size=4),
    st.tuples(st.booleans(), st.booleans()),
)
@settings(max_examples=30)
def test_derivatives_are_those_of_the_motion(names, under_way):
    motion = moving(*names, under_way=under_way)
    times = np.linspace(0.01, TIME - 0.01, 41)
    step = 1e-4
    exact = motion.derivatives(TIME, times)
    before = motion.derivatives(TIME, times - step)
    after = motion.derivatives(TIME, times + step)
    for order in range(3):
        slope = (after[order] - before[order]) / (2.0 * step)
        assert np.abs(slope - exact[order + 1]).max() < 1e-4 * (
            1.0 + np.abs(exact[order + 1]).max()
        )


@given(
    st.lists(st.sampled_from(sorted(MOTIONS)), min_size=1, max_size=4),
    st.floats(4.0, 60.0),
    st.tuples(st.booleans(), st.booleans()),
)
@settings(max_examples=50, deadline=None)
def test_places_are_those_of_a_second_derivation(names, time, under_way):
    transition = asking(*(MOTIONS[name] for name in names), under_way=under_way)
    wanted = held(transition, EVERYONE, EVERYONE, SHAPES)
    times = np.linspace(0.0, time, 97)
    flown = placed(transition)
    there = flown.derivatives(time, times)[0]
    assert np.abs(wanted.at(times, time) - there).max() < 1e-9
    assert wanted.moves_on == flown.moves_on


def test_frames_that_are_followed_are_met_but_for_what_is_said():
    times = np.linspace(0.0, 18.0, 181)
    path = np.stack([np.sin(times), np.cos(0.7 * times), 0.1 * times], axis=1)
    frames = np.stack([path, 2.0 * path, -path, 0.5 * path], axis=1)
    motion = Follow("it.csv", frames, 18.0, 2.0)
    flown = placed(asking(motion))
    # Over a hold of the frames' time and a ramp, the middle is played as recorded.
    middle = np.linspace(2.0, 18.0, 161)
    found = flown.derivatives(TIME, middle)[0] - PLACES + frames[0]
    off = np.abs(found - frames[10:171]).max()
    assert 1e-4 < off < 0.1**2 / 4.0 * 2.0
    there = flown.ends(TIME)[1][0]
    assert np.abs(there - PLACES - frames[-1] + frames[0]).max() < 1e-12


@given(st.lists(st.sampled_from(sorted(MOTIONS)), min_size=1, max_size=4))
@settings(max_examples=30)
def test_motions_begin_and_end_at_rest(names):
    motion = moving(*names)
    ends = motion.derivatives(TIME, np.array([0.0, TIME]))
    assert np.abs(ends[1:]).max() < 1e-9
    assert np.abs(ends[0, 0] - PLACES).max() < 1e-12
    # Where it ends does not depend on how long it takes.
    assert np.abs(ends[0, 1] - motion.ends(1.0)[1][0]).max() < 1e-12


def test_what_comes_back_and_what_does_not():
    for name in ("breathe", "wave", "orbit"):
        assert not moving(name).moves_on
        assert np.abs(moving(name).ends(TIME)[1][0] - PLACES).max() < 1e-12
    assert np.abs(moving("morph").ends(TIME)[1][0] - 1.5 * PLACES).max() < 1e-12
    turned = moving("rotate").ends(TIME)[1][0]
    middle = 0.5 * (PLACES.min(axis=0) + PLACES.max(axis=0))
    kept = np.linalg.norm(turned - middle, axis=1)
    assert kept == pytest.approx(np.linalg.norm(PLACES - middle, axis=1))
    assert np.abs(turned - PLACES).max() > 1.0


def test_a_breath_reaches_its_size_and_a_rotation_its_even_rate():
    times = np.linspace(0.0, TIME, 4001)
    breath = moving("breathe").derivatives(TIME, times)[0]
    middle = 0.5 * (PLACES.min(axis=0) + PLACES.max(axis=0))
    size = np.linalg.norm(breath[:, 0] - middle, axis=1)
    assert size.max() / size[0] == pytest.approx(1.4, abs=1e-4)
    speed = np.linalg.norm(moving("rotate").derivatives(TIME, times)[1], axis=2)
    assert np.ptp(speed[800:3200], axis=0).max() < 1e-9


def test_a_rotation_under_way_turns_evenly_to_its_end():
    motion = moving("rotate", under_way=(True, True))
    middle = 0.5 * (PLACES.min(axis=0) + PLACES.max(axis=0))
    axis, rate = np.array(MOTIONS["rotate"].axis), MOTIONS["rotate"].angle / TIME
    for position, velocity, acceleration, _ in motion.ends(TIME):
        along = np.cross(rate * axis, position - middle)
        assert velocity == pytest.approx(along, abs=1e-9)
        assert acceleration == pytest.approx(np.cross(rate * axis, along), abs=1e-9)
    # The rate, and with it the state, follows from how long the formation is held.
    assert motion.tied


def test_a_wave_under_way_is_met_where_it_is():
    motion = moving("wave", under_way=(True, False))
    position, velocity, *_ = motion.ends(TIME)[0]
    phase = -2.0 * np.pi * PLACES[:, 0] / MOTIONS["wave"].wavelength
    assert position[:, 2] - PLACES[:, 2] == pytest.approx(np.sin(phase), abs=1e-9)
    speed = 2.0 * np.pi / MOTIONS["wave"].period * np.cos(phase)
    assert velocity[:, 2] == pytest.approx(speed, abs=1e-9)
    # Held longer, it is met in the same state.
    assert not motion.tied
    assert motion.ends(2.0 * TIME)[0][:2] == pytest.approx(motion.ends(TIME)[0][:2])
