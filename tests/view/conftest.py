from __future__ import annotations

import sys
from io import BytesIO
from pathlib import Path

import pytest
from synthetic import gliding_flight, vertical_flight

from showc.log.reader import read_log
from showc.log.writer import write_log

sys.path.append(str(Path(__file__).parent))


def logged(flight, manifest: bytes = b"{}"):
    stream = BytesIO()
    write_log(flight, stream, manifest=manifest)
    return read_log(stream.getvalue())


@pytest.fixture(scope="session")
def make_logged():
    return logged


@pytest.fixture(scope="session")
def gliding_log():
    return logged(gliding_flight(16))


@pytest.fixture(scope="session")
def vertical_log():
    return logged(vertical_flight(4))


@pytest.fixture(scope="session")
def tab(tmp_path_factory):
    """One page of a headless Chromium."""
    from browser import find_browser, open_browser

    if find_browser() is None:
        pytest.skip("no Chromium is installed")
    with open_browser(tmp_path_factory.mktemp("browser")) as found:
        yield found
