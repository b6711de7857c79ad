"""Shows of others: read as they are, judged right, and never trusted."""

import base64
import io
import json
import struct
import zipfile
import zlib
from warnings import catch_warnings, simplefilter

import numpy as np
import pytest

from showc.errors import DamagedFileError, UsageError
from showc.foreign.acts import holds
from showc.foreign.facts import Asked
from showc.foreign.firmware import as_stored
from showc.foreign.motion import derivative, place_at
from showc.foreign.reading import read_show
from showc.foreign.verdict import Questions, verify_foreign
from showc.log.showc_pb2 import Separation


def trajectory(*points, takeoff=0):
    return {"version": 1, "points": list(points), "takeoffTime": takeoff}


# Skybrush's own loader evaluated this one.
CURVED = trajectory(
    [0, [0, 0, 0], []],
    [4, [0, 0, 10], [[0, 0, 0], [0, 0, 10]]],
    [9, [6, 3, 12], [[2, 0, 10], [4, 3, 12]]],
    [12, [6, 3, 12], []],
    [20, [0, 0, 0], []],
    takeoff=2,
)
UP = trajectory([0, [0, 0, 0], []], [10, [0, 0, 10], []], [20, [0, 0, 0], []])


def show_of(*trajectories, **settings):
    return {
        "version": 1,
        "settings": settings,
        "swarm": {
            "drones": [
                {"type": "generic", "settings": {"name": f"d{k}", "trajectory": one}}
                for k, one in enumerate(trajectories)
            ]
        },
    }


def zipped(path, **entries):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            text = content if isinstance(content, (str, bytes)) else json.dumps(content)
            archive.writestr(name.replace("__", "/").replace("_json", ".json"), text)
    return path


@pytest.fixture
def skyc(tmp_path):
    def write(show, **more):
        return zipped(tmp_path / "show.skyc", show_json=show, **more)

    return write


def findings(path, **options):
    result = verify_foreign(path, Questions(**options))
    assert result.passed != any_failed(result)
    return {check.code: check for check in result.checks if check.verdict == "fail"}


def any_failed(result):
    return any(check.verdict == "fail" for check in result.checks)


def test_curves_are_those_that_skybrush_evaluates(skyc):
    tracks = read_show(skyc(show_of(CURVED))).tracks
    heights = [place_at(tracks, time)[0, 2] for time in (4, 6, 8, 10, 16, 22)]
    assert heights == pytest.approx([5, 10, 10.704, 11.792, 9, 0])
    assert place_at(tracks, 8.0)[0, :2] == pytest.approx([2.4, 1.056])
    assert place_at(derivative(tracks), 8.0)[0] == pytest.approx([1.2, 0.864, 0.576])


def test_references_of_all_kinds_are_followed(skyc):
    show = show_of({"$ref": "./drones/a.json#/inner"}, {"$ref": "drones/b.json#"})
    path = skyc(show, drones__a_json={"inner": CURVED}, drones__b_json=CURVED)
    tracks = read_show(path).tracks
    assert place_at(tracks, 6.0)[0] == pytest.approx(place_at(tracks, 6.0)[1])


def test_pieces_without_duration_are_skipped_and_their_jumps_found(skyc):
    points = [[0, [0, 0, 0], []], [10, [0, 0, 10], []], [10, [0, 0, 10], []]]
    same = trajectory(*points, [20, [0, 0, 0], []])
    assert "VRF502" not in findings(skyc(show_of(same)))
    points[2] = [10, [2, 0, 10], []]
    moved = trajectory(*points, [20, [2, 0, 0], []])
    jump = findings(skyc(show_of(moved)))["VRF502"]
    assert (jump.value, jump.where.time) == (pytest.approx(2.0), pytest.approx(10.0))


def test_the_firmware_gets_what_the_server_cuts_off(skyc):
    # 1.001 times 1000 is 1000.9999999999999, of which the server keeps 1000.
    points = [0, [0, 0, 0], []], [5, [1.001, 1.002, 10], []], [9, [0, 0, 0], []]
    played, _, _ = as_stored(read_show(skyc(show_of(trajectory(*points)))))
    assert place_at(played, 5.0)[0] == pytest.approx([1.0, 1.002, 10.0], abs=1e-9)


def test_a_bearing_may_be_text(skyc):
    location = {"origin": [474733505, 190620195], "orientation": "59.5"}
    show = show_of(UP) | {"environment": {"location": location}}
    assert read_show(skyc(show)).location.orientation == 59.5
    location["orientation"] = "north"
    assert "wanted a number" in findings(skyc(show))["VRF501"].notes[0]


def test_an_encounter_between_two_samples_is_found(skyc):
    # Five samples a second see 5 m and more; in between they come to 2.5 m.
    speed = 60.0

    def crossing(sign):
        y = sign * 1.25
        times = np.round(np.arange(0.0, 4.01, 0.2), 3)
        x = sign * speed * (times - 2.1)
        return trajectory(
            *[[t, [a, y, 20.0], []] for t, a in zip(times, x, strict=True)]
        )

    path = skyc(show_of(crossing(1), crossing(-1)))
    tracks = read_show(path).tracks
    sampled = min(
        np.linalg.norm(np.subtract(*place_at(tracks, time)))
        for time in np.arange(0.0, 4.01, 0.2)
    )
    assert sampled > 5.0
    asked = Asked("asked", Separation(distance=3.0, vertical_stretch=1.0))
    found = findings(path, asked=asked)["VRF504"]
    assert found.value == pytest.approx(2.5, abs=1e-3)
    assert found.where.time == pytest.approx(2.1, abs=1e-3)


