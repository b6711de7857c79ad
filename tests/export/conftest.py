from __future__ import annotations

from io import BytesIO

import pytest
from synthetic import gliding_flight, vertical_flight

from showc.export.solved import solved_show
from showc.log.reader import read_log
from showc.log.writer import write_log


def solved(flight):
    stream = BytesIO()
    write_log(flight, stream, manifest=b'{"files": {}}\n')
    return solved_show(read_log(stream.getvalue()))


@pytest.fixture(scope="session")
def vertical():
    return solved(vertical_flight())


@pytest.fixture(scope="session")
def gliding():
    return solved(gliding_flight(9))


@pytest.fixture(scope="session")
def vertical_log_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "show.mcap"
    with path.open("wb") as stream:
        write_log(vertical_flight(), stream, manifest=b'{"files": {}}\n')
    return path
