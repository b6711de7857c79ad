"""Colours in time: places, fades, holds, effects, darkness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from synthetic import vertical_flight

from showc.flight import Flight
from showc.light import LightProgram, srgb_bytes
from showc.light.colour import drive_bytes, full_hue, linear_light
from showc.plan import build_itinerary
from showc.plan.itinerary import Itinerary
from showc.script import read_show
from showc.script.show import Effect, LightKey

FLIGHT = vertical_flight(4)
PROGRAM = LightProgram.of(FLIGHT)
STARTS = FLIGHT.starts
ORANGE, BLUE = [1.0, 0.25, 0.0], [0.0, 0.5, 1.0]
FIRST, FIRST_HOLD, SECOND, SECOND_HOLD, APPROACH = 2, 3, 4, 5, 6


def changed(**options) -> LightProgram:
    """Program of the same flight with other options of its first transition."""
    show = FLIGHT.itinerary.show
    first = replace(show.transitions[0], **options)
    show = replace(show, transitions=(first, *show.transitions[1:]))
    itinerary = Itinerary(show, FLIGHT.itinerary.legs)
    return LightProgram.of(Flight(itinerary, FLIGHT.legs, FLIGHT.starts))


def test_dark_until_the_first_picture_and_after_the_approach():
    before = PROGRAM.linear(np.linspace(-1.0, STARTS[FIRST], 20))
    after = PROGRAM.linear(np.linspace(STARTS[APPROACH + 1], FLIGHT.duration + 5.0, 20))
    assert not before.any() and not after.any()


def test_places_give_their_colour():
    middle = 0.5 * (STARTS[FIRST_HOLD] + STARTS[SECOND])
    assert np.allclose(PROGRAM.linear([middle]), ORANGE)
    assert np.allclose(PROGRAM.linear([STARTS[SECOND_HOLD] + 0.3]), BLUE)


def test_linear_fade_is_even_in_light():
    time = STARTS[SECOND] + np.array([0.25, 0.5, 0.75]) * FLIGHT.legs[SECOND].duration
    share = np.array([0.25, 0.5, 0.75])[:, None]
    wanted = (1.0 - share) * ORANGE + share * np.array(BLUE)
    assert np.allclose(PROGRAM.linear(time)[:, 2], wanted)


@pytest.mark.parametrize(("fade", "shown"), [("start", ORANGE), ("end", [0, 0, 0])])
def test_fades_at_one_end(fade, shown):
    program = changed(fade=fade)
    inside = STARTS[FIRST] + np.array([0.001, 1.0, FLIGHT.legs[FIRST].duration - 0.001])
    assert np.allclose(program.linear(inside), np.array(shown))
    assert np.allclose(program.linear([STARTS[FIRST_HOLD] + 0.1]), ORANGE)


def test_transition_colours_override_the_formation():
    colours = np.eye(4, 3)
    shown = changed(colours=colours).linear([STARTS[FIRST_HOLD] + 0.5])[0]
    places = FLIGHT.legs[FIRST].leg.places
    assert np.allclose(shown, colours[places])


def test_parked_drones_are_dark_and_places_are_assigned():
    leg = FLIGHT.legs[FIRST].leg
    places = np.array([2, -1, 0, 1])
    show = FLIGHT.itinerary.show
    colours = np.diag([1.0, 0.5, 0.25, 0.125])[:, :3]
    steps = replace(show.formations["steps"], colours=colours)
    show = replace(show, formations={**show.formations, "steps": steps})
    legs = [
        replace(flown, leg=replace(flown.leg, places=places))
        if flown.leg.to_formation == "steps"
        else flown
        for flown in FLIGHT.legs
    ]
    itinerary = Itinerary(show, tuple(flown.leg for flown in legs))
    program = LightProgram.of(Flight(itinerary, tuple(legs), STARTS))
    shown = program.linear([STARTS[FIRST_HOLD] + 0.5])[0]
    assert leg.drones.size == 4
    assert np.allclose(shown[[0, 2, 3]], colours[[2, 0, 1]])
    assert not shown[1].any()


def test_pulse_darkens_in_the_middle_of_its_period():
    program = changed(effect=Effect("pulse", period=1.0, depth=0.6))
    start = STARTS[FIRST_HOLD]
    shown = program.linear(start + np.array([0.5, 1.0, 1.25]))[:, 0]
    factor = np.array([0.4, 1.0, 0.7])[:, None]
    assert np.allclose(shown, factor * ORANGE)


def test_sweep_runs_along_its_axis():
    effect = Effect("sweep", period=2.0, direction=(0.0, 0.0, 1.0), wavelength=4.0)
    program = changed(effect=effect)
    time = 1.0
    height = FLIGHT.legs[FIRST_HOLD].leg.goal[:, 2]
    turns = time / 2.0 - height / 4.0
    wanted = 0.5 + 0.5 * np.cos(2.0 * np.pi * turns)
    shown = program.linear([STARTS[FIRST_HOLD] + time])[0, :, 0]
    assert np.allclose(shown, wanted)


def test_rainbow_turns_the_hue():
    effect = Effect("rainbow", period=3.0, wavelength=1e9)
    program = changed(effect=effect, hold=1.5)
    shown = program.linear([STARTS[FIRST_HOLD] + 1.0])[0]
    assert np.allclose(shown, full_hue(np.array(1.0 / 3.0)), atol=1e-6)
    assert np.allclose(shown[0], [0.0, 1.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("kind", ["pulse", "sweep", "rainbow"])
def test_nothing_jumps_with_linear_fades(kind):
    program = changed(effect=Effect(kind, period=1.7, wavelength=3.0))
    step = 1e-4
    times = np.arange(0.0, FLIGHT.duration, step)
    for part in np.array_split(times, 60):
        shown = program.linear(part)
        assert np.abs(np.diff(shown, axis=0)).max(initial=0.0) < 30.0 * step


def test_drive_values_are_linear_and_screens_get_srgb():
    light = np.array([0.0, 0.2140411, 0.5, 1.0])
    assert drive_bytes(light).tolist() == [0, 55, 128, 255]
    assert srgb_bytes(light).tolist() == [0, 127, 188, 255]


def test_every_screen_byte_survives_the_round_trip():
    every = np.arange(256, dtype=np.uint8)
    assert np.array_equal(srgb_bytes(linear_light(every)), every)


@given(arrays(np.float64, (3, 2), elements=st.floats(-2.0, 2.0)))
def test_bytes_never_wrap(values):
    for encoded in (drive_bytes(values), srgb_bytes(values)):
        assert np.all(encoded[values <= 0.0] == 0)
        assert np.all(encoded[values >= 1.0] == 255)


def played(kind, turns):
    """Brightness of each drone in the second half of a hold, at turns of an effect."""
    hold = FLIGHT.legs[FIRST_HOLD].duration
    times = STARTS[FIRST_HOLD] + 0.5 * hold + 0.25 * hold * np.asarray(turns)
    effect = Effect(kind=kind, period=0.25 * hold)
    return changed(effect=effect).linear(times).max(axis=-1)


def test_a_strobe_flashes_for_a_quarter_of_each_period():
    light = played("strobe", [0.05, 0.2, 0.3, 0.95])
    assert light[:2].min() > 0.1
    assert not light[2:].any()


def test_drones_twinkle_each_in_its_own_time():
    light = played("twinkle", np.linspace(0.0, 1.0, 81)[:-1])
    assert light.max(axis=0).min() > 10.0 * light.min(axis=0).max()
    assert len(set(light.argmax(axis=0).tolist())) == light.shape[1]


def test_what_runs_moves_its_colours_along_the_direction():
    hold = FLIGHT.legs[FIRST_HOLD].duration
    colours = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    effect = Effect(
        "run", period=0.5 * hold, direction=(1.0, 0.0, 0.0), colours=colours,
        wavelength=1e9,
    )  # fmt: skip
    # Nothing but time counts with so long a wave: backwards through the colours.
    times = STARTS[FIRST_HOLD] + 0.5 * hold * (1.0 + np.arange(3) / 3.0)
    light = changed(effect=effect).linear(times)[:, 0]
    assert np.array_equal(light.argmax(axis=1), [0, 2, 1])
    # A drone further along shows what one before it shows a little later.
    program = changed(effect=replace(effect, wavelength=60.0))
    places = FLIGHT.legs[FIRST_HOLD].leg.goal
    ahead = int(np.argmax(places[:, 0]))
    behind = int(np.argmin(places[:, 0]))
    later = (places[ahead, 0] - places[behind, 0]) / 60.0 * 0.5 * hold
    assert 0.0 < later < 0.3 * hold
    time = STARTS[FIRST_HOLD] + 0.6 * hold
    here, there = program.linear([time, time + later])
    assert np.allclose(here[behind], there[ahead], atol=1e-9)


def test_effects_in_beats_are_in_step_with_the_music():
    start = STARTS[FIRST_HOLD]
    hold = FLIGHT.legs[FIRST_HOLD].duration
    beat = 0.25 * hold
    effect = Effect("strobe", period=beat, beat=float(start) + 0.4 * beat)
    # Ten hundredths of a beat after each beat it shines, ten before it does not.
    beats = start + 0.4 * beat + beat * np.array([2.0, 3.0])
    program = changed(effect=effect)
    assert program.linear(beats + 0.1 * beat).max(axis=(1, 2)).min() > 0.1
    assert not program.linear(beats - 0.1 * beat).any()


def key(time, colour, *, step=False, absolute=False):
    return LightKey(time, absolute, np.tile(np.array(colour, float), (4, 1)), step)


def test_keyframes_change_evenly_or_at_once():
    red, blue = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
    hold = FLIGHT.legs[FIRST_HOLD].duration
    keys = (key(0.4 * hold, red), key(0.7 * hold, blue, step=True))
    program = changed(lights=keys)
    shares = np.array([0.0, 0.2, 0.4, 0.55, 0.69, 0.71, 0.99])
    light = program.linear(STARTS[FIRST_HOLD] + shares * hold)[:, 1]
    half = 0.5 * (np.array(ORANGE) + red)
    assert np.allclose(light, [ORANGE, half, red, red, red, blue, blue], atol=1e-9)
    # The next move begins from the last colour.
    assert np.allclose(program.linear([STARTS[SECOND] + 1e-6])[0, 1], blue, atol=1e-4)


def test_moments_of_the_show_count_from_its_beginning():
    start, hold = float(STARTS[FIRST_HOLD]), FLIGHT.legs[FIRST_HOLD].duration
    red, blue = [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]
    before = key(start - 2.0, red, absolute=True)
    inside = key(start + 0.5 * hold, blue, step=True, absolute=True)
    light = changed(lights=(inside, before)).linear(
        start + np.array([0.01, 0.49, 0.51]) * hold
    )
    assert np.allclose(light[:, 2], [red, red, blue])


def test_places_without_a_colour_yet_go_to_their_first_one():
    start, hold = float(STARTS[FIRST_HOLD]), FLIGHT.legs[FIRST_HOLD].duration
    blue = [0.0, 0.0, 1.0]
    first, second = np.full((2, 4, 3), np.nan)
    first[0], second[0], second[1] = blue, blue, blue
    keys = (
        LightKey(0.2 * hold, False, first, False),
        LightKey(0.6 * hold, False, second, False),
    )
    drone = {int(p): k for k, p in enumerate(FLIGHT.legs[FIRST_HOLD].leg.places)}
    light = changed(lights=keys).linear(start + np.array([0.3, 0.6, 0.9]) * hold)
    half = 0.5 * (np.array(ORANGE) + blue)
    assert np.allclose(light[:, drone[0]], blue)
    assert np.allclose(light[:, drone[1]], [half, blue, blue])
    assert np.allclose(light[:, drone[2]], ORANGE)


GROUPS = b"""\
showc: 1
drones: 3
groups: {first: [1], second: [2]}
formations:
  all: {type: line, length: 8, centre: [0, 0, 12], colour: white}
  left: {type: points, points: [[-4, 4, 12]], colour: red, effect: strobe}
  middle: {type: points, points: [[0, 4, 12]], colour: blue}
transitions:
  - {to: all, assignment: fixed, hold: 2}
  - {to: left, group: first, fade: end, hold: 4}
  - {to: middle, group: second, fade: start, hold: 4}
"""


def test_groups_in_one_time_have_fades_and_effects_of_their_own():
    """Drones of no group keep their colours, and have no effect."""
    itinerary = build_itinerary(read_show(GROUPS).show)
    durations = [leg.duration or 4.0 for leg in itinerary.legs]
    starts = np.cumsum([0.0, *durations[:-1]])
    program = LightProgram.over(itinerary.show, itinerary.legs, starts, durations)
    move = next(n for n, leg in enumerate(itinerary.legs) if "left" in leg.name)
    _, blue, white = linear_light([[255, 0, 0], [0, 0, 255], [255, 255, 255]])
    under_way = program.linear(starts[move] + np.array([0.1, 2.0, 3.9]))
    assert np.allclose(under_way, [white, blue, white])
    held = program.linear(np.linspace(starts[move + 1] + 0.6, starts[move + 1] + 3.9))
    assert np.allclose(held[:, 1:], [blue, white])
    assert {*held[:, 0, 0].round(6)} == {0.0, 1.0} and not held[:, 0, 1:].any()
