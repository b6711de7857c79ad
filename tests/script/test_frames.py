"""Tables of frames: read as written, refused with the line, played as recorded."""

import numpy as np
import pytest

DANCE = "time [s];place;x [m];y;z\n" + "".join(
    f"{0.5 * k};{place};{10 * place + 0.1 * k};{-0.2 * k};{20 + 0.05 * k}\n"
    for k in range(21)
    for place in (2, 1, 3)
)
SHOW = (
    "separation: 1.5\nformations:\n  it: {type: csv, file: dance.csv}\n"
    "transitions:\n  - {to: it, %s}\nmission: {wanted: false}\n"
)


def test_a_formation_is_the_first_frame_and_its_hold_plays_all(show, tmp_path):
    (tmp_path / "dance.csv").write_text(DANCE)
    found = show(SHOW % "motion: [{follow: dance.csv}]")
    expected = [(10.0, 0.0, 20.0), (20.0, 0.0, 20.0), (30.0, 0.0, 20.0)]
    assert found.formations["it"].points == pytest.approx(np.array(expected))
    (transition,) = found.transitions
    (motion,) = transition.motion
    assert transition.hold == pytest.approx(10.0 + motion.ramp)
    assert motion.frames.shape == (21, 3, 3) and motion.length == 10.0
    assert motion.frames[4, 1] == pytest.approx((20.4, -0.8, 20.2))
    assert found.source.inputs["dance.csv"] == DANCE.encode()


def test_a_hold_that_is_written_holds(show, tmp_path):
    (tmp_path / "dance.csv").write_text(DANCE)
    text = SHOW % "motion: [{follow: {file: dance.csv, ramp: 1}}], hold: 30"
    assert show(text).transitions[0].hold == 30.0


def test_rows_at_uneven_moments_are_joined_by_straight_lines(show, tmp_path):
    rows = "0,1,0,0,20\n1,1,1,0,20\n4,1,1,0,23\n0,2,9,0,20\n4,2,9,4,20\n"
    (tmp_path / "dance.csv").write_text("time,place,x,y,z\n" + rows)
    motion = show(SHOW % "motion: [{follow: dance.csv}]").transitions[0].motion[0]
    assert motion.frames[1] == pytest.approx(np.array([(1, 0, 21), (9, 2, 20)]))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("time,x,y,z\n0,1,2,3\n", "has a column of times"),
        ("time,place,x,y,z\n0,1,1,1,1\n", "has 1 rows of place 1"),
        ("time,place,x,y,z\n0,1,1,1,9\n1,1,1,1,9\n0,3,1,1,9\n1,3,1,1,9\n", "0 rows of"),
        ("time,place,x,y,z\n0,1,1,1,9\n0,1,1,1,9\n", "place 1 twice at 0 s"),
        ("time,place,x,y,z\n0,1,1,1,9\n1,1,1,,9\n", "line 3: y is no number"),
        ("time,place,x,y,z\n# it\n0,1,nan,1,9\n1,1,1,1,9\n", "line 3: x is no number"),
        ("time,place,x,y,z\n0,1,1,1,1e9\n1,1,1,1,9\n", "line 2: z is no number"),
        ("time,place,x,y,z\n", "rows of place 1"),
    ],
)
def test_what_is_no_table_of_frames_is_refused_with_its_line(
    read, tmp_path, content, message
):
    (tmp_path / "dance.csv").write_text(content)
    found = read(SHOW % "hold: 3").errors
    assert len(found) == 1 and message in found[0].message and found[0].help


def test_a_formation_with_other_places_is_refused(read, tmp_path):
    (tmp_path / "dance.csv").write_text(DANCE)
    text = SHOW.replace("{type: csv, file: dance.csv}", "{type: circle, count: 4}")
    (found,) = read(text % "motion: [{follow: dance.csv}]").errors
    assert found.code == "SHW205" and "has 4 places, `dance.csv`" in found.message


def test_a_file_of_places_has_no_frames_to_follow(read, tmp_path):
    (tmp_path / "dance.csv").write_text(DANCE)
    (tmp_path / "flat.csv").write_text("x,y,z\n1,2,3\n")
    (found,) = read(SHOW % "motion: [{follow: flat.csv}]").errors
    assert found.code == "SHW110" and "no column time" in found.message
