"""Shows of others that are made to hurt end in findings, in little time and memory.

Each is verified in a process of its own under limits of processor time and memory, so
that a hang or a flood is a failure and not the end of the tests.
"""

import base64
import json
import struct
import zipfile

import numpy as np
import pytest
from confined import run_confined

from showc.errors import DamagedFileError
from showc.foreign.show import BYTES_EACH, MOST_CONTROLS, Course, Courses

POLY7 = "duration," + ",".join(f"{axis}^{n}" for axis in "xyzw" for n in range(8))


def verified(folder, name):
    """Verify a show; its failed checks by code."""
    code, _ = run_confined(folder, "verify", "--json", "--output", "found.json", name)
    assert code == 1
    checks = json.loads((folder / "found.json").read_text())["checks"]
    return {check["code"] for check in checks if check["verdict"] == "fail"}


def skyc(*trajectories):
    drones = [
        {"settings": {"name": f"d{number}", "trajectory": one}}
        for number, one in enumerate(trajectories)
    ]
    return {
        "version": 1,
        "swarm": {"drones": drones},
        "settings": {"validation": {"minDistance": 2}},
    }


def up(*more):
    return {"version": 1, "points": [[0, [0, 0, 0], []], [9, [0, 0, 20], []], *more]}


def zipped(path, **entries):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            text = content if isinstance(content, (str, bytes)) else json.dumps(content)
            archive.writestr(name.replace("_", "."), text)


def scene(nodes, keys, accessors=1, count=None):
    """Nodes that move, by as many accessors of places as are asked for."""
    body = struct.pack(f"<{keys}f", *range(keys)) + struct.pack(
        f"<{3 * keys}f", *range(3 * keys)
    )
    view = {"bufferView": 1, "componentType": 5126, "type": "VEC3"}
    content = base64.b64encode(body).decode()
    return {
        "asset": {"version": "2.0"},
        "nodes": [{} for _ in range(nodes)],
        "buffers": [
            {
                "byteLength": len(body),
                "uri": f"data:application/octet-stream;base64,{content}",
            }
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 4 * keys},
            {"buffer": 0, "byteOffset": 4 * keys, "byteLength": 12 * keys},
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": count or keys,
                "type": "SCALAR",
            },
            *[view | {"count": count or keys} for _ in range(accessors)],
        ],
        "animations": [
            {
                "samplers": [
                    {"input": 0, "output": 1 + number} for number in range(accessors)
                ],
                "channels": [
                    {
                        "sampler": number % accessors,
                        "target": {"node": number, "path": "translation"},
                    }
                    for number in range(nodes)
                ],
            }
        ],
    }


def vviz(drones, step):
    one = {"agentDescription": {"agentTraversal": [{"dx": 0}, step]}}
    return {"version": "1.0", "performances": [one] * drones}


def table(rows):
    return "Time [msec],x [m],y [m],z [m]\n" + "\n".join(rows) + "\n"


def tables(path, **contents):
    path.mkdir()
    for name, content in contents.items():
        (path / f"{name}.csv").write_text(content)


def one_table(path, rows):
    zipped(path, a_csv=table(rows))


def long_tables(path):
    rows = [f"{k * 200},{k % 7},0,5" for k in range(45_000)]
    contents = dict.fromkeys((f"d{number}_csv" for number in range(70)), table(rows))
    zipped(path, **contents)


