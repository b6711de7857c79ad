"""A flight of anyone's making is proved before it is used."""

import hashlib
import io
import json
import os
from dataclasses import replace

import numpy as np
import pytest
from fleet.handmade import Listening, make_itinerary, make_leg, make_options, make_show

from showc.errors import SolveError
from showc.fleet import itinerary as module
from showc.fleet import solve_itinerary
from showc.fleet.execution.cache import Cache, _decoded, default_folder
from showc.fleet.execution.pool import InProcess
from showc.fleet.leg import solve_leg
from showc.fleet.proof import flaw
from showc.progress import Silent
from showc.trajectory import PiecewisePolynomial

START = np.array([[0.0, 0.0, 10.0], [3.0, 0.0, 10.0]])
SHOW = make_show(2)


@pytest.fixture(scope="module")
def flight():
    leg = make_leg(START, START + [0.0, 6.0, 1.0], duration=4.0)
    return solve_leg(leg, SHOW, make_options(), InProcess(), Silent())


def edited(flight, drone, part, change):
    """The same flight with the coefficients of one drone changed."""
    trajectories = list(flight.trajectories)
    old = getattr(trajectories[drone], part)
    coefficients = np.array(old.coefficients)
    coefficients = change(coefficients)
    trajectories[drone] = replace(
        trajectories[drone], **{part: PiecewisePolynomial(old.breaks, coefficients)}
    )
    return replace(flight, trajectories=tuple(trajectories))


def aside(way):
    """Lead a drone away and back, smoothly: 0.1 m from where its rotors take it."""

    def change(coefficients):
        middle = len(coefficients) // 2
        coefficients[middle, 1:-1, :3] += way
        return coefficients

    return change


def scaled(column, factor):
    def change(coefficients):
        coefficients[1:-1, :, column] *= factor
        return coefficients

    return change


def number(value):
    def change(coefficients):
        coefficients[0, 1, 0] = value
        return coefficients

    return change


EDITS = {
    "0.1 m aside": (lambda f: edited(f, 0, "state", aside([0.1, 0, 0])), "miss"),
    "another drone's flight": (
        lambda f: replace(f, trajectories=f.trajectories[::-1]),
        "from its place",
    ),
    "a drone less": (lambda f: replace(f, trajectories=f.trajectories[:1]), "flights"),
    "no number": (lambda f: edited(f, 1, "state", number(np.nan)), "finite"),
    "without end": (lambda f: edited(f, 1, "control", number(np.inf)), "finite"),
    "twice as fast": (lambda f: edited(f, 0, "state", scaled(4, 9.0)), "jump|limit"),
    "too much thrust": (lambda f: edited(f, 0, "control", scaled(0, 9.0)), "limit"),
    "another duration": (lambda f: replace(f, duration=3.0), "certificate"),
    "no duration": (lambda f: replace(f, duration=np.nan), "duration"),
    "another distance": (
        lambda f: replace(
            f,
            certificate=replace(
                f.certificate, closest=replace(f.certificate.closest, distance=9.0)
            ),
        ),
        "closest pair",
    ),
    "a pair that does not fly": (
        lambda f: replace(
            f,
            certificate=replace(
                f.certificate, closest=replace(f.certificate.closest, drone_b=77)
            ),
        ),
        "does not fly",
    ),
    "no pair": (
        lambda f: replace(f, certificate=replace(f.certificate, closest=None)),
        "no closest pair",
    ),
}


def test_what_is_solved_has_no_flaw(flight):
    assert flaw(flight, SHOW) == ""


@pytest.mark.parametrize("name", EDITS)
def test_an_edited_flight_has_a_flaw(flight, name):
    import re

    edit, said = EDITS[name]
    assert re.search(said, flaw(edit(flight), SHOW))


def test_drones_that_come_too_near_are_named(flight):
    near = replace(
        flight.leg,
        start=START * [0.3, 1, 1],
        goal=(START + [0.0, 6.0, 1.0]) * [0.3, 1, 1],
    )

    def change(coefficients):
        coefficients[..., 0] *= 0.3
        return coefficients

    moved = edited(edited(flight, 0, "state", change), 1, "state", change)
    assert "drone 1 and drone 2 come 0.900 m near" in flaw(
        replace(moved, leg=near), SHOW
    )


