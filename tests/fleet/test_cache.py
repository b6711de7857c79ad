"""The cache: right or absent, whatever happens to its files."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
from fleet.handmade import LIMITS, make_leg, make_options, make_show
from hypothesis import given, settings
from hypothesis import strategies as st

from showc.fleet.execution.cache import (
    SOLVING,
    Cache,
    default_folder,
    digest,
    leg_key,
)
from showc.fleet.execution.pool import InProcess
from showc.fleet.leg import solve_leg
from showc.progress import Silent
from showc.vehicle import Separation

START = np.array([[0.0, 0.0, 10.0], [3.0, 0.0, 10.0]])


@pytest.fixture(scope="module")
def solved():
    leg = make_leg(START, START + [0.0, 6.0, 1.0], duration=4.0)
    flight = solve_leg(leg, make_show(2), make_options(), InProcess(), Silent())
    return leg, flight


def files(folder):
    return sorted(path for path in Path(folder).rglob("*") if path.is_file())


def test_what_is_kept_comes_back_bit_for_bit(solved, tmp_path):
    leg, flight = solved
    cache = Cache(tmp_path, 10**9)
    assert cache.find("ab" * 32, leg) is None
    cache.keep("ab" * 32, flight)
    found = cache.find("ab" * 32, leg)
    assert found.duration == flight.duration
    assert found.certificate == dataclasses.replace(
        flight.certificate, statistics=found.certificate.statistics
    )
    assert dict(found.certificate.statistics) == dict(flight.certificate.statistics)
    for one, other in zip(found.trajectories, flight.trajectories, strict=True):
        assert one.meshes == other.meshes
        for a, b in ((one.state, other.state), (one.control, other.control)):
            assert np.array_equal(a.breaks, b.breaks)
            assert np.array_equal(a.coefficients, b.coefficients)
    assert [path.suffix for path in files(tmp_path)] == [".leg"]


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_a_damaged_entry_counts_as_absent_and_goes(solved, tmp_path_factory, data):
    leg, flight = solved
    cache = Cache(tmp_path_factory.mktemp("cache"), 10**9)
    cache.keep("cd" * 32, flight)
    (path,) = files(cache._folder)
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] ^= data.draw(st.integers(1, 255))
    else:
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    path.write_bytes(bytes(content))
    assert cache.find("cd" * 32, leg) is None
    assert not path.exists()


def test_the_least_recently_used_go_first(solved, tmp_path):
    leg, flight = solved
    roomy = Cache(tmp_path, 10**9)
    keys = [f"{number:02d}" * 32 for number in range(4)]
    for number, key in enumerate(keys[:3]):
        roomy.keep(key, flight)
        (path,) = tmp_path.glob(f"*/{key}.leg")
        os.utime(path, (1000 + number, 1000 + number))
    size = path.stat().st_size
    assert roomy.find(keys[0], leg) is not None  # used just now
    Cache(tmp_path, 2 * size).keep(keys[3], flight)
    left = {path.stem for path in files(tmp_path)}
    assert left == {keys[0], keys[3]}


def test_a_folder_that_cannot_be_written_is_no_fault(solved, tmp_path):
    leg, flight = solved
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    cache = Cache(blocked, 10**9)
    cache.keep("ef" * 32, flight)
    assert cache.find("ef" * 32, leg) is None


def test_the_key_follows_everything_that_matters_and_nothing_else():
    leg, show, options = make_leg(START, START + 5.0), make_show(2), make_options()
    key = leg_key(leg, show, options)
    same = (
        (make_leg(START, START + 5.0, index=0, name="other"), show, options),
        (leg, show, make_options(jobs=7, cluster="tcp://somewhere:1")),
    )
    for arguments in same:
        assert leg_key(*arguments) == key
    other = (
        (make_leg(START, START + 5.0 + 1e-12), show, options),
        (make_leg(START, START + 5.0, duration=9.0), show, options),
        (make_leg(START, START + 5.0, parked=START + 50.0), show, options),
        (
            make_leg(START, START + 5.0, limits=dataclasses.replace(LIMITS, tilt=0.3)),
            show,
            options,
        ),
        (leg, make_show(2, separation=Separation(1.1)), options),
        (leg, make_show(2, heading=0.1), options),
        (leg, make_show(2, yaw="free"), options),
        (leg, show, make_options(gap=0.02)),
    )
    keys = {leg_key(*arguments) for arguments in other}
    assert len(keys) == len(other) and key not in keys


def test_the_digest_tells_alike_values_apart():
    values = [
        1, 1.0, "1", b"1", True, None, [1], [[1]], [1, 1], ["11"], ["1", "1"],
        {"1": 1}, np.array([1]), np.array([1.0]), np.array([[1.0]]), 0.0, -0.0,
    ]  # fmt: skip
    assert len({digest(value) for value in values}) == len(values)
    with pytest.raises(TypeError):
        digest(object())


def test_the_folder_follows_the_user_s_choice(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_folder() == tmp_path / "showc"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_folder() == tmp_path / ".cache" / "showc"


def test_the_digest_covers_every_folder_that_solves():
    package = Path(__file__).parents[2] / "showc"
    for part in SOLVING:
        assert len(list((package / part).rglob("*.py"))) > 3
