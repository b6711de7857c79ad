"""The core is a library of its own: it needs no drones, no scripts, no missions."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "showc"
MODULES = ("_version", "arrays", "errors", "processes", "trajectory")
NEEDED = ("__init__.py", *(f"{name}.py" for name in MODULES), "ocp")
PROGRAM = """
import sys
from showc import ocp

problem = ocp.Problem("rest to rest")
phase = problem.phase(duration=(0.1, 10.0))
x = phase.state("x", start=0.0, end=1.0)
v = phase.state("v", start=0.0, end=0.0)
u = phase.control("u", -1.0, 1.0)
phase.derivative(x, v)
phase.derivative(v, u)
problem.minimise(phase.duration)
for name in ocp.__all__:
    getattr(ocp, name)
solution = ocp.solve(problem)
assert solution.result is ocp.Result.SOLVED
assert abs(solution.objective - 2.0) < 1e-6
ours = {name.split(".")[1] for name in sys.modules if name.startswith("showc.")}
print(*sorted(ours))
"""


def test_the_core_works_with_every_other_folder_absent(tmp_path):
    for name in NEEDED:
        source, target = PACKAGE / name, tmp_path / "showc" / name
        target.parent.mkdir(exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target)
        else:
            shutil.copy(source, target)
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert set(run.stdout.split()) <= {*MODULES, "ocp"}
