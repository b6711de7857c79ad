"""What the tests of the script share."""

import shutil
import subprocess
from pathlib import Path

import pytest
from repository import alone

from showc.script import read_show

HEAD = "showc: 1\n"


@pytest.fixture
def read(tmp_path):
    """Read a script from text, beside the files of ``tmp_path``."""

    def read_(text, path="show.yaml"):
        return read_show((HEAD + text).encode(), path=path, folder=tmp_path)

    return read_


@pytest.fixture
def show(read):
    """Read a script that must be a show."""

    def show_(text):
        result = read(text)
        assert result.show is not None, [item.message for item in result.errors]
        return result.show

    return show_


@pytest.fixture
def points(show):
    """Draw one formation, for a number of drones, with hardly any separation."""

    def points_(formation, drones=16):
        made = show(
            f"drones: {drones}\nseparation: 0.05\n"
            "site: {volume: {min: [-500, -500, -500], max: [500, 500, 500]}}\n"
            f"formations:\n  it: {formation}\ntransitions: [it]\n"
        )
        return made.formations["it"].points

    return points_


@pytest.fixture(scope="session")
def npm(request):
    """Install npm packages into a folder that lasts; return that folder."""

    def install(package):
        if shutil.which("npm") is None or shutil.which("node") is None:
            pytest.skip("node and npm are not installed")
        cache = Path(request.config.cache.mkdir("npm"))
        modules = cache / package.replace("/", "_") / "node_modules"
        command = ["npm", "install", "--no-audit", "--no-fund", "--prefix"]
        with alone(cache / "lock"):
            if not (modules / package).is_dir():
                modules.parent.mkdir(parents=True, exist_ok=True)
                done = subprocess.run(
                    [*command, modules.parent, package],
                    capture_output=True,
                    text=True,
                    timeout=300,
                    check=False,
                )
                if done.returncode:
                    pytest.skip(f"npm cannot install {package}: {done.stderr[-200:]}")
        return modules

    return install
