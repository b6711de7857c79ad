"""The pages in a real browser: right pictures, not only present ones."""

from __future__ import annotations

import json
import wave
from dataclasses import replace
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from showc.log.schema import WIND_NAME
from showc.simulate.results import Campaign, Tube, Weather
from showc.view import render_leg, render_page, render_report
from showc.view.digest import digest, tightest
from showc.view.scene import Cue, SecondFleet, Soundtrack
from showc.view.second_fleet import frame_times

if TYPE_CHECKING:
    from pathlib import Path

WIDTH, HEIGHT = 1280, 800


@pytest.fixture(scope="module")
def page(tmp_path_factory, gliding_log) -> Path:
    path = tmp_path_factory.mktemp("page") / "show.html"
    path.write_text(render_page(gliding_log), "utf-8")
    return path


def picture(tab) -> np.ndarray:
    """What the browser shows, (height, width, 3) from 0 to 255."""
    image = Image.open(BytesIO(tab.screenshot())).convert("RGB")
    return np.asarray(image, dtype=np.int64)


def projected(points: np.ndarray, azimuth, elevation, distance, target) -> np.ndarray:
    """Where a camera of 40 degrees sees points (n, 3): pixels (n, 2)."""
    a, e = np.radians([azimuth, elevation])
    forward = np.array([-np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), -np.sin(e)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    seen = points - (np.asarray(target) - distance * forward)
    depth = seen @ forward
    focal = 0.5 * HEIGHT / np.tan(np.radians(20.0))
    across, above = focal * (seen @ right) / depth, focal * (seen @ up) / depth
    return np.stack([0.5 * WIDTH + across, 0.5 * HEIGHT - above], axis=1)


@pytest.mark.parametrize(
    ("time", "angles"),
    [
        (17.0, (0.0, 5.0)),
        (28.2, (35.0, 20.0)),
        (36.1, (-60.0, 60.0)),
        (31.0, (10.0, -8.0)),
    ],
)
def test_drones_stand_where_they_are_projected_in_their_colours(
    tab, page, gliding_log, time, angles
):
    (azimuth, elevation), distance = angles, 70.0
    target = [0.0, 0.0, 20.0]
    tab.open(
        page,
        f"t={time}&play=0&az={azimuth}&el={elevation}&dist={distance}&target=0,0,20",
    )
    # The label of an encounter may cover a drone.
    hide = "document.querySelectorAll('#marks, .tag').forEach(e => e.style.opacity = 0)"
    tab.evaluate(hide)
    shown = picture(tab)
    flights = [gliding_log.trajectory(k) for k in range(16)]
    place = np.stack([flight.state(time)[:3] for flight in flights])
    pixels = projected(place, azimuth, elevation, distance, target)
    step = int(np.searchsorted(gliding_log.times, time, side="right")) - 1
    sample = gliding_log.samples[step]
    lit = 0
    for drone, (x, y) in enumerate(pixels):
        others = np.delete(pixels, drone, axis=0)
        alone = np.hypot(*(others - [x, y]).T).min() > 26.0
        if not (30 < x < WIDTH - 30 and 130 < y < HEIGHT - 150 and alone):
            continue
        colour = np.array([sample[n][drone] for n in ("red", "green", "blue")])
        around = shown[int(y) - 14 : int(y) + 15, int(x) - 14 : int(x) + 15]
        weight = around.sum(axis=2).astype(float)
        weight = np.where(weight > 0.6 * weight.max(), weight, 0.0)
        rows, columns = np.indices(weight.shape)
        centre = np.array([(columns * weight).sum(), (rows * weight).sum()])
        centre = centre / weight.sum() + [int(x) - 14 + 0.5, int(y) - 14 + 0.5]
        assert np.hypot(*(centre - [x, y])) < 1.6
        if colour.max() < 60:
            continue
        lit += 1
        # The core is paler than the light; its hue is that of the light.
        core = shown[int(y) - 4 : int(y) + 5, int(x) - 4 : int(x) + 5].sum(axis=(0, 1))
        assert core.argmax() == colour.argmax() or core.max() - core.min() < 90
        order = np.argsort(colour)
        if np.diff(colour[order]).min() > 40:
            assert np.array_equal(np.argsort(core), order)
    assert lit >= 4


def test_dark_drones_do_not_shine(tab, page):
    tab.open(page, "t=3&play=0&az=0&el=5&dist=70&target=0,0,20")
    dark = picture(tab)[150:600, 100:1100]
    tab.open(page, "t=17&play=0&az=0&el=5&dist=70&target=0,0,20")
    bright = picture(tab)[150:600, 100:1100]
    assert dark.max() < 140 and bright.max() > 230


def test_page_is_closed_and_free_of_errors(tab, page):
    tab.errors.clear()
    tab.open(page, "t=5&play=0")
    assert tab.evaluate("performance.getEntriesByType('resource').length") == 0
    assert tab.errors == []
    assert tab.evaluate("window.__load_ms") > 0
    assert tab.evaluate("document.querySelector('#failure').hidden")


def test_it_plays_at_its_speed(tab, page):
    tab.open(page, "t=5&speed=2")
    # However busy the machine: it plays on, and never faster than it is told. Frames
    # that are drawn late carry the time at which they were due, and count with that.
    passed = tab.evaluate(
        "new Promise(done => { const begin = player.last, from = player.time;"
        " const look = () => player.time > from + 2"
        " ? done([window.__frames, player.time - from, player.last - begin,"
        " performance.now() - player.last])"
        " : requestAnimationFrame(look); look(); })"
    )
    frames, played, took, late = passed
    assert frames > 5
    assert played <= 0.002 * took + 1e-9
    assert late >= 0.0
    tab.evaluate("play(false)")


def key(tab, name: str, **options) -> None:
    event = json.dumps({"key": name, "bubbles": True, **options})
    tab.evaluate(f"document.body.dispatchEvent(new KeyboardEvent('keydown', {event}))")


def test_keys(tab, page, gliding_log):
    tab.open(page, "t=5&play=0")
    for name, options, wanted in [
        ("ArrowRight", {}, 6.0),
        ("ArrowRight", {"shiftKey": True}, 11.0),
        ("ArrowLeft", {}, 10.0),
        ("Home", {}, 0.0),
        (".", {}, 0.05),
        ("]", {}, gliding_log.segments[2].start),
        ("End", {}, gliding_log.duration),
        ("[", {}, gliding_log.segments[-1].start),
    ]:
        key(tab, name, **options)
        assert tab.evaluate("player.time") == pytest.approx(wanted, abs=1e-6)
    key(tab, " ")
    assert tab.evaluate("player.playing")
    key(tab, " ")
    assert not tab.evaluate("player.playing")


def test_tightest_encounter_is_marked(tab, page, gliding_log):
    tab.open(page, "t=0&play=0&view=orbit")
    nearest = tightest(digest(gliding_log))
    chip = tab.evaluate("document.querySelector('#tightest').textContent")
    assert f"{nearest.distance:.2f} m" in chip
    tab.evaluate("document.querySelector('#tightest').click()")
    tab.evaluate("new Promise(done => requestAnimationFrame(() => done()))")
    assert tab.evaluate("player.time") == pytest.approx(nearest.time)
    label = tab.evaluate("document.querySelector('#pair-label').textContent")
    names = f"{nearest.drone_a + 1} and {nearest.drone_b + 1}"
    assert label == f"{nearest.distance:.2f} m · {names}"
    line = "['x1','y1','x2','y2'].map(n => +document.querySelector('#pair-line')"
    ends = np.reshape(tab.evaluate(f"{line}.getAttribute(n))"), (2, 2))
    camera = tab.evaluate("[camera.azimuth, camera.elevation, camera.distance]")
    pair = [nearest.drone_a, nearest.drone_b]
    place = np.stack([gliding_log.trajectory(k).state(nearest.time)[:3] for k in pair])
    wanted = projected(
        place,
        *np.degrees(camera[:2]),
        camera[2],
        tab.evaluate("camera.target"),
    )
    assert np.abs(ends - wanted).max() < 1.5


def test_clicking_a_drone_shows_its_plots(tab, page, gliding_log):
    tab.open(page, "t=17&play=0&az=0&el=5&dist=70&target=0,0,20")
    place = np.stack([gliding_log.trajectory(k).state(17.0)[:3] for k in range(16)])
    x, y = projected(place, 0.0, 5.0, 70.0, [0.0, 0.0, 20.0])[6]
    for kind in ("mousePressed", "mouseReleased"):
        tab.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1
        )
    found = tab.evaluate("document.querySelector('#panel-title').textContent")
    assert found == "Drone 0007"
    titles = tab.evaluate(
        "[...document.querySelectorAll('.plot h3 span')].map(e => e.textContent)"
    )
    assert titles == ["Speed", "Tilt (roll or pitch)", "Thrust", "Nearest drone"]
    tab.evaluate("seek(12)")
    tab.evaluate("new Promise(done => requestAnimationFrame(() => done()))")
    boxes = "[...document.querySelectorAll('.plot h3 b')]"
    values = tab.evaluate(f"{boxes}.map(e => parseFloat(e.textContent))")
    state = np.stack([gliding_log.trajectory(k).state(12.0) for k in range(16)])
    apart = np.linalg.norm(state[:, :3] - state[6, :3], axis=1)
    assert values[0] == pytest.approx(np.linalg.norm(state[6, 3:6]), abs=0.03)
    assert values[1] == pytest.approx(np.degrees(np.abs(state[6, 6:8]).max()), abs=0.1)
    assert values[3] == pytest.approx(np.delete(apart, 6).min(), abs=0.02)
    key(tab, "Escape")
    assert tab.evaluate("document.querySelector('#panel').hidden")