def tampered(content, edit):
    """An entry of the cache with its numbers edited and its checksum made right."""
    with np.load(io.BytesIO(content[40:])) as arrays:
        kept = {name: np.array(arrays[name]) for name in arrays}
    edit(kept)
    stream = io.BytesIO()
    np.savez(stream, **kept)
    payload = stream.getvalue()
    return content[:8] + hashlib.sha256(payload).digest() + payload


def test_an_edited_entry_of_the_cache_is_not_compiled(tmp_path):
    legs = [make_leg(START, START + [0.0, 6.0, 1.0], duration=4.0)]
    options = make_options(use_cache=True, cache=tmp_path)
    first = solve_itinerary(make_itinerary(legs), options, Silent())
    (entry,) = tmp_path.rglob("*.leg")

    def edit(arrays):
        arrays["state0"][0, arrays["state0"].shape[1] // 2, 1:-1, 0] += 0.1

    entry.write_bytes(tampered(entry.read_bytes(), edit))
    watcher = Listening()
    again = solve_itinerary(make_itinerary(legs), options, watcher)
    assert any("should not be trusted" in note for note in watcher.notes)
    for one, other in zip(
        first.legs[0].trajectories, again.legs[0].trajectories, strict=True
    ):
        assert np.array_equal(one.state.coefficients, other.state.coefficients)
    watcher = Listening()
    solve_itinerary(make_itinerary(legs), options, watcher)
    assert any("taken from the cache" in note for note in watcher.notes)


def test_what_a_worker_returns_is_proved(monkeypatch, flight):
    wrong = edited(flight, 0, "state", aside([0.0, 0.0, 0.1]))
    monkeypatch.setattr(module, "solve_leg", lambda *_: wrong)
    with pytest.raises(SolveError, match="worker returned"):
        solve_itinerary(make_itinerary([flight.leg]), make_options(), Silent())


@pytest.mark.parametrize("missing", ["note", "state0", "members0", "breaks0"])
def test_an_entry_without_all_of_its_parts_is_absent(flight, tmp_path, missing):
    cache = Cache(tmp_path, 10**9)
    cache.keep("ab" * 32, flight)
    (entry,) = tmp_path.rglob("*.leg")
    entry.write_bytes(tampered(entry.read_bytes(), lambda kept: kept.pop(missing)))
    assert cache.find("ab" * 32, flight.leg) is None
    assert not entry.exists()


@pytest.mark.parametrize("key", ["duration", "groups", "certificate"])
def test_an_entry_without_a_key_is_absent(flight, tmp_path, key):
    cache = Cache(tmp_path, 10**9)
    cache.keep("ab" * 32, flight)
    (entry,) = tmp_path.rglob("*.leg")

    def edit(kept):
        note = json.loads(kept["note"].tobytes())
        del note[key]
        kept["note"] = np.frombuffer(json.dumps(note).encode(), dtype=np.uint8)

    entry.write_bytes(tampered(entry.read_bytes(), edit))
    assert cache.find("ab" * 32, flight.leg) is None


def test_an_entry_that_grows_when_it_is_read_is_absent(flight):
    stream = io.BytesIO()
    np.savez_compressed(stream, note=np.zeros(10**7, dtype=np.uint8))
    payload = stream.getvalue()
    content = b"showcleg" + hashlib.sha256(payload).digest() + payload
    assert _decoded(content, flight.leg) is None


def test_a_pipe_in_place_of_an_entry_is_absent(flight, tmp_path):
    (tmp_path / "ab").mkdir()
    os.mkfifo(tmp_path / "ab" / f"{'ab' * 32}.leg")
    assert Cache(tmp_path, 10**9).find("ab" * 32, flight.leg) is None


@pytest.mark.parametrize("what", ["read-only", "a file"])
def test_a_cache_that_cannot_be_written_is_done_without(flight, tmp_path, what):
    folder = tmp_path / "cache"
    if what == "a file":
        folder.write_bytes(b"")
    else:
        folder.mkdir(mode=0o500)
    cache = Cache(folder, 10**9)
    cache.keep("ab" * 32, flight)
    found = cache.find("ab" * 32, flight.leg)
    assert found is None or os.geteuid() == 0


def test_who_has_no_home_has_no_cache(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr("os.path.expanduser", lambda path: path)
    monkeypatch.setattr("pathlib.os.path.expanduser", lambda path: path)
    assert default_folder() is None
    assert Cache.of(make_options(use_cache=True)).parts("ab" * 32) is None
