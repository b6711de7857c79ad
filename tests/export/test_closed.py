"""Folders that claim to be exports hold what showc writes, and nothing else.

Each lie is whole: its CRCs and the hashes in its manifest fit.
"""

from __future__ import annotations

import base64
import json
import re
import shutil
import struct
import zipfile
from hashlib import sha256

import pytest

from showc.export.stage import ExportOptions, export
from showc.foreign.closed import odd_command
from showc.foreign.folder import MANIFEST, verify_export
from showc.foreign.skyb import blocks_of, checksum
from showc.foreign.verdict import verify_foreign

SOURCE = {"log": "show.mcap", "data_sha256": "0" * 64}
FIRST = "drones/drone_0001"


@pytest.fixture(scope="module", params=["skyb", "skyc"])
def form(request):
    return request.param


@pytest.fixture(scope="module")
def written(vertical, tmp_path_factory):
    folder = tmp_path_factory.mktemp("closed")
    return {
        form: export(vertical, SOURCE, form, folder / form, ExportOptions(10.0)).folder
        for form in ("skyb", "skyc")
    }


def sealed(folder, **said):
    """Make the hashes of a manifest fit, and judge the folder."""
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest |= said
    manifest["files"] = {
        path.name: sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.name != MANIFEST
    }
    (folder / MANIFEST).write_text(json.dumps(manifest))
    result = verify_export(folder)
    return result, {check.code for check in result.checks if check.verdict == "fail"}


def binary(*blocks):
    body = b"".join(struct.pack("<BH", kind, len(one)) + one for kind, one in blocks)
    head = b"skyb\x02\x01"
    return head + checksum(head + bytes(4) + body).to_bytes(4, "little") + body


def changed(kind, change):
    return lambda blocks: [
        (one, change(body) if one == kind else body) for one, body in blocks
    ]


BINARY_LIES = {
    "pyrotechnics": changed(2, lambda body: bytes([21, 127]) + body),
    "a loop": changed(2, lambda body: bytes([12, 2, 2, 1, 13]) + body),
    "lights after their end": changed(2, lambda body: body + b"\1\0"),
    "no end of lights": changed(2, lambda body: body[:-1]),
    "no lights": lambda blocks: [one for one in blocks if one[0] != 2],
    "a plan to return": lambda blocks: [*blocks, (4, bytes(20))],
    "events": lambda blocks: [*blocks, (6, bytes.fromhex("e80300000100000000"))],
    "two trajectories": lambda blocks: [*blocks, (1, blocks[0][1][:9])],
    "an unknown block": lambda blocks: [*blocks, (99, b"?")],
    "another comment": changed(3, lambda body: body + b"2"),
    "yaw in the trajectory": changed(1, lambda body: body[:7] + b"\1\0" + body[9:]),
    "another mode of yaw": changed(5, lambda body: b"\1" + body[1:]),
    "a piece of no length": changed(1, lambda body: body + bytes(3)),
}


@pytest.mark.parametrize("lie", BINARY_LIES)
def test_a_binary_file_holds_nothing_else(written, tmp_path, lie):
    folder = shutil.copytree(written["skyb"], tmp_path / "x")
    path = folder / "drone_0002.skyb"
    blocks = [(kind, body) for kind, _, body in blocks_of(path.read_bytes(), "x")[0]]
    assert binary(*blocks) == path.read_bytes()
    path.write_bytes(binary(*BINARY_LIES[lie](blocks)))
    found, codes = sealed(folder)
    assert codes == {"VRF587"}
    assert "drone_0002.skyb" in found.check("VRF587").notes[0]
    # Of another tool nothing of this is asked.
    alone = verify_foreign(path)
    assert not {"VRF587", "VRF501"} & {
        check.code for check in alone.checks if check.verdict == "fail"
    }


def drone(**more):
    return lambda top: top["swarm"]["drones"][0]["settings"].update(more)


def popped(*path):
    def change(top):
        for key in path[:-1]:
            top = top[key]
        del top[path[-1]]

    return change


def put(value, *path):
    def change(top):
        for key in path[:-1]:
            top = top[key]
        top[path[-1]] = value

    return change


