from __future__ import annotations

from io import BytesIO

import pytest
from synthetic import gliding_flight, vertical_flight

from showc.log.reader import read_log
from showc.log.writer import write_log

MANIFEST = b'{"files": {}}\n'


def written(flight, **options) -> bytes:
    stream = BytesIO()
    write_log(flight, stream, manifest=MANIFEST, **options)
    return stream.getvalue()


@pytest.fixture(scope="session")
def vertical():
    return vertical_flight()


@pytest.fixture(scope="session")
def vertical_bytes(vertical):
    return written(vertical)


@pytest.fixture(scope="session")
def vertical_log(vertical_bytes):
    return read_log(vertical_bytes)


@pytest.fixture(scope="session")
def gliding():
    return gliding_flight(16)


@pytest.fixture(scope="session")
def gliding_bytes(gliding):
    return written(gliding)


@pytest.fixture(scope="session")
def gliding_log(gliding_bytes):
    return read_log(gliding_bytes)


@pytest.fixture(scope="session")
def write():
    return written