def test_the_files_own_rules_and_the_users_are_judged_apart(skyc):
    validation = {"maxAltitude": 12, "maxVelocityZ": 2, "minDistance": 5}
    beside = trajectory([0, [4, 0, 0], []], [10, [4, 0, 10], []], [20, [4, 0, 0], []])
    path = skyc(show_of(UP, beside, validation=validation))
    asked = Asked("asked", Separation(distance=3.0, vertical_stretch=1.0), 8.0)
    result = verify_foreign(path, Questions(asked=asked))
    verdicts = {check.name: check.verdict for check in result.checks}
    assert verdicts["separation of all pairs, the file's own"] == "fail"
    assert verdicts["separation of all pairs, asked"] == "pass"
    assert verdicts["height, the file's own"] == "pass"
    assert verdicts["height, asked"] == "fail"
    assert verdicts["climb, the file's own"] == "pass"


@pytest.mark.parametrize(("apart", "verdict"), [(0.0, "fail"), (0.1, "skipped")])
def test_aircraft_that_touch_are_a_fault_whatever_is_asked(skyc, apart, verdict):
    def up(x):
        return trajectory([0, [x, 0, 0], []], [10, [x, 0, 10], []], [20, [x, 0, 0], []])

    found = verify_foreign(skyc(show_of(up(0.0), up(apart))), Questions())
    check = found.check("VRF504")
    assert (check.verdict, check.value) == (verdict, pytest.approx(apart, abs=1e-4))
    assert any("touch" in note for note in check.notes) is (verdict == "fail")


def test_without_a_least_distance_nothing_is_called_proved(skyc):
    slowly = [(0, 0), (10, 10), (20, 0)]
    path = skyc(
        show_of(
            *(
                trajectory(*([t, [x, 0, z], []] for t, z in slowly), takeoff=10)
                for x in (0, 4)
            )
        )
    )
    result = verify_foreign(path)
    assert result.verdict.startswith("MEASURED, NOT JUDGED: ")
    assert result.passed and not result.proved
    asked = Asked("asked", Separation(distance=3.0, vertical_stretch=1.0))
    assert verify_foreign(path, Questions(asked=asked)).proved
    asked.separation.distance = 5.0
    found = verify_foreign(path, Questions(asked=asked))
    assert found.verdict.startswith("NOT PROVED: ") and not found.passed


def test_a_fence_of_the_file_is_kept_at_every_instant(skyc):
    fence = {
        "polygons": [
            {"isInclusion": True, "points": [[-9, -9], [9, -9], [9, 9], [-9, 9]]},
            {"isInclusion": False, "points": [[4, -1], [6, -1], [6, 1], [4, 1]]},
        ]
    }
    away = trajectory([0, [0, 3, 0], []], [10, [8, 3, 9], []])
    through = trajectory([0, [0, 0, 0], []], [10, [8, 0, 9], []])
    assert "VRF508" not in findings(skyc(show_of(away, geofence=fence)))
    found = findings(skyc(show_of(through, geofence=fence)))["VRF508"]
    assert found.value == pytest.approx(1.0, abs=1e-3)


def test_three_answers_are_kept_apart(skyc):
    result = verify_foreign(skyc(show_of(UP)))
    assert list(dict.fromkeys(check.group for check in result.checks)) == [
        "what the file says",
        "whether it can be flown",
        "what the firmware makes of it",
    ]


def test_flights_without_a_time_are_damage(skyc):
    instant = trajectory([0, [0, 0, 0], []], [1e-300, [0, 0, 9], []])
    result = verify_foreign(skyc(show_of(instant)))
    assert not result.passed
    assert "flights take 1e-300 s" in str(result.checks[0].notes)


def test_durations_that_the_server_shortens_are_said(skyc):
    times = np.round(np.arange(0.0, 20.0, 1.001), 3)
    slow = trajectory(*[[t, [0, 0, 0.5 * t], []] for t in times.tolist()])
    result = verify_foreign(skyc(show_of(slow)))
    notes = " ".join(result.check("VRF541").notes)
    assert "shortens 19 durations by 1 ms" in notes


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[0, [0, 0, 0], []], [1, [0, 0, float("nan")], []]], "nan"),
        ([[0, [0, 0, 0], []], [1, [0, 0, 1e300], []]], "1e+300"),
        ([[5, [0, 0, 0], []], [1, [0, 0, 1], []]], "time runs from 5 s to 1 s"),
        ([[0, [0, 0, 0], []], [1, "up", []]], "wanted numbers"),
        ([[0, [0, 0, 0], []], [1, [0, 0], []]], "wanted"),
        ([[0, [0, 0, 0], []], [1, [0, 0, 1], [[0, 0, 0]] * 7]], "7 inner control"),
        ([[0, [0, 0, 0], []], [1e12, [0, 0, 1], []]], "1e+12"),
        ([[0, [0, 0, 0], []], {}], "not [time, place, controls]"),
        ([], "no trajectory"),
    ],
)
def test_bad_points_end_in_one_finding(skyc, points, message):
    found = findings(skyc(show_of(trajectory(*points))))
    assert set(found) == {"VRF501"}
    assert message in found["VRF501"].notes[0]