PYRO = {"version": 1, "events": [[1, 1, "boom"]], "payloads": {"boom": {}}}
DOCUMENT_LIES = {
    "pyrotechnics": ("show", drone(pyro=PYRO)),
    "a plan to return": ("show", drone(rthPlan={"version": 1, "entries": []})),
    "a landing elsewhere": ("show", drone(landAt=[50, 50, 0])),
    "no fence": ("show", popped("settings", "geofence")),
    "another fence": (
        "show",
        put(9.0, "settings", "geofence", "polygons", 0, "points", 0, 0),
    ),
    "a fence without effect": ("show", put("none", "settings", "geofence", "action")),
    "indoor": ("show", put({"type": "indoor"}, "environment")),
    "no place": (
        "show",
        put([10**9, 0, 0], "environment", "location", "origin"),
    ),
    "another limit": ("show", put(0.5, "settings", "validation", "minDistance")),
    "another roof": ("show", put(1.0, "settings", "validation", "maxAltitude")),
    "more media": ("show", put({}, "media")),
    "a cue with more": ("cues", put(1, "items", 0, "fire")),
    "a trajectory with more": (f"{FIRST}/trajectory", put(1, "smooth")),
    "a point with more": (
        f"{FIRST}/trajectory",
        lambda found: found["points"][0].append(1),
    ),
    "yaw with more": (f"{FIRST}/yaw", put(1, "autoYaw")),
    "lights with more": (f"{FIRST}/lights", put(1, "pyro")),
    "lights that fire": (
        f"{FIRST}/lights",
        put(base64.b64encode(bytes([20, 1, 0])).decode(), "data"),
    ),
    "another entry": ("drones/drone_0001/pyro", None),
}


@pytest.mark.parametrize("lie", DOCUMENT_LIES)
def test_a_compiled_show_holds_nothing_else(written, tmp_path, lie):
    folder = shutil.copytree(written["skyc"], tmp_path / "x")
    name, change = DOCUMENT_LIES[lie]
    with zipfile.ZipFile(folder / "show.skyc") as archive:
        entries = {one: archive.read(one) for one in archive.namelist()}
    content = json.loads(entries.get(f"{name}.json", "{}"))
    if change is not None:
        change(content)
    entries[f"{name}.json"] = json.dumps(content, separators=(",", ":")).encode()
    with zipfile.ZipFile(folder / "show.skyc", "w", zipfile.ZIP_DEFLATED) as archive:
        for one, data in entries.items():
            archive.writestr(one, data)
    assert sealed(folder)[1] == {"VRF587"}


def test_an_archive_may_be_packed_otherwise(written, tmp_path):
    folder = shutil.copytree(written["skyc"], tmp_path / "x")
    with zipfile.ZipFile(folder / "show.skyc") as archive:
        entries = {one: archive.read(one) for one in archive.namelist()}
    with zipfile.ZipFile(folder / "show.skyc", "w") as archive:
        for one, data in entries.items():
            archive.writestr(one, data)
    assert sealed(folder)[1] == set()


PARAMETER_LIES = {
    "missing": lambda path: path.unlink(),
    "another height": lambda path: path.write_bytes(
        path.read_bytes().replace(b"SHOW_TAKEOFF_ALT,2.5", b"SHOW_TAKEOFF_ALT,25")
    ),
    "another landing": lambda path: path.write_bytes(
        re.sub(rb"LAND_SPEED,\d+", b"LAND_SPEED,31", path.read_bytes())
    ),
    "one more": lambda path: path.write_bytes(path.read_bytes() + b"ARMING_CHECK,0\n"),
    "another end of line": lambda path: path.write_bytes(
        path.read_bytes().replace(b"\n", b"\r\n")
    ),
}


@pytest.mark.parametrize("lie", PARAMETER_LIES)
def test_the_parameters_are_those_that_the_proof_is_of(written, form, tmp_path, lie):
    folder = shutil.copytree(written[form], tmp_path / "x")
    PARAMETER_LIES[lie](folder / "showmode.parm")
    found, codes = sealed(folder)
    assert codes == {"VRF587"}
    assert found.check("VRF587").notes[0].startswith("showmode.parm")


def test_one_more_file_is_none_of_an_export(written, form, tmp_path):
    folder = shutil.copytree(written[form], tmp_path / "x")
    (folder / "ardupilot.parm").write_text("FENCE_ENABLE,0\n")
    assert sealed(folder)[1] == {"VRF587"}


@pytest.mark.parametrize("said", [{"drones": 300}, {"duration": 1.0}])
def test_the_manifest_counts_what_is_there(written, form, tmp_path, said):
    folder = shutil.copytree(written[form], tmp_path / "x")
    honest = verify_export(folder)
    found, codes = sealed(folder, **said)
    assert codes == {"VRF588"}
    assert (found.drones, found.duration) == (honest.drones, honest.duration)


def test_what_a_folder_cannot_prove_is_said(written, form):
    found = verify_export(written[form])
    assert found.passed
    assert "`showc verify` of the log" in found.check("VRF587").notes[-1]


@pytest.mark.parametrize("program", ["00", "0205060100", "08ff008096010400ff001e00"])
def test_waits_colours_and_fades_are_plain(program):
    assert list(odd_command(bytes.fromhex(program))) == []
