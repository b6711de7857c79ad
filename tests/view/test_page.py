"""The page's own bytes: whole, small, closed, true to the log."""

from __future__ import annotations

import base64
import json
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest
from synthetic import gliding_flight
from vehicle_link.test_compare import fly_missions, with_missions

from showc.log.reader import read_log
from showc.log.sample import PLACE
from showc.vehicle_link.course import course_of
from showc.vehicle_link.flown import FlownLog
from showc.view import render_page
from showc.view.digest import digest, tightest
from showc.view.scene import SecondFleet
from showc.view.second_fleet import frame_times, mission_times, predicted_fleet


def header_of(page: str) -> dict:
    found = re.search(r'<script id="header"[^>]*>(.*?)</script>', page, re.DOTALL)
    return json.loads(found.group(1))


def payload_of(page: str) -> np.ndarray:
    found = re.search(r'<script id="data"[^>]*>(.*?)</script>', page, re.DOTALL)
    raw = zlib.decompress(base64.b64decode(found.group(1)))
    return np.frombuffer(raw, dtype=np.uint8)


def second_of(page: str) -> tuple[np.ndarray, np.ndarray]:
    """Bytes before those of the second fleet, and its steps (frames, drones, 3)."""
    header, data = header_of(page), payload_of(page)
    shape = (3, header["second"]["frames"], header["drones"])
    count = int(np.prod(shape))
    pairs = data[-2 * count :].reshape(2, count).T.copy().view("<u2").reshape(shape)
    steps = pairs.cumsum(axis=1, dtype=np.uint16).cumsum(axis=1, dtype=np.uint16)
    return data[: -2 * count], np.moveaxis(steps.view(np.int16), 0, -1).astype(float)


@pytest.fixture(scope="module")
def page(gliding_log):
    return render_page(gliding_log)


def test_same_log_gives_the_same_page(gliding_log, page):
    assert render_page(gliding_log) == page


def test_page_asks_for_nothing_from_elsewhere(page):
    assert "http" not in page.replace("http-equiv", "")
    assert not re.search(r"<(link|img|iframe|script[^>]*\ssrc)", page)
    assert "@import" not in page and "url(" not in page


def test_positions_and_colours_survive(gliding_log, page):
    header, data = header_of(page), payload_of(page)
    frames, drones = header["frames"], header["drones"]
    assert (frames, drones) == (gliding_log.times.size, 16)
    count = 3 * frames * drones
    second = data[:count].astype(np.uint16) | data[count : 2 * count].astype(
        np.uint16
    ) << np.uint16(8)
    steps = second.view(np.int16).reshape(3, frames, drones).astype(np.int64)
    place = np.moveaxis(steps.cumsum(axis=1).cumsum(axis=1), 0, -1)
    scale = np.array(header["scale"])
    found = header["origin"] + scale * place.astype(np.uint16).view(np.int16)
    assert np.abs(found - gliding_log.positions).max() <= 0.5 * scale.max() + 1e-9
    differences = data[2 * count : 3 * count].reshape(3, frames, drones)
    colours = differences.cumsum(axis=1, dtype=np.uint8)
    for channel, name in enumerate(("red", "green", "blue")):
        assert np.array_equal(colours[channel], gliding_log.samples[name])


def test_signals_survive(gliding_log, page):
    header, data = header_of(page), payload_of(page)
    frames, drones = header["frames"], header["drones"]
    begin = 9 * frames * drones
    size = header["signalFrames"] * drones
    speed = data[begin : begin + size].reshape(-1, drones).cumsum(0, dtype=np.uint8)
    exact = np.sqrt(
        sum(gliding_log.samples[n].astype(float) ** 2 for n in ("vx", "vy", "vz"))
    )
    assert header["signals"][0]["name"] == "Speed"
    found = speed / 255.0 * header["signals"][0]["range"]
    assert np.abs(found - exact).max() < header["signals"][0]["range"] / 500.0


def test_meshes_are_those_of_the_trajectories(gliding_log, page):
    header, data = header_of(page), payload_of(page)
    index = data[-2 * len(gliding_log.segments) * 16 :].copy().view("<u2")
    index = index.reshape(-1, 16)
    for number, segment in enumerate(gliding_log.segments):
        mesh = np.array(header["meshes"][index[number, 5]])
        if segment.kind == "hold":
            assert mesh.size == 0
        else:
            breaks = segment.trajectory(5).state.breaks / segment.duration
            assert np.allclose(mesh, breaks, atol=1e-4)


