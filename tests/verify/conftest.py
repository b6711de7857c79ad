import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from verified import loaded, proved_flight, written


@pytest.fixture(scope="session")
def flight():
    return proved_flight()


@pytest.fixture(scope="session")
def log_path(flight, tmp_path_factory):
    return written(flight, tmp_path_factory.mktemp("log") / "output.mcap")


@pytest.fixture(scope="session")
def log_and_show(log_path):
    return loaded(log_path)
