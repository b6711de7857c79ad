"""Mistakes that people make, each with the one message that they can act on."""

from pathlib import Path

import pytest

from showc.script import read_show
from showc.script.fixes import apply_fixes
from showc.script.render import render

GOLDEN = Path(__file__).with_name("mistakes.txt")
HEAD = "showc: 1\ndrones: 4\n"
TAIL = "transitions: [it]\n"


def formation(keys):
    return f"{HEAD}formations:\n  it: {{{keys}}}\n{TAIL}"


def circle(keys):
    return formation(f"type: circle, radius: 9, {keys}")


def shown(*transitions, head=""):
    lines = "".join(f"  - {{to: it{one}}}\n" for one in transitions)
    form = "formations: {it: {type: circle, radius: 9}}\n"
    return f"{HEAD}{head}{form}transitions:\n{lines}"


FILES = {
    "feet.csv": b"x [ft],y [ft],z [ft]\n1,2,10\n4,2,10\n7,2,10\n9,9,10\n",
    "shares.csv": b"time,place,red,green,blue\n0,1,1.0,0.5,0\n1,1,0,0,1\n",
    "words.txt": b"10,0\t10,0\tverse\n",
    "flat.csv": b"x,y\n1,2\n3,4\n",
    "skybrush.csv": b"Time [msec],x [m],y [m],z [m],Red,Green,Blue\n0,1,2,3,255,0,0\n",
    "comma.csv": b"x;y;z\n1,5;2,0;3,0\n",
    "words.csv": b"x,y,z\n1,two,3\n",
    "noise.png": b"no picture",
    "Dragon.csv": b"x,y,z\n0,0,9\n",
}
CASES = {
    "a colour that YAML takes for a comment": (
        f"{HEAD}formations:\n  it:\n    type: circle\n    radius: 9\n"
        f"    colour: #ff8800\n{TAIL}"
    ),
    "a colour that hides a bracket": circle("colour: #ff8800"),
    "a list of colours": circle("colour: [red, white]"),
    "a colour out of range": circle("colour: [256, 0, 0]"),
    "a decimal comma": f"{HEAD}formations:\n  it:\n    type: circle\n"
    f"    radius: 9,5\n{TAIL}",
    "a decimal comma in a list": circle("centre: [1,5, 0, 20]"),
    "a decimal comma in braces": (
        f"{HEAD}formations: {{it: {{type: circle, radius: 9}}}}\n"
        "transitions:\n  - {to: it, hold: 2,5}\n"
    ),
    "decimal commas and no others": circle("centre: [0 1,5 20]"),
    "no commas in a list": circle("centre: [0 20 40]"),
    "neither commas nor brackets": circle("centre: 0 20 40"),
    "commas and no brackets": circle("centre: 0, 20, 40"),
    "a CSV without heights": formation("type: csv, file: flat.csv"),
    "a CSV of Skybrush": formation("type: csv, file: skybrush.csv"),
    "a CSV with decimal commas": formation("type: csv, file: comma.csv"),
    "a CSV with words": formation("type: csv, file: words.csv"),
    "a picture that is none": formation("type: image, file: noise.png"),
    "a picture that is not there": formation("type: image, file: gone.png"),
    "a truth value for a time": (
        f"{HEAD}formations: {{it: {{type: circle, radius: 9}}}}\n"
        "transitions:\n  - {to: it, hold: yes}\n"
    ),
    "a mistyped section": (
        f"{HEAD}formatons: {{it: {{type: circle, radius: 9}}}}\n{TAIL}"
    ),
    "a mistyped type": formation("type: circel, radius: 9"),
    "a mistyped name": (
        f"{HEAD}formations: {{ring: {{type: circle, radius: 9}}}}\n"
        "transitions: [rnig]\n"
    ),
    "lat and lon": (
        f"{HEAD}site: {{origin: {{lat: 47.4, lon: 8.5}}}}\n"
        f"formations: {{it: {{type: circle, radius: 9}}}}\n{TAIL}"
    ),
    "meters": formation("type: circle, radius: 9 meters"),
    "sec": (
        f"{HEAD}formations: {{it: {{type: circle, radius: 9}}}}\n"
        "transitions:\n  - {to: it, hold: 5 sec}\n"
    ),
    "color": circle("color: red"),
    "center": circle("center: [0, 0, 20]"),
    "rotate on a formation": circle("rotate: 45"),
    "the separation that nobody wrote": (
        f"showc: 1\ndrones: 40\nformations: {{it: {{type: circle, radius: 9}}}}\n{TAIL}"
    ),
    "a group beside a drone that stands by": (
        f"{HEAD}pads: {{type: line, spacing: 3}}\n"
        "formations:\n  it: {type: points, points: [[4.5, 0, 11], [0, 5, 10]]}\n"
        "groups: {front: [1, 2]}\n"
        "transitions:\n  - {group: front, to: it}\n"
    ),
    "no space behind colons": formation("type:circle, radius:9"),
    "a no-break space": formation("type: circle, radius:\u00a09"),
    "a minus sign of typesetters": circle("centre: [\u22125, 0, 20]"),
    "a comma of thousands": formation("type: circle, radius: 1,000"),
    "levels from 0 to 1": circle("colour: [1.0, 0.5, 0]"),
    "a list for a table": f"{HEAD}formations:\n  - {{type: circle}}\n{TAIL}",
    "one motion without brackets": shown(", hold: 9, motion: {rotate: 90}"),
    "one transition without brackets": (
        f"{HEAD}formations: {{it: {{type: circle, radius: 9}}}}\ntransitions: it\n"
    ),
    "a mistyped motion": shown(", hold: 9, motion: [{rotaet: 90}]"),
    "a mistyped name of what it becomes": shown(", hold: 9, motion: [{morph: [itt]}]"),
    "one displacement without brackets": shown(
        ", hold: 30, motion: [{travel: [2, 0, 0]}]"
    ),
    "a motion without numbers": shown(", hold: 9, motion: [rotate]"),
    "a motion that follows no file": shown(", hold: 9, motion: [{follow: gone.csv}]"),
    "one light without brackets": shown(", lights: {after: 1, colour: red}"),
    "pads without a type": shown("", head="pads: {step: 4, rows: 2}\n"),
    "a mistyped key of the type": formation("tpye: circle, radius: 9"),
    "a launch without a key": shown("", head="launch: 10\n"),
    "a motion in no time": shown(", hold: 0, motion: [{rotate: 90}]"),
    "not a number": shown(", hold: .nan"),
    "seconds beyond 59": shown(', at: "00:01:61:12@25"'),
    "a frame that is left out": shown(', at: "00:01:00;00@29.97"'),
    "a cue without its sign": shown(", at: drop", head="music: {cues: {drop: 30}}\n"),
    "a tempo with a unit": shown(", at: bar 30", head="music: {bpm: 120 bpm}\n"),
    "cues that are not there": shown(
        ', at: "@drop"', ', at: "@end"', head="music: {cues: gone.txt}\n"
    ),
    "cues with decimal commas": shown(
        ', at: "@verse"', head="music: {cues: words.txt}\n"
    ),
    "a merge key": (
        f"{HEAD}formations:\n  it: &it {{type: circle, radius: 9}}\n"
        f"  up: {{<<: *it, centre: [0, 0, 30]}}\n{TAIL}"
    ),
    "a tab behind a dash": (
        f"{HEAD}formations: {{it: {{type: circle, radius: 9}}}}\ntransitions:\n-\tit\n"
    ),
    "a range from 0": shown("", head="groups: {a: 0-1}\n"),
    "a range backwards": shown("", head="groups: {a: 2-1}\n"),
    "velocity": shown("", head="limits: {velocity: 9}\n"),
    "a CSV in feet": formation("type: csv, file: feet.csv"),
    "lights from 0 to 1": shown(", hold: 9, lights: shares.csv"),
    "parentheses for a list": circle("centre: (0, 0, 20)"),
    "semicolons in a list": circle("centre: [0; 0; 20]"),
    "keys for a list": circle("centre: {x: 0, y: 0, z: 20}"),
    "a diameter": formation("type: circle, diameter: 18"),
    "a height of a circle": circle("height: 20"),
    "a gradient outside its colour": circle("gradient: [red, gold]"),
    "a shape of another name": formation("type: ring, radius: 9"),
    "a file without its type": formation("file: logo.svg"),
    "places without brackets of their own": formation(
        "type: points, points: [0, 0, 9, 4, 0, 9, 8, 0, 9, 12, 0, 9]"
    ),
    "places without heights": formation(
        "type: points, points: [[0, 0], [4, 0], [8, 0], [12, 0]]"
    ),
    "a name in other letters": formation("type: csv, file: dragon.csv"),
    "a page of the web": formation('type: csv, file: "https://example.org/a.csv"'),
    "an effect with a type": circle("effect: {type: pulse}"),
    "an effect with a speed": circle("effect: {kind: pulse, speed: 2}"),
    "a rainbow as a colour": circle("colour: rainbow"),
    "typographic quotes": formation("type: text, height: 20, text: \u201cI\u201d"),
    "radians for degrees": shown("", head="limits: {tilt: 0.35}\n"),
    "grams for kilograms": shown("", head="vehicle: {mass: 625}\n"),
    "a stretch of a sphere": shown(
        "", head="separation: {distance: 2, vertical_stretch: 3}\n"
    ),
    "coordinates as a list": shown("", head="site: {origin: [47.4, 8.5, 488]}\n"),
    "music by its file": shown("", head="music: song.mp3\n"),
    "transitions by another name": (
        f"{HEAD}formations: {{it: {{type: circle, radius: 9}}}}\nscenes: [it]\n"
    ),
    "dashes without spaces": (
        f"{HEAD}formations: {{it: {{type: circle, radius: 9}}}}\ntransitions:\n"
        "  -it\n  -it\n"
    ),
    "two motions in one": shown(", hold: 30, motion: [{rotate: 90, breathe: 1.1}]"),
    "a motion by its name": shown(", hold: 9, motion: rotate"),
    "a bar and a beat with a comma": shown(
        ", at: bar 12, beat 3", head="music: {bpm: 120}\n"
    ),
    "a bar with a fraction": shown(", at: bar 12.3", head="music: {bpm: 120}\n"),
    "a beat that the bar has not": shown(
        ", at: bar 12 beat 5", head="music: {bpm: 120}\n"
    ),
    "bars for a bar": shown(", at: 12 bars", head="music: {bpm: 120}\n"),
    "cues in a circle": shown(
        ', at: "@a"', head='music: {cues: {a: "@b", b: "@a + 2"}}\n'
    ),
    "cues without names": shown("", head="music: {cues: [24.5, 40]}\n"),
    "a range with dots": shown("", head="groups: {a: 1..2}\n"),
    "drones without brackets": (
        f"{HEAD}formations: {{it: {{type: circle, radius: 9}}}}\n"
        f"groups:\n  a: 1,2\n{TAIL}"
    ),
    "an output for two colours": shown(
        "", head="mission: {light_servos: [9, 9, 10]}\n"
    ),
    "an export twice": shown("", head="exports: [skyc, skyc]\n"),
    "a comma that is missing": formation("type: circle radius: 9"),
    "a bracket that is not closed": (
        f"{HEAD}formations:\n  it: {{type: circle, radius: 9\n{TAIL}"
    ),
    "a quote that is not closed": f'{HEAD}name: "night\n{TAIL}',
    "a colon that is missing": f"showc: 1\ndrones 4\n{TAIL}",
    "a name with a colon": f"{HEAD}name: Night: part 2\n{TAIL}",
    "a key that stands too far right": (
        f"{HEAD}formations:\n  it: {{like: up}}\n   up: {{type: circle}}\n{TAIL}"
    ),
    "times of groups in the order of groups": (
        f"{HEAD}groups: {{a: 1-2, b: 3-4}}\nformations:\n"
        "  it: {type: line, spacing: 3, centre: [-9, 0, 20]}\n"
        "  up: {type: line, spacing: 3, centre: [9, 0, 20]}\n"
        "  far: {like: up, centre: [9, 0, 30]}\n"
        "transitions:\n  - {to: it, group: a, at: 20, duration: 9}\n"
        "  - {to: it, group: a, at: 60, duration: 9}\n"
        "  - {to: up, group: b, at: 30, duration: 9}\n"
        "  - {to: far, group: b, at: 45, duration: 1}\n"
    ),
    "too little time": (
        f"{HEAD}formations:\n  it: {{type: circle, radius: 9}}\n"
        "  up: {type: circle, radius: 9, centre: [0, 0, 25]}\n"
        "transitions:\n  - it\n  - {to: up, duration: 2.8}\n"
    ),
}


