"""Lights over a hold, as scripts and tables say them."""

import numpy as np
import pytest

from showc.script.language.colours import linear_light

HEAD = (
    "drones: 4\nmusic: {offset: 5 s, bpm: 120, cues: {drop: bar 8}}\n"
    "formations: {row: {type: line, spacing: 4}}\ntransitions:\n"
)


def lights(show, text):
    return show(f"{HEAD}  - {{to: row, lights: {text}}}\n").transitions[0].lights


def test_moments_are_of_the_hold_or_of_the_music(show):
    found = lights(
        show,
        "[{after: 1.5, colour: red}, {at: '@drop + 1 beat', colour: blue, fade: end}]",
    )
    assert [(one.time, one.absolute, one.step) for one in found] == [
        (1.5, False, False),
        (5.0 + 14.0 + 0.5, True, True),
    ]
    assert np.allclose(found[0].colours, [1.0, 0.0, 0.0])


def test_colours_of_a_moment_may_be_a_gradient(show):
    (found,) = lights(
        show, "[{after: 1, colour: {gradient: [black, white], along: x}}]"
    )
    levels = linear_light(np.array([0.0, 1.0, 2.0, 3.0]) / 3.0)
    assert np.allclose(found.colours, levels[:, None], atol=1e-9)


def test_a_table_gives_places_their_colours_over_time(show, tmp_path):
    (tmp_path / "it.csv").write_text(
        "time [s];place;r;g;b\n# comment;;;;\n0;1;255;0;0\n2;1;0;0;255\n"
        "1;2;255;255;255\n"
    )
    found = lights(show, "it.csv")
    assert [one.time for one in found] == [0.0, 1.0, 2.0]
    assert np.allclose(found[1].colours[0], [0.5, 0.0, 0.5])
    assert np.isnan(found[0].colours[1]).all() and np.isnan(found[2].colours[3]).all()
    assert np.allclose(found[2].colours[1], 1.0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a,b\n1,2\n", "no column time"),
        ("time,place,r,g,b\n0,9,1,1,1\n", "line 2: place is not a number from 1 to 4"),
        ("time,place,r,g,b\n0,1,1,1,300\n", "blue is not a number from 0 to 255"),
        ("time,place,r,g,b\n0,1.5,1,1,1\n", "place is not a number"),
        ("time,place,r,g,b\n-1,1,1,1,1\n", "time is not a number"),
        ("time,place,r,g,b\n0,1,1\n", "green is not a number"),
        ("", "no column time"),
    ],
)
def test_faulty_tables_end_in_one_message(read, tmp_path, content, message):
    (tmp_path / "it.csv").write_text(content)
    found = read(f"{HEAD}  - {{to: row, lights: it.csv}}\n").errors
    assert len(found) == 1 and message in found[0].message and found[0].help


def test_a_table_that_outlasts_its_hold_is_marked_as_a_whole(read, tmp_path):
    (tmp_path / "it.csv").write_text("time,place,r,g,b\n0,1,1,2,3\n2000,1,255,0,0\n")
    text = f"{HEAD}  - {{to: row, hold: 6, lights: it.csv}}\n"
    (found,) = [one for one in read(text).diagnostics if one.code == "SHW220"]
    assert found.message.startswith("a light comes 2000 s into the hold of `row`")
    line = ("showc: 1\n" + text).splitlines()[found.span.line - 1]
    assert line[found.span.column - 1 :].startswith("it.csv")


@pytest.mark.parametrize(
    ("keys", "code", "message"),
    [
        ("effect: {kind: run}", "SHW102", "needs `colours`"),
        ("lights: [{after: 1, at: 2, colour: red}]", "SHW111", "cannot stand together"),
        ("lights: [{colour: red}]", "SHW102", "needs one of"),
        ("lights: [{at: '@dorp', colour: red}]", "SHW107", "no cue `dorp`"),
        ("lights: none.csv", "SHW109", "cannot be read"),
    ],
)
def test_faulty_lights_end_in_one_message(read, keys, code, message):
    found = read(f"{HEAD}  - {{to: row, {keys}}}\n").errors
    assert [one.code for one in found] == [code]
    assert message in found[0].message and found[0].help


def test_effects_may_count_in_beats(show, read):
    text = f"{HEAD}  - {{to: row, effect: {{kind: pulse, beats: 2}}}}\n"
    effect = show(text).transitions[0].effect
    assert (effect.period, effect.beat) == (1.0, 5.0)
    (found,) = read(text.replace(", bpm: 120, cues: {drop: bar 8}", "")).errors
    assert found.code == "SHW121" and "bpm" in found.help


def test_missions_say_once_that_they_leave_lights_out(show):
    from showc.mission.encode import lights_left_out

    made = show(
        "mission: {light_servos: [9, 10, 11]}\n"
        f"{HEAD}  - {{to: row, lights: [{{after: 1, colour: red}}]}}\n"
    )
    assert (
        sum("lights at moments over row" in one for one in lights_left_out(made)) == 1
    )


def test_a_colour_that_is_wrong_is_marked_beside_a_sound_effect(read):
    colour = "colour: {gradient: [red, blue], along: [0, 0, 0]}"
    (fault,) = read(
        f"{HEAD}  - {{to: row, {colour}, effect: {{kind: pulse}}}}\n"
    ).errors
    line = f"  - {{to: row, {colour}"
    assert "length zero" in fault.message
    assert fault.span.column == line.index("[0, 0, 0]") + 1
