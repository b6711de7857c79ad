"""Exports as they lie on disk: proved from their bytes, whole or not there at all."""

import json
import shutil
import struct
import zipfile

import pytest
from click.testing import CliRunner

from showc.errors import UsageError
from showc.export.skyb import skyb_file
from showc.export.stage import ExportOptions, export
from showc.foreign.firmware import Firmware, what_it_becomes
from showc.foreign.folder import MANIFEST, verify_export
from showc.foreign.reading import read_show
from showc.foreign.verdict import verify_foreign

SOURCE = {"log": "show.mcap", "data_sha256": "0" * 64}


def names(checks, verdict="fail"):
    return {check.name for check in checks if check.verdict == verdict}


@pytest.fixture(scope="module", params=["skyb", "skyc"])
def exported(request, vertical, tmp_path_factory):
    folder = tmp_path_factory.mktemp("export") / request.param
    # Pads stand 3 m apart: more than the script asks, and flying costs 6 cm.
    return export(vertical, SOURCE, request.param, folder, ExportOptions(10.0))


def test_written_bytes_are_proved(exported):
    assert names(exported.checks) == set()
    assert {check.group for check in exported.checks} == {
        "what the file says",
        "what the firmware makes of it",
        "whether show mode can follow it",
    }


def test_verify_repeats_the_proof_from_the_folder(exported):
    again = verify_export(exported.folder)
    assert again.passed
    files = [check for check in again.checks if check.group == "integrity"]
    assert [check.code for check in files] == ["VRF581", "VRF587", "VRF588"]
    assert again.checks[3:] == exported.checks


@pytest.mark.parametrize("said", ["x", [], "skybrush-csv", "gltf"])
def test_a_manifest_that_names_another_format_is_damaged(exported, tmp_path, said):
    folder = shutil.copytree(exported.folder, tmp_path / "it")
    manifest = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps(manifest | {"format": said}))
    assert not verify_export(folder).passed


def test_manifest_lists_hashes_rules_and_what_is_lost(exported):
    manifest = json.loads((exported.folder / MANIFEST).read_text())
    assert manifest["proved"] is True
    assert manifest["fit"]["position_error_m"] <= 0.01
    assert manifest["cannot_carry"]
    assert set(manifest["files"]) == {
        path.name for path in exported.folder.iterdir() if path.name != MANIFEST
    }


def test_same_show_gives_the_same_bytes(vertical, exported, tmp_path):
    form = json.loads((exported.folder / MANIFEST).read_text())["format"]
    again = export(vertical, SOURCE, form, tmp_path / "again", ExportOptions(10.0))
    for path in exported.folder.iterdir():
        assert (again.folder / path.name).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("form", ["skyb", "skyc"])
def test_any_change_on_disk_is_found(vertical, tmp_path, form):
    folder = export(
        vertical, SOURCE, form, tmp_path / form, ExportOptions.usual(form)
    ).folder
    assert verify_export(folder).passed
    for path in sorted(folder.iterdir()):
        if path.name == MANIFEST:
            continue
        whole = path.read_bytes()
        path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
        assert not verify_export(folder).passed
        path.write_bytes(whole)
    (folder / "stray.txt").write_text("?")
    assert not verify_export(folder).passed


def test_drones_that_come_too_near_are_found_in_the_bytes(vertical, tmp_path):
    folder = export(
        vertical, SOURCE, "skyb", tmp_path / "near", ExportOptions(10.0)
    ).folder
    first = (folder / "drone_0001.skyb").read_bytes()
    (folder / "drone_0002.skyb").write_bytes(first)
    found = verify_export(folder)
    assert names(found.checks) >= {
        "files are those of the manifest",
        "separation of all pairs, the script's",
        "separation as it will be flown",
    }
    assert found.check("VRF504").where.pair == (1, 2)


def test_a_climb_in_degree_seven_is_a_finding(tmp_path):
    climb = struct.pack("<BH7h", 0x30, 8000, *[0, 0, 0, 12000, 12000, 12000, 12000])
    block = struct.pack("<B4h", 1, 0, 0, 0, 0) + climb
    (tmp_path / "1.skyb").write_bytes(skyb_file(block, None, None, ""))
    found = verify_foreign(tmp_path)
    assert "take-off height is found" in names(found.checks)


def test_less_lead_than_the_firmware_needs_is_a_finding(vertical, tmp_path):
    written = export(vertical, SOURCE, "skyb", tmp_path / "x", ExportOptions(lead=0.0))
    slow = Firmware(climb_acceleration=0.05)
    found = what_it_becomes(read_show(written.folder), slow)
    assert names(found) == {"motors start after the show does"}


