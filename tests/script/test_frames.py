"""Tables of frames: read as written, refused with the line, played as recorded."""

import base64
import json

import numpy as np
import pytest

DANCE = "time [s];place;x [m];y;z\n" + "".join(
    f"{0.5 * k};{place};{10 * place + 0.1 * k};{-0.2 * k};{20 + 0.05 * k}\n"
    for k in range(21)
    for place in (2, 1, 3)
)
SHOW = (
    "separation: 1.5\nformations:\n  it: {type: frames, file: dance.csv}\n"
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
        ("time,x,y,z\n0,1,2,3\n", "has no column place"),
        ("time,place,x,y,z\n0,1,1,1,1\n", "has 1 row of place 1"),
        (
            "time,place,x,y,z\n0,1,1,1,9\n1,1,1,1,9\n0,3,1,1,9\n1,3,1,1,9\n",
            "no rows of",
        ),
        ("time,place,x,y,z\n0,1,1,1,9\n0,1,1,1,9\n", "place 1 twice at 0 s"),
        ("time,place,x,y,z\n0,1,1,1,9\n1,1,1,,9\n", "line 3: y is not a number"),
        (
            "time,place,x,y,z\n# it\n0,1,nan,1,9\n1,1,1,1,9\n",
            "line 3: x is not a number",
        ),
        ("time,place,x,y,z\n0,1,1,1,1e9\n1,1,1,1,9\n", "line 2: z is not a number"),
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
    text = SHOW.replace("{type: frames, file: dance.csv}", "{type: circle, count: 4}")
    (found,) = read(text % "motion: [{follow: dance.csv}]").errors
    assert (
        found.code == "SHW205"
        and "has 4 places, but follows `dance.csv`" in found.message
    )


def test_a_file_of_places_has_no_frames_to_follow(read, tmp_path):
    (tmp_path / "dance.csv").write_text(DANCE)
    (tmp_path / "flat.csv").write_text("x,y,z\n1,2,3\n")
    (found,) = read(SHOW % "motion: [{follow: flat.csv}]").errors
    assert found.code == "SHW110" and "no column time" in found.message


def scene(nodes, way="LINEAR"):
    """Return a glTF whose nodes go through keys: times (n,), values (n, 3), y up."""
    numbers, accessors, views = b"", [], []
    samplers, channels = [], []

    def added(values, kind):
        nonlocal numbers
        content = np.asarray(values, "<f4").tobytes()
        views.append(
            {"buffer": 0, "byteOffset": len(numbers), "byteLength": len(content)}
        )
        numbers += content
        count = len(values)
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": 5126, "count": count,
             "type": kind}
        )  # fmt: skip
        return len(accessors) - 1

    for number, (times, values) in enumerate(nodes):
        ends = {"input": added(times, "SCALAR"), "output": added(values, "VEC3")}
        samplers.append(ends | {"interpolation": way})
        target = {"node": number, "path": "translation"}
        channels.append({"sampler": number, "target": target})
    data = "data:application/octet-stream;base64," + base64.b64encode(numbers).decode()
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "nodes": [{"name": f"d{k}"} for k in range(len(nodes))],
            "animations": [{"samplers": samplers, "channels": channels}],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": len(numbers), "uri": data}],
        }
    )


GLTF = SHOW.replace("dance.csv", "dance.gltf") % "motion: [{follow: dance.gltf}]"


def test_nodes_of_a_scene_are_followed_in_the_show_frame(show, tmp_path):
    # (x, y, z) of the show frame is (x, z, -y) of the scene.
    nodes = [
        ([0.0, 1.0, 4.0], [(0, 20, 0), (1, 20, 0), (1, 23, -6)]),
        ([1.0, 4.0], [(9, 20, 0), (9, 20, -3)]),
    ]
    (tmp_path / "dance.gltf").write_text(scene(nodes))
    found = show(GLTF)
    places = found.formations["it"].points
    assert places == pytest.approx(np.array([(0, 0, 20), (9, 0, 20)]))
    (motion,) = found.transitions[0].motion
    assert motion.length == 4.0
    assert motion.frames[1] == pytest.approx(np.array([(1, 2, 21), (9, 1, 20)]))


def test_splines_and_steps_of_a_scene_are_those_of_the_format(show, tmp_path):
    spline = [(0, 0, 0), (0, 20, 0), (3, 0, 0), (0, 3, 0), (0, 26, 0), (0, 0, 0)]
    still = [(0, 0, 0), (9, 20, 0), (0, 0, 0)] * 2
    nodes = [([0.0, 2.0], spline), ([0.0, 2.0], still)]
    (tmp_path / "dance.gltf").write_text(scene(nodes, "CUBICSPLINE"))
    motion = show(GLTF).transitions[0].motion[0]
    # Half way: the mean of the ends, and an eighth of the tangents' difference.
    middle = np.array([2.0 * 3.0 / 8.0, 0.0, 23.0 - 2.0 * 3.0 / 8.0])
    assert motion.frames[1, 0] == pytest.approx(middle)
    steps = [([0.0, 1.0, 2.0], [(0, 20, 0), (1, 21, 0), (2, 22, 0)])]
    steps.append(([0.0, 1.5], [(9, 20, 0), (9, 25, 0)]))
    (tmp_path / "dance.gltf").write_text(scene(steps, "STEP"))
    motion = show(GLTF).transitions[0].motion[0]
    assert motion.frames[:, 1, 2].tolist() == [20.0, 20.0, 25.0]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{}", "has no node whose translation is animated"),
        ("[", "is no JSON"),
        (scene([([0.0], [(0, 20, 0)])]), "has one moment only"),
        (scene([([0.0, 0.0], [(0, 20, 0), (1, 20, 0)])]), "time runs from 0 s to 0 s"),
        (scene([([0.0, 1.0], [(0, 20, 0), (np.nan, 20, 0)])]), "wanted finite numbers"),
    ],
)
def test_what_is_no_scene_of_frames_is_refused(read, tmp_path, content, message):
    (tmp_path / "dance.gltf").write_text(content)
    found = read(GLTF).errors
    assert len(found) == 1 and found[0].code == "SHW110"
    assert message in found[0].message