NOT_A_NUMBER = float("nan")
ONE_LIST = '{"agentDescription":{"agentTraversal":[{}]}},'
LOOSE = '{"comment": "an object that is no sample"},'
HOSTILE = {
    "a crowd at one place.skyc": lambda path: zipped(
        path, show_json=skyc(*[up()] * 5000)
    ),
    "one trajectory for all.skyc": lambda path: zipped(
        path, show_json=skyc(*[{"$ref": "a.json"}] * 5000), a_json=up()
    ),
    "time backwards.skyc": lambda path: zipped(
        path, show_json=skyc(up([5, [0, 0, 5], []]))
    ),
    "no numbers.skyc": lambda path: zipped(
        path, show_json=skyc(up([12, [NOT_A_NUMBER, 0, 5], []]))
    ),
    "a bomb.skyc": lambda path: zipped(path, show_json=b" " * 100_000_000),
    "deep.skyc": lambda path: zipped(path, show_json="[" * 10**6),
    "sixty thousand points.skyc": lambda path: zipped(
        path,
        show_json=skyc(up(*[[10 + k, [0, 0, 5], []] for k in range(60_000)])),
    ),
    "deep.vviz": lambda path: path.write_text('{"a":' * 10**6),
    "a flood.vviz": lambda path: path.write_text("[" + "{}," * 10**7 + "{}]"),
    "no numbers.vviz": lambda path: path.write_text(
        json.dumps(vviz(2, {"dx": NOT_A_NUMBER}))
    ),
    "time backwards.vviz": lambda path: path.write_text(
        json.dumps(vviz(2, {"dt": -1.0}))
    ),
    "a crowd.vviz": lambda path: path.write_text(json.dumps(vviz(5001, {"dx": 1}))),
    "lists of samples.vviz": lambda path: path.write_text(
        f'{{"performances":[{ONE_LIST * 20_000}{{}}]}}'
    ),
    "loose objects.vviz": lambda path: path.write_text(
        f'{{"performances":[{LOOSE * 400_000}{{}}]}}'
    ),
    "a billion keys.gltf": lambda path: path.write_text(
        json.dumps(scene(1, 9, count=10**9))
    ),
    "all alike.gltf": lambda path: path.write_text(json.dumps(scene(5000, 999))),
    "accessors over accessors.gltf": lambda path: path.write_text(
        json.dumps(scene(5000, 999, accessors=5000))
    ),
    "leads out.gltf": lambda path: path.write_text(
        json.dumps(scene(1, 9)).replace("data:application", "../../../data")
    ),
    "time backwards.zip": lambda path: one_table(
        path, ["0,0,0,0", "9,0,0,0", "5,0,0,0"]
    ),
    "no numbers.zip": lambda path: one_table(path, ["0,0,0,0", "9,nan,0,0"]),
    "a bomb.zip": lambda path: zipped(path, a_csv=b"0,0,0,0\n" * 10**7),
    "leads out.zip": lambda path: path.write_bytes(escaping()),
    "a fleet for days.zip": long_tables,
    "no numbers poly7": lambda path: tables(path, a=f"{POLY7}\n1{',nan' * 32}\n"),
    "time backwards poly7": lambda path: tables(
        path, a=f"{POLY7}\n1{',0' * 32}\n-1{',0' * 32}\n"
    ),
    "long poly7": lambda path: tables(
        path, a=f"{POLY7}\n" + f"0.1{',0' * 32}\n" * 60_000
    ),
    "noise skyb": lambda path: blobs(path, bytes(range(256)) * 99),
    "zeros skyb": lambda path: blobs(path, bytes(2**21)),
    "a head alone skyb": lambda path: blobs(path, b"skyb\x01"),
}


def escaping():
    from io import BytesIO

    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("../../a.csv", table(["0,0,0,0"]))
    return stream.getvalue()


def blobs(path, content):
    path.mkdir()
    for number in range(3):
        (path / f"{number}.skyb").write_bytes(content)


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_show_ends_in_findings(name, tmp_path):
    HOSTILE[name](tmp_path / name)
    wanted = "VRF504" if name.startswith("a crowd at") else "VRF501"
    assert wanted in verified(tmp_path, name)


def test_a_fleet_has_no_more_coefficients_than_are_read(tmp_path):
    course = Course(np.arange(1001.0), np.zeros((1000, 8, 3)))
    courses = Courses(tmp_path)
    for _ in range(MOST_CONTROLS // 8000):
        courses.add(course)
    with pytest.raises(
        DamagedFileError, match="6,008,000 coefficients; wanted at most"
    ):
        courses.add(course)


def test_a_file_that_is_long_on_disk_may_have_more(tmp_path):
    path = tmp_path / "long.skyc"
    with path.open("wb") as stream:
        stream.truncate(2 * BYTES_EACH * MOST_CONTROLS)
    course = Course(np.arange(1001.0), np.zeros((1000, 8, 3)))
    courses = Courses(path)
    for _ in range(2 * MOST_CONTROLS // 8000):
        courses.add(course)
    with pytest.raises(DamagedFileError, match="wanted at most 12,000,000"):
        courses.add(course)