def nested(depth):
    return "[" * depth + "]" * depth


def hostile_archives(path):
    """Archives that want to do harm, by name."""
    with zipfile.ZipFile(path / "bomb.skyc", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("show.json", b"0" * (1 << 24))
    with zipfile.ZipFile(path / "out.skyc", "w") as archive:
        archive.writestr("../../evil.json", "{}")
    with zipfile.ZipFile(path / "root.skyc", "w") as archive:
        archive.writestr("/etc/evil.json", "{}")
    with zipfile.ZipFile(path / "many.skyc", "w") as archive:
        for index in range(20_001):
            archive.writestr(f"{index}", "")
    circle = show_of({"$ref": "./a.json"})
    zipped(
        path / "circle.skyc",
        show_json=circle,
        a_json={"$ref": "./b.json"},
        b_json={"$ref": "./a.json"},
    )
    zipped(path / "itself.skyc", show_json={"$ref": "./show.json"})
    zipped(path / "leads-out.skyc", show_json=show_of({"$ref": "../../etc/passwd"}))
    zipped(path / "nowhere.skyc", show_json=show_of({"$ref": "./no.json"}))
    zipped(path / "pointer.skyc", show_json=show_of({"$ref": "./show.json#/x/9"}))
    zipped(path / "deep.skyc", show_json=nested(100_000))
    zipped(path / "wide.skyc", show_json="[" + "[]," * 5_000_000 + "[]]")
    same = [{"$ref": "./a.json"}] * 5000
    zipped(path / "same.skyc", show_json=show_of(*same), a_json=CURVED)
    fan = [{"$ref": f"./a.json#/{k}"} for k in range(5000)]
    a, b = [{"$ref": f"./b.json#/{k % 9}"} for k in range(5000)], [CURVED] * 9
    zipped(path / "fan.skyc", show_json=show_of(*fan), a_json=a, b_json=b)
    inner = [trajectory() | {"points": {"$ref": "./a.json"}} for _ in range(5000)]
    zipped(path / "points.skyc", show_json=show_of(*inner), a_json=CURVED["points"])
    star = {"isInclusion": True, "points": [[k, k * k % 7] for k in range(600)]}
    fenced = show_of(UP, geofence={"polygons": [star, star]})
    zipped(path / "fences.skyc", show_json=fenced)
    zipped(path / "none.skyc", other_json="{}")
    zipped(path / "empty.skyc", show_json=show_of())
    zipped(path / "crowd.skyc", show_json=show_of(*[UP] * 5001))
    (path / "noise.skyc").write_bytes(bytes(range(256)) * 40)
    cut = (path / "circle.skyc").read_bytes()
    (path / "cut.skyc").write_bytes(cut[: len(cut) // 2])
    wrong = bytearray((path / "nowhere.skyc").read_bytes())
    wrong[60] ^= 0xFF
    (path / "wrong.skyc").write_bytes(bytes(wrong))
    return sorted(path.glob("*.skyc"))


def test_hostile_archives_end_in_one_finding(tmp_path):
    archives = hostile_archives(tmp_path)
    assert len(archives) == 21
    for path in archives:
        found = findings(path)
        assert set(found) == {"VRF501"}, path
        assert not (tmp_path.parent / "evil.json").exists()


def test_a_light_loop_without_end_is_played_no_longer_than_the_flight(skyc):
    forever = base64.b64encode(bytes([12, 0, 4, 255, 0, 0, 1, 7, 1, 13])).decode()
    show = show_of(UP)
    show["swarm"]["drones"][0]["settings"]["lights"] = {"version": 1, "data": forever}
    assert "VRF547" not in findings(skyc(show))
    without = base64.b64encode(bytes([12, 0, 1, 13, 0])).decode()
    show["swarm"]["drones"][0]["settings"]["lights"]["data"] = without
    assert "VRF547" not in findings(skyc(show))
    unknown = base64.b64encode(bytes([99])).decode()
    show["swarm"]["drones"][0]["settings"]["lights"]["data"] = unknown
    assert "command 99" in findings(skyc(show))["VRF547"].notes[0]


TABLE = "Time [msec],x [m],y [m],z [m],Red,Green,Blue\n"


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0,0,0,0,1,2,3\n0,0,0,1,1,2,3\n", "wanted times that rise"),
        ("0,0,0,0,1,2,3\n500,0,nan,1,1,2,3\n", "wanted finite numbers"),
        ("0,0,0,0,1,2,3\n500,0,0,1,1,2\n", "6 columns"),
        ("0,0,0,0,1,2,3\n500,0,0,x,1,2,3\n", "no number"),
        ("0,0,0,0,1,2,300\n500,0,0,1,1,2,3\n", "three numbers from 0 to 255"),
        ("", "0 lines of numbers"),
    ],
)
def test_bad_tables_end_in_one_finding(tmp_path, rows, message):
    (tmp_path / "1.csv").write_text(TABLE + rows)
    found = findings(tmp_path)
    assert set(found) == {"VRF501"}
    assert message in found["VRF501"].notes[0]


def test_a_table_without_heading_or_colours_is_read(tmp_path):
    (tmp_path / "Drone 2.csv").write_text("0,1,2,3\n1000,1,2,5\n")
    (tmp_path / "Drone 10.csv").write_text("0,1,2,9\r\n1000,1,2,9\r\n")
    show = read_show(tmp_path)
    assert show.names == ("Drone 2", "Drone 10")
    assert place_at(show.tracks, 0.5)[0] == pytest.approx([1, 2, 4])


def test_two_drones_of_one_name_are_refused(tmp_path):
    path = tmp_path / "show.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a/1.csv", "0,0,0,0\n")
        archive.writestr("b/1.csv", "0,0,0,0\n")
    assert "two drones named" in findings(path)["VRF501"].notes[0]


