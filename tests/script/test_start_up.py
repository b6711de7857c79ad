"""Checking knows no solver."""

import subprocess
import sys

HUNDRED = """\
showc: 1
drones: 100
formations:
  ring: {type: circle, radius: 45, centre: [0, 0, 30]}
  ball: {type: sphere, radius: 18, centre: [0, 0, 40]}
  wall: {type: grid, plane: front, step: 3}
  word: {type: text, text: SHOW, height: 30, spread: true}
  helix: {type: helix, radius: 20, height: 40, turns: 3}
  wave: {type: wave, step: 4}
transitions: [ring, ball, wall, word, helix, wave]
"""


def test_checking_imports_no_solver(tmp_path):
    (tmp_path / "hundred.yaml").write_text(HUNDRED, encoding="utf-8")
    code = (
        "import sys\nfrom showc.__main__ import main\n"
        "sys.argv = ['showc', 'check', 'hundred.yaml']\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code\n"
        "heavy = {'casadi', 'scipy', 'trimesh', 'PIL', 'svgelements', 'mcap'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
