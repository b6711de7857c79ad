"""Times are read as choreographers write them, and cues from the files they have."""

from contextlib import suppress
from math import isclose, isfinite

import pytest
from hypothesis import given
from hypothesis import strategies as st

from showc.script import read_show
from showc.script.diagnostic import ScriptError
from showc.script.language.instants import (
    Tempo,
    music_time,
    parse_instant,
    parse_length,
    read_cues,
)
from showc.script.show import Music

MUSIC = Music(None, 20.0, 120.0, 4, 0.5, {"chorus": 12.25})
SHOW = """\
showc: 1
drones: 2
music: {offset: 20, bpm: 120, first_beat: 0.5, cues: %s}
formations:
  row: {type: line, length: 6, centre: [0, 0, 20]}
  up: {type: line, length: 6, centre: [0, 0, 25]}
transitions:
  - {to: row, at: %s}
  - {to: up, at: 60}
"""


def seconds(text, music=MUSIC):
    return music_time(parse_instant(text), music)


@pytest.mark.parametrize(
    ("text", "length"),
    [
        ("2 bars", 3.75),
        ("1 bar", 1.875),
        ("3 beats", 1.40625),
        ("00:04.5", 4.5),
        ("00:00:02:12@25", 2.48),
        ("4 s", None),
    ],
)
def test_every_form_of_length(text, length):
    assert parse_length(text, Tempo(0.46875, 1.875)) == length


def test_lengths_are_counted_in_beats_wherever_one_is_written():
    script = SHOW % ("{}", "bar 16, hold: 2 bars, motion: [{rotate: {ramp: 3 beats}}]")
    script = script.replace("rotate: {", "rotate: {angle: 90, ")
    show = read_show(f"{script}mission: {{wanted: false}}\n".encode()).show
    assert show is not None
    first = show.transitions[0]
    assert (first.hold, first.motion[0].ramp) == (4.0, 1.5)
    for tempo, length, code in (
        ("first_beat: 0.5", "2 bars", "SHW121"),
        ("bpm: 120", "bar 2", "SHW103"),
        ("bpm: 120", "2000 bars", "SHW104"),
        ("bpm: fast", "2 bars", "SHW103"),
    ):
        script = SHOW.replace("bpm: 120, first_beat: 0.5", tempo) % ("{}", "60")
        script = script.replace("at: 60}\n", f"hold: {length}}}\n", 1)
        assert [one.code for one in read_show(script.encode()).errors] == [code]


@pytest.mark.parametrize(
    ("text", "time"),
    [
        ("24.5", 24.5),
        ("2 min", 120.0),
        ("01:20.5", 80.5),
        ("1:00:01", 3601.0),
        ("00:01:20:12@25", 80.48),
        ("00:00:01:15@30", 1.5),
        # The first frame of hour one: 3.6 ms before it, by the count's definition.
        ("01:00:00;00@29.97", 3599.9964),
        ("00:01:00;02", 1800 * 1001 / 30000),
        ("bar 1", 0.5),
        ("bar 12", 22.5),
        ("bar 12 beat 3", 23.5),
        ("beat 3.5", 1.75),
        ("@chorus", 12.25),
        ("@Chorus", 12.25),
        ("@chorus + 2 beats", 13.25),
        ("@chorus + 00:01.5", 13.75),
        ("@chorus - 00:00:01:12@24", 10.75),
        ("@chorus - 1 bar", 10.25),
        ("bar 9 + 250 ms", 16.75),
    ],
)
def test_every_form_of_time(text, time):
    assert isclose(seconds(text), time, abs_tol=1e-9)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("soon", "SHW103"),
        ("12 m", "SHW105"),
        ("00:01:20:12", "SHW103"),
        ("00:01:20:25@25", "SHW103"),
        ("00:01:00;00@29.97", "SHW103"),
        ("@drop", "SHW107"),
        ("1" * 500, "SHW103"),
    ],
)
def test_what_is_no_time_is_refused(text, code):
    with pytest.raises(ScriptError) as refused:
        seconds(text)
    assert refused.value.code == code


def test_beats_need_a_tempo():
    with pytest.raises(ScriptError) as refused:
        seconds("bar 3", None)
    assert refused.value.code == "SHW121"


@given(st.text(max_size=30))
def test_any_text_is_a_time_or_refused(text):
    with suppress(ScriptError):
        assert isfinite(parse_instant(text).value)


@given(st.integers(0, 23), st.integers(0, 59), st.integers(0, 59), st.integers(2, 29))
def test_drop_frame_time_code_counts_every_frame_once(hours, minutes, seconds_, frame):
    text = f"{hours:02d}:{minutes:02d}:{seconds_:02d};{frame:02d}"
    frames = seconds(text) * 30000 / 1001
    assert isclose(frames, round(frames), abs_tol=1e-6)
    # Drop-frame time code stays within two frames of the clock.
    clock = 3600 * hours + 60 * minutes + seconds_ + frame / 29.97
    assert abs(seconds(text) - clock) < 0.1 + 1e-6 * clock