def said(script, folder):
    for name, content in FILES.items():
        (folder / name).write_bytes(content)
    result = read_show(script.encode(), path="show.yaml", folder=folder)
    return render(result.diagnostics, {result.path: result.text})


def mended(script, folder):
    for name, content in FILES.items():
        (folder / name).write_bytes(content)
    return apply_fixes(
        script.encode(), lambda given: read_show(given, path="show.yaml", folder=folder)
    )


def sections():
    text = GOLDEN.read_text(encoding="utf-8")
    return dict(part.split("\n", 1) for part in text.split("===== ")[1:])


@pytest.mark.parametrize("name", CASES)
def test_what_is_said(name, tmp_path):
    assert said(CASES[name], tmp_path) == sections()[name].rstrip("\n") + "\n"


@pytest.mark.parametrize("name", CASES)
def test_one_mistake_is_one_message_that_helps(name, tmp_path):
    for file, content in FILES.items():
        (tmp_path / file).write_bytes(content)
    found = read_show(CASES[name].encode(), folder=tmp_path).errors
    assert len(found) == (2 if name == "lat and lon" else 1)
    assert all(item.help for item in found)


MENDABLE = {
    "a colour that YAML takes for a comment": 'colour: "#ff8800"',
    "a colour that hides a bracket": 'colour: "#ff8800"}',
    "a decimal comma": "radius: 9.5",
    "a decimal comma in braces": "{to: it, hold: 2.5}",
    "no commas in a list": "centre: [0, 20, 40]",
    "neither commas nor brackets": "centre: [0, 20, 40]",
    "commas and no brackets": "centre: [0, 20, 40]",
    "a mistyped section": "formations: {it: {type",
    "a mistyped type": "{type: circle, radius: 9}",
    "a mistyped name": "transitions: [ring]",
    "lat and lon": "{latitude: 47.4, longitude: 8.5}",
    "meters": "radius: 9 m}",
    "sec": "hold: 5 s}",
    "color": "colour: red",
    "center": "centre: [0, 0, 20]",
    "no space behind colons": "{type: circle, radius: 9}",
    "a no-break space": "radius: 9}",
    "a minus sign of typesetters": "centre: [-5, 0, 20]",
    "a mistyped motion": "[{rotate: 90}]",
    "velocity": "{speed: 9}",
    "a mistyped name of what it becomes": "motion: [{morph: [it]}]",
    "one displacement without brackets": "[{travel: [[2, 0, 0]]}]",
    "a mistyped key of the type": "{type: circle, radius: 9}",
    "parentheses for a list": "centre: [0, 0, 20]",
    "semicolons in a list": "centre: [0, 0, 20]",
    "places without brackets of their own": "[[0, 0, 9], [4, 0, 9], [8, 0, 9],",
    "typographic quotes": 'text: "I"',
    "transitions by another name": "transitions: [it]",
    "an effect with a type": "effect: {kind: pulse}",
    "a bar and a beat with a comma": "at: bar 12 beat 3}",
    "a range with dots": "{a: 1-2}",
    "drones without brackets": "a: [1, 2]",
}
"""What stands in the script after ``check --fix``."""