def test_timeline_shows_light_and_mesh_in_place(tab, page, gliding_log):
    tab.open(page, "t=0&play=0")
    box = tab.evaluate(
        "(({left, top, width}) => [left, top, width])"
        "(document.querySelector('#timeline').getBoundingClientRect())"
    )
    shown = picture(tab)
    left, top, width = box

    def at(time: float, down: int) -> np.ndarray:
        x = left + width * time / gliding_log.duration
        return shown[int(top) + down, int(x)]

    # The third picture is blue, the first orange; before the first all is dark.
    wave = gliding_log.segments[6]
    assert at(wave.start + 0.98 * wave.duration, 31).argmax() == 2
    first = gliding_log.segments[2]
    assert at(first.start + 0.95 * first.duration, 31).argmax() == 0
    assert at(3.0, 31).max() < 40
    # A border of the mesh at 30 % of a move, none at 50 %.
    border, middle = (
        max(
            at(first.start + share * first.duration + shift, 68).sum()
            for shift in (-0.04, 0.0, 0.04)
        )
        for share in (0.3, 0.5)
    )
    assert border > middle + 100


FRAME = "new Promise(done => requestAnimationFrame(() => done()))"


def test_the_fleet_is_held_against_its_limits_and_red_where_it_breaks_them(
    tab, tmp_path, gliding_log
):
    path = tmp_path / "show.html"
    page = render_page(gliding_log)
    path.write_text(page, "utf-8")
    tab.open(path, "t=17&play=0&fleet=1")
    names = "[...document.querySelectorAll('.plot h3 span')].map(e => e.textContent)"
    assert len(tab.evaluate(names)) == 4
    broken = "[...document.querySelectorAll('.plot')].map(e => e.className)"
    band = tab.evaluate("show.bands[2]")
    value = tab.evaluate("document.querySelectorAll('.plot h3 b')[2].textContent")
    row = int(np.searchsorted(band["times"], 17.0 + 1e-6, side="right")) - 1
    assert float(value.split()[0]) == pytest.approx(band["values"][row], abs=0.006)
    # The synthetic fleet comes nearer than its separation, and breaks nothing else.
    least = min(band["values"])
    assert least < band["limits"][0]
    assert [c.split()[1:] for c in tab.evaluate(broken)] == [[], [], ["broken"], []]
    tab.evaluate(f"show.bands[2].limits.fill({least - 0.1}); panel.choose(-1); 0")
    assert [c.split()[1:] for c in tab.evaluate(broken)] == [[], [], [], []]