HEAD = "Time [msec],x [m],y [m],z [m],Red,Green,Blue"
ROWS = ((0, 1.5, 0, 0), (1000, 1.5, 0, 0), (5000, 1.5, -2, 6))


def sheet(head=HEAD, times=1.0, lengths=1.0, order=lambda place, light: place + light):
    """A table of one drone as text, in other units or another order of columns."""
    lines = [head] if head else []
    for time, *place in ROWS:
        cells = [f"{value * lengths:g}" for value in place]
        cells = order(cells, ["255", "0", "10"])
        lines.append(",".join([f"{time * times:g}", *cells]))
    return "\n".join(lines) + "\n"


WRITTEN = {
    "as Skybrush does": sheet().encode(),
    "by Windows": ("\ufeff" + sheet()).replace("\n", "\r\n").encode(),
    "by an old Mac": sheet().replace("\n", "\r").encode(),
    "in UTF-16": sheet().encode("utf-16"),
    "with commas in numbers": sheet().replace(",", ";").replace(".", ",").encode(),
    "with tabs": sheet().replace(",", "\t").encode(),
    "with quotes": ('"' + sheet().strip().replace("\n", '"\n"').replace(",", '","') +
        '"').encode(),
    "with empty cells": sheet().replace("\n", ",\n").encode(),
    "with a comment": ("# made by hand\n\n" + sheet()).encode(),
    "without a heading": sheet("").encode(),
    "in seconds": sheet(HEAD.replace("msec", "s"), 1e-3).encode(),
    "in centimetres": sheet(HEAD.replace("[m]", "[cm]"), 1.0, 100.0).encode(),
    "in feet": sheet(HEAD.replace("[m]", "[ft]"), 1.0, 1.0 / 0.3048).encode(),
    "in round brackets": sheet("Time (ms),x (m),y (m),z (m),R,G,B").encode(),
    "with underscores": sheet("time_msec,x_cm,pos_y_cm,z_cm,red,green,blue", 1.0, 100.0
        ).encode(),
    "in seconds, unsaid": sheet("t,x,y,z,r,g,b", 1e-3).encode(),
    "in seconds, without a heading": sheet("", 1e-3).encode(),
    "with shares of light": sheet(order=lambda place, light: place +
        [str(int(one) / 255.0) for one in light]).encode(),
    "colours first": sheet("t,r,g,b,x,y,z", order=lambda place, light: light + place
        ).encode(),
    "with yaw": sheet(HEAD + ",Yaw [deg]", order=lambda place, light: place + light +
        ["90"]).encode(),
}  # fmt: skip


@pytest.mark.parametrize("name", WRITTEN)
def test_tables_are_read_however_they_were_written(tmp_path, name):
    (tmp_path / "1.csv").write_bytes(WRITTEN[name])
    show = read_show(tmp_path)
    assert place_at(show.tracks, 3.0)[0] == pytest.approx([1.5, -1.0, 3.0], abs=1e-4)
    assert show.duration == pytest.approx(5.0)
    assert show.lights[0].at(np.array([2.0]))[0] == pytest.approx([255, 0, 10])


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("frame,x,y,z,Red,Green,Blue", "no column t"),
        ("Time [msec],x [m],y [m],h [m],Red,Green,Blue", "no column z"),
        ("Time [min],x [m],y [m],z [m],Red,Green,Blue", "unit that is not known"),
        ("Time [msec],x [m],x [m],z [m],Red,Green,Blue", "twice"),
        ("Time [msec],x [m],y [m],z [m]", "its heading has 4"),
    ],
)
def test_headings_that_mean_something_else_are_refused(tmp_path, head, said):
    (tmp_path / "1.csv").write_text(sheet(head))
    assert said in findings(tmp_path)["VRF501"].notes[0]


def test_a_file_whose_up_is_another_axis_is_remarked(tmp_path):
    rows = [[0, 0, 0, 0], [5000, 3, 12, -9], [9000, 0, 0, 0]]
    text = "\n".join(",".join(map(str, row)) for row in rows)
    (tmp_path / "1.csv").write_text(text)
    found = [one for one in verify_foreign(tmp_path).checks if "depth" in one.name]
    assert [one.verdict for one in found] == ["warning"]
    assert found[0].value == pytest.approx(9.0, abs=1e-2)