AUDACITY = b"12.25\t12.25\tchorus\n\\\t100\t200\n30\t34\tdrop it\n31\t31\tdrop it\n"
REAPER = b"#,Name,Start,End,Length\nM1,chorus,0:12.25,,\nM2,drop it,5.3.50,,\n"
TABLE = b"chorus;12.25\ndrop;00:00:30:00@25\n"


def times(content, name):
    return {key: music_time(one, MUSIC) for key, one in read_cues(content, name)}


def test_cues_are_read_from_what_musicians_have():
    assert times(AUDACITY, "labels.txt") == {
        "chorus": 12.25, "drop_it": 30.0, "drop_it_2": 31.0
    }  # fmt: skip
    assert times(REAPER, "markers.csv") == {"chorus": 12.25, "drop_it": 9.75}
    assert times(TABLE, "cues.csv") == {"chorus": 12.25, "drop": 30.0}


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"chorus\n", b"chorus,soon\n"])
def test_a_file_without_cues_is_refused(content):
    with pytest.raises(ScriptError) as refused:
        read_cues(content, "cues.csv")
    assert refused.value.code == "SHW110"


def test_times_count_from_the_music():
    show = read_show((SHOW % ("{chorus: 12.25}", '"@chorus"')).encode()).show
    assert [one.at for one in show.transitions] == [32.25, 80.0]
    # The hold before a given time is as long as it must be.
    assert show.transitions[0].hold == 0.0
    assert show.transitions[1].hold == 5.0


def test_a_file_of_cues_is_one_of_the_inputs():
    text = (SHOW % ("labels.txt", '"@chorus"')).encode()
    result = read_show(text, attached={"labels.txt": AUDACITY})
    assert result.show.source.inputs == {"labels.txt": AUDACITY}
    assert result.show.transitions[0].at == 32.25
    # What counts from a cue of that file is no mistake of its own.
    assert [one.code for one in read_show(text, attached={}).errors] == ["SHW109"]


def test_a_cue_in_plain_text_needs_quotes():
    result = read_show((SHOW % ("{chorus: 12.25}", "@chorus")).encode())
    assert '"@chorus"' in result.diagnostics[0].help


@pytest.mark.parametrize(
    ("label", "cue"),
    [("Verse 1", "Verse_1"), ("2nd drop", "cue_2nd_drop"), ("Припев 1", "Припев_1")],
)
def test_a_label_that_is_no_name_is_answered_with_the_name_of_its_cue(label, cue):
    with pytest.raises(ScriptError, match="is no name of a cue") as refused:
        parse_instant(f"@{label} + 2 beats")
    assert f"`@{cue}`" in refused.value.help
    ((name, _),) = read_cues(f"20.5\t20.5\t{label}\n".encode(), "labels.txt")
    assert name == cue


def test_an_effect_in_beats_is_not_said_to_lack_the_tempo_of_music_with_a_fault():
    effect = "music: {bpm: 100, cues: {'b c': %s}}\nformations:\n  row: {type: line, "
    effect += "length: 6, centre: [0, 0, 20], effect: {kind: pulse, beats: 2}}\n"
    script = "showc: 1\ndrones: 2\n" + effect + "transitions: [row]\n"
    found = read_show((script % "3").encode()).diagnostics
    codes = [one.code for one in found if one.code != "SHW307"]
    assert codes and "SHW121" not in codes


def test_a_decimal_comma_before_a_unit_is_found_and_mended():
    script = "showc: 1\ndrones: 2\nformations:\n  row: {type: line, length: 6,5 m}\n"
    found = read_show((script + "transitions: [row]\n").encode()).diagnostics
    assert [(one.code, one.fix) for one in found] == [("SHW103", "6.5 m")]


@pytest.mark.parametrize(
    ("inertia", "sound"),
    [
        ((0.01, 0.01, 0.02), True),
        ((0.01, 0.01, 0.021), False),
        ((0.03, 0.01, 0.01), False),
        ((1.0, 1.0, 1.0), True),
    ],
)
def test_an_inertia_that_no_body_has_is_refused(inertia, sound):
    script = SHOW % ("{}", 30) + f"vehicle: {{inertia: {list(inertia)}}}\n"
    found = read_show(script.encode())
    messages = [one.message for one in found.diagnostics if one.code == "SHW104"]
    assert (found.show is not None) == sound
    assert any("no body has a moment of inertia" in one for one in messages) != sound
