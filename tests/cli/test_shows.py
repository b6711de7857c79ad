"""Every show in shows/ goes the whole way, and the bytes prove it."""

import hashlib
import json

import pytest
from repository import SHOWS, WITH_MISSIONS

NAMES = [show.stem for show in SHOWS]


@pytest.mark.parametrize("name", NAMES)
def test_check_has_no_findings(run_showc, name):
    run = run_showc("check", "--strict", *[show for show in SHOWS if show.stem == name])
    assert (run.code, run.err) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_compile_then_verify(run_showc, compiled, name):
    log = compiled(name)
    run = run_showc("verify", log, "--json")
    result = json.loads(run.out)
    assert run.code == 0, run.out
    assert result["passed"] is True


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_folder_has_what_the_manifest_says(compiled, name):
    folder = compiled(name).with_suffix("")
    manifest = json.loads((folder / "manifest.json").read_text())
    files = manifest["missions"]["files"]
    missions = [file for file in files if file.endswith(".waypoints")]
    carried = name in {show.stem for show in WITH_MISSIONS}
    assert missions == [
        f"missions/drone_{drone:04d}.waypoints"
        for drone in range(1, carried * manifest["drones"] + 1)
    ]
    for file, digest in files.items():
        assert hashlib.sha256((folder / file).read_bytes()).hexdigest() == digest
    on_disk = {
        str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()
    }
    assert on_disk == {"manifest.json", *files}


@pytest.mark.slow
def test_the_site_of_a_hundred_drones_misses_nothing(run_showc, compiled, tmp_path):
    page = tmp_path / "case.html"
    run = run_showc("safety", compiled("hundred"), "--json", "-o", page)
    assert run.code == 0, run.err
    case = json.loads(run.out)
    assert {one["code"] for one in case["findings"]} <= {"SAF141"}
    names = {one["name"] for one in case["distances"]}
    assert {"falls to stands", "flight to hangar"} <= names
    assert "MET, WITH WARNINGS" in page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_two_compiles_are_the_same_bytes(run_showc, compiled, tmp_path):
    first = compiled("grid")
    again = tmp_path / "grid.mcap"
    script = next(show for show in SHOWS if show.stem == "grid")
    run = run_showc("compile", script, "-o", again, "--no-cache", "--jobs", 1)
    assert run.code == 0, run.err
    assert again.read_bytes() == first.read_bytes()
    manifest = again.with_suffix("") / "manifest.json"
    assert (
        manifest.read_bytes() == (first.with_suffix("") / "manifest.json").read_bytes()
    )
