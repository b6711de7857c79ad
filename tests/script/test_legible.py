"""Pictures that read from one side only, and where the audience is."""

import pytest

from showc.script import read_show

SCRIPT = """\
showc: 1
site: {{audience: [{audience}]}}
drones: 40
formations:
  word: {{type: text, text: {text}, height: 18, centre: [0, 0, 30], {more}}}
  same: {{like: word, {again}}}
transitions: [word, same]
"""
FRONT = "{name: front, line: [[-30, -60], [30, -60]]}"
BACK = "{name: back, line: [[-30, 60], [30, 60]]}"
LEFT = "{name: left, line: [[-60, -30], [-60, 30]]}"
TURN, MIRROR = "transform: [{rotate: 180}]", "transform: [{mirror: x}]"


def found(audience, *, text="LEFT", more="plane: front", again="spread: false"):
    script = SCRIPT.format(audience=audience, text=text, more=more, again=again)
    result = read_show(script.encode(), path="show.yaml")
    assert not result.errors, result.errors
    return [one for one in result.diagnostics if one.code == "SHW218"]


@pytest.mark.parametrize(
    ("audience", "more"),
    [
        (FRONT, "plane: front"),
        (BACK, TURN),
        (BACK, MIRROR),
        # A drawing in the side plane, y to the right, reads from +x.
        (LEFT, f"plane: side, {TURN}"),
        (FRONT, f"plane: horizontal, {MIRROR}"),
        (FRONT, "plane: horizontal, transform: [{rotate: {angle: 90, axis: x}}]"),
        # From its edge a picture is neither as drawn nor mirrored.
        (LEFT.replace("30", "1"), "plane: front"),
    ],
)
def test_what_the_audience_reads_is_no_finding(audience, more):
    assert found(audience, more=more) == []


@pytest.mark.parametrize(
    ("audience", "more", "mended"),
    [
        (BACK, "plane: front", "rotate: 180"),
        (FRONT, TURN, "rotate: 180"),
        (FRONT, MIRROR, "rotate: 180"),
        (LEFT, "plane: side", "rotate: 180"),
        (FRONT, "plane: horizontal", "mirror: x"),
    ],
)
def test_what_is_mirrored_is_found_with_what_mends_it(audience, more, mended):
    word, same = found(audience, more=more)
    assert word.message.startswith("`word` is mirrored for the audience")
    assert same.message.startswith("`same` is mirrored for the audience")
    assert mended in word.help


def test_people_on_both_sides_are_named():
    word, _ = found(f"{FRONT}, {BACK}")
    assert "audience `back`" in word.message
    assert "mirrored for `front`" in word.help


def test_a_picture_like_a_mirrored_one_may_be_turned_back():
    (word,) = found(BACK, again=TURN)
    assert "`word`" in word.message


def test_pictures_that_look_the_same_from_both_sides_are_no_finding():
    assert found(BACK, text="AHA") == []
    assert found(BACK, text="AHAB") != []


def test_letters_without_height_are_answered():
    text = "showc: 1\ndrones: 2\ntransitions: [eight]\nformations:\n"
    text += "  eight: {type: text, text: '8', height: 6, centre: [3, 3, 26]}\n"
    (word,) = [
        one for one in read_show(text.encode()).diagnostics if one.code == "SHW216"
    ]
    assert "letters are 0 m high" in word.message
    assert word.help.startswith("use 11 drones")


@pytest.mark.parametrize(
    ("text", "draw"),
    [("HELLO", "centreline"), ("WELCOME", "outline"), ("ABC", "inside")],
)
def test_as_many_drones_as_a_message_names_can_be_read(text, draw):
    def said(drones):
        word = f"{{type: text, text: {text}, height: 20, draw: {draw}}}"
        script = f"showc: 1\ndrones: {drones}\nformations: {{word: {word}}}\n"
        result = read_show(f"{script}transitions: [word]\n".encode())
        return [one.help for one in result.diagnostics if one.code == "SHW216"]

    (advice,) = said(9)
    needed = int(advice.split()[1])
    assert said(needed) == []
    assert said(needed // 2) != []


def test_outlines_whose_sides_are_nearer_than_their_places_cannot_be_read():
    word = "{type: text, text: WELCOME, height: 40, draw: outline}"
    script = (
        f"showc: 1\ndrones: 40\nformations: {{word: {word}}}\ntransitions: [word]\n"
    )
    codes = {one.code for one in read_show(script.encode()).diagnostics}
    assert "SHW216" in codes