def test_more_tables_than_there_are_drones_are_refused(tmp_path):
    path = tmp_path / "show.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for number in range(5001):
            archive.writestr(f"{number}.csv", "")
    assert "5,001 .csv files" in findings(path)["VRF501"].notes[0]


def scene(count=3, **changes):
    times = np.arange(count, dtype="<f4").tobytes()
    places = np.arange(3 * count, dtype="<f4").tobytes()
    data = base64.b64encode(times + places).decode()
    accessor = {"componentType": 5126, "count": count}
    top = {
        "asset": {"version": "2.0"},
        "nodes": [{"name": "a"}],
        "buffers": [{"uri": f"data:;base64,{data}", "byteLength": 16 * count}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 4 * count},
            {"buffer": 0, "byteOffset": 4 * count, "byteLength": 12 * count},
        ],
        "accessors": [
            {**accessor, "bufferView": 0, "type": "SCALAR"},
            {**accessor, "bufferView": 1, "type": "VEC3"},
        ],
        "animations": [
            {
                "samplers": [{"input": 0, "output": 1}],
                "channels": [
                    {"sampler": 0, "target": {"node": 0, "path": "translation"}}
                ],
            }
        ],
    }
    return top | changes


def test_what_lies_beside_tables_of_a_mac_is_no_drone(tmp_path):
    path = tmp_path / "show.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("show/a.csv", "0,0,0,0\n9000,0,0,5\n")
        archive.writestr("__MACOSX/show/._a.csv", bytes(range(256)))
    assert read_show(path).names == ("a",)


def test_what_is_wrong_in_a_table_names_the_archive_and_the_entry(tmp_path):
    path = tmp_path / "show.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("night/a.csv", "0,0,0,0\n9000,0,0,5\n")
        archive.writestr("night/b.csv", "0,0,0,0\n9000,0,0\n")
    with pytest.raises(DamagedFileError) as refused:
        read_show(path)
    assert str(refused.value).startswith(f"{path}: night/b.csv: line 2 has 3 columns")
    alone = tmp_path / "b.csv"
    alone.write_text("0,0,0,0\n9000,0,0\n")
    with pytest.raises(DamagedFileError) as refused:
        read_show(alone)
    assert str(refused.value).startswith(f"{alone}: line 2 has")


def test_numbers_that_python_alone_reads_are_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("0,0,0,0\n9_000,0,0,5\n")
    with pytest.raises(DamagedFileError, match="no number"):
        read_show(path)


@pytest.mark.parametrize("offset", [-4, 4])
def test_an_accessor_stays_within_its_view(offset, tmp_path):
    path, top = tmp_path / "a.gltf", scene()
    top["accessors"][1]["byteOffset"] = offset
    path.write_text(json.dumps(top))
    with pytest.raises(DamagedFileError, match="bufferView"):
        read_show(path)


def test_a_way_between_keys_that_is_not_known_is_refused(tmp_path):
    path, top = tmp_path / "a.gltf", scene()
    top["animations"][0]["samplers"][0]["interpolation"] = "CATMULLROM"
    path.write_text(json.dumps(top))
    with pytest.raises(DamagedFileError, match="'CATMULLROM'"):
        read_show(path)


def test_scenes_are_turned_into_the_show_frame(tmp_path):
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(scene()))
    tracks = read_show(path).tracks
    # (x, y up, z) of glTF is (x, -z, y) of the show frame.
    assert place_at(tracks, 0.0)[0] == pytest.approx([0, -2, 1])
    assert place_at(tracks, 1.5)[0] == pytest.approx([4.5, -6.5, 5.5])


@pytest.mark.parametrize(
    "changes",
    [
        {"accessors": [{"componentType": 5126, "count": 10**9, "type": "SCALAR"}] * 2},
        {"accessors": [{"bufferView": 0, "componentType": 5126, "count": 9**9,
                        "type": "SCALAR"}] * 2},
        {"bufferViews": [{"buffer": 0, "byteOffset": -4}] * 2},
        {"buffers": [{"uri": "../../../etc/passwd"}]},
        {"buffers": [{"uri": "http://example.org/x"}]},
        {"buffers": []},
        {"animations": []},
        {"nodes": []},
    ],
)  # fmt: skip
def test_bad_scenes_end_in_one_finding(tmp_path, changes):
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(scene(**changes)))
    assert set(findings(path)) == {"VRF501"}


TILTED = {"rotation": [0.0, 0.6, 0.0, 0.8], "scale": [2.0, 1.0, 0.5]}
"""A turn about the height axis, and a stretch."""