def test_curves_of_the_fleet_are_its_extremes(gliding_log, page):
    speed, push, apart, height = header_of(page)["bands"]
    samples, times = gliding_log.samples, gliding_log.times
    velocity = np.stack([samples[n] for n in ("vx", "vy", "vz")], axis=-1)
    limits = gliding_log.rules.limits
    assert max(speed["values"]) == pytest.approx(np.abs(velocity).max(), abs=2e-3)
    assert max(speed["limits"]) == max(one.velocity_max.x for one in limits)
    change = np.diff(velocity[..., :2], axis=0) / np.diff(times)[:, None, None]
    most = np.linalg.norm(change, axis=-1).max()
    assert max(push["values"]) == pytest.approx(most, rel=1e-3)
    nearest = tightest(digest(gliding_log))
    assert min(apart["values"]) == pytest.approx(nearest.distance, abs=1e-3)
    assert apart["least"] and set(apart["limits"]) == {header_of(page)["separation"]}
    assert max(height["values"]) == pytest.approx(samples["z"].max(), abs=1e-3)


def test_the_missions_fleet_starts_each_leg_with_the_solved_one(gliding_log):
    moves = [one for one in gliding_log.segments if one.kind == "transition"]
    slots = [one.start * 1.5 + 4.0 for one in moves]
    legs = [
        {"optimal_start": one.start, "slot": slot}
        for one, slot in zip(moves, slots, strict=True)
    ]
    clock = np.arange(0.0, 1.5 * gliding_log.duration + 20.0, 0.05)
    fleet = np.zeros((clock.size, 16), dtype=PLACE)
    fleet["x"] = clock[:, None]
    logged = replace(
        gliding_log,
        predicted_times=clock,
        predicted=fleet,
        attachments={
            "manifest.json": json.dumps(
                {"missions": {"prediction": {"legs": legs}}}
            ).encode()
        },
    )
    asked = np.array([moves[0].start - 1.0, moves[0].start + 0.5, moves[1].start + 1.0])
    wanted = [asked[0], slots[0] + 0.5, slots[1] + 1.0]
    assert np.allclose(mission_times(logged, asked), wanted)
    second = predicted_fleet(logged)
    clock = mission_times(logged, second.times)
    assert np.allclose(second.positions[:, 3, 0], clock, atol=1e-3)
    assert header_of(render_page(logged))["second"]["name"] == "Missions, as predicted"
    assert predicted_fleet(gliding_log) is None
    assert header_of(render_page(gliding_log))["second"] is None


def test_a_second_fleet_survives_and_changes_nothing_of_the_first(gliding_log, page):
    places = gliding_log.positions + np.array([3.0, -400.0, 0.25])
    places[:, 5] = np.nan
    places[:40, 2] = np.nan
    fleet = SecondFleet("As flown", frame_times(gliding_log), places)
    shown = render_page(gliding_log, flown=fleet)
    second = header_of(shown)["second"]
    assert header_of(shown) == header_of(page) | {"second": second}
    alone, steps = second_of(shown)
    assert np.array_equal(alone, payload_of(page))
    assert second["frameStep"] == pytest.approx(0.05)
    scale = np.array(second["scale"])
    unknown = (steps == -32768.0).any(axis=-1)
    assert np.array_equal(unknown, np.isnan(places).any(axis=-1))
    found = second["origin"] + scale * steps
    off = np.abs(found - places)[~unknown]
    assert (off <= 0.5 * scale + 1e-9).all()


@pytest.mark.parametrize("kind", ["missions", "trajectories"])
def test_what_was_flown_is_drawn_in_the_time_of_the_show(tmp_path, run_showc, kind):
    log, page = with_missions(tmp_path / "output.mcap"), tmp_path / "flown.html"
    fly_missions(tmp_path / "logs", log, beside=0.6, kind=kind)
    (tmp_path / "logs" / "02.BIN").unlink()
    options = ("--no-verify", "-o", page)
    run = run_showc("view", log, "--flown", tmp_path / "logs", *options)
    assert run.code == 0, run.err
    shown = page.read_text("utf-8")
    second = header_of(shown)["second"]
    assert second["shown"] and second["name"] == "As flown"
    _, steps = second_of(shown)
    assert (steps[:, 2] == -32768).all()
    logged = read_log(log)
    times = frame_times(logged)
    course = course_of(logged, kind)
    clock = mission_times(logged, times) if kind == "missions" else times
    for drone in range(2):
        known = (steps[:, drone] != -32768).all(axis=-1)
        assert known.sum() > 0.5 * times.size
        found = second["origin"] + second["scale"] * steps[known, drone]
        off = found - course.at(drone, clock[known])
        # The cards have ten places a second, and straight lines between them.
        assert np.abs(off - [0.0, 0.6, 0.0]).max() < 0.1