def test_a_separation_that_flying_would_break_is_a_finding(vertical, tmp_path):
    options = ExportOptions(10.0, separation=2.99)
    written = export(vertical, SOURCE, "skyb", tmp_path / "x", options)
    assert names(written.checks) == {"separation as it will be flown"}


def test_what_is_no_export_is_never_replaced(vertical, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "notes.txt").write_text("keep")
    with pytest.raises(UsageError, match=r"no export of showc's"):
        export(vertical, SOURCE, "skyb", folder, ExportOptions(10.0))
    assert (folder / "notes.txt").read_text() == "keep"


def test_compiled_show_has_site_rules_cues_and_places(vertical, tmp_path):
    folder = export(
        vertical, SOURCE, "skyc", tmp_path / "c", ExportOptions(10.0)
    ).folder
    with zipfile.ZipFile(folder / "show.skyc") as archive:
        top = json.loads(archive.read("show.json"))
        yaw = json.loads(archive.read("drones/drone_0001/yaw.json"))
    site = vertical.rules.site
    location = top["environment"]["location"]
    assert location["origin"] == [
        round(site.latitude * 1e7),
        round(site.longitude * 1e7),
        round(site.altitude * 1000),
    ]
    assert location["orientation"] == (site.heading + 90.0) % 360.0
    assert top["settings"]["validation"]["minDistance"] == (
        vertical.rules.separation.distance
    )
    assert yaw["setpoints"][0][1] == pytest.approx(0.0)
    show = read_show(folder)
    assert [cue.name for cue in show.cues] == [stage.name for stage in vertical.stages]
    assert show.home[0] == pytest.approx(show.tracks.position[0, 0])
    assert show.location.altitude == pytest.approx(site.altitude)
    assert len(show.fences) == 1


@pytest.mark.parametrize("form", ["kml", "gltf", "vviz"])
def test_a_drawing_is_never_called_proved_to_fly(vertical, tmp_path, form):
    options = ExportOptions.usual(form)
    folder = export(vertical, SOURCE, form, tmp_path / form, options).folder
    found = verify_export(folder)
    assert found.verdict.startswith("A DRAWING, NOT FLOWN: ")
    assert found.passed and not found.proved
    assert found.trajectories == ("none" if form == "kml" else "proved")
    if form != "kml":
        # Its file by itself is drawn as well: no firmware reads it.
        (drawn,) = (path for path in folder.iterdir() if path.stem == "show")
        alone = verify_foreign(drawn)
        assert alone.verdict.startswith("A DRAWING, NOT FLOWN: "), alone.verdict
        assert not any(check.code.startswith("VRF54") for check in alone.checks)
    (folder / "stray.txt").write_text("?")
    again = verify_export(folder)
    assert again.verdict.startswith("NOT PROVED: ") and not again.passed


def test_rules_asked_for_are_proved_beside_those_of_the_export(vertical, tmp_path):
    from showc.cli.verify import command

    folder = export(
        vertical, SOURCE, "skyb", tmp_path / "x", ExportOptions(10.0)
    ).folder

    def said(*options):
        return CliRunner().invoke(
            command, [str(folder), *options], standalone_mode=False
        )

    assert said().return_value == 0
    wide = said("--separation", "50", "--json")
    apart = {
        check["name"]: check
        for check in json.loads(wide.output)["checks"]
        if check["code"] == "VRF504"
    }
    assert wide.return_value == 1
    assert apart["separation of all pairs, asked"]["verdict"] == "fail"
    assert apart["separation of all pairs, the script's"]["verdict"] == "pass"
    # Its drones are named by their numbers, which the place says already.
    notes = [note for check in apart.values() for note in check["notes"]]
    assert not any("drone" in note for note in notes)
    tilt = said("--tilt", "20")
    assert isinstance(tilt.exception, UsageError)
    assert "--tilt 20" in str(tilt.exception)


def test_a_manifest_with_a_flood_of_corners_is_damaged(vertical, tmp_path):
    folder = export(
        vertical, SOURCE, "skyb", tmp_path / "x", ExportOptions(10.0)
    ).folder
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest["rules"]["fence"] = [[[0, 0], [1, 0], [1, 1]]] * 33_334
    (folder / MANIFEST).write_text(json.dumps(manifest))
    found = verify_export(folder)
    assert "100,002 corners" in found.check("VRF501").notes[0]
    manifest["rules"]["fence"] = [[[0, 0], [1, 0]]]
    (folder / MANIFEST).write_text(json.dumps(manifest))
    assert "wanted 3 or more" in verify_export(folder).check("VRF501").notes[0]