def test_a_drone_is_where_the_nodes_above_it_put_it(tmp_path):
    # By columns: y to x, x to -y, and 10 higher.
    matrix = [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 10, 0, 1]
    nodes = [
        {"name": "a"},
        {"children": [0], "translation": [1.0, 2.0, 3.0], **TILTED},
        {"children": [1], "matrix": matrix},
    ]
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(scene(nodes=nodes)))
    place = np.array([3.0, 4.0, 5.0]) * TILTED["scale"]
    sine, cosine = 0.96, 0.28
    turned = [cosine * place[0] + sine * place[2], place[1],
              cosine * place[2] - sine * place[0]]  # fmt: skip
    x, y, z = np.array(turned) + [1.0, 2.0, 3.0]
    found = place_at(read_show(path).tracks, 1.0)[0]
    assert found == pytest.approx([y, -z, 10.0 - x])


def test_tangents_are_turned_and_not_shifted(tmp_path):
    keys = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [4, 0, 0], [0, 0, 0]])
    data = np.arange(2, dtype="<f4").tobytes() + keys.astype("<f4").tobytes()
    top = scene(2, nodes=[{"name": "a"}, {"children": [0], "translation": [5, 0, 0],
                                          "rotation": [0, 0, 1, 0]}])  # fmt: skip
    top["buffers"] = [{"uri": "data:;base64," + base64.b64encode(data).decode()}]
    top["accessors"][1]["count"] = 6
    top["bufferViews"][1]["byteLength"] = 72
    top["animations"][0]["samplers"][0]["interpolation"] = "CUBICSPLINE"
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    tracks = read_show(path).tracks
    assert place_at(tracks, 0.0)[0] == pytest.approx([5, 0, 0])
    assert place_at(tracks, 1.0)[0] == pytest.approx([1, 0, 0])
    assert place_at(derivative(tracks), 0.0)[0] == pytest.approx([-1, 0, 0])


def test_a_second_clip_for_a_drone_is_named_and_refused(tmp_path):
    top = scene()
    clip = top["animations"][0]
    top["animations"] = [clip | {"name": "take one"}, clip | {"name": "take two"}]
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    (note,) = findings(path)["VRF501"].notes
    assert "'take one' and animation 'take two'" in note


def test_a_buffer_may_have_a_name_with_blanks(tmp_path):
    top = scene()
    data = base64.b64decode(top["buffers"][0]["uri"].partition(",")[2])
    (tmp_path / "my show.bin").write_bytes(data)
    top["buffers"][0]["uri"] = "my%20show.bin"
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    assert place_at(read_show(path).tracks, 1.5)[0] == pytest.approx([4.5, -6.5, 5.5])
    top["buffers"][0]["uri"] = "%2E%2E/my%20show.bin"
    path.write_text(json.dumps(top))
    assert "leads to" in findings(path)["VRF501"].notes[0]


def test_a_place_that_is_not_finite_is_refused_without_a_warning(tmp_path):
    keys = np.array([0, 1, 2, 0, 0, 0, np.inf, 0, 0, 3, 0, 0], "<f4")
    data = base64.b64encode(keys.tobytes()).decode()
    path = tmp_path / "a.gltf"
    path.write_text(
        json.dumps(scene(buffers=[{"uri": f"data:;base64,{data}", "byteLength": 48}]))
    )
    with catch_warnings():
        simplefilter("error")
        with pytest.raises(DamagedFileError, match="node 0: point 2 is at"):
            read_show(path)


def coloured(material, *channels):
    """Return a scene of one drone that shows a material, which channels may change.

    A channel is (pointer, kind, times, values, way).
    """
    top = scene(nodes=[{"name": "a", "mesh": 0}], materials=[material])
    top["meshes"] = [{"primitives": [{"attributes": {}, "material": 0}]}]
    data = base64.b64decode(top["buffers"][0]["uri"].partition(",")[2])
    animation = top["animations"][0]
    for pointer, kind, times, values, way in channels:
        sampler = {"interpolation": way}
        for key, numbers, what in (
            ("input", times, "SCALAR"),
            ("output", values, kind),
        ):
            content = np.array(numbers, dtype="<f4").tobytes()
            view = {"buffer": 0, "byteOffset": len(data), "byteLength": len(content)}
            top["bufferViews"].append(view)
            view = {"bufferView": len(top["bufferViews"]) - 1, "componentType": 5126}
            top["accessors"].append(view | {"count": len(numbers), "type": what})
            sampler[key] = len(top["accessors"]) - 1
            data += content
        animation["samplers"].append(sampler)
        pointed = {"KHR_animation_pointer": {"pointer": f"/materials/0/{pointer}"}}
        animation["channels"].append(
            {
                "sampler": len(animation["samplers"]) - 1,
                "target": {"path": "pointer", "extensions": pointed},
            }
        )
    top["buffers"] = [{"uri": "data:;base64," + base64.b64encode(data).decode()}]
    return top


def light_of(tmp_path, *given):
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(coloured(*given)))
    (light,) = read_show(path).lights or (None,)
    return light


def test_a_drone_of_a_scene_shines_as_its_material(tmp_path):
    base = {"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 1.0, 0.5]}}
    assert light_of(tmp_path, base).at(np.array([3.0]))[0] == pytest.approx(
        [51, 102, 255]
    )
    emits = base | {"emissiveFactor": [1.0, 0.0, 0.5]}
    assert light_of(tmp_path, emits).at(np.zeros(1))[0] == pytest.approx(
        [255, 0, 127.5]
    )
    strong = {
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 8}}
    }
    bright = light_of(tmp_path, emits | strong)
    assert bright.at(np.zeros(1))[0] == pytest.approx([255, 0, 127.5])
    painted = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    assert light_of(tmp_path, painted) is None


