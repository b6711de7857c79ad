"""A type of formation is one file: keys, schema, reference and drawing follow."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "showc"

MODULE = '''
"""The cross: two lines that meet in the middle."""

import numpy as np

from showc.script.formations.shape import Drawing, Shape, any_count
from showc.script.language.kinds import Field, Quantity, Section

SECTION = Section(
    "cross",
    "Places along two lines that cross.",
    (Field("arm", Quantity("m", minimum=1.0, maximum=100.0), "Length.", default=9.0),),
)


def draw(settings, request):
    along = np.linspace(-1.0, 1.0, request.count) * settings.number("arm")
    odd = np.arange(request.count) % 2 == 1
    return Drawing(np.column_stack([along * odd, along * ~odd, 0.0 * along]))


SHAPE = Shape(SECTION, any_count, draw)
'''

SCRIPT = """
showc: 1
drones: 6
separation: 1 m
formations:
  x: {type: cross, arm: 12 m, centre: [0, 0, 20]}
transitions:
  - {to: x, hold: 1}
"""

PROGRAM = """
import json, sys
from showc.script.load import load_show
import gallery
from script_reference import page
from showc.script.language.schema import schema_text
show = load_show("show.yaml").show
print(json.dumps({
    "points": show.formations["x"].points.tolist(),
    "schema": '"cross"' in schema_text(),
    "page": "Places along two lines that cross." in page(),
    "gallery": "### Cross" in gallery.page(),
}))
"""


def test_a_module_in_the_folder_is_a_type_of_formation(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "showc", ignore=shutil.ignore_patterns("docs"))
    for name in ("script_reference.py", "gallery.py"):
        shutil.copy(PACKAGE.parent / "tests" / name, tmp_path)
    cross = tmp_path / "showc" / "script" / "formations" / "cross.py"
    cross.write_text(MODULE, encoding="utf-8")
    (tmp_path / "show.yaml").write_text(SCRIPT, encoding="utf-8")
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert len(found["points"]) == 6
    assert found["schema"]
    assert found["page"]
    assert found["gallery"]
