"""The fleet table: its scripts are shows, and what it measures is all there is."""

import sys

import numpy as np
import pytest
from benchmarks.fleet_shows import all_shows, growth
from benchmarks.fleet_table import growth_line, words
from benchmarks.household import run

from showc.script import load_show

SHOWS = {**all_shows(), **growth()}

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

ORPHAN = """
import os, time
def burn(seconds):
    held = bytearray(80_000_000)
    held[::4096] = b"x" * len(held[::4096])
    begun = time.process_time()
    while time.process_time() - begun < seconds:
        sum(range(1000))
if os.fork() == 0:
    if os.fork() == 0:
        burn(1.2)
    os._exit(0)
burn(0.8)
"""


@pytest.mark.parametrize("key", [key for key in SHOWS if key != "5000"])
def test_every_script_is_a_show_with_its_transitions(key, tmp_path):
    show = SHOWS[key]
    (tmp_path / "show.yaml").write_text(show.script)
    for name, content in show.files.items():
        (tmp_path / name).write_text(content)
    result = load_show(str(tmp_path / "show.yaml"))
    assert result.show is not None, [found.message for found in result.diagnostics]
    assert result.show.drones == show.drones
    assert {case.index for case in show.cases} <= set(
        range(len(result.show.transitions))
    )


def test_random_places_are_two_metres_apart():
    rows = SHOWS["random"].files["s.csv"].split()
    places = np.array([[float(x) for x in row.split(",")] for row in rows])
    gap = np.linalg.norm(places[:, None] - places[None], axis=2)
    gap[np.arange(1000), np.arange(1000)] = np.inf
    assert 1.9 < gap.min() < 2.1


def test_a_household_counts_those_that_outlive_their_parents(tmp_path):
    needed = run([sys.executable, "-c", ORPHAN], tmp_path)
    assert needed.code == 0
    assert 1.9 < needed.processor < 4.0
    assert needed.memory > 80.0


def test_a_household_is_stopped_after_its_limit(tmp_path):
    needed = run(
        [sys.executable, "-c", "import time; time.sleep(60)"], tmp_path, limit=1.0
    )
    assert needed.code == -1
    assert needed.wall < 30.0


def test_growth_is_the_slope_of_logarithms():
    rows = [(f"{n:,} drones", "", "", f"{0.02 * n**1.25:.6f}") for n in (250, 1000)]
    assert "power of 1.25" in growth_line(rows)
    assert words([0.4, 2.0]) == "load 0.4 to 2.0 as the shows began"