def test_lights_of_a_scene_change_with_its_materials(tmp_path):
    emits = {"emissiveFactor": [1.0, 0.0, 0.0]}
    fade = ("emissiveFactor", "VEC3", [0, 2], [[1, 0, 0], [0, 0, 1]], "LINEAR")
    found = light_of(tmp_path, emits, fade).at(np.array([0.0, 1.0, 3.0]))
    assert found == pytest.approx(
        np.array([[255, 0, 0], [127.5, 0, 127.5], [0, 0, 255]])
    )
    jump = ("emissiveFactor", "VEC3", [0, 2], [[1, 0, 0], [0, 0, 1]], "STEP")
    found = light_of(tmp_path, emits, jump).at(np.array([1.9, 2.0]))
    assert found == pytest.approx(np.array([[255, 0, 0], [0, 0, 255]]))
    dims = (
        "extensions/KHR_materials_emissive_strength/emissiveStrength",
        "SCALAR", [0, 4], [10.0, 0.0], "LINEAR",
    )  # fmt: skip
    found = light_of(tmp_path, emits, dims).at(np.array([0.0, 1.0, 4.0]))
    assert found[:, 0] == pytest.approx([255, 191.25, 0])
    keys = [[0] * 4, [0] * 4, [0] * 4, [0] * 4, [1] * 4, [0] * 4]
    base = "pbrMetallicRoughness/baseColorFactor"
    soft = (base, "VEC4", [0, 1], keys, "CUBICSPLINE")
    found = light_of(tmp_path, {}, soft).at(np.array([0.25, 0.5, 1.0]))
    assert found[:, 1] == pytest.approx([255 * 0.15625, 127.5, 255])


def test_what_steps_from_place_to_place_jumps(tmp_path):
    top = scene()
    top["animations"][0]["samplers"][0]["interpolation"] = "STEP"
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    assert "VRF502" in findings(path)
    assert place_at(read_show(path).tracks, 0.9)[0] == pytest.approx([0, -2, 1])


def test_a_fleet_that_only_steps_is_judged_and_holds_between(tmp_path):
    # Up by the firmware's take-off height, then aside, and down.
    keys = [0, 2, 4, 6, 0, 0, 0, 0, 2.5, 0, 3, 2.5, 0, 0, 0, 0]
    data = base64.b64encode(np.array(keys, "<f4").tobytes()).decode()
    buffers = [{"uri": f"data:;base64,{data}", "byteLength": 64}]
    top = scene(4, buffers=buffers)
    top["animations"][0]["samplers"][0]["interpolation"] = "STEP"
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    assert "VRF502" in findings(path)
    assert holds(read_show(path).tracks) == [(0, 2), (2, 4), (4, 6)]


def test_nodes_of_another_scene_do_not_fly(tmp_path):
    top = scene(nodes=[{"name": "a"}, {"name": "b", "children": [2]}, {"name": "c"}])
    animation = top["animations"][0]
    animation["channels"].append(
        {"sampler": 0, "target": {"node": 2, "path": "translation"}}
    )
    path = tmp_path / "a.gltf"
    for shown, names in (({"nodes": [0]}, ("a",)), ({"nodes": [1]}, ("c",))):
        path.write_text(json.dumps(top | {"scene": 0, "scenes": [shown]}))
        assert read_show(path).names == names


def test_pieces_are_known_by_their_columns_without_a_heading(tmp_path):
    folder = tmp_path / "pieces"
    folder.mkdir()
    (folder / "a.csv").write_text(f"1{',0' * 16},3,1{',0' * 14}\n")
    found = read_show(folder)
    assert found.format == "poly7 .csv"
    assert place_at(found.tracks, 0.5)[0] == pytest.approx([0, 0, 3.5])


def test_a_material_that_two_channels_change_is_refused(tmp_path):
    fade = ("emissiveFactor", "VEC3", [0, 2], [[1, 0, 0], [0, 0, 1]], "LINEAR")
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(coloured({}, fade, fade)))
    assert set(findings(path)) == {"VRF501"}


def test_a_pointer_to_a_nodes_place_moves_it(tmp_path):
    top = scene()
    target = top["animations"][0]["channels"][0]["target"]
    pointed = {"pointer": f"/nodes/{target.pop('node')}/translation"}
    target |= {"path": "pointer", "extensions": {"KHR_animation_pointer": pointed}}
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    assert place_at(read_show(path).tracks, 1.5)[0] == pytest.approx([4.5, -6.5, 5.5])


