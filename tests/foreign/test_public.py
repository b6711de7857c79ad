"""Public files of others, judged as they were measured to be.

None is kept here. A folder named by ``SHOWC_PUBLIC_SHOWS`` may hold them:

- ``demo.skyc``: skybrush-io/live, assets/shows
- ``test-show.skyc``: skybrush-io/skybrush.js, packages/show-format/test/fixtures
- ``*.skyb``: skybrush-io/libskybrush, test/fixtures
- ``mds/`` with ten tables: alireza787b/mavsdk_drone_show, shapes/swarm/skybrush
"""

from __future__ import annotations

import os
from hashlib import sha256
from pathlib import Path

import pytest

from showc.foreign.verdict import verify_foreign

FOLDER = os.environ.get("SHOWC_PUBLIC_SHOWS")
pytestmark = pytest.mark.skipif(FOLDER is None, reason="SHOWC_PUBLIC_SHOWS is not set")

KNOWN = {
    "demo.skyc": "43dc7c787141",
    "test-show.skyc": "f66408e6f20a",
    "real_show.skyb": "bc328c3cef9d",
    "forward_left_back.skyb": "ce176ded67f2",
}
"""How the SHA-256 of the files begins that were measured."""


def judged(name):
    path = Path(str(FOLDER)) / name
    if not path.exists():
        pytest.skip(f"{name} is not there")
    if path.is_file() and not sha256(path.read_bytes()).hexdigest().startswith(
        KNOWN[name]
    ):
        pytest.skip(f"{name} is another version than the measured one")
    return verify_foreign(path)


def test_the_vendors_demo_breaks_its_own_least_distance():
    found = judged("demo.skyc").check("VRF504")
    assert found.verdict == "fail" and found.limit == 5.0
    assert found.value == pytest.approx(3.776, abs=5e-4)
    assert found.where.time == pytest.approx(12.4, abs=0.05)
    assert found.notes[0] == "drone_02 and drone_03"


@pytest.mark.parametrize(
    ("name", "drones", "duration", "height"),
    [
        ("test-show.skyc", 3, 22.21, 15.0),
        ("real_show.skyb", 1, 600.85, 109.452),
        ("forward_left_back.skyb", 1, 53.0, 10.0),
    ],
)
def test_sizes_are_those_of_the_libraries_that_wrote_the_files(
    name, drones, duration, height
):
    result = judged(name)
    assert (result.drones, round(result.duration, 2)) == (drones, duration)
    assert result.check("VRF501").verdict == "pass"
    assert result.check("VRF506").value == pytest.approx(height, abs=1e-3)


def test_ten_tables_are_one_show():
    result = judged("mds")
    assert result.drones == 10 and result.duration == pytest.approx(478.75)
    found = result.check("VRF504")
    assert found.value == pytest.approx(4.238, abs=1e-3)
    assert found.where.time == pytest.approx(330.1, abs=0.05)
