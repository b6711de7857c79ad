"""The preview: what is drawn before the solve, and a page that follows the script."""

import http.client
import json
import struct
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from repository import ROOT

from showc.fleet.options import SolveOptions
from showc.plan.assignment import nearest_on_lines
from showc.preview.draft import Memory, lay_out, scene_of
from showc.preview.server import Server
from showc.preview.session import Session
from showc.script import read_show
from showc.vehicle import Separation

SMALL = """showc: 1
name: Small
drones: 4
pads: {type: line, spacing: 3}
formations:
  ring: {type: circle, radius: 6, centre: [0, 0, 20], colour: red}
  row: {type: line, spacing: 4, centre: [0, 5, 15], colour: blue}
transitions:
  - {to: ring, hold: 3}
  - {to: row, motion: [{rotate: {angle: 90 deg}}], hold: 12}
"""
BIG = """showc: 1
drones: 500
pads: {type: grid, step: 3 m}
site: {volume: {min: [-150, -150, 0], max: [150, 150, 150]}}
formations:
  ball: {type: sphere, radius: 30, centre: [0, 0, 60], colour: gold}
  wall: {type: grid, plane: front, step: 3 m, centre: [0, 0, 60], colour: red}
transitions: [ball, wall]
"""


def draft_of(script):
    result = read_show(script.encode())
    assert result.show is not None, result.errors
    return lay_out(result.show, Memory())


def test_a_draft_goes_from_place_to_place_on_straight_lines():
    draft = draft_of(SMALL)
    scene = scene_of(draft, Memory())
    times = scene.step * np.arange(len(scene.positions))
    for leg, start, length in zip(
        draft.itinerary.legs, draft.starts, draft.durations, strict=True
    ):
        inside = (times >= start) & (times <= start + length)
        if not inside.any() or leg.motion:
            continue
        way = leg.goal - leg.start
        gone = scene.positions[inside] - leg.start
        assert np.abs(np.cross(gone, way)).max() < 1e-6 * (1.0 + np.abs(way).max() ** 2)
        share = (gone * way).sum(-1) / np.maximum((way**2).sum(-1), 1e-12)
        assert (np.diff(share, axis=0) >= -1e-9).all()
    assert np.allclose(scene.positions[0], draft.itinerary.legs[0].start)
    assert np.allclose(scene.positions[-1], draft.itinerary.legs[-1].goal, atol=1e-6)


def test_times_of_a_draft_are_near_those_of_straight_flights():
    from showc.fleet.pace import straight_time

    draft = draft_of(BIG)
    for leg, length in zip(draft.itinerary.legs, draft.durations, strict=True):
        if leg.open and leg.kind == "transition":
            exact = straight_time(leg, draft.show)
            assert length == pytest.approx(exact, rel=0.05)


def test_a_formation_that_moves_is_drawn_where_it_will_be():
    draft = draft_of(SMALL)
    scene = scene_of(draft, Memory())
    number = next(k for k, leg in enumerate(draft.itinerary.legs) if leg.motion)
    leg, end = (
        draft.itinerary.legs[number],
        draft.starts[number] + draft.durations[number],
    )
    at = int(np.ceil(end / scene.step))
    assert np.allclose(scene.positions[at], leg.goal, atol=0.3)
    assert np.abs(leg.goal - leg.start).max() > 3.0
    # What it becomes has a name of its own, which no script says.
    assert scene.chapters[number].label == "row"


def test_what_arrives_and_leaves_in_motion_is_drawn_with_its_velocities():
    script = """\
showc: 1
drones: 4
formations: {ring: {type: circle, radius: 8}, up: {like: ring, centre: [0, 0, 20]}}
transitions:
  - {to: ring, at: 20, hold: 9, motion: [{rotate: 90}], leave: moving}
  - {to: up, at: 45, hold: 9, motion: [{rotate: 90}], arrive: moving}
"""
    draft = draft_of(script)
    scene = scene_of(draft, Memory())
    number = next(k for k, leg in enumerate(draft.itinerary.legs) if leg.start_state is
                  not None and leg.goal_state is not None)  # fmt: skip
    leg, begin = draft.itinerary.legs[number], draft.starts[number]
    # The motion before it fills the time: the picture stands at its cue.
    assert begin + draft.durations[number] == 45.0
    speed = np.linalg.norm(np.diff(scene.positions, axis=0), axis=-1) / scene.step
    for joint, state in ((begin, leg.start_state), (45.0, leg.goal_state)):
        own = np.linalg.norm(state[:, 3:6], axis=1)
        assert own.min() > 0.2
        at = int(joint / scene.step)
        assert np.allclose(speed[at - 1 : at + 2], own, atol=0.25)


