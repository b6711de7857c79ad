"""A compile without missions: the log alone, proved as ever, and no files to mix up."""

import json

import pytest

SCRIPT = """\
showc: 1
drones: 2
site: {volume: {min: [-20, -20, 0], max: [20, 20, 30]}}
pads: {type: line, length: 4}
formations: {pair: {type: line, length: 6, centre: [0, 3, 8]}}
transitions: [{to: pair, hold: 1}]
"""


@pytest.mark.slow
def test_the_log_alone_is_made_and_proved(run_showc, tmp_path):
    (tmp_path / "pair.yaml").write_text(SCRIPT)
    run = run_showc(
        "compile", "pair.yaml", "-o", "pair.mcap", "--no-missions", cwd=tmp_path
    )
    assert run.code == 0, run.err
    assert "showc stream" in run.out
    files = {path.name for path in (tmp_path / "pair").rglob("*")}
    assert files == {"manifest.json"}
    manifest = json.loads((tmp_path / "pair" / "manifest.json").read_text())
    assert manifest["missions"]["files"] == {}
    assert len(manifest["fleet"]) == 64

    proof = run_showc("verify", "pair.mcap", "--json", cwd=tmp_path)
    result = json.loads(proof.out)
    assert proof.code == 0
    skipped = [check for check in result["checks"] if check["verdict"] == "skipped"]
    assert any("the manifest says why" in str(check["notes"]) for check in skipped)

    # A mission of another compile in the folder is not passed over.
    (tmp_path / "pair" / "missions").mkdir()
    (tmp_path / "pair" / "missions" / "drone_0001.waypoints").write_text("QGC WPL 110")
    assert run_showc("verify", "pair.mcap", cwd=tmp_path).code == 1


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("longitude", [180.0, 179.9999])
def test_across_the_180th_meridian_is_the_log_alone(
    run_showc, tmp_path, autopilot, longitude
):
    origin = f"{{origin: {{latitude: 0, longitude: {longitude}}}, "
    script = SCRIPT.replace("site: {", f"site: {origin}")
    script += f"mission: {{autopilot: {autopilot}}}\n"
    (tmp_path / "far.yaml").write_text(script)
    run = run_showc("compile", "far.yaml", "-o", "far.mcap", cwd=tmp_path, timeout=200)
    assert run.code == 1
    assert "no missions were written: the flight volume lies on both sides" in run.out
    assert {path.name for path in (tmp_path / "far").iterdir()} == {"manifest.json"}
    assert run_showc("verify", "far.mcap", cwd=tmp_path).code == 0
    foreseen = run_showc("plan", "far.yaml", cwd=tmp_path)
    assert "no missions: the flight volume lies on both sides" in foreseen.out


def test_the_log_is_written_whatever_becomes_of_the_missions(run_showc, tmp_path):
    # Slots of minute and second come round within the hour that is held here.
    hour = SCRIPT.replace("hold: 1}", "hold: 3600}") + "log_rate: 1\n"
    (tmp_path / "hour.yaml").write_text(hour)
    run = run_showc("compile", "hour.yaml", "-o", "hour.mcap", cwd=tmp_path)
    assert run.code == 1
    assert run.out.count("no missions were written") == 1
    assert "--start" in run.out and "--no-missions" in run.out
    assert (tmp_path / "hour.mcap").stat().st_size > 0
    assert {path.name for path in (tmp_path / "hour").iterdir()} == {"manifest.json"}
    # The same was to be had before the solve.
    foreseen = run_showc("plan", "hour.yaml", cwd=tmp_path)
    assert "no missions: " in foreseen.out and "--start" in foreseen.out