def test_replaced_entries_of_a_sparse_accessor_are_read(tmp_path):
    top = scene(3)
    data = np.array([2], dtype="<u2").tobytes() + bytes(2)
    data += np.array([7, 8, 9], dtype="<f4").tobytes()
    top["buffers"].append({"uri": "data:;base64," + base64.b64encode(data).decode()})
    top["bufferViews"] += [
        {"buffer": 1, "byteLength": 2},
        {"buffer": 1, "byteOffset": 4, "byteLength": 12},
    ]
    sparse = {
        "count": 1,
        "indices": {"bufferView": 2, "componentType": 5123},
        "values": {"bufferView": 3},
    }
    top["accessors"][1]["sparse"] = sparse
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    tracks = read_show(path).tracks
    assert place_at(tracks, 1.0)[0] == pytest.approx([3, -5, 4])
    assert place_at(tracks, 2.0)[0] == pytest.approx([7, -9, 8])
    # Without a view of its own all else is zero.
    del top["accessors"][1]["bufferView"]
    path.write_text(json.dumps(top))
    assert place_at(read_show(path).tracks, 1.0)[0] == pytest.approx([0, 0, 0])
    sparse["indices"]["componentType"] = 5126
    path.write_text(json.dumps(top))
    assert "whole numbers" in findings(path)["VRF501"].notes[0]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"nodes": [{"name": "a"}, {"children": [0]}], "channel": "translation"},
         "moves too"),
        ({"nodes": [{"name": "a"}, {"children": [0]}], "channel": "rotation"},
         "moves too"),
        ({"nodes": [{"name": "a"}, {"children": [2]}, {"mesh": 0}],
          "channel": "rotation"}, "swung about"),
        ({"nodes": [{"name": "a", "children": [1]}, {"children": [0]}]},
         "carries itself"),
        ({"nodes": [{"name": "a"}, {"children": [0]}, {"children": [0]}]},
         "two parents"),
        ({"packed": {"EXT_meshopt_compression": {}}}, "export without compression"),
    ],
)  # fmt: skip
def test_scenes_that_cannot_be_read_rightly_are_refused(tmp_path, changes, said):
    top = scene(nodes=changes.get("nodes", [{"name": "a"}]))
    if "channel" in changes:
        target = {"node": 1, "path": changes["channel"]}
        top["animations"][0]["channels"].append({"sampler": 0, "target": target})
    top["bufferViews"][1]["extensions"] = changes.get("packed", {})
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    assert said in findings(path)["VRF501"].notes[0]


def test_a_camera_that_moves_is_no_drone(tmp_path):
    top = scene(nodes=[{"name": "a"}, {"name": "view", "camera": 0}])
    target = {"node": 1, "path": "translation"}
    top["animations"][0]["channels"].append({"sampler": 0, "target": target})
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    assert read_show(path).names == ("a",)


def test_copies_that_stand_elsewhere_are_drones_of_their_own(tmp_path):
    nodes = [{"name": "a"}, {"name": "b"}, {"children": [1], "translation": [9, 0, 0]}]
    top = scene(nodes=nodes)
    target = {"node": 1, "path": "translation"}
    top["animations"][0]["channels"].append({"sampler": 0, "target": target})
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(top))
    places = place_at(read_show(path).tracks, 1.0)
    assert places[1] - places[0] == pytest.approx([9, 0, 0])


def test_visualisations_are_read_by_steps(tmp_path):
    agent = {
        "homeX": -2,
        "homeY": 0,
        "homeZ": 1,
        "agentTraversal": [
            {"dx": 0, "dy": 0, "dz": 0},
            {"dx": 0, "dy": 4, "dz": 2},
            {"dx": 1, "dy": 0, "dz": 0, "dt": 2.0},
        ],
    }
    top = {"version": "1.0", "defaultPositionRate": 2, "performances": [
        {"id": 1, "agentDescription": agent}]}  # fmt: skip
    path = tmp_path / "a.vviz"
    path.write_text(json.dumps(top))
    tracks = read_show(path).tracks
    assert place_at(tracks, 0.0)[0] == pytest.approx([1, 2, 0])
    assert place_at(tracks, 0.5)[0] == pytest.approx([3, 2, 4])
    assert place_at(tracks, 2.5)[0] == pytest.approx([3, 1, 4])
    top["defaultPositionRate"] = 0
    path.write_text(json.dumps(top))
    assert set(findings(path)) == {"VRF501"}


def test_pieces_that_run_backwards_are_refused(tmp_path):
    row = ",".join(["-1"] + ["0"] * 32)
    (tmp_path / "1.csv").write_text("duration,x^0\n" + f"{row}\n{row}\n")
    assert "times that rise" in findings(tmp_path)["VRF501"].notes[0]


def test_what_is_not_known_is_said_with_what_is(tmp_path):
    with pytest.raises(UsageError, match=r"\.skyc"):
        read_show(tmp_path / "nothing.skyc")
    (tmp_path / "show.fseq").write_bytes(b"PSEQ")
    with pytest.raises(UsageError, match="no format that is known"):
        read_show(tmp_path / "show.fseq")
    with pytest.raises(UsageError, match="no show files"):
        read_show(tmp_path)


def test_an_archive_that_says_less_than_it_holds_is_refused(tmp_path):
    content = b"x" * 5000
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    packed = packer.compress(content) + packer.flush()
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("show.json", content)
    lying = stream.getvalue().replace(struct.pack("<I", 5000), struct.pack("<I", 50))
    assert packed in lying
    path = tmp_path / "a.skyc"
    path.write_bytes(lying)
    with pytest.raises(DamagedFileError):
        read_show(path)
