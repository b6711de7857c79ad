"""``exports:`` in a script: compile writes them, proved."""

import json

from click.testing import CliRunner

from showc.cli.compile import command
from showc.foreign.folder import verify_export
from showc.script import load_show

SCRIPT = """showc: 1
name: Up and down
separation: 1.6 m
pads: {type: line, count: 2, spacing: 4 m}
formations:
  high: {type: line, count: 2, spacing: 4 m, centre: [0, 0, 14]}
transitions:
  - {to: high, hold: 1 s}
exports: [kml, {to: skyb, separation: 1.5 m, lead: 12 s}]
"""


def test_wishes_are_read(tmp_path):
    path = tmp_path / "show.yaml"
    path.write_text(SCRIPT)
    kml, skyb = load_show(path).show.exports
    assert (kml.to, kml.separation, kml.lead, kml.tolerance) == (
        "kml",
        None,
        None,
        0.01,
    )
    assert (skyb.to, skyb.separation, skyb.lead) == ("skyb", 1.5, 12.0)


def test_compile_writes_and_proves_what_a_script_asks_for(tmp_path):
    path = tmp_path / "show.yaml"
    path.write_text(SCRIPT)
    log = tmp_path / "show.mcap"
    arguments = [str(path), "-o", str(log), "--no-missions", "-q", "-j", "1"]
    arguments += ["--cache-dir", str(tmp_path / "cache")]
    run = CliRunner().invoke(command, arguments, standalone_mode=False)
    assert run.return_value == 0, run.output
    manifest = json.loads((tmp_path / "show-skyb" / "export.json").read_text())
    assert manifest["proved"] and manifest["fit"]["lead_s"] == 12.0
    assert manifest["rules"]["separation_flown"] == 1.5
    assert verify_export(tmp_path / "show-skyb").passed
    assert (tmp_path / "show-kml" / "show.kml").is_file()