def test_groups_with_times_of_their_own_are_drawn_in_them():
    script = (ROOT / "shows" / "lanes.yaml").read_text(encoding="utf-8")
    # What a move is called says nothing of what it is.
    script = script.replace("{to: crown,", "{to: crown, name: hold after wheel,")
    draft = draft_of(script)
    scene = scene_of(draft, Memory())
    (chapter,) = (one for one in scene.chapters if one.moves)
    assert [(one.group, one.start, one.duration) for one in chapter.moves] == [
        ("left", 10.0, 8.0),
        ("left", 18.0, 6.0),
        ("middle", 14.0, 8.0),
        ("middle", 22.0, 12.0),
        ("right", 18.0, 8.0),
        ("left", 24.0, 6.0),
    ]
    assert [one.label for one in chapter.moves if one.held] == ["wheel", "crown"]
    assert chapter.moves[1].name == "wheel in motion"
    times = scene.step * np.arange(len(scene.positions))
    moves = np.linalg.norm(np.diff(scene.positions, axis=0), axis=-1) > 1e-9
    middle = 0.5 * (times[1:] + times[:-1])
    within = (middle > 10.2) & (middle < 29.8)
    for drones, spans in (
        (slice(0, 4), [(10, 18), (18, 24), (24, 30)]),
        (slice(4, 8), [(18, 26)]),
        (slice(8, 12), [(14, 22), (22, 34)]),
    ):
        near = [(middle > begin - 0.2) & (middle < end + 0.2) for begin, end in spans]
        deep = [(middle > begin + 0.5) & (middle < end - 0.5) for begin, end in spans]
        assert not moves[within & ~np.any(near, axis=0), drones].any()
        assert moves[np.any(deep, axis=0), drones].any(axis=1).all()
    # The wheel is left while it turns.
    speed = np.linalg.norm(np.diff(scene.positions, axis=0), axis=-1) / scene.step
    at = int(24.0 / scene.step)
    assert speed[at - 1 : at + 2, :4].min() > 0.5


def test_what_did_not_change_is_not_worked_out_again(monkeypatch):
    memory, show = Memory(), read_show(SMALL.encode()).show
    first = scene_of(lay_out(show, memory), memory)

    def never(*_, **__):
        raise AssertionError

    monkeypatch.setattr("showc.preview.draft.assign", never)
    monkeypatch.setattr("showc.preview.draft.least_times", never)
    again = scene_of(lay_out(show, memory), memory)
    assert np.array_equal(first.positions, again.positions)


@pytest.mark.parametrize("shape", ["sphere", "ellipsoid", "any-axis", "all-axes"])
def test_the_nearest_pair_on_lines_is_where_it_is_said_to_be(shape, monkeypatch):
    from showc.vehicle.metric import measure

    # Several blocks of rows, the last of them shorter.
    monkeypatch.setattr("showc.plan.assignment._BLOCK", 5)
    random = np.random.default_rng(5)
    start, goal = random.uniform(-9, 9, (2, 12, 3))
    separation = Separation(1.0, shape, 2.0)
    found = nearest_on_lines(start, goal, separation)
    place = start + found.share * (goal - start)
    own = measure(place[found.first] - place[found.second], separation)
    assert own == pytest.approx(found.distance, abs=1e-9)
    rows, columns = np.triu_indices(12, 1)
    for share in np.linspace(0.0, 1.0, 201):
        place = start + share * (goal - start)
        apart = measure(place[rows] - place[columns], separation)
        assert apart.min() >= found.distance - 1e-9


def about(session):
    (length,) = struct.unpack_from("<I", session.body)
    return json.loads(session.body[4 : 4 + length])


@contextmanager
def following(script, tmp_path, **more):
    session = Session(script, SolveOptions(cache=tmp_path / "cache"), **more)
    stopped = threading.Event()

    def follow():
        # The loop of the command, until the test is over.
        try:
            session.follow()
        except InterruptedError:
            stopped.set()

    def pause(seconds):
        if ending.wait(seconds):
            raise InterruptedError

    ending = threading.Event()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("showc.preview.session.time", type("Clock", (), {"sleep": pause}))
        thread = threading.Thread(target=follow, daemon=True)
        thread.start()
        try:
            yield session
        finally:
            ending.set()
            thread.join(30.0)
        assert stopped.is_set()


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_every_save_is_drawn_and_mistakes_leave_the_last_picture(tmp_path):
    script = tmp_path / "show.yaml"
    script.write_text(SMALL, "utf-8")
    with following(script, tmp_path) as session:
        until(lambda: session.version >= 1)
        assert about(session)["scene"]["name"] == "Small"
        assert [one["name"] for one in about(session)["pictures"]] == ["ring", "row"]
        script.write_text(SMALL.replace("Small", "Other"), "utf-8")
        until(lambda: about(session)["scene"]["name"] == "Other")
        script.write_text(SMALL.replace("to: ring", "to: rang"), "utf-8")
        until(lambda: about(session)["status"]["stale"])
        found = about(session)
        assert found["scene"]["name"] == "Other"
        assert [one["code"] for one in found["findings"]] == ["SHW107"]
        assert found["findings"][0]["line"] == 9