def test_cues_stand_on_the_ruler_and_names_over_holds(tab, tmp_path, gliding_log):
    hold = next(
        one
        for one in gliding_log.segments
        if one.kind == "hold" and not one.message.to_formation.startswith("above")
    )
    cues = (Cue(hold.start + 0.5, "the drop"),)
    track = Soundtrack(2.0, "", cues, 2.0, 2.0)
    path = tmp_path / "show.html"
    path.write_text(render_page(gliding_log, soundtrack=track), "utf-8")
    tab.open(path, f"t={hold.start + 0.5}&play=0")
    left, top, width = tab.evaluate(
        "(({left, top, width}) => [left, top, width])"
        "(document.querySelector('#timeline').getBoundingClientRect())"
    )
    tab.evaluate("seek(0)")
    tab.evaluate(FRAME)
    shown = picture(tab)
    x = int(left + width * (hold.start + 0.5) / gliding_log.duration)
    flag = shown[int(top) + 90, x - 1 : x + 2].sum(axis=0)
    assert flag[0] > flag[2] + 100  # amber
    caption = "document.querySelector('#caption').textContent"
    assert tab.evaluate(caption) == ""
    tab.evaluate(f"seek({hold.start + 0.5})")
    tab.evaluate(FRAME)
    assert tab.evaluate(caption) == hold.message.to_formation
    tab.evaluate("toggle('names', false)")
    tab.evaluate(FRAME)
    assert tab.evaluate(caption) == ""