@pytest.mark.parametrize("name", CASES)
def test_what_has_one_right_answer_is_mended_and_nothing_else(name, tmp_path):
    found = mended(CASES[name], tmp_path)
    if name not in MENDABLE:
        assert found.content.decode() == CASES[name] and not found.done
        return
    assert MENDABLE[name] in found.content.decode()
    assert not read_show(found.content, folder=tmp_path).errors
    assert mended(found.content.decode(), tmp_path).done == ()


def test_a_word_with_two_near_neighbours_is_not_mended(tmp_path):
    script = (
        f"{HEAD}formations:\n  ring1: {{type: circle, radius: 9}}\n"
        "  ring2: {like: ring1}\ntransitions: [ring, ring1, ring2]\n"
    )
    assert mended(script, tmp_path).done == ()


def test_every_golden_section_has_a_case():
    assert sections().keys() == CASES.keys()


@pytest.mark.parametrize(
    "written",
    [
        "[255, 128, 0]",
        '"rgb(255, 128, 0)"',
        "rgb(255, 128, 0)",
        "{each: [rgb(255, 128, 0), rgb(255,128,0)]}",
        '"rgb(255 128 0)"',
        '"#ff8000"',
    ],
)
def test_a_colour_may_be_written_in_several_ways(show, written):
    made = show(circle(f"colour: {written}").removeprefix("showc: 1\n"))
    expected = show(circle('colour: "#ff8000"').removeprefix("showc: 1\n"))
    assert (made.formations["it"].colours == expected.formations["it"].colours).all()
