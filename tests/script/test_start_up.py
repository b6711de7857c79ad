"""Checking knows no solver."""

import subprocess
import sys

from benchmarks.check_time import HUNDRED


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