def test_music_is_where_the_show_is(tab, tmp_path, gliding_log):
    stream = BytesIO()
    with wave.open(stream, "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        loud = (20000 * np.sin(np.arange(40_000) * 0.3)).astype("<i2")
        sound.writeframes(np.concatenate([np.zeros(40_000, "<i2"), loud]).tobytes())
    path = tmp_path / "show.html"
    track = Soundtrack(3.0, "tone.wav", (), 0.0, 0.0)
    page = render_page(gliding_log, soundtrack=track, recording=stream.getvalue())
    path.write_text(page, "utf-8")
    tab.open(path, "t=0&play=0")
    waiting = "new Promise(done => setTimeout(() => done(sound.peaks !== null), 50))"
    assert any(tab.evaluate(waiting) for _ in range(200))
    peaks = tab.evaluate("[...sound.peaks]")
    half = len(peaks) // 2
    assert max(peaks[: half - 2]) < 0.02 and min(peaks[half + 2 : -2]) > 0.5
    tab.evaluate("player.time = 7.5; player.playing = true; followSound(); 0")
    assert tab.evaluate("sound.audio.currentTime") == pytest.approx(4.5, abs=0.1)
    # Before it begins, it is silent.
    tab.evaluate("player.time = 1.0; followSound(); player.playing = false; 0")
    assert tab.evaluate("sound.audio.paused")


def test_a_show_for_clients_has_no_engineering(tab, page):
    tab.open(page, "t=17&play=0&client=1&fleet=1&drone=3")
    hidden = (
        "['nav', '.verdict', '#tightest', '#panel', '#legend'].every(name => "
        "getComputedStyle(document.querySelector(name)).display === 'none')"
    )
    assert tab.evaluate(hidden)
    key(tab, "p")
    assert not tab.evaluate(hidden)


def test_numbers_loop_and_the_clock(tab, page):
    tab.open(page, "t=17&play=0")
    plain = picture(tab)
    key(tab, "#")
    tab.evaluate(FRAME)
    assert (picture(tab) != plain).any(axis=-1).sum() > 300
    key(tab, "#")
    key(tab, "l")
    tab.evaluate("seek(show.duration - 0.01); play(true)")
    frame = "new Promise(done => requestAnimationFrame(() => done(player.time)))"
    assert any(tab.evaluate(frame) < 5.0 for _ in range(100))
    assert tab.evaluate("player.playing")
    tab.evaluate("play(false); toggle('loop', false)")
    clock = "[-0.04, -0.2, 59.96, 61.25].map(one => clockText(one))"
    assert tab.evaluate(clock) == ["0:00.0", "−0:00.2", "1:00.0", "1:01.3"]


def test_where_motion_is_not_wanted_nothing_moves_by_itself(tab, page):
    features = [{"name": "prefers-reduced-motion", "value": "reduce"}]
    tab.call("Emulation.setEmulatedMedia", features=features)
    try:
        tab.open(page, "t=5")
        assert not tab.evaluate("player.playing")
    finally:
        tab.call("Emulation.setEmulatedMedia", features=[])


def test_on_a_phone_nothing_is_cut_off(tab, page):
    size = {"deviceScaleFactor": 1, "mobile": True}
    tab.call("Emulation.setDeviceMetricsOverride", width=390, height=780, **size)
    try:
        tab.open(page, "t=17&play=0&fleet=1")
        outside = (
            "[...document.querySelectorAll('nav button, .controls button, #panel, "
            "#timeline, h1')].filter(e => { const b = e.getBoundingClientRect(); "
            "return b.width && (b.left < 0 || b.right > innerWidth || b.bottom > "
            "innerHeight); }).map(e => e.id)"
        )
        assert tab.evaluate(outside) == []
        panel, footer = tab.evaluate(
            "['#panel', 'footer'].map(n => document.querySelector(n)"
            ".getBoundingClientRect()).map(b => [b.top, b.bottom])"
        )
        assert panel[1] <= footer[0]
        assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    finally:
        tab.call(
            "Emulation.setDeviceMetricsOverride",
            width=WIDTH,
            height=HEIGHT,
            deviceScaleFactor=1,
            mobile=False,
        )


def test_report_prints(tab, tmp_path, gliding_log):
    path = tmp_path / "report.html"
    check = {
        "code": "VRF321",
        "group": "separation",
        "name": "separation of every pair",
        "verdict": "fail",
        "value": 0.13,
        "limit": 1.0,
        "unit": "m",
        "where": {"pair": [9, 10], "segment": "pads -> sphere-1", "time": 9.8},
        "notes": ["too near"],
    }
    verification = {
        "passed": False,
        "proved": False,
        "anchor": "script “a”",
        "verdict": "NOT PROVED: trajectories not proved (closest pair 0.13 m, limit 1)",
        "checks": [check],
    }
    path.write_text(render_report(gliding_log, verification), "utf-8")
    tab.errors.clear()
    tab.open(path)
    assert tab.evaluate("document.querySelector('.verdict').innerText").startswith(
        "NOT PROVED"
    )
    assert tab.errors == []
    shown = picture(tab)
    box = tab.evaluate(
        "(({left, top}) => [left, top])"
        "(document.querySelector('.verdict').getBoundingClientRect())"
    )
    red = shown[int(box[1]) + 4, int(box[0]) + 10]
    assert red[0] > 150 and red[1] < 80
    # Fence on the map in orange, inside the first figure.
    left, top, wide, high = tab.evaluate(
        "(({left, top, width, height}) => [left, top, width, height])"
        "(document.querySelector('figure svg').getBoundingClientRect())"
    )
    site = shown[int(top) : int(top + high), int(left) : int(left + wide)]
    orange = (site[..., 0] > 190) & (site[..., 1] < 170) & (site[..., 2] < 110)
    assert orange.sum() > 200
    assert tab.printed().startswith(b"%PDF")
    overflow = "document.documentElement.scrollWidth <= innerWidth"
    assert tab.evaluate(overflow)


def test_leg_draws_its_curves(tab, tmp_path, gliding_log):
    path = tmp_path / "leg.html"
    path.write_text(render_leg(gliding_log, 2, 6), "utf-8")
    tab.errors.clear()
    tab.open(path)
    assert tab.errors == []
    titles = tab.evaluate(
        "[...document.querySelectorAll('.plots h3')].map(e => e.textContent)"
    )
    assert len(titles) == 11 and titles[1] == "Velocity [m/s]"
    # The limits of 5 m/s are dashed lines; their distance on the page is the scale.
    lines = tab.evaluate(
        "[...document.querySelectorAll('.plots figure')[1].querySelectorAll("
        "'path[stroke-dasharray]')].map(e => e.getBBox().y)"
    )
    curve = tab.evaluate(
        "[...document.querySelectorAll('.plots figure')[1].querySelectorAll("
        "'polyline')].map(e => e.getBBox().y)[2]"
    )
    bottom, top = max(lines), min(lines)
    climb = -5.0 + 10.0 * (bottom - curve) / (bottom - top)
    state = gliding_log.segments[2].trajectory(6).state
    exact = state(np.linspace(0.0, state.end, 500))[:, 5].max()
    assert climb == pytest.approx(exact, abs=0.05)


def test_tubes_of_simulated_wind_are_drawn_about_the_drones(tab, tmp_path, gliding_log):
    legs = [(one.message.name, one.start) for one in gliding_log.segments]
    numbers = (1.0, 0.999, 0.2, 1.6, 0.0, 0.9)
    tubes = [
        Tube(name, start, 1.1, *numbers) for name, start in [*legs, ("whole", 0.0)]
    ]
    wind = Campaign(
        Weather(8.0, "moderate", 3), tuple(tubes), "flatness", observer=True
    )
    path = tmp_path / "windy.html"
    windy = replace(gliding_log, added={WIND_NAME: json.dumps(wind.to_json()).encode()})
    path.write_text(render_page(windy), "utf-8")
    tab.open(path, "t=17&play=0&drone=1")
    plain = picture(tab)
    key(tab, "w")
    tab.evaluate(FRAME)
    place = tab.evaluate(
        "project(viewProjection(innerWidth, innerHeight), placeAt(0, player.time),"
        " innerWidth, innerHeight)"
    )
    edge = tab.evaluate(
        "(() => { const [x, y, z] = placeAt(0, player.time);"
        "const m = viewProjection(innerWidth, innerHeight);"
        "return project(m, [x, y, z + 0.95], innerWidth, innerHeight); })()"
    )
    changed = (picture(tab) != plain).any(axis=-1)
    # Near the rim of a tube of 1 m, and not two metres away.
    x, y = round(edge[0]), round(edge[1])
    assert changed[y - 3 : y + 4, x - 3 : x + 4].any()
    radius = abs(edge[1] - place[1]) / 0.95
    rows, columns = np.nonzero(changed)
    near = np.hypot(columns - place[0], rows - place[1]) < 1.15 * radius
    assert near.sum() > 3.0 * radius
    assert tab.evaluate("display.tubes")
    # A page without simulated flights has no such switch.
    bare = tmp_path / "bare.html"
    bare.write_text(render_page(gliding_log), "utf-8")
    tab.open(bare, "t=17&play=0")
    key(tab, "w")
    assert not tab.evaluate("display.tubes")
    hidden = "document.querySelector('#menu [data-toggle=tubes]').hidden"
    assert tab.evaluate(hidden)


def test_a_second_fleet_stands_hollow_beside_the_solved_one(tab, tmp_path, gliding_log):
    offsets = np.zeros((16, 3))
    offsets[:, 2] = 0.2
    offsets[3] = [0.0, 0.0, 2.5]
    offsets[6] = [0.0, 0.0, 1.5]
    places = gliding_log.positions + offsets
    places[:, 9] = np.nan
    path = tmp_path / "flown.html"
    fleet = SecondFleet("As flown", frame_times(gliding_log), places)
    path.write_text(render_page(gliding_log, flown=fleet), "utf-8")
    time, camera = 17.0, (0.0, 5.0, 70.0, [0.0, 0.0, 20.0])
    tab.errors.clear()
    tab.open(path, f"t={time}&play=0&az=0&el=5&dist=70&target=0,0,20")
    hidden = "document.querySelector('#farthest').hidden"
    assert tab.evaluate(hidden)
    plain = picture(tab)
    key(tab, "m")
    tab.evaluate(FRAME)
    assert not tab.evaluate(hidden)
    chip = "document.querySelector('#farthest').textContent"
    assert tab.evaluate(chip) == "◯ As flown: up to 2.50 m, drone 4"
    changed = (picture(tab) - plain).max(axis=-1) > 40
    state = np.stack([gliding_log.trajectory(k).state(time)[:3] for k in range(16)])
    for drone in (3, 6):
        x, y = projected(state[[drone]] + offsets[drone], *camera)[0]
        rows, columns = np.indices(changed.shape)
        away = np.hypot(columns + 0.5 - x, rows + 0.5 - y)
        # A ring, dark inside.
        assert changed[(away > 4.5) & (away < 7.0)].sum() > 20
        assert not changed[away < 3.0].any()
    # The drone without a record has no ring.
    x, y = projected(state[[9]], *camera)[0]
    assert not changed[int(y) - 7 : int(y) + 8, int(x) - 7 : int(x) + 8].any()
    label = "document.querySelector('#second-label')"
    assert tab.evaluate(f"{label}.hidden")
    x, y = projected(state[[6]], *camera)[0]
    tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    tab.evaluate(FRAME)
    assert tab.evaluate(f"{label}.textContent") == "7: 1.50 m"
    line = "['x1','y1','x2','y2'].map(n => +document.querySelector('#second-line')"
    ends = np.reshape(tab.evaluate(f"{line}.getAttribute(n))"), (2, 2))
    wanted = projected(state[[6, 6]] + [[0.0] * 3, offsets[6]], *camera)
    assert np.abs(ends - wanted).max() < 1.5
    tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=5, y=300)
    tab.evaluate("document.querySelector('#farthest').click()")
    tab.evaluate(FRAME)
    assert tab.evaluate(f"{label}.textContent") == "4: 2.50 m"
    key(tab, "p")
    tab.evaluate(FRAME)
    assert tab.evaluate(f"{label}.hidden")
    assert tab.errors == []