def test_records_that_compare_refuses_view_refuses_alike(tmp_path, run_showc):
    log = with_missions(tmp_path / "output.mcap")
    missing = tmp_path / "missing.BIN"
    run = run_showc("view", log, "--flown", missing)
    assert run.code == 2
    assert run.err == run_showc("compare", log, missing).err
    assert not log.with_suffix(".html").exists()
    with FlownLog(tmp_path / "late.mcap", (0,), 0) as record:
        record.add(0, 1000.0, np.zeros(3), np.zeros(3))
    run = run_showc("view", log, "--flown", tmp_path / "late.mcap")
    assert run.code == 2 and "has no position between 0 and" in run.err


def test_the_layout_for_other_viewers_is_the_one_in_the_log(
    tmp_path, run_showc, compiled
):
    log, layout = compiled("swap"), tmp_path / "layout.json"
    page = ("--no-verify", "-o", tmp_path / "page.html")
    run = run_showc("view", log, *page, "--layout", layout)
    assert run.code == 0 and "import it in Foxglove" in run.out
    assert layout.read_bytes() == read_log(log).attachments["layout.json"]


def test_the_second_of_a_great_fleet_has_fewer_frames(gliding_log, monkeypatch):
    monkeypatch.setattr("showc.view.second_fleet.BUDGET", 16 * 200)
    times = frame_times(gliding_log)
    assert times.size <= 202
    assert np.diff(times)[:-1] == pytest.approx(times[1] - times[0])
    assert times[-1] == gliding_log.times[-1]


def test_encounters_and_chapters(gliding_log, page):
    header = header_of(page)
    nearest = tightest(digest(gliding_log))
    marked = [e for e in header["encounters"] if e["tightest"]]
    assert len(marked) == 1 and marked[0]["distance"] == nearest.distance
    place = gliding_log.positions
    step = int(np.searchsorted(gliding_log.times, nearest.time))
    a, b = nearest.drone_a, nearest.drone_b
    apart = np.linalg.norm(place[step, a] - place[step, b])
    assert apart == pytest.approx(nearest.distance, abs=0.1)
    kinds = [segment["kind"] for segment in header["segments"]]
    assert kinds[0] == "launch" and kinds[-1] == "land" and "hold" in kinds


def test_digest_finds_a_pair_the_certificate_missed(make_logged):
    flight = gliding_flight(9)
    logged = make_logged(flight)
    for segment in logged.segments:
        segment.message.certificate.closest.distance += 5.0
    found = tightest(digest(logged))
    exact = min(
        leg.certificate.closest.distance
        for leg in flight.legs
        if leg.certificate.closest is not None
    )
    assert found.distance < exact + 0.2


def test_names_cannot_break_out_of_the_page(make_logged):
    logged = make_logged(gliding_flight(4))
    logged.rules.name = "</script><script>alert('$header & more')</script>"
    page = render_page(logged)
    assert page.count("<script") == 4 and "<script>alert" not in page
    assert header_of(page)["name"] == logged.rules.name


@pytest.mark.parametrize(
    ("proved", "passed", "kind"),
    [(True, True, "pass"), (False, True, "open"), (False, False, "fail")],
)
def test_the_badge_is_green_only_for_what_is_proved(gliding_log, proved, passed, kind):
    verdict = "SAID: <b> by verify."
    verification = {"proved": proved, "passed": passed, "verdict": verdict}
    verification["checks"] = []
    shown = render_page(gliding_log, verification)
    assert f'<div class="verdict {kind}">' in shown
    assert "&lt;b&gt; by verify." in shown
    assert ('class="verdict pass"' in shown) == proved
    assert 'class="verdict none"' in render_page(gliding_log)