def test_faults_of_showc_leave_the_last_picture_until_the_next_save(
    tmp_path, monkeypatch, capfd
):
    def broken(*_, **__):
        raise RuntimeError("no such thing")

    script = tmp_path / "show.yaml"
    script.write_text(SMALL, "utf-8")
    with following(script, tmp_path) as session:
        until(lambda: session.version >= 1)
        for name in ("load_show", "lay_out"):
            with monkeypatch.context() as patch:
                patch.setattr(f"showc.preview.session.{name}", broken)
                script.write_text(SMALL.replace("Small", f"Not {name}"), "utf-8")
                until(lambda: about(session)["status"]["stale"])
            found = about(session)
            assert found["scene"]["name"] == "Small"
            (finding,) = found["findings"]
            assert "internal error" in finding["message"]
            assert "no such thing" in finding["message"]
            script.write_text(SMALL, "utf-8")
            until(lambda: not about(session)["status"]["stale"])
    assert "Traceback" in capfd.readouterr().err


def test_findings_say_when_and_where_they_can_be_seen(tmp_path):
    script = tmp_path / "show.yaml"
    near = SMALL.replace("radius: 6, centre", "radius: 0.9, centre")
    script.write_text(near, "utf-8")
    with following(script, tmp_path) as session:
        until(lambda: session.version >= 1)
        found = about(session)
        # An error, and still a picture to find it in.
        (finding,) = [one for one in found["findings"] if one["code"] == "SHW201"]
        assert found["scene"] is not None and not found["status"]["stale"]
        assert len(finding["drones"]) == 2 and finding["time"] is not None
        held = [one for one in found["scene"]["segments"] if one["picture"] == "ring"]
        assert finding["time"] == pytest.approx(held[0]["start"])


@pytest.mark.slow
def test_solved_flights_take_the_place_of_straight_lines(tmp_path):
    script = tmp_path / "show.yaml"
    script.write_text(SMALL, "utf-8")
    with following(script, tmp_path, solve=True) as session:

        def solved():
            status = about(session)["status"]
            return status["solved"] == status["legs"] and not status["solving"]

        until(lambda: session.version > 0 and solved(), seconds=180.0)
        states = {one["state"] for one in about(session)["scene"]["segments"]}
        assert states == {"solved"}


@pytest.fixture
def served(tmp_path):
    script = tmp_path / "show.yaml"
    script.write_text(SMALL, "utf-8")
    with following(script, tmp_path) as session:
        until(lambda: session.version >= 1)
        server = Server(session)
        server.start()
        try:
            yield server, script
        finally:
            server.shutdown()
            server.server_close()


def ask(server, path, headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def test_the_server_answers_this_machine_and_its_own_name_alone(served):
    server, _ = served
    assert server.server_address[0] == "127.0.0.1"
    own = f"127.0.0.1:{server.server_port}"
    answer, body = ask(server, "/", {"Host": own})
    assert answer.status == 200 and b"<canvas" in body
    policy = answer.getheader("Content-Security-Policy")
    assert "default-src 'none'" in policy and "unsafe" not in policy
    for host in ("evil.example", f"evil.example:{server.server_port}", "127.0.0.1"):
        assert ask(server, "/scene", {"Host": host})[0].status == 421
    assert ask(server, "/scene", {})[0].status == 421
    crossed = {"Host": own, "Sec-Fetch-Site": "cross-site"}
    assert ask(server, "/scene", crossed)[0].status == 403
    assert ask(server, "/../../etc/passwd", {"Host": own})[0].status == 404
    answer, _ = ask(server, "/scene", {"Host": own})
    assert answer.getheader("Access-Control-Allow-Origin") is None


def test_the_page_follows_the_script_in_the_browser(served, tab):
    server, script = served
    tab.errors.clear()
    tab.visit(f"{server.url}?play=0&t=3")
    assert tab.evaluate("document.querySelector('#title').textContent") == "Small"
    assert tab.evaluate("document.querySelectorAll('#pictures canvas').length") == 2
    script.write_text(BIG.replace("showc: 1", "showc: 1\nname: Big"), "utf-8")
    title = "document.querySelector('#title').textContent"
    until(lambda: tab.evaluate(title) == "Big")
    assert tab.evaluate("show.drones") == 500
    before = tab.evaluate("placeAt(0, show.duration / 2)[2]")
    script.write_text(BIG.replace("[0, 0, 60]", "[0, 0, 90]"), "utf-8")
    until(lambda: tab.evaluate("placeAt(0, show.duration / 2)[2]") > before + 20.0)
    script.write_text(BIG.replace("gold", "gild"), "utf-8")
    rows = "document.querySelectorAll('#findings li.error').length"
    until(lambda: tab.evaluate(rows) == 1)
    assert tab.evaluate("show.drones") == 500
    assert tab.errors == []
    asked = "performance.getEntriesByType('resource').map(e => new URL(e.name).host)"
    assert set(tab.evaluate(asked)) == {f"127.0.0.1:{server.server_port}"}
